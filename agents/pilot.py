"""Where to go, for a member of a formation: the stages up to the aim, then the formation decides.

    scan, members --watch--> memory          memory, goal --to_goal--> Aim        a leader
                                             memory, point --to_point--> Aim      a slot that moves

Who goes first is said by the slots, and members are kept off by forces and guards of their own:
here they are neither obstacles nor do they promise anything.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import atan2

import msgspec
import numpy as np

from agents import msam, navigator
from agents.navigator import forces, headway, memory, movers, speed, way
from agents.navigator.aim import Aim
from agents.navigator.law import Law, law
from agents.navigator.state import State, obstacles
from agents.peers import Peer, has_come_to_grief
from swarm import geometry
from swarm.geometry import Floats, Vec2
from swarm.messages import Forces, Reason, SensorFrame
from swarm.scenario import Navigator, RobotSetup

# Repulsion of members: they press each other towards walls, which it has to make up for. So it
# reaches further from the body's surface than that of a robot alone, and is stronger, up to this
# share of the attraction.
REACH_M, REPULSION_M2, REPULSION_MAX = 0.6, 0.03, 0.5
# This little further off than the guard's margin it is in touch: nearer, the guard lets nothing
# move that is not on its way out.
SPARE_M = 0.02
# A body that has moved on has left its hits this near to where it is now, at most.
TRAIL_M = 0.2
# A way to a point that moves is kept until that is so far from its end.
MOVED_M = 0.25
# Where the point is blocked, this near to it is near enough.
NEAR_M = 1.5
# Slower than this it stands because it is there, or waits.
STANDS_MPS = 0.1


def touch_m(setup: RobotSetup) -> float:
    """Room that a member needs, from the body's surface, for its guard to let it go on."""
    return setup.guard.strip_margin_m + SPARE_M


@lru_cache(maxsize=32)
def roomy(navigator: Navigator, room_m: float) -> Navigator:
    """Parameters by which ways with less room are the last resort."""
    return msgspec.structs.replace(navigator, hard_m=max(navigator.hard_m, room_m))


def rules_of(setup: RobotSetup) -> Law:
    """The law of clearances for a member."""
    return law(roomy(setup.navigator, touch_m(setup)), setup.robot.body_radius_m)


def to_goal(
    setup: RobotSetup,
    state: State,
    frame: SensorFrame,
    map: msam.Map,
    *,
    held: bool,
    elapsed_s: float,
) -> tuple[State, Aim]:
    """By way of the way-points to the goal, by all stages of a robot alone up to the aim."""
    setup = msgspec.structs.replace(setup, navigator=roomy(setup.navigator, touch_m(setup)))
    state = msgspec.structs.replace(state, held=held)
    state, aim = navigator.look(setup, state, frame, frame, map.ranges_m, (), elapsed_s)
    return state, navigator.straightened(setup, state, frame, frame, map, aim)


def push(
    setup: RobotSetup, direction_rad: float, pull: float, robots: Vec2, points_m: Floats
) -> Forces:
    """Forces on a robot that is attracted in a direction by so much, and pushed off by others.

    Repulsion works across the attraction; near contact nothing pulls inwards, others do not either.

    Args:
        points_m: (points, 2) m, world axes, from the robot: obstacles.
    """
    x, y = geometry.unit(direction_rad)
    attractive = (pull * x, pull * y)
    bounds, radius_m = memory.beams(forces.SECTORS).bounds, setup.robot.body_radius_m
    barrier_m = setup.navigator.barrier_m
    across_x, across_y, _, _ = forces.field(
        points_m, bounds, x, y, radius_m, REACH_M, REPULSION_M2, REPULSION_MAX, barrier_m
    )
    repulsive = (pull * across_x, pull * across_y)
    x, y = attractive[0] + repulsive[0] + robots[0], attractive[1] + repulsive[1] + robots[1]
    size = geometry.length(x, y)
    if size == 0.0:
        return Forces(attractive, repulsive, robots=robots)
    _, _, turned_x, turned_y = forces.field(
        points_m,
        bounds,
        x / size,
        y / size,
        radius_m + touch_m(setup),
        REACH_M,
        0.0,
        0.0,
        barrier_m,
    )
    resultant = (size * turned_x, size * turned_y)
    rotating = (resultant[0] - x, resultant[1] - y)
    return Forces(attractive, repulsive, rotating, robots, resultant)


def watch(
    setup: RobotSetup,
    state: State,
    frame: SensorFrame,
    map: msam.Map,
    others: Sequence[Peer],
    masked: Sequence[Peer],
    elapsed_s: float,
) -> State:
    """State that has forgotten where bodies were that have moved on since.

    Unlike for a robot alone, what moves stays on the map: nothing here foresees where it goes.

    Args:
        others: all who are heard; masked: those whose bodies are not on the map.
    """
    before = state.movers
    now = movers.step(setup, before, frame, map.ranges_m, others, elapsed_s)
    known, gone = state.memory, movers.trail(before, now)
    names = tuple([peer.beacon.name for peer in masked])
    moved = [peer for peer in masked if peer.beacon.name not in state.heard]
    if len(masked) < len(others):
        moved += [
            peer
            for peer in others
            if peer.beacon.name not in names and not has_come_to_grief(peer.beacon)
        ]
    if moved:
        gone = np.concatenate((gone, _bodies(moved)))
    if known is not None and len(gone):
        known = memory.cleared(rules_of(setup), known, gone)
    return msgspec.structs.replace(state, movers=now, memory=known, heard=names)


