"""A stream of tick records -> what a run came to.

    begin(scenario) -> Score    observe(score, record) every tick    ended(score)? -> why
                                     summary(score, facts) -> Summary, the `--json` object

Only recorded truth and published beacons count, so the figures are the same live, from a recording
and in tests. What adds up from tick to tick is in swarm.score.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from math import inf
from typing import Literal

import msgspec

from swarm import geometry
from swarm.messages import TickRecord
from swarm.scenario import Expect, Scenario
from swarm.score import (
    Fault,
    Score,
    Tally,
    begin,
    ended,
    formation_error_now,
    observe,
)

__all__ = [
    "Facts",
    "Score",
    "Summary",
    "begin",
    "check",
    "ended",
    "formation_error_now",
    "observe",
    "of_records",
    "summary",
]

Outcome = Literal["succeeded", "collided", "timeout", "failed"]
RobotOutcome = Literal["arrived", "collided", "killed", "failed", "blocked", "timeout"]


class RobotRow(msgspec.Struct, frozen=True, kw_only=True):
    """One robot's part of a summary."""

    name: str
    outcome: RobotOutcome
    arrival_s: float | None  # first tick of the final unbroken stay
    path_m: float
    final_error_m: float | None  # to the goal, or to the slot of a follower
    yields: int
    waiting_s: float
    restarts: int
    reason: str = ""  # why it said FAILED, when that is how it ended


class FormationRow(msgspec.Struct, frozen=True, kw_only=True):
    """How well the followers kept their nominal slots."""

    error_m_max: float | None
    error_m_final: float | None
    settling_s: float | None  # None also when it never settled
    symmetry_m: float | None


class PriorityRow(msgspec.Struct, frozen=True, kw_only=True):
    """Who had to wait for whom."""

    yields: int
    waiting_s_max: float
    grants: int  # of passages that two cannot pass in
    double_grants: int  # to two of opposite directions at once
    guard_interventions: int  # times a guard began to hold a robot back


class LeaderRow(msgspec.Struct, frozen=True, kw_only=True):
    """From this tick on all live members of the formation followed this leader, who lived."""

    tick: int
    name: str
    term: int


class FaultRow(msgspec.Struct, frozen=True, kw_only=True):
    """One injected fault."""

    kind: str
    target: str
    tick: int
    over_s: float | None  # how long it lasted; None: to the end
    detected_s: float | None  # until the world took the robot for lost and nobody followed it
    recovered_s: float | None  # until all followed one live leader, within 0.1 m of their slots


class RecordingRow(msgspec.Struct, frozen=True, kw_only=True):
    """What the recording should hold, and what it does."""

    expected: int
    written: int
    lost: int


class ExpectRow(msgspec.Struct, frozen=True, kw_only=True):
    """The scenario's expectations, as texts."""

    met: list[str]
    missed: list[str]


class Summary(msgspec.Struct, frozen=True, kw_only=True):
    """The object of `swarm run --json` and of summary.json; what does not apply is None."""

    scenario: str
    run: str
    seed: int
    clock: Literal["lockstep", "realtime"]
    bus: str
    robots: int
    arrived: int
    outcome: Outcome
    collisions: int  # bodies that touched something, but for those that a fault excuses
    collisions_excused: int  # the fault was of the motors or the lidar, its own or the other's
    ticks: int  # the last tick's number
    sim_time_s: float
    wall_time_s: float | None
    real_time_factor: float | None
    min_clearance_obstacle_m: float | None
    min_clearance_robot_m: float | None
    makespan_s: float | None  # last arrival, when all who could arrive did
    path_ratio_mean: float | None  # over those who arrived
    per_robot: list[RobotRow]
    formation: FormationRow | None
    priority: PriorityRow
    leaders: list[LeaderRow]
    faults: list[FaultRow]
    late_commands: int
    commands_total: int
    recording: RecordingRow | None
    world_restarts: int
    state_hash: str | None
    expect: ExpectRow


