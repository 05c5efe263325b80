"""What came over each topic: how often, how evenly, how late, and what did not come.

Course --rows--> TopicRow ...        all in simulated time, to one tick: the recording has no other
"""

from __future__ import annotations

import msgspec
import numpy as np

from dashboards.course import Course, Flags
from swarm import metrics
from swarm.geometry import Floats


class TopicRow(msgspec.Struct, frozen=True):
    """Messages of one kind."""

    topic: str
    way: str  # from whom to whom
    expected: int
    came: int
    lost: int
    rate_hz: float | None  # of one sender, while it lives
    jitter_ms: float | None  # standard deviation of the time between two of one sender
    gap_ms_max: float | None  # longest time between two, while it lives
    late: int  # came after the tick for which they were
    late_ms_max: float


def rows(seen: Course, summary: metrics.Summary) -> tuple[TopicRow, ...]:
    """Frames, commands, beacons, and events."""
    dt_s = seen.path.scenario.dt_s
    frames, commands = int(seen.frames.sum()), int(seen.commands.sum())
    links = seen.links
    ages, gaps = (
        np.repeat(np.arange(len(counts)), counts) for counts in (links.age_ticks, links.gap_ticks)
    )
    return (
        _row(seen, "frame", "world to robot", int(seen.alive.sum()), frames, seen.frames),
        msgspec.structs.replace(
            _row(seen, "command", "robot to world", frames, commands, seen.commands > 0),
            late=summary.late_commands,
            late_ms_max=1e3 * dt_s * float(seen.late_ticks.max(initial=0)),
        ),
        TopicRow(
            "beacon",
            "robot to robot, within range",
            links.expected,
            links.heard,
            max(0, links.expected - links.heard),
            links.heard / links.expected / dt_s if links.expected else None,
            1e3 * dt_s * float(gaps.std()) if len(gaps) else None,
            1e3 * dt_s * float(gaps.max()) if len(gaps) else None,
            int((ages > 1).sum()),
            1e3 * dt_s * max(0.0, float(ages.max(initial=0)) - 1.0),
        ),
        TopicRow(
            "event",
            "world to all",
            len(seen.events) + seen.events_more,
            len(seen.events) + seen.events_more,
            0,
            None,
            None,
            None,
            0,
            0.0,
        ),
    )


def _row(seen: Course, topic: str, way: str, expected: int, came: int, flags: Flags) -> TopicRow:
    dt_s = seen.path.scenario.dt_s
    gaps_s = _gaps(seen, flags) * dt_s
    living_s = seen.alive.sum() * dt_s
    return TopicRow(
        topic,
        way,
        expected,
        came,
        max(0, expected - came),
        came / float(living_s) if living_s else None,
        1e3 * float(gaps_s.std()) if len(gaps_s) else None,
        1e3 * float(gaps_s.max()) if len(gaps_s) else None,
        0,
        0.0,
    )


def _gaps(seen: Course, flags: Flags) -> Floats:
    """Ticks between two messages of one robot that lived all the while."""
    found = [np.empty(0)]
    deaths = np.cumsum(~seen.alive, axis=0)
    for row in range(flags.shape[1]):
        at = np.flatnonzero(flags[:, row])
        living = deaths[at[1:], row] == deaths[at[:-1], row]
        found.append(np.diff(seen.ticks[at])[living].astype(np.float64))
    return np.concatenate(found)
