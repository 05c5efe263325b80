"""The paper's slips in its forces: each as printed, failing, and as adopted, holding.

Oracles are finite differences of the potentials and a point that follows the force.
"""

from __future__ import annotations

from collections.abc import Callable
from math import atan2, cos, hypot, log, sin, sqrt

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents import field, seek
from swarm.geometry import Pose, Vec2
from swarm.messages import Arc
from swarm.scenario import Field
from tests.agents import scenes
from tests.agents.test_field import GOALS

FIELD = Field()
STEP = 1e-5
angles = st.floats(-3.1, 3.1)


def slope(potential: Callable[[float, float], float]) -> Vec2:
    """Negative gradient at the origin by central differences."""
    return (
        -(potential(STEP, 0.0) - potential(-STEP, 0.0)) / (2.0 * STEP),
        -(potential(0.0, STEP) - potential(0.0, -STEP)) / (2.0 * STEP),
    )


@given(angles, st.floats(0.3, 2.0), st.floats(0.2, 1.5))
def test_repulsion_of_eq_28_needs_the_unit_vector_from_the_centre(
    bearing: float, gap_m: float, radius_m: float
) -> None:
    far_m = gap_m + radius_m
    centre = (far_m * cos(bearing), far_m * sin(bearing))

    def potential(x_m: float, y_m: float) -> float:
        f_m = hypot(x_m - centre[0], y_m - centre[1]) - radius_m
        return 0.5 * FIELD.k_r * (1.0 / f_m - 1.0 / FIELD.rho_m) ** 2

    expected = slope(potential)
    force = field.repulsive(FIELD, [Arc(bearing, gap_m, 0.3, 1.0)], 0.0, 10.0)
    assert force == pytest.approx(expected, rel=1e-4, abs=1e-4)
    size = FIELD.k_r * (1.0 / gap_m - 1.0 / FIELD.rho_m) / gap_m**2
    printed = (size * -centre[0] / gap_m, size * -centre[1] / gap_m)
    assert hypot(*printed) == pytest.approx(hypot(*expected) * far_m / gap_m, rel=1e-4)
    assert hypot(*printed) > 1.09 * hypot(*expected)


@given(angles, angles, st.floats(0.2, 1.0), st.floats(1.05, 1.9))
def test_cancelled_repulsion_of_eq_33_is_the_slope_with_a_minus_in_eq_32(
    goal_rad: float, bearing: float, goal_m: float, farther: float
) -> None:
    gap_m = goal_m * farther
    goal = (goal_m * cos(goal_rad), goal_m * sin(goal_rad))
    surface = (gap_m * cos(bearing), gap_m * sin(bearing))

    def attraction(x_m: float, y_m: float) -> float:
        return 0.5 * FIELD.k_g * ((x_m - goal[0]) ** 2 + (y_m - goal[1]) ** 2)

    def repulsion(x_m: float, y_m: float) -> float:
        f_m = hypot(x_m - surface[0], y_m - surface[1])
        return 0.5 * FIELD.k_r * (1.0 / f_m - 1.0 / FIELD.rho_m) ** 2

    def total(sign: float) -> Vec2:  # eq. 22 with U_att of eq. 32 with that sign
        return slope(lambda x, y: attraction(x, y) + sign * repulsion(x, y) + repulsion(x, y))

    force = field.total(
        field.attractive(FIELD, goal_rad, goal_m),
        field.repulsive(FIELD, [Arc(bearing, gap_m, 0.3, 1.0)], 0.0, goal_m),
    )
    assert force == pytest.approx(total(-1.0), abs=1e-3)
    doubled = field.repulsive(FIELD, [Arc(bearing, gap_m, 0.3, 1.0)], 0.0, 10.0)
    printed = total(1.0)
    assert (printed[0] - force[0], printed[1] - force[1]) == pytest.approx(
        (2.0 * doubled[0], 2.0 * doubled[1]), rel=1e-3, abs=1e-2
    )


