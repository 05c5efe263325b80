"""What is remembered of the peers, and for how long."""

from __future__ import annotations

from math import cos, pi, sin

import pytest

from agents import peers
from swarm.geometry import Pose, Twist
from swarm.messages import Beacon
from tests.agents import scenes


def names(beacons: tuple[Beacon, ...]) -> list[tuple[str, int, int]]:
    return [(beacon.name, beacon.incarnation, beacon.tick) for beacon in beacons]


def beacon(name: str, tick: int, **changes: object) -> Beacon:
    return scenes.beacon(name, scenes.ORIGIN, tick=tick, **changes)


def test_remember_keeps_the_newest_of_each_in_order_of_names() -> None:
    known = (beacon("robot2", 5), beacon("robot4", 5))
    heard = [beacon("robot3", 6), beacon("robot2", 6), beacon("robot4", 4)]
    kept = peers.remember(known, heard, "robot1", 7, 6)
    assert names(kept) == [("robot2", 0, 6), ("robot3", 0, 6), ("robot4", 0, 5)]


def test_remember_forgets_what_is_too_old() -> None:
    known = (beacon("robot2", 5),)
    assert names(peers.remember(known, (), "robot1", 11, 6)) == [("robot2", 0, 5)]
    assert peers.remember(known, (), "robot1", 12, 6) == ()


def test_remember_leaves_out_itself_and_the_future() -> None:
    heard = [beacon("robot1", 6), beacon("robot2", 8)]
    assert peers.remember((), heard, "robot1", 7, 6) == ()


def test_remember_prefers_a_later_incarnation_to_a_later_tick() -> None:
    known = (beacon("robot2", 6),)
    kept = peers.remember(known, [beacon("robot2", 3, incarnation=1)], "robot1", 7, 6)
    assert names(kept) == [("robot2", 1, 3)]
    assert names(peers.remember(kept, known, "robot1", 7, 6)) == [("robot2", 1, 3)]


@pytest.mark.parametrize(
    "changes",
    [
        {"pose": Pose(1e300, 0.0, 0.0)},
        {"twist": Twist(1e9, 0.0)},
        {"formation_turn_rate_radps": 1e300},
    ],
)
def test_remember_leaves_out_what_no_world_can_hold(changes: dict[str, object]) -> None:
    fields = {"pose": scenes.ORIGIN, "tick": 1, **changes}
    assert peers.remember((), [scenes.beacon("robot2", **fields)], "robot1", 2, 6) == ()


def test_now_moves_a_beacon_along_its_arc() -> None:
    # A quarter of a circle of radius 0.5 in 5 ticks.
    turn = Twist(0.5 * pi / 2.0 / 0.4, pi / 2.0 / 0.4)
    heard = scenes.beacon("robot2", Pose(1.0, 0.0, 0.0), turn, tick=3)
    own = Pose(1.0, 1.5, pi / 2.0)
    (found,) = peers.now((heard,), own, 8, scenes.DT_S)
    assert (found.pose.x_m, found.pose.y_m, found.pose.yaw_rad) == pytest.approx(
        (1.5, 0.5, pi / 2.0)
    )
    assert found.offset == pytest.approx((0.5, -1.0))
    assert found.offset_body == pytest.approx((-1.0, -0.5))
    assert found.distance_m == pytest.approx(1.25**0.5)
    assert found.distance_m * cos(found.bearing_rad) == pytest.approx(-1.0)
    assert found.distance_m * sin(found.bearing_rad) == pytest.approx(-0.5)
    assert (found.missed_ticks, found.age_s) == (4, pytest.approx(0.4))
    assert found.velocity() == pytest.approx((0.0, turn.speed_mps))