class Facts(msgspec.Struct, frozen=True, kw_only=True):
    """What only the shell knows of a run."""

    scenario: str  # its name, not its title
    run: str
    bus: str
    clock: Literal["lockstep", "realtime"] = "lockstep"
    wall_time_s: float | None = None
    late_commands: int = 0
    recording: RecordingRow | None = None
    restarts: dict[str, int] = {}  # by robot's name; absent: 0
    world_restarts: int = 0


def of_records(scenario: Scenario, records: Iterable[TickRecord]) -> Score:
    """Score of ticks that have been recorded, in order."""
    score = begin(scenario)
    for record in records:
        observe(score, record)
    return score


def summary(score: Score, facts: Facts) -> Summary:
    """What the run came to, after its last tick."""
    scenario = score.scenario
    outcomes = [
        _outcome(tally, mission)
        for tally, mission in zip(score.tallies, score.missions, strict=True)
    ]
    rows = [_robot_row(score, facts, row, outcome) for row, outcome in enumerate(outcomes)]
    arrivals = [
        row.arrival_s for row in rows if row.outcome == "arrived" and row.arrival_s is not None
    ]
    everyone = all(
        outcome in ("arrived", "killed") or tally.excused
        for outcome, mission, tally in zip(outcomes, score.missions, score.tallies, strict=True)
        if mission
    )
    sim_time_s = score.tick * scenario.dt_s
    result = Summary(
        scenario=facts.scenario,
        run=facts.run,
        seed=scenario.seed,
        clock=facts.clock,
        bus=facts.bus,
        robots=len(rows),
        arrived=outcomes.count("arrived"),
        outcome=_run_outcome(score, outcomes),
        collisions=sum(tally.contact and not tally.excused for tally in score.tallies),
        collisions_excused=sum(tally.contact and tally.excused for tally in score.tallies),
        ticks=score.tick,
        sim_time_s=sim_time_s,
        wall_time_s=facts.wall_time_s,
        real_time_factor=sim_time_s / facts.wall_time_s if facts.wall_time_s else None,
        min_clearance_obstacle_m=_finite(score.clearance_obstacle_m),
        min_clearance_robot_m=_finite(score.clearance_robot_m),
        makespan_s=max(arrivals) if arrivals and everyone else None,
        path_ratio_mean=_path_ratio_mean(score, outcomes),
        per_robot=rows,
        formation=_formation_row(score),
        priority=PriorityRow(
            yields=sum(row.yields for row in rows),
            waiting_s_max=max(row.waiting_s for row in rows),
            grants=score.grants,
            double_grants=score.double_grants,
            guard_interventions=score.guard_interventions,
        ),
        leaders=[LeaderRow(tick=tick, name=one.name, term=one.term) for tick, one in score.leaders],
        faults=[_fault_row(scenario, fault) for fault in score.faults],
        late_commands=facts.late_commands,
        commands_total=score.commands_total,
        recording=facts.recording,
        world_restarts=facts.world_restarts,
        state_hash=score.hash.hexdigest() if facts.clock == "lockstep" else None,
        expect=ExpectRow(met=[], missed=[]),
    )
    met, missed = check(scenario.expect, result)
    return msgspec.structs.replace(result, expect=ExpectRow(met=met, missed=missed))


def check(expect: Expect, result: Summary) -> tuple[list[str], list[str]]:
    """What a summary meets and misses, as texts such as "arrived >= 6: 5".

    What does not apply (None) is missed: whoever expects it wants it to.
    """
    met: list[str] = []
    missed: list[str] = []
    for key in expect.__struct_fields__:
        limit = getattr(expect, key)
        if limit is None or key == "mirror_pairs":
            continue
        value = _at(result, key)
        if key == "outcome":
            sign, good = "==", value == limit
        elif key in ("arrived", "blocked") or key.startswith("min_"):
            sign, good = ">=", value is not None and value >= limit
        else:
            sign, good = "<=", value is not None and value <= limit
        (met if good else missed).append(f"{key} {sign} {_text(limit)}: {_text(value)}")
    return met, missed


