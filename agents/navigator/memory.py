"""What a robot remembers of obstacles: points in a window of the world, and the distance to them.

    hits --new ones--> points --stamp--> field D      points that beams pass through --clear--> gone

The window is a square anchored in the world that is moved on, by whole cells, when the robot nears
its border. Points and distances are whole millimetres from the middle of its middle cell; a cell
is centred on a multiple of its size, so that mirrored robots have mirrored windows.

A State keeps points (5 bytes each) and a field (2 bytes a cell, 98 kB as the defaults are) that
lags behind: it is shared by successive States, and the newest points are stamped into a copy that
lives for a tick.
"""

from __future__ import annotations

from functools import lru_cache

import msgspec
import numpy as np
import numpy.typing as npt

from agents.navigator.compiled import compiled
from agents.navigator.law import Law
from swarm import geometry
from swarm.geometry import Floats, Pose, Ranges, Vec2

Points = npt.NDArray[np.int16]  # (points, 2) mm, window
Counts = npt.NDArray[np.uint8]
Field = npt.NDArray[np.uint16]  # (side, side) mm, by column (x) and row (y)

POINTS_MAX = 4000  # then nothing new is remembered until the window moves on
PENDING_MAX = 24  # points that a kept field may lag behind
# A point is gone when beams passed through it this often, and by so much beyond it, ...
MISSES_MAX = 3
BEYOND_M = 0.08
# ... near enough for beams to lie this close together; further off they pass beside what is thin.
BEAM_SPACING_M = 0.08
GONE_AFTER_TICKS = 6  # from one clearing to the next: each costs a field of its own
BORDER = 0.55  # the window moves when the robot is beyond this share of it from its middle


class Memory(msgspec.Struct, frozen=True):
    """Points and the distances to them, as bytes of arrays: they cannot be changed in place."""

    origin_mm: tuple[int, int]  # world, of the middle of the middle cell
    points: bytes = b""  # (points, 2) int16 mm
    misses: bytes = b""  # (points,) uint8 beams that passed through since it was last seen
    field: bytes = b""  # (side, side) uint16 mm to the nearest of the first `stamped` points
    stamped: int = 0
    ticks: int = 0  # since points were cleared
    version: int = 0  # of the distances: counts changes
    grown: int = 0  # version at which distances last grew, so that a better way may exist

    def points_mm(self) -> Points:
        """Read-only view."""
        return np.frombuffer(self.points, dtype=np.int16).reshape(-1, 2)

    def field_mm(self, law: Law) -> Field:
        """Read-only view."""
        return np.frombuffer(self.field, dtype=np.uint16).reshape(law.side_cells, law.side_cells)


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
    bounds = [-2.0, *[diamond(x, y) for x, y in edges[1:]], 2.0]
    return Beams(np.array([geometry.unit(angle) for angle in angles]), np.array(bounds))


