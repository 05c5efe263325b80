"""Which follower has which slot: the leader decides, at least cost, and as seldom as it can.

    followers heard, places of the formation --plan--> the slots that must change

A new leader gives out all slots anew, so that the squares of the ways to them are least in sum.
Later nobody moves for somebody else: who is lost leaves a hole, who comes gets its own slot back
when that is free, and else the free one that is nearest.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence

import msgspec

from agents import assignment, formation
from agents.peers import Peer
from swarm.geometry import Pose, Vec2
from swarm.messages import Name, Slot

Assignments = tuple[tuple[Name, Slot], ...]

# A slot on which a body stands is worth a detour of any length.
BLOCKED_COST_M2 = 1e9


class State(msgspec.Struct, frozen=True):
    """What the leader has decided; kept while the same followers are there."""

    followers: tuple[Name, ...] = ()
    plan: Assignments = ()  # in order of names
    elected: bool = False  # all slots are to be given out anew
    settled: bool = False  # slots on which bodies stand have been looked for at the goal


def step(
    state: State,
    places: Sequence[Slot],
    leader: Pose,
    heading_rad: float,
    followers: Sequence[Peer],
    bodies: Collection[Vec2],
    *,
    clear_m: float,
    arrived: bool,
) -> State:
    """Plan of this tick.

    Args:
        followers: those to be led, in order of names.
        bodies: where something stands for good that was a robot.
        clear_m: nearest that a slot may be to one of them.
        arrived: the slots do not move any more.
    """
    names = tuple([peer.beacon.name for peer in followers])
    look = arrived and not state.settled and len(bodies) > 0
    if names == state.followers and not look and not state.elected:
        return state
    points = [
        formation.waypoint(leader, heading_rad, place.distance_m, place.bearing_rad)
        for place in places
    ]
    blocked = set()
    if arrived:
        blocked = {
            number
            for number, point in enumerate(points)
            if any(_square(point, body) < clear_m * clear_m for body in bodies)
        }
    kept = {} if state.elected else _kept(state.plan, places, followers, blocked)
    taken = set(kept.values())
    homeless = [peer for peer in followers if peer.beacon.name not in kept]
    free = [number for number in range(len(places)) if number not in taken]
    homeless = homeless[: len(free)]
    if homeless:
        costs = [
            [
                _square((peer.pose.x_m, peer.pose.y_m), points[number])
                + (BLOCKED_COST_M2 if number in blocked else 0.0)
                for number in free
            ]
            for peer in homeless
        ]
        for peer, column in zip(homeless, assignment.solve(costs), strict=True):
            kept[peer.beacon.name] = free[column]
    plan = tuple([(name, places[kept[name]]) for name in names if name in kept])
    return State(names, plan, elected=False, settled=arrived)


def changes(state: State, followers: Sequence[Peer]) -> Assignments:
    """What the followers do not have yet of the plan."""
    has = {peer.beacon.name: peer.beacon.slot for peer in followers}
    return tuple([(name, slot) for name, slot in state.plan if has.get(name) != slot])


def _kept(
    plan: Assignments, places: Sequence[Slot], followers: Sequence[Peer], blocked: Collection[int]
) -> dict[Name, int]:
    """Number of the place of everybody who stays in it: first those of the plan."""
    numbers = {place: number for number, place in enumerate(places)}
    planned = dict(plan)
    kept: dict[Name, int] = {}
    taken = set(blocked)
    for peer in followers:
        slot = planned.get(peer.beacon.name)
        if slot is not None and (number := numbers[slot]) not in taken:
            kept[peer.beacon.name] = number
            taken.add(number)
    for peer in sorted(followers, key=_claim_of):
        slot = peer.beacon.slot
        if peer.beacon.name in planned or slot is None:
            continue
        number = numbers.get(slot, -1)
        if number >= 0 and number not in taken:
            kept[peer.beacon.name] = number
            taken.add(number)
    return kept


def _claim_of(peer: Peer) -> tuple[int, int, int, int]:
    return peer.beacon.priority


def _square(one: Vec2, other: Vec2) -> float:
    x_m, y_m = one[0] - other[0], one[1] - other[1]
    return x_m * x_m + y_m * y_m
