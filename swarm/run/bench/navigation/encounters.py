"""Families of several robots: circle swap, opposing pairs, random places, door and corridor."""

from __future__ import annotations

from functools import partial
from math import atan2, cos, pi, sin, sqrt

import numpy as np

from swarm import geometry
from swarm.geometry import wrap_angle
from swarm.run.bench.navigation import cases
from swarm.run.bench.navigation.cases import Case, Group
from swarm.scenario import Obstacle, Point, Robot

SWAP_SIZES = (2, 4, 8, 16, 32, 64)
SWAP_COUNT = 21  # the exactly symmetric one and 20 with noise
SWAP_RADIUS_M_MIN = 4.0
SWAP_SPACING_M = 0.8  # along the circle, twice the body
SWAP_NOISE_M = 0.1  # of each coordinate, either way
SWAP_NOISE_RAD = 0.1

# Fig. 12 of the paper
LANES_Y_M = (3.0, 0.0, -3.0)
PAIR_RADIUS_M = 7.0

RANDOM_COUNT = 50
RANDOM_SIZES = tuple((count, area) for count in (10, 20, 50) for area in (16, 8, 4))
AREA_PER_CIRCLE_M2 = 10.0
CIRCLE_RADIUS_M = (0.2, 0.5)
CIRCLE_GAP_M = 0.8  # between surfaces: two bodies pass one after the other
PLACE_GAP_M = 0.4  # from a start or goal to a surface, centre to surface
PLACE_SPACING_M = 1.0  # between starts, and between goals: parked robots leave a way
WAY_SHARE_MIN = 1.0 / 3.0  # of the side: from a robot's start to its goal at least
RANDOM_PATIENCE = 6.0  # the slowest of the peers needs 3.1 times the straight way in the mean
TRIES_MAX = 100_000  # draws per instance; at the bound the instance cannot be laid out

GATE_COUNT = 10
DOOR_WIDTH_M, DOOR_DEPTH_M = 1.0, 0.2
CORRIDOR_WIDTH_M, CORRIDOR_DEPTH_M = 0.8, 4.0
WALL_REACH_M = 100.0  # to either side: nobody gets round within the time
PLATOON = 4
PLATOON_SPACING_M = 0.8
PLATOON_AHEAD_M = (1.5, 4.5)  # from the mouth
PLATOON_ASIDE_M = 2.0


def groups() -> tuple[Group, ...]:
    """All sizes."""
    swaps = [
        Group(
            family="circle-swap",
            size=str(count),
            count=SWAP_COUNT,
            make=partial(circle_swap, count),
            seeded=True,
        )
        for count in SWAP_SIZES
    ]
    randoms = [
        Group(
            family="random",
            size=f"{count}x{area}m2",
            count=RANDOM_COUNT,
            make=partial(random_places, count, float(area)),
            seeded=True,
        )
        for count, area in RANDOM_SIZES
    ]
    return (
        *swaps,
        Group(family="pairs", size="lanes", count=1, make=lanes),
        Group(family="pairs", size="star", count=1, make=star),
        *randoms,
        Group(family="door", size="1.0m", count=GATE_COUNT, make=door, seeded=True),
        Group(family="corridor", size="0.8m", count=GATE_COUNT, make=corridor, seeded=True),
    )


def circle_swap(count: int, number: int) -> Case:
    """Robots on a circle, each to the opposite place; number 0 is exactly symmetric."""
    radius_m = max(SWAP_RADIUS_M_MIN, count * SWAP_SPACING_M / (2.0 * pi))
    noise = cases.draws(number).uniform(-1.0, 1.0, (count, 3)) * (number > 0)
    robots = []
    for row in range(count):
        angle_rad = 2.0 * pi * row / count
        x_m, y_m = radius_m * cos(angle_rad), radius_m * sin(angle_rad)
        off_x, off_y, off_yaw = noise[row].tolist()
        start = (
            x_m + SWAP_NOISE_M * off_x,
            y_m + SWAP_NOISE_M * off_y,
            wrap_angle(angle_rad + pi + SWAP_NOISE_RAD * off_yaw),
        )
        robots.append(cases.robot(row, start, (-x_m, -y_m)))
    return cases.case("circle-swap", str(count), number, robots)


def lanes(number: int) -> Case:
    """Three pairs meet head-on in lanes of their own, Fig. 12."""
    robots: list[Robot] = []
    for y_m in LANES_Y_M:
        robots += _pair(len(robots), (-PAIR_RADIUS_M, y_m), (PAIR_RADIUS_M, y_m))
    return cases.case("pairs", "lanes", number, robots)


