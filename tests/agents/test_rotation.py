"""The rotation memory's rules: when ROUND begins, turns back, ends and gives up."""

from __future__ import annotations

from math import inf, pi

import pytest

from agents import msam, rotation
from swarm.geometry import Vec2
from swarm.scenario import Steering
from tests.agents import scenes

STEERING = Steering()
CLEAR_M = 0.34


def remember(
    memory: rotation.State,
    map: msam.Map,
    distance_m: float,
    *,
    position: Vec2 = (0.0, 0.0),
    goal_rad: float = 0.0,
    waiting: bool = False,
    ticks: int = 1,
) -> rotation.State:
    for _ in range(ticks):
        memory = rotation.step(
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


AHEAD = scenes.map_of([1.0 if 33 <= index < 39 else inf for index in range(72)])
FREE = scenes.map_of([inf] * 72)
STALL_TICKS = 51  # the first tick sets the reference, 50 more make 4.0 s


def test_round_begins_after_four_seconds_without_progress() -> None:
    memory = remember(rotation.State(), AHEAD, 5.0, ticks=STALL_TICKS - 1, goal_rad=0.2)
    assert memory.sense == 0
    memory = remember(memory, AHEAD, 5.0, goal_rad=0.2)
    assert (memory.sense, memory.hit, memory.hit_distance_m) == (1, (0.0, 0.0), 5.0)


def test_round_goes_right_when_the_goal_is_straight_behind() -> None:
    assert remember(rotation.State(), AHEAD, 5.0, ticks=STALL_TICKS).sense == -1


def test_round_does_not_begin_while_waiting_or_in_the_open() -> None:
    assert remember(rotation.State(), AHEAD, 5.0, ticks=200, waiting=True).sense == 0
    assert remember(rotation.State(), FREE, 5.0, ticks=200).sense == 0


def test_round_does_not_begin_while_the_goal_comes_nearer() -> None:
    memory = rotation.State()
    for tick in range(400):
        memory = remember(memory, AHEAD, 20.0 - 0.05 * tick)
    assert memory.sense == 0


def test_round_tries_the_other_way_at_the_same_place() -> None:
    memory = rotation.State(hit=(0.5, 0.0), hit_sense=1, hit_distance_m=5.0)
    assert remember(memory, AHEAD, 5.0, ticks=STALL_TICKS, goal_rad=0.2).sense == -1
    far = remember(memory, AHEAD, 5.0, position=(2.0, 0.0), ticks=STALL_TICKS, goal_rad=0.2)
    assert far.sense == 1


def test_round_ends_when_nearer_and_free_only() -> None:
    memory = rotation.State(best_m=5.0, sense=1, hit=(0.0, 0.0), hit_distance_m=5.0, hit_sense=1)
    assert remember(memory, AHEAD, 4.6).sense == 1  # nearer, not free
    assert remember(memory, AHEAD, 4.8, goal_rad=2.0).sense == 1  # free, not nearer
    assert remember(memory, AHEAD, 4.6, goal_rad=2.0).sense == 0
    assert remember(memory, FREE, 5.0).sense == 0  # nothing to walk round


def test_round_fails_after_its_longest_time_for_good() -> None:
    memory = rotation.State(sense=1, hit=(0.0, 0.0), hit_distance_m=5.0, round_s=149.95)
    after = remember(memory, AHEAD, 6.0)
    assert (after.sense, after.failed) == (0, "too-long")
    assert remember(after, FREE, 1.0) == after
    assert remember(memory, AHEAD, 6.0, waiting=True).failed == ""


def near(wall_rad: float) -> msam.Map:
    """A wall at the distance that is kept, in that direction, and a blocked goal."""
    middle = round((wall_rad + pi) / (pi / 36.0))
    return scenes.map_of([0.65 if abs(index - middle) < 3 else inf for index in range(72)])


def lap(memory: rotation.State, *, back_wall_rad: float = 0.0) -> rotation.State:
    """Away from the hit point and back to it."""
    for x_m, y_m in ((1.0, 0.5), (2.0, 2.0), (0.5, 1.0)):
        memory = remember(memory, near(0.0), 6.0, position=(x_m, y_m))
    return remember(memory, near(back_wall_rad), 6.0, position=(0.2, 0.1))


def test_round_turns_back_after_a_lap_and_fails_after_the_second() -> None:
    memory = rotation.State(sense=1, hit=(0.3, 0.0), hit_distance_m=5.0, hit_sense=1)
    memory = remember(memory, near(0.0), 6.0)
    assert (memory.sense, memory.lap, memory.laps) == (1, (0.0, 0.0), 0)
    memory = lap(memory)
    assert (memory.sense, memory.hit_sense, memory.laps, memory.failed) == (-1, -1, 1, "")
    memory = lap(memory)
    assert (memory.sense, memory.failed) == (0, "enclosed")


def test_round_goes_on_when_another_wall_is_beside_the_place() -> None:
    memory = remember(rotation.State(sense=1, hit=(0.3, 0.0), hit_distance_m=5.0), near(0.0), 6.0)
    assert lap(memory, back_wall_rad=2.0).laps == 0  # back along a narrow corridor


def test_round_begins_a_lap_at_the_wall_only() -> None:
    memory = rotation.State(sense=1, hit=(0.3, 0.0), hit_distance_m=5.0)
    assert remember(memory, AHEAD, 6.0).lap is None  # 1.0 m away
    assert lap(remember(memory, AHEAD, 6.0)).laps == 0


def test_round_counts_laps_anew_when_the_goal_came_nearer() -> None:
    memory = rotation.State(sense=1, hit_distance_m=5.0, lap=(0.0, 0.0), laps=1, round_s=80.0)
    after = remember(memory, AHEAD, 4.6, goal_rad=2.0)
    assert (after.sense, after.laps, after.lap, after.round_s) == (0, 0, None, 0.0)


@pytest.mark.parametrize("sense", [1, -1])
def test_follow_wall_keeps_its_distance_and_side(sense: int) -> None:
    def along(range_m: float) -> Vec2:
        sectors_m = [inf] * 72
        sectors_m[36] = range_m  # 2.5 degrees left of the heading
        return rotation.follow_wall(STEERING.round_distance_m, scenes.map_of(sectors_m), sense, 0.0)

    ahead_x, side_y = along(0.65)
    assert side_y * sense > 0.9
    assert abs(ahead_x) < 0.1
    assert along(0.40)[0] < -0.4  # too near: away
    assert along(1.40)[0] > 0.9  # too far: closer


ROUND = rotation.State(sense=-1, hit=(0.0, 0.0), hit_distance_m=5.0, hit_sense=-1, place=(0.0, 0.0))
PLACE_TICKS = 251  # 20 s and a tick


def test_round_that_does_not_get_away_has_no_room_and_looks_for_a_gap_by_turns() -> None:
    memory = remember(ROUND, AHEAD, 5.0, ticks=PLACE_TICKS - 2)
    assert (rotation.is_confined(memory), memory.sense) == (False, -1)
    memory = remember(memory, AHEAD, 5.0, ticks=2)
    assert (rotation.is_confined(memory), memory.sense) == (True, 0)
    memory = remember(memory, AHEAD, 5.0, ticks=STALL_TICKS + 1)
    assert (rotation.is_confined(memory), memory.sense) == (True, 1)  # the other way round
    assert memory.turn_s < 0.5


def test_round_that_gets_away_has_room_again() -> None:
    memory = remember(ROUND, AHEAD, 5.0, ticks=PLACE_TICKS + 10)
    memory = remember(memory, AHEAD, 5.0, position=(0.9, 0.0))
    assert rotation.is_confined(memory)
    memory = remember(memory, AHEAD, 5.0, position=(1.1, 0.0))
    assert not rotation.is_confined(memory)


def test_who_waits_for_others_is_not_confined() -> None:
    assert not rotation.is_confined(remember(ROUND, AHEAD, 5.0, ticks=1000, waiting=True))
