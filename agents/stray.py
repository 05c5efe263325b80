"""A follower that does not get away from a place: round what is in its way, like one alone.

    on the spot for long --> the way-point as a goal: ROUND, then GO --near it again--> AVOID, FORM

The potential field of AVOID has no memory: behind the body of a robot that was lost in a gap it
comes to rest, or turns on the spot, until somebody tells it to go round.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import atan2

import msgspec

from agents import mission, msam, rotation, seek, steering
from agents.mission import Mission
from agents.peers import Peer
from agents.priority import Claim
from agents.steering import Wish
from swarm import geometry
from swarm.geometry import Pose, Vec2
from swarm.messages import Forces
from swarm.scenario import RobotSetup

# Nearer than this to its way-point a follower has not strayed.
NEAR_M = 1.0
# Stuck: within this of one place for so long. A formation that waits for its last moves on faster.
STUCK_M = 0.8
STUCK_S = 11.0
# In a jam: held by a peer with a better claim, at an end of this distance, for so long in all. Then
# it backs off for so long, at this speed, looking this far for a free way.
JAM_M = 1.5
JAM_S = 3.0
JAM_FORGET = 0.25
BACK_S = 2.5
BACK_MPS = 0.4
BACK_LOOK_M = 0.8
# Going round takes no longer; then the field is tried again, and after it perhaps the other side.
ROUND_S_MAX = 30.0


class State(msgspec.Struct, frozen=True):
    """How long a follower has been in one place, and its own way while it goes round."""

    place: Vec2 | None = None  # world
    stuck_s: float = 0.0  # there
    seeking: seek.State | None = None  # None: not gone astray
    astray_s: float = 0.0
    jam_s: float = 0.0  # held by a peer with a better claim
    back_s: float = 0.0  # still to back off


def back_off(
    setup: RobotSetup,
    state: State,
    pose: Pose,
    map: msam.Map,
    others: Iterable[Peer],
    claim: Claim,
    held_by: str,
    elapsed_s: float,
) -> tuple[State, Wish | None]:
    """Away from a peer with a better claim, when the two have blocked each other for long.

    Their guards let neither move, and neither waits for the other for ever: the worse claim goes.
    """
    before = [peer for peer in others if peer.beacon.priority < claim and peer.distance_m < JAM_M]
    jam_s, back_s = state.jam_s, state.back_s
    if any(peer.beacon.name == held_by for peer in before):
        jam_s += elapsed_s
    else:
        jam_s = max(0.0, jam_s - JAM_FORGET * elapsed_s)
    if back_s <= 0.0 and jam_s > JAM_S:
        jam_s, back_s = 0.0, BACK_S
    if back_s <= 0.0 or not before:
        return msgspec.structs.replace(state, jam_s=jam_s, back_s=0.0), None
    nearest = min(before, key=_distance_of)
    away_rad = atan2(-nearest.offset[1], -nearest.offset[0])
    free_rad = steering.choose_direction(
        setup.steering,
        map,
        pose.yaw_rad,
        away_rad,
        away_rad,
        clear_m=setup.robot.body_radius_m + setup.steering.gap_margin_follower_m,
        look_m=BACK_LOOK_M,
    )
    back = State(back_s=back_s - elapsed_s)
    if free_rad is None:
        return back, Wish(mode="AVOID")
    towards = geometry.unit(free_rad)
    speed_mps, turn_rate_radps = steering.head(
        setup.steering, setup.robot, towards, pose.yaw_rad, BACK_MPS
    )
    forces = Forces(resultant=towards)
    return back, Wish("AVOID", speed_mps, turn_rate_radps, forces=forces)


def _distance_of(peer: Peer) -> float:
    return peer.distance_m


def step(
    setup: RobotSetup,
    state: State,
    pose: Pose,
    map: msam.Map,
    others: Iterable[Peer],
    point: Vec2,
    *,
    extended: bool,
    waiting: bool,
    elapsed_s: float,
) -> tuple[State, Wish | None]:
    """One tick of the clock that runs on the spot; a wish of its own while astray.

    Args:
        point: the follower's way-point.
        waiting: whether it gave way in the tick before; the clocks then stand.
    """
    place, here = state.place, (pose.x_m, pose.y_m)
    away_m = geometry.length(point[0] - here[0], point[1] - here[1])
    if away_m < NEAR_M or not extended:
        return State(), None
    seeking, astray_s = state.seeking, state.astray_s
    if seeking is None:
        if place is None or geometry.length(here[0] - place[0], here[1] - place[1]) > STUCK_M:
            return State(here, jam_s=state.jam_s), None
        stuck_s = state.stuck_s + (0.0 if waiting else elapsed_s)
        if stuck_s < STUCK_S:
            return State(place, stuck_s, jam_s=state.jam_s), None
        memory = rotation.State(best_m=away_m, reference_m=away_m, stalled_s=stuck_s)
        seeking, astray_s = seek.State(rotation=memory), 0.0
    seeking, wish = seek.step(
        mission.bound_for(setup, Mission(point)),
        seeking,
        pose,
        map,
        others,
        speed_mps=setup.robot.speed_mps_max,
        extended=True,
        waiting=waiting,
        elapsed_s=elapsed_s,
    )
    astray_s += 0.0 if waiting else elapsed_s
    if wish.mode == "FAILED" or astray_s > ROUND_S_MAX:
        return State(), None
    return State(place, state.stuck_s, seeking, astray_s, state.jam_s), wish
