"""A campaign: many runs with faults drawn from one seed, and what they came to.

order --undisturbed run--> its length --schedules--> runs --failures--> shrunk, shown by a line
"""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path

import msgspec

from swarm import errors, faults, metrics, recording, runs
from swarm.run import lockstep, sharing
from swarm.run.chaos import memory, processes, schedules, shrink
from swarm.run.chaos.memory import Job, Ran
from swarm.run.chaos.watch import Findings, Violation, Watch
from swarm.scenario import Scenario

TWICE_EVERY = 25  # runs; one of them is made twice, and has to come out the same
SHRUNK_MAX = 6  # failures that are made small: the first for each invariant, then the earliest
SHRINK_S = 300.0  # wall, for each of them
CONFIRM_S = 600.0  # wall; a run of the command line takes seconds

GRAVEST = (
    *("crash", "contact", "two-leaders", "falls", "stuck", "no-leader", "waits", "lost"),
    *("replay", "identity", "recording", "processes", "orphans"),
)

Advance = Callable[[int, int, str], None]


class Order(msgspec.Struct, frozen=True, kw_only=True):
    """What to do."""

    scenario: Scenario
    given: str  # name or file of the scenario
    settings: tuple[str, ...] = ()  # --set of it
    runs: int
    seed: int
    bus: str = "memory"
    everything: bool = False
    workers: int | None = None  # processes; 0: all in this one; None: one for each core
    tries_max: int = shrink.TRIES_MAX
    shrunk_max: int = SHRUNK_MAX


class Spread(msgspec.Struct, frozen=True):
    """Percentiles of some seconds."""

    count: int
    p50: float
    p90: float
    p99: float
    max: float


class Failure(msgspec.Struct, frozen=True, kw_only=True):
    """A run that broke something."""

    run: int
    worst: Violation  # what the command shows
    violations: tuple[Violation, ...]
    schedule: tuple[str, ...]
    command: str  # shows it; of the smallest schedule found, where one was looked for
    faults: int  # in that command
    tries: int  # runs that it took to find it
    confirmed: bool | None  # whether that very line was run and shows it; None: it was not run


class Campaign(msgspec.Struct, frozen=True, kw_only=True):
    """The object of `swarm chaos --json`."""

    scenario: str
    bus: str
    seed: int
    runs: int
    ok: bool
    everything: bool
    undisturbed_s: float
    faults: dict[str, int]  # injected, by kind
    violations: dict[str, int]  # by invariant
    failures: tuple[Failure, ...]
    detected_s: Spread | None
    recovered_s: Spread | None
    agreed_s: Spread | None
    converged_s: Spread | None
    min_clearance_obstacle_m: float | None
    min_clearance_robot_m: float | None
    sim_time_s: float
    wall_time_s: float
    folder: str


def undisturbed_s(scenario: Scenario) -> float:
    """How long the scenario takes without faults; raises UsageError when it does not succeed."""
    done = lockstep.run(scenario)
    outcome = metrics.summary(done.score, metrics.Facts(scenario="", run="", bus="memory")).outcome
    if outcome != "succeeded" or done.ended != "arrived":
        raise errors.UsageError(
            f"expected a scenario that ends well when nothing disturbs it, got: {outcome}"
        )
    return schedules.rounded_s(scenario, done.score.tick)


def conduct(order: Order, folder: Path, advance: Advance, note: Callable[[str], None]) -> Campaign:
    """All of it; no process is left when this returns."""
    begun_s = time.monotonic()
    length_s = undisturbed_s(order.scenario)
    jobs = [
        Job(
            order.scenario,
            length_s,
            schedules.draw(
                order.scenario, length_s, order.seed, number, everything=order.everything
            ),
            twice=order.bus == "memory" and number % TWICE_EVERY == 0,
        )
        for number in range(order.runs)
    ]
    lines = [f"{job.schedule.number}: {job.schedule.text}\n" for job in jobs]
    (folder / "schedules.txt").write_text("".join(lines))
    ran: list[Ran] = []
    for one in _ran(order, jobs, folder, note):
        ran.append(one)
        said = "held"
        if one.findings.violations:
            found = worst(one.findings.violations)
            said = f"BROKEN {found.invariant}"
            who = "/".join(found.robots) or "all"
            note(f"run {one.schedule.number}: {said} at tick {found.tick}, {who}: {found.text}")
        advance(len(ran), len(jobs), f"run {one.schedule.number}: {said}")
    ran.sort(key=lambda one: one.schedule.number)
    failures = tuple(_failures(order, length_s, ran, folder, note))
    return _campaign(order, length_s, ran, failures, folder, time.monotonic() - begun_s)


