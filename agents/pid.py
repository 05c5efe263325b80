"""Adaptive PID tracking of a slot, reading A2 (section 3.2, eq. 42 to 64).

    leader, slot --observe--> error e, drift F --step--> u --inverse of G--> (v, omega)

The tracked point C lies L ahead of the axle, so that both its coordinates can be driven; so does
the leader's point of reference, and the robots' centres match when their headings agree.
Kp, Ki, Kd = 8, 5, 5 are the adaptation gains: the paper starts with all PID values zero.
"""

from __future__ import annotations

from math import atan2, cos, pi, sin

import msgspec

from swarm import geometry
from swarm.geometry import Pose, Twist, Vec2, wrap_angle
from swarm.messages import Slot
from swarm.scenario import Pid

# Below this the bearing from the leader means nothing, and 1/d grows without bound.
DISTANCE_M_MIN = 0.15

Gains = tuple[float, float, float, float, float, float]


class State(msgspec.Struct, frozen=True):
    """Adapted gains (P, I, D along, then across) and what integral and slope remember.

    Errors are in m: along the line from the leader, and across it (bearing times distance).
    """

    gains: Gains = (0.0,) * 6
    integral: Vec2 = (0.0, 0.0)
    slope: Vec2 = (0.0, 0.0)  # filtered derivative of e
    error: Vec2 | None = None  # of the tick before; None after a reset


class Observation(msgspec.Struct, frozen=True):
    """Where the tracked point is, as seen from the leader's."""

    distance_m: float  # d of eq. 45
    beta_rad: float  # bearing of C less own heading: b of eq. 42
    error: Vec2  # e of eq. 47: m, rad
    drift: Vec2  # F of eq. 43: m/s, rad/s


def reset(state: State) -> State:
    """Same gains, nothing else remembered: on every entry into FORM."""
    return State(gains=state.gains)


def observe(
    pid: Pid,
    pose: Pose,
    leader: Pose,
    leader_twist: Twist,
    formation_heading_rad: float,
    formation_turn_rate_radps: float,
    slot: Slot,
) -> Observation:
    """Error and drift of the l-psi model (eq. 42 to 47, with the missing terms put back).

    C - P_ref in polar coordinates (d, phi), P_ref the leader's own point L ahead of its axle; the
    set point is (d, theta_F + alpha + pi), global bearings. Poses in the world frame.
    """
    l_m = pid.off_axle_m
    leader_cos, leader_sin = cos(leader.yaw_rad), sin(leader.yaw_rad)
    x_m = pose.x_m + l_m * cos(pose.yaw_rad) - leader.x_m - l_m * leader_cos
    y_m = pose.y_m + l_m * sin(pose.yaw_rad) - leader.y_m - l_m * leader_sin
    phi = atan2(y_m, x_m)
    true_m = geometry.length(x_m, y_m)
    distance_m = max(true_m, DISTANCE_M_MIN)
    swing_mps = l_m * leader_twist.turn_rate_radps
    v_x = leader_twist.speed_mps * leader_cos - swing_mps * leader_sin
    v_y = leader_twist.speed_mps * leader_sin + swing_mps * leader_cos
    e_x, e_y = cos(phi), sin(phi)
    wanted_rad = formation_heading_rad + slot.bearing_rad + pi
    return Observation(
        distance_m=distance_m,
        beta_rad=phi - pose.yaw_rad,
        error=(slot.distance_m - true_m, wrap_angle(wanted_rad - phi)),
        drift=(
            -(e_x * v_x + e_y * v_y),
            (e_y * v_x - e_x * v_y) / distance_m - formation_turn_rate_radps,
        ),
    )


def step(
    pid: Pid, state: State, seen: Observation, dt_s: float, *, frozen: bool
) -> tuple[State, Vec2]:
    """Next state and input u = -F + u_pid (eq. 44 with e = desired - measured, 49, 55).

    Unlike the source, the bearing's error is multiplied by the distance, so that both channels
    are in metres: in radians the gains of a slot 5.7 m away would learn sixteen times slower
    than at 1.4 m (its residual on random fields was 0.023 m, now 0.012 m).

    Args:
        frozen: the last set-point was not the one asked for (limits, guard, waiting): neither
            integral nor gains may learn from an error that they cannot change.
    Returns:
        u: m/s along, rad/s across the line from the leader.
    """
    e = (
        max(-pid.error_m_max, min(pid.error_m_max, seen.error[0])),
        max(-pid.error_m_max, min(pid.error_m_max, seen.error[1] * seen.distance_m)),
    )
    before = e if state.error is None else state.error
    share = dt_s / (pid.derivative_filter_s + dt_s)
    raw = ((e[0] - before[0]) / dt_s, (e[1] - before[1]) / dt_s)
    slope = (
        state.slope[0] + share * (raw[0] - state.slope[0]),
        state.slope[1] + share * (raw[1] - state.slope[1]),
    )
    integral = state.integral
    if not frozen:
        integral = (
            max(-pid.integral_max, min(pid.integral_max, integral[0] + e[0] * dt_s)),
            max(-pid.integral_max, min(pid.integral_max, integral[1] + e[1] * dt_s)),
        )
    gains: list[float] = []
    output = []
    for channel in range(2):
        p = (e[channel], integral[channel], slope[channel])
        k = state.gains[3 * channel : 3 * channel + 3]
        u = p[0] * k[0] + p[1] * k[1] + p[2] * k[2]
        output.append(u)
        gains.extend(k if frozen else adapt(pid, k, p, u, dt_s))
    next_state = State(
        gains=(gains[0], gains[1], gains[2], gains[3], gains[4], gains[5]),
        integral=integral,
        slope=slope,
        error=e,
    )
    return next_state, (output[0] - seen.drift[0], output[1] / seen.distance_m - seen.drift[1])


def adapt(
    pid: Pid, k: tuple[float, ...], p: tuple[float, float, float], u: float, dt_s: float
) -> list[float]:
    """Gains of one channel after a tick: kdot = -Gamma P e_u, eq. 55 with its sign put right.

    e_u is the distance from the ideal input K e + K_I int e. As printed, with a plus, the gains
    run away. Normalised, because an explicit step needs dt gamma |P|^2 < 2; with a leak in
    proportion to |e_u|, because a constant one would erase the gains where e = 0; projected into
    the box that the scenario allows.
    """
    e_u = u - (pid.k * p[0] + pid.k_i * p[1])
    norm = pid.normalisation + p[0] * p[0] + p[1] * p[1] + p[2] * p[2]
    leak = pid.leak * abs(e_u)
    return [
        max(0.0, min(bound, gain - dt_s * (gamma * part * e_u / norm + leak * gain)))
        for gain, gamma, part, bound in zip(k, pid.gamma, p, pid.gain_max, strict=True)
    ]


def invert(pid: Pid, seen: Observation, u: Vec2) -> tuple[float, float]:
    """(v, omega) = G^-1 u of eq. 43, with L where the paper's print has 1."""
    c, s = cos(seen.beta_rad), sin(seen.beta_rad)
    return (
        c * u[0] - seen.distance_m * s * u[1],
        (s * u[0] + seen.distance_m * c * u[1]) / pid.off_axle_m,
    )
