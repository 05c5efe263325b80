"""Two platoons inside one corridor: the worse key backs out, however they got there.

The corridor is the bench's: 0.8 m wide, 4 m long, bodies of 0.4 m. Nobody gets past anybody in it.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, pi, sin

import msgspec
import numpy as np
import pytest

from agents import robot
from agents.navigator import gaps, walls
from swarm import metrics
from swarm.geometry import Floats
from swarm.messages import Passage
from swarm.run.bench.navigation import cases, encounters
from swarm.scenario import Scenario
from world import simulation

HALF_M = encounters.CORRIDOR_DEPTH_M / 2.0
GOAL_M = 4.0
DURATION_S = 40.0
NUDGE_M = 0.3  # who goes first may be made way for, and turn, but does not back out
DOUBLE_S_MAX = 8.0  # by then at most one direction holds inside
Line = tuple[float, ...]


class Course(msgspec.Struct, frozen=True):
    """What became of a run."""

    summary: metrics.Summary
    back_m: tuple[float, ...]  # (robots,) furthest back from the best place on its way
    double_s: float  # last time at which two of opposite directions held, both inside


def platoons(right_m: Sequence[float], left_m: Sequence[float]) -> Scenario:
    """Robots in the middle of the corridor, some on their way to the right, some to the left."""
    robots = []
    for goal_m, yaw_rad, places_m in ((GOAL_M, 0.0, right_m), (-GOAL_M, -pi, left_m)):
        for number, x_m in enumerate(places_m):
            goal = (goal_m, 0.9 * (number - 1))
            robots.append(cases.robot(len(robots), (x_m, 0.0, yaw_rad), goal))
    case = encounters.corridor(0)
    plan = msgspec.structs.replace(case.scenario, robots=tuple(robots), duration_s=DURATION_S)
    return cases.under(msgspec.structs.replace(case, scenario=plan), "navigator")


def drive(plan: Scenario, since: Sequence[int] = ()) -> Course:
    """Run to its end.

    Args:
        since: (robots,) ticks of the claims that all of them hold already; empty: nobody has one.
    """
    world = simulation.build(plan)
    setups = {one.name: plan.setup(one.name) for one in plan.robots}
    minds = {name: robot.init(setup) for name, setup in setups.items()}
    signs = [cos(one.start[2]) for one in plan.robots]
    for one, sign, tick in zip(plan.robots, signs, since, strict=False):
        passage = Passage(True, (-sign * HALF_M, 0.0), (sign, 0.0), tick)
        gap = gaps.State(passage, encounters.CORRIDOR_WIDTH_M, 2.0 * HALF_M)
        navigating = minds[one.name].navigating
        giving = msgspec.structs.replace(navigating.giving, gap=gap)
        navigating = msgspec.structs.replace(navigating, giving=giving)
        minds[one.name] = msgspec.structs.replace(minds[one.name], navigating=navigating)
    state, score = simulation.init(world), metrics.begin(plan)
    best_m = [sign * one.start[0] for one, sign in zip(plan.robots, signs, strict=True)]
    back_m = [0.0] * len(signs)
    double_s = 0.0
    while True:
        frames = simulation.sense(world, state)
        commands = {}
        for frame in frames:
            minds[frame.robot], commands[frame.robot] = robot.step(
                setups[frame.robot], minds[frame.robot], frame
            )
        metrics.observe(score, simulation.record(world, state, frames, commands.values(), []))
        holding = set()
        for row, (body, sign) in enumerate(zip(state.bodies, signs, strict=True)):
            along_m = sign * body.pose.x_m
            best_m[row] = max(best_m[row], along_m)
            back_m[row] = max(back_m[row], best_m[row] - along_m)
            claim = body.beacon.passage if body.beacon is not None else None
            if claim is not None and claim.holds and abs(along_m) < HALF_M:
                holding.add(sign)
        if len(holding) > 1:
            double_s = state.tick * plan.dt_s
        if metrics.ended(score) is not None:
            facts = metrics.Facts(scenario="inside", run="memory", bus="memory")
            return Course(metrics.summary(score, facts), tuple(back_m), double_s)
        state = simulation.step(world, state, commands)


@pytest.mark.parametrize(
    ("right_m", "left_m", "since", "first"),
    [
        ((-1.0, -0.2), (0.8, 1.6), (-20, -20, -10, -10), (0, 1)),
        ((-1.0, -0.2), (0.8, 1.6), (-10, -10, -20, -20), (2, 3)),
        # the best key of a platoon is that of all of it, and the name decides between alike ones
        ((-1.2, -0.5), (0.3,), (-10, -30, -20), (0, 1)),
        ((-1.2,), (0.3, 1.0), (-20, -20, -20), (0,)),
    ],
)
def test_of_two_platoons_inside_a_corridor_the_worse_key_backs_out(
    right_m: Line, left_m: Line, since: tuple[int, ...], first: tuple[int, ...]
) -> None:
    course = drive(platoons(right_m, left_m), since)
    assert course.summary.arrived == course.summary.robots
    assert course.summary.collisions == 0
    assert course.summary.min_clearance_obstacle_m is not None
    assert course.summary.min_clearance_obstacle_m > 0.0
    assert course.double_s < 1.0
    for row, back_m in enumerate(course.back_m):
        assert (back_m < NUDGE_M) == (row in first)


@pytest.mark.parametrize(
    ("right_m", "left_m"),
    [((-1.33,), (-0.27, 0.85, 1.56)), ((-1.55,), (0.57, 1.8)), ((-0.3,), (0.5,))],
)
def test_who_comes_to_itself_inside_a_corridor_claims_it_from_there(
    right_m: Line, left_m: Line
) -> None:
    """Of these all but the last stood before each other for good: no mouth was seen behind."""
    course = drive(platoons(right_m, left_m))
    assert course.summary.arrived == course.summary.robots
    assert course.summary.collisions == 0
    assert course.double_s < DOUBLE_S_MAX


# --- what of the hits are walls right and left --------------------------------------------------

PATH = np.stack((np.arange(0.0, 5.0, 0.2), np.zeros(25)), axis=1)


def corridor_m(back_m: float, ahead_m: float, turn_rad: float = 0.0) -> Floats:
    """(hits, 2) of two walls 0.8 m apart along x, seen from a place 0.1 m beside their middle."""
    x_m = np.arange(-back_m, ahead_m, 0.05)
    points = np.concatenate([np.stack((x_m, np.full(len(x_m), y_m)), 1) for y_m in (0.5, -0.3)])
    ahead, aside = cos(turn_rad), sin(turn_rad)
    turned: Floats = points @ np.array([[ahead, aside], [-aside, ahead]])
    return turned


def disc_m(x_m: float, y_m: float, radius_m: float) -> Floats:
    turns = [(cos(0.1 * number), sin(0.1 * number)) for number in range(63)]
    disc: Floats = np.array((x_m, y_m)) + radius_m * np.array(turns)
    return disc


def found(points: Floats, path: Floats = PATH) -> Floats:
    result = np.zeros(5)
    walls.inside(points, path, 0.55, 1.05, result)
    return result


@pytest.mark.parametrize("turn_rad", [0.0, 0.3, -0.3])
def test_walls_right_and_left_are_found_and_how_far_they_go_on(turn_rad: float) -> None:
    width_m, axis_x, axis_y, back_m, ahead_m = found(corridor_m(1.5, 2.5, turn_rad))
    assert width_m == pytest.approx(0.8, abs=0.02)
    assert (axis_x, axis_y) == pytest.approx((cos(turn_rad), sin(turn_rad)), abs=0.05)
    assert back_m == pytest.approx(1.5, abs=walls.HOLE_M)
    assert ahead_m == pytest.approx(2.5, abs=walls.HOLE_M)


def test_the_axis_of_walls_points_along_the_way() -> None:
    _, axis_x, _, back_m, ahead_m = found(corridor_m(1.5, 2.5), -PATH)
    assert axis_x < -0.99
    assert back_m > ahead_m


@pytest.mark.parametrize(
    "points",
    [
        np.empty((0, 2)),
        np.zeros((3, 2)),  # where the robot itself stands
        corridor_m(1.5, 2.5)[:80],  # one wall only
        corridor_m(0.3, 0.3),  # a door
        np.concatenate((disc_m(0.0, 0.9, 0.5), disc_m(0.0, -0.9, 0.5))),
        np.concatenate([disc_m(x, y, 0.2) for x in (-1.0, 0.0, 1.0) for y in (0.6, -0.6)]),
        2.0 * corridor_m(1.5, 2.5),  # two can pass
    ],
)
def test_where_there_are_no_two_long_walls_nobody_is_inside(points: Floats) -> None:
    assert found(points)[0] == 0.0
    assert found(points, np.empty((0, 2)))[0] == 0.0
