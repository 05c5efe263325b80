"""The lidar against sphere tracing in plain Python, by hand, and in the mirror."""

from __future__ import annotations

import itertools
from math import cos, inf, pi, sin, sqrt

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from swarm.geometry import Pose, Ranges, sector_centres, wrap_angle
from swarm.scenario import Obstacle
from world import raycast, scene

RANGE_M = 5.0
Circle = tuple[float, float, float]
Corners = tuple[tuple[float, float], ...]

coordinates = st.floats(-6.0, 6.0)
circles = st.tuples(coordinates, coordinates, st.floats(0.05, 3.0))
triangles = st.tuples(*[st.tuples(coordinates, coordinates)] * 3).filter(
    # Scenarios refuse corners that coincide; edges without length have no direction.
    lambda corners: all(
        abs(a[0] - b[0]) + abs(a[1] - b[1]) > 1e-3 for a, b in itertools.combinations(corners, 2)
    )
)
yaws = st.floats(-pi, pi, exclude_max=True)


def cast(
    obstacles: tuple[Obstacle, ...],
    poses: list[Pose],
    *,
    beams: int = 16,
    radius_m: float = 0.2,
    rows: list[int] | None = None,
) -> Ranges:
    radii_m = np.full(len(poses), radius_m)
    sensor = raycast.lidar(beams, RANGE_M, scene.build(obstacles), radii_m)
    return raycast.cast(sensor, poses, range(len(poses)) if rows is None else rows)


def segment_m(point: tuple[float, float], a: tuple[float, float], b: tuple[float, float]) -> float:
    """Distance from a point to a segment."""
    square = (b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2
    along = (point[0] - a[0]) * (b[0] - a[0]) + (point[1] - a[1]) * (b[1] - a[1])
    share = min(1.0, max(0.0, along / square)) if square > 0.0 else 0.0
    x, y = a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])
    return sqrt((point[0] - x) ** 2 + (point[1] - y) ** 2)


def traced_m(
    discs: list[Circle], outlines: list[Corners], origin: Pose, angle_rad: float, thicker_m: float
) -> float:
    """Range by sphere tracing, all things thicker (or thinner) than they are by a little."""
    along_m = 0.0
    while along_m <= RANGE_M + 0.01:
        x_m, y_m = origin.x_m + along_m * cos(angle_rad), origin.y_m + along_m * sin(angle_rad)
        gaps_m = [sqrt((x_m - x) ** 2 + (y_m - y) ** 2) - r for x, y, r in discs]
        gaps_m += [
            segment_m((x_m, y_m), a, b)
            for corners in outlines
            for a, b in zip(corners, corners[1:] + corners[:1], strict=True)
        ]
        gap_m = min(gaps_m, default=inf) - thicker_m
        if gap_m <= 0.0:
            return along_m
        along_m += max(gap_m, 1e-5)
    return inf


@given(st.lists(circles, max_size=4), st.lists(circles, max_size=3), yaws)
def test_cast_agrees_with_sphere_tracing_among_circles_and_bodies(
    discs: list[Circle], others: list[Circle], yaw_rad: float
) -> None:
    bodies = [(x_m, y_m, 0.2) for x_m, y_m, _ in others]
    assume(all(sqrt(x * x + y * y) > r + 0.2 for x, y, r in discs + bodies))
    own = Pose(0.0, 0.0, yaw_rad)
    poses = [own, *(Pose(x_m, y_m, 0.0) for x_m, y_m, _ in bodies)]
    ranges_m = cast(tuple(Obstacle(circle=disc) for disc in discs), poses, rows=[0])[0]
    for angle_rad, range_m in zip(sector_centres(16), ranges_m.tolist(), strict=True):
        world_rad = yaw_rad + angle_rad
        assert range_m <= traced_m(discs + bodies, [], own, world_rad, -1e-4) + 1e-4
        thick_m = traced_m(discs + bodies, [], own, world_rad, 1e-4)
        assert range_m >= thick_m - 1e-4 or thick_m > RANGE_M


