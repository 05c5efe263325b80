"""The paper's slips in the formation's model: each as printed, failing, and as adopted, holding.

Oracles are finite differences and simulations with slow wheels and noise.
"""

from __future__ import annotations

from math import atan, cos, hypot, pi, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents import pid
from swarm import geometry
from swarm.geometry import Pose, Twist, wrap_angle
from swarm.messages import Slot
from swarm.scenario import Pid

PID = Pid()
DT_S = 0.08
STEP_S = 1e-5
speeds = st.floats(0.2, 1.0)
turns = st.floats(0.2, 1.0)
yaws = st.floats(-3.1, 3.1)
bearings = st.floats(0.3, 1.2)


@given(speeds, turns, speeds, turns, yaws, yaws, bearings, st.floats(0.8, 6.0))
def test_model_of_eq_42_needs_psi_and_the_off_axle_point(
    v_l: float,
    w_l: float,
    v_f: float,
    w_f: float,
    yaw_l: float,
    yaw_f: float,
    alpha: float,
    d: float,
) -> None:
    l_m = PID.off_axle_m
    leader = Pose(0.4, -0.3, yaw_l)
    # Eq. 39 with its minus: the tracked point is at -d e(alpha + theta_l).
    x_m, y_m = leader.x_m - d * cos(alpha + yaw_l), leader.y_m - d * sin(alpha + yaw_l)
    follower = Pose(x_m - l_m * cos(yaw_f), y_m - l_m * sin(yaw_f), yaw_f)

    def at(after_s: float) -> tuple[float, float]:
        one = geometry.advance(leader, Twist(v_l, w_l), after_s)
        other = geometry.advance(follower, Twist(v_f, w_f), after_s)
        dx = other.x_m + l_m * cos(other.yaw_rad) - one.x_m
        dy = other.y_m + l_m * sin(other.yaw_rad) - one.y_m
        return hypot(dx, dy), float(np.arctan2(dy, dx)) - one.yaw_rad

    (d_1, psi_1), (d_0, psi_0) = at(STEP_S), at(-STEP_S)
    truth = ((d_1 - d_0) / (2.0 * STEP_S), wrap_angle(psi_1 - psi_0) / (2.0 * STEP_S))

    def model(psi: float, l_m: float) -> tuple[float, float]:
        b = yaw_l + psi - yaw_f
        return (
            v_f * cos(b) - v_l * cos(psi) + l_m * w_f * sin(b),
            (v_l * sin(psi) - v_f * sin(b) - d * w_l + l_m * w_f * cos(b)) / d,
        )

    assert model(wrap_angle(alpha + pi), l_m) == pytest.approx(truth, abs=1e-5)
    # With alpha for psi, both signs of what the leader does to d are wrong: eq. 39 and 42 differ.
    assert model(alpha, l_m)[0] == pytest.approx(-truth[0], abs=1e-5)
    # As printed: cos(beta) twice in the second line, and 1 m from axle to tracked point.
    b = yaw_l + alpha + pi - yaw_f
    printed = (v_l * sin(alpha + pi) - v_f * cos(b) - d * w_l + l_m * w_f * cos(b)) / d
    assert printed - truth[1] == pytest.approx(v_f * (sin(b) - cos(b)) / d, abs=1e-5)
    assert model(alpha + pi, 1.0)[0] - truth[0] == pytest.approx(0.8 * w_f * sin(b), abs=1e-5)


@given(st.floats(0.5, 6.0), yaws, st.floats(-1.0, 1.0), st.floats(-1.0, 1.0))
def test_invert_undoes_g_of_eq_43_whose_determinant_is_l_over_d(
    d_m: float, beta: float, u_1: float, u_2: float
) -> None:
    def g(l_m: float) -> geometry.Floats:
        return np.array([[cos(beta), l_m * sin(beta)], [-sin(beta) / d_m, l_m * cos(beta) / d_m]])

    l_m = PID.off_axle_m
    assert np.linalg.det(g(l_m)) == pytest.approx(l_m / d_m)
    seen = pid.Observation(d_m, beta, (0.0, 0.0), (0.0, 0.0))
    twist = pid.invert(PID, seen, (u_1, u_2))
    assert g(l_m) @ twist == pytest.approx([u_1, u_2], abs=1e-9)
    printed = np.linalg.solve(g(1.0), [u_1, u_2])
    assert printed[1] == pytest.approx(l_m * twist[1], abs=1e-9)  # turns five times too slowly


