"""Claims to gaps in which two cannot pass each other: who waits beside the mouth, who goes through.

    hits --narrow chord between walls--> mouth, axis --claim--> wants --granted--> holds --> through
    peers' claims to the same gap: same direction follows as a platoon, opposite waits

Two of opposite directions that have heard each other never both enter: the order (since, name) is
total. No gap has a name: two claims mean the same where their axes lie on one line.
"""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np

from agents.navigator.walls import ASIDE_M, SIGHT_M, end, find, inside
from agents.peers import Peer
from swarm.geometry import Floats, Vec2, length
from swarm.messages import Name, Passage
from swarm.passages import OPPOSITE, SAME, of_axis, same_line

# Of a gap: wider than a body by this, narrower than two by that.
SLACK_M, TWO_ABREAST_M = 0.15, 0.25
BLOCKED_SHARE = 0.3  # of its width: something this near to its middle, and it is no gap
BETTER_M = 0.01  # an outside robot replaces its chord by one no longer than this more
OUTSIDE_M = 0.3
INSIDE_M = 0.35  # nearer to the mouth than this it cannot give a passage back
CLEAR_M = 0.3  # beyond its end
FAR_M = 4.2  # a mouth further away is forgotten
# Grants.
ANNOUNCED_TICKS = 6  # an opposite claimant has heard of it by then, whatever was lost
NEAR_M, NEAR_FOLLOWER_M = 1.7, 3.2
EMERGED_M = 0.2  # outside this mouth an opposite holder is through
PLATOON_TICKS = 75  # who claims later than this after the oldest waiting opponent waits too
SLOW_SHARE = 0.25  # of its top speed: an opponent is taken to be no slower
HURRY_S = 0.3  # it may set out this long before the last opponent is through
# Waiting beside the mouth: so far before it, to its right, one behind the other.
WAIT_NEAR_M, WAIT_BEFORE_M, WAIT_STEP_M, WAIT_RIGHT_M = 3.0, 0.75, 0.55, 0.85
ZIP_M = 0.5  # between those of a platoon that merge into the mouth
SHARE_HOLDER, SHARE_WAITER = 0.3, 1.0


_NOT_FOUND = (0.0,) * 5


class State(msgspec.Struct, frozen=True):
    """Own claim, and what was seen of the gap."""

    passage: Passage | None = None
    width_m: float = 0.0
    end_m: float = 0.0  # of the narrow part, along the axis from the mouth
    from_inside: bool = False  # the mouth was never seen from before it


class Rule(msgspec.Struct, frozen=True):
    """What a claim makes of the way."""

    place: Vec2 | None  # m, world: to go to first; None: its own way
    waits: bool  # beside the mouth
    face: Vec2 | None = None  # m, world: to look at while it stands there
    yields_to: Name | None = None
    shares: tuple[tuple[Name, float, float], ...] = ()  # (peer, share, risk) of the cells


class Other(msgspec.Struct, frozen=True):
    """A peer with a claim to the same gap, seen along this robot's axis."""

    name: Name
    key: tuple[int, Name]
    along_m: float  # before the mouth it is negative
    mouth_m: float  # so far along is its own
    holds: bool
    opposite: bool
    speed_mps: float


def step(
    state: State,
    name: Name,
    tick: int,
    position: Vec2,
    target: Vec2,
    radius_m: float,
    speed_mps: float,
    others: Sequence[Peer],
    rows: Floats,
    points: Floats,
    path: Floats,
) -> tuple[State, Rule | None]:
    """State at this tick, and what it makes of the way to `target`; None: nothing.

    Args:
        target: m, world: next point on the way.
        others: peers heard lately.
        rows: of `table`: those in sight, behind whom nothing is seen.
        points: (n, 2) m from here, world axes: obstacles in sight.
        path: (cells, 2) m from here, world axes: the way that is planned.
    """
    state = look(state, tick, position, target, radius_m, others, rows, points, path)
    mine = state.passage
    if mine is None:
        return state, None
    along_m, _ = of_axis(mine, position)
    near = [other for peer in others if (other := same_gap(mine, peer)) is not None]
    against = [one for one in near if one.opposite and not (one.holds and one.along_m < -EMERGED_M)]
    beside = [one for one in near if not one.opposite]
    holds = grant(mine, name, tick, along_m, state.end_m, speed_mps, beside, against)
    if holds != mine.holds:
        mine = msgspec.structs.replace(mine, holds=holds)
        state = msgspec.structs.replace(state, passage=mine)
    return state, rule(mine, name, along_m, beside, against)


