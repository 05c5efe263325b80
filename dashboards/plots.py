"""Curves and words over time: errors, forces, clearances, gains, speed, costs; events and states.

Every view takes a batch. A curve is one number of a row of them; nan leaves a gap.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from math import inf, nan

import numpy as np
import rerun as rr

from dashboards import batches, states
from dashboards.batches import Batch, Drawing, Lead
from dashboards.snapshot import CLEARANCE, SPEED
from dashboards.stage import STATE_ROBOTS_MAX
from swarm import messages
from swarm.geometry import Floats
from swarm.messages import Event, EventKind, TickRecord

RIGHT_OF_WAY = "DEBUG"  # level of who waits for whom: often, and no trouble
OVER: tuple[EventKind, ...] = ("fault-over", "robot-returned")


def formation_error(batch: Batch) -> Iterator[Drawing]:
    """Distance of each follower from its slot, and the largest of them."""
    if batch.scenario.formation is None:
        return
    apart = batch.positions[batch.detail] - batch.slots
    errors_m = np.sqrt((apart**2).sum(axis=2))
    table = np.column_stack([errors_m, np.fmax.reduce(errors_m, axis=1)])
    yield _curves("plots/formation_error", batch.detail, table)


def tracking(batch: Batch) -> Iterator[Drawing]:
    """The error e of eq. 47 as each follower has it: along, and as an angle. While it tracks."""
    if batch.scenario.formation is None:
        return
    errors = batch.traces[:, :, [batches.ERROR_M, batches.ERROR_RAD]]
    errors[(errors == 0.0).all(axis=2)] = nan  # who tracks nothing
    yield _curves("plots/tracking_distance", batch.detail, errors[:, :, 0])
    yield _curves("plots/tracking_bearing", batch.detail, errors[:, :, 1])


def gains(batch: Batch) -> Iterator[Drawing]:
    """The six adapted gains, mean of those who have any."""
    table = batch.traces[:, :, batches.GAINS]
    some = (table != 0.0).any(axis=2) & np.isfinite(table).all(axis=2)
    rows = some.any(axis=1)
    if rows.any():
        table = np.where(some[:, :, None], table, 0.0).sum(axis=1)[rows]
        yield _curves("plots/gains", batch.detail[rows], table / some.sum(axis=1)[rows, None])


def force_angle(batch: Batch) -> Iterator[Drawing]:
    """Direction of each robot's resultant force of eq. 38; nan without one."""
    if len(batch.detail):
        x, y = np.moveaxis(batch.traces[:, :, batches.FORCES][:, :, -2:], 2, 0)
        angles_rad = np.where((x == 0.0) & (y == 0.0), nan, np.arctan2(y, x))
        yield _curves("plots/force_angle", batch.detail, angles_rad)


def clearance(batch: Batch) -> Iterator[Drawing]:
    """Smallest distance of surfaces: robot to obstacle, robot to robot; nan where there is none."""
    if len(batch.detail) == 0:
        return
    touching_m = batch.radii_m[:, None] + batch.radii_m[None, :]
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
    yield _curves("plots/clearance", batch.detail, smallest)


def speed(batch: Batch) -> Iterator[Drawing]:
    """Of each robot."""
    yield _curves("plots/speed", batch.all, batch.motion[:, :, SPEED])


def tick_cost(batch: Batch) -> Iterator[Drawing]:
    """Time from tick to tick by the wall, and the CPU that the world spent in it, ms."""
    if np.isfinite(batch.costs_s).any():
        yield _curves("plots/tick_cost", batch.all, 1000.0 * batch.costs_s)


def modes(batch: Batch) -> Iterator[Drawing]:
    """How many robots of a large swarm are in each mode, wait, or have stopped for good."""
    if len(batch.rows) <= STATE_ROBOTS_MAX or not len(batch.detail):
        return
    table = []
    for row, company in zip(batch.detail.tolist(), batch.companies, strict=True):
        found: Counter[str] = Counter(
            robot.beacon.mode
            for robot in batch.records[row].robots
            if robot.alive and not robot.contact and robot.beacon is not None
        )
        stopped = int(batch.stopped[row].sum())
        table.append([*(found[mode] for mode in states.MODES), len(company.yields), stopped])
    yield _curves("plots/modes", batch.detail, np.array(table, np.float64))


