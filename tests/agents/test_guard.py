"""Guards: by hand, and by driving at things."""

from __future__ import annotations

from math import cos, inf, sin, sqrt

import msgspec
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from agents import guard
from swarm import geometry
from swarm.geometry import STILL, Pose, Twist
from tests.agents import scenes
from world import motion

SETUP = scenes.alone()


def test_brake_allows_the_speed_that_stops_in_the_free_way() -> None:
    near = guard.hits(SETUP, scenes.look(SETUP, scenes.wall(0.6)))
    # The beam nearest to the axis is half a beam off it; 0.6 - 0.22 - 0.05 is free.
    assert guard.brake(SETUP, near, 1.0) == pytest.approx(sqrt(2.0 * 0.33), abs=1e-3)
    assert guard.brake(SETUP, near, -1.0) == inf


def test_brake_ignores_what_is_beside_the_way() -> None:
    # A disc whose surface is 0.27 m off the axis, outside the strip of 0.25 m.
    near = guard.hits(SETUP, scenes.look(SETUP, scenes.scan([(0.5, 0.57, 0.3)], scenes.ORIGIN)))
    assert near
    assert guard.brake(SETUP, near, 1.0) == inf


def test_who_brakes_late_begins_earlier() -> None:
    map = scenes.look(SETUP, scenes.wall(0.6))
    driving = Twist(1.0, 0.0)
    # 0.33 m are free; 0.16 s go by until it brakes: v 0.16 + v2 / 2 = 0.33
    late = guard.by_obstacles(SETUP, map, driving, 0.0, late_s=0.16).speed_mps
    assert late * 0.16 + late * late / 2.0 == pytest.approx(0.33, abs=1e-3)
    heard = scenes.peer(scenes.beacon("robot2", Pose(1.5, 0.0, 0.0)))
    expected = sqrt(2.0 * 0.5 + 0.32**2) - 0.32  # its half of the gap; 0.16 s more than always
    assert guard.share(SETUP, heard, 1.0, late_s=0.16) == pytest.approx(expected)
    missed = msgspec.structs.replace(heard, missed_ticks=2)
    assert guard.share(SETUP, missed, 1.0) == pytest.approx(expected)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_brake_stops_before_a_wall_whatever_the_direction(side: float) -> None:
    yaw_rad = 0.0 if side > 0.0 else 3.141592653589793
    x_m, speed_mps = 0.0, 1.0
    for _ in range(100):
        pose = Pose(x_m, 0.0, yaw_rad)
        map = scenes.look(SETUP, scenes.scan([(52.0, 0.0, 50.0)], pose))
        driving, asked = Twist(side * speed_mps, 0.0), Twist(side, 0.0)
        speed_mps = abs(guard.hold(SETUP, driving, asked, map, ())[0].speed_mps)
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


def test_guards_plan_with_less_than_the_bodys_own_brakes_when_they_are_weak() -> None:
    weak = scenes.alone(acceleration_mps2_max=0.5)
    near = guard.hits(SETUP, scenes.look(SETUP, scenes.wall(0.6)))
    share = sqrt(0.75 * 0.5)
    assert guard.brake(weak, near, 1.0) == pytest.approx(share * guard.brake(SETUP, near, 1.0))
    heard = scenes.peer(scenes.beacon("robot2", Pose(1.0, 0.0, 0.0)))
    assert guard.share(weak, heard, 1.0) == pytest.approx(sqrt(0.375 * 0.5 + 0.06**2) - 0.06)


def test_hold_names_what_holds_the_robot_back() -> None:
    near = scenes.peer(scenes.beacon("robot2", Pose(0.6, 0.0, 0.0)))
    open_map = scenes.look(SETUP, scenes.nothing())
    driving = Twist(1.0, 0.0)
    assert guard.hold(SETUP, driving, driving, open_map, ()) == (driving, guard.Limit(1.0, ""))
    held, allowed = guard.hold(SETUP, driving, driving, open_map, [near])
    assert allowed.by == "robot2"
    assert held == Twist(allowed.speed_mps, 0.0)
    wall = scenes.look(SETUP, scenes.wall(0.26))
    assert guard.hold(SETUP, driving, driving, wall, [near])[1] == guard.Limit(0.0, "brake")


# --- in a bend ----------------------------------------------------------------------------------

FAST = scenes.alone(speed_mps_max=2.0, acceleration_mps2_max=2.0, turn_acceleration_radps2_max=8.0)
BESIDE = [(1.0, 1.0, 0.5)]  # on the left, 0.5 m off the way straight on


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_bend_is_the_brake_where_the_robot_drives_straight_at_something(side: float) -> None:
    driving = Twist(side * 2.0, 0.0)
    near = [(side * 1.2, 0.0)]
    # 1.2 - 0.22 - 0.05 is free.
    assert guard.brake(FAST, near, side) == pytest.approx(sqrt(2.0 * 0.93))
    assert guard.bend(FAST, near, driving, 0.0) == pytest.approx(sqrt(2.0 * 0.93))
    assert guard.bend(FAST, [(-side * 0.3, 0.0)], driving, 0.0) == inf


