"""Angles, arcs and sectors."""

from __future__ import annotations

from math import atan2, cos, inf, nan, nextafter, pi, sin

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm.geometry import Pose, Twist, advance, bearing, distance, sector_centres, wrap_angle

angles = st.floats(-100.0, 100.0)


@given(angles)
def test_wrap_angle_keeps_the_direction_and_ends_in_the_half_open_interval(angle: float) -> None:
    wrapped = wrap_angle(angle)
    assert -pi <= wrapped < pi
    assert (cos(wrapped), sin(wrapped)) == pytest.approx((cos(angle), sin(angle)), abs=1e-12)


@given(st.floats(-pi, pi, exclude_max=True))
def test_wrap_angle_changes_no_bit_when_there_is_nothing_to_wrap(angle: float) -> None:
    assert wrap_angle(angle) == angle


@pytest.mark.parametrize("angle", [pi, -pi, 3.0 * pi, nextafter(-pi, -inf), -1e-17 - pi])
def test_wrap_angle_never_returns_pi(angle: float) -> None:
    assert -pi <= wrap_angle(angle) < pi


@given(st.floats(-1.0, 1.0), st.floats(-2.5, 2.5), st.floats(-pi, pi, exclude_max=True))
def test_advance_ends_where_the_chord_of_the_arc_does(
    speed_mps: float, turn_rate_radps: float, yaw_rad: float
) -> None:
    pose = advance(Pose(1.0, -2.0, yaw_rad), Twist(speed_mps, turn_rate_radps), 0.08)
    turn_rad = turn_rate_radps * 0.08
    half = turn_rad / 2.0  # a chord is 2 r sin(turn / 2) long and half the turn off the heading
    chord_m = speed_mps * 0.08 * (sin(half) / half if abs(half) > 1e-12 else 1.0)
    assert pose.x_m == pytest.approx(1.0 + chord_m * cos(yaw_rad + half), abs=1e-6)
    assert pose.y_m == pytest.approx(-2.0 + chord_m * sin(yaw_rad + half), abs=1e-6)
    assert pose.yaw_rad == wrap_angle(yaw_rad + turn_rad)


def test_advance_is_exact_when_straight_and_continuous_when_nearly_so() -> None:
    straight = advance(Pose(0.0, 0.0, 0.0), Twist(0.5, 0.0), 0.1)
    assert straight == Pose(0.05, 0.0, 0.0)
    nearly = advance(Pose(0.0, 0.0, 0.0), Twist(0.5, 2e-9), 0.1)
    assert distance(straight, nearly) < 1e-7


@pytest.mark.parametrize("count", [8, 17, 72, 216])
def test_sector_centres_are_even_and_exactly_antisymmetric(count: int) -> None:
    centres = sector_centres(count)
    assert centres == [-angle for angle in reversed(centres)]
    assert centres[0] == pytest.approx(-pi + pi / count)
    assert centres[1] - centres[0] == pytest.approx(2.0 * pi / count)


def test_bearing_points_from_the_pose_to_the_point() -> None:
    assert bearing(Pose(1.0, 1.0, 2.0), 1.0, 3.0) == atan2(2.0, 0.0)


@pytest.mark.parametrize("value", [nan, inf, -inf])
def test_pose_and_twist_refuse_what_is_not_finite_when_decoded(value: float) -> None:
    with pytest.raises(msgspec.ValidationError, match="float"):
        msgspec.msgpack.decode(msgspec.msgpack.encode(Pose(0.0, value, 0.0)), type=Pose)
    with pytest.raises(msgspec.ValidationError, match="float"):
        msgspec.msgpack.decode(msgspec.msgpack.encode(Twist(value, 0.0)), type=Twist)
