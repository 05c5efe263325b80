"""Who hears whom, and what: the radio between the robots, which only the world knows.

    positions -> audible -> carried (loss, partition, deaf, mute) -> the newest beacon of each
                                     delay, duplicate: history --> arriving --> an older one, too

What was said is remembered only while something is delayed or duplicated.
"""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np
import numpy.typing as npt

from swarm.faults import Deaf, Delay, Duplicate, Loss, Mute, Partition
from swarm.geometry import Floats
from swarm.messages import Beacon
from world import faults
from world.faults import Active

Flags = npt.NDArray[np.bool_]
Ticks = npt.NDArray[np.int64]


class Said(msgspec.Struct, frozen=True, array_like=True):
    """A beacon and when it went out."""

    tick: int  # heard at the next one, if nothing is in its way
    beacon: Beacon


History = tuple[tuple[Said, ...], ...]  # by robot, oldest first; empty: nothing is remembered


def audible(range_m: float, positions_m: Floats, alive: Flags) -> Flags:
    """Which robot hears which: within range of each other, both alive, never itself.

    Args:
        positions_m: (robots, 2) world frame.
        alive: (robots,) the dead say nothing and hear nothing.
    Returns:
        (robots, robots) row: listener, column: speaker. Symmetric.
    """
    dx_m = positions_m[:, 0, None] - positions_m[:, 0]
    dy_m = positions_m[:, 1, None] - positions_m[:, 1]
    heard: Flags = dx_m * dx_m + dy_m * dy_m <= range_m * range_m
    heard &= alive
    heard &= alive[:, None]
    np.fill_diagonal(heard, False)
    return heard


def carried(heard: Flags, active: Sequence[Active], *, seed: int, tick: int) -> Flags:
    """Which of the links (listener, speaker) that reach far enough carry a beacon in this tick."""
    left = heard.copy()
    for one in active:
        fault, rows = one.fault, list(one.rows)
        if isinstance(fault, Deaf):
            left[rows] = False
        elif isinstance(fault, Mute):
            left[:, rows] = False
        elif isinstance(fault, Partition):
            struck = _struck(len(left), one)
            left &= struck[:, None] == struck
        elif isinstance(fault, Loss):
            left &= ~_drawn(len(left), one, fault.probability, seed, tick)
    return left


def needs_history(active: Sequence[Active]) -> bool:
    """Whether anything but the newest beacons may arrive."""
    return any(isinstance(one.fault, Delay | Duplicate) for one in active)


def remember(
    history: History,
    beacons: Sequence[Beacon | None],
    active: Sequence[Active],
    *,
    tick: int,
    dt_s: float,
) -> History:
    """History with what was said in this tick; what nobody can hear any more is forgotten.

    Args:
        beacons: (robots,) newest of each.
    """
    longest = int(max((_ticks(one, dt_s) for one in active), default=0))
    kept = []
    for said, beacon in zip(history, beacons, strict=True):
        if beacon is not None and not (said and said[-1].beacon == beacon):
            said = (*said, Said(tick, beacon))
        # The newest that is due everywhere stays, and the one before it, for duplicates.
        while len(said) > 2 and said[2].tick <= tick - longest:
            said = said[1:]
        kept.append(said)
    return tuple(kept)


def arriving(
    heard: Flags,
    history: History,
    active: Sequence[Active],
    listeners: Sequence[int],
    *,
    seed: int,
    tick: int,
    dt_s: float,
) -> list[tuple[Beacon, ...]]:
    """Beacons that arrive at each listener, by speaker; a duplicate follows the newer one.

    A link that several faults delay has the longest delay. On a link that has just been delayed
    nothing arrives at first: what was said is on its way.
    """
    count = len(heard)
    late = np.zeros((count, count), np.int64)
    again = np.zeros((count, count), np.bool_)
    for one in active:
        if isinstance(one.fault, Delay):
            np.maximum(late, _ticks(one, dt_s), out=late, where=_touched(count, one))
        elif isinstance(one.fault, Duplicate):
            again |= _drawn(count, one, one.fault.probability, seed, tick)
    # What a speaker's beacons look like from so many ticks away: (), (newest,) or (newest, before).
    views = {
        ticks: [_newest(said, tick - 1 - ticks) for said in history]
        for ticks in np.unique(late).tolist()
    }
    found = []
    for row in listeners:
        beacons: list[Beacon] = []
        delays, copies = late[row].tolist(), again[row].tolist()
        for speaker in heard[row].nonzero()[0].tolist():
            seen = views[delays[speaker]][speaker]
            beacons += seen if copies[speaker] else seen[:1]
        found.append(tuple(beacons))
    return found


def _newest(said: tuple[Said, ...], tick_max: int) -> tuple[Beacon, ...]:
    """The newest beacon that went out by then, and the one before it."""
    return tuple(one.beacon for one in reversed(said) if one.tick <= tick_max)[:2]


def _ticks(active: Active, dt_s: float) -> int:
    return round(active.fault.delay_s / dt_s) if isinstance(active.fault, Delay) else 0


def _struck(count: int, active: Active) -> Flags:
    struck = np.zeros(count, np.bool_)
    struck[list(active.rows)] = True
    return struck


def _touched(count: int, active: Active) -> Flags:
    """Links to or from those whom a fault strikes."""
    struck = _struck(count, active)
    touched: Flags = struck[:, None] | struck
    return touched


def _drawn(count: int, active: Active, probability: float, seed: int, tick: int) -> Flags:
    """Those links that a fault draws in this tick: one draw for each link there could be."""
    generator = faults.draws(seed, faults.STREAM_LINKS, active.number, 0, tick)
    drawn: Flags = (generator.random((count, count)) < probability) & _touched(count, active)
    return drawn
