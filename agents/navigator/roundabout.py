"""A virtual roundabout: robots whose straight ways conflict all go round one centre, to its right.

    straight ways of both --closest approach--> conflicts --midpoints--> centre, remembered
    bearings round the centre --gaps--> radius --tangent--> direction

Nobody agrees with anybody: all see about the same conflicts, and so about the same centre.
"""

from __future__ import annotations

from itertools import pairwise
from math import asin, atan2, cos, pi, sin, sqrt

import msgspec
import numpy as np

from agents.navigator import table
from agents.navigator.compiled import compiled
from swarm.geometry import Floats, Vec2, length, wrap_angle

HORIZON_S = 8.0  # of conflicts
SPACING_M = 0.2  # hull to hull: less at the closest approach is a conflict
# A small ring is made wider by this much between neighbours, who then keep their order on it.
WIDE_M, SMALL_M = 0.1, 1.8
RING_M = 0.2  # between neighbours on a ring, hull to hull
ARRIVED_M = 0.3  # a peer this near to its target goes nowhere
# Centre and radius follow what is seen of them by such parts in a tick: as soon as all turn,
# straight ways tell little of the centre, and a radius that jumps as neighbours come into sight
# and go breaks up the ring. Both are forgotten this long after the last conflict.
FOLLOW, FOLLOW_RING = 0.002, 0.05
# Where more than so many conflict at once they follow less, by the square of how many more.
FEW = 4
# Of a ring larger than this only an arc is in sight: what is seen tells more as it goes on.
LARGE_M, FOLLOW_LARGE = 4.0, 0.003
MEMORY_S = 1.6
RADIUS_M_MAX = 8.0
LONE_GAP = 1.6  # a gap this many times the mean one is not part of the ring
BEYOND_S = 1.5  # a conflict so soon before either arrives is not one to go round
CLEAR_SHARE = 0.95  # of the way to the ring: a goal that is no nearer to the centre is this side
INSIDE_RAD_MAX = 0.6  # inside the circle it goes outwards by this at most
LEAVE_RAD = 0.6 * pi  # a goal further left of the centre than this is not beyond it
# Conflicts further off the centre than its ring, or so much, are others than it is for.
STRAY_M = 1.0
# On a ring nobody goes away from its goal by more than little: one that asks for that is not round
# what lies between, and leads astray.
TURN_RAD_MAX = 95.0 * pi / 180.0
SHARE_MIN = 0.4  # of its speed that a robot keeps whoever is ahead: that one may stand
SPEED_MIN = 0.3  # of the top speed; slower robots do not go round


class State(msgspec.Struct, frozen=True):
    """Centre and radius, for as long as they are kept in mind."""

    centre: Vec2 | None = None  # m, world
    idle_s: float = 0.0  # since the last conflict
    ring_m: float = 0.0  # radius; 0: not known yet
    most: int = 0  # conflicts at once since it is kept in mind


class Turn(msgspec.Struct, frozen=True):
    """How to go round."""

    direction_rad: float  # world
    share: float  # of the speed


def step(
    state: State,
    position: Vec2,
    target: Vec2,
    direction_rad: float,
    speed_mps: float,
    radius_m: float,
    peers: Floats,
    elapsed_s: float,
) -> tuple[State, Turn | None]:
    """How to go round the centre, None where the way is not round it.

    Args:
        target: m, world: what this robot announces as its own.
        direction_rad: world, to where it goes without a roundabout.
        speed_mps: its top speed.
        peers: rows of `table`.
    """
    if not len(peers) and state.centre is None:
        return state, None
    to_x, to_y = target[0] - position[0], target[1] - position[1]
    met = np.zeros(len(peers))
    found = np.zeros(5)
    if len(peers):
        conflicts(to_x, to_y, speed_mps, radius_m, peers, met, found)
    if found[0] > 0.0:
        seen = (position[0] + float(found[1]), position[1] + float(found[2]))
        idle_s = 0.0
        if state.centre is not None and strays(state.centre, seen, state.ring_m):
            idle_s = state.idle_s + elapsed_s
        if state.centre is None or idle_s > MEMORY_S:
            state, centre, idle_s = State(), seen, 0.0
        elif idle_s > 0.0:
            centre = state.centre
        else:
            follow = FOLLOW_LARGE if state.ring_m > LARGE_M else FOLLOW * steady(state.most)
            centre = (
                state.centre[0] + follow * (seen[0] - state.centre[0]),
                state.centre[1] + follow * (seen[1] - state.centre[1]),
            )
        state = State(centre, idle_s, state.ring_m, max(state.most, int(found[0])))
    elif state.centre is None or state.idle_s + elapsed_s > MEMORY_S:
        return State(), None
    else:
        state = State(state.centre, state.idle_s + elapsed_s, state.ring_m, state.most)
    assert state.centre is not None
    x_m, y_m = state.centre[0] - position[0], state.centre[1] - position[1]
    away_m = length(x_m, y_m)
    bearings = [atan2(-y_m, -x_m)]
    spacing_m = 2.0 * radius_m + RING_M
    for row in met.nonzero()[0].tolist():
        bearings.append(atan2(float(peers[row, 1]) - y_m, float(peers[row, 0]) - x_m))
        spacing_m = max(spacing_m, radius_m + float(peers[row, table.RADIUS]) + RING_M)
    apart_rad = gap(bearings)
    ring_m = radius(apart_rad, spacing_m)
    ring_m = max(ring_m, min(radius(apart_rad, spacing_m + WIDE_M), SMALL_M))
    if len(bearings) > 1:  # else nobody is in the way any more: the ring may be left
        if state.ring_m > 0.0 and max(state.ring_m, ring_m) <= LARGE_M:
            ring_m = state.ring_m + FOLLOW_RING * steady(state.most) * (ring_m - state.ring_m)
        state = msgspec.structs.replace(state, ring_m=ring_m)
    centre_rad = atan2(y_m, x_m)
    if away_m > ring_m:
        tangent_rad = atan2(ring_m, sqrt(away_m * away_m - ring_m * ring_m))
    else:
        tangent_rad = pi / 2.0 + min(INSIDE_RAD_MAX, ring_m - away_m)
    aside_rad = wrap_angle(direction_rad - centre_rad)
    if aside_rad < 0.0:
        # Straight on to a goal that lies this side of the ring is out of everybody's way.
        goal_m = length(to_x, to_y)
        ahead_m = away_m * cos(aside_rad)
        goal_x, goal_y = to_x - x_m, to_y - y_m
        nearest_m = away_m if ahead_m <= 0.0 else length(goal_x, goal_y)
        if (ahead_m <= 0.0 or ahead_m >= goal_m) and nearest_m >= CLEAR_SHARE * min(ring_m, away_m):
            return state, None
    if -tangent_rad < aside_rad < min(LEAVE_RAD, TURN_RAD_MAX - tangent_rad):
        share = zipped(bearings, spacing_m, ring_m)
        return state, Turn(wrap_angle(centre_rad - tangent_rad), share)
    return state, None


