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
from swarm.messages import Arc, Forces, Mode, Reason
from swarm.scenario import Robot, Steering

# A new ROUND this near to the place of the last one tries the other way round.
SAME_PLACE_M = 1.0
# A lap round something begins within this of the distance kept from it, has been under way once
# the robot was so far from there, and is complete this near to there with the same wall beside it
# (across a narrow corridor it is the other wall).
LAP_REACH_M = 0.15
LAP_AWAY_M = 1.2
LAP_BACK_M = 0.4
LAP_WALL_RAD = 1.0
# Looking this far to either side of the way along the wall for a corner ahead, ...
CORNER_RAD = 0.45
# ... which is kept off from this much further than the wall.
CORNER_BEYOND_M = 0.45
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
    reason: Reason = ""  # of FAILED

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
    round_s: float = 0.0  # in ROUND without coming nearer
    hit: Vec2 | None = None  # world, where the last ROUND began
    hit_distance_m: float = inf  # from there to the goal
    hit_sense: int = 0
    lap: Vec2 | None = None  # world, where it reached the wall that it follows
    lap_wall_rad: float = 0.0  # world, from there to the wall
    lap_away: bool = False  # has been away from there
    laps: int = 0  # completed, one each way
    failed: Reason = ""  # there is no way; for good


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
    keep_m: float,
    waiting: bool,
    elapsed_s: float,
) -> Rotation:
    """Memory after this tick: ROUND begins after a stall, ends when the goal is nearer and free.

    The clock stands while the robot waits for others: it would start to circle them. Once the
    robot has walked round what is in its way, it tries the other way round; after both there is
    no way to the goal, and after the longest time it is taken for that.

    Args:
        goal_rad: world.
        clear_m: body radius plus margin.
        keep_m: distance from the wall that it follows.
    """
    if memory.failed:
        return memory
    best_m = min(memory.best_m, distance_m)
    if memory.sense != 0:
        round_s = memory.round_s + (0.0 if waiting else elapsed_s)
        done = not map.clusters
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
        memory = msgspec.structs.replace(memory, best_m=best_m, round_s=round_s)
        if not done:
            if round_s > steering.round_s_max:
                return msgspec.structs.replace(memory, sense=0, failed="too-long")
            return walk_round(memory, map, position, yaw_rad, keep_m)
        if distance_m < memory.hit_distance_m - steering.round_leave_m:
            memory = msgspec.structs.replace(memory, round_s=0.0)
        return msgspec.structs.replace(
            memory, reference_m=distance_m, stalled_s=0.0, sense=0, lap=None, laps=0
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
        round_s=memory.round_s,
        hit=position,
        hit_distance_m=best_m,
        hit_sense=sense,
    )


def walk_round(
    memory: Rotation, map: msam.Map, position: Vec2, yaw_rad: float, keep_m: float
) -> Rotation:
    """Memory of a ROUND that goes on, turned back or given up where a lap is complete."""
    wall_rad = wrap_angle(_nearest_angle(map) + yaw_rad)
    if memory.lap is None:
        if map.nearest_m > keep_m + LAP_REACH_M:
            return memory
        return msgspec.structs.replace(memory, lap=position, lap_wall_rad=wall_rad, lap_away=False)
    away_m = geometry.length(position[0] - memory.lap[0], position[1] - memory.lap[1])
    if not memory.lap_away:
        return msgspec.structs.replace(memory, lap_away=away_m > LAP_AWAY_M)
    if away_m > LAP_BACK_M or abs(wrap_angle(wall_rad - memory.lap_wall_rad)) > LAP_WALL_RAD:
        return memory
    if memory.laps > 0:
        return msgspec.structs.replace(memory, sense=0, laps=memory.laps + 1, failed="enclosed")
    return msgspec.structs.replace(
        memory,
        sense=-memory.sense,
        hit_sense=-memory.hit_sense,
        lap=position,
        lap_wall_rad=wall_rad,
        lap_away=False,
        laps=1,
    )


def follow_wall(keep_m: float, map: msam.Map, sense: int, yaw_rad: float) -> Vec2:
    """Direction along the nearest surface, `keep_m` from it, turned away from corners ahead."""
    angles = msam.layout(len(map.sectors_m), len(map.sectors_m)).sector_angles
    wall_body_rad = _nearest_angle(map)
    wall_x, wall_y = geometry.unit(wall_body_rad + yaw_rad)
    along_x, along_y = -sense * wall_y, sense * wall_x
    pull = clip(WALL_GAIN_1PM * (map.nearest_m - keep_m), 1.0)
    along_body_rad = wall_body_rad + sense * TAU / 4.0
    ahead_m = min(
        [
            range_m
            for range_m, angle_rad in zip(map.sectors_m, angles, strict=True)
            if abs(wrap_angle(angle_rad - along_body_rad)) <= CORNER_RAD
        ]
    )
    corner_m = keep_m + CORNER_BEYOND_M
    if ahead_m < corner_m:
        pull -= min(CORNER_PUSH_MAX, WALL_GAIN_1PM * (corner_m - ahead_m))
    return (along_x + pull * wall_x, along_y + pull * wall_y)


def _nearest_angle(map: msam.Map) -> float:
    """Body angle of the nearest sector."""
    return msam.layout(len(map.sectors_m), len(map.sectors_m)).sector_angles[map.nearest_index]


def _range_of(arc: Arc) -> float:
    return arc.range_m
