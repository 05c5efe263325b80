"""Forces against finite differences of their potentials, and the goals near obstacles."""

from __future__ import annotations

from collections.abc import Callable
from math import atan2, cos, hypot, log, pi, sin

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents import field, msam, seek
from swarm.geometry import Pose, Vec2
from swarm.messages import Arc
from swarm.scenario import Field
from tests.agents import scenes

FIELD = Field()
STEP_M = 1e-6
angles = st.floats(-3.1, 3.1)


def slope(potential: Callable[[float, float], float], x_m: float, y_m: float) -> Vec2:
    """Negative gradient by central differences."""
    return (
        -(potential(x_m + STEP_M, y_m) - potential(x_m - STEP_M, y_m)) / (2.0 * STEP_M),
        -(potential(x_m, y_m + STEP_M) - potential(x_m, y_m - STEP_M)) / (2.0 * STEP_M),
    )


@given(angles, st.floats(0.1, 20.0))
def test_attractive_is_the_slope_of_eq_23(angle_rad: float, distance_m: float) -> None:
    goal = (distance_m * cos(angle_rad), distance_m * sin(angle_rad))

    def potential(x_m: float, y_m: float) -> float:
        return 0.5 * FIELD.k_g * ((x_m - goal[0]) ** 2 + (y_m - goal[1]) ** 2)

    force = field.attractive(FIELD, angle_rad, distance_m)
    assert force == pytest.approx(slope(potential, 0.0, 0.0), abs=1e-5)


@given(angles, angles, st.floats(0.3, 2.9))
def test_repulsive_is_the_slope_of_eq_26(bearing: float, yaw: float, range_m: float) -> None:
    surface = (range_m * cos(bearing + yaw), range_m * sin(bearing + yaw))

    def potential(x_m: float, y_m: float) -> float:
        f_m = hypot(x_m - surface[0], y_m - surface[1])
        return 0.5 * FIELD.k_r * (1.0 / f_m - 1.0 / FIELD.rho_m) ** 2

    force = field.repulsive(FIELD, [Arc(bearing, range_m, 0.3, 1.0)], yaw, 10.0)
    assert force == pytest.approx(slope(potential, 0.0, 0.0), rel=1e-4, abs=1e-3)


@given(angles, st.floats(0.56, 0.99))
def test_between_robots_is_the_slope_of_eq_36(angle_rad: float, distance_m: float) -> None:
    other = (distance_m * cos(angle_rad), distance_m * sin(angle_rad))

    def potential(x_m: float, y_m: float) -> float:
        # k_ij (ln 1/(q - r) + (q - r)/(r_ij - r)): the constant left out
        gap_m = hypot(x_m - other[0], y_m - other[1]) - FIELD.safe_distance_m
        reach_m = FIELD.robot_reach_m - FIELD.safe_distance_m
        return FIELD.k_ij * (-log(gap_m) + gap_m / reach_m)

    heard = scenes.peer(scenes.beacon("robot2", Pose(*other, 0.0)))
    force = field.between_robots(scenes.alone(), [heard])
    assert force == pytest.approx(slope(potential, 0.0, 0.0), rel=1e-4, abs=1e-3)


@pytest.mark.parametrize("distance_m", [0.1, 0.44, 0.5, 0.55, 0.9])
def test_between_robots_never_attracts_within_reach(distance_m: float) -> None:
    heard = scenes.peer(scenes.beacon("robot2", Pose(distance_m, 0.0, 0.0)))
    x, y = field.between_robots(scenes.alone(), [heard])
    assert x < 0.0
    assert y == 0.0


def test_between_robots_is_zero_beyond_reach() -> None:
    heard = scenes.peer(scenes.beacon("robot2", Pose(1.01, 0.0, 0.0)))
    assert field.between_robots(scenes.alone(), [heard]) == (0.0, 0.0)


@pytest.mark.parametrize(("radius_m", "safe_m"), [(0.15, 0.5), (0.22, 0.5), (0.4, 0.68)])
def test_between_robots_keeps_further_from_a_large_peer(radius_m: float, safe_m: float) -> None:
    def push(distance_m: float) -> float:
        other = scenes.beacon("robot2", Pose(distance_m, 0.0, 0.0), body_radius_m=radius_m)
        return field.between_robots(scenes.alone(), [scenes.peer(other)])[0]

    assert push(safe_m + 0.25) == pytest.approx(-5.0 * (4.0 - 2.0))
    assert push(safe_m + 0.51) == 0.0


def test_rotating_pushes_to_the_goals_side_and_right_when_in_line() -> None:
    field_1 = Field(k_e=1.0)
    circle_m = msam.circle_distance(1.0, 0.5)
    for goal_rad, side in ((0.3, 1.0), (-0.3, -1.0), (0.0, -1.0)):
        x, y = field.rotating(field_1, [Arc(0.0, 1.0, 0.5, 1.0)], 0.0, goal_rad)
        assert x == pytest.approx(-side * circle_m * sin(goal_rad))
        assert y == pytest.approx(side * circle_m * cos(goal_rad))


def test_rotating_ignores_what_lies_behind() -> None:
    x, y = field.rotating(Field(k_e=1.0), [Arc(0.0, 1.0, 0.5, 1.0)], 0.0, pi / 2.0 + 0.01)
    assert (x, y) == (0.0, 0.0)


def test_without_opposition_keeps_what_pushes_along_and_across() -> None:
    assert field.without_opposition((-3.0, 2.0), 0.0) == pytest.approx((0.0, 2.0))
    assert field.without_opposition((3.0, 2.0), 0.0) == pytest.approx((3.0, 2.0))
    assert field.without_opposition((0.0, -4.0), pi / 2.0) == pytest.approx((0.0, 0.0))


# A disc of radius 1 at the origin and goals near, beside and behind it: the repulsion of the disc
# is stronger there than the attraction, as long as it is not cancelled (eq. 33).
GOALS = [
    ((1.0 + gap_m) * cos(angle_rad), (1.0 + gap_m) * sin(angle_rad))
    for gap_m in (0.3, 0.6, 0.9, 1.2)
    for angle_rad in (pi, 2.4, 1.4)
]


@pytest.mark.parametrize("goal", GOALS)
def test_field_reaches_a_goal_near_an_obstacle(goal: Vec2) -> None:
    setup = scenes.alone(controller="paper")
    x_m, y_m = -4.0, 0.3
    for _ in range(400):
        away_m = hypot(goal[0] - x_m, goal[1] - y_m)
        if away_m < 0.1:
            break
        pose = Pose(x_m, y_m, 0.0)
        map = scenes.look(setup, scenes.scan([(0.0, 0.0, 1.0)], pose))
        goal_rad = atan2(goal[1] - y_m, goal[0] - x_m)
        fx, fy = seek.add_up(setup, pose, map, (), goal_rad, away_m).resultant
        step_m = min(0.04, away_m) / hypot(fx, fy)
        x_m, y_m = x_m + step_m * fx, y_m + step_m * fy
        assert hypot(x_m, y_m) > 1.0
    assert away_m < 0.1
