"""Peers as numbers, for the inner loops: one row each, relative to this robot.

others --rows within SIGHT_M--> (peers, COLUMNS)
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from agents import peers
from agents.navigator.compiled import compiled
from agents.peers import Peer
from swarm.geometry import Floats, Vec2, length

SIGHT_M = 5.5  # who is further away does not matter yet

# Columns: where it is from here, m; the velocity it means to have, m/s; where it wants to go, m
# from here; its top speed, body radius; whether it is on its way there; which part of giving way
# to it is ours; whether it is a risk at all, LAWLESS if no right of way holds for it.
X, Y, U_X, U_Y, TARGET_X, TARGET_Y, SPEED, RADIUS, ACTIVE, SHARE, RISK = range(11)
COLUMNS = 11

LAWLESS = 2.0
SHARE_OPEN = 0.5  # both give way alike
SHARE_PARKED = 0.6  # one that stands at its goal makes room, but less
SHARE_OTHERS = 0.8  # other controllers make little room
# Who gets to its goal sooner is soon out of the way: it makes way by less than half, the other by
# as much more. By how much less at most, and the time below which both are about there.
SHARE_SOONER, ABOUT_S = 0.25, 1.0
# All announce their top speed, also when the guard holds them: how much of it is believed of one
# that stands. Were it all, it would be fled from as if it came on.
BELIEVED = 0.5
# From this part of it on all of it: wheels go slower in curves, and whoever is behind would too.
UNDER_WAY = 0.8


def of(
    others: Sequence[Peer], x_m: float, y_m: float, *, parked: bool = False
) -> tuple[Floats, list[Peer]]:
    """Rows of the peers in sight that can move, and those peers, both in order of their names."""
    flat: list[float] = []  # one by one: arrays are made of lists of lists in twice the time
    seen: list[Peer] = []
    for peer in others:
        if peer.distance_m > SIGHT_M or peers.has_come_to_grief(peer.beacon):
            continue
        beacon, intent = peer.beacon, peer.beacon.intent
        if intent is None:
            u_x, u_y = peer.velocity()
            target, active, share = None, 0.0, SHARE_OTHERS
        else:
            u_x, u_y = intent.velocity
            if not parked and abs(beacon.twist.speed_mps) < UNDER_WAY * beacon.speed_mps_max:
                u_x, u_y = believed(intent.velocity, beacon.twist.speed_mps)
            target, active = intent.target, 1.0 if intent.active else 0.0
            share = SHARE_PARKED if beacon.arrived else SHARE_OPEN
        if target is None:
            to_x, to_y, active = 0.0, 0.0, 0.0
        else:
            to_x, to_y = target[0] - x_m, target[1] - y_m
        seen.append(peer)
        flat += (*peer.offset, u_x, u_y, to_x, to_y)
        flat += (beacon.speed_mps_max, beacon.body_radius_m, active, share, 1.0)
    return np.array(flat, dtype=np.float64).reshape(-1, COLUMNS), seen


def believed(velocity: Vec2, speed_mps: float) -> Vec2:
    """m/s, world: what to expect of an announced velocity at a measured speed."""
    most_mps = length(*velocity)
    if UNDER_WAY * most_mps <= abs(speed_mps):
        return velocity
    share = BELIEVED + (1.0 - BELIEVED) * abs(speed_mps) / (UNDER_WAY * most_mps)
    return share * velocity[0], share * velocity[1]


@compiled
def prefer_nearer(rows: Floats, distance_m: float, speed_mps: float) -> None:
    """Share giving way by who gets to its target sooner: the two shares add up to one.

    Args:
        rows: shares of those on their way are filled in.
        distance_m, speed_mps: of this robot to its target, and its top speed.
    """
    mine_s = distance_m / speed_mps
    for row in range(rows.shape[0]):
        if rows[row, ACTIVE] > 0.0 and rows[row, SHARE] == SHARE_OPEN:
            x_m = rows[row, TARGET_X] - rows[row, X]
            y_m = rows[row, TARGET_Y] - rows[row, Y]
            theirs_s = np.sqrt(x_m * x_m + y_m * y_m) / rows[row, SPEED]
            more = (mine_s - theirs_s) / (mine_s + theirs_s + ABOUT_S)
            rows[row, SHARE] += SHARE_SOONER * more
