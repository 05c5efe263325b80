"""The paper's slips in the adaptation and its proof: as printed, failing, and as adopted, holding.

Oracles are random matrices, and simulations of the law with slow wheels and noise.
"""

from __future__ import annotations

from math import exp, sqrt

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents import pid
from swarm.scenario import Pid
from tests.agents.test_pid import track

PID = Pid()
DT_S = 0.08
seeds = st.integers(0, 2**32 - 1)


@given(seeds)
def test_pid_of_eq_48_and_49_is_a_matrix_of_six_by_two(seed: int) -> None:
    random = np.random.default_rng(seed)
    gains = tuple(random.uniform(0.1, 2.0, 6).tolist())
    integral = tuple(random.uniform(-0.5, 0.5, 2).tolist())
    seen = pid.Observation(1.0, 0.0, (0.3, -0.2), (0.1, 0.05))
    state = pid.State(gains=gains, integral=integral, slope=(0.0, 0.0), error=(0.3, -0.2))
    _, u = pid.step(PID, state, seen, DT_S, frozen=True)
    p_t = np.array([[0.3, integral[0], 0.0, 0, 0, 0], [0, 0, 0, -0.2, integral[1], 0.0]])
    assert u == pytest.approx(p_t @ gains - [0.1, 0.05])
    with pytest.raises(ValueError, match="mismatch"):
        p_t.T @ np.array(gains)  # the T at the end of the printed definition


def test_ideal_input_of_eq_51_is_in_the_span_when_the_drift_is_fed_forward() -> None:
    drift = np.array([-0.6, 0.3])
    for e in (np.zeros(2), np.array([0.3, -0.1])):
        p_t = np.array([[e[0], 0.1 * e[0], 0, 0, 0, 0], [0, 0, 0, e[1], 0.1 * e[1], 0]])
        best = np.array([PID.k, PID.k_i, 0.0, PID.k, PID.k_i, 0.0])
        ideal = PID.k * e + PID.k_i * 0.1 * e
        assert ideal - p_t @ best == pytest.approx([0.0, 0.0])  # delta = 0, so eq. 52 holds
        if not e.any():
            printed = -drift - PID.k * e  # P is zero, what is asked for is not
            assert np.linalg.norm(printed - p_t @ best) == pytest.approx(np.linalg.norm(drift))


def test_adaptation_of_eq_55_diverges_with_the_printed_sign() -> None:
    assert track(adapts=True)[-1] < 0.005
    assert track(adapts=False)[-1] > 1e6


@given(seeds)
def test_error_dynamics_of_eq_56_have_minus_e_u_for_the_error_of_eq_47(seed: int) -> None:
    random = np.random.default_rng(seed)
    e, drift, e_u = random.normal(0.0, 1.0, (3, 2))
    u = -drift + PID.k * e
    u_pid = u + e_u  # eq. 50
    slope = -(drift + u_pid)  # e = desired - measured, measured rate F + u (eq. 43), at rest
    assert slope == pytest.approx(-PID.k * e - e_u)
    assert slope - (-PID.k * e + e_u) == pytest.approx(-2.0 * e_u)  # as printed


@given(seeds)
def test_lyapunov_rate_of_eq_58_needs_the_minus_in_eq_55(seed: int) -> None:
    random = np.random.default_rng(seed)
    p, best, gains = random.normal(0.0, 1.0, (6, 2)), *random.normal(0.0, 1.0, (2, 6))
    delta = random.normal(0.0, 0.3, 2)
    e_u = p.T @ gains - p.T @ best - delta  # eq. 53
    off = best - gains
    line_3 = -(e_u + delta) @ e_u  # as eq. 58 has it
    assert -off @ (-p @ e_u) == pytest.approx(line_3)
    assert -off @ (p @ e_u) == pytest.approx(-line_3)  # with eq. 55 as printed


@given(seeds)
def test_completion_of_squares_of_eq_59_holds(seed: int) -> None:
    e, e_u = np.random.default_rng(seed).normal(0.0, 2.0, (2, 2))
    assert e @ e_u <= 0.25 * e_u @ e_u + e @ e + 1e-12


class Bounded(msgspec.Struct, frozen=True):
    """A simulation of one channel of the law that the repaired proof is about."""

    lyapunov: list[float]  # V, every step
    error: list[float]  # |e|
    disturbance: float  # largest that slow wheels and noise did to the error's rate
    kick: float  # |e0|^2 + k~0' Gamma^-1 k~0


