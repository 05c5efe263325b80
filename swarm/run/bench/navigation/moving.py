"""Robots among cylinders that move: the paper's random fields with some of them on their ways.

One robot among 12 of them, from corner to corner; or several among 6, each to the place opposite,
so that they meet each other and what moves in the middle.
"""

from __future__ import annotations

from functools import partial
from math import atan2, cos, pi, sin

import msgspec
import numpy as np

from swarm import geometry
from swarm.run.bench.navigation import cases, obstacles
from swarm.run.bench.navigation.cases import Case, Group
from swarm.scenario import Obstacle, Point
from world import scene

SIZES = (0, 12, 25)  # circles that stand, the same ones as in paper-fields
COUNT = 100
MOVERS = 12
RADIUS_M = 0.25
SPEED_MPS = (0.3, 1.0)  # of each its own; the robot does 1 m/s
WAY_M = (2.0, 10.0)  # there, then back
# Nobody is crushed between what moves and what stands: a body of 0.44 m and 8 cm on either side.
GAP_M = 0.6
KEEP_CLEAR_M = 1.5  # between a surface on its way and start or goal
TRIES_MAX = 20_000  # draws of a way; at the bound the field is too full

# Several robots, named by how many they are and how many move.
SEVERAL = ((6, 6),)
SEVERAL_COUNT = 50
SEVERAL_CIRCLES = 12  # that stand
FROM_CENTRE_M = (6.0, 9.5)
SPACING_M = 2.0  # between starts and goals, whosever


def groups() -> tuple[Group, ...]:
    """All sizes."""
    alone = [
        Group(
            family="moving", size=str(count), count=COUNT, make=partial(field, count), seeded=True
        )
        for count in SIZES
    ]
    several = [
        Group(
            family="moving-several",
            size=f"{robots}among{ways}",
            count=SEVERAL_COUNT,
            make=partial(opposite, robots, ways),
            seeded=True,
        )
        for robots, ways in SEVERAL
    ]
    return (*alone, *several)


def field(count: int, number: int) -> Case:
    """From corner to corner of a field of the paper, through what moves."""
    case = obstacles.paper_field(count, number)
    return _among(case, "moving", str(count), MOVERS, cases.draws(number))


def opposite(robots: int, ways: int, number: int) -> Case:
    """Several through the middle of a field of the paper, in which something moves as well."""
    generator = cases.draws(number)
    middle_m = obstacles.FIELD_SIDE_M / 2.0
    ends: list[Point] = []  # start, goal, start, ...
    for _ in range(TRIES_MAX):
        if len(ends) == 2 * robots:
            break
        angle, away = generator.random(2).tolist()
        away_m = FROM_CENTRE_M[0] + away * (FROM_CENTRE_M[1] - FROM_CENTRE_M[0])
        x_m, y_m = away_m * cos(2.0 * pi * angle), away_m * sin(2.0 * pi * angle)
        start, goal = (middle_m + x_m, middle_m + y_m), (middle_m - x_m, middle_m - y_m)
        if all(
            geometry.length(place[0] - end[0], place[1] - end[1]) >= SPACING_M
            for place in (start, goal)
            for end in ends
        ):
            ends += [start, goal]
    assert len(ends) == 2 * robots, "expected room for all, a smaller spacing gives more"
    alone = obstacles.paper_field(SEVERAL_CIRCLES, number).scenario
    case = cases.case(
        "moving-several",
        f"{robots}among{ways}",
        number,
        [
            cases.robot(
                row,
                (*start, atan2(goal[1] - start[1], goal[0] - start[0])),
                goal,
                obstacles.PAPER,
            )
            for row, (start, goal) in enumerate(zip(ends[::2], ends[1::2], strict=True))
        ],
        duration_s=obstacles.FIELD_DURATION_S,
        random_obstacles=alone.random_obstacles,
        seed=alone.seed,
    )
    return _among(case, case.family, case.size, ways, generator)


def _among(case: Case, family: str, size: str, count: int, generator: np.random.Generator) -> Case:
    """The same with so many that move, clear of what stands, of starts and of goals."""
    plan = case.scenario
    circles = [one.circle for one in scene.obstacles(plan) if one.circle is not None]
    ends = [robot.start[:2] for robot in plan.robots]
    ends += [robot.goal for robot in plan.robots if robot.goal is not None]
    ways: list[Obstacle] = []
    for _ in range(TRIES_MAX):
        if len(ways) == count:
            break
        begin, end, speed_mps = _way(generator)
        if all(
            _apart_m((x_m, y_m), begin, end) >= radius_m + GAP_M + RADIUS_M
            for x_m, y_m, radius_m in circles
        ) and all(_apart_m(place, begin, end) >= KEEP_CLEAR_M + RADIUS_M for place in ends):
            ways.append(Obstacle(circle=(*begin, RADIUS_M), path=(end,), speed_mps=speed_mps))
    assert len(ways) == count, "expected room for all ways, a smaller gap gives more"
    return msgspec.structs.replace(
        case,
        family=family,
        scenario=msgspec.structs.replace(
            plan,
            title=f"Bench: {family} {size}, instance {case.number}",
            obstacles=tuple(ways),
        ),
    )


def _way(generator: np.random.Generator) -> tuple[Point, Point, float]:
    """From where to where inside the field, and how fast."""
    while True:
        x, y, angle, length, speed = generator.random(5).tolist()
        begin = (obstacles.FIELD_SIDE_M * x, obstacles.FIELD_SIDE_M * y)
        way_m = WAY_M[0] + length * (WAY_M[1] - WAY_M[0])
        end = (
            begin[0] + way_m * cos(2.0 * pi * angle),
            begin[1] + way_m * sin(2.0 * pi * angle),
        )
        if all(0.0 <= value <= obstacles.FIELD_SIDE_M for value in end):
            return begin, end, SPEED_MPS[0] + speed * (SPEED_MPS[1] - SPEED_MPS[0])


def _apart_m(point: Point, begin: Point, end: Point) -> float:
    """Distance from a point to a segment."""
    along = (end[0] - begin[0], end[1] - begin[1])
    off = (point[0] - begin[0], point[1] - begin[1])
    square_m2 = along[0] * along[0] + along[1] * along[1]
    share = min(1.0, max(0.0, (off[0] * along[0] + off[1] * along[1]) / square_m2))
    return geometry.length(off[0] - share * along[0], off[1] - share * along[1])
