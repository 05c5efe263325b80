"""From a set-point to where the body is one tick later, were it alone in the world.

set-point -> speed and turn-rate limits -> acceleration limits -> wheel rims -> reached twist
    kinematic   ideal wheels: it has that twist at once, and goes an exact arc
    dynamic     it is what the wheel loop steers for: world.dynamics
"""

from __future__ import annotations

from swarm.geometry import STILL, Pose, Twist, advance
from swarm.messages import Wheels
from swarm.scenario import RobotParameters
from world import dynamics


def step(
    robot: RobotParameters,
    pose: Pose,
    twist: Twist,
    set_point: Twist,
    *,
    dt_s: float,
    speed_factor: float = 1.0,
) -> tuple[Pose, Twist]:
    """Pose and twist after one tick under a set-point.

    With ideal wheels the new twist is reached at once and held for the tick (the paper's 0.08 m
    step is this at 1 m/s), so the way is the exact arc of eq. 7.

    Args:
        twist: of the body, and so is the twist returned.
        speed_factor: of the body's speeds over those that its wheels believe in, as wheels that
            are larger than they should be have it. Limits are the wheels'.
    """
    if set_point == STILL and twist == STILL:
        return pose, twist
    reached = limited(robot, scaled(twist, 1.0 / speed_factor), set_point, dt_s=dt_s)
    reached = scaled(reached, speed_factor)
    if robot.motion == "dynamic":
        return dynamics.step(robot, pose, twist, reached, dt_s=dt_s)
    return advance(pose, reached, dt_s), reached


def limited(robot: RobotParameters, twist: Twist, set_point: Twist, *, dt_s: float) -> Twist:
    """The twist an ideal body reaches within one tick, and the most a real one is asked for.

    The rims come last and scale both parts, which keeps the path's curvature: no wheel ever
    exceeds its speed, and what this takes away only brakes, at worst by the acceleration limit of
    the axle plus that of a rim on top of the body's own.
    """
    speed_mps = _clip(set_point.speed_mps, -robot.speed_mps_reverse_max, robot.speed_mps_max)
    turn_rate_radps = _clip(
        set_point.turn_rate_radps, -robot.turn_rate_radps_max, robot.turn_rate_radps_max
    )
    change_mps = robot.acceleration_mps2_max * dt_s
    change_radps = robot.turn_acceleration_radps2_max * dt_s
    speed_mps = _clip(speed_mps, twist.speed_mps - change_mps, twist.speed_mps + change_mps)
    turn_rate_radps = _clip(
        turn_rate_radps,
        twist.turn_rate_radps - change_radps,
        twist.turn_rate_radps + change_radps,
    )
    rim_mps = abs(speed_mps) + robot.half_track_m * abs(turn_rate_radps)
    if rim_mps > robot.speed_mps_max:
        scale = robot.speed_mps_max / rim_mps
        return Twist(speed_mps * scale, turn_rate_radps * scale)
    return Twist(speed_mps, turn_rate_radps)


def scaled(twist: Twist, factor: float) -> Twist:
    """So many times as fast, along the same curve."""
    if factor == 1.0:
        return twist
    return Twist(factor * twist.speed_mps, factor * twist.turn_rate_radps)


def wheels(robot: RobotParameters, twist: Twist) -> Wheels:
    """Rim speeds of a twist: the inverse of eq. 1 and 2, with the sign of 2 that makes ccw > 0."""
    rim_mps = robot.half_track_m * twist.turn_rate_radps
    return Wheels(twist.speed_mps + rim_mps, twist.speed_mps - rim_mps)


def _clip(value: float, low: float, high: float) -> float:
    return low if value < low else high if value > high else value
