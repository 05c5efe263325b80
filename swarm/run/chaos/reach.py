"""Whether a robot could have got to where it should be: by way of free places, and within earshot.

A grid is flooded from the robot, around obstacles and the bodies of those who will not move again.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from math import ceil, sqrt

import numpy as np

from swarm.geometry import Vec2
from swarm.messages import RobotRecord
from swarm.scenario import Scenario
from world import scene

CELL_M = 0.1
MARGIN_M = 0.35  # that a robot keeps from what it passes; a narrower gap counts as closed
FREE_M = 0.15  # and from what stands beside its goal; robots do not stop nearer to a body
AROUND_M = 6.0  # how far beyond everything it may go round


def can_arrive(
    scenario: Scenario,
    robots: Sequence[RobotRecord],
    row: int,
    target: Vec2 | None,
    *,
    margin_m: float = MARGIN_M,
) -> bool:
    """Whether a robot that has not arrived is to blame for it.

    Args:
        robots: at the end of the run.
        target: where it should be, None when nobody has told it.
        margin_m: that it keeps from what it passes.
    """
    here = robots[row]
    if target is None:
        return any(
            other != row and robot.alive and _apart(here, robot) <= scenario.radio.range_m
            for other, robot in enumerate(robots)
        )
    radius_m = scenario.robots[row].body_radius_m
    standing = [
        (robot.pose.x_m, robot.pose.y_m, scenario.robots[other].body_radius_m)
        for other, robot in enumerate(robots)
        if other != row and (not robot.alive or robot.contact)
    ]
    if any(
        sqrt((target[0] - x) ** 2 + (target[1] - y) ** 2) < radius_m + other_m + FREE_M
        for x, y, other_m in standing
    ):
        return False
    points = [(here.pose.x_m, here.pose.y_m), target, *((x, y) for x, y, _ in standing)]
    low = [min(point[axis] for point in points) - AROUND_M for axis in (0, 1)]
    high = [max(point[axis] for point in points) + AROUND_M for axis in (0, 1)]
    columns, lines = (ceil((high[axis] - low[axis]) / CELL_M) + 1 for axis in (0, 1))
    x_m = low[0] + CELL_M * np.arange(columns)
    y_m = low[1] + CELL_M * np.arange(lines)
    cells_m = np.stack(np.meshgrid(x_m, y_m, indexing="ij"), axis=-1).reshape(-1, 2)
    room_m = np.full(len(cells_m), np.inf)
    obstacles = scene.obstacles(scenario)
    if obstacles:
        room_m = scene.clearance(scene.build(obstacles), cells_m)
    for x, y, other_m in standing:
        dx_m, dy_m = cells_m[:, 0] - x, cells_m[:, 1] - y
        room_m = np.minimum(room_m, np.sqrt(dx_m * dx_m + dy_m * dy_m) - other_m)
    room_m = room_m.reshape(columns, lines) - radius_m

    def cell(point: Vec2) -> tuple[int, int]:
        return round((point[0] - low[0]) / CELL_M), round((point[1] - low[1]) / CELL_M)

    begin, end = cell((here.pose.x_m, here.pose.y_m)), cell(target)
    free = room_m >= margin_m
    for place, need_m in ((begin, 0.0), (end, FREE_M)):  # both may be near to something
        around = np.s_[max(0, place[0] - 5) : place[0] + 6, max(0, place[1] - 5) : place[1] + 6]
        free[around] |= room_m[around] >= need_m
    if not free[end]:
        return False
    return _is_joined(free, begin, end)


def _is_joined(free: np.ndarray, begin: tuple[int, int], end: tuple[int, int]) -> bool:
    """Whether a way of free cells, side by side, leads from one to the other."""
    seen = np.zeros_like(free)
    seen[begin] = True
    todo = deque([begin])
    while todo:
        i, j = todo.popleft()
        if (i, j) == end:
            return True
        for one in ((i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)):
            inside = 0 <= one[0] < free.shape[0] and 0 <= one[1] < free.shape[1]
            if inside and free[one] and not seen[one]:
                seen[one] = True
                todo.append(one)
    return False


def _apart(one: RobotRecord, other: RobotRecord) -> float:
    dx_m, dy_m = one.pose.x_m - other.pose.x_m, one.pose.y_m - other.pose.y_m
    return sqrt(dx_m * dx_m + dy_m * dy_m)
