"""The paper's slips in its models and map: each as printed, failing, and as adopted, holding.

Oracles are finite differences and Newton's law; agents/README.md tells which row uses which test.
"""

from __future__ import annotations

from math import cos, floor, hypot, pi, sin, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents import msam
from swarm import geometry
from swarm.geometry import Floats, Pose, Twist, Vec2
from swarm.scenario import Msam, Robot
from tests.agents import scenes
from world import motion

ROBOT = Robot(name="robot1", start=(0.0, 0.0, 0.0))
B_M, R_M = ROBOT.half_track_m, ROBOT.wheel_radius_m
MASS_KG, INERTIA_KGM2, OFFSET_M = 12.0, 0.28, 0.05  # about the centre of mass; its offset g
STEP = 1e-5
rates = st.floats(0.1, 2.0)
angles = st.floats(-3.1, 3.1)


# --- kinematics and dynamics --------------------------------------------------------------------


@given(st.floats(-1.0, 1.0), rates, angles)
def test_turn_rate_of_eq_2_and_6_is_right_wheel_less_left(v: float, w: float, yaw: float) -> None:
    here, twist = Pose(0.3, -0.4, yaw), Twist(v, w)

    def wheel(aside_m: float, after_s: float) -> Vec2:
        body = geometry.advance(here, twist, after_s)
        return (body.x_m - aside_m * sin(body.yaw_rad), body.y_m + aside_m * cos(body.yaw_rad))

    def rim_mps(aside_m: float) -> float:
        (x_1, y_1), (x_0, y_0) = wheel(aside_m, STEP), wheel(aside_m, -STEP)
        return ((x_1 - x_0) * cos(yaw) + (y_1 - y_0) * sin(yaw)) / (2.0 * STEP)

    left, right = rim_mps(B_M), rim_mps(-B_M)
    adopted = motion.wheels(ROBOT, twist)
    assert (adopted.left_mps, adopted.right_mps) == pytest.approx((left, right), abs=1e-8)
    assert (right - left) / (2.0 * B_M) == pytest.approx(w, abs=1e-7)
    assert (left - right) / (2.0 * B_M) == pytest.approx(-w, abs=1e-7)  # eq. 2 as printed
    printed = np.array([[0.5, 0.5], [1.0 / B_M, -1.0 / B_M]]) @ [left, right]
    assert printed == pytest.approx([v, -2.0 * w], abs=1e-6)  # eq. 6 as printed
    half = np.array([[0.5, 0.5], [-0.5 / B_M, 0.5 / B_M]]) @ [left, right]
    assert half == pytest.approx([v, w], abs=1e-6)


def inertia(yaw: float, behind_m: float) -> Floats:
    """M of eq. 9 with g = `behind_m`."""
    side = MASS_KG * behind_m
    i = INERTIA_KGM2 + MASS_KG * behind_m**2
    return np.array(
        [
            [MASS_KG, 0.0, side * sin(yaw)],
            [0.0, MASS_KG, -side * cos(yaw)],
            [side * sin(yaw), -side * cos(yaw), i],
        ]
    )


def span(yaw: float) -> Floats:
    """S of eq. 7."""
    return np.array([[cos(yaw), 0.0], [sin(yaw), 0.0], [0.0, 1.0]])


@given(st.floats(0.1, 1.0), rates, angles)
def test_g_of_eq_9_is_an_offset_behind_the_axle_not_gravity(v: float, w: float, yaw: float) -> None:
    speed = span(yaw) @ [v, w]
    assert np.shape(inertia(yaw, OFFSET_M) @ speed) == (3,)
    with pytest.raises(ValueError, match="mismatch"):  # eq. 8 as printed: M is 3x3, V is 2x1
        inertia(yaw, OFFSET_M) @ np.array([v, w])

    def energy(ahead_m: float) -> float:
        x, y = speed[0] - w * ahead_m * sin(yaw), speed[1] + w * ahead_m * cos(yaw)
        return float(0.5 * MASS_KG * (x * x + y * y) + 0.5 * INERTIA_KGM2 * w * w)

    assert 0.5 * speed @ inertia(yaw, OFFSET_M) @ speed == pytest.approx(energy(-OFFSET_M))
    sliding = np.array([-v * sin(yaw), v * cos(yaw), w])  # sideways, where the sides differ
    x, y = sliding[0] + w * OFFSET_M * sin(yaw), sliding[1] - w * OFFSET_M * cos(yaw)
    behind = 0.5 * MASS_KG * (x * x + y * y) + 0.5 * INERTIA_KGM2 * w * w
    assert 0.5 * sliding @ inertia(yaw, OFFSET_M) @ sliding == pytest.approx(behind)
    assert 0.5 * sliding @ inertia(yaw, -OFFSET_M) @ sliding != pytest.approx(behind, rel=1e-3)


