"""What a run of the bench is made of: a scenario, and the times it is measured against.

Group(family, size, count) --make(number)--> Case --under(controller)--> Scenario
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal

import msgspec
import numpy as np

from swarm import geometry
from swarm.scenario import Obstacle, Point, RandomObstacles, Robot, RobotParameters, Scenario, Stage

Controller = Literal["paper", "navigator"]

DT_S = 0.08  # of the neutral simulator, the paper and every built-in scenario
STREAM_CASES = 2  # second half of the Philox key; the world's obstacles have the first
# The slowest success among the peers took 8.2 times the straight way.
PATIENCE = 12.0  # a run of several robots may last this many times the straight way

# Body and limits of the neutral simulator that the peers were measured in.
NEUTRAL = RobotParameters(
    body_radius_m=0.2,
    speed_mps_max=1.0,
    turn_rate_radps_max=2.5,
    acceleration_mps2_max=2.0,
    turn_acceleration_radps2_max=8.0,
)


class Case(msgspec.Struct, frozen=True, kw_only=True):
    """One instance of a family."""

    family: str
    size: str
    number: int  # instance of its group
    scenario: Scenario
    bounds_s: tuple[float, ...]  # (robots,) straight or reference way at top speed
    dues_s: tuple[float, ...]  # (robots,) who gets to its goal for the first time later is late
    scored: bool = False  # by the rule of BARN

    @property
    def stops(self) -> bool:
        """Whether a robot stops for good on its way."""
        return bool(self.scenario.faults)

    @property
    def name(self) -> str:
        """Of files and rows: family, size and number."""
        return f"{self.family}-{self.size}-{self.number}"


class Group(msgspec.Struct, frozen=True, kw_only=True):
    """All instances of one size of a family."""

    family: str
    size: str
    count: int  # instances of the full bench, numbered from 0
    make: Callable[[int], Case]
    seeded: bool = False  # any number makes an instance, not only those below `count`


def case(
    family: str,
    size: str,
    number: int,
    robots: Sequence[Robot],
    *,
    duration_s: float | None = None,
    obstacles: Sequence[Obstacle] = (),
    random_obstacles: RandomObstacles | None = None,
    seed: int | None = None,
    bounds_s: tuple[float, ...] | None = None,
    patience: float = PATIENCE,
    scored: bool = False,
) -> Case:
    """Case of some robots among some obstacles.

    Args:
        duration_s: the same for all; None: each robot has `patience` times its straight way.
        seed: of the drawn obstacles; None: the number.
        bounds_s: None: the straight way at top speed.
    """
    straight_s = tuple(_straight_m(robot) / robot.speed_mps_max for robot in robots)
    dues_s = tuple(patience * way_s if duration_s is None else duration_s for way_s in straight_s)
    if duration_s is None and len({robot.speed_mps_max for robot in robots}) == 1:
        dues_s = (max(dues_s),) * len(robots)  # alike robots share the time of the longest way
    return Case(
        family=family,
        size=size,
        number=number,
        scenario=Scenario(
            title=f"Bench: {family} {size}, instance {number}",
            seed=number if seed is None else seed,
            dt_s=DT_S,
            duration_s=max(dues_s),
            robots=tuple(robots),
            obstacles=tuple(obstacles),
            random_obstacles=random_obstacles,
        ),
        bounds_s=straight_s if bounds_s is None else bounds_s,
        dues_s=dues_s,
        scored=scored,
    )


def under(case: Case, controller: Controller) -> Scenario:
    """Scenario of a case with every robot's mind chosen."""
    return msgspec.structs.replace(
        case.scenario,
        robots=tuple(
            msgspec.structs.replace(robot, controller=controller) for robot in case.scenario.robots
        ),
    )


def without(case: Case, stages: tuple[Stage, ...]) -> Case:
    """The same for a navigator that lacks some stages: what are they good for?"""
    scenario = case.scenario
    navigator = msgspec.structs.replace(scenario.navigator, without=stages)
    return msgspec.structs.replace(
        case, scenario=msgspec.structs.replace(scenario, navigator=navigator)
    )


def shortened(case: Case, duration_s: float) -> Case:
    """The same, ended early: to see that it runs."""
    scenario = case.scenario
    duration_s = min(scenario.duration_s, duration_s)
    return msgspec.structs.replace(
        case, scenario=msgspec.structs.replace(scenario, duration_s=duration_s)
    )


def robot(
    row: int,
    start: tuple[float, float, float],
    goal: Point,
    parameters: RobotParameters = NEUTRAL,
) -> Robot:
    """robot1, robot2, ... with a goal of its own."""
    table = {field: getattr(parameters, field) for field in RobotParameters.__struct_fields__}
    return Robot(**table, name=f"robot{row + 1}", start=start, goal=goal)


def rectangle(x_min_m: float, y_min_m: float, x_max_m: float, y_max_m: float) -> Obstacle:
    """Block with sides along the axes."""
    return Obstacle(
        polygon=((x_min_m, y_min_m), (x_max_m, y_min_m), (x_max_m, y_max_m), (x_min_m, y_max_m))
    )


def draws(number: int) -> np.random.Generator:
    """Random numbers of one instance."""
    key = np.array([number, STREAM_CASES], dtype=np.uint64)
    return np.random.Generator(np.random.Philox(key=key))


def _straight_m(robot: Robot) -> float:
    assert robot.goal is not None
    return geometry.length(robot.goal[0] - robot.start[0], robot.goal[1] - robot.start[1])
