"""Set-points by hand, gaps against a slow search, and the rotation memory's rules."""

from __future__ import annotations

from math import asin, inf, pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents import msam, steering
from agents.steering import Rotation
from swarm.geometry import Twist, Vec2, sector_centres, wrap_angle
from swarm.scenario import Robot, Steering
from tests.agents import scenes

STEERING = Steering()
ROBOT = Robot(name="robot1", start=(0.0, 0.0, 0.0))
CLEAR_M = 0.34
seeds = st.integers(0, 2**32 - 1)


def map_of(sectors_m: list[float]) -> msam.Map:
    ranges_m = np.repeat(np.array(sectors_m, dtype=np.float32) + np.float32(0.01), 3)
    return scenes.look(scenes.alone(), ranges_m)


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
            abs(wrap_angle(angle + yaw - goal)) + 0.35 * abs(wrap_angle(angle + yaw - last)),
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
    map = map_of([float(np.floor(ring)) * 0.05 if ring < 100.0 else inf for ring in rings])
    yaw, goal, last = random.uniform(-pi, pi, 3).tolist()
    look_m = float(random.uniform(0.5, 2.0))
    chosen = steering.choose_direction(
        STEERING, map, yaw, goal, last, clear_m=CLEAR_M, look_m=look_m
    )
    assert chosen == slow_choice(map.sectors_m, yaw, goal, last, look_m)


def test_choose_direction_is_none_when_enclosed() -> None:
    map = map_of([0.5] * 72)
    assert (
        steering.choose_direction(STEERING, map, 0.0, 1.0, 1.0, clear_m=CLEAR_M, look_m=2.0) is None
    )


def test_choose_direction_keeps_to_the_gap_chosen_last() -> None:
    sectors_m = [inf] * 72
    for index in range(30, 42):
        sectors_m[index] = 1.0
    map = map_of(sectors_m)
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


# --- rotation memory ----------------------------------------------------------------------------


def remember(
    memory: Rotation,
    map: msam.Map,
    distance_m: float,
    *,
    position: Vec2 = (0.0, 0.0),
    goal_rad: float = 0.0,
    waiting: bool = False,
    ticks: int = 1,
) -> Rotation:
    for _ in range(ticks):
        memory = steering.remember_rotation(
            STEERING,
            memory,
            map,
            position,
            0.0,
            goal_rad,
            distance_m,
            clear_m=CLEAR_M,
            keep_m=STEERING.round_distance_m,
            waiting=waiting,
            elapsed_s=0.08,
        )
    return memory


AHEAD = map_of([1.0 if 33 <= index < 39 else inf for index in range(72)])
FREE = map_of([inf] * 72)
STALL_TICKS = 51  # the first tick sets the reference, 50 more make 4.0 s


def test_round_begins_after_four_seconds_without_progress() -> None:
    memory = remember(Rotation(), AHEAD, 5.0, ticks=STALL_TICKS - 1, goal_rad=0.2)
    assert memory.sense == 0
    memory = remember(memory, AHEAD, 5.0, goal_rad=0.2)
    assert (memory.sense, memory.hit, memory.hit_distance_m) == (1, (0.0, 0.0), 5.0)


def test_round_goes_right_when_the_goal_is_straight_behind() -> None:
    assert remember(Rotation(), AHEAD, 5.0, ticks=STALL_TICKS).sense == -1


def test_round_does_not_begin_while_waiting_or_in_the_open() -> None:
    assert remember(Rotation(), AHEAD, 5.0, ticks=200, waiting=True).sense == 0
    assert remember(Rotation(), FREE, 5.0, ticks=200).sense == 0


def test_round_does_not_begin_while_the_goal_comes_nearer() -> None:
    memory = Rotation()
    for tick in range(400):
        memory = remember(memory, AHEAD, 20.0 - 0.05 * tick)
    assert memory.sense == 0


def test_round_tries_the_other_way_at_the_same_place() -> None:
    memory = Rotation(hit=(0.5, 0.0), hit_sense=1, hit_distance_m=5.0)
    assert remember(memory, AHEAD, 5.0, ticks=STALL_TICKS, goal_rad=0.2).sense == -1
    far = remember(memory, AHEAD, 5.0, position=(2.0, 0.0), ticks=STALL_TICKS, goal_rad=0.2)
    assert far.sense == 1