def _bodies(peers: Sequence[Peer]) -> Floats:
    """(peers, 3) m: x, y, radius, world: where hits on those lie."""
    return np.array(
        [(peer.pose.x_m, peer.pose.y_m, peer.beacon.body_radius_m + TRAIL_M) for peer in peers]
    ).reshape(-1, 3)


def remember(
    setup: RobotSetup, state: State, frame: SensorFrame, map: msam.Map, elapsed_s: float
) -> State:
    """State of a follower after one scan."""
    rules = rules_of(setup)
    pose = frame.pose
    known = memory.shifted(rules, state.memory or memory.empty(rules, pose), pose)
    if state.way is not None:
        state, known = headway.doubt(setup, rules, state, known, frame, (), elapsed_s)
    known, _ = memory.observe(rules, known, pose, frame.ranges_m(), map.ranges_m)
    return msgspec.structs.replace(state, memory=known, forgot=False)


def around(
    setup: RobotSetup, state: State, frame: SensorFrame, map: msam.Map, reach_m: float
) -> Floats:
    """(points, 2) m, world axes, from the robot: what it sees and remembers."""
    return obstacles(setup, state, frame, frame, map, reach_m)


def reach_m(setup: RobotSetup) -> float:
    """From the robot's centre, of what pushes it off."""
    return setup.robot.body_radius_m + max(REACH_M, setup.navigator.barrier_m)


def is_clear(
    setup: RobotSetup, state: State, frame: SensorFrame, map: msam.Map, way_m: Vec2, margin_m: float
) -> bool:
    """Whether the body has so much room on a straight way.

    Args:
        way_m: to its end, m, world axes.
    """
    assert state.memory is not None
    keep_m = setup.robot.body_radius_m + margin_m
    return memory.is_clear(state.memory, frame.pose, map.ranges_m, frame.pose, way_m, keep_m)


def stay(state: State) -> State:
    """State of a robot that needs no way now."""
    if state.way is None:
        return state
    return msgspec.structs.replace(state, way=None, closed_s=0.0, place=None, still_s=0.0)


def to_point(
    setup: RobotSetup,
    state: State,
    frame: SensorFrame,
    map: msam.Map,
    point: Vec2,
    *,
    held: bool,
    elapsed_s: float,
) -> tuple[State, Aim]:
    """Straight to a point that moves where that is clear, else on the way to where it was lately.

    Args:
        held: something else keeps it, so that there is nothing to doubt.
    """
    replace = msgspec.structs.replace
    rules = rules_of(setup)
    pose, known = frame.pose, state.memory
    assert known is not None
    field_mm = known.field_mm(rules)
    to_x_m, to_y_m = point[0] - pose.x_m, point[1] - pose.y_m
    away_m = geometry.length(to_x_m, to_y_m)
    most_mps = setup.robot.speed_mps_max
    direction_rad = pose.yaw_rad if away_m == 0.0 else atan2(to_y_m, to_x_m)
    if is_clear(setup, state, frame, map, (to_x_m, to_y_m), setup.navigator.comfort_m):
        aim = Aim(direction_rad, most_mps, point, away_m, is_last=True, open_mps=most_mps)
        return stay(state), aim
    before = state.way or way.Way(point)
    moved_m = geometry.length(before.target[0] - point[0], before.target[1] - point[1])
    if before.search is None and moved_m > MOVED_M:
        before = way.towards(before, point)
    found = way.step(rules, before, known, field_mm, pose, before.target, NEAR_M)
    closed_s = 0.0 if found.path else state.closed_s + elapsed_s
    state = replace(state, way=found, closed_s=closed_s, held=held)
    if not found.path:
        reason: Reason = "enclosed" if found.closed else ""
        return state, Aim(direction_rad, 0.0, point, away_m, is_last=True, reason=reason)
    look_m = setup.navigator.look_m + setup.navigator.look_s * abs(frame.twist.speed_mps)
    factor = setup.navigator.chord_factor
    subgoal, index = way.subgoal(rules, found, known, field_mm, pose, look_m, factor)
    speed_mps = speed.cap(
        setup, rules, found, known, field_mm, pose, frame.twist.speed_mps, subgoal, index
    )
    x_m, y_m = subgoal[0] - pose.x_m, subgoal[1] - pose.y_m
    if (x_m, y_m) != (0.0, 0.0):
        direction_rad = atan2(y_m, x_m)
    return state, Aim(direction_rad, speed_mps, subgoal, away_m, is_last=True, open_mps=most_mps)
