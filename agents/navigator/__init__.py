"""A robot that always arrives: a map with memory, a way through it, right of way, a safe speed.

    scan --insert--> memory --navigation function--> Aim
    Aim, peers --right of way: roundabout, gap claims--> Aim
    Aim, peers, memory --cells in time--> direction, speed --forces--> wish --guard--> set-point

Each stage is a module of pure functions; what must be remembered is in one State.

law       clearance -> speed and cost, the same for all stages
predict   pose and twist at which what is decided now takes effect
memory    hits -> points in a window -> distances       (points: its inner loops)
way       distances, goal -> way, sub-goal              (search, chords: its inner loops)
speed     clearance along the way -> the highest speed
forces    pull, points around -> the direction to steer in
brake     asked -> allowed: the robot can always stop without contact
warm      all inner loops called once, before robots are started
"""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2, cos, pi, sqrt

import msgspec

from agents import lateness, msam, peers, steering
from agents.guard import Limit
from agents.navigator import brake, forces, memory, predict, speed, way
from agents.navigator.aim import Aim
from agents.navigator.law import Law, law
from agents.navigator.memory import Memory
from agents.navigator.way import Way
from agents.peers import Peer
from agents.steering import Wish
from swarm import geometry
from swarm.geometry import Floats, Twist, Vec2
from swarm.messages import Reason, SensorFrame
from swarm.scenario import RobotSetup

__all__ = ["Aim", "State", "hold", "redirect", "step"]

# A robot that stands for so long where nothing holds it, slower than this, doubts what it
# remembers nearby: the first time within so much, then within twice and thrice that, and again.
STILL_S, STILL_MPS, STILL_RADPS = 1.0, 0.03, 0.2
DOUBT_M, DOUBTS = 1.5, 3
# Likewise one that has not left a place of this size for so long and a turn.
PLACE_M, PLACE_S = 0.2, 3.0
BESIDE_M = 1.0  # hull to hull, a peer this near may be why
# Without a way for so long it forgets all that it does not see, once; the second time it gives up.
CLOSED_S = 3.0
NEARER_M = 0.15  # nearer to the goal than ever by this is headway
TURN_BRAKES_SHARE = 0.7
TURN_RAD_MAX = 1.2  # further off the direction it turns on the spot
BEHIND_RAD = 3.09  # beyond it the goal is straight behind: it turns the way it turned last


class State(msgspec.Struct, frozen=True):
    """What the stages remember."""

    via_index: int = 0
    memory: Memory | None = None
    way: Way | None = None
    turn_sense: int = -1  # of the last turn; at first to the right
    still_s: float = 0.0
    place: Vec2 | None = None  # where it has been since place_s
    place_s: float = 0.0
    doubts: int = 0
    closed_s: float = 0.0  # without a way
    forgot: bool = False  # all that it does not see, for want of a way
    best_m: float = 1e9  # nearest to the goal so far
    best_s: float = 0.0  # since then
    failed: Reason = ""  # there is no way; for good
    held: bool = False  # in the tick before: it waited for others


def redirect(state: State) -> State:
    """State of a robot that has got another goal: what it knows of obstacles stays."""
    return State(memory=state.memory, turn_sense=state.turn_sense)


def step(
    setup: RobotSetup,
    state: State,
    frame: SensorFrame,
    map: msam.Map,
    others: Sequence[Peer],
    elapsed_s: float,
    late: lateness.State,
) -> tuple[State, Wish]:
    """One tick on the way to `setup.robot.goal` by way of its way-points."""
    seen, frame = frame, predict.ahead(setup, late, frame)
    state, aim = look(setup, state, seen, frame, map, others, elapsed_s)
    if aim.is_last and aim.distance_m < setup.robot.goal_tolerance_m:
        return state, Wish(mode="ARRIVED", arrived=True, waypoint=aim.subgoal)
    if state.failed:
        return state, Wish(mode="FAILED", waypoint=aim.subgoal, reason=state.failed)
    state, aim = give_way(setup, state, frame, others, aim, elapsed_s)
    if aim.held != state.held:
        state = msgspec.structs.replace(state, held=aim.held)
    direction_rad, speed_mps = choose(setup, state, frame, map, others, aim)
    return drive(setup, state, seen, frame, map, direction_rad, speed_mps, aim)


