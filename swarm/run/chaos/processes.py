"""One run of real processes under the same eyes, and what only such a run can break.

Job --supervisor--> run folder --recording--> Watch
                         |-- verify, replay --> recording, replay
                         |-- in memory -------> identity
                         '-- processes left --> orphans
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import msgspec
import psutil
import tomli_w

from swarm import errors, metrics, recording, runs
from swarm import scenario as scenarios
from swarm.run import launch, supervisor
from swarm.run import replay as replaying
from swarm.run.chaos import memory
from swarm.run.chaos.memory import Job, Ran
from swarm.run.chaos.watch import Findings, Violation, Watch
from swarm.scenario import Scenario

OURS = "swarm-"  # what processes of a run are called
SETTINGS = {"mcap": True, "rerun": False}  # nobody looks at these recordings in Rerun


def run(job: Job, folder: Path, name: str, note: Callable[[str], None]) -> Ran:
    """Run with real processes in a folder of its own.

    Raises KeyboardInterrupt when a person ends it.
    """
    plan, watch = memory.prepare(job)
    plan = msgspec.structs.replace(
        plan, recording=msgspec.structs.replace(plan.recording, **SETTINGS)
    )
    toml = tomli_w.dumps(scenarios.to_builtins(plan)).encode()
    runs.new_folder(folder, name)
    (folder / runs.SCENARIO).write_bytes(toml)
    order = supervisor.Plan(
        scenario=plan, scenario_toml=toml, name=name, folder=folder, run=runs.new_run_id(folder)
    )
    found: list[Violation] = []
    ended = launch.conduct(order, "zenoh", supervisor.Watcher())
    if ended.interrupted:
        raise KeyboardInterrupt
    tick = ended.summary.ticks
    if ended.problem is not None:
        found.append(Violation("processes", tick, (), ended.problem))
    found += [Violation("orphans", tick, (), text) for text in _left()]
    findings = _watched(plan, folder, watch, found)
    note(f"run {job.schedule.number}: {ended.summary.outcome} after {tick} ticks")
    found += _recorded(folder, tick)
    found += _replayed(folder, tick)
    twin = memory.run(memory.changed(job, job.schedule.faults))
    state_hash = ended.summary.state_hash or ""
    if twin.state_hash != state_hash:
        text = f"state hash {state_hash}, in memory {twin.state_hash}"
        found.append(Violation("identity", tick, (), text))
    findings = msgspec.structs.replace(findings, violations=(*findings.violations, *found))
    return Ran(job.schedule, findings, state_hash)


def _watched(plan: Scenario, folder: Path, watch: Watch, found: list[Violation]) -> Findings:
    """What the eyes see in the recording, as far as it can be read."""
    score = metrics.begin(plan)
    try:
        for record in recording.read(folder / runs.MCAP).ticks:
            watch.observe(record)
            metrics.observe(score, record)
    except errors.RecordingError as error:
        found.append(Violation("recording", score.tick, (), str(error)))
    return watch.conclude(score, metrics.ended(score))


def _recorded(folder: Path, tick: int) -> list[Violation]:
    verdict = recording.verify(folder / runs.MCAP)
    if verdict.ok and verdict.last_tick == tick:
        return []
    return [Violation("recording", tick, (), "; ".join(verdict.text))]


def _replayed(folder: Path, tick: int) -> list[Violation]:
    try:
        found = replaying.replay(folder / runs.MCAP)
    except errors.RecordingError as error:
        return [Violation("replay", tick, (), str(error))]
    if found.ok:
        return []
    return [Violation("replay", tick, (), str(found.difference or found.missing))]


def _left() -> list[str]:
    """Processes of a run that are still there."""
    left = []
    for process in psutil.Process().children(recursive=True):
        try:
            if process.name().startswith(OURS) and process.status() != psutil.STATUS_ZOMBIE:
                left.append(f"{process.name()} ({process.pid}) is still there")
        except psutil.Error:
            continue
    return left
