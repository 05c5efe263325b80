"""What the leading robot sees and makes of it: its scan, its map in polar cells, its circles.

    frames and traces of the focus --look--> Looks --> scan (points), cells (arcs), circles (rings)

A cell is drawn as an arc as thick as its ring, so few numbers do for a whole map.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from math import cos, pi

import msgspec
import numpy as np

from dashboards import batches, stage
from dashboards.batches import Batch, Drawing, Flags, Rows, command_of, frame_of
from swarm import geometry
from swarm.geometry import TAU, Floats
from swarm.messages import Command, FrameRecord

CELL_M = 0.08  # as thick as an occupied cell is drawn, a little more than it is
FREE_M = 0.015  # half of a ray's thickness
ARC_POINTS = 3
CIRCLE_WIDTH_RAD_MAX = 119.0 * pi / 180.0  # wider ones would hold the robot


class Looks(msgspec.Struct, frozen=True, eq=False):
    """Ticks of a batch at which the focus has sensed and answered."""

    rows: Rows  # (looks,) of the batch
    focus: Rows  # (looks,) of the scenario
    frames: list[FrameRecord]
    commands: list[Command]
    poses: Floats  # (looks, 3): x_m, y_m, yaw_rad


def draw(batch: Batch) -> Iterator[Drawing]:
    """Scan, cells and circles; no lines where the focus has nothing to show."""
    if not batch.maps:
        return
    looks = look(batch)
    rows = np.array(list(batch.maps), np.intp)
    places = np.searchsorted(rows, looks.rows)

    def spread(counts: Floats | Rows | list[int]) -> list[int]:
        """Instances in every row that is drawn."""
        result = np.zeros(len(rows), np.int64)
        result[places] = counts
        found: list[int] = result.tolist()
        return found

    hits, counts = scan(batch, looks)
    yield Drawing("world/scan", rows, batches.points(hits, spread(counts)))
    lines, flags, colours = cells(batch, looks)
    shades = np.broadcast_to(colours, flags.shape)[flags]
    radii_m = np.where(shades == stage.CELL_FREE, FREE_M, CELL_M / 2.0)
    drawn = batches.strips(lines[flags], spread(flags.sum(axis=1)), shades, radii_m)
    yield Drawing("world/msam/cells", rows, drawn)
    rings, colours, counts = circles(batch, looks)
    drawn = batches.strips(rings, spread(counts), colours)
    yield Drawing("world/msam/circles", rows, drawn)


def look(batch: Batch) -> Looks:
    """What the focus of each tick saw and answered."""
    rows: list[int] = []
    focus: list[int] = []
    frames: list[FrameRecord] = []
    commands: list[Command] = []
    for row, company in batch.maps.items():
        record = batch.records[row]
        frame = frame_of(record, company.focus)
        command = command_of(record, batch.scenario.robots[company.focus].name)
        if frame is not None and command is not None and _fits(batch, command):
            rows.append(row)
            focus.append(company.focus)
            frames.append(frame)
            commands.append(command)
    poses = [(frame.pose.x_m, frame.pose.y_m, frame.pose.yaw_rad) for frame in frames]
    return Looks(
        rows=np.array(rows, np.intp),
        focus=np.array(focus, np.intp),
        frames=frames,
        commands=commands,
        poses=np.array(poses).reshape(-1, 3),
    )


def _fits(batch: Batch, command: Command) -> bool:
    """A robot may say anything; a map of another size is not drawn."""
    return command.trace.sectors.dtype == "<f4" and command.trace.sectors.shape == (
        batch.scenario.msam.sectors,
    )


def scan(batch: Batch, looks: Looks) -> tuple[Floats, list[int]]:
    """(hits, 2) m: where the beams ended; and how many hits each look has."""
    beams = batch.scenario.sensor.beams
    ranges_m = _table([frame.ranges.data for frame in looks.frames], beams)
    some = np.isfinite(ranges_m)
    return _polar(looks, _centres(beams), ranges_m)[some], some.sum(axis=1).tolist()


def cells(batch: Batch, looks: Looks) -> tuple[Floats, Flags, stage.Colours]:
    """The polar maps: the way to an occupied cell is free.

    Returns:
        (looks, 3 sectors + 1, ARC_POINTS, 2) m: a ray per sector, an arc per occupied cell, one
        per cell where a robot that it hears begins (that is not on its map), the target's;
        (looks, 3 sectors + 1) whether there is one; (3 sectors + 1,) its colour.
    """
    count = batch.scenario.msam.sectors
    range_m, centres_rad = batch.scenario.sensor.range_m, _centres(count)
    sectors_m = _table([one.trace.sectors.data for one in looks.commands], count)
    peers_m = _peers(batch, looks, count)
    body_m = batch.radii_m[looks.focus][:, None]
    free_m = np.maximum(np.minimum(np.minimum(sectors_m, peers_m), range_m), body_m)
    target_rad, target_m, aims = _targets(looks, range_m, count)

    half_rad = 0.5 * TAU / count
    across_rad = np.linspace(-half_rad, half_rad, ARC_POINTS)
    inner_m = np.concatenate([sectors_m, peers_m, target_m], axis=1)
    middles_rad = np.concatenate(
        [np.tile([*centres_rad, *centres_rad], (len(inner_m), 1)), target_rad], axis=1
    )
    occupied = np.isfinite(inner_m)
    occupied[:, -1:] &= aims
    angles_rad = np.concatenate(
        [
            np.broadcast_to(centres_rad[:, None], (len(inner_m), count, ARC_POINTS)),
            middles_rad[:, :, None] + across_rad,
        ],
        axis=1,
    )
    middle_m = np.where(occupied, inner_m, 0.0) + CELL_M / 2.0
    distances_m = np.concatenate(
        [
            np.linspace(np.broadcast_to(body_m, free_m.shape), free_m, ARC_POINTS, axis=2),
            np.broadcast_to(middle_m[:, :, None], (*middle_m.shape, ARC_POINTS)),
        ],
        axis=1,
    )
    flags = np.concatenate([np.ones_like(free_m, bool), occupied], axis=1)
    kinds = [stage.CELL_FREE, stage.CELL_OBSTACLE, stage.CELL_ROBOT, stage.CELL_TARGET]
    colours = np.repeat(np.array(kinds, np.uint32), [count, count, count, 1])
    return _polar(looks, angles_rad, distances_m), flags, colours


def circles(batch: Batch, looks: Looks) -> tuple[Floats, stage.Colours, list[int]]:
    """How far the focus sees, and the virtual circles of eq. 19 to 21 that it fits to its map.

    Returns:
        (rings, points, 2) m, their colours, and how many each look has.
    """
    places: list[tuple[float, float, float]] = []  # centre and radius
    colours: list[int] = []
    for frame, command in zip(looks.frames, looks.commands, strict=True):
        pose = frame.pose
        places.append((pose.x_m, pose.y_m, batch.scenario.sensor.range_m))
        colours.append(stage.SENSOR_RANGE)
        for arc in command.trace.arcs:
            # The centre lies at twice the distance to the arc's chord; the radius is r_o.
            away_m = 2.0 * arc.range_m * cos(min(arc.width_rad, CIRCLE_WIDTH_RAD_MAX) / 2.0)
            x, y = geometry.unit(pose.yaw_rad + arc.bearing_rad)
            places.append((pose.x_m + away_m * x, pose.y_m + away_m * y, arc.range_m))
            colours.append(stage.CIRCLE)
    table = np.array(places).reshape(-1, 1, 3)
    counts = [1 + len(command.trace.arcs) for command in looks.commands]
    return table[:, :, :2] + table[:, :, 2:] * stage.RING, np.array(colours, np.uint32), counts


def _peers(batch: Batch, looks: Looks, count: int) -> Floats:
    """(looks, sectors) m: where bodies of those begin whom the focus hears, inf where none does."""
    result = np.full((len(looks.rows), count), np.inf)
    heard = [np.frombuffer(frame.heard.data, "<i4")[::2] for frame in looks.frames]
    which = np.repeat(np.arange(len(heard)), [len(one) for one in heard])
    others = np.concatenate([np.empty(0, np.int32), *heard])
    apart = batch.positions[looks.rows[which], others] - looks.poses[which, :2]
    distances_m = np.sqrt((apart**2).sum(axis=1))
    radii_m = batch.radii_m[others]
    near = (distances_m > radii_m) & (distances_m < batch.scenario.sensor.range_m)
    which, apart, distances_m, radii_m = which[near], apart[near], distances_m[near], radii_m[near]
    bearings_rad = np.arctan2(apart[:, 1], apart[:, 0]) - looks.poses[which, 2]
    off_rad = np.abs((_centres(count) - bearings_rad[:, None] + pi) % TAU - pi)
    half_rad = np.arcsin(radii_m / distances_m) + 0.5 * TAU / count
    begin_m = np.where(off_rad <= half_rad[:, None], (distances_m - radii_m)[:, None], np.inf)
    np.minimum.at(result, which, begin_m)
    return result


def _targets(looks: Looks, range_m: float, count: int) -> tuple[Floats, Floats, Flags]:
    """(looks, 1) sector's middle, distance in m within the lidar's range, whether there is any."""
    points = [command.trace.waypoint or (np.nan, np.nan) for command in looks.commands]
    apart = np.array(points).reshape(-1, 2) - looks.poses[:, :2]
    bearings_rad = np.arctan2(apart[:, 1], apart[:, 0]) - looks.poses[:, 2]
    width_rad = TAU / count
    sectors = np.floor(((bearings_rad + pi) % TAU) / width_rad)
    away_m = np.minimum(np.sqrt((apart**2).sum(axis=1)), range_m) - CELL_M / 2.0
    middles_rad = (sectors + 0.5) * width_rad - pi
    aims = np.isfinite(away_m)
    return np.where(aims, middles_rad, 0.0)[:, None], away_m[:, None], aims[:, None]


def _polar(looks: Looks, angles_rad: Floats, distances_m: Floats) -> Floats:
    """(looks, ..., 2) m, world frame, of directions and distances as the focus has them."""
    poses = looks.poses.reshape(-1, *[1] * (distances_m.ndim - 1), 3)
    world_rad = angles_rad + poses[..., 2]
    away_m = np.where(np.isfinite(distances_m), distances_m, 0.0)
    return np.stack(
        [
            poses[..., 0] + away_m * np.cos(world_rad),
            poses[..., 1] + away_m * np.sin(world_rad),
        ],
        axis=-1,
    )


def _table(rows: list[bytes], width: int) -> Floats:
    """(rows, width) of float32 as bytes."""
    return np.frombuffer(b"".join(rows), "<f4").reshape(len(rows), width).astype(np.float64)


@cache
def _centres(count: int) -> Floats:
    return np.array(geometry.sector_centres(count))
