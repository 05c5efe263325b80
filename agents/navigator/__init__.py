"""A robot that always arrives: a map with memory, a way through it, right of way, a safe speed.

    scan --insert--> memory --navigation function--> Aim
    Aim, peers --right of way: roundabout, gap claims--> Aim
    Aim, peers, memory --cells in time--> direction, speed --forces--> wish --guard--> set-point

Each stage is a module of pure functions; what must be remembered is in one State.

estimate  pose shown, wheels -> pose believed in
law       clearance -> speed and cost, the same for all stages
movers    scans -> what moves and is not heard
sight     scan -> hits without peers, sectors: before all others
predict   pose and twist at which what is decided now takes effect
memory    hits -> points in a window -> distances       (points: its inner loops)
way       distances, goal -> way, sub-goal              (search, chords: its inner loops)
speed     clearance along the way -> the highest speed
forces    pull, points around -> the direction to steer in
dodge     asked -> asked, out of the way of what moves
brake     asked -> allowed: the robot can always stop without contact
warm      all inner loops called once, before robots are started
"""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2, cos, inf, pi, sqrt

import msgspec
import numpy as np

from agents import lateness, msam, peers, steering
from agents.guard import Limit, share
from agents.navigator import (
    brake,
    cells,
    dodge,
    estimate,
    forces,
    memory,
    movers,
    pact,
    predict,
    right_of_way,
    sight,
    speed,
    table,
    way,
)
from agents.navigator.aim import Aim
from agents.navigator.law import Law, law
from agents.navigator.memory import Memory
from agents.navigator.way import Way
from agents.peers import Peer
from agents.steering import Wish
from swarm import geometry
from swarm.geometry import Floats, Pose, Twist, Vec2
from swarm.messages import Beacon, Intent, Mode, Name, Promise, Reason, SensorFrame
from swarm.scenario import RobotSetup

braked, see = brake.braked, sight.look

__all__ = [
    "Aim",
    "State",
    "braked",
    "hold",
    "locate",
    "place",
    "promise",
    "redirect",
    "see",
    "send",
    "step",
]

# A robot that stands for so long where nothing holds it, slower than this, doubts what it
# remembers nearby: the first time within so much, then within twice and thrice that, and again.
STILL_S, STILL_MPS, STILL_RADPS = 1.0, 0.03, 0.2
DOUBT_M, DOUBTS = 1.5, 3
# Likewise one that has not left a place of this size for so long and a turn.
PLACE_M, PLACE_S = 0.2, 3.0
# And says that it is blocked when it has got no further than this for so long, at last among
# others, which may go. Queues at a door wait for less.
FURTHER_M, BLOCKED_S = 0.5, 20.0
ASTRAY_S = 45.0  # likewise where it finds no way that brings it nearer, however it looks for one
# After so long it stands, and looks for a way again from time to time.
TIRED_S, REST_S, TRY_S = 75.0, 60.0, 30.0
BESIDE_M = 1.0  # hull to hull, a peer this near may be why
# Without a way for so long it forgets all that it does not see, once; the second time it gives up.
CLOSED_S = 3.0
NEARER_M = 0.15  # nearer to the goal than ever by this is headway
TURN_BRAKES_SHARE = 0.7
TURN_RAD_MAX = 1.2  # further off the direction it turns on the spot
# Parked within this part of the goal's tolerance, until it is further off than the other part.
PARKED_IN, PARKED_OUT = 0.6, 0.95
# A robot this near to its goal does not hurry because somebody comes.
NEAR_GOAL_M, NEAR_GOAL_MPS = 0.6, 0.1
# Among others: further off the direction it drives slowly, from here on backwards if it may.
ASIDE_RAD, ASIDE_SHARE, BACK_RAD, BACK_SHARE = 0.9, 0.35, 2.0, 0.6
STAND_GAIN_1PS, STAND_RADPS_MAX = 2.0, 1.5  # standing, it turns to where it wants to go
# Less than this share of the speed it wants is being held up.
HELD_SHARE = 0.5
BEHIND_RAD = 3.09  # beyond it the goal is straight behind: it turns the way it turned last


