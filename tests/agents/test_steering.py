"""Set-points by hand."""

from __future__ import annotations

from math import pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents import steering
from swarm.geometry import Twist
from swarm.scenario import Robot, Steering

STEERING = Steering()
ROBOT = Robot(name="robot1", start=(0.0, 0.0, 0.0))


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
