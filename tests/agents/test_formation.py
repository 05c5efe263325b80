"""Slots by hand, the bearing switch against a slow search, the leader's heading and pace."""

from __future__ import annotations

from math import cos, hypot, pi, radians, sin, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents import formation
from agents.peers import Peer
from swarm.geometry import Pose, Vec2, wrap_angle
from swarm.messages import Slot
from swarm.scenario import Formation
from tests.agents import scenes

FORMATION = Formation(leader="leader")
CLEAR_M = 0.52
seeds = st.integers(0, 2**32 - 1)


def test_waypoint_of_a_positive_bearing_is_behind_to_the_right() -> None:
    x_m, y_m = formation.waypoint(Pose(3.0, 1.0, 2.0), 0.0, sqrt(2.0), pi / 4.0)
    assert (x_m, y_m) == pytest.approx((2.0, 0.0))


def test_waypoint_turns_with_the_formation_not_with_the_leader() -> None:
    x_m, y_m = formation.waypoint(Pose(0.0, 0.0, 1.0), pi / 2.0, 2.0, 0.0)
    assert (x_m, y_m) == pytest.approx((0.0, -2.0))


def test_turn_is_limited_so_that_the_outermost_slot_can_follow() -> None:
    setup = scenes.leader()
    assert formation.turn(setup, 0.0, 0.1, 0.4) == pytest.approx(0.05)
    bound = (1.0 - 0.6) / (2.0 * sqrt(2.0))
    assert formation.turn(setup, 0.0, 2.0, 0.4) == pytest.approx(bound)
    assert formation.turn(setup, 3.05, -3.1, 0.4) == pytest.approx(0.5 * (2.0 * pi - 6.15))


def test_cruise_leaves_the_slowest_follower_a_reserve() -> None:
    setup = scenes.leader()

    def heard(speed_mps: float) -> Peer:
        return scenes.peer(scenes.beacon("robot1", scenes.ORIGIN, speed_mps_max=speed_mps))

    assert formation.slowest(setup, []) == 1.0
    assert formation.slowest(setup, [heard(0.5), heard(2.0)]) == 0.5
    assert formation.cruise(setup, 1.0) == 0.6
    assert formation.cruise(setup, 0.5) == pytest.approx(0.4)
    assert formation.turn(setup, 0.0, 2.0, -0.1) == 0.0


def test_lag_counts_followers_behind_their_slots_only() -> None:
    slot = Slot(2.0, 0.0)
    behind = scenes.peer(scenes.beacon("robot1", Pose(-3.0, 0.4, 0.0), slot=slot))
    ahead = scenes.peer(scenes.beacon("robot2", Pose(-1.0, 0.0, 0.0), slot=slot))
    stranger = scenes.peer(scenes.beacon("robot3", Pose(-9.0, 0.0, 0.0)))
    assert formation.lag(0.0, scenes.ORIGIN, [ahead, stranger]) == 0.0
    assert formation.lag(0.0, scenes.ORIGIN, [ahead, behind]) == pytest.approx(1.0)


@pytest.mark.parametrize(("lag_m", "factor"), [(0.0, 1.0), (0.6, 1.0), (1.2, 0.5), (9.0, 0.15)])
def test_pace_falls_with_the_lag(lag_m: float, factor: float) -> None:
    assert formation.pace(FORMATION, lag_m) == pytest.approx(factor)


def slow_bearing(slot: Slot, now_rad: float, points: list[Vec2]) -> float:
    """Every candidate against every point, along the corridor in steps of a millimetre or so."""
    best = (np.inf, 0.0)
    for bearing in [slot.bearing_rad, *[radians(2.5 * i) for i in range(-36, 37)]]:
        x_m, y_m = -slot.distance_m * cos(bearing), -slot.distance_m * sin(bearing)
        free = all(
            hypot(px - min(max(px, x_m - 0.7), x_m + 2.5), py - y_m) >= CLEAR_M for px, py in points
        )
        cost = abs(wrap_angle(bearing - slot.bearing_rad)) + 0.15 * abs(
            wrap_angle(bearing - now_rad)
        )
        if free and cost < best[0] - 1e-12:
            best = (cost, bearing)
    return best[1]


@given(seeds)
def test_choose_bearing_is_the_slow_search(seed: int) -> None:
    random = np.random.default_rng(seed)
    points = [
        (float(x_m), float(y_m)) for x_m, y_m in random.uniform(-4.0, 4.0, (random.integers(9), 2))
    ]
    slot = Slot(float(random.uniform(1.0, 3.0)), float(random.uniform(-1.2, 1.2)))
    now_rad = float(random.uniform(-1.2, 1.2))
    chosen = formation.choose_bearing(FORMATION, slot, now_rad, points, CLEAR_M)
    assert chosen == pytest.approx(slow_bearing(slot, now_rad, points))


def test_choose_bearing_goes_behind_the_leader_when_nothing_is_free() -> None:
    wall = [(0.0, 0.1 * i) for i in range(-60, 61)]
    assert formation.choose_bearing(FORMATION, Slot(1.5, 0.8), 0.8, wall, CLEAR_M) == 0.0


def test_slew_bearing_moves_at_its_rate_and_stops_there() -> None:
    assert formation.slew_bearing(FORMATION, 0.0, -1.0, 0.1) == pytest.approx(-0.12)
    assert formation.slew_bearing(FORMATION, 0.95, 1.0, 0.1) == 1.0