@given(st.floats(0.1, 1.0), rates, angles)
def test_columns_of_eq_11_are_right_then_left(v: float, w: float, yaw: float) -> None:
    drive = np.array([[cos(yaw), cos(yaw)], [sin(yaw), sin(yaw)], [B_M, -B_M]]) / R_M
    right_nm, left_nm = 0.7, 0.2
    power_w = (right_nm * (v + B_M * w) + left_nm * (v - B_M * w)) / R_M
    through = span(yaw) @ [v, w]
    assert through @ drive @ [right_nm, left_nm] == pytest.approx(power_w)
    assert through @ drive @ [left_nm, right_nm] != pytest.approx(power_w, rel=1e-4)


@given(st.floats(0.1, 1.0), rates, st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), angles)
def test_coriolis_term_of_eq_16_has_the_sign_of_newton(
    v: float, w: float, v_dot: float, w_dot: float, yaw: float
) -> None:
    s = span(yaw)
    s_dot = np.array([[-w * sin(yaw), 0.0], [w * cos(yaw), 0.0], [0.0, 0.0]])
    side = MASS_KG * OFFSET_M * w
    v_m = np.array([[0.0, 0.0, side * cos(yaw)], [0.0, 0.0, side * sin(yaw)], [0.0, 0.0, 0.0]])
    m = inertia(yaw, OFFSET_M)
    coriolis = s.T @ m @ s_dot + s.T @ v_m @ s  # of eq. 14
    assert coriolis == pytest.approx(np.array([[0.0, side], [-side, 0.0]]), abs=1e-12)
    assert [v, w] @ coriolis @ [v, w] == pytest.approx(0.0, abs=1e-12)  # it does no work
    assert s.T @ [-sin(yaw), cos(yaw), 0.0] == pytest.approx([0.0, 0.0])  # A drops out of 15

    # Newton: acceleration of a point `ahead` of the axle, along the heading, to the left.
    def acceleration(ahead: float) -> Vec2:
        return (v_dot - ahead * w * w, v * w + ahead * w_dot)

    along, aside = acceleration(-OFFSET_M)
    force_n = MASS_KG * along
    torque_nm = INERTIA_KGM2 * w_dot - OFFSET_M * MASS_KG * aside  # the axle's push is d ahead
    change = s.T @ m @ s @ [v_dot, w_dot]
    assert change + coriolis @ [v, w] == pytest.approx([force_n, torque_nm])
    assert change - coriolis @ [v, w] != pytest.approx([force_n, torque_nm], rel=1e-4)  # printed
    # As printed it is the law of a centre of mass that is g ahead.
    along, aside = acceleration(OFFSET_M)
    torque_nm = INERTIA_KGM2 * w_dot + OFFSET_M * MASS_KG * aside
    assert change - coriolis @ [v, w] == pytest.approx([MASS_KG * along, torque_nm])


# --- the map ------------------------------------------------------------------------------------


def test_cells_of_eq_18_hold_every_point_once() -> None:
    random = np.random.default_rng(18)
    sectors, rings, reach_m = 72, 100, 5.0
    width_rad, ring_m = 2.0 * pi / sectors, reach_m / rings
    printed_is_one = 0
    for angle, range_m in zip(
        random.uniform(0.0, 2.0 * pi, 300), random.uniform(0.1, 4.9, 300), strict=True
    ):
        j = floor(range_m / ring_m)
        of_ring = [i for i in range(sectors) if i * width_rad <= angle < (j + 1) * width_rad]
        printed_is_one += len(of_ring) == 1
        adopted = [i for i in range(sectors) if i * width_rad <= angle < (i + 1) * width_rad]
        assert len(adopted) == 1
        ranges_m = scenes.nothing()
        ranges_m[adopted[0] * 3 + 1] = range_m
        found = msam.sector_ranges(ranges_m, sectors, ring_m)
        assert found[adopted[0]] == pytest.approx(ring_m * floor(np.float32(range_m) / ring_m))
        assert sum(value < np.inf for value in found) == 1
    assert printed_is_one < 15


@pytest.mark.parametrize("cells", [1, 3, 6, 12])
def test_virtual_circle_of_eq_19_to_21_mirrors_the_robot_in_the_chord(cells: int) -> None:
    r_o, half = 1.3, cells * pi / 72.0
    a, b = (r_o * cos(half), r_o * sin(half)), (r_o * cos(half), -r_o * sin(half))
    chord_m = hypot((a[0] + b[0]) / 2.0, (a[1] + b[1]) / 2.0)
    centre_m = msam.circle_distance(r_o, 2.0 * half)
    assert centre_m == pytest.approx(2.0 * chord_m)
    assert hypot(a[0] - centre_m, a[1]) == pytest.approx(r_o)  # through A and B, radius r_o


def test_virtual_circle_holds_the_robot_from_120_degrees_on() -> None:
    def surface(width_rad: float) -> float:
        return 2.0 * cos(width_rad / 2.0) - 1.0

    shares = [surface(pi * degrees / 180.0) for degrees in (60.0, 120.0, 150.0)]
    assert shares == pytest.approx([sqrt(3.0) - 1.0, 0.0, 2.0 * cos(5.0 * pi / 12.0) - 1.0])
    assert shares[2] < 0.0
    assert surface(Msam().split_rad) > 0.7
