"""The guard: after whatever it allows, braking touches nothing."""

from __future__ import annotations

from math import cos, pi, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.navigator import brake
from swarm import geometry
from swarm.geometry import STILL, Pose, Twist
from swarm.scenario import RobotSetup
from tests.agents import scenes

SETUP = scenes.alone(acceleration_mps2_max=2.0, turn_acceleration_radps2_max=8.0)
RADIUS_M = SETUP.robot.body_radius_m
NONE = np.empty((0, 2))


def near(points: list[tuple[float, float]], pose: Pose) -> np.ndarray:
    away = np.array(points).reshape(-1, 2) - np.array((pose.x_m, pose.y_m))
    return np.asarray(away, dtype=np.float64)


def moved(pose: Pose, twist: Twist) -> list[Pose]:
    """Where it is during a tick."""
    return [geometry.advance(pose, twist, scenes.DT_S * part / 8) for part in range(1, 9)]


def gap(points: list[tuple[float, float]], pose: Pose) -> float:
    return min(geometry.length(x - pose.x_m, y - pose.y_m) for x, y in points) - RADIUS_M


asked = st.builds(Twist, st.floats(-1.5, 1.5), st.floats(-4.0, 4.0))
clouds = st.lists(st.tuples(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5)), min_size=1, max_size=25)


@given(clouds, st.lists(asked, min_size=1, max_size=14), st.floats(-pi, 3.1))
def test_nothing_is_ever_touched_whatever_is_asked(
    points: list[tuple[float, float]], wishes: list[Twist], yaw_rad: float
) -> None:
    pose, twist = Pose(0.0, 0.0, yaw_rad), STILL
    points = [point for point in points if geometry.length(*point) > RADIUS_M + 0.005]
    if not points:
        return
    for wish in wishes:
        around = near(points, pose)
        set_point, _ = brake.hold(SETUP, pose.yaw_rad, twist, wish, around)
        twist = brake.reached(SETUP.robot, twist, set_point, scenes.DT_S)
        assert twist.speed_mps == pytest.approx(set_point.speed_mps, abs=1e-12)
        for place in moved(pose, twist):
            assert gap(points, place) > 0.0
        pose = place
    # and then the brakes alone, until it stands
    while twist.speed_mps != 0.0:
        twist = brake.braked(SETUP, twist)
        for place in moved(pose, twist):
            assert gap(points, place) > 0.0
        pose = place


@given(asked, asked)
def test_a_course_is_where_the_robot_goes(before: Twist, wish: Twist) -> None:
    twist = brake.reached(SETUP.robot, STILL, before, 1.0)
    one = brake.course(SETUP, 0.3, twist, wish)
    pose, twist = Pose(0.0, 0.0, 0.3), one.reached
    for x_m, y_m in one.at_ticks().tolist():
        pose = geometry.advance(pose, twist, scenes.DT_S)
        assert geometry.length(x_m - pose.x_m, y_m - pose.y_m) < 1e-5
        twist = brake.braked(SETUP, twist)
    assert twist.speed_mps == 0.0


def test_what_is_asked_is_allowed_where_nothing_is() -> None:
    set_point, limit = brake.hold(SETUP, 0.0, Twist(0.5, 0.0), Twist(0.6, 0.3), NONE)
    assert set_point == Twist(0.6, 0.3)
    assert limit.by == ""


def test_the_robot_slows_down_before_a_wall_and_stops_at_the_margin() -> None:
    points = [(1.0, 0.02 * i) for i in range(-50, 51)]
    pose, twist = Pose(0.0, 0.0, 0.0), STILL
    said = set()
    for _ in range(80):
        twist, limit = brake.hold(SETUP, 0.0, twist, Twist(1.0, 0.0), near(points, pose))
        said.add(limit.by)
        pose = geometry.advance(pose, twist, scenes.DT_S)
    assert said == {"", "brake"}
    assert twist.speed_mps < 0.06
    assert 0.0 < gap(points, pose) <= SETUP.navigator.guard_margin_m + 0.01


def test_a_slit_with_less_room_than_the_margin_can_be_passed() -> None:
    side_m = RADIUS_M + 0.012
    points = [(0.4 + 0.02 * i, side * side_m) for i in range(30) for side in (-1, 1)]
    pose, twist = Pose(0.0, 0.0, 0.0), STILL
    for _ in range(150):
        twist, _ = brake.hold(SETUP, 0.0, twist, Twist(0.4, 0.0), near(points, pose))
        pose = geometry.advance(pose, twist, scenes.DT_S)
    assert pose.x_m > 1.3


def test_who_touches_almost_may_leave_but_not_press_on() -> None:
    points = near([(RADIUS_M + 0.001, 0.0)], Pose(0.0, 0.0, 0.0))
    onward, _ = brake.hold(SETUP, 0.0, STILL, Twist(0.3, 0.0), points)
    away, _ = brake.hold(SETUP, 0.0, STILL, Twist(-0.3, 0.0), points)
    turning, _ = brake.hold(SETUP, 0.0, STILL, Twist(0.0, 0.5), points)
    assert onward.speed_mps == 0.0
    assert away.speed_mps < 0.0
    assert turning.turn_rate_radps == 0.5


@given(clouds, asked, asked, st.floats(-pi, 3.1))
def test_the_first_candidate_that_keeps_off_is_taken(
    points: list[tuple[float, float]], before: Twist, wish: Twist, yaw_rad: float
) -> None:
    around = near(points, Pose(0.0, 0.0, yaw_rad))
    twist = brake.reached(SETUP.robot, STILL, before, 1.0)
    wishes = [Twist(share * wish.speed_mps, wish.turn_rate_radps) for share in brake.SHARES]
    courses = [brake.course(SETUP, yaw_rad, twist, one) for one in wishes]
    keep_m = brake.room(SETUP, around)
    free = [one.reached for one in courses if brake.keeps_off(around, one.places_m, keep_m)]
    set_point, limit = brake.hold(SETUP, yaw_rad, twist, wish, around)
    assert set_point == (free[0] if free else brake.braked(SETUP, twist))
    assert (limit.by == "") == bool(free and free[0] is courses[0].reached)


def mirrored(setup: RobotSetup, yaw_rad: float) -> Twist:
    angles = [0.1 * i for i in range(12)]
    points = np.array([(0.5 * cos(angle), 0.5 * sin(angle)) for angle in angles])
    if yaw_rad < 0.0:
        points = points * np.array((1.0, -1.0))
    side = 1.0 if yaw_rad > 0.0 else -1.0
    return brake.hold(setup, yaw_rad, Twist(0.4, side), Twist(0.8, side), points)[0]


def test_mirrored_scenes_are_braked_mirrored() -> None:
    left, right = mirrored(SETUP, 0.4), mirrored(SETUP, -0.4)
    assert left == Twist(right.speed_mps, -right.turn_rate_radps)
