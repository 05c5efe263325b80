"""Which bearings of a slot are free of all that is known: a loop over bearings and points."""

from __future__ import annotations

import numpy as np

from agents.navigator.compiled import compiled
from swarm.geometry import Floats

# Columns of a bearing: turn from the nominal one, rad; what it costs beyond that to go over to it;
# way-point from the leader along and across the formation's heading, m.
TURN, MORE, X, Y = range(4)


@compiled
def cheapest(
    bearings: Floats,
    points_m: Floats,
    from_x: float,
    from_y: float,
    ahead: float,
    aside: float,
    behind_m: float,
    ahead_m: float,
    clear_m: float,
) -> int:
    """Row of the cheapest bearing whose corridor no point is nearer to than `clear_m`; -1: none.

    Args:
        bearings: (bearings, 4), least turn first.
        points_m: (points, 2) from the robot, world axes.
        from_x, from_y: the robot from the leader, world axes.
        ahead, aside: cosine and sine of the formation's heading, along which corridors reach from
            behind way-points to ahead of them.
    """
    count = len(points_m)
    xs, ys = np.empty(count), np.empty(count)
    for index in range(count):
        x, y = points_m[index, 0] + from_x, points_m[index, 1] + from_y
        xs[index] = ahead * x + aside * y
        ys[index] = ahead * y - aside * x
    best, least = -1, np.inf
    for row in range(len(bearings)):
        if bearings[row, TURN] >= least:
            break
        cost = bearings[row, TURN] + bearings[row, MORE]
        if cost >= least:
            continue
        rear, front = bearings[row, X] - behind_m, bearings[row, X] + ahead_m
        free = True
        for index in range(count):
            off = ys[index] - bearings[row, Y]
            if -clear_m < off < clear_m:
                beyond = 0.0
                if xs[index] < rear:
                    beyond = rear - xs[index]
                elif xs[index] > front:
                    beyond = xs[index] - front
                if off * off + beyond * beyond < clear_m * clear_m:
                    free = False
                    break
        if free:
            best, least = row, cost
    return best