def test_round_ends_when_nearer_and_free_only() -> None:
    memory = Rotation(best_m=5.0, sense=1, hit=(0.0, 0.0), hit_distance_m=5.0, hit_sense=1)
    assert remember(memory, AHEAD, 4.6).sense == 1  # nearer, not free
    assert remember(memory, AHEAD, 4.8, goal_rad=2.0).sense == 1  # free, not nearer
    assert remember(memory, AHEAD, 4.6, goal_rad=2.0).sense == 0
    assert remember(memory, FREE, 5.0).sense == 0  # nothing to walk round


def test_round_fails_after_its_longest_time_for_good() -> None:
    memory = Rotation(sense=1, hit=(0.0, 0.0), hit_distance_m=5.0, round_s=149.95)
    after = remember(memory, AHEAD, 6.0)
    assert (after.sense, after.failed) == (0, "too-long")
    assert remember(after, FREE, 1.0) == after
    assert remember(memory, AHEAD, 6.0, waiting=True).failed == ""


def near(wall_rad: float) -> msam.Map:
    """A wall at the distance that is kept, in that direction, and a blocked goal."""
    middle = round((wall_rad + pi) / (pi / 36.0))
    return map_of([0.65 if abs(index - middle) < 3 else inf for index in range(72)])


def lap(memory: Rotation, *, back_wall_rad: float = 0.0) -> Rotation:
    """Away from the hit point and back to it."""
    for x_m, y_m in ((1.0, 0.5), (2.0, 2.0), (0.5, 1.0)):
        memory = remember(memory, near(0.0), 6.0, position=(x_m, y_m))
    return remember(memory, near(back_wall_rad), 6.0, position=(0.2, 0.1))


def test_round_turns_back_after_a_lap_and_fails_after_the_second() -> None:
    memory = Rotation(sense=1, hit=(0.3, 0.0), hit_distance_m=5.0, hit_sense=1)
    memory = remember(memory, near(0.0), 6.0)
    assert (memory.sense, memory.lap, memory.laps) == (1, (0.0, 0.0), 0)
    memory = lap(memory)
    assert (memory.sense, memory.hit_sense, memory.laps, memory.failed) == (-1, -1, 1, "")
    memory = lap(memory)
    assert (memory.sense, memory.failed) == (0, "enclosed")


def test_round_goes_on_when_another_wall_is_beside_the_place() -> None:
    memory = remember(Rotation(sense=1, hit=(0.3, 0.0), hit_distance_m=5.0), near(0.0), 6.0)
    assert lap(memory, back_wall_rad=2.0).laps == 0  # back along a narrow corridor


def test_round_begins_a_lap_at_the_wall_only() -> None:
    memory = Rotation(sense=1, hit=(0.3, 0.0), hit_distance_m=5.0)
    assert remember(memory, AHEAD, 6.0).lap is None  # 1.0 m away
    assert lap(remember(memory, AHEAD, 6.0)).laps == 0


def test_round_counts_laps_anew_when_the_goal_came_nearer() -> None:
    memory = Rotation(sense=1, hit_distance_m=5.0, lap=(0.0, 0.0), laps=1, round_s=80.0)
    after = remember(memory, AHEAD, 4.6, goal_rad=2.0)
    assert (after.sense, after.laps, after.lap, after.round_s) == (0, 0, None, 0.0)


@pytest.mark.parametrize("sense", [1, -1])
def test_follow_wall_keeps_its_distance_and_side(sense: int) -> None:
    def along(range_m: float) -> Vec2:
        sectors_m = [inf] * 72
        sectors_m[36] = range_m  # 2.5 degrees left of the heading
        return steering.follow_wall(STEERING.round_distance_m, map_of(sectors_m), sense, 0.0)

    ahead_x, side_y = along(0.65)
    assert side_y * sense > 0.9
    assert abs(ahead_x) < 0.1
    assert along(0.40)[0] < -0.4  # too near: away
    assert along(1.40)[0] > 0.9  # too far: closer