def test_bend_sees_what_a_turn_swings_the_robot_at() -> None:
    near = guard.hits(FAST, scenes.look(FAST, scenes.scan(BESIDE, scenes.ORIGIN)))
    driving = Twist(1.5, 0.0)
    assert guard.brake(FAST, near, 1.0) == inf
    assert guard.bend(FAST, near, driving, 0.0) == inf
    assert guard.bend(FAST, near, driving, -2.5) == inf
    assert guard.bend(FAST, near, driving, 2.5) < 1.5


@given(
    speed_mps=st.floats(0.3, 2.0),
    turn_rate_radps=st.floats(-2.5, 2.5),
    onward_radps=st.floats(-2.5, 2.5),
    hit=st.tuples(st.floats(-1.0, 2.0), st.floats(-1.5, 1.5)),
)
def test_bend_is_what_driving_it_in_small_steps_says(
    speed_mps: float, turn_rate_radps: float, onward_radps: float, hit: tuple[float, float]
) -> None:
    keep_m = 0.22 + FAST.guard.strip_margin_m
    assume(sqrt(hit[0] ** 2 + hit[1] ** 2) > keep_m)
    driving = Twist(speed_mps, turn_rate_radps)
    free_m = _driven(driving, onward_radps, hit, keep_m)
    allowed = guard.bend(FAST, [hit], driving, onward_radps)
    if allowed == inf:  # it may graze, between two points of the curve
        assert _driven(driving, onward_radps, hit, keep_m - 0.04) == inf
    else:
        assert _driven(driving, onward_radps, hit, keep_m + 0.01) < inf
        if free_m < inf:
            assert allowed**2 / 2.0 == pytest.approx(max(0.0, free_m - 0.02), abs=0.08)


def _driven(driving: Twist, onward_radps: float, hit: tuple[float, float], keep_m: float) -> float:
    """Way until the hit is nearer than `keep_m`, inf when it never is; in twentieths of a tick."""
    x_m = y_m = yaw_rad = way_m = 0.0
    speed_mps, turn_rate_radps = driving.speed_mps, driving.turn_rate_radps
    stop_m = speed_mps**2 / 2.0
    while way_m < stop_m and speed_mps > 0.0:
        for _ in range(20):
            x_m += 0.004 * speed_mps * cos(yaw_rad)
            y_m += 0.004 * speed_mps * sin(yaw_rad)
            yaw_rad += 0.004 * turn_rate_radps
            way_m += 0.004 * speed_mps
            if sqrt((hit[0] - x_m) ** 2 + (hit[1] - y_m) ** 2) < keep_m:
                return way_m
        speed_mps -= 0.08
        turn_rate_radps += max(-0.64, min(0.64, onward_radps - turn_rate_radps))
    return inf


def test_hold_brakes_first_and_turns_later_where_the_brakes_are_too_weak() -> None:
    map = scenes.look(FAST, scenes.scan([(0.9, 0.75, 0.5)], scenes.ORIGIN))
    driving, asked = Twist(2.0, 0.0), Twist(2.0, 2.5)
    held, allowed = guard.hold(FAST, driving, asked, map, ())
    assert allowed.speed_mps < 2.0 - 2.0 * 0.08  # out of reach within this tick
    assert held == Twist(allowed.speed_mps, 0.0)
    slow, _ = guard.hold(FAST, Twist(0.3, 0.0), Twist(0.3, 2.5), map, ())
    assert slow.turn_rate_radps == pytest.approx(0.64)


@pytest.mark.parametrize(
    ("speed_mps", "brakes_mps2"), [(1.0, 4.0), (1.0, 1.0), (2.0, 2.0)], ids=str
)
def test_hold_keeps_a_wild_driver_from_touching_anything(
    speed_mps: float, brakes_mps2: float
) -> None:
    setup = scenes.alone(
        speed_mps_max=speed_mps,
        acceleration_mps2_max=brakes_mps2,
        turn_acceleration_radps2_max=8.0,
    )
    for seed in range(6):
        generator = np.random.Generator(np.random.Philox(key=seed))
        ring = [(6.0 * x, 6.0 * y, 0.5) for x, y in map(geometry.unit, np.arange(0.0, 6.3, 0.15))]
        spots = generator.uniform(-5.0, 5.0, (40, 2)).tolist()
        discs = ring + [(x_m, y_m, 0.3) for x_m, y_m in spots if sqrt(x_m**2 + y_m**2) > 1.0]
        pose, twist, way_m = scenes.ORIGIN, STILL, 0.0
        for tick in range(150):
            if tick % 6 == 0:
                asked = Twist(speed_mps, 2.5 * float(generator.integers(-1, 2)))
            map_ = scenes.look(setup, scenes.scan(discs, pose))
            held, _ = guard.hold(setup, twist, asked, map_, ())
            pose, twist = motion.step(setup.robot, pose, twist, held, dt_s=0.08)
            way_m += 0.08 * abs(twist.speed_mps)
            gap_m = min([sqrt((x - pose.x_m) ** 2 + (y - pose.y_m) ** 2) - r for x, y, r in discs])
            assert gap_m > setup.robot.body_radius_m
        assert way_m > 2.0


# --- peers --------------------------------------------------------------------------------------


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
