"""Torques to twist to pose: eq. 8 to 16 by hand, by matrices, and against the whole Lagrangian."""

from __future__ import annotations

from math import atanh, ceil, pi, sqrt, tanh

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm.geometry import STILL, Pose, Twist, distance, wrap_angle
from swarm.scenario import RobotParameters
from tests.world import lagrange
from world import dynamics, motion
from world.dynamics import Torques

DT_S = 0.08
PERIOD_S = dynamics.PERIOD_S_MAX
ORIGIN = Pose(0.0, 0.0, 0.0)
# 12 kg, I = 0.28 + 12 * 0.05^2 = 0.31 kg m^2, half track 0.17 m, wheels of 0.12 m, 3 N m, 40 1/s
ROBOT = RobotParameters(motion="dynamic")
SMOOTH = msgspec.structs.replace(  # without friction
    ROBOT,
    rolling_friction_n=0.0,
    rolling_damping_nspm=0.0,
    turning_friction_nm=0.0,
    turning_damping_nms=0.0,
)
LOOSE = Torques(0.0, 0.0)


def bounded(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high, allow_subnormal=False)


twists = st.builds(Twist, bounded(-1.5, 1.5), bounded(-4.0, 4.0))
torque_pairs = st.builds(Torques, bounded(-3.0, 3.0), bounded(-3.0, 3.0))
smooth_robots = st.builds(
    lambda mass_kg, inertia_kgm2, offset_m: msgspec.structs.replace(
        SMOOTH, mass_kg=mass_kg, inertia_kgm2=inertia_kgm2, mass_offset_m=offset_m
    ),
    bounded(1.0, 50.0),
    bounded(0.02, 5.0),
    bounded(-0.3, 0.3),
)


# --- the equations --------------------------------------------------------------------------------


@given(smooth_robots, bounded(-pi, 3.14), twists, torque_pairs)
def test_acceleration_is_the_reduction_of_the_three_by_three_form(
    robot: RobotParameters, yaw_rad: float, twist: Twist, torques: Torques
) -> None:
    # Eq. 14 and 15: S'M S V' + (S'M S_rate + S'V_m S) V = S'B tau.
    turning, a = twist.turn_rate_radps, robot.mass_offset_m
    s = lagrange.kinematic_matrix(yaw_rad)
    s_rate = lagrange.kinematic_matrix_rate(yaw_rad, turning)
    m = lagrange.inertia(robot, yaw_rad, a)
    reduced_m = s.T @ m @ s
    reduced_c = s.T @ m @ s_rate + s.T @ lagrange.coriolis(robot, yaw_rad, turning, a) @ s
    reduced_b = s.T @ lagrange.input_matrix(robot, yaw_rad)
    v = np.array([twist.speed_mps, turning])
    assert reduced_m == pytest.approx(
        np.diag([robot.mass_kg, dynamics.axle_inertia_kgm2(robot)]), abs=1e-12
    )
    assert v @ reduced_c @ v == pytest.approx(0.0, abs=1e-9)  # Coriolis does no work
    assert lagrange.constraint(yaw_rad) @ s == pytest.approx(0.0, abs=1e-15)  # lambda drops out
    push = reduced_b @ [torques.right_nm, torques.left_nm]
    assert dynamics.drive(robot, torques) == pytest.approx(push, abs=1e-9)
    expected = np.linalg.solve(reduced_m, push - reduced_c @ v)
    found = dynamics.acceleration(robot, twist, torques)
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-9)


@given(smooth_robots, bounded(-pi, 3.14), bounded(-4.0, 4.0))
def test_inertia_and_coriolis_are_those_of_particles_ahead_of_the_axle(
    robot: RobotParameters, yaw_rad: float, turning: float
) -> None:
    a = robot.mass_offset_m
    matrix, forces = lagrange.particles(robot, yaw_rad, turning)
    assert lagrange.inertia(robot, yaw_rad, a) == pytest.approx(matrix, abs=1e-9)
    velocity = np.array([0.7, -0.2, turning])
    found = lagrange.coriolis(robot, yaw_rad, turning, a) @ velocity
    assert found == pytest.approx(forces, abs=1e-9)


