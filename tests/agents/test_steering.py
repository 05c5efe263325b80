"""Set-points by hand, gaps against a slow search."""

from __future__ import annotations

from math import asin, inf, pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents import steering
from swarm.geometry import Twist, sector_centres, wrap_angle
from swarm.scenario import Robot, Steering
from tests.agents import scenes

STEERING = Steering()
ROBOT = Robot(name="robot1", start=(0.0, 0.0, 0.0))
CLEAR_M = 0.34
seeds = st.integers(0, 2**32 - 1)


# --- head, slew, rims ---------------------------------------------------------------------------


def test_head_drives_along_the_force_and_turns_by_its_angle() -> None:
    speed_mps, turn_rate_radps = steering.head(STEERING, ROBOT, (1.0, 1.0), pi / 4.0 - 0.1, 1.0)
    assert speed_mps == pytest.approx(np.cos(0.1))
    assert turn_rate_radps == pytest.approx(0.4)


def test_head_turns_on_the_spot_when_the_force_points_back() -> None:
    speed_mps, turn_rate_radps = steering.head(STEERING, ROBOT, (-1.0, 0.5), 0.0, 1.0)
    assert speed_mps == 0.0
    assert turn_rate_radps == ROBOT.turn_rate_radps_max


def test_slew_stays_within_a_ticks_acceleration() -> None:
    reached = steering.slew(ROBOT, Twist(0.2, 0.0), 1.0, -2.0, 0.08)
    assert reached == Twist(0.2 + 4.0 * 0.08, -12.0 * 0.08)


def test_slew_returns_what_can_be_reached_bit_for_bit() -> None:
    assert steering.slew(ROBOT, Twist(0.1, 0.3), 0.2, 0.7, 0.08) == Twist(0.2, 0.7)


@given(st.floats(-2.0, 2.0), st.floats(-9.0, 9.0))
def test_scale_to_rims_keeps_the_curve_and_the_wheels_limit(v: float, w: float) -> None:
    scaled = steering.scale_to_rims(ROBOT, Twist(v, w))
    assert abs(scaled.speed_mps) + 0.17 * abs(scaled.turn_rate_radps) <= 1.0 + 1e-12
    assert scaled.speed_mps * w == pytest.approx(v * scaled.turn_rate_radps)


# --- gap choice ---------------------------------------------------------------------------------


def slow_choice(
    sectors_m: list[float], yaw: float, goal: float, last: float, look_m: float
) -> float | None:
    """The rule as it is written down: every direction against every cell."""
    angles = sector_centres(len(sectors_m))

    def free(direction: float) -> bool:
        return all(
            abs(wrap_angle(direction - angle))
            >= asin(min(1.0, CLEAR_M / max(range_m, 1e-9))) + pi / len(sectors_m)
            for angle, range_m in zip(angles, sectors_m, strict=True)
            if range_m < look_m
        )

    if free(wrap_angle(goal - yaw)):
        return goal
    costs = [
        (
            abs(wrap_angle(angle + yaw - goal))
            + STEERING.gap_memory_weight * abs(wrap_angle(angle + yaw - last)),
            angle,
        )
        for angle in angles
        if free(angle)
    ]
    return wrap_angle(min(costs)[1] + yaw) if costs else None


@given(seeds)
def test_choose_direction_is_the_slow_search(seed: int) -> None:
    random = np.random.default_rng(seed)
    rings = random.uniform(2.0, 110.0, 72)
    rings[random.uniform(size=72) < random.uniform()] = inf
    map = scenes.map_of([float(np.floor(ring)) * 0.05 if ring < 100.0 else inf for ring in rings])
    yaw, goal, last = random.uniform(-pi, pi, 3).tolist()
    look_m = float(random.uniform(0.5, 2.0))
    chosen = steering.choose_direction(
        STEERING, map, yaw, goal, last, clear_m=CLEAR_M, look_m=look_m
    )
    assert chosen == slow_choice(map.sectors_m, yaw, goal, last, look_m)


def test_choose_direction_is_none_when_enclosed() -> None:
    map = scenes.map_of([0.5] * 72)
    assert (
        steering.choose_direction(STEERING, map, 0.0, 1.0, 1.0, clear_m=CLEAR_M, look_m=2.0) is None
    )


def test_choose_direction_keeps_to_the_gap_chosen_last() -> None:
    sectors_m = [inf] * 72
    for index in range(30, 42):
        sectors_m[index] = 1.0
    map = scenes.map_of(sectors_m)
    chosen = {
        side: steering.choose_direction(
            STEERING, map, 0.0, side * -0.05, side * 1.0, clear_m=CLEAR_M, look_m=2.0
        )
        for side in (1.0, -1.0)
    }
    assert chosen[1.0] is not None
    assert chosen[-1.0] is not None
    # The goal lies a little nearer to the other gap; the memory outweighs that.
    assert chosen[1.0] > 0.5
    assert chosen[-1.0] == pytest.approx(-chosen[1.0])
