"""Families of one robot: traps, and the paper's random fields, U-traps and walls."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import pi

from swarm.run.bench.navigation import cases
from swarm.run.bench.navigation.cases import Case, Group
from swarm.scenario import Obstacle, RandomObstacles, RobotParameters

WALL_M = 0.2  # thickness of every wall here

# traps, in the neutral simulator: from the origin along +x
TRAP_GOAL_M = 10.0
TRAP_DURATION_S = 120.0
HEAD_ON = (5.0, 0.0, 1.0)
U_BACK_M, U_HALF_WIDTH_M = 6.0, 1.0
U_DEPTHS_M = (1.0, 2.0, 3.0, 4.0)
WALL_X_M = 5.0
WALL_LENGTHS_M = (2.0, 4.0, 6.0, 8.0)
# a blind alley: the robot stands near its end, the goal is right behind it
CANYON_BACK_M, CANYON_DEPTH_M, CANYON_HALF_WIDTH_M, CANYON_GOAL_M = 2.0, 8.0, 1.5, 5.0

# the paper's fields, section 6 of the reading, with its body and limits
PAPER = RobotParameters()
FIELD_COUNT, FIELD_SIZES, FIELD_SEED = 100, (12, 25, 40), 1000
FIELD_SIDE_M, FIELD_DURATION_S = 20.0, 90.0
PAPER_TRAP_COUNT, PAPER_TRAP_DURATION_S, PAPER_TRAP_GOAL_M = 30, 110.0, 16.0
PAPER_U_BACK_M, PAPER_U_DEPTH_M, PAPER_U_HALF_WIDTH_M = 9.0, (2.0, 5.0), (1.5, 3.0)
PAPER_WALL_X_M, PAPER_WALL_LENGTH_M = 8.0, (4.0, 14.0)
PAPER_OFFSET_M = (-1.2, 1.2)


def groups() -> tuple[Group, ...]:
    """All sizes."""
    fields = [
        Group(
            family="paper-fields",
            size=str(count),
            count=FIELD_COUNT,
            make=partial(paper_field, count),
            seeded=True,
        )
        for count in FIELD_SIZES
    ]
    traps: tuple[tuple[str, int, Callable[[int], Obstacle]], ...] = (
        ("circle", 1, lambda number: Obstacle(circle=HEAD_ON)),
        (
            "u",
            len(U_DEPTHS_M),
            lambda number: u_shape(U_BACK_M, U_DEPTHS_M[number], U_HALF_WIDTH_M),
        ),
        ("wall", len(WALL_LENGTHS_M), lambda number: wall(WALL_X_M, WALL_LENGTHS_M[number])),
        (
            "canyon",
            1,
            lambda number: u_shape(CANYON_BACK_M, CANYON_DEPTH_M, CANYON_HALF_WIDTH_M),
        ),
    )
    return (
        *(
            Group(family="traps", size=size, count=count, make=partial(trap, size, make))
            for size, count, make in traps
        ),
        *fields,
        Group(family="paper-u", size="u", count=PAPER_TRAP_COUNT, make=paper_u_trap, seeded=True),
        Group(
            family="paper-walls", size="wall", count=PAPER_TRAP_COUNT, make=paper_wall, seeded=True
        ),
    )


def trap(size: str, make: Callable[[int], Obstacle], number: int) -> Case:
    """One obstacle right in the way, exactly symmetric."""
    goal_m = CANYON_GOAL_M if size == "canyon" else TRAP_GOAL_M
    return cases.case(
        "traps",
        size,
        number,
        [cases.robot(0, (0.0, 0.0, 0.0), (goal_m, 0.0))],
        duration_s=TRAP_DURATION_S,
        obstacles=[make(number)],
    )


def paper_field(count: int, number: int) -> Case:
    """From corner to corner of a square with circles drawn by the world."""
    seed = FIELD_SEED + number
    return cases.case(
        "paper-fields",
        str(count),
        number,
        [cases.robot(0, (0.0, 0.0, pi / 4.0), (FIELD_SIDE_M, FIELD_SIDE_M), PAPER)],
        duration_s=FIELD_DURATION_S,
        random_obstacles=RandomObstacles(
            count=count, area=(0.0, 0.0, FIELD_SIDE_M, FIELD_SIDE_M), gap_m_min=0.6
        ),
        seed=seed,
    )


def paper_u_trap(number: int) -> Case:
    """A U open towards the robot, of random depth, width and offset."""
    depth, width, offset = cases.draws(number).random(3).tolist()
    shape = u_shape(
        PAPER_U_BACK_M,
        _between(PAPER_U_DEPTH_M, depth),
        _between(PAPER_U_HALF_WIDTH_M, width),
        _between(PAPER_OFFSET_M, offset),
    )
    return _paper_trap("paper-u", "u", number, shape)


def paper_wall(number: int) -> Case:
    """A wall across the way, of random length and offset."""
    length, offset = cases.draws(number).random(2).tolist()
    length_m, offset_m = _between(PAPER_WALL_LENGTH_M, length), _between(PAPER_OFFSET_M, offset)
    return _paper_trap("paper-walls", "wall", number, wall(PAPER_WALL_X_M, length_m, offset_m))


def _paper_trap(family: str, size: str, number: int, obstacle: Obstacle) -> Case:
    return cases.case(
        family,
        size,
        number,
        [cases.robot(0, (0.0, 0.0, 0.0), (PAPER_TRAP_GOAL_M, 0.0), PAPER)],
        duration_s=PAPER_TRAP_DURATION_S,
        obstacles=[obstacle],
    )


def u_shape(back_m: float, depth_m: float, half_width_m: float, offset_m: float = 0.0) -> Obstacle:
    """U open towards -x: `back_m` is the inner face of its bottom, depth and width are inner."""
    mouth_m, outer_m, aside_m = back_m - depth_m, back_m + WALL_M, half_width_m + WALL_M
    corners = (
        (mouth_m, -aside_m),
        (outer_m, -aside_m),
        (outer_m, aside_m),
        (mouth_m, aside_m),
        (mouth_m, half_width_m),
        (back_m, half_width_m),
        (back_m, -half_width_m),
        (mouth_m, -half_width_m),
    )
    return Obstacle(polygon=tuple((x_m, y_m + offset_m) for x_m, y_m in corners))


def wall(x_m: float, length_m: float, offset_m: float = 0.0) -> Obstacle:
    """Wall across the x axis, its near face at `x_m`."""
    return cases.rectangle(x_m, offset_m - length_m / 2.0, x_m + WALL_M, offset_m + length_m / 2.0)


def _between(bounds: tuple[float, float], share: float) -> float:
    return bounds[0] + share * (bounds[1] - bounds[0])