class Near(msgspec.Struct, frozen=True):
    """What was gathered for the stages of a tick, so that the guard need not do it again."""

    tick: int = -1
    reach_m: float = 0.0
    points: bytes = b""  # (points, 2) float64 of `obstacles`

    def points_m(self) -> Floats:
        """Of one's own: inner loops take what is read-only for another type."""
        return np.frombuffer(bytearray(self.points)).reshape(-1, 2)


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
    parked: bool = False
    giving: right_of_way.State = right_of_way.State()
    chosen: Vec2 = (0.0, 0.0)  # m/s, world: velocity of the newest cell
    intent: Intent = Intent()
    yields_to: Name | None = None
    pact: pact.State = pact.State()
    where: estimate.State = estimate.State()
    since: Vec2 | None = None  # it has got no further from here
    since_s: float = 0.0  # for so long
    movers: movers.State = movers.State()  # seen by the lidar only
    near: Near = Near()
    heard: tuple[Name, ...] = ()  # in the tick before, in order


def redirect(state: State) -> State:
    """State of a robot that has got another goal: what it knows of obstacles stays."""
    return State(
        memory=state.memory,
        turn_sense=state.turn_sense,
        pact=state.pact,
        where=state.where,
        movers=state.movers,
        heard=state.heard,
    )


def locate(setup: RobotSetup, state: State, frame: SensorFrame) -> tuple[State, SensorFrame]:
    """State and frame with the pose that is believed in: first of all in a tick."""
    where = estimate.step(setup, state.where, frame)
    state = msgspec.structs.replace(state, where=where)
    if where.pose is frame.pose or where.pose is None:
        return state, frame
    return state, msgspec.structs.replace(frame, pose=where.pose)


def place(state: State, frame: SensorFrame) -> Pose:
    """Pose to announce."""
    return state.where.pose or frame.pose


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
    state, map = watch(setup, state, seen, map, others, elapsed_s)
    others = later(setup, late, frame, others)
    state, aim = look(setup, state, seen, frame, map, others, elapsed_s)
    if state.failed:
        state = msgspec.structs.replace(state, intent=Intent(), yields_to=None)
        return state, Wish(mode="FAILED", waypoint=aim.subgoal, reason=state.failed)
    rows, near = table.of(others, frame.pose.x_m, frame.pose.y_m)
    more_m = 2.0 * estimate.error_m(setup)  # the guard keeps them so much further off
    if len(rows):
        rows[:, table.RADIUS] += more_m
    after_s = late.late_ticks * setup.dt_s
    moving = movers.as_peers(state.movers, frame.pose.x_m, frame.pose.y_m, after_s)
    if len(rows):
        aim = straightened(setup, state, seen, frame, map, aim)
    reach_m = setup.robot.body_radius_m + max(setup.navigator.reach_m, setup.navigator.barrier_m)
    if len(rows) or len(moving):
        reach_m = max(reach_m, right_of_way.SIGHT_M, cells.reach_m(setup.robot))
    points_m = obstacles(setup, state, seen, frame, map, reach_m)
    state = msgspec.structs.replace(state, near=Near(seen.tick, reach_m, points_m.tobytes()))
    state, aim, course = give_way(setup, state, frame, others, rows, near, points_m, aim, elapsed_s)
    rows = np.concatenate((rows, moving)) if len(moving) else rows
    state, choice = choose(setup, state, frame, rows, points_m, aim, course)
    state, wish = drive(setup, state, frame, rows, points_m, aim, course, choice)
    return say_blocked(state, frame, wish, elapsed_s, among=len(others) > 0)


