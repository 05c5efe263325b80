"""Ways of members of a formation: out of traps by memory, and what of others is forgotten."""

from __future__ import annotations

from collections.abc import Callable
from math import cos, pi, sin

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents import formation, navigator, pilot, robot
from agents.navigator import corridor
from swarm import geometry, scenario
from swarm.geometry import Pose, Vec2
from swarm.messages import Leadership, Slot
from swarm.run import lockstep
from swarm.scenario import Formation
from tests.agents import scenes

seeds = st.integers(0, 2**32 - 1)

# A U of three walls, open to the follower; the leader stands behind its back, the slot too.
TRAP = b"""
title = "A follower in a U"
seed = 0
dt_s = 0.08
duration_s = 60.0
formation = { leader = "leader", slots = [{ distance_m = 1.2, bearing_rad = 0.0 }] }
[[robots]]
name = "leader"
start = [8.0, 0.0, 0.0]
goal = [8.5, 0.0]
[[robots]]
name = "robot1"
start = [4.0, 0.1, 0.0]
[[obstacles]]
polygon = [[6.0, -2.0], [6.3, -2.0], [6.3, 2.0], [6.0, 2.0]]
[[obstacles]]
polygon = [[3.5, 2.0], [6.3, 2.0], [6.3, 2.3], [3.5, 2.3]]
[[obstacles]]
polygon = [[3.5, -2.3], [6.3, -2.3], [6.3, -2.0], [3.5, -2.0]]
"""


@pytest.mark.parametrize(("controller", "gets_out"), [("navigator", True), ("paper", False)])
def test_follower_gets_out_of_a_trap_by_memory(controller: str, gets_out: bool) -> None:
    # Along the walls, without a memory, it took 28 s from here.
    plan = scenario.decode(
        TRAP, "trap", settings=[f"robot.controller={controller}"], duration_s=16.0
    )
    follower = lockstep.run(plan).score.tallies[1]
    assert (follower.arrival_tick is not None) == gets_out
    assert not follower.contact


def test_way_leads_to_the_nearest_point_where_the_slot_lies_in_an_obstacle() -> None:
    setup = scenes.follower(Slot(2.0, 0.0))
    ranges_m = scenes.scan([(3.0, 0.0, 0.6)], scenes.ORIGIN)
    frame = scenes.frame(ranges_m=ranges_m)
    map = scenes.look(setup, ranges_m)
    state = pilot.remember(setup, navigator.State(), frame, map, 0.08)
    _, aim = pilot.to_point(setup, state, frame, map, (2.45, 0.0), held=False, elapsed_s=0.08)
    assert not aim.reason
    assert aim.speed_mps > 0.0
    assert abs(aim.direction_rad) < 0.5


def test_way_to_a_point_in_the_open_is_straight_and_costs_no_search() -> None:
    setup = scenes.follower(Slot(2.0, 0.0))
    frame = scenes.frame()
    map = scenes.look(setup, frame.ranges_m())
    state = pilot.remember(setup, navigator.State(), frame, map, 0.08)
    state, aim = pilot.to_point(setup, state, frame, map, (1.0, 1.0), held=False, elapsed_s=0.08)
    assert aim.direction_rad == pytest.approx(pi / 4.0)
    assert aim.speed_mps == setup.robot.speed_mps_max
    assert state.way is None


def test_way_is_kept_until_the_point_has_moved_on() -> None:
    setup = scenes.follower(Slot(2.0, 0.0))
    ranges_m = scenes.wall(1.5)
    frame = scenes.frame(ranges_m=ranges_m)
    map = scenes.look(setup, ranges_m)
    state = pilot.remember(setup, navigator.State(), frame, map, 0.08)
    targets = []
    for number in range(8):
        point = (3.0 + 0.05 * number, 0.0)
        state, _ = pilot.to_point(setup, state, frame, map, point, held=False, elapsed_s=0.08)
        assert state.way is not None
        targets.append(state.way.target[0])
    assert targets == pytest.approx([3.0] * 6 + [3.3] * 2)


def test_member_that_is_masked_again_leaves_nothing_behind() -> None:
    setup = scenes.leader()
    leadership = Leadership(0, (0, 0, 0, 0), "leader")
    ahead = scenes.beacon("robot2", Pose(1.5, 0.1, 0.0), slot=Slot(1.0, 0.0), leadership=leadership)
    aside = scenes.beacon(
        "robot2", Pose(1.5, 1.6, 0.0), tick=2, slot=Slot(1.0, 0.0), leadership=leadership
    )
    state = robot.init(setup)
    seen = scenes.scan([(1.5, 0.1, 0.22)], scenes.ORIGIN)
    state, _ = robot.step(setup, state, scenes.frame("leader", ranges_m=seen, beacons=(ahead,)))
    assert state.navigating.memory is not None
    assert len(state.navigating.memory.points_mm()) > 0
    near = msgspec.structs.replace(ahead, pose=Pose(1.45, 0.1, 0.0), tick=1)
    seen = scenes.scan([(1.45, 0.1, 0.22)], scenes.ORIGIN)
    state, _ = robot.step(setup, state, scenes.frame("leader", 2, ranges_m=seen, beacons=(near,)))
    known = state.navigating.memory
    assert known is not None
    # Only what is seen of it now: nothing lies where it was before and is not any more.
    xs_m = (known.points_mm()[:, 0] + known.origin_mm[0]) / 1000.0
    assert xs_m.min() > 1.2
    far = scenes.scan([(1.5, 1.6, 0.22)], scenes.ORIGIN)
    state, _ = robot.step(setup, state, scenes.frame("leader", 3, ranges_m=far, beacons=(aside,)))


