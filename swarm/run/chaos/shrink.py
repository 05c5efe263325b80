"""The smallest schedule that still does it, by trying simpler ones until none does any more.

    faults, does it still fail? --fewer, then shorter, earlier, rounder, for fewer robots--> faults

Greedy: whatever is simpler and still fails is taken, and all is tried again. hypothesis does the
like for tests; here a failure is a run of a second, so what to try first is chosen by hand.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import msgspec

from swarm import faults
from swarm.faults import Fault
from swarm.run.chaos import schedules
from swarm.scenario import Scenario

TRIES_MAX = 80  # runs
ROUND_TICKS = (25, 5)  # coarse grids for times; 2 s and 0.4 s at 80 ms

Drawn = tuple[Fault, ...]


class Shrunk(msgspec.Struct, frozen=True):
    """The smallest found, and after how many runs."""

    faults: Drawn
    tries: int


def shrink(
    scenario: Scenario,
    drawn: Drawn,
    fails: Callable[[Drawn], bool],
    *,
    fair: Callable[[Drawn], bool] = lambda drawn: True,
    tries_max: int = TRIES_MAX,
) -> Shrunk:
    """Smallest schedule found that fails.

    Args:
        drawn: fails.
        fair: what is not fair is not tried.
        tries_max: runs; at the bound the best so far is returned.
    """
    best = drawn
    known = {_text(drawn): True}
    tries = 0
    smaller = True
    while smaller:
        smaller = False
        for candidate in _simpler(scenario, best):
            text = _text(candidate)
            if text in known or not fair(candidate):
                continue
            if tries >= tries_max:
                return Shrunk(best, tries)
            tries += 1
            known[text] = fails(candidate)
            if known[text]:
                best, smaller = candidate, True
                break
    return Shrunk(best, tries)


def _text(drawn: Drawn) -> str:
    return " ".join(faults.text_of(fault) for fault in drawn)


def _simpler(scenario: Scenario, drawn: Drawn) -> Iterator[Drawn]:
    """Schedules that are simpler in one way, the boldest first."""
    count = len(drawn)
    if count > 2:
        yield drawn[: count // 2]
        yield drawn[count // 2 :]
    if count > 1:
        for number in range(count):
            yield (*drawn[:number], *drawn[number + 1 :])
    for number, fault in enumerate(drawn):
        for one in _simpler_fault(scenario, fault):
            changed = (*drawn[:number], one, *drawn[number + 1 :])
            yield tuple(sorted(changed, key=lambda fault: fault.at_s))


def _simpler_fault(scenario: Scenario, fault: Fault) -> Iterator[Fault]:
    """One fault: fewer robots, a simpler kind, shorter, then earlier and rounder."""
    replace = msgspec.structs.replace
    names = faults.names_in(fault.target)
    if len(names) > 1:
        for name in names:
            yield replace(fault, target="/".join(one for one in names if one != name))
    elif fault.target == faults.EVERYONE or fault.target.startswith(faults.ANY):
        for robot in scenario.robots:
            yield replace(fault, target=robot.name)
    if isinstance(fault, faults.Restart | faults.Hang):
        yield faults.Kill(target=fault.target, at_s=fault.at_s)
    if fault.for_s is not None:
        for ticks in _smaller(scenario.tick_of(fault.for_s), 1):
            yield replace(fault, for_s=schedules.rounded_s(scenario, ticks))
    for ticks in _smaller(scenario.tick_of(fault.at_s), schedules.FIRST_TICK):
        yield replace(fault, at_s=schedules.rounded_s(scenario, ticks))


def _smaller(ticks: int, least: int) -> Sequence[int]:
    """Numbers of ticks to try instead of one: half of it, and rounder ones below it."""
    found = [ticks // 2]
    found += [ticks // grid * grid for grid in ROUND_TICKS]
    return [one for one in dict.fromkeys(found) if least <= one < ticks]
