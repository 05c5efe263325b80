"""A robot that always arrives: a map with memory, a way through it, right of way, a safe speed.

    scan --insert--> memory --navigation function--> Aim
    Aim, peers --right of way: roundabout, gap claims--> Aim
    Aim, peers, memory --cells in time--> direction, speed --forces--> wish --guard--> set-point

Each stage is a module of pure functions; what must be remembered is in one State.

state         all of that State
estimate      pose shown, wheels -> pose believed in
predict       pose and twist at which what is decided now takes effect
law           clearance -> speed and cost, the same for all stages
movers        scans -> what moves and is not heard           (arcs, segments, tracks)
sight         scan -> hits without peers, sectors: before all others
memory        hits -> points in a window -> distances       (points: its inner loops)
way           distances, goal -> way, sub-goal              (search, chords: its inner loops)
headway       whether it gets on: doubts, blocked, failed
speed         clearance along the way -> the highest speed
right_of_way  who goes first                                (roundabout, gaps, walls, stuck)
drive         direction, speed -> what to ask of the motors (cells in time, forces)
last_word     asked -> allowed                              (dodge, brake, announce,
              pact: pledge, admission)
corridor      bearings of a slot that are free of all that is known, for formations
warm          all inner loops called once, before robots are started
"""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2

import msgspec
import numpy as np

from agents import lateness, msam, peers
from agents.navigator import (
    brake,
    cells,
    drive,
    estimate,
    headway,
    last_word,
    memory,
    movers,
    predict,
    right_of_way,
    sight,
    speed,
    table,
    way,
)
from agents.navigator.aim import Aim
from agents.navigator.law import law
from agents.navigator.state import (
    Near,
    State,
    obstacles,
    pass_waypoints,
    redirect,
    standing,
    target_of,
)
from agents.peers import Peer
from agents.steering import Wish
from swarm import geometry
from swarm.geometry import Floats, Pose, Ranges
from swarm.messages import Intent, SensorFrame
from swarm.scenario import RobotSetup

braked, see = brake.braked, sight.look
hold, promise, send = last_word.hold, last_word.promise, last_word.send

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

# Parked within this part of the goal's tolerance, until it is further off than the other part.
PARKED_IN, PARKED_OUT = 0.6, 0.95


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
    masked: Sequence[Peer],
    elapsed_s: float,
    late: lateness.State,
) -> tuple[State, Wish]:
    """One tick on the way to `setup.robot.goal` by way of its way-points.

    Args:
        masked: those of the others that were left out of the map.
    """
    seen, frame = frame, predict.ahead(setup, late, frame)
    state, map = watch(setup, state, seen, map, others, elapsed_s)
    hits_m = sight.surely(setup, map.ranges_m, masked)
    others = last_word.later(setup, late, frame, others)
    state, aim = look(setup, state, seen, frame, hits_m, others, elapsed_s)
    if state.failed:
        state = msgspec.structs.replace(state, intent=Intent(), yields_to=None)
        return state, Wish(mode="FAILED", waypoint=aim.subgoal, reason=state.failed)
    rows, near = table.of(others, frame.pose.x_m, frame.pose.y_m, parked=state.parked)
    more_m = 2.0 * estimate.error_m(setup)  # the guard keeps them so much further off
    if len(rows):
        rows[:, table.RADIUS] += more_m
        if not state.parked:
            to_m, _ = target_of(setup, state)
            to_go_m = geometry.length(to_m[0] - frame.pose.x_m, to_m[1] - frame.pose.y_m)
            table.prefer_nearer(rows, to_go_m, setup.robot.speed_mps_max)
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
    state, choice = drive.choose(setup, state, frame, rows, points_m, aim, course)
    state, wish = drive.ask(setup, state, frame, rows, points_m, aim, course, choice)
    return headway.say_blocked(state, frame, wish, elapsed_s, among=len(others) > 0)


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
    before = now = state.movers
    if "movers" not in setup.navigator.without:
        now = movers.step(setup, before, seen, map.ranges_m, others, elapsed_s)
    known, gone = state.memory, movers.trail(before, now)
    heard = tuple([peer.beacon.name for peer in others])
    if heard != state.heard:
        bodies = bodies_of([peer for peer in others if peer.beacon.name not in state.heard], setup)
        gone = np.concatenate((gone, bodies))
    if known is not None and len(gone):
        known = memory.cleared(law(setup.navigator, setup.robot.body_radius_m), known, gone)
    state = msgspec.structs.replace(state, movers=now, memory=known, heard=heard)
    return state, standing(state, seen, map)


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


def look(
    setup: RobotSetup,
    state: State,
    seen: SensorFrame,
    frame: SensorFrame,
    hits_m: Ranges,
    others: Sequence[Peer],
    elapsed_s: float,
) -> tuple[State, Aim]:
    """Memory and way: where to go were there no peers.

    Args:
        seen: as it was measured.
        frame: with the pose at which what is decided now takes effect.
        hits_m: (beams,) of obstacles that are to be remembered.
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
    without = setup.navigator.without
    if "memory" in without:
        known = memory.empty(rules, pose, known.version + 1)
    if not is_there:
        state, known = headway.doubt(setup, rules, state, known, frame, others, elapsed_s)
    known, field_mm = memory.observe(rules, known, seen.pose, seen.ranges_m(), hits_m)
    # 2. Find the way.
    tolerance_m = setup.robot.goal_tolerance_m if is_last else setup.robot.via_tolerance_m
    found = way.step(rules, state.way, known, field_mm, pose, target, tolerance_m)
    state = replace(state, memory=known, way=found)
    if is_there:  # should it be pushed away it has all the time again
        state = replace(state, still_s=0.0, place=None, closed_s=0.0, best_m=1e9, best_s=0.0)
    else:
        state = headway.give_up(setup, state, others, goal_m, elapsed_s)
    # 3. Aim at the farthest point of it that can be driven to straight on.
    look_m = setup.navigator.look_m + setup.navigator.look_s * abs(frame.twist.speed_mps)
    factor = setup.navigator.chord_factor
    subgoal, index = way.subgoal(rules, found, known, field_mm, pose, look_m, factor)
    if "way" in without:
        subgoal = target
    open_mps = speed_mps = setup.robot.speed_mps_max
    if "speed" not in without and "way" not in without:
        speed_mps = speed.cap(
            setup, rules, found, known, field_mm, pose, frame.twist.speed_mps, subgoal, index
        )
    if is_last:
        open_mps = min(open_mps, speed.at_goal(setup, goal_m))
    speed_mps = min(speed_mps, open_mps)
    if not found.path and "way" not in without:
        speed_mps = open_mps = 0.0
    x_m, y_m = subgoal[0] - pose.x_m, subgoal[1] - pose.y_m
    direction_rad = pose.yaw_rad if (x_m, y_m) == (0.0, 0.0) else atan2(y_m, x_m)
    return state, Aim(
        direction_rad, speed_mps, subgoal, goal_m, is_last, state.failed, open_mps=open_mps
    )


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
