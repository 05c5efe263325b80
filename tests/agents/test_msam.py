"""The map against slow second implementations and by hand."""

from __future__ import annotations

from math import ceil, cos, floor, inf, isclose, pi, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents import msam
from swarm.geometry import Pose, Twist, sector_centres, wrap_angle
from swarm.scenario import Msam
from tests.agents import scenes

SECTOR_RAD = pi / 36.0
seeds = st.integers(0, 2**32 - 1)


def clutter(seed: int) -> list[float]:
    """72 sectors, some free, in ring steps."""
    random = np.random.default_rng(seed)
    rings = np.floor(random.uniform(0.0, 120.0, 72))
    smooth = np.minimum(rings, np.roll(rings, 1))
    return [ring * 0.05 if ring < 60.0 else inf for ring in smooth.tolist()]


def test_sector_ranges_are_inner_ring_edges_of_the_nearest_beam() -> None:
    ranges_m = scenes.nothing()
    ranges_m[3:6] = (1.37, 0.99, 4.0)  # sector 1
    ranges_m[215] = 0.04
    sectors_m = msam.sector_ranges(ranges_m, 72, 0.05)
    assert sectors_m[1] == floor(0.99 / 0.05) * 0.05
    assert sectors_m[71] == 0.0
    assert sectors_m[0] == sectors_m[2] == inf


def test_linked_runs_break_where_neighbours_are_far_apart() -> None:
    sectors_m = [inf] * 72
    sectors_m[10:14] = [1.0, 1.0, 2.0, 2.0]  # 1 to 2 m: a gap of more than 0.8
    assert msam.linked_runs(sectors_m, 3.0, 0.8) == [range(10, 12), range(12, 14)]
    assert msam.linked_runs(sectors_m, 3.0, 1.2) == [range(10, 14)]


def test_linked_runs_go_on_across_the_back() -> None:
    sectors_m = [inf] * 72
    sectors_m[0] = sectors_m[1] = sectors_m[71] = 1.0
    assert msam.linked_runs(sectors_m, 3.0, 0.8) == [range(71, 74)]


def test_linked_runs_of_a_closed_ring_are_one() -> None:
    assert msam.linked_runs([1.0] * 72, 3.0, 0.8) == [range(72)]


@given(seeds)
def test_linked_runs_hold_every_cell_once_and_are_maximal(seed: int) -> None:
    sectors_m = clutter(seed)
    runs = msam.linked_runs(sectors_m, 3.0, 0.8)
    cells = [index % 72 for run in runs for index in run]
    assert sorted(cells) == [i for i in range(72) if sectors_m[i] < 3.0]

    def linked(i: int) -> bool:
        a_m, b_m = sectors_m[i % 72], sectors_m[(i + 1) % 72]
        if not (a_m < 3.0 and b_m < 3.0):
            return False
        x_m = a_m - b_m * cos(SECTOR_RAD)
        y_m = b_m * sin(SECTOR_RAD)
        return bool(np.hypot(x_m, y_m) < 0.8)

    for run in runs:
        assert all(linked(i) for i in run[:-1])
        assert len(run) == 72 or not linked(run[-1])


def test_split_cuts_at_sixty_degrees_and_keeps_the_weight_of_the_width() -> None:
    sectors_m = [inf] * 72
    sectors_m[20:44] = [2.0 - 0.05 * i for i in range(24)]  # 120 degrees
    seen = scenes.alone()
    whole = msam._arc(sectors_m, range(20, 44), 0, 1, 1.0)
    left, right = msam.split(sectors_m, range(20, 44), seen.msam.split_rad, whole)
    assert left.width_rad == pytest.approx(pi / 3.0)
    assert (left.range_m, right.range_m) == (min(sectors_m[20:32]), min(sectors_m[32:44]))
    assert left.weight == right.weight == pytest.approx(1.0)
    assert left.bearing_rad == pytest.approx(sector_centres(72)[20] + 5.5 * SECTOR_RAD)


@given(seeds)
def test_arcs_are_narrow_and_weigh_as_much_as_their_cluster_is_wide(seed: int) -> None:
    sectors_m = clutter(seed)
    for run in msam.linked_runs(sectors_m, 3.0, 0.8):
        whole = msam._arc(sectors_m, run, 0, 1, 1.0)
        arcs = msam.split(sectors_m, run, pi / 3.0, whole)
        assert all(arc.width_rad <= pi / 3.0 + 1e-9 for arc in arcs)
        assert len(arcs) == ceil(len(run) / 12)
        assert sum(arc.weight for arc in arcs) == pytest.approx(max(1.0, len(run) / 12))
        assert min(arc.range_m for arc in arcs) == whole.range_m
        middle_rad = sector_centres(72)[0] + (run.start + (len(run) - 1) / 2.0) * SECTOR_RAD
        assert abs(wrap_angle(whole.bearing_rad - middle_rad)) < 1e-9