def zipped(bearings: list[float], spacing_m: float, ring_m: float) -> float:
    """Share of its speed at which a robot leaves its room to who is next ahead on the ring.

    Whoever has too little of it falls back until it has enough, and leaves a place to those who
    are beside it and further out: otherwise nobody makes way for them, and they go round outside.

    Args:
        bearings: round the centre, the own one first.
    """
    needed_rad = 2.0 * asin(min(1.0, spacing_m / (2.0 * ring_m)))
    ahead_rad = min([(other - bearings[0]) % (2.0 * pi) for other in bearings[1:]], default=pi)
    return max(SHARE_MIN, min(1.0, ahead_rad / needed_rad))


def steady(most: int) -> float:
    """How much centre and radius of a ring follow what is seen: the more are on it the less."""
    return min(1.0, FEW / max(1, most)) ** 2


def strays(centre: Vec2, seen: Vec2, ring_m: float) -> bool:
    """Whether conflicts are not those that a remembered centre is for: seen too far off it."""
    return length(seen[0] - centre[0], seen[1] - centre[1]) > max(ring_m, STRAY_M)


def gap(bearings: list[float]) -> float:
    """Mean angle between neighbours at such bearings, rad; 2 pi for one alone."""
    if len(bearings) < 2:
        return 2.0 * pi
    order = sorted(bearings)
    gaps = [after - before for before, after in pairwise(order)]
    gaps.append(2.0 * pi - (order[-1] - order[0]))
    mean_rad = 2.0 * pi / len(order)
    largest_rad = max(gaps)
    if largest_rad > LONE_GAP * mean_rad:
        mean_rad = (2.0 * pi - largest_rad) / (len(order) - 1)
    return mean_rad


def radius(apart_rad: float, spacing_m: float) -> float:
    """Of a circle on which those so many radians apart go at a distance from each other, m."""
    half = sin(min(pi, apart_rad) / 2.0)
    return RADIUS_M_MAX if half <= 0.0 else min(RADIUS_M_MAX, spacing_m / (2.0 * half))


@compiled
def conflicts(
    to_x: float,
    to_y: float,
    speed_mps: float,
    radius_m: float,
    peers: Floats,
    met: Floats,
    found: Floats,
) -> None:
    """Who comes too near if all drive straight, and the weighted mean of where.

    Args:
        to_x, to_y: m from here to the target.
        met: (peers,) filled with 1.0 for a conflict.
        found: how many there are, mean midpoint x and y from here.
    """
    way_m = np.sqrt(to_x * to_x + to_y * to_y)
    if way_m <= 0.0:
        return
    v_x, v_y = speed_mps * to_x / way_m, speed_mps * to_y / way_m
    weights = sum_x = sum_y = 0.0
    count = 0.0
    for row in range(peers.shape[0]):
        if peers[row, table.ACTIVE] <= 0.0:
            continue
        x_m, y_m = peers[row, table.X], peers[row, table.Y]
        go_x, go_y = peers[row, table.TARGET_X] - x_m, peers[row, table.TARGET_Y] - y_m
        go_m = np.sqrt(go_x * go_x + go_y * go_y)
        if go_m <= ARRIVED_M:
            continue
        peer_mps = peers[row, table.SPEED]
        u_x, u_y = peer_mps * go_x / go_m, peer_mps * go_y / go_m
        rel_x, rel_y = u_x - v_x, u_y - v_y
        rel2 = rel_x * rel_x + rel_y * rel_y
        if rel2 <= 0.0:
            continue
        after_s = -(x_m * rel_x + y_m * rel_y) / rel2
        if after_s <= 0.0 or after_s > HORIZON_S:
            continue
        if after_s > min(way_m / speed_mps, go_m / peer_mps) - BEYOND_S:
            continue
        near_x, near_y = x_m + after_s * rel_x, y_m + after_s * rel_y
        touch_m = radius_m + peers[row, table.RADIUS] + SPACING_M
        if near_x * near_x + near_y * near_y >= touch_m * touch_m:
            continue
        weight = 1.0 / (0.5 + after_s)
        weights += weight
        sum_x += weight * (after_s * v_x + 0.5 * near_x)
        sum_y += weight * (after_s * v_y + 0.5 * near_y)
        met[row] = 1.0
        count += 1.0
    found[0] = count
    if count > 0.0:
        found[1] = sum_x / weights
        found[2] = sum_y / weights
