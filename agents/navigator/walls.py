"""What of the hits in sight are walls with a gap: inner loops of `gaps`.

hits, way --find--> narrow chord between two walls ahead
hits, way --inside--> two walls right and left of the robot
hits, mouth, axis --end--> how far there are walls on both sides
"""

from __future__ import annotations

from math import sqrt

import numpy as np

from agents.navigator.compiled import compiled
from agents.navigator.table import RADIUS
from swarm.geometry import Floats

ASIDE_M, SIGHT_M = 0.4, 3.6  # its middle is this near to the way, and to the robot
ROUNDING_M = 1e-6
ACROSS_MIN = 0.35  # sine of the angle between chord and way
FLANK_M, FLANK_NEAR_M = 1.4, 0.35  # both posts go on as walls: a hit this near to so far beyond
CIRCLE_M = 0.04  # nothing stands inside the circle on the chord, less this
DISTANCE_COST = 0.2  # of a chord further away
ZONE_M = 4.6  # a gap is followed so far along its axis
# Who stands between two walls is inside a gap: they are straight to this, without larger holes,
# and at least this long. Two pairs of round obstacles are not.
STRAIGHT_M, HOLE_M, INSIDE_LONG_M = 0.12, 0.35, 1.0
FACING = -0.9  # cosine of the angle between the ways to the nearest points of both


@compiled
def find(
    points: Floats, path: Floats, rows: Floats, least_m: float, most_m: float, found: Floats
) -> None:
    """Narrow chord between two walls that the way leads through.

    Args:
        points: (n, 2) m from here.
        path: (cells, 2) m from here.
        rows: of `table`: what lies behind them is not seen.
        found: (5,) width, middle, axis; the width stays 0.0 where there is none.
    """
    count = points.shape[0]
    best = np.inf
    # Cells that can be near enough to the middle of a chord in sight.
    near = np.empty(path.shape[0], dtype=np.int64)
    nears = 0
    for cell in range(1, path.shape[0]):
        off_m = SIGHT_M + ASIDE_M + ROUNDING_M
        if path[cell, 0] * path[cell, 0] + path[cell, 1] * path[cell, 1] < off_m * off_m:
            near[nears] = cell
            nears += 1
    # Points that can be near enough to one of these to be a post of such a chord.
    posts = np.empty(count, dtype=np.int64)
    found_posts = 0
    for point in range(count):
        off_m = ASIDE_M + 0.5 * most_m + ROUNDING_M
        for number in range(nears):
            off_x = path[near[number], 0] - points[point, 0]
            off_y = path[near[number], 1] - points[point, 1]
            if off_x * off_x + off_y * off_y < off_m * off_m:
                posts[found_posts] = point
                found_posts += 1
                break
    for left in range(found_posts):
        one = posts[left]
        for right in range(left + 1, found_posts):
            other = posts[right]
            x_m = points[other, 0] - points[one, 0]
            y_m = points[other, 1] - points[one, 1]
            width2_m2 = x_m * x_m + y_m * y_m
            if width2_m2 <= least_m * least_m or width2_m2 >= most_m * most_m:
                continue
            width_m = sqrt(width2_m2)
            middle_x = 0.5 * (points[one, 0] + points[other, 0])
            middle_y = 0.5 * (points[one, 1] + points[other, 1])
            away_m = sqrt(middle_x * middle_x + middle_y * middle_y)
            cost = width_m + DISTANCE_COST * away_m
            if away_m > SIGHT_M or cost >= best:
                continue
            unit_x, unit_y = x_m / width_m, y_m / width_m
            # Where the way crosses the chord, or comes nearest to its middle.
            nearest_m2, nearest = ASIDE_M * ASIDE_M, -1
            for number in range(nears):
                cell = near[number]
                off_x, off_y = path[cell, 0] - middle_x, path[cell, 1] - middle_y
                off_m2 = off_x * off_x + off_y * off_y
                if off_m2 < nearest_m2:
                    nearest_m2, nearest = off_m2, cell
            if nearest < 1:
                continue
            last = min(nearest + 1, path.shape[0] - 1)
            way_x = path[last, 0] - path[nearest - 1, 0]
            way_y = path[last, 1] - path[nearest - 1, 1]
            way_m = sqrt(way_x * way_x + way_y * way_y)
            if way_m <= 0.0:
                continue
            way_x, way_y = way_x / way_m, way_y / way_m
            if abs(unit_x * way_y - unit_y * way_x) < ACROSS_MIN:
                continue
            radius_m = 0.5 * width_m - CIRCLE_M
            open_ = True
            before = after = False
            before_x = points[one, 0] - FLANK_M * unit_x
            before_y = points[one, 1] - FLANK_M * unit_y
            after_x = points[other, 0] + FLANK_M * unit_x
            after_y = points[other, 1] + FLANK_M * unit_y
            for hit in range(count):
                hit_x, hit_y = points[hit, 0], points[hit, 1]
                off_x, off_y = hit_x - middle_x, hit_y - middle_y
                if off_x * off_x + off_y * off_y < radius_m * radius_m:
                    open_ = False
                    break
                off_x, off_y = hit_x - before_x, hit_y - before_y
                if off_x * off_x + off_y * off_y < FLANK_NEAR_M * FLANK_NEAR_M:
                    before = True
                off_x, off_y = hit_x - after_x, hit_y - after_y
                if off_x * off_x + off_y * off_y < FLANK_NEAR_M * FLANK_NEAR_M:
                    after = True
            if not (open_ and before and after):
                continue
            for row in range(rows.shape[0]):
                off_x, off_y = rows[row, 0], rows[row, 1]
                share = (off_x * middle_x + off_y * middle_y) / (away_m * away_m)
                if 0.0 < share < 1.0:
                    off_x -= share * middle_x
                    off_y -= share * middle_y
                    hidden_m = 0.5 * width_m + rows[row, RADIUS]
                    if off_x * off_x + off_y * off_y < hidden_m * hidden_m:
                        open_ = False
                        break
            if not open_:
                continue
            best = cost
            axis_x, axis_y = -unit_y, unit_x
            if axis_x * way_x + axis_y * way_y < 0.0:
                axis_x, axis_y = -axis_x, -axis_y
            found[0], found[1], found[2] = width_m, middle_x, middle_y
            found[3], found[4] = axis_x, axis_y


