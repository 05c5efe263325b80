"""Who gets which slot, and who keeps the one it has."""

from __future__ import annotations

from math import pi

from agents import places
from agents.peers import Peer
from swarm.geometry import Pose
from swarm.messages import Slot
from tests.agents import scenes

# Behind a leader at the origin that looks along x: (-1, 1), (-1, -1), (-2, 0).
LEFT, RIGHT, BEHIND = Slot(2.0**0.5, -pi / 4.0), Slot(2.0**0.5, pi / 4.0), Slot(2.0, 0.0)
ALL = (LEFT, RIGHT, BEHIND)


def follower(name: str, x_m: float, y_m: float, slot: Slot | None) -> Peer:
    return scenes.peer(scenes.beacon(name, Pose(x_m, y_m, 0.0), slot=slot))


def decide(
    state: places.State,
    *followers: Peer,
    bodies: tuple[tuple[float, float], ...] = (),
    arrived: bool = False,
) -> places.State:
    return places.step(
        state, ALL, scenes.ORIGIN, 0.0, followers, bodies, clear_m=0.9, arrived=arrived
    )


def test_everybody_keeps_its_slot_at_first_wherever_it_is() -> None:
    followers = [follower("robot1", -1.0, -1.0, LEFT), follower("robot2", -1.0, 1.0, RIGHT)]
    state = decide(places.State(), *followers)
    assert state.plan == (("robot1", LEFT), ("robot2", RIGHT))
    assert places.changes(state, followers) == ()


def test_new_leader_gives_out_all_slots_at_least_cost_once() -> None:
    followers = [follower("robot1", -1.0, -1.0, LEFT), follower("robot2", -1.0, 1.0, RIGHT)]
    state = decide(places.State(elected=True), *followers)
    assert state.plan == (("robot1", RIGHT), ("robot2", LEFT))
    assert places.changes(state, followers) == state.plan
    # It stays so while they cross over, and wherever they are then.
    assert decide(state, *followers) is state


def test_nobody_moves_for_one_that_is_lost_and_who_returns_gets_its_own_slot() -> None:
    three = [
        follower("robot1", -1.0, 1.0, LEFT),
        follower("robot2", -1.0, -1.0, RIGHT),
        follower("robot3", -2.0, 0.0, BEHIND),
    ]
    state = decide(places.State(), *three)
    state = decide(state, three[0], three[2])
    assert state.plan == (("robot1", LEFT), ("robot3", BEHIND))
    state = decide(state, three[0], follower("robot2", -9.0, 0.0, RIGHT), three[2])
    assert state.plan == (("robot1", LEFT), ("robot2", RIGHT), ("robot3", BEHIND))


def test_who_returns_without_a_slot_or_to_one_that_is_taken_gets_a_free_one() -> None:
    state = decide(places.State(), follower("robot2", -1.0, -1.0, RIGHT))
    taken = follower("robot1", -1.0, 1.2, RIGHT)
    bare = follower("leader", -2.0, 0.2, None)
    state = decide(state, bare, taken, follower("robot2", -1.0, -1.0, RIGHT))
    assert state.plan == (("leader", BEHIND), ("robot1", LEFT), ("robot2", RIGHT))


def test_slot_with_a_body_in_it_is_given_up_at_the_goal_only() -> None:
    one = follower("robot1", -1.0, 1.0, LEFT)
    body = ((-1.1, 1.1),)
    state = decide(places.State(), one, bodies=body)
    assert state.plan == (("robot1", LEFT),)
    state = decide(state, one, bodies=body, arrived=True)
    assert state.plan == (("robot1", BEHIND),)
    assert decide(state, one, bodies=body, arrived=True) is state


def test_more_followers_than_places_leave_the_last_without() -> None:
    followers = [follower(f"robot{i}", -1.0 * i, 0.0, None) for i in range(1, 5)]
    state = decide(places.State(), *followers)
    assert sorted(name for name, _ in state.plan) == ["robot1", "robot2", "robot3"]
