"""From a force to a set-point, and which way to go between the obstacles.

    force --head--> (v, omega) --slew--> --scale_to_rims--> set-point
    map, goal --choose_direction--> gap

The paper has neither a heading controller nor a choice of gaps; all of this is ours.
"""

from __future__ import annotations

from math import atan2, ceil, cos, inf, sqrt

import msgspec

from agents import msam
from swarm.geometry import TAU, Twist, Vec2, wrap_angle
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


def choose_direction(
    steering: Steering,
    map: msam.Map,
    yaw_rad: float,
    goal_rad: float,
    last_rad: float,
    *,
    clear_m: float,
    look_m: float,
) -> float | None:
    """Free world direction nearest to the goal's, None when all are blocked.

    A sector with something nearer than `look_m` blocks every direction in which a body of
    `clear_m` would touch it. Among the free sectors the cost is the angle to the goal plus a
    share of the angle to the direction chosen last, so that the robot keeps to its gap.

    Args:
        goal_rad, last_rad: world.
        clear_m: body radius plus margin.
    """
    count = len(map.sectors_m)
    sector_rad = TAU / count
    goal_body_rad = wrap_angle(goal_rad - yaw_rad)
    angles = msam.layout(count, count).sector_angles
    goal_is_free = True
    blocked = 0  # one bit per sector, three turns side by side so that no run is cut at the back
    if map.nearest_m < look_m:
        for index in [index for index, range_m in enumerate(map.sectors_m) if range_m < look_m]:
            range_m = map.sectors_m[index]
            half_rad = half_width(clear_m, range_m) + sector_rad / 2.0
            if goal_is_free and abs(wrap_angle(goal_body_rad - angles[index])) < half_rad:
                goal_is_free = False
            aside = ceil(half_rad / sector_rad) - 1
            blocked |= ((1 << (2 * aside + 1)) - 1) << (index - aside + count)
    if goal_is_free:
        return goal_rad
    blocked |= (blocked >> count) | (blocked >> 2 * count)
    last_body_rad = wrap_angle(last_rad - yaw_rad)
    best = inf
    chosen_rad = None
    for index, angle_rad in enumerate(angles):
        if blocked >> index & 1:
            continue
        cost = abs(wrap_angle(angle_rad - goal_body_rad))
        if cost < best:
            cost += steering.gap_memory_weight * abs(wrap_angle(angle_rad - last_body_rad))
            if cost < best:
                best = cost
                chosen_rad = angle_rad
    return None if chosen_rad is None else wrap_angle(chosen_rad + yaw_rad)


def half_width(clear_m: float, range_m: float) -> float:
    """asin(clear / range), a right angle when nearer than that."""
    if range_m <= clear_m:
        return TAU / 4.0
    return atan2(clear_m, sqrt(range_m * range_m - clear_m * clear_m))
