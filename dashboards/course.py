"""A whole run as arrays, for its report: tracks, clearances, who waits, what came over each topic.

    TickRecord ... --follow--> Course       every tick is looked at once and then forgotten

The figures of the summary come from the same ticks, in `score`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import msgspec
import numpy as np
import numpy.typing as npt

from dashboards import snapshot, tracks
from dashboards.tracks import NOBODY, Rows, Tracks
from swarm import errors, metrics
from swarm.geometry import Floats
from swarm.messages import Event, TickRecord
from swarm.scenario import Obstacle, Scenario

EVENTS_MAX = 10_000  # kept; a run that is flooded with garbage has one of each message
Flags = npt.NDArray[np.bool_]
Counts = npt.NDArray[np.int32]


class Links(msgspec.Struct, frozen=True, eq=False):
    """Beacons from robot to robot, of those pairs that were within range of each other."""

    expected: int  # one a tick for each listener and speaker
    heard: int  # each beacon once
    again: int  # came once more, or after a newer one
    age_ticks: Counts  # how many were so many ticks old when they were heard
    gap_ticks: Counts  # how many were so many ticks newer than the one before on their link


class Course(msgspec.Struct, frozen=True, eq=False):
    """One run; arrays are (ticks, robots) unless they say otherwise."""

    path: Tracks
    score: metrics.Score
    ticks: Rows  # (ticks,) their numbers
    alive: Flags
    clearance_obstacle_m: Floats  # inf without obstacles, nan for the dead
    clearance_robot_m: Floats  # to the surface of the nearest, inf without others, nan for the dead
    nearest: Rows  # row of the nearest, NOBODY for the dead
    yields_to: Rows  # row of whom each waits for, NOBODY
    frames: Flags  # who was sent a frame
    commands: Counts  # how many came from each
    late_ticks: Counts  # of the newest of these, after its frame
    links: Links
    events: tuple[Event, ...]
    events_more: int  # that were not kept


def follow(
    scenario: Scenario, obstacles: tuple[Obstacle, ...], records: Iterable[TickRecord]
) -> Course:
    """Course of a run from its records in order.

    Raises RecordingError when there is none, or when they are of another scenario.
    """
    observer = _Observer(scenario)
    score = metrics.begin(scenario)
    path = tracks.collect(scenario, obstacles, observer.through(records), score)
    return observer.course(path, score)


class _Observer:
    """Looks at ticks as they pass by."""

    def __init__(self, scenario: Scenario) -> None:
        count = len(scenario.robots)
        self._scenario = scenario
        self._rows = {robot.name: row for row, robot in enumerate(scenario.robots)}
        radii_m = np.array([robot.body_radius_m for robot in scenario.robots])
        self._touching_m = radii_m[:, None] + radii_m
        self._ticks: list[int] = []
        self._motion: list[Floats] = []
        self._nearest: list[Rows] = []
        self._gaps_m: list[Floats] = []
        self._yields: list[list[int]] = []
        self._frames: list[Flags] = []
        self._commands: list[Counts] = []
        self._late: list[Counts] = []
        self._events: list[Event] = []
        self._event_count = 0
        self._heard_tick = np.full((count, count), NOBODY, np.int64)  # newest, listener by speaker
        self._linked = np.zeros((count, count), np.bool_)  # in range since the newest
        self._ages: dict[int, int] = {}
        self._gaps: dict[int, int] = {}
        self._expected = self._heard = self._again = 0

    def through(self, records: Iterable[TickRecord]) -> Iterator[TickRecord]:
        """The same records."""
        count = len(self._rows)
        for record in records:
            if len(record.robots) != count or any(
                command.robot not in self._rows for command in record.commands
            ):
                raise errors.RecordingError(
                    f"tick {record.tick}: expected the {count} robots of the scenario "
                    f"'{self._scenario.title}', got others"
                )
            self._look(record)
            yield record

    def _look(self, record: TickRecord) -> None:
        self._ticks.append(record.tick)
        motion = snapshot.motion(record)
        self._motion.append(motion)
        self._look_around(motion)
        self._yields.append(
            [
                NOBODY
                if not robot.alive or robot.beacon is None or robot.beacon.yields_to is None
                else self._rows.get(robot.beacon.yields_to, NOBODY)
                for robot in record.robots
            ]
        )
        room = EVENTS_MAX - len(self._events)
        self._events += record.events[:room]
        self._event_count += len(record.events)
        self._look_at_messages(record)
        self._listen(record, motion)

    def _look_around(self, motion: Floats) -> None:
        """Nearest surface of another body, alive or not."""
        positions = motion[:, :2]
        apart = positions[:, None] - positions
        gaps_m = np.sqrt((apart**2).sum(axis=-1)) - self._touching_m
        np.fill_diagonal(gaps_m, np.inf)
        nearest = gaps_m.argmin(axis=1)
        self._nearest.append(nearest)
        self._gaps_m.append(gaps_m[np.arange(len(nearest)), nearest])

    def _look_at_messages(self, record: TickRecord) -> None:
        count = len(self._rows)
        frames = np.zeros(count, np.bool_)
        frames[[frame.row for frame in record.frames]] = True
        commands, late = np.zeros(count, np.int32), np.zeros(count, np.int32)
        for command in record.commands:
            row = self._rows[command.robot]
            commands[row] += 1
            late[row] = record.tick - command.tick
        self._frames.append(frames)
        self._commands.append(commands)
        self._late.append(late)

    def _listen(self, record: TickRecord, motion: Floats) -> None:
        """Whom each frame let its robot hear, against whom it could have heard."""
        listening = [frame.row for frame in record.frames]
        if record.tick == 0 or not listening:
            return
        apart = motion[:, None, :2] - motion[:, :2]
        within = (apart**2).sum(axis=-1) <= self._scenario.radio.range_m**2
        speaking = np.array([robot.alive and robot.beacon is not None for robot in record.robots])
        within &= speaking
        np.fill_diagonal(within, False)
        self._expected += int(within[listening].sum())
        lengths = [frame.heard.shape[0] for frame in record.frames]
        pairs = np.concatenate([frame.heard.numpy() for frame in record.frames]).reshape(-1, 2)
        listeners = np.repeat(listening, lengths)
        speakers, ticks = pairs[:, 0], pairs[:, 1]
        new = ticks > self._heard_tick[listeners, speakers]
        self._heard += int(new.sum())
        self._again += int((~new).sum())
        _count(self._ages, record.tick - ticks[new])
        after = new & self._linked[listeners, speakers]
        _count(self._gaps, (ticks - self._heard_tick[listeners, speakers])[after])
        np.maximum.at(self._heard_tick, (listeners, speakers), ticks)
        self._linked[listeners, speakers] = True
        self._linked &= within

    def course(self, path: Tracks, score: metrics.Score) -> Course:
        """All that was seen."""
        motion = np.array(self._motion)
        alive = motion[:, :, snapshot.ALIVE] > 0.0
        return Course(
            path=path,
            score=score,
            ticks=np.array(self._ticks),
            alive=alive,
            clearance_obstacle_m=np.where(alive, motion[:, :, snapshot.CLEARANCE], np.nan),
            clearance_robot_m=np.where(alive, np.array(self._gaps_m), np.nan),
            nearest=np.where(alive, np.array(self._nearest), NOBODY),
            yields_to=np.array(self._yields),
            frames=np.array(self._frames),
            commands=np.array(self._commands),
            late_ticks=np.array(self._late),
            links=Links(
                self._expected,
                self._heard,
                self._again,
                _histogram(self._ages),
                _histogram(self._gaps),
            ),
            events=tuple(self._events),
            events_more=self._event_count - len(self._events),
        )


def _count(numbers: dict[int, int], values: Rows) -> None:
    for value, number in zip(*np.unique(values, return_counts=True), strict=True):
        numbers[int(value)] = numbers.get(int(value), 0) + int(number)


def _histogram(numbers: dict[int, int]) -> Counts:
    result = np.zeros(max(numbers, default=0) + 1, np.int32)
    for value, number in numbers.items():
        result[max(value, 0)] += number
    return result


# --- what is read from it -------------------------------------------------------------------------


class Waiting(msgspec.Struct, frozen=True):
    """How often and how long one robot gave way to another."""

    robot: str
    to: str
    times: int
    total_s: float
    longest_s: float
    first_s: float  # simulation time when it first did


def waits(course: Course) -> tuple[Waiting, ...]:
    """Who waited for whom, longest first."""
    names = [robot.name for robot in course.path.scenario.robots]
    dt_s = course.path.scenario.dt_s
    found = []
    for row, name in enumerate(names):
        column = course.yields_to[:, row]
        for other in np.unique(column[column != NOBODY]):
            flags = np.concatenate(([False], column == other, [False]))
            edges = np.flatnonzero(flags[1:] != flags[:-1])
            lengths = edges[1::2] - edges[::2]
            found.append(
                Waiting(
                    name,
                    names[other],
                    len(lengths),
                    float(lengths.sum() * dt_s),
                    float(lengths.max() * dt_s),
                    float(course.path.times_s[edges[0]]),
                )
            )
    return tuple(sorted(found, key=lambda one: (-one.total_s, one.robot, one.to)))


class Nearest(msgspec.Struct, frozen=True):
    """The closest of all moments."""

    robot: str
    to: str  # another robot's name, or "" for an obstacle
    distance_m: float
    time_s: float


def nearest_obstacle(course: Course) -> Nearest | None:
    """Where a live robot came nearest to an obstacle; None without obstacles."""
    return _nearest(course, course.clearance_obstacle_m, None)


def nearest_robot(course: Course) -> Nearest | None:
    """Where two robots came nearest, of which one lived at least; None for one robot alone."""
    return _nearest(course, course.clearance_robot_m, course.nearest)


def _nearest(course: Course, distances_m: Floats, others: Rows | None) -> Nearest | None:
    kept = np.where(np.isfinite(distances_m), distances_m, np.inf)
    tick, row = np.unravel_index(int(kept.argmin()), kept.shape)
    if not np.isfinite(kept[tick, row]):
        return None
    names = [robot.name for robot in course.path.scenario.robots]
    other = "" if others is None else names[int(others[tick, row])]
    return Nearest(names[int(row)], other, float(kept[tick, row]), float(course.path.times_s[tick]))


def formation_error_m(course: Course) -> Floats:
    """(ticks,) largest distance of a follower from its slot, nan while nobody follows."""
    off_m = tracks.tracking_errors(course.path)[2]
    kept = np.where(np.isfinite(off_m), off_m, -np.inf).max(axis=1, initial=-np.inf)
    result: Floats = np.where(kept >= 0.0, kept, np.nan)
    return result