def simulate(leak: float, slow: float, noise_m: float, sign: float = 1.0) -> Bounded:
    """edot = -(F + (1 - slow) u), u = -F + P'k, kdot = -Gamma (sign P e_u + leak k), 2 ms steps."""
    drift = -0.6
    random = np.random.default_rng(62)
    step_s = 0.002
    e, integral, k = 0.5, 0.0, [0.0, 0.0]
    best = (PID.k, 0.0)
    gamma = PID.gamma[:2]
    lyapunov, error, disturbance, noise = [], [], 0.0, 0.0
    for index in range(10_000):
        if index % 40 == 0:
            noise = max(-0.06, min(0.06, float(random.normal(0.0, noise_m))))
        off = sum((b - g) ** 2 / rate for b, g, rate in zip(best, k, gamma, strict=True))
        lyapunov.append(0.5 * e * e + 0.5 * off)
        error.append(abs(e))
        p = (e + noise, integral)
        u_pid = p[0] * k[0] + p[1] * k[1]
        e_u = u_pid - PID.k * p[0]
        e_dot = -(drift + (1.0 - slow) * (u_pid - drift))
        disturbance = max(disturbance, abs(e_dot - (-PID.k * e - e_u)))
        k = [
            g - step_s * rate * (sign * part * e_u + leak * g)
            for g, rate, part in zip(k, gamma, p, strict=True)
        ]
        e += step_s * e_dot
        if abs(e) > 1e6:
            break
        integral = max(-1.0, min(1.0, integral + step_s * p[0]))
    return Bounded(lyapunov, error, disturbance, 0.25 + PID.k**2 / gamma[0])


@pytest.mark.parametrize(("slow", "noise_m"), [(0.0, 0.0), (0.15, 0.0), (0.0, 0.02), (0.15, 0.02)])
def test_repaired_bound_of_eq_62_to_64_holds_with_slow_wheels_and_noise(
    slow: float, noise_m: float
) -> None:
    run = simulate(PID.leak, slow, noise_m)
    # e'w <= |e|^2 / 2 + |w|^2 / 2 takes a half off the margin K - 1 of e.
    a = min(2.0 * (PID.k - 1.5), PID.leak * min(PID.gamma[:2]))
    b = 0.5 * run.disturbance**2 + 0.5 * PID.leak * PID.k**2
    for index in range(0, len(run.error), 50):
        fade = exp(-a * 0.002 * index)
        assert run.lyapunov[index] <= (run.lyapunov[0] - b / a) * fade + b / a + 1e-3
        assert run.error[index] <= sqrt(run.kick) * sqrt(fade) + sqrt(2.0 * b / a)
    assert max(run.error[-2000:]) < 0.15
    printed = simulate(PID.leak, slow, noise_m, sign=-1.0)
    assert max(printed.lyapunov) > 100.0 * (run.lyapunov[0] + b / a)


def test_bound_of_eq_62_does_not_follow_from_eq_60_as_printed() -> None:
    # Gains that are off by 2, and no error: the right of eq. 60 grows with them, -aV + b falls.
    off2, b = 4.0, 0.1
    a = min(2.0 * (PID.k - 1.0), 0.5)
    before, after = 0.25 * off2 + b, -a * 0.5 * off2 + b
    assert before > after
    # The leak's -sigma/2 |k~|^2 is the -aV of the gains, V with Gamma^-1, for a = sigma min Gamma.
    leaking = -0.5 * PID.leak * off2 + b
    assert leaking <= -PID.leak * min(PID.gamma) * 0.5 * off2 / min(PID.gamma) + b + 1e-12


def test_limit_of_eq_64_is_reached_with_the_decay_before_the_root_only() -> None:
    start, b, a = 3.0, 0.1, 0.5
    adopted = [sqrt(start) * exp(-0.5 * a * t) + sqrt(2.0 * b / a) for t in (0.0, 60.0)]
    printed = sqrt(start + 2.0 * b / a * exp(-0.5 * a * 60.0)) + sqrt(2.0 * b / a)
    assert adopted[1] == pytest.approx(sqrt(2.0 * b / a), abs=1e-5)
    assert printed > sqrt(2.0 * b / a) + 1.7
    for t in (0.0, 1.0, 5.0, 20.0):  # from eq. 63, |e|^2 <= 2 V
        true = sqrt(2.0 * ((0.5 * start - b / a) * exp(-a * t) + b / a))
        assert true <= sqrt(start) * exp(-0.5 * a * t) + sqrt(2.0 * b / a) + 1e-12