def look(
    state: State,
    tick: int,
    position: Vec2,
    target: Vec2,
    radius_m: float,
    others: Sequence[Peer],
    rows: Floats,
    points: Floats,
    path: Floats,
) -> State:
    """State after what is seen: a gap is found, seen better, left behind."""
    mine = state.passage
    along_m = 0.0
    if mine is not None:
        along_m, aside_m = of_axis(mine, position)
        behind = (target[0] - mine.mouth[0]) * mine.axis[0] + (
            target[1] - mine.mouth[1]
        ) * mine.axis[1]
        away_m = length(mine.mouth[0] - position[0], mine.mouth[1] - position[1])
        if (
            along_m > state.end_m + radius_m + CLEAR_M
            or behind <= 0.0
            or (along_m < 0.0 and away_m > FAR_M)
            or (along_m > OUTSIDE_M and abs(aside_m) > state.width_m)
            or (along_m < -OUTSIDE_M and blocked(mine, state.width_m, position, points))
        ):
            state, mine = State(), None
    if mine is None and len(rows) and (within := between(tick, position, radius_m, points, path)):
        # It was put here, or has forgotten how it came: the mouth is behind it.
        state, mine = within, within.passage
    elif mine is None or along_m < -OUTSIDE_M:
        found: Floats | tuple[float, ...] = _NOT_FOUND
        least_m, most_m = 2.0 * radius_m + SLACK_M, 4.0 * radius_m + TWO_ABREAST_M
        if len(points) > 1 and len(path) > 1:
            seen = np.zeros(5)
            find(points, path, rows, least_m, most_m, seen)
            found = seen
        if found[0] > 0.0 and (mine is None or found[0] <= state.width_m + BETTER_M):
            mouth = (position[0] + float(found[1]), position[1] + float(found[2]))
            axis = (float(found[3]), float(found[4]))
            since, holds = (tick, False) if mine is None else (mine.since, mine.holds)
            if mine is None or same_line(mine, mouth, axis) > SAME:
                mine = Passage(holds, mouth, axis, since)
                state = State(mine, float(found[0]), state.end_m)
        if mine is None and (heard := hearsay(others, position, path)) is not None:
            mine = Passage(False, heard.mouth, heard.axis, tick)
            state = State(mine, most_m)
    if mine is not None:
        end_m = end(
            points,
            mine.mouth[0] - position[0],
            mine.mouth[1] - position[1],
            mine.axis[0],
            mine.axis[1],
            0.5 * state.width_m + CLEAR_M,
        )
        if end_m > state.end_m:
            state = msgspec.structs.replace(state, end_m=end_m)
        if state.from_inside and along_m > -INSIDE_M:
            within = between(tick, position, radius_m, points, path)
            if within is not None:
                state = reopened(state, mine, within)
    return state


def reopened(state: State, mine: Passage, within: State) -> State:
    """State of a robot that came to itself inside, with as much of the walls as it sees by now."""
    assert within.passage is not None
    along_m, _ = of_axis(mine, within.passage.mouth)
    if along_m >= 0.0:
        return state
    mouth = (mine.mouth[0] + along_m * mine.axis[0], mine.mouth[1] + along_m * mine.axis[1])
    mine = msgspec.structs.replace(mine, mouth=mouth)
    return msgspec.structs.replace(state, passage=mine, end_m=state.end_m - along_m)


def between(
    tick: int, position: Vec2, radius_m: float, points: Floats, path: Floats
) -> State | None:
    """State of a robot that would find itself inside a gap, without a claim to it."""
    if len(points) < 2 or len(path) < 2:
        return None
    walls = np.zeros(5)
    least_m, most_m = 2.0 * radius_m + SLACK_M, 4.0 * radius_m + TWO_ABREAST_M
    inside(points, path, least_m, most_m, walls)
    if walls[0] == 0.0:
        return None
    axis, back_m = (float(walls[1]), float(walls[2])), float(walls[3])
    mouth = (position[0] - back_m * axis[0], position[1] - back_m * axis[1])
    passage = Passage(False, mouth, axis, tick)
    return State(passage, float(walls[0]), back_m + float(walls[4]), from_inside=True)


def blocked(mine: Passage, width_m: float, position: Vec2, points: Floats) -> bool:
    """Whether there is no gap after all: something stands in the middle of it."""
    if not len(points):
        return False
    x_m, y_m = mine.mouth[0] - position[0], mine.mouth[1] - position[1]
    off_m = points - np.array((x_m, y_m))
    away2_m2 = off_m[:, 0] * off_m[:, 0] + off_m[:, 1] * off_m[:, 1]
    free_m = BLOCKED_SHARE * width_m
    return bool((away2_m2 < free_m * free_m).any())


def hearsay(others: Sequence[Peer], position: Vec2, path: Floats) -> Passage | None:
    """A peer's claim to a gap that the way leads through in the same direction, the nearest one.

    Whoever drives behind others does not see the gap that they drive through.
    """
    best, best_m = None, SIGHT_M
    for peer in others:
        claim = peer.beacon.passage
        if claim is None or len(path) < 2:
            continue
        x_m, y_m = claim.mouth[0] - position[0], claim.mouth[1] - position[1]
        away_m = length(x_m, y_m)
        if away_m >= best_m or x_m * claim.axis[0] + y_m * claim.axis[1] < OUTSIDE_M:
            continue
        off_m = path - np.array((x_m, y_m))
        away2_m2 = off_m[:, 0] * off_m[:, 0] + off_m[:, 1] * off_m[:, 1]
        cell = int(away2_m2.argmin())
        if float(away2_m2[cell]) >= ASIDE_M * ASIDE_M:
            continue
        last, first = min(cell + 1, len(path) - 1), max(cell - 1, 0)
        along = (path[last] - path[first]) @ np.array(claim.axis)
        if float(along) > 0.0:
            best, best_m = claim, away_m
    return best


