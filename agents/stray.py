"""A follower that does not get away from a place: round what is in its way, like one alone.

    on the spot for long --> the way-point as a goal: ROUND, then GO --near it again--> AVOID, FORM

The potential field of AVOID has no memory: behind the body of a robot that was lost in a gap it
comes to rest, or turns on the spot, until somebody tells it to go round.
"""

from __future__ import annotations

from collections.abc import Iterable

import msgspec

from agents import mission, msam, rotation, seek
from agents.mission import Mission
from agents.peers import Peer
from agents.steering import Wish
from swarm import geometry
from swarm.geometry import Pose, Vec2
from swarm.scenario import RobotSetup

# Nearer than this to its way-point a follower has not strayed.
NEAR_M = 1.0
# Stuck: within this of one place for so long. A formation that waits for its last moves on faster.
STUCK_M = 0.8
STUCK_S = 11.0
# Going round takes no longer; then the field is tried again, and after it perhaps the other side.
ROUND_S_MAX = 30.0


class State(msgspec.Struct, frozen=True):
    """How long a follower has been in one place, and its own way while it goes round."""

    place: Vec2 | None = None  # world
    stuck_s: float = 0.0  # there
    seeking: seek.State | None = None  # None: not gone astray
    astray_s: float = 0.0


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
            return State(here), None
        stuck_s = state.stuck_s + (0.0 if waiting else elapsed_s)
        if stuck_s < STUCK_S:
            return State(place, stuck_s), None
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
    return State(place, state.stuck_s, seeking, astray_s), wish