@given(seeds)
def test_map_of_a_mirrored_scan_is_the_mirrored_map(seed: int) -> None:
    setup = scenes.alone()
    ranges_m = np.repeat(np.array(clutter(seed)), 3).astype(np.float32) + np.float32(0.01)
    map = scenes.look(setup, ranges_m)
    mirrored = scenes.look(setup, ranges_m[::-1].copy())
    assert mirrored.sectors_m == map.sectors_m[::-1]

    def rows(map: msam.Map, side: float) -> list[tuple[float, ...]]:
        # the back of the robot is -pi in both worlds
        return sorted(
            (round(wrap_angle(side * arc.bearing_rad + pi), 9), arc.range_m, round(arc.weight, 9))
            for arc in map.arcs
        )

    assert rows(mirrored, 1.0) == rows(map, -1.0)


def test_circle_distance_stays_outside_up_to_120_degrees() -> None:
    assert msam.circle_distance(2.0, pi / 3.0) == pytest.approx(2.0 * 3.0**0.5)
    # At 120 degrees the circle's surface is at the robot itself: r_o (2 cos 60 - 1) = 0.
    assert msam.circle_distance(1.0, 2.0 * pi / 3.0) > 1.0
    assert msam.circle_distance(1.0, 2.0 * pi) == msam.circle_distance(1.0, 2.0 * pi / 3.0)
    wide = scenes.look(scenes.alone(), scenes.scan([(1.2, 0.0, 1.1)], scenes.ORIGIN))
    assert wide.clusters[0].width_rad > 2.0 * pi / 3.0
    for arc in wide.arcs:
        assert arc.range_m * (2.0 * cos(arc.width_rad / 2.0) - 1.0) > 0.0


@pytest.mark.parametrize("missed", [0, 2])
def test_peer_beams_are_those_that_end_on_its_body(missed: int) -> None:
    pose = Pose(0.3, -0.2, 0.7)
    others = [(1.5, 0.4, 0.22), (-0.4, -0.5, 0.22), (0.3, 1.1, 0.22)]
    obstacle = (2.4, 0.2, 0.6)
    ranges_m = scenes.scan([*others, obstacle], pose)
    heard = [
        scenes.peer(
            scenes.beacon("robot2", Pose(x_m, y_m, 0.0), tick=4 - missed), pose=pose, tick=5
        )
        for x_m, y_m, _ in others[:2]
    ]
    hidden = msam.peer_beams(Msam(), msam.layout(scenes.BEAMS, 72), ranges_m.tolist(), heard)
    expected = []
    for beam, angle_rad in enumerate(sector_centres(scenes.BEAMS)):
        range_m = float(ranges_m[beam])
        if range_m < inf:
            x_m = pose.x_m + range_m * cos(angle_rad + pose.yaw_rad)
            y_m = pose.y_m + range_m * sin(angle_rad + pose.yaw_rad)
            if any(
                np.hypot(x_m - other[0], y_m - other[1]) <= 0.22 + 0.05 + 0.06 * missed
                for other in others[:2]
            ):
                expected.append(beam)
    assert sorted(hidden) == expected
    assert len(expected) > 10


def test_map_hides_a_peer_that_moved_since_its_beacon() -> None:
    setup = scenes.alone()
    twist = Twist(1.0, 0.0)
    heard = scenes.peer(scenes.beacon("robot2", Pose(1.0, 0.0, 0.0), twist, tick=4), tick=5)
    ranges_m = scenes.scan([(1.08, 0.0, 0.22)], scenes.ORIGIN)
    assert scenes.look(setup, ranges_m).arcs
    assert not scenes.look(setup, ranges_m, [heard]).arcs


def test_map_sees_a_body_that_no_beacon_explains() -> None:
    heard = scenes.peer(scenes.beacon("robot2", Pose(1.0, 0.6, 0.0)))
    map = scenes.look(scenes.alone(), scenes.scan([(1.0, 0.0, 0.22)], scenes.ORIGIN), [heard])
    assert map.nearest_m == pytest.approx(0.75)


def test_cell_points_lie_on_the_surface_that_was_seen() -> None:
    setup = scenes.alone()
    pose = Pose(1.0, 2.0, 0.9)
    map = scenes.look(setup, scenes.scan([(3.0, 2.5, 0.5)], pose))
    points = msam.cell_points(map, 0.05, 4.9, (pose.x_m, pose.y_m), pose.yaw_rad)
    assert len(points) == sum(range_m < inf for range_m in map.sectors_m)
    # Half a sector to the side and a ring in range are the map's resolution.
    assert all(isclose(np.hypot(x - 3.0, y - 2.5), 0.5, abs_tol=0.12) for x, y in points)
