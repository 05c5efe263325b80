"""The motion situational awareness map: what is near, by direction (section 2.3).

    ranges --without peers--> beams --minimum, rings--> sectors --links--> clusters --split--> arcs

The map is the robot's own: polar, body frame, angle 0 ahead, sectors symmetric about the heading
so that mirrored robots see mirrored maps.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache, reduce
from math import atan2, ceil, cos, floor, inf, sin, sqrt

import msgspec
import numpy as np

from agents.peers import Peer
from swarm import geometry
from swarm.geometry import TAU, Floats, Ranges, Vec2
from swarm.messages import Arc
from swarm.scenario import Msam, RobotSetup

# A width of just n times the split angle makes n parts, whatever the last digit says.
ROUNDING = 1e-9
# The virtual circle of a wider arc would hold the robot; distances to it are taken at this width.
CIRCLE_WIDTH_RAD_MAX = 119.0 * TAU / 360.0


class Map(msgspec.Struct, frozen=True):
    """One look around; distances in m from the robot's centre, inf where free."""

    beams_m: list[float]  # (beams,) hits that are obstacles; none of a navigator's map
    ranges_m: Ranges  # (beams,) the same, read-only
    sectors_m: list[float]  # (sectors,) inner edge of the nearest occupied ring
    clusters: tuple[Arc, ...]  # runs of linked cells within rho, unsplit
    arcs: tuple[Arc, ...]  # the same, split; the virtual circles of eq. 19 to 21
    nearest_m: float  # of all sectors
    nearest_index: int


class Layout(msgspec.Struct, frozen=True, eq=False):
    """Directions of beams and sectors, body frame: constants of a scenario."""

    beam_units: list[Vec2]  # (beams,)
    beam_units_twice: list[Vec2]  # (2 beams,) for windows across the back
    sector_angles: list[float]  # (sectors,)
    sector_units: list[Vec2]  # (sectors,)
    beam_rad: float  # width
    sector_rad: float
    beam_units_array: Floats  # (beams, 2)


@lru_cache(maxsize=32)
def layout(beams: int, sectors: int) -> Layout:
    """Directions for so many beams and sectors."""
    beam_angles = geometry.sector_centres(beams)
    sector_angles = geometry.sector_centres(sectors)
    beam_units = [geometry.unit(angle) for angle in beam_angles]
    return Layout(
        beam_units=beam_units,
        beam_units_twice=beam_units * 2,
        sector_angles=sector_angles,
        sector_units=[geometry.unit(angle) for angle in sector_angles],
        beam_rad=TAU / beams,
        sector_rad=TAU / sectors,
        beam_units_array=np.array(beam_units),
    )


def update(setup: RobotSetup, ranges_m: Ranges, peers: Iterable[Peer]) -> Map:
    """Map of one scan, without the hits that belong to the given peers.

    Args:
        ranges_m: (beams,) m, inf for a miss; beam k looks to sector_centres(beams)[k].
        peers: those whose bodies are not obstacles. What stands behind them stays unseen.
    """
    directions = layout(len(ranges_m), setup.msam.sectors)
    beams_m: list[float] = ranges_m.tolist()
    hidden = peer_beams(setup.msam, directions, beams_m, peers)
    if hidden:
        for beam in hidden:
            beams_m[beam] = inf
        ranges_m = ranges_m.copy()
        ranges_m[hidden] = inf
    ranges_m = ranges_m.view()
    ranges_m.setflags(write=False)
    ring_m = setup.sensor.range_m / setup.msam.rings
    sectors_m = sector_ranges(ranges_m, setup.msam.sectors, ring_m)
    runs = linked_runs(sectors_m, setup.field.rho_m, setup.msam.link_distance_m)
    return of(setup, ranges_m, sectors_m, beams_m, runs)


def of(
    setup: RobotSetup,
    ranges_m: Ranges,
    sectors_m: list[float],
    beams_m: list[float],
    runs: list[range],
) -> Map:
    """Map of hits and of the sectors made from them.

    Args:
        ranges_m: (beams,) m, read-only, without those of peers.
        beams_m: the same, or none where nobody asks for them one by one.
        sectors_m: of `sector_ranges`.
        runs: of `linked_runs`.
    """
    clusters: list[Arc] = []
    arcs: list[Arc] = []
    for run in runs:
        cluster = _arc(sectors_m, run, 0, 1, 1.0)
        clusters.append(cluster)
        arcs += split(sectors_m, run, setup.msam.split_rad, whole=cluster)
    nearest_m = min(sectors_m)
    return Map(
        beams_m=beams_m,
        ranges_m=ranges_m,
        sectors_m=sectors_m,
        clusters=tuple(clusters),
        arcs=tuple(arcs),
        nearest_m=nearest_m,
        nearest_index=sectors_m.index(nearest_m),
    )