@settings(suppress_health_check=[HealthCheck.filter_too_much])
@given(st.lists(triangles, min_size=1, max_size=3), yaws)
def test_cast_agrees_with_sphere_tracing_among_polygons(
    outlines: list[Corners], yaw_rad: float
) -> None:
    obstacles = tuple(Obstacle(polygon=corners) for corners in outlines)
    standing = scene.build(obstacles)
    edges_m = np.abs(standing.edges[:, :2] - standing.edges[:, 2:]).max(axis=1)
    assume(edges_m.min() > 1e-3)
    assume(scene.clearance(standing, np.zeros((1, 2)))[0] > 0.2)
    own = Pose(0.0, 0.0, yaw_rad)
    ranges_m = cast(obstacles, [own])[0]
    sides = [(corners[i], corners[i - 1]) for corners in outlines for i in range(len(corners))]
    for angle_rad, range_m in zip(sector_centres(16), ranges_m.tolist(), strict=True):
        world_rad = yaw_rad + angle_rad
        thick_m = traced_m([], outlines, own, world_rad, 1e-4)
        assert range_m >= thick_m - 1e-4 or thick_m > RANGE_M
        for a, b in sides:  # no beam slips through a side
            assert range_m <= crossed_m(a, b, world_rad) + 1e-5
        if range_m < RANGE_M:  # what was hit is there
            hit = (range_m * cos(world_rad), range_m * sin(world_rad))
            assert min(segment_m(hit, a, b) for a, b in sides) < 1e-5


def crossed_m(a: tuple[float, float], b: tuple[float, float], angle_rad: float) -> float:
    """Range at which a ray from the origin clearly crosses a segment, else inf: Cramer's rule."""
    forward, left = cos(angle_rad), sin(angle_rad)
    to_x, to_y = b[0] - a[0], b[1] - a[1]
    determinant = to_x * left - to_y * forward
    if abs(determinant) < 1e-9:
        return inf
    range_m = (to_x * a[1] - to_y * a[0]) / determinant
    share = (forward * a[1] - left * a[0]) / determinant
    inside = 1e-6 < share < 1.0 - 1e-6 and 0.0 < range_m < RANGE_M - 1e-6
    return range_m if inside else inf


@given(yaws)
def test_cast_lets_no_beam_out_when_a_polygon_surrounds_the_robot(yaw_rad: float) -> None:
    box = Obstacle(polygon=((-1.0, -2.0), (3.0, -2.0), (3.0, 1.0), (-1.0, 1.0)))
    ranges_m = cast((box,), [Pose(0.0, 0.0, yaw_rad)], beams=64)[0]
    for angle_rad, range_m in zip(sector_centres(64), ranges_m.tolist(), strict=True):
        forward, left = cos(yaw_rad + angle_rad), sin(yaw_rad + angle_rad)
        walls_m = [
            wall / part
            for wall, part in ((3.0, forward), (-1.0, forward), (1.0, left), (-2.0, left))
            if wall * part > 0.0
        ]
        assert range_m == pytest.approx(min(walls_m), abs=1e-6)


def test_cast_measures_by_hand_when_a_circle_is_straight_ahead() -> None:
    # 17 beams: number 8 looks straight ahead. Nearest surface 3 - 1 m; at 5 m nothing is left.
    near = cast((Obstacle(circle=(3.0, 0.0, 1.0)),), [Pose(0.0, 0.0, 0.0)], beams=17)[0]
    assert near[8] == 2.0
    assert near[7] == near[9] == inf  # 21 degrees off, the circle spans 19.5 either side
    assert np.isinf(cast((Obstacle(circle=(6.1, 0.0, 1.0)),), [Pose(0.0, 0.0, 0.0)])).all()
    edge = cast((Obstacle(circle=(6.0, 0.0, 1.0)),), [Pose(0.0, 0.0, 0.0)], beams=17)[0]
    assert edge[8] == 5.0


def test_cast_sees_the_other_body_but_never_its_own() -> None:
    poses = [Pose(0.0, 0.0, 0.0), Pose(2.0, 0.0, -pi)]
    ranges_m = cast((), poses, beams=17)
    assert ranges_m.dtype == np.float32
    assert ranges_m[0, 8] == ranges_m[1, 8] == np.float32(1.8)
    assert np.isfinite(ranges_m).sum() == 2


