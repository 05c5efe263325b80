"""One robot among cylinders that move: the paper's random fields with 12 of them on their ways."""

from __future__ import annotations

from functools import partial
from math import cos, pi, sin

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


def groups() -> tuple[Group, ...]:
    """All sizes."""
    return tuple(
        Group(
            family="moving", size=str(count), count=COUNT, make=partial(field, count), seeded=True
        )
        for count in SIZES
    )


def field(count: int, number: int) -> Case:
    """From corner to corner of a field of the paper, through what moves."""
    case = obstacles.paper_field(count, number)
    plan = case.scenario
    (robot,) = plan.robots
    assert robot.goal is not None
    circles = [one.circle for one in scene.obstacles(plan) if one.circle is not None]
    generator = cases.draws(number)
    ways: list[Obstacle] = []
    for _ in range(TRIES_MAX):
        if len(ways) == MOVERS:
            break
        begin, end, speed_mps = _way(generator)
        if all(
            _apart_m((x_m, y_m), begin, end) >= radius_m + GAP_M + RADIUS_M
            for x_m, y_m, radius_m in circles
        ) and all(
            _apart_m(place, begin, end) >= KEEP_CLEAR_M + RADIUS_M
            for place in (robot.start[:2], robot.goal)
        ):
            ways.append(Obstacle(circle=(*begin, RADIUS_M), path=(end,), speed_mps=speed_mps))
    assert len(ways) == MOVERS, "expected room for all ways, a smaller gap gives more"
    return msgspec.structs.replace(
        case,
        family="moving",
        scenario=msgspec.structs.replace(
            plan,
            title=f"Bench: moving {count}, instance {number}",
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
