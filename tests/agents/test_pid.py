"""The tracking model against finite differences, and the adaptation against the law as printed."""

from __future__ import annotations

from math import atan2, cos, hypot, pi, sin

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents import pid
from swarm import geometry
from swarm.geometry import Pose, Twist, wrap_angle
from swarm.messages import Slot
from swarm.scenario import Pid

PID = Pid()
STEP_S = 1e-4
speeds = st.floats(-1.0, 1.0)
yaws = st.floats(-3.1, 3.1)


def polar(follower: Pose, leader: Pose) -> tuple[float, float]:
    """d and phi of the off-axle points."""
    x_m = follower.x_m + 0.2 * cos(follower.yaw_rad) - leader.x_m - 0.2 * cos(leader.yaw_rad)
    y_m = follower.y_m + 0.2 * sin(follower.yaw_rad) - leader.y_m - 0.2 * sin(leader.yaw_rad)
    return hypot(x_m, y_m), atan2(y_m, x_m)


@given(speeds, speeds, speeds, speeds, yaws, yaws, yaws, st.floats(0.6, 6.0), st.floats(-0.3, 0.3))
def test_observe_and_invert_are_the_model_of_eq_42(
    v_l: float,
    w_l: float,
    v_f: float,
    w_f: float,
    yaw_l: float,
    yaw_f: float,
    phi: float,
    d_m: float,
    rate: float,
) -> None:
    leader = Pose(0.4, -0.3, yaw_l)
    follower = Pose(0.4 + d_m * cos(phi), -0.3 + d_m * sin(phi), yaw_f)
    seen = pid.observe(PID, follower, leader, Twist(v_l, w_l), 0.2, rate, Slot(2.0, 0.5))

    def at(after_s: float) -> tuple[float, float]:
        return polar(
            geometry.advance(follower, Twist(v_f, w_f), after_s),
            geometry.advance(leader, Twist(v_l, w_l), after_s),
        )

    (d_1, phi_1), (d_0, phi_0) = at(STEP_S), at(-STEP_S)
    u = (
        (d_1 - d_0) / (2.0 * STEP_S) - seen.drift[0],
        wrap_angle(phi_1 - phi_0) / (2.0 * STEP_S) - rate - seen.drift[1],
    )
    assert pid.invert(PID, seen, u) == pytest.approx((v_f, w_f), abs=1e-5)


def test_observe_sees_no_error_in_the_slot() -> None:
    slot = Slot(2.0, pi / 4.0)
    leader = Pose(3.0, 1.0, 0.3)
    follower = Pose(
        3.0 - 2.0 * cos(0.3 + pi / 4.0), 1.0 - 2.0 * sin(0.3 + pi / 4.0), leader.yaw_rad
    )
    seen = pid.observe(PID, follower, leader, Twist(0.6, 0.0), 0.3, 0.0, slot)
    assert seen.error == pytest.approx((0.0, 0.0), abs=1e-12)
    assert pid.invert(PID, seen, (-seen.drift[0], -seen.drift[1])) == pytest.approx(
        (0.6, 0.0), abs=1e-12
    )


def test_observe_stays_finite_on_top_of_the_leader() -> None:
    seen = pid.observe(PID, scenes_pose(), scenes_pose(), Twist(0.6, 0.1), 0.0, 0.0, Slot(1.0, 0.0))
    assert seen.distance_m == pid.DISTANCE_M_MIN
    assert seen.error[0] == pytest.approx(1.0)


def scenes_pose() -> Pose:
    return Pose(1.0, 1.0, 0.5)


def track(adapts: bool) -> list[float]:
    """|e| of edot = 0.1 - u under the adaptive law, or under kdot = +P e_u as printed (eq. 55)."""
    e, integral, k = 0.5, 0.0, [0.0, 0.0, 0.0]
    sizes = []
    for _ in range(round(40.0 / 0.08)):
        integral += 0.08 * e
        p = (e, integral, 0.0)
        u = sum(part * gain for part, gain in zip(p, k, strict=True))
        if adapts:
            k = pid.adapt(PID, tuple(k), p, u, 0.08)
        else:
            e_u = u - (PID.k * e + PID.k_i * integral)
            k = [
                gain + 0.08 * gamma * part * e_u
                for gain, gamma, part in zip(k, PID.gamma, p, strict=True)
            ]
        e += 0.08 * (0.1 - u)
        sizes.append(abs(e))
        if sizes[-1] > 1e6:
            break
    return sizes


def test_adapt_converges_where_the_printed_sign_diverges() -> None:
    assert track(adapts=True)[-1] < 0.005
    assert track(adapts=False)[-1] > 1e6


def test_adapt_stays_in_its_box() -> None:
    assert pid.adapt(PID, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 9.0, 0.08) == [0.0, 0.0, 0.0]
    assert pid.adapt(PID, (8.0, 5.0, 0.5), (1.0, 1.0, 1.0), -9.0, 0.08) == [8.0, 5.0, 0.5]


def test_step_learns_nothing_while_frozen() -> None:
    seen = pid.Observation(2.0, 0.0, (0.4, -0.1), (0.1, 0.2))
    state = pid.State(gains=(1.0, 0.2, 0.0, 1.5, 0.3, 0.0), integral=(0.1, -0.1))
    after, u = pid.step(PID, state, seen, 0.08, frozen=True)
    assert (after.gains, after.integral) == (state.gains, state.integral)
    assert u == pytest.approx(
        (0.4 * 1.0 + 0.1 * 0.2 - 0.1, (-0.1 * 2.0 * 1.5 - 0.1 * 0.3) / 2.0 - 0.2)
    )


def test_step_starts_from_zero_gains_with_the_drift_fed_forward() -> None:
    seen = pid.Observation(2.0, 0.0, (0.4, -0.1), (0.1, 0.2))
    after, u = pid.step(PID, pid.State(), seen, 0.08, frozen=False)
    assert u == (-0.1, -0.2)
    assert after.gains[0] > 0.0
    assert after.gains[3] > 0.0


def test_step_clips_a_large_error() -> None:
    seen = pid.Observation(2.0, 0.0, (50.0, -3.0), (0.0, 0.0))
    after, _ = pid.step(PID, pid.State(), seen, 0.08, frozen=False)
    assert after.error == (1.0, -1.0)
    assert after.integral == pytest.approx((0.08, -0.08))


def test_reset_keeps_what_was_learned_only() -> None:
    state = pid.State((1.0, 0.2, 0.0, 1.5, 0.3, 0.0), (0.1, 0.1), (0.2, 0.2), (0.3, 0.3))
    assert pid.reset(state) == pid.State(gains=state.gains)