def test_cast_is_hidden_by_what_stands_in_front() -> None:
    hidden = (Obstacle(circle=(4.0, 0.0, 0.5)), Obstacle(circle=(2.0, 0.0, 0.5)))
    assert cast(hidden, [Pose(0.0, 0.0, 0.0)], beams=17)[0, 8] == 1.5
    wall = Obstacle(polygon=((1.0, -1.0), (1.2, -1.0), (1.2, 1.0), (1.0, 1.0)))
    assert cast((*hidden, wall), [Pose(0.0, 0.0, 0.0)], beams=17)[0, 8] == 1.0


def test_cast_turns_with_the_body() -> None:
    # 16 beams: number 12 looks to (12 - 7.5) * 22.5 = 101.25 degrees, world 90 for this yaw.
    yaw_rad = pi / 2.0 - 101.25 * pi / 180.0
    ranges_m = cast((Obstacle(circle=(0.0, 3.0, 1.0)),), [Pose(0.0, 0.0, yaw_rad)])[0]
    assert ranges_m[12] == pytest.approx(2.0)


def test_cast_asks_only_the_lidars_of_the_rows_given() -> None:
    poses = [Pose(0.0, 0.0, 0.0), Pose(2.0, 0.0, 0.0), Pose(0.0, 2.0, 1.0)]
    every = cast((), poses)
    assert (cast((), poses, rows=[2, 0]) == every[[2, 0]]).all()
    assert cast((), poses, rows=[]).shape == (0, 16)


@settings(suppress_health_check=[HealthCheck.filter_too_much])
@given(
    st.lists(circles, max_size=4),
    st.lists(triangles, max_size=2),
    st.lists(st.tuples(coordinates, coordinates, yaws), min_size=1, max_size=3),
)
def test_cast_mirrors_bit_for_bit_when_the_scene_does(
    discs: list[Circle], outlines: list[Corners], places: list[tuple[float, float, float]]
) -> None:
    def scans(sign: float) -> Ranges:
        obstacles = [Obstacle(circle=(x, sign * y, r)) for x, y, r in discs]
        obstacles += [
            Obstacle(polygon=tuple((x, sign * y) for x, y in corners)) for corners in outlines
        ]
        poses = [Pose(x, sign * y, wrap_angle(sign * yaw)) for x, y, yaw in places]
        return cast(tuple(obstacles), poses, beams=36, radius_m=0.01)

    assume(all(abs(yaw_rad) < pi for _, _, yaw_rad in places))  # -pi has no mirror image
    points_m = np.array([place[:2] for place in places])
    standing = scene.build(
        (
            *(Obstacle(circle=disc) for disc in discs),
            *(Obstacle(polygon=corners) for corners in outlines),
        )
    )
    assume(scene.clearance(standing, points_m).min() > 0.01)  # on a corner anything may be hit
    apart = {(x, y) for x, y, _ in places}
    assume(len(apart) == len(places))
    gaps = [abs(a[0] - b[0]) + abs(a[1] - b[1]) for a in apart for b in apart if a != b]
    assume(min(gaps, default=1.0) > 0.05)
    assert np.array_equal(scans(1.0), scans(-1.0)[:, ::-1])


def test_cast_mirrors_bit_for_bit_at_the_start_of_two_obstacles() -> None:
    obstacles = (Obstacle(circle=(7.0, 2.5, 1.5)), Obstacle(circle=(7.0, -2.5, 1.5)))
    starts = [(3.0, 0.0), (2.0, 1.0), (2.0, -1.0), (1.0, 2.0), (1.0, 0.0), (1.0, -2.0)]
    scans = cast(obstacles, [Pose(x, y, 0.0) for x, y in starts], beams=216, radius_m=0.22)
    assert np.isfinite(scans).any(axis=1).all()
    for one, other in [(0, 0), (1, 2), (3, 5), (4, 4)]:
        assert np.array_equal(scans[one], scans[other, ::-1])
