"""From a force to a set-point.

    force --head--> (v, omega) --slew--> --scale_to_rims--> set-point

The paper has no heading controller; all of this is ours.
"""

from __future__ import annotations

from math import atan2, cos

import msgspec

from swarm.geometry import Twist, Vec2, wrap_angle
from swarm.messages import Forces, Mode, Reason
from swarm.scenario import Robot, Steering


class Wish(msgspec.Struct, frozen=True):
    """What a mode asks for, before limits and guards."""

    mode: Mode
    speed_mps: float = 0.0
    turn_rate_radps: float = 0.0
    arrived: bool = False
    forces: Forces = Forces()
    waypoint: Vec2 | None = None  # world
    error: Vec2 = (0.0, 0.0)  # e of eq. 47: m, rad
    saturated: bool = False  # it asked for more than the robot's limits
    reason: Reason = ""  # of FAILED

    def direction_rad(self, yaw_rad: float) -> float:
        """World direction of the resultant force, the heading where there is none."""
        x, y = self.forces.resultant
        return atan2(y, x) if (x, y) != (0.0, 0.0) else yaw_rad


def head(
    steering: Steering, robot: Robot, force: Vec2, yaw_rad: float, speed_mps: float
) -> tuple[float, float]:
    """(v, omega) that turns to the force and drives with `speed_mps` once it looks that way."""
    error_rad = wrap_angle(atan2(force[1], force[0]) - yaw_rad)
    turn_rate_radps = clip(steering.heading_gain_1ps * error_rad, robot.turn_rate_radps_max)
    return (speed_mps * max(0.0, cos(error_rad)), turn_rate_radps)


def slew(
    robot: Robot, measured: Twist, speed_mps: float, turn_rate_radps: float, dt_s: float
) -> Twist:
    """Nearest twist that the body can reach within a tick from the one it has; what it can reach
    comes back bit for bit, so that a change means a limit.
    """
    change_mps = robot.acceleration_mps2_max * dt_s
    change_radps = robot.turn_acceleration_radps2_max * dt_s
    v_mps, w_radps = measured.speed_mps, measured.turn_rate_radps
    return Twist(
        max(v_mps - change_mps, min(v_mps + change_mps, speed_mps)),
        max(w_radps - change_radps, min(w_radps + change_radps, turn_rate_radps)),
    )


def scale_to_rims(robot: Robot, twist: Twist) -> Twist:
    """Same curve, slowed until no wheel exceeds its rim speed: v_r, v_l = v +- b omega (eq. 7)."""
    fastest_mps = abs(twist.speed_mps) + robot.half_track_m * abs(twist.turn_rate_radps)
    if fastest_mps <= robot.speed_mps_max:
        return twist
    scale = robot.speed_mps_max / fastest_mps
    return Twist(twist.speed_mps * scale, twist.turn_rate_radps * scale)


def clip(value: float, bound: float) -> float:
    """Value within [-bound, bound]."""
    return max(-bound, min(bound, value))
