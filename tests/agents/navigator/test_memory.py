"""Memory: what is seen stays, what beams pass through goes, the window moves with the robot."""

from __future__ import annotations

from math import inf, pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.navigator import memory
from agents.navigator.law import Law, law
from agents.navigator.memory import Memory
from swarm import geometry
from swarm.geometry import Pose
from swarm.scenario import Navigator
from tests.agents import scenes

RULES = law(Navigator(), 0.22)
NOTHING = np.full(scenes.BEAMS, inf, dtype=np.float32)


def look(rules: Law, known: Memory, pose: Pose, discs: list[scenes.Disc]) -> Memory:
    scan = scenes.scan(discs, pose)
    return memory.observe(rules, known, pose, scan, scan)[0]


def distances(rules: Law, known: Memory) -> np.ndarray:
    """By definition: of every cell to every point."""
    axis = (np.arange(rules.side_cells) - rules.half_cells) * rules.cell_mm
    x, y = np.meshgrid(axis, axis, indexing="ij")
    field = np.full(x.shape, float(rules.reach_mm))
    for px, py in known.points_mm().astype(int):
        field = np.minimum(field, np.floor(np.sqrt((x - px) ** 2.0 + (y - py) ** 2.0)))
    return field


poses = st.builds(Pose, st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(-pi, 3.14))
discs = st.lists(
    st.tuples(st.floats(-4.0, 4.0), st.floats(-4.0, 4.0), st.floats(0.2, 0.8)), max_size=4
)


@given(discs, st.lists(poses, min_size=1, max_size=4))
def test_the_field_is_the_distance_to_the_nearest_point_that_is_kept(
    some: list[scenes.Disc], ways: list[Pose]
) -> None:
    known = memory.empty(RULES, ways[0])
    for pose in ways:
        scan = scenes.scan(some, pose)
        known, field_mm = memory.observe(RULES, known, pose, scan, scan)
        assert (field_mm == distances(RULES, known)).all()


@given(discs, poses)
def test_what_is_seen_is_never_forgotten(some: list[scenes.Disc], pose: Pose) -> None:
    known = memory.empty(RULES, pose)
    for tick in range(20):
        turned = Pose(pose.x_m, pose.y_m, geometry.wrap_angle(pose.yaw_rad + 0.001 * tick))
        before = known.points_mm().tolist()
        known = look(RULES, known, turned, some)
        assert known.points_mm().tolist()[: len(before)] == before
    scan = scenes.scan(some, pose)
    points = known.points_mm() / 1000.0 + np.array(known.origin_mm) / 1000.0
    for angle, range_m in zip(geometry.sector_centres(scenes.BEAMS), scan.tolist(), strict=True):
        if range_m < inf:
            x, y = geometry.unit(angle + pose.yaw_rad)
            away = points - np.array((pose.x_m + range_m * x, pose.y_m + range_m * y))
            assert np.sqrt((away * away).sum(axis=1)).min() < 0.08  # the same cell of 0.05 m


def test_what_beams_pass_through_goes_and_its_distances_with_it() -> None:
    pose, disc = Pose(0.0, 0.0, 0.0), (1.2, 0.3, 0.3)
    known = look(RULES, memory.empty(RULES, pose), pose, [disc, (-1.0, -1.0, 0.3)])
    count = len(known.points_mm())
    for _ in range(12):
        known = look(RULES, known, pose, [(-1.0, -1.0, 0.3)])
    assert 0 < len(known.points_mm()) < count
    assert (known.points_mm()[:, 0] < 0).all()
    assert (known.field_mm(RULES) == distances(RULES, known)).all()
    assert known.grown > 0


def test_hits_of_peers_clear_nothing_behind_them() -> None:
    pose = Pose(0.0, 0.0, 0.0)
    wall = scenes.scan([(1.5, 0.0, 0.3)], pose)
    known, _ = memory.observe(RULES, memory.empty(RULES, pose), pose, wall, wall)
    peer = np.minimum(wall, np.where(wall < inf, np.float32(0.6), np.float32(inf)))
    for _ in range(20):  # the peer stands before it, and is no obstacle
        known, _ = memory.observe(RULES, known, pose, peer, NOTHING)
    assert len(known.points_mm()) > 10


@pytest.mark.parametrize("to", [(6.3, -0.4), (-7.0, 7.0), (10.9, 0.2)])
def test_the_window_moves_and_keeps_what_it_still_holds(to: tuple[float, float]) -> None:
    discs = [(1.5, 0.4, 0.4), (-1.5, -1.0, 0.3)]
    here = Pose(0.0, 0.0, 0.0)
    known = look(RULES, memory.empty(RULES, here), here, discs)
    moved = memory.shifted(RULES, known, Pose(*to, 0.0))
    assert moved.origin_mm == (round(10 * to[0]) * 100, round(10 * to[1]) * 100)
    old = known.points_mm() + np.array(known.origin_mm)
    new = moved.points_mm() + np.array(moved.origin_mm)
    half_mm = RULES.half_cells * RULES.cell_mm
    kept = (abs(old - np.array(moved.origin_mm)) <= half_mm).all(axis=1)
    assert old[kept].tolist() == new.tolist()
    inside = distances(RULES, moved)[20:-20, 20:-20]
    assert (moved.field_mm(RULES)[20:-20, 20:-20] == inside).all()


def test_far_away_nothing_is_left_of_the_window() -> None:
    known = look(RULES, memory.empty(RULES, Pose(0, 0, 0)), Pose(0.0, 0.0, 0.0), [(1, 0, 0.3)])
    assert len(memory.shifted(RULES, known, Pose(500.0, 0.0, 0.0)).points_mm()) == 0


@given(discs, poses)
def test_mirrored_scenes_are_remembered_mirrored(some: list[scenes.Disc], pose: Pose) -> None:
    scan = scenes.scan(some, pose)
    other = Pose(pose.x_m, -pose.y_m, -pose.yaw_rad)
    one, _ = memory.observe(RULES, memory.empty(RULES, pose), pose, scan, scan)
    two, _ = memory.observe(RULES, memory.empty(RULES, other), other, scan[::-1].copy(), scan[::-1])
    assert two.origin_mm == (one.origin_mm[0], -one.origin_mm[1])
    assert sorted((x, -y) for x, y in two.points_mm().tolist()) == sorted(
        (x, y) for x, y in one.points_mm().tolist()
    )


def test_a_state_costs_what_the_docstring_says() -> None:
    pose = Pose(0.0, 0.0, 0.0)
    known = look(RULES, memory.empty(RULES, pose), pose, [(1.0, 0.0, 0.3)])
    assert known.field.nbytes == 2 * 221 * 221
    assert len(known.points) + len(known.misses) == 5 * len(known.points_mm())