def follow(sign: float, share: float = 1.0, law: str = "fixed") -> list[float]:
    """Error in m of a follower, tick by tick, whose wheels turn at `share` of what they are told.

    `fixed`: u = -F + sign K e; `adaptive`: pid.step; `noisy`: pid.step with 2 cm on every pose.
    """
    random = np.random.default_rng(44)
    slot = Slot(2.0, 0.5)
    leader = Pose(0.0, 0.0, 0.3)
    away = (slot.distance_m + 0.3, slot.bearing_rad + 0.15 + leader.yaw_rad)
    pose = Pose(-away[0] * cos(away[1]), -away[0] * sin(away[1]), 0.3)
    state = pid.State()
    errors = []
    for _ in range(500):
        there = pose
        if law == "noisy":
            off = random.normal(0.0, 0.02, 2).clip(-0.06, 0.06)
            there = Pose(pose.x_m + float(off[0]), pose.y_m + float(off[1]), pose.yaw_rad)
        seen = pid.observe(PID, there, leader, Twist(0.6, 0.0), 0.3, 0.0, slot)
        if law == "fixed":
            u = (
                sign * PID.k * seen.error[0] - seen.drift[0],
                sign * PID.k * seen.error[1] - seen.drift[1],
            )
        else:
            state, u = pid.step(PID, state, seen, DT_S, frozen=False)
        v, w = pid.invert(PID, seen, u)
        pose = geometry.advance(pose, Twist(share * max(-3.0, min(3.0, v)), share * w), DT_S)
        leader = geometry.advance(leader, Twist(0.6, 0.0), DT_S)
        true = pid.observe(PID, pose, leader, Twist(0.6, 0.0), 0.3, 0.0, slot)
        errors.append(hypot(true.error[0], true.distance_m * true.error[1]))
    return errors


def test_input_of_eq_44_converges_with_plus_k_e_for_the_error_of_eq_47() -> None:
    assert follow(1.0)[-1] < 1e-3
    printed = follow(-1.0)
    assert max(printed[-100:]) > 3.0


def test_bearing_of_eq_46_needs_the_quadrant() -> None:
    slot = Slot(2.0, 0.5)
    leader = Pose(3.0, 1.0, 0.0)
    pose = Pose(3.0 - 2.0 * cos(0.5), 1.0 - 2.0 * sin(0.5), 0.0)
    seen = pid.observe(PID, pose, leader, Twist(0.6, 0.0), 0.0, 0.0, slot)
    assert seen.error == pytest.approx((0.0, 0.0), abs=1e-12)
    printed = atan((pose.y_m - leader.y_m) / (pose.x_m - leader.x_m))
    assert abs(wrap_angle(0.5 + pi - printed)) == pytest.approx(pi)


def test_bearing_error_of_eq_47_is_wrapped() -> None:
    slot, heading_rad = Slot(2.0, 0.0), 0.05  # the follower is just beside -x of the leader
    pose = Pose(-2.0, 0.01, 0.0)
    seen = pid.observe(PID, pose, Pose(0.0, 0.0, 0.0), Twist(0.0, 0.0), heading_rad, 0.0, slot)
    assert seen.error[1] == pytest.approx(0.05 + atan(0.01 / 2.0), abs=1e-9)
    printed = wrap_angle(heading_rad + pi) - float(np.arctan2(0.01, -2.0))
    assert printed == pytest.approx(seen.error[1] - 2.0 * pi)


def test_adaptive_law_learns_slow_wheels_and_stays_near_in_noise() -> None:
    assert max(follow(1.0, 0.85)[-50:]) > 0.04  # without adaptation
    assert max(follow(1.0, 0.85, "adaptive")[-50:]) < 0.015
    assert max(follow(1.0, 0.85, "noisy")[-200:]) < 0.08
    assert max(follow(1.0, 1.0, "noisy")[-200:]) < 0.08
