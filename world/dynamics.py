"""Bodies with mass, wheels with torque: eq. 8 to 16.

    asked twist --wheel_torques--> torques, held --mean_twist--> twist --> pose      every 10 ms

The model, V = (v, w) = (speed, turn rate), q = (x, y, theta) of the axle's centre: eq. 8 with the
wheels' no-slip constraint eliminated by V,

    m v' - m a w^2   = (tau_r + tau_l) / r   - F_d          (16)
    I w' + m a v w   = b (tau_r - tau_l) / r - tau_d,       I = I_c + m a^2

with mass m, inertia I_c about the centre of mass, which lies a ahead of the axle, wheel radius r,
half track b. Where we differ from the print, and why:
- eq. 8 mixes sizes; M(q) multiplies q'' (3), not V' (2).
- the print's g is not gravity but the offset: eq. 9 and 10 put the centre of mass behind the axle
  by it, eq. 16 ahead of it. We take it ahead, as 16, in all of them, and call it a.
- eq. 11 turns clockwise for b > 0 with (tau_l, tau_r); we order (tau_r, tau_l), so ccw is positive.
- [F_d, tau_d] is what friction takes: constant (Coulomb) and growing (viscous) parts.
"""

from __future__ import annotations

from math import ceil, cos, sin, sqrt

import msgspec

from swarm.geometry import STILL, Pose, Twist, wrap_angle
from swarm.scenario import RobotParameters

# Period of the wheel loop, and the integrator's longest step: 100 Hz is a slow motor controller.
# With velocity_gain_1ps <= 100 the loop takes away at most the whole error in one period.
PERIOD_S_MAX = 0.01
# Coulomb friction rises linearly up to about this slip: it is not defined at rest.
SLIP_MPS = 0.01
SLIP_RADPS = 0.05
# Slower than this with nothing asked for, a body stands: static friction.
REST_MPS = 1e-4
REST_RADPS = 1e-3


class Torques(msgspec.Struct, frozen=True, array_like=True):
    """What the motors do to the wheels, positive forward."""

    right_nm: float
    left_nm: float


def step(
    robot: RobotParameters, pose: Pose, twist: Twist, asked: Twist, *, dt_s: float
) -> tuple[Pose, Twist]:
    """Pose and twist after one tick in which the wheel loop steers for the twist asked for.

    Equal periods of at most PERIOD_S_MAX; in each the torques are held, as a motor controller
    does, and eq. 16 is integrated by one linearly implicit midpoint step: second order, stable for
    any parameters. With the default ones the twist after a tick of 0.08 s is within 2e-4 m/s and
    2e-3 rad/s, and the position within 3e-5 m, of the exact solution under the same torque law.
    """
    periods = ceil(dt_s / PERIOD_S_MAX - 1e-9)
    period_s = dt_s / periods
    x_m, y_m, yaw_rad = pose.x_m, pose.y_m, pose.yaw_rad
    for _ in range(periods):
        mean = mean_twist(robot, twist, wheel_torques(robot, twist, asked), period_s)
        # The arc's chord, taken as long as the arc: too long by turn^2 / 24, 3e-5 at 2.5 rad/s.
        turn_rad = mean.turn_rate_radps * period_s
        chord_m = mean.speed_mps * period_s
        x_m += chord_m * cos(yaw_rad + 0.5 * turn_rad)
        y_m += chord_m * sin(yaw_rad + 0.5 * turn_rad)
        yaw_rad += turn_rad
        twist = after(twist, mean)
    if asked == STILL and is_at_rest(twist):
        twist = STILL
    return Pose(x_m, y_m, wrap_angle(yaw_rad)), twist


def wheel_torques(robot: RobotParameters, twist: Twist, asked: Twist) -> Torques:
    """Computed torque: eq. 16 solved for the torques, each wheel cut at what its motor can do.

    The acceleration wanted is the error over the loop's lag. The loop knows masses, not friction:
    that is the disturbance, and costs friction / (m gain) of speed.
    """
    gain_1ps, mass_kg = robot.velocity_gain_1ps, robot.mass_kg
    speed_mps, turn_rate_radps = twist.speed_mps, twist.turn_rate_radps
    coriolis_kgps = mass_kg * robot.mass_offset_m * turn_rate_radps
    force_n = mass_kg * gain_1ps * (asked.speed_mps - speed_mps) - coriolis_kgps * turn_rate_radps
    moment_nm = (
        axle_inertia_kgm2(robot) * gain_1ps * (asked.turn_rate_radps - turn_rate_radps)
        + coriolis_kgps * speed_mps
    )
    shared_nm = 0.5 * robot.wheel_radius_m * force_n
    opposed_nm = 0.5 * robot.wheel_radius_m * moment_nm / robot.half_track_m
    limit_nm = robot.wheel_torque_nm_max
    right_nm, left_nm = shared_nm + opposed_nm, shared_nm - opposed_nm
    return Torques(
        limit_nm if right_nm > limit_nm else -limit_nm if right_nm < -limit_nm else right_nm,
        limit_nm if left_nm > limit_nm else -limit_nm if left_nm < -limit_nm else left_nm,
    )


