"""How fast to go: by the clearance along the way, braking for what is tight further on."""

from __future__ import annotations

from math import sqrt

import numpy as np

from agents.navigator.chords import Path, distance_at, share_at
from agents.navigator.compiled import compiled
from agents.navigator.law import Law
from agents.navigator.memory import Memory, within
from agents.navigator.points import Field
from agents.navigator.way import Way
from swarm.geometry import Floats, Pose, Vec2
from swarm.scenario import RobotSetup

BRAKES_SHARE = 0.7  # of the brakes, planned with
GOAL_SHARE = 0.8
# The clearance law never asks for less than this share of what it has in touch, except in touch.
FLOOR_SHARE = 0.8
SPARE_M = 0.3  # looked at beyond the way to a standstill
SHORT_M = 0.02  # the goal is aimed at with this to spare


def cap(
    setup: RobotSetup,
    law: Law,
    way: Way,
    memory: Memory,
    field_mm: Field,
    pose: Pose,
    speed_mps: float,
    subgoal: Vec2,
    index: int,
) -> float:
    """Highest speed for the way ahead, v <= sqrt(v(c_s)^2 + 2 a s) over its points."""
    robot = setup.robot
    most_mps = robot.speed_mps_max
    if not way.path:
        return most_mps
    brakes_mps2 = BRAKES_SHARE * robot.acceleration_mps2_max
    x_mm, y_mm = within(memory, pose.x_m, pose.y_m)
    to_x_mm, to_y_mm = within(memory, *subgoal)
    return along(
        field_mm,
        way.path_mm(),
        *memory.origin_mm,
        index,
        x_mm,
        y_mm,
        to_x_mm,
        to_y_mm,
        law.cell_mm,
        law.shares,
        most_mps,
        FLOOR_SHARE * setup.navigator.crawl_share * most_mps,
        brakes_mps2,
        abs(speed_mps) * setup.dt_s,
        most_mps * most_mps / (2.0 * brakes_mps2) + SPARE_M,
    )


def at_goal(setup: RobotSetup, distance_m: float) -> float:
    """Speed from which the robot stops at its goal."""
    braked_m = max(0.0, distance_m - SHORT_M)
    return sqrt(2.0 * GOAL_SHARE * setup.robot.acceleration_mps2_max * braked_m)


@compiled
def along(
    field_mm: Field,
    path_mm: Path,
    origin_x: int,
    origin_y: int,
    index: int,
    x_mm: float,
    y_mm: float,
    to_x_mm: float,
    to_y_mm: float,
    cell_mm: int,
    shares: Floats,
    most_mps: float,
    floor_mps: float,
    brakes_mps2: float,
    lead_m: float,
    reach_m: float,
) -> float:
    """Speed over the straight line to the sub-goal, and on along the way behind it."""
    speed2 = most_mps * most_mps
    dx, dy = to_x_mm - x_mm, to_y_mm - y_mm
    chord_m = np.sqrt(dx * dx + dy * dy) / 1000.0
    count = int(2000.0 * chord_m / cell_mm) + 1
    for step in range(count + 1):
        part = step / count
        way_m = part * chord_m
        if way_m > reach_m:
            break
        away_mm = distance_at(field_mm, x_mm + part * dx, y_mm + part * dy, cell_mm)
        here_mps = max(most_mps * share_at(shares, away_mm), floor_mps)
        speed2 = min(speed2, here_mps * here_mps + 2.0 * brakes_mps2 * max(0.0, way_m - lead_m))
    way_m = chord_m
    before_x, before_y = to_x_mm, to_y_mm
    for place in range(index + 1, len(path_mm)):
        px = float(path_mm[place, 0] - origin_x)
        py = float(path_mm[place, 1] - origin_y)
        dx, dy = px - before_x, py - before_y
        way_m += np.sqrt(dx * dx + dy * dy) / 1000.0
        before_x, before_y = px, py
        if way_m > reach_m:
            break
        away_mm = distance_at(field_mm, px, py, cell_mm)
        here_mps = max(most_mps * share_at(shares, away_mm), floor_mps)
        speed2 = min(speed2, here_mps * here_mps + 2.0 * brakes_mps2 * max(0.0, way_m - lead_m))
    return float(np.sqrt(speed2))
