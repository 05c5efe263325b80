"""Reading all that a run has left behind, for its report.

RUN --read--> report.Run        recording once for the ticks, once more for its verdict
"""

from __future__ import annotations

import contextlib
import itertools
import shlex
from collections.abc import Iterable, Sequence
from pathlib import Path

import msgspec
import numpy as np

from dashboards import course
from dashboards.charts import Load
from dashboards.report import ProcessRow, Run
from swarm import errors, metrics, recording, runs
from swarm import scenario as scenarios
from swarm.run import sampler
from swarm.run.sampler import Sample
from swarm.run.supervisor import SUPERVISOR
from world import scene

NOT_VERSIONS = ("run", "title", "seed", "segment", "first_tick")  # of the recording's metadata
MEGABYTE = 1e6


def read(run: Path) -> Run:
    """A run given as its folder or its recording.

    Raises:
        UsageError: there is no such run.
        RecordingError: nothing of it can be read.
    """
    path = runs.recording(run)
    folder = path.parent
    source = recording.read(path)
    toml, plan = _scenario(source, folder)
    seen = course.follow(plan, scene.obstacles(plan), source.ticks)
    verdict = recording.verify(path)
    summary, problems = _summary(folder, source, seen)
    if not verdict.ok:
        last_s = float(seen.path.times_s[-1])
        problems.append(
            f"The recording is not whole: it can be read up to {last_s:.2f} s (tick "
            f"{int(seen.ticks[-1])}), and this page tells no more than that. Mend it with: "
            f"swarm verify {run} --repair"
        )
    samples = sampler.read(folder)
    bus = " --bus memory" if summary.bus == "memory" else ""
    return Run(
        name=folder.resolve().name,
        seen=seen,
        summary=summary,
        verdict=verdict,
        versions={name: text for name, text in source.metadata.items() if name not in NOT_VERSIONS},
        scenario_toml=toml.decode(errors="replace"),
        command=f"swarm run {shlex.quote(str(path.with_name(runs.SCENARIO)))}{bus}",
        processes=process_rows(samples),
        loads=loads(samples),
        problems=tuple(problems),
    )


def _scenario(source: recording.Recording, folder: Path) -> tuple[bytes, scenarios.Scenario]:
    """The scenario that was run: the recording's, or the folder's when that is lost."""
    toml, where = source.scenario_toml, f"{source.path}: {recording.SCENARIO_NAME}"
    if not toml:
        where = str(folder / runs.SCENARIO)
        try:
            toml = (folder / runs.SCENARIO).read_bytes()
        except OSError as error:
            raise errors.RecordingError(
                f"{source.path}: expected the run's scenario in it or beside it, got none"
            ) from error
    try:
        return toml, scenarios.decode(toml, where)
    except errors.ScenarioError as error:
        raise errors.RecordingError(f"{error}; was it made by another version?") from error


def _summary(
    folder: Path, source: recording.Recording, seen: course.Course
) -> tuple[metrics.Summary, list[str]]:
    """The summary as the run wrote it, or else as the recording tells it; and what is odd."""
    score = seen.score
    with contextlib.suppress(OSError, msgspec.DecodeError, ValueError):
        written = msgspec.json.decode((folder / runs.SUMMARY).read_bytes(), type=metrics.Summary)
        if written.ticks != score.tick:
            return written, [
                f"The summary is of {written.ticks} ticks, the recording of {score.tick}: what is "
                "drawn and timed here is of the recording, the outcome is the summary's."
            ]
        told = score.hash.hexdigest()
        if written.state_hash not in (None, told):
            return written, [
                "The recording does not give the state hash of the summary: one of them is not of "
                "this run, or has been changed."
            ]
        return written, []
    facts = metrics.Facts(
        scenario=folder.resolve().name,
        run=source.metadata.get("run", folder.resolve().name),
        bus="unknown",
        clock=score.scenario.clock.mode,
        restarts=_restarts(seen),
    )
    told_summary = metrics.summary(score, facts)
    if metrics.ended(score) is None:  # it was cut off, whatever it had come to
        told_summary = msgspec.structs.replace(told_summary, outcome="failed")
    return told_summary, [
        "The run has left no summary, as one that is killed: the figures are worked out from what "
        "is recorded."
    ]


def _restarts(seen: course.Course) -> dict[str, int]:
    count: dict[str, int] = {}
    for event in seen.events:
        if event.kind == "robot-started" and event.incarnation > 0 and event.robot is not None:
            count[event.robot] = count.get(event.robot, 0) + 1
    return count


# --- processes ----------------------------------------------------------------------------------


def process_rows(samples: Sequence[Sample]) -> tuple[ProcessRow, ...]:
    """What each used, all processes of a name taken together; in the order of their start."""
    return tuple(
        _process_row(name, [one for one in samples if one.name == name])
        for name in dict.fromkeys(one.name for one in samples)
    )


def _process_row(name: str, samples: Sequence[Sample]) -> ProcessRow:
    lives = [
        [one for one in samples if one.pid == pid] for pid in dict.fromkeys(s.pid for s in samples)
    ]
    shares = [share for life in lives for _, share in _shares(life)]
    spent_s = sum(life[-1].cpu_s - life[0].cpu_s for life in lives)
    lived_s = sum(life[-1].wall_s - life[0].wall_s for life in lives)
    return ProcessRow(
        name=name,
        processes=len(lives),
        cpu_s=sum(life[-1].cpu_s for life in lives),
        cpu_mean=spent_s / lived_s if lived_s else 0.0,
        cpu_most=max(shares, default=0.0),
        memory_mb_max=max(one.memory_bytes for one in samples) / MEGABYTE,
    )


def _shares(life: Sequence[Sample]) -> Iterable[tuple[float, float]]:
    """(time, share of a core since the sample before) of one process."""
    for before, after in itertools.pairwise(life):
        span_s = after.wall_s - before.wall_s
        if span_s > 0.0:
            yield after.wall_s, (after.cpu_s - before.cpu_s) / span_s


def loads(samples: Sequence[Sample]) -> tuple[Load, ...]:
    """World, supervisor, all robots together, and the busiest or largest of them, over time."""
    times = sorted({one.wall_s for one in samples})
    if len(times) < 2:
        return ()
    index = {time_s: number for number, time_s in enumerate(times)}
    robots = [
        name
        for name in dict.fromkeys(one.name for one in samples)
        if name not in ("world", SUPERVISOR)
    ]
    cpu: dict[str, np.ndarray] = {}
    memory: dict[str, np.ndarray] = {}
    for name in ("world", SUPERVISOR, *robots):
        cpu[name], memory[name] = np.full((2, len(times)), np.nan)
        own = [one for one in samples if one.name == name]
        for pid in dict.fromkeys(one.pid for one in own):
            for time_s, share in _shares([one for one in own if one.pid == pid]):
                cpu[name][index[time_s]] = share
        for one in own:
            memory[name][index[one.wall_s]] = one.memory_bytes / MEGABYTE
    result = [
        Load(name, np.array(times), cpu[name], memory[name]) for name in ("world", SUPERVISOR)
    ]
    if robots:
        shares = np.nan_to_num(np.array([cpu[name] for name in robots]))
        sizes = np.nan_to_num(np.array([memory[name] for name in robots]))
        lead = np.full(len(times), np.nan)
        result.append(Load("all robots", np.array(times), shares.sum(axis=0), lead))
        result.append(Load("largest robot", np.array(times), shares.max(axis=0), sizes.max(axis=0)))
    return tuple(result)
