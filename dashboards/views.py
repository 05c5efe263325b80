"""Tick records -> Rerun: a table of small converters, one entity per kind, one instance per robot.

    records --batch--> Batch (arrays) --VIEWS--> Drawing (path, rows, columns) ...

The number of entities does not grow with the robots, and what costs most (forces, scans, slots,
distances of all pairs) is drawn at every tick only for a small swarm.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from math import inf, nan

import msgspec
import numpy as np
import numpy.typing as npt
import rerun as rr

from dashboards import snapshot, states
from dashboards.snapshot import ALIVE, CLEARANCE, CONTACT, SPEED, YAW
from dashboards.stage import FORCES, STATE_ROBOTS_MAX
from dashboards.states import Troubles
from swarm import geometry, messages
from swarm.geometry import Floats
from swarm.messages import Event, TickRecord
from swarm.scenario import Scenario

FORCE_LENGTH_M_MAX = 1.0  # arrow of an endless force
FORCE_HALF = 6.0  # force whose arrow has half that length
CROSS = np.array([[[-1.0, -1.0], [1.0, 1.0]], [[-1.0, 1.0], [1.0, -1.0]]])  # strokes, in radii

Rows = npt.NDArray[np.intp]


class Before(msgspec.Struct, frozen=True, eq=False):
    """What the batch before leaves for the next one."""

    positions: Floats | None = None  # (robots, 2) m
    stopped: bool = False  # whether there was any body that stood for good
    troubles: Troubles = Troubles()
    words: tuple[str, ...] = ()  # on the time lines; none for a large swarm


class Shot(msgspec.Struct, frozen=True, eq=False):
    """One tick, its arrays taken while they were fresh."""

    record: TickRecord
    motion: Floats  # (robots, 7), as in snapshot
    scan: Floats | None  # (hits, 2) m; None when scans are not drawn at this tick


class Batch(msgspec.Struct, frozen=True, eq=False):
    """Some consecutive ticks as arrays."""

    scenario: Scenario
    records: Sequence[TickRecord]
    before: Before
    all: Rows  # 0 .. ticks - 1
    detail: Rows  # those drawn in full
    ticks: npt.NDArray[np.int64]  # (ticks,)
    times_s: Floats  # (ticks,)
    motion: Floats  # (ticks, robots, 7)
    positions: Floats  # (ticks, robots, 2) m
    slots: Floats  # (details, robots, 2) m, nan where there is none
    scans: Mapping[int, Floats]  # (hits, 2) m, by row
    troubles: Troubles  # after the last tick
    words: Sequence[tuple[str, ...]]  # on the time lines, by tick; none for a large swarm


class Drawing(msgspec.Struct, frozen=True, eq=False):
    """Columns of one entity at some rows of a batch."""

    path: str
    rows: Rows
    columns: Sequence[rr.ComponentColumn]


def shot(record: TickRecord) -> Shot:
    """What a batch needs of one tick."""
    scanned = record.tick % snapshot.scan_ticks(len(record.robots)) == 0
    return Shot(record, snapshot.motion(record), snapshot.scan(record) if scanned else None)


def batch(scenario: Scenario, shots: Sequence[Shot], before: Before) -> Batch:
    """Arrays of at least one tick."""
    records = [shot.record for shot in shots]
    ticks = np.array([record.tick for record in records], np.int64)
    detail = np.flatnonzero(ticks % snapshot.detail_ticks(len(scenario.robots)) == 0)
    motion = np.array([shot.motion for shot in shots])
    slots = [_slots(scenario, records[row]) for row in detail]
    troubles, words = before.troubles, []
    if len(scenario.robots) <= STATE_ROBOTS_MAX:
        for record in records:
            troubles = states.follow(troubles, record)
            words.append(states.words(scenario, troubles, record))
    return Batch(
        scenario=scenario,
        records=records,
        before=before,
        all=np.arange(len(records)),
        detail=detail,
        ticks=ticks,
        times_s=np.array([record.stamp_ns for record in records]) * 1e-9,
        motion=motion,
        positions=np.ascontiguousarray(motion[:, :, :2]),
        slots=np.array(slots).reshape(-1, len(scenario.robots), 2),
        scans={row: shot.scan for row, shot in enumerate(shots) if shot.scan is not None},
        troubles=troubles,
        words=words,
    )


def after(batch: Batch) -> Before:
    """What the next batch needs of this one."""
    return Before(
        batch.positions[-1],
        bool(_stopped_flags(batch)[-1].any()),
        batch.troubles,
        batch.words[-1] if batch.words else (),
    )


def _slots(scenario: Scenario, record: TickRecord) -> list[geometry.Vec2]:
    """Where each follower should be by eq. 39, P_l - d e(alpha + theta_F), else nan.

    As in the metrics: the true pose of the leader that a follower names, that leader's published
    formation heading, and the nominal slot that the follower publishes.
    """
    result = [(nan, nan)] * len(record.robots)
    if scenario.formation is None:
        return result
    rows = {robot.name: row for row, robot in enumerate(scenario.robots)}
    for row, robot in enumerate(record.robots):
        beacon = robot.beacon
        if beacon is None or beacon.leadership is None or not robot.alive:
            continue
        leader_row = rows.get(beacon.leadership.name, row)
        leader, slot = record.robots[leader_row], beacon.slot or scenario.slot(row)
        if leader_row == row or slot is None or leader.beacon is None or not leader.alive:
            continue
        x, y = geometry.unit(slot.bearing_rad + leader.beacon.formation_heading_rad)
        result[row] = (
            leader.pose.x_m - slot.distance_m * x,
            leader.pose.y_m - slot.distance_m * y,
        )
    return result


# --- the scene ------------------------------------------------------------------------------------


def _bodies(batch: Batch) -> Iterator[Drawing]:
    robots = batch.positions.shape[1]
    yield Drawing(
        "world/bodies",
        batch.all,
        _points(batch.positions, [robots] * len(batch.all)),
    )


def _headings(batch: Batch) -> Iterator[Drawing]:
    """From the centre to the rim."""
    radii_m = np.array([robot.body_radius_m for robot in batch.scenario.robots])
    yaw_rad = batch.motion[:, :, YAW]
    vectors = radii_m[:, None] * np.stack([np.cos(yaw_rad), np.sin(yaw_rad)], axis=2)
    counts = [vectors.shape[1]] * len(batch.all)
    yield Drawing("world/headings", batch.all, _arrows(batch.positions, vectors, counts))


def _trails(batch: Batch) -> Iterator[Drawing]:
    """The step of each robot at each tick; the view shows those of the last seconds as one line."""
    first = batch.positions[0] if batch.before.positions is None else batch.before.positions
    start = np.concatenate([first[None], batch.positions[:-1]])
    steps = np.stack([start, batch.positions], axis=2).reshape(-1, 2, 2)
    columns = rr.LineStrips2D.columns(strips=steps)
    counts = [batch.positions.shape[1]] * len(batch.all)
    yield Drawing("world/trails", batch.all, [*columns.partition(counts)])


def _stopped(batch: Batch) -> Iterator[Drawing]:
    """Each body that is dead or has touched something is crossed out."""
    flags = _stopped_flags(batch)
    if flags.any() or batch.before.stopped:
        radii_m = np.array([robot.body_radius_m for robot in batch.scenario.robots])
        reach_m = np.broadcast_to(radii_m, flags.shape)[flags][:, None, None, None]
        strokes = batch.positions[flags][:, None, None] + reach_m * CROSS
        columns = rr.LineStrips2D.columns(strips=strokes.reshape(-1, 2, 2))
        counts = [len(CROSS) * int(number) for number in flags.sum(axis=1)]
        yield Drawing("world/stopped", batch.all, [*columns.partition(counts)])


def _stopped_flags(batch: Batch) -> npt.NDArray[np.bool_]:
    """(ticks, robots)"""
    flags: npt.NDArray[np.bool_] = (batch.motion[:, :, ALIVE] == 0.0) | (
        batch.motion[:, :, CONTACT] != 0.0
    )
    return flags


def _slot_marks(batch: Batch) -> Iterator[Drawing]:
    """All robots, so that the colours fit; a point that is nan is not drawn."""
    if batch.scenario.formation is not None and len(batch.detail):
        counts = [batch.slots.shape[1]] * len(batch.detail)
        yield Drawing("world/slots", batch.detail, _points(batch.slots, counts))


def _scan(batch: Batch) -> Iterator[Drawing]:
    if batch.scans:
        scans = list(batch.scans.values())
        columns = _points(np.concatenate(scans), [len(scan) for scan in scans])
        yield Drawing("world/scan", np.array(list(batch.scans)), columns)


def _forces(batch: Batch) -> Iterator[Drawing]:
    """Arrows of the terms of eq. 38, long forces compressed: |arrow| = max |F| / (|F| + half)."""
    rows = {robot.name: row for row, robot in enumerate(batch.scenario.robots)}
    flat: list[float] = []
    whose: list[int] = []
    counts: list[int] = []
    for index in batch.detail:
        commands = batch.records[index].commands
        counts.append(len(commands))
        for command in commands:
            whose.append(rows[command.robot])
            forces = command.trace.forces
            flat += forces.attractive
            flat += forces.repulsive
            flat += forces.rotating
            flat += forces.robots
            flat += forces.resultant
    if not counts:
        return
    origins = batch.positions[np.repeat(batch.detail, counts), np.array(whose, np.intp)]
    vectors = np.array(flat).reshape(-1, len(FORCES), 2)
    lengths = np.sqrt((vectors**2).sum(axis=2, keepdims=True))
    vectors *= FORCE_LENGTH_M_MAX / (lengths + FORCE_HALF)
    for number, name in enumerate(FORCES):
        columns = _arrows(origins, vectors[:, number], counts)
        yield Drawing(f"world/forces/{name}", batch.detail, columns)


# --- plots, events, states ------------------------------------------------------------------------


def _formation_error(batch: Batch) -> Iterator[Drawing]:
    """Distance of each follower from its slot, and the largest of them."""
    apart = batch.positions[batch.detail] - batch.slots
    errors_m = np.sqrt((apart**2).sum(axis=2))
    some = np.isfinite(errors_m).any(axis=1)
    if not some.any():
        return
    rows, errors_m = batch.detail[some], errors_m[some]
    counts = [errors_m.shape[1]] * len(rows)
    yield Drawing("plots/formation_error", rows, _scalars(errors_m, counts))
    largest_m = np.nanmax(errors_m, axis=1)
    yield Drawing("plots/formation_error_max", rows, _scalars(largest_m, [1] * len(rows)))


def _clearance(batch: Batch) -> Iterator[Drawing]:
    """Smallest distance of surfaces: robot to obstacle, robot to robot; nan where there is none."""
    if len(batch.detail) == 0:
        return
    radii_m = np.array([robot.body_radius_m for robot in batch.scenario.robots])
    touching_m = radii_m[:, None] + radii_m[None, :]
    np.fill_diagonal(touching_m, -inf)
    x, y = (batch.positions[batch.detail, :, axis] for axis in (0, 1))
    apart = (x[:, :, None] - x[:, None]) ** 2 + (y[:, :, None] - y[:, None]) ** 2
    smallest = np.column_stack(
        [
            batch.motion[batch.detail, :, CLEARANCE].min(axis=1),
            (np.sqrt(apart) - touching_m).min(axis=(1, 2)),
        ]
    )
    smallest[np.isinf(smallest)] = nan
    yield Drawing("plots/clearance", batch.detail, _scalars(smallest, [2] * len(batch.detail)))


def _speed(batch: Batch) -> Iterator[Drawing]:
    counts = [batch.motion.shape[1]] * len(batch.all)
    yield Drawing("plots/speed", batch.all, _scalars(batch.motion[:, :, SPEED], counts))


def _events(batch: Batch) -> Iterator[Drawing]:
    rows, texts, levels = [], [], []
    for row, record in enumerate(batch.records):
        for event in record.events:
            rows.append(row)
            texts.append(event_text(event))
            levels.append(messages.level_of(event.kind).upper())
    if rows:
        columns = [*rr.TextLog.columns(text=texts, level=levels)]
        yield Drawing("events", np.array(rows), columns)


def event_text(event: Event) -> str:
    """One line for a person."""
    who = "" if event.robot is None else f" {event.robot}"
    text = event.text or event.fault
    return f"{event.kind}{who}{': ' if text else ''}{text}"


def _state_changes(batch: Batch) -> Iterator[Drawing]:
    """One time line per robot, a row only where it changes."""
    changes: dict[int, list[tuple[int, str]]] = {}
    before = batch.before.words
    for row, now in enumerate(batch.words):
        for robot, word in enumerate(now):
            if not before or before[robot] != word:
                changes.setdefault(robot, []).append((row, word))
        before = now
    for robot, found in changes.items():
        rows = np.array([row for row, _ in found])
        columns = [*rr.StateChange.columns(state=[word for _, word in found])]
        yield Drawing(f"robots/{batch.scenario.robots[robot].name}", rows, columns)


VIEWS: tuple[Callable[[Batch], Iterator[Drawing]], ...] = (
    _bodies,
    _headings,
    _trails,
    _stopped,
    _slot_marks,
    _scan,
    _forces,
    _formation_error,
    _clearance,
    _speed,
    _events,
    _state_changes,
)


# --- columns --------------------------------------------------------------------------------------


def _points(positions: Floats, counts: Sequence[int]) -> list[rr.ComponentColumn]:
    columns = rr.Points2D.columns(positions=positions.reshape(-1, 2))
    return [*columns.partition(counts)]


def _arrows(origins: Floats, vectors: Floats, counts: Sequence[int]) -> list[rr.ComponentColumn]:
    columns = rr.Arrows2D.columns(origins=origins.reshape(-1, 2), vectors=vectors.reshape(-1, 2))
    return [*columns.partition(counts)]


def _scalars(values: Floats, counts: Sequence[int]) -> list[rr.ComponentColumn]:
    return [*rr.Scalars.columns(scalars=values.ravel()).partition(counts)]
