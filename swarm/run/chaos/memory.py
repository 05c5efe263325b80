"""One run in memory under the eyes of Watch, as often as anybody likes.

Job --lockstep.run--> records --Watch--> Ran
"""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from swarm import lifetime
from swarm.faults import Fault
from swarm.messages import TickRecord
from swarm.run import lockstep
from swarm.run.chaos import schedules
from swarm.run.chaos.schedules import Schedule
from swarm.run.chaos.watch import Findings, Violation, Watch
from swarm.scenario import Scenario

SHOWN = "shown"  # why a run is stopped that has broken what it should break


class Job(msgspec.Struct, frozen=True):
    """What to run."""

    scenario: Scenario  # undisturbed
    length_s: float  # of it
    schedule: Schedule
    twice: bool = False  # and compare


class Ran(msgspec.Struct, frozen=True):
    """What came of it."""

    schedule: Schedule
    findings: Findings
    state_hash: str


def run(job: Job) -> Ran:
    """Run to the end, and again where it should be compared."""
    ran = _run(job)
    if job.twice and (again := _run(job)).state_hash != ran.state_hash:
        text = f"state hash {ran.state_hash}, then {again.state_hash}"
        findings = msgspec.structs.replace(
            ran.findings,
            violations=(*ran.findings.violations, Violation("replay", 0, (), text)),
        )
        return msgspec.structs.replace(ran, findings=findings)
    return ran


def _run(job: Job) -> Ran:
    plan, watch = prepare(job)
    done = lockstep.run(plan, [watch.observe])
    findings = watch.conclude(done.score, done.ended)
    return Ran(job.schedule, findings, done.score.hash.hexdigest())


def prepare(job: Job) -> tuple[Scenario, Watch]:
    """The scenario with its faults, and who watches it."""
    drawn = job.schedule.faults
    plan = schedules.plan(job.scenario, job.length_s, drawn)
    return plan, Watch(plan, schedules.healed_tick(job.scenario, drawn))


def breaks(job: Job, invariant: str) -> Violation | None:
    """The first violation of this invariant in a run, None when it holds.

    The run goes no further than to where it shows.
    """
    plan, watch = prepare(job)
    stop = lifetime.Stop()

    def observe(record: TickRecord) -> None:
        watch.observe(record)
        if first(watch.violations, invariant) is not None:
            stop.request(SHOWN)

    done = lockstep.run(plan, [observe], stop)
    if done.ended == SHOWN:
        return first(watch.violations, invariant)
    return first(watch.conclude(done.score, done.ended).violations, invariant)


def first(violations: Sequence[Violation], invariant: str) -> Violation | None:
    """The first of a kind."""
    return next((one for one in violations if one.invariant == invariant), None)


def changed(job: Job, drawn: Sequence[Fault]) -> Job:
    """The same run with other faults."""
    schedule = Schedule(job.schedule.number, tuple(drawn))
    return msgspec.structs.replace(job, schedule=schedule, twice=False)
