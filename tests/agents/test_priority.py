"""The total order of eq. 65 and 66, and who waits for whom."""

from __future__ import annotations

from math import atan2, hypot, pi, sqrt

import pytest

from agents import priority
from swarm.geometry import STILL, Pose, Twist, wrap_angle
from swarm.messages import Beacon, Slot
from swarm.scenario import Priority, RobotSetup
from tests.agents import scenes

TABLE_I = {
    "robot1": (-1.0, 1.0),
    "robot2": (-1.0, -1.0),
    "robot3": (-2.0, 2.0),
    "robot4": (-2.0, 0.0),
    "robot5": (-2.0, -2.0),
}
LEADER = (0, 0, 0, 0)


def slot_of(x_m: float, y_m: float) -> Slot:
    return Slot(hypot(x_m, y_m), wrap_angle(atan2(y_m, x_m) + pi))


# --- claims -------------------------------------------------------------------------------------


def test_claims_order_table_i_as_leader_2_1_4_5_3() -> None:
    claims = {
        name: priority.claim("follower", slot_of(*position), row)
        for row, (name, position) in enumerate(TABLE_I.items(), start=1)
    }
    claims["leader"] = priority.claim("leader", None, 0)
    order = sorted(claims, key=claims.__getitem__)
    assert order == ["leader", "robot2", "robot1", "robot4", "robot5", "robot3"]


def test_claim_is_the_rounded_eq_66() -> None:
    claim = priority.follower_claim(Slot(sqrt(2.0), -pi / 4.0), 1)
    assert claim == (1, -707, 785, 1)
    assert priority.follower_claim(Slot(2.0, 0.0), 4) == (1, -500, 0, 4)


def test_claim_without_a_formation_is_the_id() -> None:
    assert priority.claim("alone", None, 3) == (1, 0, 0, 3)


# --- right of way -------------------------------------------------------------------------------


def decide(
    setup: RobotSetup,
    other: Beacon,
    state: priority.State = priority.State(),  # noqa: B008 - frozen
    twist: Twist = Twist(0.5, 0.0),  # noqa: B008 - frozen
) -> priority.State:
    role: priority.Role = "leader" if setup.leads else "follower" if setup.slot else "alone"
    claim = priority.claim(role, setup.slot, setup.row)
    others = [scenes.peer(other)]
    return priority.step(setup, state, role, claim, scenes.ORIGIN, twist, 0.0, others, scenes.DT_S)


def head_on(claim: tuple[int, int, int, int], **changes: object) -> Beacon:
    """A robot 2 m ahead that drives towards this one."""
    return scenes.beacon("robot9", Pose(2.0, 0.1, -pi), Twist(0.8, 0.0), priority=claim, **changes)


def test_robot_waits_for_a_smaller_id_that_closes_in() -> None:
    setup = scenes.alone(row=3)
    assert decide(setup, head_on((1, 0, 0, 2))).yields_to == "robot9"
    assert decide(setup, head_on((1, 0, 0, 4))).yields_to is None


@pytest.mark.parametrize(
    "changes", [{"arrived": True}, {"yields_to": "robot1"}, {"mode": "HOLD"}, {"mode": "FAILED"}]
)
def test_robot_never_waits_for_one_that_stands(changes: dict[str, object]) -> None:
    assert decide(scenes.alone(row=3), head_on((1, 0, 0, 2), **changes)).yields_to is None


def test_robot_does_not_wait_for_one_that_passes_at_a_distance_or_goes_away() -> None:
    setup = scenes.alone(row=3)
    aside = scenes.beacon("robot9", Pose(1.5, 1.5, -pi), Twist(0.8, 0.0), priority=(1, 0, 0, 2))
    away = scenes.beacon("robot9", Pose(1.5, 0.0, 0.0), Twist(0.9, 0.0), priority=(1, 0, 0, 2))
    assert decide(setup, aside).yields_to is None
    assert decide(setup, away).yields_to is None


def test_robot_waits_a_little_longer_than_the_reason() -> None:
    setup = scenes.alone(row=3)
    state = decide(setup, head_on((1, 0, 0, 2)))
    gone = scenes.beacon("robot9", Pose(-2.0, 0.0, -pi), Twist(0.8, 0.0), priority=(1, 0, 0, 2))
    held = 0
    while (state := decide(setup, gone, state)).yields_to is not None:
        held += 1
    assert held == 4  # of 0.08 s within 0.4 s


def test_robots_that_are_moving_obstacles_to_each_other_wait_for_nobody() -> None:
    setup = scenes.alone(row=3, priority=Priority(strategy="mutual"))
    assert decide(setup, head_on((1, 0, 0, 2))).yields_to is None


def test_leader_waits_for_nobody() -> None:
    assert decide(scenes.leader(), head_on((0, -1, 0, 0))).yields_to is None


FOLLOWER = scenes.follower(Slot(2.0, 0.0), row=4)
NEAR = scenes.beacon("robot2", Pose(0.6, 0.1, -pi), Twist(0.3, 0.0), priority=(1, -707, -785, 2))


def test_follower_waits_for_a_better_claim_right_ahead() -> None:
    assert decide(FOLLOWER, NEAR).yields_to == "robot2"


@pytest.mark.parametrize(
    "other",
    [
        scenes.beacon("robot2", Pose(0.64, 0.0, -pi), Twist(0.3, 0.0), priority=LEADER),  # far
        scenes.beacon("robot2", Pose(0.1, 0.5, -pi), Twist(0.3, 0.0), priority=LEADER),  # aside
        scenes.beacon("robot2", Pose(0.6, 0.0, 0.0), Twist(0.6, 0.0), priority=LEADER),  # going
        scenes.beacon("robot3", Pose(0.6, 0.0, -pi), Twist(0.3, 0.0), priority=(1, -354, 0, 3)),
    ],
)
def test_follower_does_not_wait_without_a_reason(other: Beacon) -> None:
    assert decide(FOLLOWER, other).yields_to is None


def test_follower_waits_six_seconds_at_most() -> None:
    state = priority.State()
    waited = 0
    for _ in range(200):
        state = decide(FOLLOWER, NEAR, state, STILL)
        waited += state.yields_to is not None
    assert waited * scenes.DT_S == pytest.approx(6.0, abs=1.5 * scenes.DT_S)
    away = scenes.beacon("robot2", Pose(3.0, 0.0, 0.0), priority=LEADER)
    state = decide(FOLLOWER, away, state)
    assert decide(FOLLOWER, NEAR, state).yields_to == "robot2"


def test_robot_alone_waits_thirty_seconds_at_most() -> None:
    setup = scenes.alone(row=3)
    state = priority.State()
    waited = 0
    for _ in range(600):  # one that says that it comes, and never does
        state = decide(setup, head_on((1, 0, 0, 2)), state)
        waited += state.yields_to is not None
    assert waited * scenes.DT_S == pytest.approx(30.0, abs=1.5 * scenes.DT_S)
    gone = scenes.beacon("robot9", Pose(-2.0, 0.0, -pi), Twist(0.8, 0.0), priority=(1, 0, 0, 2))
    for _ in range(6):
        state = decide(setup, gone, state)
    assert decide(setup, head_on((1, 0, 0, 2)), state).yields_to == "robot9"
