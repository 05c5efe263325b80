"""Guards: by hand, and by driving at things."""

from __future__ import annotations

from math import inf, sqrt

import pytest

from agents import guard
from swarm.geometry import Pose, Twist
from tests.agents import scenes

SETUP = scenes.alone()


def test_brake_allows_the_speed_that_stops_in_the_free_way() -> None:
    map = scenes.look(SETUP, scenes.wall(0.6))
    # The beam nearest to the axis is half a beam off it; 0.6 - 0.22 - 0.05 is free.
    assert guard.brake(SETUP, map, 1.0) == pytest.approx(sqrt(2.0 * 0.33), abs=1e-3)
    assert guard.brake(SETUP, map, -1.0) == inf


def test_brake_ignores_what_is_beside_the_way() -> None:
    # A disc whose surface is 0.27 m off the axis, outside the strip of 0.25 m.
    map = scenes.look(SETUP, scenes.scan([(0.5, 0.57, 0.3)], scenes.ORIGIN))
    assert guard.brake(SETUP, map, 1.0) == inf


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_brake_stops_before_a_wall_whatever_the_direction(side: float) -> None:
    yaw_rad = 0.0 if side > 0.0 else 3.141592653589793
    x_m, speed_mps = 0.0, 1.0
    for _ in range(100):
        pose = Pose(x_m, 0.0, yaw_rad)
        map = scenes.look(SETUP, scenes.scan([(52.0, 0.0, 50.0)], pose))
        allowed = guard.limit(SETUP, map, (), forward=side > 0.0).speed_mps
        speed_mps = max(min(1.0, allowed), speed_mps - 4.0 * 0.08)
        x_m += 0.08 * speed_mps
        assert x_m + 0.22 < 2.0
    assert x_m + 0.22 == pytest.approx(2.0 - 0.05, abs=0.03)


def test_share_leaves_half_of_the_gap_to_a_peer_ahead() -> None:
    heard = scenes.peer(scenes.beacon("robot2", Pose(1.5, 0.0, 0.0)))
    expected = sqrt(2.0 * (1.5 - 0.44 - 0.06) / 2.0 + 0.16**2) - 0.16
    assert guard.share(SETUP, heard, 1.0) == pytest.approx(expected)
    assert guard.share(SETUP, heard, -1.0) == inf


def test_share_is_zero_when_the_gap_is_used_up() -> None:
    heard = scenes.peer(scenes.beacon("robot2", Pose(0.49, 0.0, 0.0)))
    assert guard.share(SETUP, heard, 1.0) == 0.0


def test_share_lets_pass_what_is_far_aside_or_away() -> None:
    for pose in (Pose(1.0, 0.8, 0.0), Pose(0.0, 0.6, 0.0)):
        heard = scenes.peer(scenes.beacon("robot2", pose))
        assert guard.share(SETUP, heard, 1.0) == inf
    far = scenes.peer(scenes.beacon("robot2", Pose(2.1, 0.0, 0.0)))
    assert guard.share(SETUP, far, 1.0) > SETUP.robot.speed_mps_max


def test_share_limits_a_fast_robot_from_further_away() -> None:
    fast = scenes.alone(speed_mps_max=2.0)
    heard = scenes.peer(scenes.beacon("robot2", Pose(3.0, 0.0, 0.0), body_radius_m=0.4))
    half_m = (3.0 - 0.22 - 0.4 - 0.06) / 2.0
    assert guard.share(fast, heard, 1.0) == pytest.approx(sqrt(2.0 * half_m + 0.0256) - 0.16)
    assert guard.share(fast, heard, 1.0) < fast.robot.speed_mps_max


def test_guards_plan_with_the_bodys_own_brakes_when_they_are_weaker() -> None:
    weak = scenes.alone(acceleration_mps2_max=0.5)
    map = scenes.look(weak, scenes.wall(0.6))
    assert guard.brake(weak, map, 1.0) == pytest.approx(
        guard.brake(SETUP, map, 1.0) / sqrt(2.0), abs=1e-9
    )
    heard = scenes.peer(scenes.beacon("robot2", Pose(1.0, 0.0, 0.0)))
    assert guard.share(weak, heard, 1.0) == pytest.approx(sqrt(0.25 + 0.0064) - 0.08)


def test_limit_names_what_holds_the_robot_back() -> None:
    near = scenes.peer(scenes.beacon("robot2", Pose(0.6, 0.0, 0.0)))
    open_map = scenes.look(SETUP, scenes.nothing())
    assert guard.limit(SETUP, open_map, (), forward=True) == guard.Limit(1.0, "")
    assert guard.limit(SETUP, open_map, [near], forward=True).by == "robot2"
    wall = scenes.look(SETUP, scenes.wall(0.26))
    assert guard.limit(SETUP, wall, [near], forward=True).by == "brake"


def test_two_robots_that_drive_at_each_other_never_touch() -> None:
    poses = [Pose(0.0, 0.0, 0.0), Pose(3.0, 0.0, -3.141592653589793)]
    speeds = [1.0, 1.0]
    past = [poses, poses]  # each knows the other a tick late, and not how it brakes
    for _ in range(80):
        heard = [
            scenes.peer(
                scenes.beacon("robot2", past[0][1 - i], Twist(speeds[1 - i], 0.0)), poses[i], 1
            )
            for i in (0, 1)
        ]
        allowed = [guard.share(SETUP, heard[i], 1.0) for i in (0, 1)]
        speeds = [max(min(1.0, allowed[i]), speeds[i] - 4.0 * 0.08) for i in (0, 1)]
        past = [past[1], poses]
        poses = [
            Pose(poses[0].x_m + 0.08 * speeds[0], 0.0, 0.0),
            Pose(poses[1].x_m - 0.08 * speeds[1], 0.0, -3.141592653589793),
        ]
        assert poses[1].x_m - poses[0].x_m > 0.44
