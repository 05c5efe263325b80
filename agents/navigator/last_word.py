"""The guard's place in a tick: what it is given, what it allows, and what is promised to others."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

import msgspec

from agents import lateness, msam, peers, steering
from agents.guard import Limit, share
from agents.navigator import brake, dodge, estimate, movers, pact, pledge, predict
from agents.navigator.state import State, obstacles, standing
from agents.peers import Peer
from swarm import geometry
from swarm.geometry import Twist
from swarm.messages import Beacon, Promise, SensorFrame
from swarm.scenario import RobotSetup


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
    if "guard" in setup.navigator.without:
        within = steering.scale_to_rims(setup.robot, asked)
        return state, within, Limit(setup.robot.speed_mps_max, "")
    frame = predict.ahead(setup, late, seen)
    map = standing(state, seen, map)
    moving = movers.ahead(
        state.movers, frame.pose.x_m, frame.pose.y_m, late.late_ticks * setup.dt_s
    )
    if len(moving) and "dodge" not in setup.navigator.without:
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
    if not pledge.is_kept(setup) or late.late_ticks != setup.disturbance.latency_ticks:
        return None
    pending = predict.pending(setup, late, frame)
    return pledge.promise(setup, set_point, state.where.doubt, pending)


def send(setup: RobotSetup, state: State, beacon: Beacon) -> State:
    """State after a beacon went out."""
    return msgspec.structs.replace(state, pact=pact.send(setup, state.pact, beacon))