def star(number: int) -> Case:
    """Three pairs meet head-on across one centre, Fig. 12."""
    robots: list[Robot] = []
    for angle_rad in (pi, -2.0 * pi / 3.0, -pi / 3.0):
        x_m, y_m = PAIR_RADIUS_M * cos(angle_rad), PAIR_RADIUS_M * sin(angle_rad)
        robots += _pair(len(robots), (x_m, y_m), (-x_m, -y_m))
    return cases.case("pairs", "star", number, robots)


def _pair(row: int, one: Point, other: Point) -> tuple[Robot, Robot]:
    return (
        cases.robot(row, (*one, _towards(one, other)), other),
        cases.robot(row + 1, (*other, _towards(other, one)), one),
    )


def random_places(count: int, area_m2: float, number: int) -> Case:
    """Starts and goals anywhere among circles in a square of `area_m2` per robot."""
    generator = cases.draws(number)
    side_m = sqrt(count * area_m2)
    circles: list[tuple[float, float, float]] = []
    starts: list[Point] = []
    goals: list[Point] = []
    wanted = round(count * area_m2 / AREA_PER_CIRCLE_M2)
    for _ in range(TRIES_MAX):
        x_m, y_m, share = (generator.random(3) * (side_m, side_m, 1.0)).tolist()
        if len(circles) < wanted:
            radius_m = CIRCLE_RADIUS_M[0] + share * (CIRCLE_RADIUS_M[1] - CIRCLE_RADIUS_M[0])
            if _gap_m((x_m, y_m), circles) >= radius_m + CIRCLE_GAP_M:
                circles.append((x_m, y_m, radius_m))
            continue
        place = (x_m, y_m)
        taken = starts if len(starts) < count else goals
        if _gap_m(place, circles) < PLACE_GAP_M or not _apart(place, taken, PLACE_SPACING_M):
            continue
        if taken is goals and _apart(place, [starts[len(goals)]], WAY_SHARE_MIN * side_m):
            goals.append(place)
        elif taken is starts:
            starts.append(place)
        if len(goals) == count:
            break
    assert len(goals) == count, "expected room for all robots, a smaller spacing gives more"
    return cases.case(
        "random",
        f"{count}x{area_m2:g}m2",
        number,
        [
            cases.robot(row, (*start, _towards(start, goal)), goal)
            for row, (start, goal) in enumerate(zip(starts, goals, strict=True))
        ],
        obstacles=[Obstacle(circle=circle) for circle in circles],
        patience=RANDOM_PATIENCE,
    )


def door(number: int) -> Case:
    """Four against four through a gap in a long wall."""
    return _gate("door", "1.0m", number, DOOR_WIDTH_M, DOOR_DEPTH_M)


def corridor(number: int) -> Case:
    """Four against four through a passage for one."""
    return _gate("corridor", "0.8m", number, CORRIDOR_WIDTH_M, CORRIDOR_DEPTH_M)


def _gate(family: str, size: str, number: int, width_m: float, depth_m: float) -> Case:
    """Two platoons in random places, each to the mirrored places of its own."""
    generator = cases.draws(number)
    edge_m = depth_m / 2.0
    robots: list[Robot] = []
    for sign in (-1.0, 1.0):
        for x_m, y_m in _platoon(generator, edge_m):
            start, goal = (sign * x_m, y_m), (-sign * x_m, y_m)
            robots.append(cases.robot(len(robots), (*start, _towards(start, goal)), goal))
    return cases.case(
        family,
        size,
        number,
        robots,
        obstacles=[
            cases.rectangle(-edge_m, width_m / 2.0, edge_m, WALL_REACH_M),
            cases.rectangle(-edge_m, -WALL_REACH_M, edge_m, -width_m / 2.0),
        ],
    )


def _platoon(generator: np.random.Generator, edge_m: float) -> list[Point]:
    """Places before one mouth, x outwards."""
    near_m, far_m = PLATOON_AHEAD_M
    places: list[Point] = []
    while len(places) < PLATOON:
        ahead, aside = generator.random(2).tolist()
        place = (
            edge_m + near_m + (far_m - near_m) * ahead,
            PLATOON_ASIDE_M * (2.0 * aside - 1.0),
        )
        if _apart(place, places, PLATOON_SPACING_M):
            places.append(place)
    return places


def _towards(start: Point, goal: Point) -> float:
    return wrap_angle(atan2(goal[1] - start[1], goal[0] - start[0]))


def _apart(place: Point, others: list[Point], spacing_m: float) -> bool:
    return all(geometry.length(place[0] - x_m, place[1] - y_m) >= spacing_m for x_m, y_m in others)


def _gap_m(place: Point, circles: list[tuple[float, float, float]]) -> float:
    return min(
        (
            geometry.length(place[0] - x_m, place[1] - y_m) - radius_m
            for x_m, y_m, radius_m in circles
        ),
        default=float("inf"),
    )
