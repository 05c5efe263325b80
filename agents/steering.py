"""From a force to a set-point, and the two decisions that a force field cannot make.

    force --head--> (v, omega) --slew--> --scale_to_rims--> set-point
    map, goal --choose_direction--> gap            (which way between the obstacles)
    progress --remember_rotation--> ROUND          (walk round what the field cannot leave)

The paper gives neither a heading controller nor a way out of a trap; all of this is ours.
"""

from __future__ import annotations

from math import atan2, ceil, cos, inf, sqrt

import msgspec

from agents import field, msam
from swarm import geometry
from swarm.geometry import TAU, Twist, Vec2, wrap_angle
from swarm.messages import Arc, Forces, Mode
from swarm.scenario import Robot, Steering

# A new ROUND this near to the place of the last one tries the other way round.
SAME_PLACE_M = 1.0
# Looking this far to either side of the way along the wall for a corner ahead, ...
CORNER_RAD = 0.45
# ... which is kept off from this distance, as measured from the robot's centre.
CORNER_DISTANCE_M = 1.10
CORNER_PUSH_MAX = 1.5
# Steepness of both pushes, 1/m.
WALL_GAIN_1PM = 2.0
# Leaving ROUND, the way to the goal must be free this far.
LEAVE_LOOK_M = 1.5


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

    def direction_rad(self, yaw_rad: float) -> float:
        """World direction of the resultant force, the heading where there is none."""
        x, y = self.forces.resultant
        return atan2(y, x) if (x, y) != (0.0, 0.0) else yaw_rad


class Rotation(msgspec.Struct, frozen=True):
    """Rotation memory: how long the goal has come no nearer, and the wall that is followed."""

    best_m: float = inf  # nearest to the goal so far
    reference_m: float = inf  # distance from which progress is counted
    stalled_s: float = 0.0
    sense: int = 0  # +1: wall on the right, -1: on the left, 0: not in ROUND
    round_s: float = 0.0
    hit: Vec2 | None = None  # world, where the last ROUND began
    hit_distance_m: float = inf  # from there to the goal
    hit_sense: int = 0


# --- force to set-point -------------------------------------------------------------------------


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


# --- gap choice ---------------------------------------------------------------------------------


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
        for index, range_m in enumerate(map.sectors_m):
            if not range_m < look_m:
                continue
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


# --- rotation memory ----------------------------------------------------------------------------


def remember_rotation(
    steering: Steering,
    memory: Rotation,
    map: msam.Map,
    position: Vec2,
    yaw_rad: float,
    goal_rad: float,
    distance_m: float,
    *,
    clear_m: float,
    waiting: bool,
    elapsed_s: float,
) -> Rotation:
    """Memory after this tick: ROUND begins after a stall, ends when the goal is nearer and free.

    The clock stands while the robot waits for others: it would start to circle them.
    """
    best_m = min(memory.best_m, distance_m)
    if memory.sense != 0:
        round_s = memory.round_s + (0.0 if waiting else elapsed_s)
        done = round_s > steering.round_s_max or not map.clusters
        if distance_m < memory.hit_distance_m - steering.round_leave_m and not done:
            free_rad = choose_direction(
                steering,
                map,
                yaw_rad,
                goal_rad,
                goal_rad,
                clear_m=clear_m,
                look_m=min(distance_m, LEAVE_LOOK_M),
            )
            done = free_rad == goal_rad
        if not done:
            return msgspec.structs.replace(memory, best_m=best_m, round_s=round_s)
        return msgspec.structs.replace(
            memory, best_m=best_m, reference_m=distance_m, stalled_s=0.0, sense=0, round_s=0.0
        )
    if distance_m < memory.reference_m - steering.stall_progress_m:
        return msgspec.structs.replace(memory, best_m=best_m, reference_m=distance_m, stalled_s=0.0)
    stalled_s = memory.stalled_s + (0.0 if waiting else elapsed_s)
    if stalled_s < steering.stall_s or not map.clusters:
        return msgspec.structs.replace(memory, best_m=best_m, stalled_s=stalled_s)
    nearest = min(map.clusters, key=_range_of)
    sense = field.passing_side(wrap_angle(goal_rad - (nearest.bearing_rad + yaw_rad)))
    if memory.hit is not None:
        dx_m, dy_m = position[0] - memory.hit[0], position[1] - memory.hit[1]
        if geometry.length(dx_m, dy_m) < SAME_PLACE_M:
            sense = -memory.hit_sense
    return Rotation(
        best_m=best_m,
        reference_m=memory.reference_m,
        sense=sense,
        hit=position,
        hit_distance_m=best_m,
        hit_sense=sense,
    )


def follow_wall(steering: Steering, map: msam.Map, sense: int, yaw_rad: float) -> Vec2:
    """Direction along the nearest surface, kept at its distance, turned away from corners ahead."""
    angles = msam.layout(len(map.sectors_m), len(map.sectors_m)).sector_angles
    wall_body_rad = angles[map.nearest_index]
    wall_x, wall_y = geometry.unit(wall_body_rad + yaw_rad)
    along_x, along_y = -sense * wall_y, sense * wall_x
    pull = clip(WALL_GAIN_1PM * (map.nearest_m - steering.round_distance_m), 1.0)
    along_body_rad = wall_body_rad + sense * TAU / 4.0
    ahead_m = min(
        [
            range_m
            for range_m, angle_rad in zip(map.sectors_m, angles, strict=True)
            if abs(wrap_angle(angle_rad - along_body_rad)) <= CORNER_RAD
        ]
    )
    if ahead_m < CORNER_DISTANCE_M:
        pull -= min(CORNER_PUSH_MAX, WALL_GAIN_1PM * (CORNER_DISTANCE_M - ahead_m))
    return (along_x + pull * wall_x, along_y + pull * wall_y)


def _range_of(arc: Arc) -> float:
    return arc.range_m