def faults(batch: Batch) -> Iterator[Drawing]:
    """Marks on the ground line of every plot: something goes wrong, something is over."""
    marks: dict[int, list[float]] = {}
    for row, record in enumerate(batch.records):
        for event in record.events:
            if event.kind in OVER:
                marks.setdefault(row, [nan, nan])[1] = 0.0
            elif messages.level_of(event.kind) != "info":
                marks.setdefault(row, [nan, nan])[0] = 0.0
    if marks:
        yield _curves("plots/faults", np.array(list(marks)), np.array(list(marks.values())))


def _curves(path: str, rows: batches.Rows, table: Floats) -> Drawing:
    """A number per curve in every row."""
    return Drawing(path, rows, batches.scalars(table, [table.shape[1]] * len(rows)))


# --- words ----------------------------------------------------------------------------------------


def events(batch: Batch) -> Iterator[Drawing]:
    """What happened, who leads from now on, and in a small swarm who waits for whom."""
    lines: list[tuple[int, str, str]] = []
    for row, record in enumerate(batch.records):
        lines += _told(row, record)
    leads, yields, gaps = batch.before.leads, dict(batch.before.yields), dict(batch.before.gaps)
    for row, company in zip(batch.detail.tolist(), batch.companies, strict=True):
        if company.leads != leads and (company.leads or leads):
            lines.append((row, f"leader: {lead_text(company.leads)}", "INFO"))
        leads = company.leads
        if len(batch.rows) <= STATE_ROBOTS_MAX:
            lines += _right_of_way(batch, row, yields, dict(company.yields))
            lines += _gaps(batch, row, gaps, dict(company.gaps))
            yields, gaps = dict(company.yields), dict(company.gaps)
    if lines:
        lines.sort(key=lambda line: line[0])
        rows, texts, levels = zip(*lines, strict=True)
        columns = [*rr.TextLog.columns(text=texts, level=levels)]
        yield Drawing("events", np.array(rows), columns)


def _told(row: int, record: TickRecord) -> Iterator[tuple[int, str, str]]:
    for event in record.events:
        yield row, event_text(event), messages.level_of(event.kind).upper()


def _right_of_way(
    batch: Batch, row: int, before: Mapping[int, int], now: Mapping[int, int]
) -> Iterator[tuple[int, str, str]]:
    names = list(batch.rows)
    for who, whom in now.items():
        if before.get(who) != whom:
            yield row, f"{names[who]} yields to {names[whom]}", RIGHT_OF_WAY
    for who in before.keys() - now.keys():
        yield row, f"{names[who]} goes on", RIGHT_OF_WAY


def _gaps(
    batch: Batch, row: int, before: Mapping[int, bool], now: Mapping[int, bool]
) -> Iterator[tuple[int, str, str]]:
    names = list(batch.rows)
    for who, holds in now.items():
        if before.get(who) != holds:
            yield row, f"{names[who]} {'holds' if holds else 'claims'} a gap", RIGHT_OF_WAY
    for who in before.keys() - now.keys():
        yield row, f"{names[who]} is through its gap", RIGHT_OF_WAY


def event_text(event: Event) -> str:
    """One line for a person."""
    who = "" if event.robot is None else f" {event.robot}"
    text = event.text or event.fault
    return f"{event.kind}{who}{': ' if text else ''}{text}"


def lead_text(leads: tuple[Lead, ...]) -> str:
    """Who leads, in which term; several when they do not hear each other."""
    return " and ".join(f"{name} (term {term})" for name, term in leads) or "nobody"


def state_changes(batch: Batch) -> Iterator[Drawing]:
    """One time line per robot of a small swarm, a row only where it changes."""
    changes: dict[int, list[tuple[int, str]]] = {}
    before = batch.before.words
    for row, now in enumerate(batch.words):
        for robot, word in enumerate(now):
            if not before or before[robot] != word:
                changes.setdefault(robot, []).append((row, word))
        before = now
    names = list(batch.rows)
    for robot, found in changes.items():
        rows = np.array([row for row, _ in found])
        columns = [*rr.StateChange.columns(state=[word for _, word in found])]
        yield Drawing(f"robots/{names[robot]}", rows, columns)


def leader_changes(batch: Batch) -> Iterator[Drawing]:
    """The time line of the leaders and their terms, where somebody can lead."""
    if batch.scenario.formation is None:
        return
    rows, words, before = [], [], batch.before.leads
    for row, company in zip(batch.detail.tolist(), batch.companies, strict=True):
        if before is None or company.leads != before:
            rows.append(row)
            words.append(lead_text(company.leads))
        before = company.leads
    if rows:
        columns = [*rr.StateChange.columns(state=words)]
        yield Drawing("swarm/leader", np.array(rows), columns)