@compiled
def inside(points: Floats, path: Floats, least_m: float, most_m: float, walls: Floats) -> None:
    """Two walls right and left of the robot, too near to each other for two.

    Args:
        points: (n, 2) m from here.
        path: (cells, 2) m from here.
        walls: (5,) width, axis along the way, how far they go on backwards and ahead, m from here;
            the width stays 0.0 where there are none.
    """
    count = points.shape[0]
    one, other = -1, -1
    one_m2 = other_m2 = most_m * most_m
    for hit in range(count):
        away_m2 = points[hit, 0] * points[hit, 0] + points[hit, 1] * points[hit, 1]
        if away_m2 < one_m2:
            one, one_m2 = hit, away_m2
    if one < 0 or one_m2 <= 0.0:
        return
    for hit in range(count):
        away_m2 = points[hit, 0] * points[hit, 0] + points[hit, 1] * points[hit, 1]
        if away_m2 >= other_m2:
            continue
        product = points[hit, 0] * points[one, 0] + points[hit, 1] * points[one, 1]
        if product < FACING * sqrt(away_m2 * one_m2):
            other, other_m2 = hit, away_m2
    if other < 0:
        return
    x_m, y_m = points[other, 0] - points[one, 0], points[other, 1] - points[one, 1]
    width_m = sqrt(x_m * x_m + y_m * y_m)
    if width_m <= least_m or width_m >= most_m:
        return
    axis_x, axis_y = -y_m / width_m, x_m / width_m
    # The way ahead, as far as it is that long.
    ahead = 0.0
    for cell in range(path.shape[0]):
        off_m2 = path[cell, 0] * path[cell, 0] + path[cell, 1] * path[cell, 1]
        if off_m2 < most_m * most_m:
            ahead = path[cell, 0] * axis_x + path[cell, 1] * axis_y
    if ahead < 0.0:
        axis_x, axis_y, ahead = -axis_x, -axis_y, -ahead
    if ahead <= 0.5 * least_m:
        return
    # Parts of both walls, of one hole each, from here both ways.
    parts = int(ZONE_M / HOLE_M)
    seen = np.zeros((2, 2 * parts), dtype=np.bool_)
    one_aside = points[one, 1] * axis_x - points[one, 0] * axis_y
    other_aside = points[other, 1] * axis_x - points[other, 0] * axis_y
    for hit in range(count):
        along_m = points[hit, 0] * axis_x + points[hit, 1] * axis_y
        aside_m = points[hit, 1] * axis_x - points[hit, 0] * axis_y
        part = int(np.floor(along_m / HOLE_M)) + parts
        if 0 <= part < 2 * parts:
            if abs(aside_m - one_aside) < STRAIGHT_M:
                seen[0, part] = True
            elif abs(aside_m - other_aside) < STRAIGHT_M:
                seen[1, part] = True
    last = parts
    while last < 2 * parts and seen[0, last] and seen[1, last]:
        last += 1
    first = parts
    while first > 0 and seen[0, first - 1] and seen[1, first - 1]:
        first -= 1
    if (last - first) * HOLE_M >= INSIDE_LONG_M:
        walls[0], walls[1], walls[2] = width_m, axis_x, axis_y
        walls[3], walls[4] = (parts - first) * HOLE_M, (last - parts) * HOLE_M


@compiled
def end(
    points: Floats, mouth_x: float, mouth_y: float, axis_x: float, axis_y: float, half_m: float
) -> float:
    """How far along the axis there are hits on both sides, m from the mouth."""
    left_m = right_m = 0.0
    for hit in range(points.shape[0]):
        x_m, y_m = points[hit, 0] - mouth_x, points[hit, 1] - mouth_y
        along_m = x_m * axis_x + y_m * axis_y
        aside_m = y_m * axis_x - x_m * axis_y
        if 0.0 < along_m < ZONE_M and abs(aside_m) < half_m:
            if aside_m > 0.0:
                left_m = max(left_m, along_m)
            else:
                right_m = max(right_m, along_m)
    return min(left_m, right_m)