def look(
    setup: RobotSetup,
    state: State,
    seen: SensorFrame,
    frame: SensorFrame,
    map: msam.Map,
    others: Sequence[Peer],
    elapsed_s: float,
) -> tuple[State, Aim]:
    """Memory and way: where to go were there no peers.

    Args:
        seen: as it was measured.
        frame: with the pose at which what is decided now takes effect.
    """
    replace = msgspec.structs.replace
    pose, rules = frame.pose, law(setup.navigator, setup.robot.body_radius_m)
    state = pass_waypoints(setup, state, frame)
    target, is_last = target_of(setup, state)
    goal_m = geometry.length(target[0] - pose.x_m, target[1] - pose.y_m)
    is_there = is_last and goal_m < setup.robot.goal_tolerance_m
    # 1. Remember.
    known = state.memory or memory.empty(rules, pose)
    known = memory.shifted(rules, known, pose)
    if not is_there:
        state, known = doubt(setup, rules, state, known, frame, others, elapsed_s)
    known, field_mm = memory.observe(rules, known, seen.pose, seen.ranges_m(), map.ranges_m)
    # 2. Find the way.
    tolerance_m = setup.robot.goal_tolerance_m if is_last else setup.robot.via_tolerance_m
    found = way.step(rules, state.way, known, field_mm, pose, target, tolerance_m)
    state = replace(state, memory=known, way=found)
    if is_there:  # should it be pushed away it has all the time again
        state = replace(state, still_s=0.0, place=None, closed_s=0.0, best_m=1e9, best_s=0.0)
    else:
        state = give_up(setup, state, others, goal_m, elapsed_s)
    # 3. Aim at the farthest point of it that can be driven to straight on.
    look_m = setup.navigator.look_m + setup.navigator.look_s * abs(frame.twist.speed_mps)
    factor = setup.navigator.chord_factor
    subgoal, index = way.subgoal(rules, found, known, field_mm, pose, look_m, factor)
    speed_mps = speed.cap(
        setup, rules, found, known, field_mm, pose, frame.twist.speed_mps, subgoal, index
    )
    if is_last:
        speed_mps = min(speed_mps, speed.at_goal(setup, goal_m))
    if not found.path:
        speed_mps = 0.0
    x_m, y_m = subgoal[0] - pose.x_m, subgoal[1] - pose.y_m
    direction_rad = pose.yaw_rad if (x_m, y_m) == (0.0, 0.0) else atan2(y_m, x_m)
    return state, Aim(direction_rad, speed_mps, subgoal, goal_m, is_last, state.failed)


def pass_waypoints(setup: RobotSetup, state: State, frame: SensorFrame) -> State:
    """State after ticking off the way-points that are near enough, in their order."""
    index, via = state.via_index, setup.robot.via
    while index < len(via):
        away_x_m, away_y_m = via[index][0] - frame.pose.x_m, via[index][1] - frame.pose.y_m
        if geometry.length(away_x_m, away_y_m) > setup.robot.via_tolerance_m:
            break
        index += 1
    if index == state.via_index:
        return state
    return msgspec.structs.replace(redirect(state), via_index=index)


def target_of(setup: RobotSetup, state: State) -> tuple[Vec2, bool]:
    """Where to go now, and whether that is the goal itself."""
    assert setup.robot.goal is not None
    if state.via_index < len(setup.robot.via):
        return setup.robot.via[state.via_index], False
    return setup.robot.goal, True


def doubt(
    setup: RobotSetup,
    rules: Law,
    state: State,
    known: Memory,
    frame: SensorFrame,
    others: Sequence[Peer],
    elapsed_s: float,
) -> tuple[State, Memory]:
    """State and memory after a look at whether the robot is stuck in what it remembers.

    Beside a peer it is not: that may be what holds it.
    """
    replace = msgspec.structs.replace
    beside_m = setup.robot.body_radius_m + BESIDE_M
    if state.held or any(one.distance_m < beside_m + one.beacon.body_radius_m for one in others):
        return replace(state, still_s=0.0, place=None), known
    if state.closed_s > CLOSED_S and not state.forgot:
        known = memory.empty(rules, frame.pose, known.version + 1)
        return replace(state, forgot=True, closed_s=0.0, way=None), known
    twist = frame.twist
    here, place, place_s = (frame.pose.x_m, frame.pose.y_m), state.place, state.place_s + elapsed_s
    if place is None or geometry.length(here[0] - place[0], here[1] - place[1]) > PLACE_M:
        place, place_s = here, 0.0
    moves = abs(twist.speed_mps) > STILL_MPS or abs(twist.turn_rate_radps) > STILL_RADPS
    if state.way is None or state.way.closed:
        moves, place_s = True, 0.0
    still_s = 0.0 if moves else state.still_s + elapsed_s
    if still_s <= STILL_S and place_s <= PLACE_S + pi / setup.robot.turn_rate_radps_max:
        return replace(state, still_s=still_s, place=place, place_s=place_s), known
    radius_m = DOUBT_M * (1 + state.doubts % DOUBTS)
    known = memory.without(rules, known, frame.pose, radius_m)
    return replace(state, still_s=0.0, place=here, place_s=0.0, doubts=state.doubts + 1), known