def empty(law: Law, pose: Pose, version: int = 0) -> Memory:
    """Nothing known, around a robot."""
    return Memory(
        origin_mm=_cell_at(law, pose),
        field=np.full(law.side_cells**2, law.reach_mm, dtype=np.uint16).tobytes(),
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
    points_mm, misses, gone = remember(
        memory.points_mm(),
        np.frombuffer(memory.misses, dtype=np.uint8),
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
    field_mm, count = memory.field_mm(law), len(points_mm)
    if gone and memory.ticks >= GONE_AFTER_TICKS:
        field_mm = _stamped(law, field_mm, points_mm, memory.stamped).copy()
        lost = misses >= MISSES_MAX
        kept_mm = points_mm[~lost]
        unstamp(field_mm, points_mm[lost], kept_mm, law.cell_mm, law.reach_mm)
        field_mm.setflags(write=False)
        return replace(
            memory,
            points=kept_mm.tobytes(),
            misses=misses[~lost].tobytes(),
            field=field_mm.tobytes(),
            stamped=len(kept_mm),
            ticks=0,
            version=memory.version + 1,
            grown=memory.version + 1,
        ), field_mm
    added = 4 * count > len(memory.points)
    field_mm = _stamped(law, field_mm, points_mm, memory.stamped)
    kept = count - memory.stamped > PENDING_MAX
    return replace(
        memory,
        points=points_mm.tobytes() if added else memory.points,
        misses=misses.tobytes(),
        field=field_mm.tobytes() if kept else memory.field,
        stamped=count if kept else memory.stamped,
        ticks=memory.ticks + 1,
        version=memory.version + added,
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
    return gather(
        memory.points_mm(),
        np.frombuffer(memory.misses, dtype=np.uint8),
        hits_m,
        rays.units,
        *within(memory, seen_from.x_m, seen_from.y_m),
        ahead,
        aside,
        *within(memory, pose.x_m, pose.y_m),
        1000.0 * reach_m,
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
    before_mm = _stamped(law, memory.field_mm(law), memory.points_mm(), memory.stamped)
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
        misses=np.frombuffer(memory.misses, dtype=np.uint8)[inside].tobytes(),
        field=field_mm.tobytes(),
        stamped=int(inside.sum()),
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
        misses=np.frombuffer(memory.misses, dtype=np.uint8)[kept].tobytes(),
        field=_stamped(law, blank, points_mm, 0).tobytes(),
        stamped=len(points_mm),
        ticks=0,
        version=memory.version + 1,
        grown=memory.version + 1,
    )


def _stamped(law: Law, field_mm: Field, points_mm: Points, first: int) -> Field:
    """The same field, or a copy in which the points from `first` on count too; read-only."""
    if first == len(points_mm):
        return field_mm
    field_mm = field_mm.copy()
    stamp(field_mm, points_mm, first, len(points_mm), law.cell_mm, law.reach_mm)
    field_mm.setflags(write=False)
    return field_mm


def _cell_at(law: Law, pose: Pose) -> tuple[int, int]:
    cell_mm = law.cell_mm
    return (
        nearest(1000.0 * pose.x_m / cell_mm) * cell_mm,
        nearest(1000.0 * pose.y_m / cell_mm) * cell_mm,
    )


def _overlap(side: int, shift: int) -> tuple[slice, slice]:
    """Cells of the old window that the new one has too, and where it has them."""
    if shift >= 0:
        return slice(min(shift, side), side), slice(0, max(0, side - shift))
    return slice(0, max(0, side + shift)), slice(min(-shift, side), side)


# --- inner loops --------------------------------------------------------------------------------


@compiled
def nearest(value: float) -> int:
    """Nearest whole number; halves away from zero, so that mirrors stay exact."""
    if value >= 0.0:
        return int(value + 0.5)
    return -int(0.5 - value)


@compiled
def diamond(x: float, y: float) -> float:
    """Number that grows with the angle of a vector, from -2 to 2 as that from -pi to pi."""
    if y >= 0.0:
        if x >= 0.0:
            return y / (x + y) if x + y > 0.0 else 0.0
        return 1.0 - x / (y - x)
    if x >= 0.0:
        return y / (x - y)
    return -1.0 + x / (-x - y)


@compiled
def bin_of(bounds: Floats, x: float, y: float) -> int:
    """Which part of the circle a vector points to; the bounds are as `diamond` has them."""
    count = len(bounds) - 1
    value = diamond(x, y)
    index = min(max(int((value + 2.0) * 0.25 * count), 0), count - 1)
    while index > 0 and value < bounds[index]:
        index -= 1
    while index < count - 1 and value >= bounds[index + 1]:
        index += 1
    return index


@compiled
def remember(
    points_mm: Points,
    misses: Counts,
    points_max: int,
    seen_m: Ranges,
    hits_m: Ranges,
    units: Floats,
    bounds: Floats,
    x_mm: float,
    y_mm: float,
    ahead: float,
    aside: float,
    fine_mm: int,
    half_mm: int,
    clear_m: float,
) -> tuple[Points, Counts, int]:
    """Points and misses after a scan from (x, y), and how many have been missed too often.

    A hit in a fine cell that has a point already is that point; of several hits of this scan in
    an empty one the nearest to the robot counts, whichever way round beams are numbered.
    """
    known = len(points_mm)
    beams = len(hits_m)
    per_mm = 1.0 / fine_mm
    room = min(max(points_max, known), known + beams)
    points = np.empty((room, 2), dtype=np.int16)
    missed = np.zeros(room, dtype=np.uint8)
    ranges = np.empty(beams, dtype=np.float64)  # of new points
    slots = 64
    while slots < 2 * room:
        slots *= 2
    table = np.zeros(slots, dtype=np.int32)  # point + 1, by its fine cell
    for index in range(known):
        px_mm = int(points_mm[index, 0])
        py_mm = int(points_mm[index, 1])
        points[index, 0] = px_mm
        points[index, 1] = py_mm
        missed[index] = misses[index]
        cell_x = nearest(px_mm * per_mm)
        cell_y = nearest(py_mm * per_mm)
        slot = (cell_x * 7919 + cell_y * 104729) & (slots - 1)
        while table[slot] != 0:
            slot = (slot + 1) & (slots - 1)
        table[slot] = index + 1
    # 1. What beams pass through.
    gone = 0
    clear2_mm2 = 1e6 * clear_m * clear_m
    for index in range(known):
        dx_mm = int(points[index, 0]) - x_mm
        dy_mm = int(points[index, 1]) - y_mm
        away2_mm2 = dx_mm * dx_mm + dy_mm * dy_mm
        if away2_mm2 > clear2_mm2:
            if int(missed[index]) >= MISSES_MAX:
                gone += 1
            continue
        away_m = np.sqrt(away2_mm2) / 1000.0
        body_x = ahead * dx_mm + aside * dy_mm
        body_y = ahead * dy_mm - aside * dx_mm
        beam = bin_of(bounds, body_x, body_y)
        before = beam - 1 if beam > 0 else beams - 1
        after = beam + 1 if beam + 1 < beams else 0
        far_m = away_m + BEYOND_M
        seen = float(seen_m[beam])
        if seen > far_m and float(seen_m[before]) > far_m and float(seen_m[after]) > far_m:
            missed[index] = min(int(missed[index]) + 1, 200)
        elif abs(seen - away_m) <= BEYOND_M:
            missed[index] = 0
        if int(missed[index]) >= MISSES_MAX:
            gone += 1
    # 2. What is new.
    count = known
    for beam in range(beams):
        range_m = float(hits_m[beam])
        if not range_m < 1e6:
            continue
        ux, uy = units[beam, 0], units[beam, 1]
        px_mm = nearest(x_mm + 1000.0 * range_m * (ahead * ux - aside * uy))
        py_mm = nearest(y_mm + 1000.0 * range_m * (aside * ux + ahead * uy))
        if abs(px_mm) > half_mm or abs(py_mm) > half_mm:
            continue
        cell_x = nearest(px_mm * per_mm)
        cell_y = nearest(py_mm * per_mm)
        slot = (cell_x * 7919 + cell_y * 104729) & (slots - 1)
        while table[slot] != 0:
            index = table[slot] - 1
            if (
                nearest(int(points[index, 0]) * per_mm) == cell_x
                and nearest(int(points[index, 1]) * per_mm) == cell_y
            ):
                break
            slot = (slot + 1) & (slots - 1)
        if table[slot] == 0:
            if count == room:
                continue
            table[slot] = count + 1
            index = count
            count += 1
        elif index < known:
            missed[index] = 0
            continue
        elif range_m > ranges[index - known]:
            continue
        elif range_m == ranges[index - known]:  # perhaps mirror images: their middle
            px_mm = nearest((px_mm + int(points[index, 0])) / 2)
            py_mm = nearest((py_mm + int(points[index, 1])) / 2)
        points[index, 0] = px_mm
        points[index, 1] = py_mm
        ranges[index - known] = range_m
    return points[:count], missed[:count], gone


@compiled
def gather(
    points_mm: Points,
    misses: Counts,
    hits_m: Ranges,
    units: Floats,
    seen_x: float,
    seen_y: float,
    ahead: float,
    aside: float,
    x_mm: float,
    y_mm: float,
    reach_mm: float,
) -> Floats:
    """(points, 2) m from (x, y): hits seen from another place, and points that are not missed."""
    found = np.empty((len(hits_m) + len(points_mm), 2))
    count = 0
    reach2_mm2 = reach_mm * reach_mm
    for beam in range(len(hits_m)):
        range_m = float(hits_m[beam])
        if not range_m < 1e6:
            continue
        ux, uy = units[beam, 0], units[beam, 1]
        dx = seen_x + 1000.0 * range_m * (ahead * ux - aside * uy) - x_mm
        dy = seen_y + 1000.0 * range_m * (aside * ux + ahead * uy) - y_mm
        if dx * dx + dy * dy < reach2_mm2:
            found[count, 0] = dx / 1000.0
            found[count, 1] = dy / 1000.0
            count += 1
    for index in range(len(points_mm)):
        dx = int(points_mm[index, 0]) - x_mm
        dy = int(points_mm[index, 1]) - y_mm
        if dx * dx + dy * dy < reach2_mm2 and int(misses[index]) < MISSES_MAX:
            found[count, 0] = dx / 1000.0
            found[count, 1] = dy / 1000.0
            count += 1
    return found[:count]


@compiled
def stamp(
    field_mm: Field, points_mm: Points, first: int, last: int, cell_mm: int, reach_mm: int
) -> None:
    """Lower the distances of all cells within reach of some points."""
    side = field_mm.shape[0]
    half = side // 2
    reach2_mm2 = reach_mm * reach_mm
    span = reach_mm // cell_mm + 1
    for index in range(first, last):
        px_mm = int(points_mm[index, 0])
        py_mm = int(points_mm[index, 1])
        column = nearest(px_mm / cell_mm) + half
        row = nearest(py_mm / cell_mm) + half
        for i in range(max(0, column - span), min(side, column + span + 1)):
            dx_mm = (i - half) * cell_mm - px_mm
            for j in range(max(0, row - span), min(side, row + span + 1)):
                dy_mm = (j - half) * cell_mm - py_mm
                away2_mm2 = dx_mm * dx_mm + dy_mm * dy_mm
                if away2_mm2 < reach2_mm2:
                    now_mm = int(field_mm[i, j])
                    if away2_mm2 < now_mm * now_mm:
                        field_mm[i, j] = int(np.sqrt(float(away2_mm2)))


@compiled
def unstamp(field_mm: Field, lost_mm: Points, kept_mm: Points, cell_mm: int, reach_mm: int) -> None:
    """Distances without some points that counted; the points that are kept count again there."""
    side = field_mm.shape[0]
    half = side // 2
    span = reach_mm // cell_mm + 1
    near_mm = 2 * reach_mm + 2 * cell_mm
    for index in range(len(lost_mm)):
        column = nearest(int(lost_mm[index, 0]) / cell_mm) + half
        row = nearest(int(lost_mm[index, 1]) / cell_mm) + half
        for i in range(max(0, column - span), min(side, column + span + 1)):
            for j in range(max(0, row - span), min(side, row + span + 1)):
                field_mm[i, j] = reach_mm
    for index in range(len(kept_mm)):
        px_mm = int(kept_mm[index, 0])
        py_mm = int(kept_mm[index, 1])
        for other in range(len(lost_mm)):
            if (
                abs(px_mm - int(lost_mm[other, 0])) <= near_mm
                and abs(py_mm - int(lost_mm[other, 1])) <= near_mm
            ):
                stamp(field_mm, kept_mm, index, index + 1, cell_mm, reach_mm)
                break
