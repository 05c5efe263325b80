"""Inner loops of the memory: hits to points, points to distances, and which way a vector points.

All in whole millimetres from the middle of the window where nothing else is said.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from agents.navigator.compiled import compiled
from swarm.geometry import Floats, Ranges

Points = npt.NDArray[np.int16]  # (points, 2) mm, window
Counts = npt.NDArray[np.uint8]
Field = npt.NDArray[np.uint16]  # (side, side) mm, by column (x) and row (y)

# A point is gone when beams passed through it this often, and by so much beyond it.
MISSES_MAX = 3
BEYOND_M = 0.08


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
    # No hit is in the fine cell of a point that is further off than all of them.
    range_max_m = 0.0
    for beam in range(beams):
        range_m = float(hits_m[beam])
        if range_m < 1e6:
            range_max_m = max(range_max_m, range_m)
    span_mm = 1000.0 * range_max_m + 3.0 * fine_mm
    table = np.zeros(slots, dtype=np.int32)  # point + 1, by its fine cell
    points[:known] = points_mm
    missed[:known] = misses
    for index in range(known):
        px_mm = int(points_mm[index, 0])
        py_mm = int(points_mm[index, 1])
        if abs(px_mm - x_mm) > span_mm or abs(py_mm - y_mm) > span_mm:
            continue
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
def is_clear(
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
    to_x: float,
    to_y: float,
    keep_m: float,
) -> bool:
    """Whether nothing that `gather` would find lies nearer than so to the straight way from (x, y).

    Args:
        to_x, to_y: m from there.
    """
    for beam in range(len(hits_m)):
        range_m = float(hits_m[beam])
        if not range_m < 1e6:
            continue
        ux, uy = units[beam, 0], units[beam, 1]
        dx = seen_x + 1000.0 * range_m * (ahead * ux - aside * uy) - x_mm
        dy = seen_y + 1000.0 * range_m * (aside * ux + ahead * uy) - y_mm
        if is_beside(dx / 1000.0, dy / 1000.0, to_x, to_y, keep_m):
            return False
    for index in range(len(points_mm)):
        dx = int(points_mm[index, 0]) - x_mm
        dy = int(points_mm[index, 1]) - y_mm
        if int(misses[index]) < MISSES_MAX and is_beside(
            dx / 1000.0, dy / 1000.0, to_x, to_y, keep_m
        ):
            return False
    return True


@compiled
def is_beside(x_m: float, y_m: float, to_x: float, to_y: float, keep_m: float) -> bool:
    """Whether a point lies nearer than `keep_m` to the straight way from here."""
    way2_m2 = to_x * to_x + to_y * to_y
    if way2_m2 > 0.0:
        share = (x_m * to_x + y_m * to_y) / way2_m2
        share = max(0.0, min(1.0, share))
        x_m -= share * to_x
        y_m -= share * to_y
    return x_m * x_m + y_m * y_m < keep_m * keep_m


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