def reached(repulsion: float) -> int:
    """Goals near a disc that a point reaches when arcs beyond the goal push `repulsion` times."""
    setup = scenes.alone(controller="paper")
    count = 0
    for goal in GOALS:
        x_m, y_m = -4.0, 0.3
        for _ in range(300):
            away_m = hypot(goal[0] - x_m, goal[1] - y_m)
            if away_m < 0.1:
                count += 1
                break
            pose = Pose(x_m, y_m, 0.0)
            map = scenes.look(setup, scenes.scan([(0.0, 0.0, 1.0)], pose))
            goal_rad = atan2(goal[1] - y_m, goal[0] - x_m)
            beyond = [arc for arc in map.arcs if away_m < arc.range_m]
            extra = field.repulsive(FIELD, beyond, 0.0, 1e3)
            force = seek.add_up(setup, pose, map, (), goal_rad, away_m).resultant
            fx, fy = force[0] + repulsion * extra[0], force[1] + repulsion * extra[1]
            step_m = min(0.04, away_m) / hypot(fx, fy)
            x_m, y_m = x_m + step_m * fx, y_m + step_m * fy
    return count


def test_goals_near_obstacles_are_reached_by_eq_33_without_its_plus_sign_only() -> None:
    assert reached(0.0) == 12
    assert reached(1.0) == 0  # without the rule
    assert reached(2.0) == 0  # as printed


@given(st.floats(0.05, 1.5), st.floats(0.5, 2.9))
def test_rotating_force_of_eq_35_is_perpendicular_to_the_attraction(
    goal_rad: float, range_m: float
) -> None:
    field_1 = Field(k_e=1.0)
    width_rad = 0.4
    pull = field.attractive(field_1, goal_rad, 3.0)
    force = field.rotating(field_1, [Arc(0.0, range_m, width_rad, 1.0)], 0.0, goal_rad)
    centre_m = 2.0 * range_m * cos(width_rad / 2.0)
    assert hypot(*force) == pytest.approx(centre_m)
    assert force[0] * pull[0] + force[1] * pull[1] == pytest.approx(0.0, abs=1e-9)
    printed = (-centre_m, 0.0)  # k_e (q - q_o)
    aligned = printed[0] * pull[0] + printed[1] * pull[1]
    assert aligned < -0.05 * hypot(*pull) * centre_m  # it pushes back, for ever when straight ahead


@given(st.floats(0.56, 0.99))
def test_force_between_robots_of_eq_37_has_the_reach_of_its_potential(q_m: float) -> None:
    r_m, r_ij_m = FIELD.safe_distance_m, FIELD.robot_reach_m

    def potential(x_m: float, y_m: float) -> float:  # eq. 36, whose constant jump has no slope
        away_m = hypot(x_m - q_m, y_m)
        return -FIELD.k_ij * (log(away_m - r_m) - away_m / (r_ij_m - r_m))

    heard = scenes.peer(scenes.beacon("robot2", Pose(q_m, 0.0, 0.0)))
    push, _ = slope(potential)
    assert field.between_robots(scenes.alone(), [heard])[0] == pytest.approx(
        push, rel=1e-4, abs=1e-3
    )
    printed = FIELD.k_ij * (1.0 / (q_m - r_m) - 1.0 / (FIELD.rho_m - r_m))
    assert abs(printed - -push) > 1.0


def test_force_between_robots_of_eq_37_attracts_below_the_safe_distance_as_printed() -> None:
    def printed(q_m: float) -> float:
        return FIELD.k_ij * (1.0 / (q_m - 0.5) - 1.0 / (FIELD.rho_m - 0.5))

    near = scenes.peer(scenes.beacon("robot2", Pose(0.4, 0.0, 0.0)))
    assert printed(0.4) < -50.0
    assert (
        field.between_robots(scenes.alone(), [near])[0] < -50.0
    )  # away from the peer, which is at +x
    neighbour = scenes.peer(scenes.beacon("robot2", Pose(sqrt(2.0), 0.0, 0.0)))
    assert printed(sqrt(2.0)) > 3.0  # a formation would fight itself
    assert field.between_robots(scenes.alone(), [neighbour]) == (0.0, 0.0)