def same_gap(mine: Passage, peer: Peer) -> Other | None:
    """A peer that claims the gap of one's own claim."""
    theirs = peer.beacon.passage
    if theirs is None:
        return None
    product = same_line(mine, theirs.mouth, theirs.axis)
    if OPPOSITE <= product <= SAME:
        return None
    along_m, _ = of_axis(mine, (peer.pose.x_m, peer.pose.y_m))
    mouth_m, _ = of_axis(mine, theirs.mouth)
    return Other(
        name=peer.beacon.name,
        key=(theirs.since, peer.beacon.name),
        along_m=along_m,
        mouth_m=mouth_m,
        holds=theirs.holds,
        opposite=product < 0.0,
        speed_mps=max(SLOW_SHARE * peer.beacon.speed_mps_max, abs(peer.beacon.twist.speed_mps)),
    )


def grant(
    mine: Passage,
    name: Name,
    tick: int,
    along_m: float,
    end_m: float,
    speed_mps: float,
    beside: Sequence[Other],
    against: Sequence[Other],
) -> bool:
    """Whether this robot holds the passage from now on.

    Args:
        beside, against: claims of this direction, and of the other as far as they are not through.
    """
    key = (mine.since, name)
    holders = [one for one in against if one.holds]
    first = min([key, *(one.key for one in beside)])
    opponent = min([one.key for one in against], default=None)
    if along_m > -INSIDE_M:
        # Inside, all that can be given back is the way out, by those whose direction is worse.
        # Others hide how far it goes on: those of the other direction know where it ends.
        inside = [one for one in holders if one.along_m < max(end_m, one.mouth_m) + INSIDE_M]
        mates = [one.key for one in beside if one.holds and one.along_m > -INSIDE_M]
        return not inside or min([key, *mates]) < min(one.key for one in inside)
    if mine.holds:
        return not holders or key < min(one.key for one in holders)
    if tick - mine.since < ANNOUNCED_TICKS:
        return False
    approach_s = -along_m / speed_mps - HURRY_S
    if any(
        one.along_m >= end_m + INSIDE_M or (one.along_m + EMERGED_M) / one.speed_mps > approach_s
        for one in holders
    ):
        return False
    followed = any(one.holds for one in beside)
    if -along_m > (NEAR_FOLLOWER_M if followed else NEAR_M):
        return False
    if opponent is None or first < opponent:
        return True
    return followed and mine.since <= opponent[0] + PLATOON_TICKS


def rule(
    mine: Passage,
    name: Name,
    along_m: float,
    beside: Sequence[Other],
    against: Sequence[Other],
) -> Rule | None:
    """Where to go under a claim."""
    shares = [
        *((one.name, 1.0, 1.0) for one in beside if one.along_m > along_m),
        *((one.name, 0.5, 0.0) for one in beside if one.along_m <= along_m),
    ]
    (x_m, y_m), (ahead_x, ahead_y) = mine.mouth, mine.axis
    if mine.holds:
        shares += [(one.name, SHARE_HOLDER, 1.0) for one in against if not one.holds]
        if along_m > -INSIDE_M:
            return Rule(None, False, shares=tuple(shares))
        rank = sum(along_m < one.along_m < -INSIDE_M for one in beside if one.holds)
        if not rank:
            return Rule(None, False, shares=tuple(shares))
        place = (x_m - ZIP_M * rank * ahead_x, y_m - ZIP_M * rank * ahead_y)
        return Rule(place, False, shares=tuple(shares))
    shares += [(one.name, SHARE_WAITER, 1.0) for one in against if one.holds]
    key = (mine.since, name)
    first = min([key, *(one.key for one in beside)])
    blocking = [one for one in against if one.holds or one.key < first]
    if not blocking or (-along_m > WAIT_NEAR_M):
        return Rule(None, False, shares=tuple(shares)) if shares else None
    rank = sum(along_m < one.along_m < 0.0 for one in beside if not one.holds)
    back_m = WAIT_BEFORE_M + WAIT_STEP_M * rank
    place = (
        x_m - back_m * ahead_x + WAIT_RIGHT_M * ahead_y,
        y_m - back_m * ahead_y - WAIT_RIGHT_M * ahead_x,
    )
    first_of_them = min(blocking, key=lambda one: (not one.holds, one.key))
    return Rule(place, True, mine.mouth, first_of_them.name, tuple(shares))
