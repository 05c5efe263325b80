"""Some consecutive ticks as arrays, for everything that is drawn of them.

    TickRecord --shot--> Shot ... --batch--> Batch (arrays) --views--> Drawing (path, rows, columns)

What costs most (forces, errors, who hears whom, distances of all pairs) is gathered at every tick
only for a small swarm, the map and the scan of the leading robot a few times a second.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import nan

import msgspec
import numpy as np
import numpy.typing as npt
import rerun as rr

from dashboards import snapshot, states
from dashboards.snapshot import ALIVE, CONTACT
from dashboards.stage import STATE_ROBOTS_MAX, TRAILS, Colours
from dashboards.states import Troubles
from swarm import geometry
from swarm.geometry import Floats
from swarm.messages import Command, FrameRecord, Leadership, TickRecord, leadership_order
from swarm.scenario import Scenario

# Numbers of a robot's trace, and where they are in `Batch.traces`.
FORCES = slice(0, 10)  # (attractive, repulsive, rotating, robots, resultant) x (x, y)
GAINS = slice(10, 16)
ERROR_M, ERROR_RAD = 16, 17  # e of eq. 47
NUMBERS = 18

Rows = npt.NDArray[np.intp]
Flags = npt.NDArray[np.bool_]
Lead = tuple[str, int]  # name, term


class Before(msgspec.Struct, frozen=True, eq=False):
    """What the batch before leaves for the next one."""

    corners: tuple[Floats, ...] = ()  # (robots, 2) m, where the trail of each of TRAILS ends
    stopped: bool = False  # whether there was any body that stood for good
    troubles: Troubles = Troubles()
    words: tuple[str, ...] = ()  # on the time lines; none for a large swarm
    leads: tuple[Lead, ...] | None = None
    yields: tuple[tuple[int, int], ...] = ()
    gaps: tuple[tuple[int, bool], ...] = ()


class Shot(msgspec.Struct, frozen=True, eq=False):
    """One tick, its arrays taken while they were fresh."""

    record: TickRecord
    motion: Floats  # (robots, 7), as in snapshot
    wall_s: float = nan  # since the tick before
    cpu_s: float = nan  # of this process in that time


class Company(msgspec.Struct, frozen=True):
    """What the robots are to each other at one tick, by what they say; rows of the scenario."""

    leads: tuple[Lead, ...]  # who says that it leads, highest claim first
    focus: int  # who is selected, else the first of these, or of the living
    yields: tuple[tuple[int, int], ...]  # who waits, for whom
    gaps: tuple[tuple[int, bool], ...]  # who claims a gap, and whether it holds it


class Batch(msgspec.Struct, frozen=True, eq=False):
    """Some consecutive ticks as arrays."""

    scenario: Scenario
    rows: Mapping[str, int]  # name -> row of the scenario
    radii_m: Floats  # (robots,) of the bodies
    records: Sequence[TickRecord]
    before: Before
    all: Rows  # 0 .. ticks - 1
    detail: Rows  # those drawn in full
    ticks: npt.NDArray[np.int64]  # (ticks,)
    times_s: Floats  # (ticks,)
    motion: Floats  # (ticks, robots, 7)
    positions: Floats  # (ticks, robots, 2) m
    stopped: Flags  # (ticks, robots) dead, or has touched something
    costs_s: Floats  # (ticks, 2) wall and CPU
    companies: Sequence[Company]  # (details,)
    slots: Floats  # (details, robots, 2) m, nan where there is none
    traces: Floats  # (details, robots, NUMBERS), nan where there was no command
    maps: Mapping[int, Company]  # by row: ticks at which map and scan of the focus are drawn
    troubles: Troubles  # after the last tick
    words: Sequence[tuple[str, ...]]  # on the time lines, by tick; none for a large swarm


class Drawing(msgspec.Struct, frozen=True, eq=False):
    """Columns of one entity at some rows of a batch."""

    path: str
    rows: Rows
    columns: Sequence[rr.ComponentColumn]


def shot(record: TickRecord, wall_s: float = nan, cpu_s: float = nan) -> Shot:
    """What a batch needs of one tick."""
    return Shot(record, snapshot.motion(record), wall_s, cpu_s)


def batch(scenario: Scenario, shots: Sequence[Shot], before: Before, selected: str = "") -> Batch:
    """Arrays of at least one tick.

    Args:
        selected: robot that is looked at while it lives; "": the leader.
    """
    robots = len(scenario.robots)
    records = [shot.record for shot in shots]
    rows = {robot.name: row for row, robot in enumerate(scenario.robots)}
    ticks = np.array([record.tick for record in records], np.int64)
    detail = np.flatnonzero(ticks % snapshot.detail_ticks(robots) == 0)
    seldom = snapshot.scan_ticks(robots)
    motion = np.array([shot.motion for shot in shots])
    companies = [_company(records[row], rows, rows.get(selected)) for row in detail]
    troubles, words = before.troubles, []
    for record in records:
        troubles = states.follow(troubles, record)
        if robots <= STATE_ROBOTS_MAX:
            words.append(states.words(scenario, troubles, record))
    return Batch(
        scenario=scenario,
        rows=rows,
        radii_m=np.array([robot.body_radius_m for robot in scenario.robots]),
        records=records,
        before=before,
        all=np.arange(len(records)),
        detail=detail,
        ticks=ticks,
        times_s=np.array([record.stamp_ns for record in records]) * 1e-9,
        motion=motion,
        positions=np.ascontiguousarray(motion[:, :, :2]),
        stopped=(motion[:, :, ALIVE] == 0.0) | (motion[:, :, CONTACT] != 0.0),
        costs_s=np.array([(shot.wall_s, shot.cpu_s) for shot in shots]),
        companies=companies,
        slots=np.array([_slots(scenario, records[row], rows) for row in detail]).reshape(
            -1, robots, 2
        ),
        traces=_traces([records[row] for row in detail], rows),
        maps={
            row: company
            for row, company in zip(detail.tolist(), companies, strict=True)
            if ticks[row] % seldom == 0
        },
        troubles=troubles,
        words=words,
    )


def after(batch: Batch) -> Before:
    """What the next batch needs of this one."""
    last = batch.companies[-1] if batch.companies else None
    return Before(
        corners=tuple(corners(batch, trail)[1][-1] for trail in range(len(TRAILS))),
        stopped=bool(batch.stopped[-1].any()),
        troubles=batch.troubles,
        words=batch.words[-1] if batch.words else (),
        leads=batch.before.leads if last is None else last.leads,
        yields=batch.before.yields if last is None else last.yields,
        gaps=batch.before.gaps if last is None else last.gaps,
    )


def corners(batch: Batch, trail: int) -> tuple[Rows, Floats]:
    """Rows at which a trail gets a new corner, and (rows + 1, robots, 2) its last corners, m."""
    rows = np.flatnonzero(batch.ticks % TRAILS[trail].stride_ticks == 0)
    known = batch.before.corners
    first = known[trail] if known else batch.positions[0]
    return rows, np.concatenate([first[None], batch.positions[rows]])


def _company(record: TickRecord, rows: Mapping[str, int], selected: int | None) -> Company:
    claims: list[Leadership] = []  # of a robot about itself
    yields: list[tuple[int, int]] = []
    gaps: list[tuple[int, bool]] = []
    living = -1
    for row, robot in enumerate(record.robots):
        beacon = robot.beacon
        if not robot.alive:
            continue
        if living < 0:
            living = row
        if beacon is None:
            continue
        claim, other = beacon.leadership, beacon.yields_to
        if claim is not None and rows.get(claim.name) == row:
            claims.append(claim)
        if other is not None and other in rows:
            yields.append((row, rows[other]))
        if beacon.passage is not None:
            gaps.append((row, beacon.passage.holds))
    if len(claims) > 1:
        claims.sort(key=leadership_order)
    focus = rows[claims[0].name] if claims else max(living, 0)
    if selected is not None and record.robots[selected].alive:
        focus = selected
    return Company(
        leads=tuple([(claim.name, claim.term) for claim in claims]),
        focus=focus,
        yields=tuple(yields),
        gaps=tuple(gaps),
    )


def _slots(scenario: Scenario, record: TickRecord, rows: Mapping[str, int]) -> list[geometry.Vec2]:
    """Where each follower should be by eq. 39, P_l - d e(alpha + theta_F), else nan.

    As in the metrics: the true pose of the leader that a follower names, that leader's published
    formation heading, and the nominal slot that the follower publishes.
    """
    result = [(nan, nan)] * len(record.robots)
    if scenario.formation is None:
        return result
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


def _traces(records: Sequence[TickRecord], rows: Mapping[str, int]) -> Floats:
    flat: list[float] = []
    whose: list[int] = []
    counts: list[int] = []
    for record in records:
        counts.append(len(record.commands))
        for command in record.commands:
            trace = command.trace
            forces = trace.forces
            whose.append(rows[command.robot])
            flat += forces.attractive
            flat += forces.repulsive
            flat += forces.rotating
            flat += forces.robots
            flat += forces.resultant
            flat += trace.gains
            flat += trace.error
    result = np.full((len(records), len(rows), NUMBERS), nan)
    at = np.repeat(np.arange(len(records)), counts)
    result[at, np.array(whose, np.intp)] = np.array(flat).reshape(-1, NUMBERS)
    return result


def command_of(record: TickRecord, name: str) -> Command | None:
    """Newest command of a robot in a tick."""
    return next((one for one in reversed(record.commands) if one.robot == name), None)


def frame_of(record: TickRecord, row: int) -> FrameRecord | None:
    """Frame of a robot in a tick."""
    return next((frame for frame in record.frames if frame.row == row), None)


# --- columns --------------------------------------------------------------------------------------


def points(positions: Floats, counts: Sequence[int]) -> list[rr.ComponentColumn]:
    """Columns of `counts` points a row."""
    columns = rr.Points2D.columns(positions=positions.reshape(-1, 2))
    return [*columns.partition(counts)]


def arrows(origins: Floats, vectors: Floats, counts: Sequence[int]) -> list[rr.ComponentColumn]:
    """Columns of `counts` arrows a row."""
    columns = rr.Arrows2D.columns(origins=origins.reshape(-1, 2), vectors=vectors.reshape(-1, 2))
    return [*columns.partition(counts)]


def strips(
    lines: Floats,
    counts: Sequence[int],
    colours: Colours | None = None,
    radii_m: Floats | None = None,
) -> list[rr.ComponentColumn]:
    """Columns of `counts` lines a row, all of as many points: (lines, points, 2)."""
    columns = rr.LineStrips2D.columns(
        strips=lines.astype(np.float32), colors=colours, radii=radii_m
    )
    return [*columns.partition(counts)]


def scalars(values: Floats, counts: Sequence[int]) -> list[rr.ComponentColumn]:
    """Columns of `counts` numbers a row."""
    return [*rr.Scalars.columns(scalars=values.ravel()).partition(counts)]