def acceleration(robot: RobotParameters, twist: Twist, torques: Torques) -> tuple[float, float]:
    """(v', w') of eq. 16 in m/s^2 and rad/s^2."""
    force_n, moment_nm = drive(robot, torques)
    speed_mps, turn_rate_radps = twist.speed_mps, twist.turn_rate_radps
    drag_nspm, drag_nms = drag(robot, speed_mps, turn_rate_radps)
    coriolis_kgps = robot.mass_kg * robot.mass_offset_m * turn_rate_radps
    return (
        (force_n + coriolis_kgps * turn_rate_radps - drag_nspm * speed_mps) / robot.mass_kg,
        (moment_nm - coriolis_kgps * speed_mps - drag_nms * turn_rate_radps)
        / axle_inertia_kgm2(robot),
    )


def mean_twist(robot: RobotParameters, twist: Twist, torques: Torques, duration_s: float) -> Twist:
    """Mean of the twists before and after a time under constant torques; see `after`.

    The midpoint rule for eq. 16 with Coriolis and friction coefficients frozen at an explicit
    half step, which leaves two linear equations for the mean twist. The frozen Coriolis matrix is
    still skew: it does no work, so the kinetic energy changes by exactly the torques' work on the
    mean twist less the friction's, whatever the step.
    """
    mass_kg, inertia_kgm2 = robot.mass_kg, axle_inertia_kgm2(robot)
    force_n, moment_nm = drive(robot, torques)
    change_mps2, change_radps2 = acceleration(robot, twist, torques)
    middle_mps = twist.speed_mps + 0.5 * duration_s * change_mps2
    middle_radps = twist.turn_rate_radps + 0.5 * duration_s * change_radps2
    drag_nspm, drag_nms = drag(robot, middle_mps, middle_radps)
    # 2 m / h (mean_v - v) = F + c mean_w - drag mean_v;  2 I / h (mean_w - w) = T - c mean_v - ..
    coupling = mass_kg * robot.mass_offset_m * middle_radps
    inert_kgps = 2.0 * mass_kg / duration_s
    inert_kgm2ps = 2.0 * inertia_kgm2 / duration_s
    along, around = inert_kgps + drag_nspm, inert_kgm2ps + drag_nms
    push_n = force_n + inert_kgps * twist.speed_mps
    push_nm = moment_nm + inert_kgm2ps * twist.turn_rate_radps
    scale = 1.0 / (along * around + coupling * coupling)
    return Twist(
        scale * (around * push_n + coupling * push_nm),
        scale * (along * push_nm - coupling * push_n),
    )


def after(before: Twist, mean: Twist) -> Twist:
    """Twist at the end of a time, from that at its begin and the mean of both."""
    return Twist(
        2.0 * mean.speed_mps - before.speed_mps,
        2.0 * mean.turn_rate_radps - before.turn_rate_radps,
    )


def drive(robot: RobotParameters, torques: Torques) -> tuple[float, float]:
    """Force along the heading (N) and moment about the axle's centre (N m): B tau of eq. 15."""
    return (
        (torques.right_nm + torques.left_nm) / robot.wheel_radius_m,
        robot.half_track_m * (torques.right_nm - torques.left_nm) / robot.wheel_radius_m,
    )


def drag(robot: RobotParameters, speed_mps: float, turn_rate_radps: float) -> tuple[float, float]:
    """F_d / v (N s/m) and tau_d / w (N m s) of eq. 16: viscous plus Coulomb friction.

    Coulomb's sign is v / sqrt(v^2 + slip^2), so both are finite and positive at any speed.
    """
    slip_mps = sqrt(speed_mps * speed_mps + SLIP_MPS * SLIP_MPS)
    slip_radps = sqrt(turn_rate_radps * turn_rate_radps + SLIP_RADPS * SLIP_RADPS)
    return (
        robot.rolling_damping_nspm + robot.rolling_friction_n / slip_mps,
        robot.turning_damping_nms + robot.turning_friction_nm / slip_radps,
    )


def axle_inertia_kgm2(robot: RobotParameters) -> float:
    """I of eq. 9: about the axle's centre."""
    return robot.inertia_kgm2 + robot.mass_kg * robot.mass_offset_m * robot.mass_offset_m


def kinetic_energy_j(robot: RobotParameters, twist: Twist) -> float:
    """Half of V' M V, with the reduced inertia matrix diag(m, I) of eq. 15."""
    speed_mps, turn_rate_radps = twist.speed_mps, twist.turn_rate_radps
    return 0.5 * (
        robot.mass_kg * speed_mps * speed_mps
        + axle_inertia_kgm2(robot) * turn_rate_radps * turn_rate_radps
    )


def is_at_rest(twist: Twist) -> bool:
    """Whether a body that is not driven stands."""
    return abs(twist.speed_mps) < REST_MPS and abs(twist.turn_rate_radps) < REST_RADPS