def _outcome(tally: Tally, mission: bool) -> RobotOutcome:
    """How it ended for one robot; who has nowhere to go is where it should be."""
    if tally.contact:
        return "collided"
    if not tally.alive:
        return "killed" if tally.killed else "failed"
    if not mission or tally.arrival_tick is not None:
        return "arrived"
    return "blocked" if tally.mode == "FAILED" else "timeout"


def _run_outcome(score: Score, outcomes: list[RobotOutcome]) -> Outcome:
    """Collided before failed before timeout; a run that nobody survives has failed too.

    A contact that a fault excuses takes its robot out, as a kill does.
    """
    if any(tally.contact and not tally.excused for tally in score.tallies):
        return "collided"
    if "failed" in outcomes or not any(t.alive and not t.contact for t in score.tallies):
        return "failed"
    if score.faults_failed:
        return "failed"
    cut_short = not any(score.missions) and ended(score) is None
    return "timeout" if cut_short or {"blocked", "timeout"} & set(outcomes) else "succeeded"


def _robot_row(score: Score, facts: Facts, row: int, outcome: RobotOutcome) -> RobotRow:
    tally, dt_s = score.tallies[row], score.scenario.dt_s
    name = score.scenario.robots[row].name
    return RobotRow(
        name=name,
        outcome=outcome,
        arrival_s=None if tally.arrival_tick is None else tally.arrival_tick * dt_s,
        path_m=tally.path_m,
        final_error_m=tally.error_m,
        yields=tally.yields,
        waiting_s=tally.waiting_ticks * dt_s,
        restarts=facts.restarts.get(name, 0),
        reason=tally.reason if outcome == "blocked" else "",
    )


def _formation_row(score: Score) -> FormationRow | None:
    """None for a scenario without a formation and without pairs that should mirror each other."""
    if score.scenario.formation is None and not score.mirror_rows:
        return None
    settling_s = None
    if score.avoid_tick is not None:
        left = score.avoid_tick + 1
        settled = left if score.unsettled_tick is None else max(left, score.unsettled_tick + 1)
        if settled <= score.tick:
            settling_s = (settled - left) * score.scenario.dt_s
    return FormationRow(
        error_m_max=score.error_m_max,
        error_m_final=score.error_m,
        settling_s=settling_s,
        symmetry_m=score.symmetry_m,
    )


def _path_ratio_mean(score: Score, outcomes: list[RobotOutcome]) -> float | None:
    """Path over the straight way, from start through way-points to the goal or the final slot."""
    ratios: list[float] = []
    for setup, tally, outcome in zip(score.scenario.robots, score.tallies, outcomes, strict=True):
        if outcome != "arrived" or tally.target is None:
            continue
        points = [setup.start[:2], *setup.via, tally.target]
        straight_m = sum(
            geometry.length(b[0] - a[0], b[1] - a[1]) for a, b in itertools.pairwise(points)
        )
        if straight_m > 0.0:
            ratios.append(tally.path_m / straight_m)
    return sum(ratios) / len(ratios) if ratios else None


def _fault_row(scenario: Scenario, fault: Fault) -> FaultRow:
    def since_s(tick: int | None) -> float | None:
        return None if tick is None else (tick - fault.tick) * scenario.dt_s

    return FaultRow(
        kind=fault.kind,
        target=scenario.robots[fault.row].name,
        tick=fault.tick,
        over_s=since_s(fault.over_tick),
        detected_s=since_s(fault.detected_tick),
        recovered_s=since_s(fault.recovered_tick),
    )


def _at(result: Summary, path: str) -> float | str | None:
    """Value at a summary path joined by `_`, such as formation_error_m_final."""
    if path == "blocked":
        return [row.outcome for row in result.per_robot].count("blocked")
    part, _, key = path.partition("_")
    inside = getattr(result, part, None)
    value = getattr(inside, key, None) if part in ("formation", "priority") else None
    if part not in ("formation", "priority"):
        value = getattr(result, path)
    assert value is None or isinstance(value, (int, float, str))
    return value


def _text(value: float | str | None) -> str:
    return "none" if value is None else value if isinstance(value, str) else f"{value:.6g}"


def _finite(value: float) -> float | None:
    return value if value < inf else None
