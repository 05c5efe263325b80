"""Runs -> rows of figures, and the runs most worth looking at."""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Sequence

import msgspec

from swarm.run.bench.figures import Machine
from swarm.run.bench.navigation.cases import Controller
from swarm.run.bench.navigation.course import Outcome, Run
from swarm.run.bench.navigation.peers import EXPECTED, PEERS, Published

WORST_MAX = 2  # of a family under one controller
SEVERITY: tuple[Outcome, ...] = ("crashed", "collided", "timeout", "blocked", "succeeded")


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """All runs of one group under one controller; medians are those of the successes."""

    family: str
    size: str
    controller: Controller
    runs: int
    success: float  # shares of the runs
    collided: float
    timeout: float
    blocked: float
    crashed: float
    arrived: float  # share of the robots, over all runs
    clearance_m_worst: float | None
    clearance_m_median: float | None  # over the runs, each with its least
    makespan_ratio: float | None
    time_ratio: float | None
    path_ratio: float | None
    score: float | None  # mean
    step_us: float | None  # median over the runs
    expected: float | None  # share of successes
    met: bool | None  # that many, and nobody touched anything


class Worst(msgspec.Struct, frozen=True, kw_only=True):
    """A run to look at, and how."""

    run: Run
    command: str


class Navigation(msgspec.Struct, frozen=True, kw_only=True):
    """All that `swarm bench navigation` found."""

    machine: Machine
    versions: dict[str, str]
    tiny: bool
    partial: bool  # interrupted: of the runs that had ended by then
    planned: int  # runs
    rows: tuple[Row, ...]
    peers: tuple[Published, ...]
    worst: tuple[Worst, ...]
    runs: tuple[Run, ...]
    skipped: tuple[str, ...]  # families without their data
    wall_time_s: float

    @property
    def crashed(self) -> bool:
        """Whether any run ended by an exception."""
        return any(run.outcome == "crashed" for run in self.runs)


def rows(runs: Iterable[Run], *, judged: bool) -> tuple[Row, ...]:
    """One row per group and controller, in the order of the runs given."""
    groups: dict[tuple[str, str, Controller], list[Run]] = {}
    for run in runs:
        groups.setdefault((run.family, run.size, run.controller), []).append(run)
    return tuple(row(some, judged=judged) for some in groups.values())


def row(runs: Sequence[Run], *, judged: bool) -> Row:
    """Row of some runs of one group under one controller.

    Args:
        judged: whether expectations count.
    """
    first = runs[0]
    clearances_m = _known(run.clearance_m for run in runs)
    scores = _known(run.score for run in runs)
    success = _share(runs, "succeeded")
    judged = judged and first.controller == "navigator"
    expected = EXPECTED.get((first.family, first.size)) if judged else None
    contact = any(run.outcome in ("collided", "crashed") for run in runs)
    return Row(
        family=first.family,
        size=first.size,
        controller=first.controller,
        runs=len(runs),
        success=success,
        collided=_share(runs, "collided"),
        timeout=_share(runs, "timeout"),
        blocked=_share(runs, "blocked"),
        crashed=_share(runs, "crashed"),
        arrived=sum(run.arrived for run in runs) / sum(run.robots for run in runs),
        clearance_m_worst=min(clearances_m, default=None),
        clearance_m_median=_median(clearances_m),
        makespan_ratio=_median(_known(run.makespan_ratio for run in runs)),
        time_ratio=_median(_known(run.time_ratio for run in runs)),
        path_ratio=_median(_known(run.path_ratio for run in runs)),
        score=sum(scores) / len(runs) if scores else None,
        step_us=_median(_known(run.step_us for run in runs)),
        expected=expected,
        met=None if expected is None else success >= expected and not contact,
    )


def worst(runs: Iterable[Run]) -> tuple[Run, ...]:
    """Crashed, then collided, then late or blocked, then slowest, of each family and controller."""
    families: dict[tuple[str, Controller], list[Run]] = {}
    for run in runs:
        families.setdefault((run.family, run.controller), []).append(run)
    return tuple(
        run for some in families.values() for run in sorted(some, key=_badness)[:WORST_MAX]
    )


def beside(some: Sequence[Row]) -> tuple[Published, ...]:
    """Peers' figures for the groups at hand."""
    groups = {(row.family, row.size) for row in some}
    return tuple(peer for peer in PEERS if (peer.family, peer.size) in groups)


def _badness(run: Run) -> tuple[int, float, float]:
    return (
        SEVERITY.index(run.outcome),
        run.arrived / run.robots,
        -(run.makespan_ratio or 0.0),
    )


def _share(runs: Sequence[Run], outcome: Outcome) -> float:
    return sum(run.outcome == outcome for run in runs) / len(runs)


def _known(values: Iterable[float | None]) -> list[float]:
    return [value for value in values if value is not None]


def _median(values: Sequence[float]) -> float | None:
    return statistics.median(values) if values else None
