"""Rotation memory: out of what the field cannot leave, along the wall, and when to give up.

    no progress --> ROUND, wall followed with a held sense --goal nearer and free--> GO
                      '--a lap each way, or too long--> FAILED, for good

The rotating force of eq. 35 has no memory and turns round with the goal's side; all of this is
ours.
"""

from __future__ import annotations

from math import inf

import msgspec

from agents import field, msam, steering
from swarm import geometry
from swarm.geometry import TAU, Vec2, wrap_angle
from swarm.messages import Arc, Reason
from swarm.scenario import Steering

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
# A ROUND that has not left a place of this size for so long has no room to keep its distance: the
# bodies of robots that were lost may stand nearer to each other. It then follows the wall closely,
# and by turns looks for a gap that is narrower.
PLACE_M = 1.0
PLACE_S = 20.0
# Steepness of both pushes, 1/m.
WALL_GAIN_1PM = 2.0
# Leaving ROUND, the way to the goal must be free this far.
LEAVE_LOOK_M = 1.5


class State(msgspec.Struct, frozen=True):
    """How long the goal has come no nearer, and the wall that is followed."""

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
    place: Vec2 | None = None  # world, where it has been since a ROUND
    place_s: float = 0.0  # for so long
    turn_s: float = 0.0  # of this ROUND
    failed: Reason = ""  # there is no way; for good


def step(
    params: Steering,
    memory: State,
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
) -> State:
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
    memory = _stay(memory, position, 0.0 if waiting else elapsed_s)
    if memory.sense != 0:
        round_s = memory.round_s + (0.0 if waiting else elapsed_s)
        done = not map.clusters
        if distance_m < memory.hit_distance_m - params.round_leave_m and not done:
            free_rad = steering.choose_direction(
                params,
                map,
                yaw_rad,
                goal_rad,
                goal_rad,
                clear_m=clear_m,
                look_m=min(distance_m, LEAVE_LOOK_M),
            )
            done = free_rad == goal_rad
        turn_s = memory.turn_s + (0.0 if waiting else elapsed_s)
        done = done or (is_confined(memory) and turn_s > PLACE_S)
        memory = msgspec.structs.replace(memory, best_m=best_m, round_s=round_s, turn_s=turn_s)
        if not done:
            if round_s > params.round_s_max:
                return msgspec.structs.replace(memory, sense=0, failed="too-long")
            return _walk_round(memory, map, position, yaw_rad, keep_m)
        if distance_m < memory.hit_distance_m - params.round_leave_m:
            memory = msgspec.structs.replace(memory, round_s=0.0)
        return msgspec.structs.replace(
            memory,
            reference_m=distance_m,
            stalled_s=0.0,
            sense=0,
            lap=None,
            laps=0,
        )
    if distance_m < memory.reference_m - params.stall_progress_m:
        return msgspec.structs.replace(memory, best_m=best_m, reference_m=distance_m, stalled_s=0.0)
    stalled_s = memory.stalled_s + (0.0 if waiting else elapsed_s)
    if stalled_s < params.stall_s or not map.clusters:
        return msgspec.structs.replace(memory, best_m=best_m, stalled_s=stalled_s)
    nearest = min(map.clusters, key=_range_of)
    sense = field.passing_side(wrap_angle(goal_rad - (nearest.bearing_rad + yaw_rad)))
    if memory.hit is not None:
        dx_m, dy_m = position[0] - memory.hit[0], position[1] - memory.hit[1]
        if geometry.length(dx_m, dy_m) < SAME_PLACE_M:
            sense = -memory.hit_sense
    return State(
        best_m=best_m,
        reference_m=memory.reference_m,
        sense=sense,
        round_s=memory.round_s,
        hit=position,
        hit_distance_m=best_m,
        hit_sense=sense,
        place=memory.place or position,
        place_s=memory.place_s,
    )


def is_confined(memory: State) -> bool:
    """Whether it has been where there is no room for the usual distances, for long."""
    return memory.place_s >= PLACE_S


def _stay(memory: State, position: Vec2, elapsed_s: float) -> State:
    """Memory with the clock of the place moved on, or stopped once that was left."""
    if memory.place is None:
        return memory
    dx_m, dy_m = position[0] - memory.place[0], position[1] - memory.place[1]
    if geometry.length(dx_m, dy_m) <= PLACE_M:
        return msgspec.structs.replace(memory, place_s=memory.place_s + elapsed_s)
    place = None if memory.sense == 0 else position
    return msgspec.structs.replace(memory, place=place, place_s=0.0)


def _walk_round(
    memory: State, map: msam.Map, position: Vec2, yaw_rad: float, keep_m: float
) -> State:
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
    pull = steering.clip(WALL_GAIN_1PM * (map.nearest_m - keep_m), 1.0)
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
