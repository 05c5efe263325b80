"""A pose that creeps away with the way: what was seen before lies elsewhere, and closes no gap.

Beams that pass through where a remembered point would be now make it forgotten, sooner than a
drift of some hundredths of the way moves it far: so nothing has to be forgotten by its age.
"""

from __future__ import annotations

import msgspec
import pytest

from agents.navigator import estimate
from swarm.run.bench.navigation import course, obstacles
from swarm.run.bench.navigation.cases import Case
from swarm.run.bench.navigation.course import Job, Run
from swarm.scenario import Disturbance
from tests.agents import scenes

DRIFT = Disturbance(drift_m_per_m=0.02, drift_m_max=0.8)
TOLERANCE_M = 1.0  # a goal is found as far beside it as the pose has crept: of BARN


def drifting(case: Case) -> Run:
    plan = case.scenario
    robots = tuple(
        msgspec.structs.replace(one, goal_tolerance_m=TOLERANCE_M) for one in plan.robots
    )
    plan = msgspec.structs.replace(plan, robots=robots, disturbance=DRIFT)
    return course.run(Job(msgspec.structs.replace(case, scenario=plan), "navigator"))


def thin(number: int) -> Case:
    """As in BARN: narrow gaps between many thin cylinders."""
    case = obstacles.paper_field(0, number)
    drawn = case.scenario.random_obstacles
    assert drawn is not None
    drawn = msgspec.structs.replace(
        drawn, count=110, radius_m=(0.075, 0.15), gap_m_min=0.6, area=(2.0, 2.0, 14.0, 14.0)
    )
    (robot,) = case.scenario.robots
    robot = msgspec.structs.replace(robot, goal=(15.0, 15.0))
    plan = msgspec.structs.replace(case.scenario, random_obstacles=drawn, robots=(robot,))
    return msgspec.structs.replace(case, scenario=plan)


@pytest.mark.parametrize("number", range(3))
def test_it_arrives_among_many_thin_obstacles_though_its_pose_drifts(number: int) -> None:
    run = drifting(thin(number))
    assert run.outcome == "succeeded"
    assert run.clearance_m is not None
    assert run.clearance_m > 0.0
    assert run.makespan_ratio is not None
    assert run.makespan_ratio < 2.0


@pytest.mark.parametrize(
    "case", [obstacles.trap("u", lambda _: obstacles.u_shape(6.0, 4.0, 1.0), 3)]
)
def test_it_gets_out_of_a_trap_though_its_pose_drifts(case: Case) -> None:
    run = drifting(case)
    assert run.outcome == "succeeded"
    assert run.clearance_m is not None
    assert run.clearance_m > 0.05


def test_room_that_peers_keep_covers_all_of_the_drift() -> None:
    setup = scenes.alone(controller="navigator", goal=(4.0, 0.0))
    setup = msgspec.structs.replace(setup, disturbance=DRIFT)
    assert estimate.error_m(setup) == pytest.approx(0.8)
    frame = scenes.frame("robot1", 3, scenes.ORIGIN)
    assert estimate.step(setup, estimate.State(), frame).doubt.position_m == pytest.approx(0.8)
