"""Set-point to twist to pose: every limit by hand, and all of them together."""

from __future__ import annotations

from math import cos, pi, sin, sqrt

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm.geometry import STILL, Pose, Twist
from swarm.scenario import RobotParameters
from world import motion

ROBOT = RobotParameters()  # 1 m/s, 0.4 m/s back, 2.5 rad/s, 4 m/s^2, 12 rad/s^2, half track 0.17 m
DT_S = 0.08

twists = st.builds(Twist, st.floats(-3.0, 3.0), st.floats(-9.0, 9.0))


@pytest.mark.parametrize(
    ("twist", "set_point", "expected"),
    [
        (STILL, Twist(0.1, -0.5), Twist(0.1, -0.5)),  # within every limit
        (STILL, Twist(1.0, 0.0), Twist(0.32, 0.0)),  # 4 m/s^2 for 0.08 s
        (Twist(0.6, 0.0), STILL, Twist(0.28, 0.0)),  # braking
        (STILL, Twist(0.0, 2.0), Twist(0.0, 0.96)),  # 12 rad/s^2 for 0.08 s
        (Twist(0.9, 0.0), Twist(2.0, 0.0), Twist(1.0, 0.0)),  # speed
        (Twist(-0.3, 0.0), Twist(-2.0, 0.0), Twist(-0.4, 0.0)),  # speed in reverse
        (Twist(0.0, 2.4), Twist(0.0, 9.0), Twist(0.0, 2.5)),  # turn rate
    ],
)
def test_limited_keeps_each_limit(twist: Twist, set_point: Twist, expected: Twist) -> None:
    reached = motion.limited(ROBOT, twist, set_point, dt_s=DT_S)
    assert msgspec.structs.astuple(reached) == pytest.approx(msgspec.structs.astuple(expected))


def test_limited_scales_both_parts_when_a_rim_is_too_fast() -> None:
    # Rims at 0.9 +- 0.17 * 2 = 1.24 and 0.56 m/s: both parts over 1.24.
    reached = motion.limited(ROBOT, Twist(0.9, 2.0), Twist(0.9, 2.0), dt_s=DT_S)
    assert reached.speed_mps == pytest.approx(0.9 / 1.24)
    assert reached.turn_rate_radps == pytest.approx(2.0 / 1.24)
    assert motion.wheels(ROBOT, reached).right_mps == pytest.approx(1.0)


@given(twists, twists)
def test_limited_never_breaks_a_limit(wild: Twist, set_point: Twist) -> None:
    twist = motion.limited(ROBOT, STILL, wild, dt_s=1.0)  # any that can be reached at all
    reached = motion.limited(ROBOT, twist, set_point, dt_s=DT_S)
    wheels = motion.wheels(ROBOT, reached)
    assert max(abs(wheels.right_mps), abs(wheels.left_mps)) <= 1.0 + 1e-12
    assert -0.4 - 1e-12 <= reached.speed_mps <= 1.0 + 1e-12
    assert abs(reached.turn_rate_radps) <= 2.5 + 1e-12
    rim_mps2 = ROBOT.acceleration_mps2_max + 0.17 * ROBOT.turn_acceleration_radps2_max
    change_mps = abs(reached.speed_mps - twist.speed_mps)
    assert change_mps <= (ROBOT.acceleration_mps2_max + rim_mps2) * DT_S + 1e-12
    faster_mps = abs(reached.speed_mps) - abs(twist.speed_mps)
    assert faster_mps <= ROBOT.acceleration_mps2_max * DT_S + 1e-12


@given(twists, twists)
def test_limited_mirrors_when_the_turn_rates_do(twist: Twist, set_point: Twist) -> None:
    def mirrored(one: Twist) -> Twist:
        return Twist(one.speed_mps, -one.turn_rate_radps)

    reached = motion.limited(ROBOT, twist, set_point, dt_s=DT_S)
    other = motion.limited(ROBOT, mirrored(twist), mirrored(set_point), dt_s=DT_S)
    assert other == mirrored(reached)


def test_wheels_turn_left_when_the_right_one_is_faster() -> None:
    wheels = motion.wheels(ROBOT, Twist(0.5, 1.0))
    assert (wheels.right_mps, wheels.left_mps) == pytest.approx((0.67, 0.33))


def test_step_goes_a_quarter_circle_exactly_when_time_allows() -> None:
    robot = RobotParameters(acceleration_mps2_max=100.0, turn_acceleration_radps2_max=500.0)
    turn_rate_radps = pi / 2.0  # radius 0.5 / (pi / 2) in one second
    pose, twist = motion.step(
        robot, Pose(1.0, 2.0, 0.0), STILL, Twist(0.5, turn_rate_radps), dt_s=1.0
    )
    radius_m = 1.0 / pi
    assert (pose.x_m, pose.y_m, pose.yaw_rad) == pytest.approx(
        (1.0 + radius_m, 2.0 + radius_m, pi / 2.0)
    )
    assert twist == Twist(0.5, turn_rate_radps)


def test_step_agrees_with_many_small_straight_ones_when_the_twist_is_held() -> None:
    twist = Twist(0.6, -1.3)
    pose, _ = motion.step(ROBOT, Pose(0.0, 0.0, 0.4), twist, twist, dt_s=DT_S)
    # The oracle: the midpoint rule in 1e5 pieces.

    x_m, y_m, pieces = 0.0, 0.0, 100_000
    for piece in range(pieces):
        yaw_rad = 0.4 - 1.3 * DT_S * (piece + 0.5) / pieces
        x_m += 0.6 * DT_S / pieces * cos(yaw_rad)
        y_m += 0.6 * DT_S / pieces * sin(yaw_rad)
    assert sqrt((pose.x_m - x_m) ** 2 + (pose.y_m - y_m) ** 2) < 1e-9


def test_step_leaves_the_pose_alone_when_nothing_moves() -> None:
    pose = Pose(0.1, 0.2, -pi)
    assert motion.step(ROBOT, pose, STILL, STILL, dt_s=DT_S) == (pose, STILL)
