"""What a robot remembers of obstacles: points in a window of the world, and the distance to them.

    hits --new ones--> points --stamp--> field D      points that beams pass through --clear--> gone

The window is a square anchored in the world that is moved on, by whole cells, when the robot nears
its border. Points and distances are whole millimetres from the middle of its middle cell; a cell
is centred on a multiple of its size, so that mirrored robots have mirrored windows.

A State keeps points (5 bytes each) and a field (2 bytes a cell, 98 kB as the defaults are), which
successive States share as long as no point is added.
"""

from __future__ import annotations

from functools import lru_cache

import msgspec
import numpy as np
import numpy.typing as npt

from agents.navigator import points
from agents.navigator.law import Law
from agents.navigator.points import Counts, Field, Points
from swarm import geometry
from swarm.geometry import Floats, Pose, Ranges, Vec2

POINTS_MAX = 4000  # then nothing new is remembered until the window moves on
# Beams that lie this close together tell what is gone; further off they pass beside what is thin.
BEAM_SPACING_M = 0.08
GONE_AFTER_TICKS = 6  # from one clearing to the next: each costs a field of its own
BORDER = 0.55  # the window moves when the robot is beyond this share of it from its middle


class Memory(msgspec.Struct, frozen=True):
    """Points and the distances to them, as bytes of arrays: they cannot be changed in place."""

    origin_mm: tuple[int, int]  # world, of the middle of the middle cell
    field: memoryview  # (side, side) uint16 mm to the nearest point, read-only
    points: bytes = b""  # (points, 2) int16 mm
    misses: bytes = b""  # (points,) uint8 beams that passed through since it was last seen
    ticks: int = 0  # since points were cleared
    version: int = 0  # of the distances: counts changes
    grown: int = 0  # version at which distances last grew, so that a better way may exist

    def points_mm(self) -> Points:
        """Read-only view."""
        # In half the time of np.frombuffer and a reshape, here and where else it matters.
        return np.ndarray((len(self.points) // 4, 2), np.int16, self.points)

    def counts(self) -> Counts:
        """Read-only view of the misses."""
        return np.ndarray((len(self.misses),), np.uint8, self.misses)

    def field_mm(self, law: Law) -> Field:
        """Read-only view."""
        shape = (law.side_cells, law.side_cells)
        found: Field = np.ndarray(shape, np.uint16, self.field)
        if found.flags.aligned:
            return found
        return np.ndarray(shape, np.uint16, bytes(self.field))  # it has come over a wire


class Beams(msgspec.Struct, frozen=True, eq=False):
    """Directions of a lidar, body frame, and where one beam's share of the circle ends."""

    units: Floats  # (beams, 2)
    bounds: Floats  # (beams + 1,) as `diamond` has them


@lru_cache(maxsize=32)
def beams(count: int) -> Beams:
    """Directions of so many beams."""
    angles = geometry.sector_centres(count)
    half_rad = geometry.TAU / count / 2.0
    edges = [geometry.unit(angle - half_rad) for angle in angles]
    bounds = [-2.0, *[points.diamond(x, y) for x, y in edges[1:]], 2.0]
    return Beams(np.array([geometry.unit(angle) for angle in angles]), np.array(bounds))


def empty(law: Law, pose: Pose, version: int = 0) -> Memory:
    """Nothing known, around a robot."""
    return Memory(
        origin_mm=_cell_at(law, pose),
        field=shared(np.full((law.side_cells, law.side_cells), law.reach_mm, dtype=np.uint16)),
        version=version,
        grown=version,
    )


def within(memory: Memory, x_m: float, y_m: float) -> Vec2:
    """World point in mm from the window's middle."""
    return (1000.0 * x_m - memory.origin_mm[0], 1000.0 * y_m - memory.origin_mm[1])


def observe(
    law: Law, memory: Memory, pose: Pose, seen_m: Ranges, hits_m: Ranges
) -> tuple[Memory, Field]:
    """Memory after one scan, and the distances to all that is in it.

    Args:
        pose: at which it was made.
        seen_m: (beams,) all hits, peers' too: beams passed through all that is nearer.
        hits_m: (beams,) those of obstacles, inf for the rest.
    """
    rays = beams(len(hits_m))
    ahead, aside = geometry.unit(pose.yaw_rad)
    x_mm, y_mm = within(memory, pose.x_m, pose.y_m)
    points_mm, misses, gone = points.remember(
        memory.points_mm(),
        memory.counts(),
        POINTS_MAX,
        seen_m,
        hits_m,
        rays.units,
        rays.bounds,
        x_mm,
        y_mm,
        ahead,
        aside,
        max(1, law.cell_mm // 2),
        law.cell_mm * law.half_cells,
        BEAM_SPACING_M * len(hits_m) / geometry.TAU,
    )
    replace = msgspec.structs.replace
    before, count = len(memory.misses), len(points_mm)
    field_mm = _stamped(law, memory.field_mm(law), points_mm, before)
    if gone and memory.ticks >= GONE_AFTER_TICKS:
        lost = misses >= points.MISSES_MAX
        memory = replace(memory, field=shared(field_mm), ticks=0)
        memory = _unstamped(law, memory, points_mm, misses, lost)
        return memory, memory.field_mm(law)
    if count == before:
        return replace(memory, misses=misses.tobytes(), ticks=memory.ticks + 1), field_mm
    return replace(
        memory,
        points=points_mm.tobytes(),
        misses=misses.tobytes(),
        field=shared(field_mm),
        ticks=memory.ticks + 1,
        version=memory.version + 1,
    ), field_mm


def around(
    law: Law, memory: Memory, seen_from: Pose, hits_m: Ranges, pose: Pose, reach_m: float
) -> Floats:
    """(points, 2) m, world axes, from a pose: hits of this scan and points remembered, in reach.

    Args:
        seen_from: where the scan was made.
    """
    rays = beams(len(hits_m))
    ahead, aside = geometry.unit(seen_from.yaw_rad)
    return points.gather(
        memory.points_mm(),
        memory.counts(),
        hits_m,
        rays.units,
        *within(memory, seen_from.x_m, seen_from.y_m),
        ahead,
        aside,
        *within(memory, pose.x_m, pose.y_m),
        1000.0 * reach_m,
    )


def is_clear(
    memory: Memory, seen_from: Pose, hits_m: Ranges, pose: Pose, way_m: Vec2, keep_m: float
) -> bool:
    """Whether nothing that `around` finds lies nearer than so to a straight way.

    Args:
        way_m: from the pose to its end, m, world axes.
    """
    rays = beams(len(hits_m))
    ahead, aside = geometry.unit(seen_from.yaw_rad)
    return points.is_clear(
        memory.points_mm(),
        memory.counts(),
        hits_m,
        rays.units,
        *within(memory, seen_from.x_m, seen_from.y_m),
        ahead,
        aside,
        *within(memory, pose.x_m, pose.y_m),
        *way_m,
        keep_m,
    )


def shifted(law: Law, memory: Memory, pose: Pose) -> Memory:
    """Memory with its window around the robot once that nears its border."""
    x_mm, y_mm = within(memory, pose.x_m, pose.y_m)
    half_mm = law.cell_mm * law.half_cells
    if max(abs(x_mm), abs(y_mm)) < BORDER * half_mm:
        return memory
    if max(abs(x_mm), abs(y_mm)) > 2 * half_mm:  # nothing of it is left
        return empty(law, pose, memory.version + 1)
    origin_mm = _cell_at(law, pose)
    before_mm = memory.field_mm(law)
    dx_mm = origin_mm[0] - memory.origin_mm[0]
    dy_mm = origin_mm[1] - memory.origin_mm[1]
    moved_mm = memory.points_mm().astype(np.int64) - np.array((dx_mm, dy_mm))
    inside = (abs(moved_mm) <= half_mm).all(axis=1)
    field_mm = np.full_like(before_mm, law.reach_mm)
    old_x, new_x = _overlap(law.side_cells, dx_mm // law.cell_mm)
    old_y, new_y = _overlap(law.side_cells, dy_mm // law.cell_mm)
    field_mm[new_x, new_y] = before_mm[old_x, old_y]
    return msgspec.structs.replace(
        memory,
        origin_mm=origin_mm,
        points=moved_mm[inside].astype(np.int16).tobytes(),
        misses=memory.counts()[inside].tobytes(),
        field=shared(field_mm),
        version=memory.version + 1,
    )


def without(law: Law, memory: Memory, pose: Pose, radius_m: float) -> Memory:
    """Memory that has forgotten what is this near to the robot."""
    x_mm, y_mm = within(memory, pose.x_m, pose.y_m)
    away_mm = memory.points_mm() - np.array((x_mm, y_mm))
    kept = away_mm[:, 0] ** 2 + away_mm[:, 1] ** 2 > (1000.0 * radius_m) ** 2
    points_mm = memory.points_mm()[kept]
    blank = np.full((law.side_cells, law.side_cells), law.reach_mm, dtype=np.uint16)
    return msgspec.structs.replace(
        memory,
        points=points_mm.tobytes(),
        misses=memory.counts()[kept].tobytes(),
        field=shared(_stamped(law, blank, points_mm, 0)),
        ticks=0,
        version=memory.version + 1,
        grown=memory.version + 1,
    )


def cleared(law: Law, memory: Memory, discs: Floats) -> Memory:
    """Memory that has forgotten what lies in some discs; the same when nothing does.

    Args:
        discs: (discs, 3) m, world: x, y, radius.
    """
    points_mm = memory.points_mm()
    middle_mm = np.array(memory.origin_mm)
    lost = np.zeros(len(points_mm), dtype=np.bool_)
    for x_m, y_m, radius_m in discs.tolist():
        away_mm = points_mm - (np.array((1000.0 * x_m, 1000.0 * y_m)) - middle_mm)
        lost |= away_mm[:, 0] ** 2 + away_mm[:, 1] ** 2 < (1000.0 * radius_m) ** 2
    if not lost.any():
        return memory
    misses = memory.counts()
    return _unstamped(law, memory, points_mm, misses, lost)


def _unstamped(
    law: Law, memory: Memory, points_mm: Points, misses: points.Counts, lost: npt.NDArray[np.bool_]
) -> Memory:
    """Memory without some of its points.

    Args:
        points_mm, misses: all of them, and how often they have been missed.
        lost: (points,) which.
    """
    field_mm = memory.field_mm(law).copy()
    kept_mm = points_mm[~lost]
    points.unstamp(field_mm, points_mm[lost], kept_mm, law.cell_mm, law.reach_mm)
    return msgspec.structs.replace(
        memory,
        points=kept_mm.tobytes(),
        misses=misses[~lost].tobytes(),
        field=shared(field_mm),
        version=memory.version + 1,
        grown=memory.version + 1,
    )


def shared(field_mm: Field) -> memoryview:
    """A field as States share it: nobody may write to it from now on."""
    field_mm.setflags(write=False)
    return field_mm.data.cast("B")


def _stamped(law: Law, field_mm: Field, points_mm: Points, first: int) -> Field:
    """The same field, or a copy in which the points from `first` on count too; read-only."""
    if first == len(points_mm):
        return field_mm
    field_mm = field_mm.copy()
    points.stamp(field_mm, points_mm, first, len(points_mm), law.cell_mm, law.reach_mm)
    field_mm.setflags(write=False)
    return field_mm


def _cell_at(law: Law, pose: Pose) -> tuple[int, int]:
    cell_mm = law.cell_mm
    return (
        points.nearest(1000.0 * pose.x_m / cell_mm) * cell_mm,
        points.nearest(1000.0 * pose.y_m / cell_mm) * cell_mm,
    )


def _overlap(side: int, shift: int) -> tuple[slice, slice]:
    """Cells of the old window that the new one has too, and where it has them."""
    if shift >= 0:
        return slice(min(shift, side), side), slice(0, max(0, side - shift))
    return slice(0, max(0, side + shift)), slice(min(-shift, side), side)