def watch(
    setup: RobotSetup,
    state: State,
    seen: SensorFrame,
    map: msam.Map,
    others: Sequence[Peer],
    elapsed_s: float,
) -> tuple[State, msam.Map]:
    """What moves: known, off the map, and out of the memory.

    A peer that is heard for the first time, or again, was seen as an obstacle before: where it
    stands there is none.
    """
    before, now = (
        state.movers,
        movers.step(setup, state.movers, seen, map.ranges_m, others, elapsed_s),
    )
    known, gone = state.memory, movers.trail(before, now)
    heard = tuple([peer.beacon.name for peer in others])
    if heard != state.heard:
        bodies = bodies_of([peer for peer in others if peer.beacon.name not in state.heard], setup)
        gone = np.concatenate((gone, bodies))
    if known is not None and len(gone):
        known = memory.cleared(law(setup.navigator, setup.robot.body_radius_m), known, gone)
    state = msgspec.structs.replace(state, movers=now, memory=known, heard=heard)
    return state, without(state, seen, map)


def bodies_of(others: Sequence[Peer], setup: RobotSetup) -> Floats:
    """(peers, 3) m: x, y, radius, world: where hits on those lie that are masked."""
    more_m = setup.msam.peer_tolerance_m
    return np.array(
        [
            (peer.pose.x_m, peer.pose.y_m, peer.beacon.body_radius_m + more_m)
            for peer in others
            if peer.beacon.promise is not None and not peers.has_come_to_grief(peer.beacon)
        ]
    ).reshape(-1, 3)


def without(state: State, seen: SensorFrame, map: msam.Map) -> msam.Map:
    """The map of this tick without what moves."""
    ranges_m = state.movers.without(map.ranges_m, seen.tick)
    return map if ranges_m is map.ranges_m else msgspec.structs.replace(map, ranges_m=ranges_m)


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
    open_mps = setup.robot.speed_mps_max
    if is_last:
        open_mps = min(open_mps, speed.at_goal(setup, goal_m))
    speed_mps = min(speed_mps, open_mps)
    if not found.path:
        speed_mps = open_mps = 0.0
    x_m, y_m = subgoal[0] - pose.x_m, subgoal[1] - pose.y_m
    direction_rad = pose.yaw_rad if (x_m, y_m) == (0.0, 0.0) else atan2(y_m, x_m)
    return state, Aim(
        direction_rad, speed_mps, subgoal, goal_m, is_last, state.failed, open_mps=open_mps
    )


def say_blocked(
    state: State, frame: SensorFrame, wish: Wish, elapsed_s: float, *, among: bool
) -> tuple[State, Wish]:
    """Wish that says so where a robot has got no further for long.

    It goes on trying, so that it is gone as soon as what blocks it is; but one that drives about in
    vain rests in between, or those that have arrived would have to make way for it for ever.

    Args:
        among: others are heard.
    """
    x_m, y_m = frame.pose.x_m, frame.pose.y_m
    since, since_s = state.since, state.since_s + elapsed_s
    if since is None or geometry.length(x_m - since[0], y_m - since[1]) > FURTHER_M:
        since, since_s = (x_m, y_m), 0.0
    if wish.arrived or state.parked:
        since_s = 0.0
    state = msgspec.structs.replace(state, since=since, since_s=since_s)
    astray_s = state.best_s if among and not (wish.arrived or state.parked) else 0.0
    if since_s <= BLOCKED_S and astray_s <= ASTRAY_S:
        return state, wish
    if astray_s > TIRED_S and (astray_s - TIRED_S) % (REST_S + TRY_S) < REST_S:
        state = msgspec.structs.replace(state, intent=Intent())
        wish = msgspec.structs.replace(wish, speed_mps=0.0, turn_rate_radps=0.0)
    return state, msgspec.structs.replace(wish, mode="HOLD", reason="blocked")