def test_printed_9_and_16_contradict_each_other_in_the_sign_of_the_offset() -> None:
    # Both with g = 0.05, the mass ahead, at v = 1 m/s, w = 2 rad/s and no torques.
    g, yaw_rad, turning = 0.05, 0.4, 2.0
    v = np.array([1.0, turning])
    s = lagrange.kinematic_matrix(yaw_rad)
    s_rate = lagrange.kinematic_matrix_rate(yaw_rad, turning)
    m = lagrange.inertia(ROBOT, yaw_rad, -g)  # eq. 9 and 10 as printed
    c = lagrange.coriolis(ROBOT, yaw_rad, turning, -g)
    from_9 = np.linalg.solve(s.T @ m @ s, -(s.T @ m @ s_rate + s.T @ c @ s) @ v)
    printed_16 = np.array([[0.0, 12.0 * g * turning], [-12.0 * g * turning, 0.0]])
    from_16 = np.linalg.solve(np.diag([12.0, 0.31]), printed_16 @ v)
    # Thrown outwards, a mass ahead pulls the body on, and straight: v' = a w^2, w' < 0.
    assert from_16 == pytest.approx([0.05 * 4.0, -12.0 * 0.05 * 1.0 * 2.0 / 0.31])
    assert from_9 == pytest.approx(-from_16)
    matrix, forces = lagrange.particles(ROBOT, yaw_rad, turning)
    by_particles = np.linalg.solve(s.T @ matrix @ s, -s.T @ (matrix @ s_rate @ v + forces))
    assert by_particles == pytest.approx(from_16)
    found = dynamics.acceleration(SMOOTH, Twist(1.0, turning), LOOSE)
    assert found == pytest.approx(tuple(from_16))


def test_printed_11_turns_the_wrong_way_when_the_left_wheel_comes_first() -> None:
    right_only = Torques(1.0, 0.0)
    forwards = lagrange.input_matrix(ROBOT, 0.0)
    assert (forwards @ [0.0, 1.0])[2] < 0.0  # (tau_l, tau_r): the right wheel turns it clockwise
    assert (forwards @ [1.0, 0.0])[2] > 0.0
    assert dynamics.acceleration(SMOOTH, STILL, right_only)[1] > 0.0


def test_acceleration_is_torque_over_radius_and_mass_when_straight() -> None:
    # (1.2 + 1.2) N m / 0.12 m / 12 kg; opposed: 0.17 m * 1.24 N m / 0.12 m / 0.31 kg m^2
    assert dynamics.acceleration(SMOOTH, STILL, Torques(1.2, 1.2)) == pytest.approx((5.0 / 3.0, 0))
    turned = dynamics.acceleration(SMOOTH, STILL, Torques(0.62, -0.62))
    assert turned == pytest.approx((0.0, 17.0 / 3.0))
    # Friction at 2 m/s: 1.2 + 1 * 2 N of 20 N remain to push 12 kg.
    rolling = dynamics.acceleration(ROBOT, Twist(2.0, 0.0), Torques(1.2, 1.2))
    assert rolling[0] == pytest.approx((20.0 - 3.2) / 12.0, abs=1e-5)
    # At 2 rad/s: 0.1 + 0.05 * 2 N m against the turn, 0.05 m * 2^2 / s^2 along the heading.
    turning = dynamics.acceleration(ROBOT, Twist(0.0, 2.0), LOOSE)
    assert turning == pytest.approx((0.2, -0.2 / 0.31), abs=1e-3)


# --- the integrator -------------------------------------------------------------------------------


@given(smooth_robots, twists)
def test_mean_twist_keeps_the_energy_when_a_body_rolls_freely(
    robot: RobotParameters, twist: Twist
) -> None:
    before_j = dynamics.kinetic_energy_j(robot, twist)
    for _ in range(50):
        twist = dynamics.after(twist, dynamics.mean_twist(robot, twist, LOOSE, PERIOD_S))
    assert dynamics.kinetic_energy_j(robot, twist) == pytest.approx(before_j, rel=1e-12)


def test_mean_twist_follows_the_closed_solution_of_free_rolling_to_second_order() -> None:
    # v' = a w^2 and the energy give v' = (m a / I) (V^2 - v^2), V^2 = 2 E / m:
    # v = V tanh(m a V t / I + atanh(v0 / V)): a mass ahead straightens the way.
    start = Twist(0.4, 2.5)
    top_mps = sqrt(0.4**2 + 0.31 / 12.0 * 2.5**2)
    speed_mps = top_mps * tanh(12.0 * 0.05 * top_mps / 0.31 + atanh(0.4 / top_mps))
    errors_mps = []
    for steps in (25, 50, 100):
        twist = start
        for _ in range(steps):
            twist = dynamics.after(twist, dynamics.mean_twist(SMOOTH, twist, LOOSE, 1.0 / steps))
        errors_mps.append(abs(twist.speed_mps - speed_mps))
    assert errors_mps[2] < 1e-5
    assert errors_mps[0] / errors_mps[1] == pytest.approx(4.0, rel=0.1)
    assert errors_mps[1] / errors_mps[2] == pytest.approx(4.0, rel=0.1)