def slow_bearing(
    slot: Slot, now_rad: float, points: list[Vec2], origin: Vec2, heading_rad: float, clear_m: float
) -> float:
    """The rule over points one by one, in the formation's frame."""
    x_m, y_m = origin
    ahead, aside = cos(heading_rad), sin(heading_rad)
    turned = [
        (ahead * (x + x_m) + aside * (y + y_m), ahead * (y + y_m) - aside * (x + x_m))
        for x, y in points
    ]
    return formation.choose_bearing(Formation(leader="leader"), slot, now_rad, turned, clear_m)


@given(seeds)
def test_bearing_among_all_that_is_remembered_is_that_of_the_points_one_by_one(seed: int) -> None:
    random = np.random.default_rng(seed)
    points_m = random.uniform(-4.0, 4.0, (int(random.integers(12)), 2))
    slot = Slot(float(random.uniform(1.0, 3.0)), float(random.uniform(-1.4, 1.4)))
    now_rad, heading_rad = random.uniform(-1.5, 1.5, 2).tolist()
    origin = tuple(random.uniform(-3.0, 3.0, 2).tolist())
    chosen = formation.choose_bearing_among(
        Formation(leader="leader"), slot, now_rad, points_m, origin, heading_rad, 0.52
    )
    expected = slow_bearing(
        slot, now_rad, [tuple(one) for one in points_m.tolist()], origin, heading_rad, 0.52
    )
    assert chosen == pytest.approx(expected)


def plain(kernel: object) -> Callable[..., int]:
    return getattr(kernel, "py_func", kernel)


@given(seeds)
def test_bearings_are_judged_alike_compiled_and_plain(seed: int) -> None:
    random = np.random.default_rng(seed)
    bearings = random.uniform(-2.0, 2.0, (9, 4))
    bearings[:, 0] = np.sort(np.abs(bearings[:, 0]))
    bearings[:, 1] = np.abs(bearings[:, 1])
    given = (bearings, random.uniform(-4.0, 4.0, (8, 2)), 0.3, -0.2, 0.8, 0.6, 0.7, 2.5, 0.52)
    assert corridor.cheapest(*given) == plain(corridor.cheapest)(*given)


@given(seeds)
def test_forces_of_mirrored_members_are_mirrored(seed: int) -> None:
    random = np.random.default_rng(seed)
    setup = scenes.follower(Slot(2.0, 0.0))
    points_m = random.uniform(-1.0, 1.0, (12, 2))
    away = np.sqrt((points_m**2).sum(axis=1))
    points_m = points_m[away > 0.25]
    direction_rad = float(random.uniform(-pi, pi))
    robots = tuple(random.uniform(-20.0, 20.0, 2).tolist())
    one = pilot.push(setup, direction_rad, 40.0, robots, points_m).resultant
    other = pilot.push(
        setup, -direction_rad, 40.0, (robots[0], -robots[1]), points_m * np.array((1.0, -1.0))
    ).resultant
    assert other == pytest.approx((one[0], -one[1]), abs=1e-6)


def test_nothing_pulls_inwards_in_touch_whoever_pushes() -> None:
    setup = scenes.follower(Slot(2.0, 0.0))
    points_m = np.array([(0.24, 0.0)])
    forces = pilot.push(setup, 0.3, 40.0, (60.0, 5.0), points_m)
    assert forces.resultant[0] < 0.0
    assert geometry.length(*forces.resultant) > 0.0


def test_way_round_is_taken_rather_than_a_slit_that_the_guard_does_not_let_through() -> None:
    setup = scenes.follower(Slot(2.0, 0.0))
    half_m = setup.robot.body_radius_m + setup.guard.strip_margin_m
    for room_m, through in ((0.0, False), (0.1, True)):
        discs = [(2.0, side * (half_m + room_m + 0.3), 0.3) for side in (1.0, -1.0)]
        ranges_m = scenes.scan(discs, scenes.ORIGIN)
        frame = scenes.frame(ranges_m=ranges_m)
        map = scenes.look(setup, ranges_m)
        state = pilot.remember(setup, navigator.State(), frame, map, 0.08)
        state, _ = pilot.to_point(setup, state, frame, map, (4.0, 0.0), held=False, elapsed_s=0.08)
        assert state.way is not None
        aside_mm = np.abs(state.way.path_mm()[:, 1]).max()
        assert (aside_mm < 300) == through


def test_point_without_a_way_is_tried_again_where_it_has_moved_to() -> None:
    setup = scenes.follower(Slot(2.0, 0.0))
    discs = [(3.0 + 0.7 * cos(angle), 0.7 * sin(angle), 0.3) for angle in np.arange(0.0, 6.2, 0.3)]
    state = navigator.State()
    # Round the ring once, so that it is known from all sides.
    for place in [(0.0, 0.0), (3.0, -3.0), (6.0, 0.0), (3.0, 3.0)]:
        pose = Pose(*place, 0.0)
        ranges_m = scenes.scan(discs, pose)
        frame = scenes.frame(pose=pose, ranges_m=ranges_m)
        map = scenes.look(setup, ranges_m)
        state = pilot.remember(setup, state, frame, map, 0.08)
    aims = []
    for point in [(3.0, 0.0)] * 12 + [(0.0, 3.0)]:
        state, aim = pilot.to_point(setup, state, frame, map, point, held=False, elapsed_s=0.08)
        aims.append(aim)
    assert aims[-2].reason == "enclosed"
    assert aims[-1].speed_mps > 0.0
    assert not aims[-1].reason
