"""What went wrong in a run, one by one: when, to whom, why, and how well the others took it.

    Course, Summary --incidents--> Incident ...     injected faults, and what nobody had asked for

One fault that strikes several robots is one incident. How well the formation took it is told of
what takes a robot away: from then until the next such thing.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite

import msgspec
import numpy as np

from dashboards import course
from dashboards.course import Course
from swarm import metrics
from swarm.messages import Event
from swarm.score import SETTLED_M, SILENCING

# Event kinds -> what they are called; all of them come unasked.
UNASKED = {
    "robot-lost": "lost",
    "robot-hung": "hung",
    "robot-missing": "missing",
    "collision": "collision",
    "fault-failed": "fault failed",
    "world-resumed": "world restarted",
}
TAKES_AWAY = (*SILENCING, "lost", "hung", "collision")
BEFORE_S = 1.0  # the formation's error is averaged over so long before


class Shape(msgspec.Struct, frozen=True):
    """How far the formation was out of shape: largest error of its followers."""

    before_m: float | None  # mean over BEFORE_S
    most_m: float | None  # afterwards, until the next thing that takes a robot away
    settled_s: float | None  # until all were within SETTLED_M again, with a leader; None: never


class Incident(msgspec.Struct, frozen=True):
    """One thing that went wrong. Spans count from `time_s`."""

    tick: int
    time_s: float
    kind: str  # of the fault, or one of UNASKED
    robots: tuple[str, ...]  # empty: the world, or nobody
    cause: str  # the fault as it was asked for, or what the world says
    injected: bool
    led: bool  # one of them was the leader then
    detected_s: float | None
    recovered_s: float | None
    over_s: float | None  # until it ended
    back_s: float | None  # until a new process took the robot's place
    successor: str  # who led next, "" when nobody did
    successor_s: float | None
    shape: Shape | None  # None where nobody was taken away from a formation


def incidents(seen: Course, summary: metrics.Summary) -> tuple[Incident, ...]:
    """All of them by time."""
    injected = _injected(seen, summary)
    expected = {
        one.tick for one in injected if not one.robots and one.kind == "kill" and one.back_s == 0.0
    }
    unasked = [
        one
        for one in _unasked(seen, summary)
        if one.kind != "world restarted" or one.tick not in expected
    ]
    found = [*injected, *unasked]
    found.sort(key=lambda one: (one.tick, not one.injected))
    return tuple(_with_shape(seen, found, number) for number in range(len(found)))


def leader_at(seen: Course, summary: metrics.Summary, tick: int) -> str:
    """Who led just before a tick, "" when nobody did; at the very start whoever is to lead."""
    before = [row.name for row in summary.leaders if row.tick < tick]
    formation = seen.path.scenario.formation
    return before[-1] if before else "" if formation is None else formation.leader


def _injected(seen: Course, summary: metrics.Summary) -> list[Incident]:
    by_number: dict[int, list[Event]] = {}
    for event in seen.events:
        if event.kind == "fault":
            by_number.setdefault(event.number, []).append(event)
    return [_of_fault(seen, summary, events) for events in by_number.values()]


def _of_fault(seen: Course, summary: metrics.Summary, events: Sequence[Event]) -> Incident:
    first = events[0]
    robots = tuple(event.robot for event in events if event.robot is not None)
    rows = [
        row
        for row in summary.faults
        if row.tick == first.tick and row.target in robots and row.kind == first.fault
    ]
    over = [
        event.tick
        for event in seen.events
        if event.kind == "fault-over" and event.number == first.number
    ]
    return _incident(
        seen,
        summary,
        first,
        first.fault or first.text.partition(":")[0],
        robots,
        injected=True,
        detected_s=_last([row.detected_s for row in rows]),
        recovered_s=_last([row.recovered_s for row in rows]),
        over_s=_since_s(seen, first.tick, max(over) if over else None),
    )


def _unasked(seen: Course, summary: metrics.Summary) -> list[Incident]:
    return [
        _incident(
            seen,
            summary,
            event,
            UNASKED[event.kind],
            () if event.robot is None else (event.robot,),
            injected=False,
            detected_s=None,
            recovered_s=None,
            over_s=_since_s(seen, event.tick, _next(seen, event, "robot-returned")),
        )
        for event in seen.events
        if event.kind in UNASKED
    ]


def _incident(
    seen: Course,
    summary: metrics.Summary,
    event: Event,
    kind: str,
    robots: tuple[str, ...],
    *,
    injected: bool,
    detected_s: float | None,
    recovered_s: float | None,
    over_s: float | None,
) -> Incident:
    takes_away = kind in TAKES_AWAY
    led = takes_away and leader_at(seen, summary, event.tick) in robots
    successor = next((row for row in summary.leaders if led and row.tick > event.tick), None)
    back = None
    if len(robots) == 1:
        back = _next(seen, event, "robot-started")
    elif event.kind == "fault" and kind == "kill":  # of the world
        back = _next(seen, event, "world-resumed")
    return Incident(
        tick=event.tick,
        time_s=event.tick * seen.path.scenario.dt_s,
        kind=kind,
        robots=robots,
        cause=event.text,
        injected=injected,
        led=led,
        detected_s=detected_s,
        recovered_s=recovered_s,
        over_s=over_s,
        back_s=_since_s(seen, event.tick, back),
        successor="" if successor is None else successor.name,
        successor_s=_since_s(seen, event.tick, None if successor is None else successor.tick),
        shape=None,
    )


def _next(seen: Course, event: Event, kind: str) -> int | None:
    """Tick of the next event of a kind about the same robot, before it is in trouble again."""
    for other in seen.events:
        if other.tick >= event.tick and other.robot == event.robot and other is not event:
            if other.kind == kind:
                return other.tick
            if other.kind in ("robot-lost", "robot-hung") or other.fault in SILENCING:
                return None
    return None


def _since_s(seen: Course, start: int, tick: int | None) -> float | None:
    return None if tick is None else (tick - start) * seen.path.scenario.dt_s


def _last(values: Sequence[float | None]) -> float | None:
    """The longest, None when one of them never ended."""
    known = [value for value in values if value is not None]
    return max(known) if known and len(known) == len(values) else None


def _with_shape(seen: Course, found: Sequence[Incident], number: int) -> Incident:
    one = found[number]
    if seen.path.scenario.formation is None or not _takes_away(one):
        return one
    following = [other.tick for other in found[number + 1 :] if _takes_away(other)]
    error_m = course.formation_error_m(seen)
    first = int(np.searchsorted(seen.ticks, one.tick))
    end = int(np.searchsorted(seen.ticks, following[0])) if following else len(error_m)
    before_m = error_m[max(0, first - seen.path.scenario.tick_of(BEFORE_S)) : first]
    after_m = error_m[first : max(end, first + 1)]
    begin = 0
    if one.led:  # only what was measured by the next leader counts
        begin = len(after_m)
        if one.successor_s is not None:
            begin = seen.path.scenario.tick_of(one.successor_s)
    settled = np.flatnonzero(after_m[begin:] < SETTLED_M)
    return msgspec.structs.replace(
        one,
        shape=Shape(
            before_m=_finite(before_m.mean()) if np.isfinite(before_m).any() else None,
            most_m=_finite(np.nanmax(after_m[begin:]))
            if np.isfinite(after_m[begin:]).any()
            else None,
            settled_s=float((begin + settled[0]) * seen.path.scenario.dt_s)
            if len(settled)
            else None,
        ),
    )


def _takes_away(one: Incident) -> bool:
    """Whether it takes a robot; the world comes back and has forgotten nothing."""
    return bool(one.robots) and one.kind in TAKES_AWAY


def _finite(value: float) -> float | None:
    return float(value) if isfinite(value) else None
