"""Who passes first, who waits and who leads (section 3.3.1).

    setup --claim--> beacon        claims of the peers --step--> the peer to wait for

Order is decided from published claims only, which are rounded integers: every robot that hears
two claims orders them alike.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import cos, pi, sin
from typing import Literal

import msgspec

from agents import peers
from agents.peers import Peer
from swarm import geometry
from swarm.geometry import Pose, Twist, Vec2
from swarm.messages import Name, Slot
from swarm.scenario import Priority, RobotSetup

Claim = tuple[int, int, int, int]
# What a robot is at the moment: an election changes it.
Role = Literal["leader", "follower", "alone"]

# Slot distances and angles are compared in thousandths (of 1/m and rad).
CLAIM_STEP = 1e-3
# In a formation a robot waits when one with a better claim is this near beyond the safe distance,
FORMATION_MARGIN_M = 0.12
# and within this angle of its heading.
FORMATION_AHEAD_RAD = 1.2
# Without a formation, where a waiting robot would go is judged at this share of its top speed.
ASSUMED_SPEED = 0.8


class State(msgspec.Struct, frozen=True):
    """For whom a robot waits, and since when."""

    yields_to: Name | None = None
    hold_s: float = 0.0  # without a formation: still waits this long after the last reason
    waited_s: float = 0.0  # this long without a break


def claim(role: Role, slot: Slot | None, row: int) -> Claim:
    """Claim of eq. 65 and 66; the smaller one passes first.

    A leader before its followers; of these the one nearer to the leader (larger p^d = 1/d), then
    the one with the larger p^a = sgn(alpha) (pi/2 - |alpha|), then the smaller id. The paper
    leaves open which of two unequal values wins; so read, the order is total.
    """
    if role == "leader":
        return (0, 0, 0, row)
    if role == "alone" or slot is None:
        return (1, 0, 0, row)
    return follower_claim(slot, row)


def follower_claim(slot: Slot, row: int) -> Claim:
    """Claim of a follower, from its nominal slot."""
    alpha = slot.bearing_rad
    sign = (alpha > 0.0) - (alpha < 0.0)
    p_distance = 1.0 / max(slot.distance_m, CLAIM_STEP)
    p_angle = sign * (pi / 2.0 - abs(alpha))
    return (1, -round(p_distance / CLAIM_STEP), -round(p_angle / CLAIM_STEP), row)


def step(
    setup: RobotSetup,
    state: State,
    role: Role,
    mine: Claim,
    pose: Pose,
    twist: Twist,
    direction_rad: float,
    others: Iterable[Peer],
    elapsed_s: float,
) -> State:
    """For whom to wait in this tick.

    Robots that wait themselves or have arrived are never waited for: with a total order nobody
    can then wait in a circle. A leader waits for nobody; robots that treat each other as moving
    obstacles do not either.

    Args:
        mine: own claim.
        direction_rad: world direction of the force on this robot.
        others: those heard lately; the body of any other is an obstacle.
    """
    before = [
        peer for peer in others if peer.beacon.priority < mine and not peers.stands(peer.beacon)
    ]
    if role == "follower":
        return _in_formation(setup, state, pose, twist, before, elapsed_s)
    if role == "leader" or setup.priority.strategy == "mutual":
        return State()
    return _without_formation(setup, state, pose, direction_rad, before, elapsed_s)


def _in_formation(
    setup: RobotSetup,
    state: State,
    pose: Pose,
    twist: Twist,
    before: list[Peer],
    elapsed_s: float,
) -> State:
    velocity = _velocity(pose, twist.speed_mps)
    near = [
        peer
        for peer in before
        if peer.distance_m < peers.safe_distance(setup, peer) + FORMATION_MARGIN_M
        and abs(peer.bearing_rad) < FORMATION_AHEAD_RAD
        and _closing(peer, velocity) < 0.0
    ]
    if not near:
        return State()
    waited_s = state.waited_s + elapsed_s
    # Waiting is bounded, so nobody starves; the clock starts again once the reason has gone.
    if waited_s > setup.priority.yield_s_max:
        return State(waited_s=waited_s)
    return State(yields_to=_best(near), waited_s=waited_s)


def _without_formation(
    setup: RobotSetup,
    state: State,
    pose: Pose,
    direction_rad: float,
    before: list[Peer],
    elapsed_s: float,
) -> State:
    priority = setup.priority
    assumed_mps = ASSUMED_SPEED * setup.robot.speed_mps_max
    going = (assumed_mps * cos(direction_rad), assumed_mps * sin(direction_rad))
    near = [
        peer
        for peer in before
        if peer.distance_m < priority.yield_reach_m
        and any(
            comes_too_near(priority, setup.robot.body_radius_m, peer, velocity)
            for velocity in (going, (0.0, 0.0))
        )
    ]
    if near:
        waited_s = state.waited_s + elapsed_s
        # Bounded here too: one that stands for good, and says that it goes, holds up nobody.
        if waited_s > priority.wait_s_max:
            return State(hold_s=priority.yield_hold_s, waited_s=waited_s)
        return State(_best(near), priority.yield_hold_s, waited_s)
    hold_s = state.hold_s - elapsed_s
    if hold_s <= 0.0:
        return State()
    return State(state.yields_to, hold_s, state.waited_s + elapsed_s)


def comes_too_near(priority: Priority, radius_m: float, peer: Peer, velocity: Vec2) -> bool:
    """Whether a peer is closing in and will pass within the margin before the horizon."""
    closing = _closing(peer, velocity)
    if closing >= 0.0:
        return False
    v_x, v_y = peer.velocity()
    u_x, u_y = v_x - velocity[0], v_y - velocity[1]
    after_s = min(-closing / (u_x * u_x + u_y * u_y), priority.yield_horizon_s)
    x_m, y_m = peer.offset[0] + u_x * after_s, peer.offset[1] + u_y * after_s
    touch_m = radius_m + peer.beacon.body_radius_m
    return geometry.length(x_m, y_m) < touch_m + priority.yield_margin_m


def _closing(peer: Peer, velocity: Vec2) -> float:
    """dq . (v_j - v_i) in m2/s, negative while the distance shrinks."""
    x, y = peer.velocity()
    return peer.offset[0] * (x - velocity[0]) + peer.offset[1] * (y - velocity[1])


def _velocity(pose: Pose, speed_mps: float) -> Vec2:
    return (speed_mps * cos(pose.yaw_rad), speed_mps * sin(pose.yaw_rad))


def _best(others: list[Peer]) -> Name:
    return min(others, key=_claim_of).beacon.name


def _claim_of(peer: Peer) -> Claim:
    return peer.beacon.priority