@given(twists, torque_pairs)
def test_mean_twist_gains_the_work_of_the_torques_less_that_of_friction(
    twist: Twist, torques: Torques
) -> None:
    viscous = msgspec.structs.replace(SMOOTH, rolling_damping_nspm=8.0, turning_damping_nms=0.4)
    for robot, lost_w in ((SMOOTH, (0.0, 0.0)), (viscous, (8.0, 0.4))):
        mean = dynamics.mean_twist(robot, twist, torques, PERIOD_S)
        end = dynamics.after(twist, mean)
        force_n, moment_nm = dynamics.drive(robot, torques)
        power_w = force_n * mean.speed_mps + moment_nm * mean.turn_rate_radps
        power_w -= lost_w[0] * mean.speed_mps**2 + lost_w[1] * mean.turn_rate_radps**2
        gained_j = dynamics.kinetic_energy_j(robot, end) - dynamics.kinetic_energy_j(robot, twist)
        assert gained_j == pytest.approx(power_w * PERIOD_S, abs=1e-11)


def test_step_keeps_its_error_bound_against_the_whole_lagrangian() -> None:
    random = np.random.default_rng(2)
    for _ in range(16):
        now = twist = Twist(random.uniform(-0.4, 1.0), random.uniform(-2.5, 2.5))
        change = random.uniform(-0.32, 0.32), random.uniform(-0.96, 0.96)
        asked = Twist(twist.speed_mps + change[0], twist.turn_rate_radps + change[1])
        start = pose = Pose(1.0, -2.0, random.uniform(-pi, pi))
        work_j = 0.0
        for _ in range(ceil(DT_S / PERIOD_S)):
            torques = dynamics.wheel_torques(ROBOT, now, asked)
            pose, now, gained_j = lagrange.roll(ROBOT, pose, now, torques, PERIOD_S)
            work_j += gained_j
        found_pose, found = dynamics.step(ROBOT, start, twist, asked, dt_s=DT_S)
        assert abs(found.speed_mps - now.speed_mps) < 2e-4
        assert abs(found.turn_rate_radps - now.turn_rate_radps) < 2e-3
        assert distance(found_pose, pose) < 3e-5
        assert abs(wrap_angle(found_pose.yaw_rad - pose.yaw_rad)) < 1e-4
        # The energy balance, with a work that the core has no part in.
        gained_j = dynamics.kinetic_energy_j(ROBOT, found)
        gained_j -= dynamics.kinetic_energy_j(ROBOT, twist)
        assert abs(gained_j - work_j) < 1e-3


def mirrored(twist: Twist) -> Twist:
    return Twist(twist.speed_mps, -twist.turn_rate_radps)


@given(bounded(-3.0, 3.0), twists, twists)
def test_step_mirrors_to_the_bit_when_everything_does(
    yaw_rad: float, twist: Twist, asked: Twist
) -> None:
    pose, reached = dynamics.step(ROBOT, Pose(0.5, 0.7, yaw_rad), twist, asked, dt_s=DT_S)
    other_pose, other = dynamics.step(
        ROBOT, Pose(0.5, -0.7, -yaw_rad), mirrored(twist), mirrored(asked), dt_s=DT_S
    )
    assert other_pose == Pose(pose.x_m, -pose.y_m, -pose.yaw_rad)
    assert other == mirrored(reached)


magnitudes = bounded(-2.0, 4.0).map(lambda exponent: 10.0**exponent)


@given(
    st.builds(
        RobotParameters,
        mass_kg=magnitudes,
        inertia_kgm2=bounded(-6.0, 4.0).map(lambda exponent: 10.0**exponent),
        mass_offset_m=bounded(-10.0, 10.0),
        wheel_torque_nm_max=magnitudes,
        velocity_gain_1ps=bounded(0.01, 100.0),
        rolling_friction_n=magnitudes,
        rolling_damping_nspm=magnitudes,
        turning_friction_nm=magnitudes,
        turning_damping_nms=magnitudes,
    ),
    twists,
    twists,
)
def test_step_never_gains_more_than_the_motors_can_give_whatever_the_body(
    robot: RobotParameters, twist: Twist, asked: Twist
) -> None:
    for _ in range(5):
        before_j = dynamics.kinetic_energy_j(robot, twist)
        _, twist = dynamics.step(robot, ORIGIN, twist, asked, dt_s=PERIOD_S)
        # sqrt(E) rises by at most force / sqrt(2 m) and moment / sqrt(2 I) per second.
        force_n = 2.0 * robot.wheel_torque_nm_max / robot.wheel_radius_m
        inertia_kgm2 = dynamics.axle_inertia_kgm2(robot)
        rise = PERIOD_S * (
            force_n / sqrt(2.0 * robot.mass_kg)
            + robot.half_track_m * force_n / sqrt(2.0 * inertia_kgm2)
        )
        after_j = dynamics.kinetic_energy_j(robot, twist)
        assert sqrt(after_j) <= sqrt(before_j) * (1.0 + 1e-9) + rise


