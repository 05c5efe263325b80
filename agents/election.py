"""Who leads: one leader among those who hear each other, by the age of beacons alone.

    beacons --highest claim, newest sign of life--> whom to follow
    silent for too long --best of those who hear each other--> a claim of a higher term

Every robot passes on the highest claim that it knows, dead or alive, and the newest tick at which
the claimant is known to have led. Both only ever grow, so late and repeated beacons change
nothing, a claim whose leader is gone dies out everywhere, and signs of life reach those who do
not hear the leader themselves.
"""

from __future__ import annotations

from collections.abc import Iterable

import msgspec

from swarm.messages import Beacon, Leadership, leadership_order

Key = tuple[int, int, int, int]


class State(msgspec.Struct, frozen=True):
    """The highest claim known, and whether its leader still gives signs of life."""

    leadership: Leadership | None = None
    leader_tick: int = -1  # newest at which that leader is known to have led
    silent_ticks: int = 0  # since this grew
    waited_ticks: int = 0  # for somebody better to claim
    listen_ticks: int = 0  # still to go before it may claim
    leads: bool = False  # the claim is its own, made in this life


def init(name: str, key: Key, *, leads: bool, incarnation: int, patience_ticks: int) -> State:
    """Before the first frame: the formation's leader begins with a claim of term 0.

    One that was restarted claims nothing before it has listened for as long as an election takes:
    what it was in its former life the others may have given to somebody else.
    """
    if incarnation > 0:
        return State(listen_ticks=election_ticks(patience_ticks))
    if leads:
        return State(Leadership(0, key, name), leads=True)
    return State()


def election_ticks(patience_ticks: int) -> int:
    """How long an election takes among robots that all hear each other, at most."""
    return 2 * patience_ticks + 1


def step(
    state: State,
    name: str,
    key: Key,
    heard: Iterable[Beacon],
    tick: int,
    elapsed_ticks: int,
    *,
    fit: bool,
    patience_ticks: int,
) -> State:
    """Whom to follow in this tick.

    Args:
        key: own claim of eq. 66; the smallest of those who are fit to lead is the best.
        heard: newest beacon of everyone heard lately, this robot's own not among them.
        elapsed_ticks: since its last frame. One that was away for long has missed what was said,
            not the leader what it should have said.
        fit: whether this robot could lead. A leader that is not stops giving signs of life.
        patience_ticks: silence after which a leader is taken for gone.
    """
    if elapsed_ticks > patience_ticks:
        elapsed_ticks = 1
    leadership, leader_tick, leads = state.leadership, state.leader_tick, state.leads
    silent_ticks = state.silent_ticks + elapsed_ticks
    heard = list(heard)
    for beacon in heard:
        claim = beacon.leadership
        if claim is None:
            continue
        if claim != leadership:
            if leadership is not None and not is_higher(claim, leadership):
                continue
            leadership, leader_tick, leads = claim, -1, False
            silent_ticks = patience_ticks + 1
        seen_tick = beacon.leader_tick
        if seen_tick is not None and leader_tick < seen_tick <= beacon.tick:
            leader_tick, silent_ticks = seen_tick, 0
    listen_ticks = max(0, state.listen_ticks - elapsed_ticks)
    waited_ticks = 0
    if leads:
        leader_tick, silent_ticks = (tick, 0) if fit else (leader_tick, patience_ticks + 1)
    elif silent_ticks > patience_ticks and fit and listen_ticks == 0:
        waited_ticks = state.waited_ticks + elapsed_ticks
        better = any(beacon.fit and beacon.priority < key for beacon in heard)
        if not better or waited_ticks > election_ticks(patience_ticks):
            term = 1 if leadership is None else leadership.term + 1
            leadership, leader_tick, leads = Leadership(term, key, name), tick, True
            silent_ticks = waited_ticks = 0
    return State(leadership, leader_tick, silent_ticks, waited_ticks, listen_ticks, leads)


def is_followed(state: State, patience_ticks: int) -> bool:
    """Whether there is a leader that gives signs of life, perhaps this robot itself."""
    return state.leadership is not None and state.silent_ticks <= patience_ticks


def leads(beacon: Beacon) -> bool:
    """Whether a beacon is that of a leader, as far as its sender knows."""
    return (
        beacon.leadership is not None
        and beacon.leadership.name == beacon.name
        and beacon.leader_tick == beacon.tick
    )


def is_higher(one: Leadership, other: Leadership) -> bool:
    """Whether one claim is above another: later term, then better key, then name."""
    return leadership_order(one) < leadership_order(other)