def give_up(
    setup: RobotSetup, state: State, others: Sequence[Peer], goal_m: float, elapsed_s: float
) -> State:
    """State with what there is to say about there being no way.

    A peer that stands in sight may be what closes it, and may go: that is too long at worst.
    """
    replace = msgspec.structs.replace
    assert state.way is not None
    if state.held:
        elapsed_s = 0.0
    closed_s = state.closed_s + elapsed_s if state.way.closed else 0.0
    if any(peers.stands(one.beacon) and one.distance_m < setup.sensor.range_m for one in others):
        closed_s = min(closed_s, state.closed_s)
    best_m, best_s = state.best_m, state.best_s + elapsed_s
    if goal_m < best_m - NEARER_M:
        best_m, best_s = goal_m, 0.0
    failed = state.failed
    if not failed and closed_s > CLOSED_S and state.forgot:
        failed = "enclosed"
    if not failed and best_s > setup.navigator.give_up_s:
        failed = "too-long"
    return replace(state, closed_s=closed_s, best_m=best_m, best_s=best_s, failed=failed)


def give_way(
    setup: RobotSetup,
    state: State,
    frame: SensorFrame,
    others: Sequence[Peer],
    aim: Aim,
    elapsed_s: float,
) -> tuple[State, Aim]:
    """Right of way: virtual roundabout, claims to narrow gaps."""
    return state, aim


def choose(
    setup: RobotSetup,
    state: State,
    frame: SensorFrame,
    map: msam.Map,
    others: Sequence[Peer],
    aim: Aim,
) -> tuple[float, float]:
    """World direction and speed of the cheapest cell in time."""
    return aim.direction_rad, aim.speed_mps


def drive(
    setup: RobotSetup,
    state: State,
    seen: SensorFrame,
    frame: SensorFrame,
    map: msam.Map,
    direction_rad: float,
    speed_mps: float,
    aim: Aim,
) -> tuple[State, Wish]:
    """Forces along and across that direction, and what to ask of the motors."""
    navigator = setup.navigator
    near_m = setup.robot.body_radius_m + max(navigator.reach_m, navigator.barrier_m)
    points_m = obstacles(setup, state, seen, frame, map, near_m)
    total = forces.add_up(setup, geometry.unit(direction_rad), points_m)
    x, y = total.resultant
    error_rad = geometry.wrap_angle(atan2(y, x) - frame.pose.yaw_rad)
    sense = state.turn_sense
    if abs(error_rad) > BEHIND_RAD:
        error_rad = sense * abs(error_rad)
    elif error_rad != 0.0:
        sense = 1 if error_rad > 0.0 else -1
    # No faster than it can stop turning again: with weak motors it would swing to and fro.
    turning_radps2 = TURN_BRAKES_SHARE * setup.robot.turn_acceleration_radps2_max
    turn_rate_radps = steering.clip(
        navigator.heading_gain_1ps * error_rad,
        min(setup.robot.turn_rate_radps_max, sqrt(2.0 * turning_radps2 * abs(error_rad))),
    )
    ahead = cos(error_rad) if abs(error_rad) <= TURN_RAD_MAX else 0.0
    if sense != state.turn_sense:
        state = msgspec.structs.replace(state, turn_sense=sense)
    wish = Wish(
        "GO", speed_mps * ahead * ahead, turn_rate_radps, forces=total, waypoint=aim.subgoal
    )
    return state, wish


def hold(
    setup: RobotSetup,
    state: State,
    seen: SensorFrame,
    map: msam.Map,
    late: lateness.State,
    asked: Twist,
    allows: brake.Allows | None = None,
) -> tuple[Twist, Limit]:
    """Set-point from which the robot can always stop in time: the last word.

    Args:
        allows: what else a course must keep to.
    """
    frame = predict.ahead(setup, late, seen)
    reach_m = brake.reach_m(setup, frame.twist.speed_mps)
    points_m = obstacles(setup, state, seen, frame, map, reach_m)
    return brake.hold(setup, frame.pose.yaw_rad, frame.twist, asked, points_m, allows)


def obstacles(
    setup: RobotSetup,
    state: State,
    seen: SensorFrame,
    frame: SensorFrame,
    map: msam.Map,
    reach_m: float,
) -> Floats:
    """(points, 2) m, world axes, from the robot's centre: what it sees and remembers in reach."""
    rules = law(setup.navigator, setup.robot.body_radius_m)
    known = state.memory or memory.empty(rules, frame.pose)
    return memory.around(rules, known, seen.pose, map.ranges_m, frame.pose, reach_m)