def peer_beams(
    msam: Msam, directions: Layout, beams_m: list[float], peers: Iterable[Peer]
) -> list[int]:
    """Beams whose hit lies on a peer's body, as far as its beacon tells where that is."""
    units = directions.beam_units_twice
    beams = len(beams_m)
    hidden = []
    for peer in peers:
        reach_m = (
            peer.beacon.body_radius_m
            + msam.peer_tolerance_m
            + msam.peer_tolerance_per_missed_tick_m * peer.missed_ticks
        )
        distance_m = peer.distance_m
        x_m, y_m = peer.offset_body
        half = beams / 2.0
        if distance_m > reach_m:
            beyond_m = sqrt(distance_m * distance_m - reach_m * reach_m)
            half = atan2(reach_m, beyond_m) / directions.beam_rad
        middle = peer.bearing_rad / directions.beam_rad + (beams - 1) / 2.0
        first = ceil(middle - half)
        count = min(floor(middle + half) - first + 1, beams)
        first %= beams
        near_m, far_m, reach2_m2 = distance_m - reach_m, distance_m + reach_m, reach_m * reach_m
        window = beams_m[first : first + count]
        if first + count > beams:  # across the back of the robot
            window += beams_m[: first + count - beams]
        for beam, range_m in enumerate(window, first):
            if near_m <= range_m <= far_m:
                unit_x, unit_y = units[beam]
                dx_m = range_m * unit_x - x_m
                dy_m = range_m * unit_y - y_m
                if dx_m * dx_m + dy_m * dy_m <= reach2_m2:
                    hidden.append(beam if beam < beams else beam - beams)
    return hidden


def sector_ranges(ranges_m: Ranges, sectors: int, ring_m: float) -> list[float]:
    """(sectors,) inner edge r_o = eta dr of the nearest occupied ring (eq. 18, 20), inf where free.

    The paper takes the lower corner of a cell; we do so for the range, which is cautious, but
    look to the middle of the sector, otherwise every obstacle would be turned by half a sector.
    """
    # Beam by beam across all sectors: half the time of a minimum along the short axis.
    nearest_m = reduce(np.minimum, ranges_m.reshape(sectors, -1).T).astype(np.float64)
    result: list[float] = (np.floor(nearest_m / ring_m) * ring_m).tolist()
    return result


def linked_runs(sectors_m: list[float], rho_m: float, link_m: float) -> list[range]:
    """Runs of neighbouring cells within rho that are close enough to be one obstacle.

    A run that crosses the back of the robot goes on past the number of sectors. A closed ring is
    one run that begins at sector 0.
    """
    count = len(sectors_m)
    turn = cos(TAU / count)
    runs: list[range] = []
    start = stop = 0  # of the run at hand
    before_m = inf
    for index in [index for index, range_m in enumerate(sectors_m) if range_m < rho_m]:
        range_m = sectors_m[index]
        if index != stop or not (
            range_m * range_m + before_m * before_m - 2.0 * range_m * before_m * turn
            < link_m * link_m
        ):
            if stop > start:
                runs.append(range(start, stop))
            start = index
        stop = index + 1
        before_m = range_m
    if stop > start:
        runs.append(range(start, stop))
    if len(runs) > 1 and runs[0].start == 0 and runs[-1].stop == count:
        a_m, b_m = sectors_m[-1], sectors_m[0]
        if a_m * a_m + b_m * b_m - 2.0 * a_m * b_m * turn < link_m * link_m:
            runs[-1] = range(runs[-1].start, count + runs[0].stop)
            del runs[0]
    return runs


def split(sectors_m: list[float], run: range, split_rad: float, whole: Arc) -> list[Arc]:
    """Arcs of one cluster, none wider than `split_rad`.

    The circle of eq. 21 has its surface at r_o (2 cos(width / 2) - 1): the robot would be inside
    it from 120 degrees on, so wide clusters are cut into equal parts, each with its own r_o. The
    weights add up to the cluster's width over `split_rad`, at least 1: an uncut arc is the
    paper's, and cutting does not multiply the force. Parts need not end between two cells (a
    shared cell counts for both), because whole cells could not be cut alike by mirrored robots.
    """
    if whole.width_rad <= split_rad:
        return [whole]
    parts = ceil(whole.width_rad / split_rad - ROUNDING)
    weight = whole.width_rad / split_rad / parts
    return [_arc(sectors_m, run, part, parts, weight) for part in range(parts)]


def _arc(sectors_m: list[float], run: range, part: int, parts: int, weight: float) -> Arc:
    count = len(sectors_m)
    cells = len(run)
    first = run.start + part * cells // parts
    stop = run.start - (-(part + 1) * cells // parts)
    middle = run.start + (part + 0.5) * cells / parts - 0.5
    width_rad = TAU / count
    return Arc(
        bearing_rad=geometry.wrap_angle((middle - (count - 1) / 2.0) * width_rad),
        range_m=min(sectors_m[first:stop])
        if stop <= count
        else min([sectors_m[index % count] for index in range(first, stop)]),
        width_rad=cells * width_rad / parts,
        weight=weight,
    )


def circle_distance(range_m: float, width_rad: float) -> float:
    """Distance |q - q_o| to the centre of the virtual circle (eq. 19, 21): twice that to its chord.

    r_o cos(width / 2) to the chord, and the circle is the robot's mirror image in it.
    """
    return 2.0 * range_m * cos(min(width_rad, CIRCLE_WIDTH_RAD_MAX) / 2.0)


def cell_points(
    map: Map, ring_m: float, reach_m: float, origin: Vec2, turn_rad: float
) -> list[Vec2]:
    """Centres of the occupied cells nearer than `reach_m`, in another frame.

    Args:
        origin: this robot's centre in that frame, m.
        turn_rad: its heading in that frame.
    """
    units = layout(len(map.beams_m), len(map.sectors_m)).sector_units
    x_m, y_m = origin
    ahead, aside = cos(turn_rad), sin(turn_rad)
    reach_m -= ring_m / 2.0
    return [
        (
            x_m + (middle_m := range_m + ring_m / 2.0) * (ahead * unit[0] - aside * unit[1]),
            y_m + middle_m * (aside * unit[0] + ahead * unit[1]),
        )
        for range_m, unit in zip(map.sectors_m, units, strict=True)
        if range_m < reach_m
    ]
