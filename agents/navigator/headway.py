"""Whether a robot gets on: doubts about what it remembers, and what it says when it does not.

still     -> forgets what is near        (the memory may be wrong: a body that has gone)
no way    -> forgets what it does not see, once; then it gives up, but not while others are near
no headway-> says that it is blocked, goes on trying, rests in between
"""

from __future__ import annotations

from collections.abc import Sequence
from math import pi

import msgspec

from agents.navigator import memory
from agents.navigator.law import Law
from agents.navigator.memory import Memory
from agents.navigator.state import State
from agents.peers import Peer
from agents.steering import Wish
from swarm import geometry
from swarm.messages import Intent, SensorFrame
from swarm.scenario import RobotSetup

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
    if not failed and best_s > setup.navigator.give_up_s and not others:
        failed = (
            "too-long"  # among others one may be what closes the way: it says that it is blocked
        )
    return replace(state, closed_s=closed_s, best_m=best_m, best_s=best_s, failed=failed)


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