# --- the wheel loop -------------------------------------------------------------------------------


@given(twists, twists)
def test_wheel_torques_stay_within_the_motors_limit(twist: Twist, asked: Twist) -> None:
    torques = dynamics.wheel_torques(ROBOT, twist, asked)
    assert max(abs(torques.right_nm), abs(torques.left_nm)) <= 3.0


def test_step_is_limited_by_the_torque_when_much_is_asked_for() -> None:
    # 6 N m / 0.12 m / 12 kg = 25/6 m/s^2 in the one period; the loop asks for 40 * 1 m/s^2.
    _, reached = dynamics.step(SMOOTH, ORIGIN, STILL, Twist(1.0, 0.0), dt_s=PERIOD_S)
    assert reached.speed_mps == pytest.approx(25.0 / 600.0)
    weak = msgspec.structs.replace(SMOOTH, wheel_torque_nm_max=1.0)
    _, reached = dynamics.step(weak, ORIGIN, STILL, Twist(1.0, 0.0), dt_s=DT_S)
    assert reached.speed_mps == pytest.approx(25.0 / 18.0 * DT_S)


def test_wheel_torques_take_away_the_gains_part_of_the_error() -> None:
    # 40 1/s for 10 ms: 0.6 of the error is left; eight periods in the tick.
    _, reached = dynamics.step(SMOOTH, ORIGIN, STILL, Twist(0.05, 0.0), dt_s=DT_S)
    assert reached.speed_mps == pytest.approx(0.05 * (1.0 - 0.6**8))


def test_step_lags_by_friction_over_mass_and_gain_when_steady() -> None:
    pose, twist = ORIGIN, STILL
    for _ in range(40):
        pose, twist = dynamics.step(ROBOT, pose, twist, Twist(0.6, 0.0), dt_s=DT_S)
    # 12 * 40 * (0.6 - v) = 1.2 + 1.0 v
    assert twist.speed_mps == pytest.approx((480.0 * 0.6 - 1.2) / 481.0, abs=1e-6)
    assert twist.turn_rate_radps == 0.0


def ideal(robot: RobotParameters) -> RobotParameters:
    return msgspec.structs.replace(robot, motion="kinematic")


def test_motion_comes_to_the_kinematic_one_when_torque_and_gain_are_plenty() -> None:
    set_points = [Twist(0.8, 0.5), Twist(0.9, -1.0), Twist(0.3, -2.0), Twist(-0.2, 0.4), STILL]
    apart_m = []
    for gain_1ps in (25.0, 50.0, 100.0):
        robot = msgspec.structs.replace(SMOOTH, wheel_torque_nm_max=1e3, velocity_gain_1ps=gain_1ps)
        real, wanted, worst_m = (ORIGIN, STILL), (ORIGIN, STILL), 0.0
        for set_point in set_points:
            for _ in range(12):
                real = motion.step(robot, *real, set_point, dt_s=DT_S)
                wanted = motion.step(ideal(robot), *wanted, set_point, dt_s=DT_S)
                worst_m = max(worst_m, distance(real[0], wanted[0]))
            assert abs(real[1].speed_mps - wanted[1].speed_mps) < 1e-6
            assert abs(real[1].turn_rate_radps - wanted[1].turn_rate_radps) < 1e-6
        apart_m.append(worst_m)
    # What is left is the way that the loop's lag, 1 / gain, costs.
    assert apart_m[0] > 2.0 * apart_m[1] > 4.0 * apart_m[2]
    assert apart_m[2] < 0.006


def test_motion_is_kinematic_unless_told_otherwise() -> None:
    _, real = motion.step(ROBOT, ORIGIN, STILL, Twist(0.3, 0.0), dt_s=DT_S)
    _, wanted = motion.step(RobotParameters(), ORIGIN, STILL, Twist(0.3, 0.0), dt_s=DT_S)
    assert wanted == Twist(0.3, 0.0)
    assert 0.25 < real.speed_mps < 0.3


@pytest.mark.parametrize("torque_nm", [1.0, 3.0])
def test_motion_stops_within_the_distance_that_guards_plan_for(torque_nm: float) -> None:
    robot = msgspec.structs.replace(ROBOT, wheel_torque_nm_max=torque_nm)
    pose, twist, ticks = ORIGIN, Twist(1.0, 0.0), 0
    while twist != STILL and ticks < 100:
        pose, twist = motion.step(robot, pose, twist, STILL, dt_s=DT_S)
        ticks += 1
    assert twist == STILL  # and not just ever slower
    assert pose.x_m < 1.0 / (2.0 * 1.0)  # v^2 / 2 a at the guards' 1 m/s^2
    assert motion.step(robot, pose, twist, STILL, dt_s=DT_S) == (pose, STILL)