def straightened(
    setup: RobotSetup, state: State, seen: SensorFrame, frame: SensorFrame, map: msam.Map, aim: Aim
) -> Aim:
    """Aim straight at the target where nothing known is near that line.

    A way over the cells of a grid keeps to eight directions; among others it matters whether all
    see each other's straight ways.
    """
    target, _ = target_of(setup, state)
    if aim.reason or aim.open_mps == 0.0:
        return aim
    to_x_m, to_y_m = target[0] - frame.pose.x_m, target[1] - frame.pose.y_m
    keep_m = setup.robot.body_radius_m + setup.navigator.comfort_m
    if (to_x_m, to_y_m) == (0.0, 0.0) or not memory.is_clear(
        state.memory or memory.empty(law(setup.navigator, setup.robot.body_radius_m), frame.pose),
        seen.pose,
        map.ranges_m,
        frame.pose,
        (to_x_m, to_y_m),
        keep_m,
    ):
        return aim
    return msgspec.structs.replace(aim, direction_rad=atan2(to_y_m, to_x_m), subgoal=target)


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
    if state.closed_s > CLOSED_S and not state.forgot:
        known = memory.empty(rules, frame.pose, known.version + 1)
        return replace(state, forgot=True, closed_s=0.0, way=None), known
    beside_m = setup.robot.body_radius_m + BESIDE_M
    if state.held or any(one.distance_m < beside_m + one.beacon.body_radius_m for one in others):
        return replace(state, still_s=0.0, place=None), known
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

    A peer in sight may be what closes it, and may go: as long as there is one it does not give up,
    and forgets again and again.
    """
    replace = msgspec.structs.replace
    assert state.way is not None
    if state.held:
        elapsed_s = 0.0
    closed_s = state.closed_s + elapsed_s if state.way.closed else 0.0
    in_sight = any(one.distance_m < setup.sensor.range_m for one in others)
    forgot = state.forgot
    if in_sight and forgot and closed_s > CLOSED_S:
        forgot, closed_s = False, 0.0
    best_m, best_s = state.best_m, state.best_s + elapsed_s
    if goal_m < best_m - NEARER_M:
        best_m, best_s = goal_m, 0.0
    failed = state.failed
    if in_sight:  # they may be what is in the way, and go: no more than blocked
        return replace(state, closed_s=closed_s, forgot=forgot, best_m=best_m, best_s=best_s)
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
    rows: Floats,
    near: Sequence[Peer],
    points_m: Floats,
    aim: Aim,
    elapsed_s: float,
) -> tuple[State, Aim, right_of_way.Course]:
    """Right of way: parking, virtual roundabout, claims to narrow gaps.

    Args:
        rows, near: of `table.of`.
        points_m: (points, 2) from here, world axes: obstacles.
    """
    tolerance_m = setup.robot.goal_tolerance_m
    parked_m = tolerance_m * (PARKED_OUT if state.parked else PARKED_IN)
    parked = aim.is_last and aim.distance_m < parked_m
    path_m: Floats = np.empty((0, 2))
    if not parked and others and len(points_m):
        assert state.way is not None
        cells_mm = state.way.path_mm()[state.way.index :][:: right_of_way.PATH_STEP]
        here_m = np.array((frame.pose.x_m, frame.pose.y_m))
        path_m = np.subtract(cells_mm * 0.001, here_m, dtype=np.float64)
    target, _ = target_of(setup, state)
    giving, course = right_of_way.step(
        setup,
        state.giving,
        frame,
        aim,
        target,
        others,
        rows,
        near,
        points_m,
        path_m,
        elapsed_s,
        parked=parked,
    )
    state = msgspec.structs.replace(state, giving=giving, parked=parked, yields_to=course.yields_to)
    return state, aim, course


def choose(
    setup: RobotSetup,
    state: State,
    frame: SensorFrame,
    rows: Floats,
    points_m: Floats,
    aim: Aim,
    course: right_of_way.Course,
) -> tuple[State, cells.Choice]:
    """World direction and speed of the cheapest cell in time; alone, those of the way."""
    robot = setup.robot
    choice = cells.Choice(course.direction_rad, course.speed_mps, False)
    if len(rows):
        slow_mps = robot.speed_mps_max
        if aim.is_last and aim.distance_m < NEAR_GOAL_M and not state.parked:
            slow_mps = max(course.speed_mps, NEAR_GOAL_MPS)
        choice = cells.choose(
            course.direction_rad,
            course.speed_mps,
            frame.pose.yaw_rad,
            state.chosen,
            state.intent.velocity,
            robot.body_radius_m,
            robot.speed_mps_max,
            rows,
            points_m,
            keeps_right=course.round,
            parked=state.parked,
            slow_mps=slow_mps,
            free_m=geometry.length(aim.subgoal[0] - frame.pose.x_m, aim.subgoal[1] - frame.pose.y_m)
            if course.own
            else 0.0,
        )
    unit = geometry.unit(choice.direction_rad)
    u_mps = choice.speed_mps
    chosen = (u_mps * unit[0], u_mps * unit[1])
    # Whoever announced less than its top speed would keep those behind it from going faster, and
    # they it, for good; the guard sees to it that nobody relies on it.
    if u_mps > 0.0 and course.speed_mps >= robot.speed_mps_max:
        u_mps = robot.speed_mps_max
    intent = Intent((u_mps * unit[0], u_mps * unit[1]), course.target, course.active)
    held = len(rows) > 0 and (
        course.waits or state.parked or choice.speed_mps < HELD_SHARE * aim.speed_mps
    )
    return msgspec.structs.replace(state, intent=intent, chosen=chosen, held=held), choice


def drive(
    setup: RobotSetup,
    state: State,
    frame: SensorFrame,
    rows: Floats,
    points_m: Floats,
    aim: Aim,
    course: right_of_way.Course,
    choice: cells.Choice,
) -> tuple[State, Wish]:
    """Forces along and across that direction, and what to ask of the motors."""
    navigator, robot = setup.navigator, setup.robot
    total = forces.add_up(setup, geometry.unit(choice.direction_rad), points_m)
    x, y = total.resultant
    error_rad = geometry.wrap_angle(atan2(y, x) - frame.pose.yaw_rad)
    sense = state.turn_sense
    if abs(error_rad) > BEHIND_RAD:
        error_rad = sense * abs(error_rad)
    elif error_rad != 0.0:
        sense = 1 if error_rad > 0.0 else -1
    if sense != state.turn_sense:
        state = msgspec.structs.replace(state, turn_sense=sense)
    arrived = aim.is_last and aim.distance_m < robot.goal_tolerance_m
    mode: Mode = "ARRIVED" if arrived else "GO"
    gain_1ps, most_radps = navigator.heading_gain_1ps, robot.turn_rate_radps_max
    speed_mps = choice.speed_mps
    if not len(rows):
        ahead = cos(error_rad) if abs(error_rad) <= TURN_RAD_MAX else 0.0
        speed_mps *= ahead * ahead
        if state.parked:
            gain_1ps = 0.0
    elif speed_mps == 0.0:
        error_rad = geometry.wrap_angle(course.direction_rad - frame.pose.yaw_rad)
        gain_1ps, most_radps = STAND_GAIN_1PS, min(STAND_RADPS_MAX, most_radps)
        if state.parked:
            gain_1ps = 0.0
    elif abs(error_rad) > BACK_RAD and speed_mps <= BACK_SHARE * robot.speed_mps_max:
        error_rad = geometry.wrap_angle(error_rad + pi)
        speed_mps *= -max(0.0, cos(error_rad))
    else:
        speed_mps *= max(0.0, cos(error_rad))
        if abs(error_rad) > ASIDE_RAD:
            speed_mps = min(speed_mps, ASIDE_SHARE * robot.speed_mps_max)
    # No faster than it can stop turning again: with weak motors it would swing to and fro.
    turning_radps2 = TURN_BRAKES_SHARE * robot.turn_acceleration_radps2_max
    most_radps = min(most_radps, sqrt(2.0 * turning_radps2 * abs(error_rad)))
    turn_rate_radps = steering.clip(gain_1ps * error_rad, most_radps)
    wish = Wish(
        mode, speed_mps, turn_rate_radps, arrived=arrived, forces=total, waypoint=aim.subgoal
    )
    return state, wish


def hold(
    setup: RobotSetup,
    state: State,
    seen: SensorFrame,
    map: msam.Map,
    others: Sequence[Peer],
    late: lateness.State,
    asked: Twist,
) -> tuple[State, Twist, Limit]:
    """Set-point from which the robot can always stop in time, off bodies too: the last word.

    Args:
        others: peers whose bodies are not on the map.
    """
    frame = predict.ahead(setup, late, seen)
    map = without(state, seen, map)
    moving = movers.ahead(
        state.movers, frame.pose.x_m, frame.pose.y_m, late.late_ticks * setup.dt_s
    )
    if len(moving):
        far_m = obstacles(setup, state, seen, frame, map, dodge.reach_m(setup))
        heading = geometry.unit(frame.pose.yaw_rad)
        asked = dodge.ask(setup, heading, frame.twist, asked, moving, far_m)
    reach_m = brake.reach_m(setup, max(abs(frame.twist.speed_mps), abs(asked.speed_mps)))
    # Points that are too far off to matter change nothing, unless the body may be faster than told.
    exact = setup.disturbance.speed_error == 0.0
    if exact and state.near.tick == seen.tick and reach_m <= state.near.reach_m:
        points_m = state.near.points_m()
    else:
        points_m = obstacles(setup, state, seen, frame, map, reach_m)
    others = later(setup, late, frame, others)
    promising = [peer for peer in others if peer.beacon.promise is not None]
    rest = [peer for peer in others if peer.beacon.promise is None]
    rest += peers.halted(rest, frame.pose, setup.dt_s)
    if late.late_ticks != setup.disturbance.latency_ticks:
        # Nothing can be promised; it takes its half of each gap, as others do.
        late_s = late.late_ticks * setup.dt_s
        bodies = [*others, *peers.halted(others, frame.pose, setup.dt_s)]
        side = 1.0 if asked.speed_mps >= 0.0 else -1.0
        most_mps = min([share(setup, peer, side, late_s=late_s) for peer in bodies], default=inf)
        asked = Twist(steering.clip(asked.speed_mps, most_mps), asked.turn_rate_radps)
        promising, rest = [], []
    carried = frame.pose
    if state.where.carried is not None and state.where.carried != seen.pose:
        before = msgspec.structs.replace(seen, pose=state.where.carried)
        carried = predict.ahead(setup, late, before).pose
    kept, held = pact.hold(
        setup,
        state.pact,
        frame.tick,
        frame.pose,
        frame.twist,
        asked,
        promising,
        rest,
        points_m,
        state.where,
        carried,
        predict.pending(setup, late, seen),
    )
    state = msgspec.structs.replace(state, pact=kept)
    if held is not None and not held.corrects:
        state = msgspec.structs.replace(state, where=estimate.carry(state.where))
    if held is None:
        set_point, allowed = brake.hold(setup, frame.pose.yaw_rad, frame.twist, asked, points_m)
        # Whatever was measured: no wheel is asked for more than it can.
        return state, steering.scale_to_rims(setup.robot, set_point), allowed
    most_mps = abs(held.set_point.speed_mps) if held.by else setup.robot.speed_mps_max
    set_point = steering.scale_to_rims(setup.robot, held.set_point)
    return state, set_point, Limit(most_mps, held.by)


def later(
    setup: RobotSetup, late: lateness.State, frame: SensorFrame, others: Sequence[Peer]
) -> list[Peer]:
    """Peers when what is decided now takes effect, from where the robot is then."""
    if not late.late_ticks:
        return list(others)
    beacons = [peer.beacon for peer in others]
    return peers.now(beacons, frame.pose, frame.tick, setup.dt_s, late.late_ticks)


def promise(
    setup: RobotSetup, state: State, frame: SensorFrame, late: lateness.State, set_point: Twist
) -> Promise | None:
    """What a robot promises, None when it stops too slowly or is later than all are."""
    if not pact.is_kept(setup) or late.late_ticks != setup.disturbance.latency_ticks:
        return None
    pending = predict.pending(setup, late, frame)
    return pact.promise(setup, set_point, state.where.doubt, pending)


def send(setup: RobotSetup, state: State, beacon: Beacon) -> State:
    """State after a beacon went out."""
    return msgspec.structs.replace(state, pact=pact.send(setup, state.pact, beacon))


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