def _ran(
    order: Order, jobs: Sequence[Job], folder: Path, note: Callable[[str], None]
) -> Iterator[Ran]:
    if order.bus == "memory":
        for done in _shared(memory.run, jobs, order.workers):
            yield done.value or Ran(done.job.schedule, _crashed(done.problem), "")
        return
    for job in jobs:
        note(f"run {job.schedule.number}: {job.schedule.text}")
        place = folder / f"run-{job.schedule.number:04d}"
        one = processes.run(job, place, Path(order.given).stem, note)
        if not one.findings.violations:
            shutil.rmtree(place)
        yield one


def _shared(
    work: Callable[[sharing.J], sharing.V], jobs: Sequence[sharing.J], workers: int | None
) -> Iterator[sharing.Done[sharing.J, sharing.V]]:
    """Jobs by processes that share them, or one after the other in this one."""
    if workers == 0:
        for job in jobs:
            yield sharing.Done(job, work(job))
        return
    count = min(workers or os.cpu_count() or 1, max(1, len(jobs)))
    shared = sharing.share(work, jobs, count, "chaos")
    try:
        yield from shared
    finally:
        shared.close()


def _crashed(problem: str) -> Findings:
    return Findings(violations=(Violation("crash", 0, (), problem),))


# --- failures -----------------------------------------------------------------------------------


class _Task(msgspec.Struct, frozen=True):
    """A failure to be made small."""

    job: Job
    invariant: str
    everything: bool
    tries_max: int


def _smallest(task: _Task) -> shrink.Shrunk | None:
    """The smallest schedule that breaks the same; None when memory does not show it."""
    job = task.job
    until_s = time.monotonic() + SHRINK_S

    def fails(drawn: shrink.Drawn) -> bool:
        if time.monotonic() > until_s:
            return False  # the best so far has to do
        try:
            broken = memory.breaks(memory.changed(job, drawn), task.invariant)
        except Exception:  # whatever it is, it is what is looked for, or it is not
            return task.invariant == "crash"
        return broken is not None

    if not fails(job.schedule.faults):
        return None
    return shrink.shrink(
        job.scenario,
        job.schedule.faults,
        fails,
        fair=lambda drawn: task.everything or schedules.is_fair(job.scenario, drawn),
        tries_max=task.tries_max,
    )


def _failures(
    order: Order,
    length_s: float,
    ran: Iterable[Ran],
    folder: Path,
    note: Callable[[str], None],
) -> Iterator[Failure]:
    """Every run that broke something; some of them are made small."""
    broken = [one for one in ran if one.findings.violations]
    tasks = [
        _Task(
            Job(order.scenario, length_s, one.schedule),
            worst(one.findings.violations).invariant,
            order.everything,
            order.tries_max,
        )
        for one in _chosen(broken)[: order.shrunk_max]
    ]
    found: dict[int, shrink.Shrunk | None] = {}
    for done in _shared(_smallest, tasks, order.workers):
        found[done.job.job.schedule.number] = done.value
        note(f"run {done.job.job.schedule.number}: made as small as it gets")
    for one in broken:
        number = one.schedule.number
        small = found.get(number)
        drawn = small.faults if small is not None else one.schedule.faults
        plan = schedules.plan(order.scenario, length_s, drawn)
        command = command_of(order, plan, drawn)
        confirmed = None
        if small is not None and order.workers != 0:
            confirmed = shows(command, plan, drawn, worst(one.findings.violations).invariant)
        yield Failure(
            run=number,
            worst=worst(one.findings.violations),
            violations=one.findings.violations,
            schedule=tuple(faults.text_of(fault) for fault in one.schedule.faults),
            command=command,
            faults=len(drawn),
            tries=0 if small is None else small.tries,
            confirmed=confirmed,
        )


