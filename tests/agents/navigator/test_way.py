"""Ways: cheapest, never where there is no room, mirrored for mirrored robots, over many ticks."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.navigator import memory, points, search, way
from agents.navigator.law import FREE, law
from agents.navigator.memory import Memory
from agents.navigator.points import Field
from agents.navigator.way import Way
from swarm.geometry import Pose, Vec2
from swarm.scenario import Navigator

RULES = law(Navigator(window_m=8.0), 0.22)
START = Pose(-3.0, 0.0, 0.0)
GOAL = (3.0, 0.0)
Disc = tuple[float, float, float]


def known(points_m: list[Vec2], version: int = 1) -> tuple[Memory, Field]:
    """Memory of some points, around the origin."""
    blank = memory.empty(RULES, Pose(0.0, 0.0, 0.0))
    mm = np.array([(round(1000 * x), round(1000 * y)) for x, y in points_m], dtype=np.int16)
    mm = mm.reshape(-1, 2)
    field = blank.field_mm(RULES).copy()
    points.stamp(field, mm, 0, len(mm), RULES.cell_mm, RULES.reach_mm)
    return Memory(
        blank.origin_mm,
        memory.shared(field),
        mm.tobytes(),
        bytes(len(mm)),
        version=version,
    ), field


def walls(*rows: tuple[float, float, float, float]) -> list[Vec2]:
    """Points every 4 cm along some lines."""
    found = []
    for x0, y0, x1, y1 in rows:
        count = round(max(abs(x1 - x0), abs(y1 - y0)) / 0.04)
        found += [
            (x0 + (x1 - x0) * i / count, y0 + (y1 - y0) * i / count) for i in range(count + 1)
        ]
    return found


def plan(points_m: list[Vec2], start: Pose = START, goal: Vec2 = GOAL) -> Way:
    remembered, field = known(points_m)
    found = None
    for _ in range(100):
        found = way.step(RULES, found, remembered, field, start, goal, 0.1)
        if found.path or found.closed:
            return found
    raise AssertionError("a search without end")


clouds = st.lists(
    st.tuples(
        st.floats(-2.4, 2.4).map(lambda x: round(x, 2)),
        st.floats(-2.0, 2.0).map(lambda y: round(y, 2)),
    ),
    max_size=40,
)


@given(clouds)
def test_a_way_never_crosses_cells_without_room(some: list[Vec2]) -> None:
    found = plan(some)
    assert found.path
    _, field = known(some)
    for x_mm, y_mm in found.path_mm()[search.NEAR_CELLS + 1 :].tolist():
        cell = round(x_mm / 100) + RULES.half_cells, round(y_mm / 100) + RULES.half_cells
        assert field[cell] - RULES.radius_mm >= min(found.hard_mm, RULES.hard_mm)
        assert RULES.straight[int(field[cell])] >= 0


@given(clouds)
def test_a_way_costs_what_dijkstra_finds(some: list[Vec2]) -> None:
    """Oracle: sweeps over the whole field until nothing becomes cheaper."""
    found = plan(some)
    _, field = known(some)
    side, half = RULES.side_cells, RULES.half_cells
    start_i = half - 30
    straight = RULES.straight[field.astype(int)].astype(float)
    diagonal = RULES.diagonal[field.astype(int)].astype(float)
    straight[straight < 0], diagonal[diagonal < 0] = np.inf, np.inf
    near = slice(start_i - 3, start_i + 4), slice(half - 3, half + 4)
    straight[near] = np.minimum(straight[near], RULES.near_straight)
    diagonal[near] = np.minimum(diagonal[near], RULES.near_diagonal)
    costs = np.full((side, side), np.inf)
    costs[half + 30, half] = 0.0
    while True:
        before = costs.copy()
        padded = np.pad(costs, 1, constant_values=np.inf)
        for i in (-1, 0, 1):
            for j in (-1, 0, 1):
                if (i, j) != (0, 0):
                    step = straight if i == 0 or j == 0 else diagonal
                    beside = padded[1 + i : 1 + i + side, 1 + j : 1 + j + side]
                    costs = np.minimum(costs, beside + step)
        if (costs == before).all():
            break
    assert int(found.planned()[0]) == costs[start_i, half]


@given(clouds)
def test_mirrored_ways_mirror_each_other(some: list[Vec2]) -> None:
    some = [*some, (0.5, 0.13)]  # else scene and mirror image may be the same
    start, goal = Pose(-3.0, 0.17, 0.0), (3.0, -0.08)
    one = plan(some, start, goal)
    two = plan([(x, -y) for x, y in some], Pose(-3.0, -0.17, 0.0), (3.0, 0.08))
    assert [[x, -y] for x, y in one.path_mm().tolist()] == two.path_mm().tolist()


def test_of_two_ways_that_mirror_each_other_the_right_one_is_taken() -> None:
    path = plan(walls((0.0, -1.0, 0.0, 1.0))).path_mm()
    assert path[:, 1].min() < -1000
    assert path[:, 1].max() <= 0
    back = plan(walls((0.0, -1.0, 0.0, 1.0)), Pose(3.0, 0.0, 0.0), (-3.0, 0.0)).path_mm()
    assert back[:, 1].max() > 1000


def test_a_way_through_a_slit_is_the_last_resort() -> None:
    narrow = walls((0.0, -3.9, 0.0, -0.225), (0.0, 0.225, 0.0, 3.9))
    open_ = walls((0.0, -2.0, 0.0, -0.225), (0.0, 0.225, 0.0, 2.0))
    assert abs(plan(narrow).path_mm()[:, 1]).max() < 300
    assert abs(plan(open_).path_mm()[:, 1]).max() > 2000


def test_there_is_no_way_out_of_a_box_and_none_into_it() -> None:
    box = walls((-1, -1, 1, -1), (1, -1, 1, 1), (1, 1, -1, 1), (-1, 1, -1, -1))
    assert plan(box, Pose(0.0, 0.0, 0.0), (3.0, 0.0)).closed
    assert plan(box, Pose(-3.0, 0.0, 0.0), (0.0, 0.0)).closed


def test_a_goal_in_an_obstacle_has_a_way_only_to_what_is_near_enough() -> None:
    remembered, field = known([(3.0, 0.0)])
    assert way.step(RULES, None, remembered, field, START, GOAL, 0.1).closed
    found = way.step(RULES, None, remembered, field, START, GOAL, 0.5)
    x_mm, y_mm = found.path_mm()[-1].tolist()
    assert 200 < ((x_mm - 3000) ** 2 + y_mm**2) ** 0.5 <= 500


def test_a_long_search_goes_on_in_the_next_ticks_and_finds_the_same() -> None:
    rules = law(Navigator(), 0.22)
    scene = walls((0.0, -9.0, 0.0, 9.0), (0.0, 9.0, -6.0, 9.0), (0.0, -9.0, -6.0, -9.0))
    blank = memory.empty(rules, Pose(0, 0, 0))
    mm = np.array([(round(1000 * x), round(1000 * y)) for x, y in scene], dtype=np.int16)
    field = blank.field_mm(rules).copy()
    points.stamp(field, mm, 0, len(mm), rules.cell_mm, rules.reach_mm)
    remembered = Memory(blank.origin_mm, memory.shared(field), mm.tobytes(), bytes(len(mm)))
    found: Way | None = None
    ticks = 0
    while found is None or not found.path:
        found = way.step(rules, found, remembered, field, START, GOAL, 0.1)
        ticks += 1
    assert ticks > 2
    most, way.EXPANSIONS_MAX = way.EXPANSIONS_MAX, 10**6
    try:
        at_once = way.step(rules, None, remembered, field, START, GOAL, 0.1)
    finally:
        way.EXPANSIONS_MAX = most
    assert at_once.path == found.path


def test_a_way_is_kept_until_it_becomes_dearer() -> None:
    remembered, field = known([])
    found = way.step(RULES, None, remembered, field, START, GOAL, 0.1)
    aside, aside_field = known([(0.0, 1.5)], 2)
    kept = way.step(RULES, found, aside, aside_field, START, GOAL, 0.1)
    assert kept.path == found.path
    ahead, ahead_field = known([(0.0, 0.05)], 3)
    assert way.step(RULES, kept, ahead, ahead_field, START, GOAL, 0.1).path != found.path


def test_the_sub_goal_cuts_corners_but_not_through_walls() -> None:
    remembered, field = known(walls((0.0, -1.0, 0.0, 1.0)))
    found = way.step(RULES, None, remembered, field, START, GOAL, 0.1)
    open_field = known([])[1]
    far, index = way.subgoal(RULES, found, remembered, open_field, START, 3.0, 1.03)
    assert index > 20
    near, index = way.subgoal(RULES, found, remembered, field, Pose(-0.5, 0.0, 0.0), 3.0, 1.03)
    assert near[0] < 0.0  # before the wall, which it has to go round
    assert far[0] > -1.0


def test_progress_goes_on_along_the_way() -> None:
    remembered, field = known([])
    found = way.step(RULES, None, remembered, field, START, GOAL, 0.1)
    for x_m in (-2.5, -1.0, 0.4):
        found = way.step(RULES, found, remembered, field, Pose(x_m, 0.1, 0.0), GOAL, 0.1)
        assert found.path_mm()[found.index].tolist() == [round(1000 * x_m), 0]
    assert int(found.planned()[0]) == 60 * FREE


def test_a_way_to_a_goal_far_away_leads_straight_to_the_border() -> None:
    found = plan([], START, (500.0, 200.0))
    x_mm, y_mm = found.path_mm()[-1].tolist()
    assert x_mm == 4000
    assert y_mm == 2800  # straight on


def test_cells_grow_with_large_bodies_so_that_points_cost_no_more() -> None:
    rules = law(Navigator(), 3.0)
    assert rules.cell_mm == 500
    assert rules.reach_mm / rules.cell_mm < 9


def test_a_window_has_no_more_cells_than_a_tick_can_bear() -> None:
    with pytest.raises(ValueError, match="at most 500 cells"):
        Navigator(window_m=22.0, cell_m=0.03)
