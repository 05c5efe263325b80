"""What a new leader takes over."""

from __future__ import annotations

import pytest

from agents import mission
from agents.mission import Mission
from agents.peers import Body
from swarm.geometry import Pose
from swarm.messages import Leadership
from tests.agents import scenes

CLAIM = Leadership(0, (0, 0, 0, 0), "leader")
GOAL, VIA = (10.0, 0.0), ((4.0, 0.0), (6.0, 3.0))


def test_mission_is_what_the_leader_says_even_that_there_is_no_goal() -> None:
    heard = scenes.peer(scenes.beacon("leader", scenes.ORIGIN, goal=GOAL, via=VIA))
    assert mission.learn(None, heard, ()) == Mission(GOAL, VIA)
    known = Mission(GOAL, VIA)
    assert mission.learn(known, heard, ()) is known
    nowhere = scenes.peer(scenes.beacon("leader", scenes.ORIGIN))
    assert mission.learn(known, nowhere, ()) == Mission(None)


def test_who_knows_nothing_learns_the_mission_from_anybody_in_the_formation() -> None:
    alone = scenes.peer(scenes.beacon("robot9", scenes.ORIGIN, goal=(1.0, 1.0)))
    member = scenes.peer(scenes.beacon("robot2", scenes.ORIGIN, goal=GOAL, leadership=CLAIM))
    assert mission.learn(None, None, [alone]) is None
    assert mission.learn(None, None, [alone, member]) == Mission(GOAL)
    assert mission.learn(Mission((5.0, 5.0)), None, [member]) == Mission((5.0, 5.0))


def test_mission_is_taken_over_as_it_is_where_nobody_is_in_the_way() -> None:
    bodies = [Body("leader", 4.0, 2.0, 0.22)]
    taken = mission.take_over(Mission(GOAL, VIA), scenes.ORIGIN, 0.22, bodies)
    assert taken == Mission(GOAL, VIA)


def test_way_point_with_a_body_on_it_counts_as_passed() -> None:
    bodies = [Body("leader", 4.3, 0.2, 0.22)]
    taken = mission.take_over(Mission(GOAL, VIA), scenes.ORIGIN, 0.22, bodies)
    assert taken == Mission(GOAL, VIA[1:])


def test_goal_with_a_body_on_it_moves_towards_the_new_leader() -> None:
    bodies = [Body("leader", 10.0, 0.0, 0.22)]
    taken = mission.take_over(Mission(GOAL), Pose(10.0, -5.0, 0.0), 0.22, bodies)
    assert taken.goal == pytest.approx((10.0, -0.94))


def test_setup_is_bound_for_the_mission() -> None:
    setup = scenes.leader()
    assert mission.bound_for(setup, Mission(setup.robot.goal)) is setup
    bound = mission.bound_for(scenes.follower(scenes.Slot(1.0, 0.0)), Mission(GOAL, VIA))
    assert (bound.robot.goal, bound.robot.via) == (GOAL, VIA)