def _chosen(broken: Sequence[Ran]) -> list[Ran]:
    """Runs to be made small, in this order."""
    firsts: dict[str, Ran] = {}
    for one in broken:
        firsts.setdefault(worst(one.findings.violations).invariant, one)
    others = [one for one in broken if one not in firsts.values()]
    return [*firsts.values(), *others]


def worst(violations: Sequence[Violation]) -> Violation:
    """The first of the gravest."""
    return min(violations, key=lambda one: GRAVEST.index(one.invariant))


def command_of(order: Order, plan: Scenario, drawn: shrink.Drawn) -> str:
    """One line that makes this very run."""
    words = ["swarm", "run", order.given, "--duration", f"{plan.duration_s:.9g}"]
    for setting in order.settings:
        words += ["--set", setting]
    for fault in drawn:
        words += ["--fault", faults.text_of(fault)]
    return shlex.join(words)


def shows(command: str, plan: Scenario, drawn: shrink.Drawn, invariant: str) -> bool:
    """Whether a line, run as it is but in memory, breaks the invariant again."""
    with tempfile.TemporaryDirectory(prefix="swarm-") as kept:
        folder = Path(kept) / "run"
        words = [*shlex.split(command)[1:], "--bus", "memory", "--quiet", "--out", str(folder)]
        subprocess.run(
            [sys.executable, "-m", "swarm.run.start", *words],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            timeout=CONFIRM_S,
            check=False,
        )
        if invariant == "crash":
            return not (folder / runs.SUMMARY).exists()
        watch = Watch(plan, schedules.healed_tick(plan, drawn))
        score = metrics.begin(plan)
        try:
            for record in recording.read(folder / runs.MCAP).ticks:
                watch.observe(record)
                metrics.observe(score, record)
        except errors.RecordingError:
            return False
        findings = watch.conclude(score, metrics.ended(score))
        return memory.first(findings.violations, invariant) is not None


# --- figures ------------------------------------------------------------------------------------


def _campaign(
    order: Order,
    length_s: float,
    ran: Sequence[Ran],
    failures: tuple[Failure, ...],
    folder: Path,
    wall_time_s: float,
) -> Campaign:
    found = [one.findings for one in ran]
    kinds = Counter(faults.kind_of(fault) for one in ran for fault in one.schedule.faults)
    broken = Counter(violation.invariant for one in found for violation in one.violations)
    return Campaign(
        scenario=order.given,
        bus=order.bus,
        seed=order.seed,
        runs=len(ran),
        ok=not failures,
        everything=order.everything,
        undisturbed_s=length_s,
        faults=dict(sorted(kinds.items())),
        violations=dict(broken.most_common()),
        failures=failures,
        detected_s=spread([value for one in found for value in one.detected_s]),
        recovered_s=spread([value for one in found for value in one.recovered_s]),
        agreed_s=spread([value for one in found for value in one.agreed_s]),
        converged_s=spread([one.converged_s for one in found if one.converged_s is not None]),
        min_clearance_obstacle_m=_least(one.clearance_obstacle_m for one in found),
        min_clearance_robot_m=_least(one.clearance_robot_m for one in found),
        sim_time_s=sum(one.sim_time_s for one in found),
        wall_time_s=wall_time_s,
        folder=str(folder),
    )


def spread(values: Sequence[float]) -> Spread | None:
    """Percentiles by nearest rank, None of nothing."""
    if not values:
        return None
    ordered = sorted(values)

    def at(share: float) -> float:
        return ordered[max(0, -(-int(share * 1000) * len(ordered) // 1000) - 1)]

    return Spread(len(ordered), at(0.5), at(0.9), at(0.99), ordered[-1])


def _least(values: Iterable[float | None]) -> float | None:
    return min((value for value in values if value is not None), default=None)
