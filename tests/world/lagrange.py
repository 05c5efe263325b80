"""Slow second opinion on eq. 8 to 16: the whole q = (x, y, theta) with the constraint's force.

The body is two particles of half the mass, level with the centre of mass, so that nothing here
depends on a formula of the paper; the matrices of eq. 8 to 11 stand beside it, adopted and printed.
"""

from __future__ import annotations

from math import cos, sin, sqrt

import numpy as np

from swarm.geometry import Floats, Pose, Twist
from swarm.scenario import RobotParameters
from world import dynamics
from world.dynamics import Torques


def kinematic_matrix(yaw_rad: float) -> Floats:
    """S of eq. 7: q' = S V."""
    return np.array([[cos(yaw_rad), 0.0], [sin(yaw_rad), 0.0], [0.0, 1.0]])


def kinematic_matrix_rate(yaw_rad: float, turn_rate_radps: float) -> Floats:
    """S' of eq. 12."""
    return turn_rate_radps * np.array([[-sin(yaw_rad), 0.0], [cos(yaw_rad), 0.0], [0.0, 0.0]])


def constraint(yaw_rad: float) -> Floats:
    """A of eq. 8: A q' = 0, no slip sideways."""
    return np.array([-sin(yaw_rad), cos(yaw_rad), 0.0])


def inertia(robot: RobotParameters, yaw_rad: float, offset_m: float) -> Floats:
    """M of eq. 9 with the centre of mass ahead; the print is this with offset_m = -g."""
    m, s, c = robot.mass_kg, sin(yaw_rad), cos(yaw_rad)
    about_axle = robot.inertia_kgm2 + m * offset_m**2
    side, along = -m * offset_m * s, m * offset_m * c
    return np.array([[m, 0.0, side], [0.0, m, along], [side, along, about_axle]])


def coriolis(
    robot: RobotParameters, yaw_rad: float, turn_rate_radps: float, offset_m: float
) -> Floats:
    """V_m of eq. 10 with the centre of mass ahead; the print is this with offset_m = -g."""
    matrix = np.zeros((3, 3))
    matrix[:, 2] = -robot.mass_kg * offset_m * turn_rate_radps
    matrix[:, 2] *= [cos(yaw_rad), sin(yaw_rad), 0.0]
    return matrix


def input_matrix(robot: RobotParameters, yaw_rad: float) -> Floats:
    """B of eq. 11, as printed: its columns must be (right, left)."""
    b, c, s = robot.half_track_m, cos(yaw_rad), sin(yaw_rad)
    return np.array([[c, c], [s, s], [b, -b]]) / robot.wheel_radius_m


def particles(
    robot: RobotParameters, yaw_rad: float, turn_rate_radps: float
) -> tuple[Floats, Floats]:
    """Inertia matrix and velocity forces (3,) of two particles m/2 at (a, +-sqrt(I_c / m))."""
    matrix, forces = np.zeros((3, 3)), np.zeros(3)
    for side in (1.0, -1.0):
        ahead_m = robot.mass_offset_m
        left_m = side * sqrt(robot.inertia_kgm2 / robot.mass_kg)
        x_m = ahead_m * cos(yaw_rad) - left_m * sin(yaw_rad)
        y_m = ahead_m * sin(yaw_rad) + left_m * cos(yaw_rad)
        jacobian = np.array([[1.0, 0.0, -y_m], [0.0, 1.0, x_m]])
        centripetal = -(turn_rate_radps**2) * np.array([x_m, y_m])
        matrix += robot.mass_kg / 2.0 * jacobian.T @ jacobian
        forces += robot.mass_kg / 2.0 * jacobian.T @ centripetal
    return matrix, forces


def rates(robot: RobotParameters, state: Floats, torques: Torques) -> Floats:
    """Derivative of (q, q', work of the torques): eq. 8 and (A q')' = 0 as one 4 x 4 system."""
    yaw_rad, turn_rate_radps = state[2], state[5]
    row = constraint(yaw_rad)
    speed_mps = state[3] * cos(yaw_rad) + state[4] * sin(yaw_rad)
    drag_nspm, drag_nms = dynamics.drag(robot, speed_mps, turn_rate_radps)
    friction = kinematic_matrix(yaw_rad) @ [drag_nspm * speed_mps, drag_nms * turn_rate_radps]
    push = input_matrix(robot, yaw_rad) @ [torques.right_nm, torques.left_nm]
    matrix, forces = particles(robot, yaw_rad, turn_rate_radps)
    whole = np.block([[matrix, row[:, None]], [row[None, :], np.zeros((1, 1))]])
    row_rate = -turn_rate_radps * np.array([cos(yaw_rad), sin(yaw_rad), 0.0])
    right = np.append(push - friction - forces, -row_rate @ state[3:6])
    power_w = (push - friction) @ state[3:6]
    return np.concatenate([state[3:6], np.linalg.solve(whole, right)[:3], [power_w]])


def roll(
    robot: RobotParameters, pose: Pose, twist: Twist, torques: Torques, duration_s: float
) -> tuple[Pose, Twist, float]:
    """Pose, twist and net work (J) after a time under constant torques: 8 steps of RK4."""
    velocity = kinematic_matrix(pose.yaw_rad) @ [twist.speed_mps, twist.turn_rate_radps]
    state = np.array([pose.x_m, pose.y_m, pose.yaw_rad, *velocity, 0.0])
    h = duration_s / 8
    for _ in range(8):
        first = rates(robot, state, torques)
        second = rates(robot, state + h / 2.0 * first, torques)
        third = rates(robot, state + h / 2.0 * second, torques)
        fourth = rates(robot, state + h * third, torques)
        state = state + h / 6.0 * (first + 2.0 * second + 2.0 * third + fourth)
    x_m, y_m, yaw_rad, x_mps, y_mps, turn_rate_radps, work_j = state.tolist()
    speed_mps = x_mps * cos(yaw_rad) + y_mps * sin(yaw_rad)
    return Pose(x_m, y_m, yaw_rad), Twist(speed_mps, turn_rate_radps), work_j
