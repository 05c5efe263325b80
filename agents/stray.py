"""Two followers that have blocked each other: the worse claim backs off.

    held by a better claim for long --> away from it, on a way that is found --> AVOID, FORM

Their guards let neither move, and neither waits for the other for ever.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import atan2

import msgspec

from agents.peers import Peer
from agents.priority import Claim

# In a jam: held by a peer with a better claim, at an end of this distance, for so long in all. Then
# it backs off for so long, at this speed, to a point this far away.
JAM_M = 1.5
JAM_S = 3.0
JAM_FORGET = 0.25
BACK_S = 2.5
BACK_MPS = 0.4
BACK_M = 1.0


class State(msgspec.Struct, frozen=True):
    """How long a follower has been held up, and for how long it goes on backing off."""

    jam_s: float = 0.0  # held by a peer with a better claim
    back_s: float = 0.0  # still to back off


def step(
    state: State, others: Iterable[Peer], claim: Claim, held_by: str, elapsed_s: float
) -> tuple[State, float | None]:
    """State after a tick, and the world direction to back off to, None when it need not.

    Args:
        held_by: peer that lets it not move, "" when there is none.
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
        return State(jam_s), None
    nearest = min(before, key=_distance_of)
    return State(back_s=back_s - elapsed_s), atan2(-nearest.offset[1], -nearest.offset[0])


def _distance_of(peer: Peer) -> float:
    return peer.distance_m
