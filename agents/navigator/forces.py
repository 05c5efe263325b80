"""The improved artificial potential field of the navigator: across the attraction, never against.

    sub-goal --> F_att, a unit vector          points around --sectors--> F_rep, barrier --> F

The attraction is the descent of the navigation function, which has obstacles in it already; the
repulsion only centres: the paper's magnitude, its part across the attraction, capped. In touch the
barrier takes away what pulls inwards; what is left is the rotation about the obstacle.
"""

from __future__ import annotations

import numpy as np

from agents.navigator import memory as memories
from agents.navigator.compiled import compiled
from agents.navigator.points import bin_of
from swarm.geometry import Floats, Vec2
from swarm.messages import Forces
from swarm.scenario import RobotSetup

SECTORS = 72
NEAR_M = 0.02  # repulsion grows no further from here on
TOUCH_M = 0.015  # c0: here the barrier takes all that pulls inwards, ...
OUTWARDS = -0.5  # ... and nearer it asks for a pull outwards, up to this share
SWEEPS = 4
NOTHING = 0.01  # forces below this cancel each other


def add_up(setup: RobotSetup, pull: Vec2, points_m: Floats) -> Forces:
    """Forces for a pull.

    Args:
        pull: unit vector, world axes.
        points_m: (points, 2) around the robot, from its centre, world axes.
    """
    navigator = setup.navigator
    across_x, across_y, x, y = field(
        points_m,
        memories.beams(SECTORS).bounds,
        pull[0],
        pull[1],
        setup.robot.body_radius_m,
        navigator.reach_m,
        navigator.repulsion_m2,
        navigator.repulsion_max,
        navigator.barrier_m,
    )
    rotating = (x - pull[0] - across_x, y - pull[1] - across_y)
    return Forces(pull, (across_x, across_y), rotating, resultant=(x, y))


@compiled
def field(
    points_m: Floats,
    bounds: Floats,
    pull_x: float,
    pull_y: float,
    radius_m: float,
    reach_m: float,
    gain: float,
    across_max: float,
    barrier_m: float,
) -> tuple[float, float, float, float]:
    """Repulsion across the pull, and the sum of both after the barrier.

    F_rep = k (1/b - 1/rho) / b of eq. 27, away from the nearest point of each sector, b from the
    body's surface.
    """
    sectors = len(bounds) - 1
    nearest_m = np.full(sectors, 1e9)
    units = np.zeros((sectors, 2))
    far_m = radius_m + max(reach_m, barrier_m)
    for index in range(len(points_m)):
        x, y = points_m[index, 0], points_m[index, 1]
        away2 = x * x + y * y
        if away2 >= far_m * far_m or away2 == 0.0:
            continue
        away_m = np.sqrt(away2)
        sector = bin_of(bounds, x, y)
        if away_m < nearest_m[sector]:
            nearest_m[sector] = away_m
            units[sector, 0] = x / away_m
            units[sector, 1] = y / away_m
    push_x = push_y = 0.0
    closest_m = np.inf
    for sector in range(sectors):
        closest_m = min(closest_m, nearest_m[sector])
        gap_m = max(nearest_m[sector] - radius_m, NEAR_M)
        if gap_m < reach_m:
            size = gain * (1.0 / gap_m - 1.0 / reach_m) / gap_m
            push_x -= size * units[sector, 0]
            push_y -= size * units[sector, 1]
    across = pull_x * push_y - pull_y * push_x
    across = max(-across_max, min(across_max, across))
    across_x, across_y = -pull_y * across, pull_x * across
    x, y = pull_x + across_x, pull_y + across_y
    for _ in range(SWEEPS if closest_m - radius_m < barrier_m else 0):
        for sector in range(sectors):
            clear_m = nearest_m[sector] - radius_m
            if clear_m >= barrier_m:
                continue
            most = max(OUTWARDS, (clear_m - TOUCH_M) / (barrier_m - TOUCH_M))
            inwards = x * units[sector, 0] + y * units[sector, 1]
            if inwards > most:
                x -= (inwards - most) * units[sector, 0]
                y -= (inwards - most) * units[sector, 1]
    if x * x + y * y < NOTHING * NOTHING:
        x, y = pull_x, pull_y
    return across_x, across_y, x, y
