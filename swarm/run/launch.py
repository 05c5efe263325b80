"""Carry out one run, over Zenoh or in memory, and say what it came to."""

from __future__ import annotations

import contextlib
import math
import os
import re
import signal
import time
from pathlib import Path
from typing import Literal

import msgspec

from swarm import errors, lifetime, messages, metrics, recording, runs
from swarm import scenario as scenarios
from swarm.run import journal, supervisor

ENDPOINT = re.compile(r"^[a-z0-9-]+/[^\s/][^\s]*:[0-9]{1,5}\Z")


class Conducted(msgspec.Struct, frozen=True):
    """How a run ended."""

    summary: metrics.Summary
    interrupted: bool = False
    overtime: bool = False  # ended by --stop-after
    problem: str | None = None  # what went wrong with its processes


def conduct(
    order: supervisor.Plan, bus: Literal["zenoh", "memory"], watcher: supervisor.Watcher
) -> Conducted:
    """Carry out a run to its end."""
    watcher = journal.Journal(watcher, order.folder)
    if bus == "memory":
        return _run_in_memory(order, watcher)
    ending = supervisor.supervise(order, watcher)
    problem = ending.problem
    path = order.folder / runs.SUMMARY
    if problem is None and not path.exists():
        problem = f"{path}: expected the world's summary, got none: is the disk full?"
    summary = summary_of(order.folder, order.name, order.run, ending.world_restarts)
    return Conducted(summary, ending.interrupted, ending.overtime, problem)


def check_flags(
    plan: scenarios.Scenario,
    *,
    bus: str,
    watched: bool,
    router: str | None,
    tls: Path | None,
    stop_after_s: float | None,
) -> None:
    """Raise UsageError for flags that cannot be honoured, before anything starts."""
    if stop_after_s is not None and not 0.0 < stop_after_s < math.inf:
        raise errors.UsageError(f"--stop-after: expected seconds > 0, got {stop_after_s:g}")
    if router is not None and ENDPOINT.match(router) is None:
        raise errors.UsageError(
            f"--router: expected an endpoint such as tcp/127.0.0.1:7447, got '{router}'"
        )
    if bus == "memory":
        if plan.clock.mode == "realtime":
            raise errors.UsageError(
                "--bus memory: expected --clock lockstep, got realtime; one process has no "
                "lateness to show, use --rate 1 to pace it"
            )
        if watched or router is not None or tls is not None:
            raise errors.UsageError(
                "--bus memory: expected no --view, --foxglove, --router or --tls: "
                "nothing leaves the process"
            )
    if tls is not None:
        names = ["world", "supervisor", *(robot.name for robot in plan.robots)]
        wanted = ["ca.pem", *(f"{name}{end}" for name in names for end in (".pem", ".key"))]
        missing = [name for name in wanted if not (tls / name).is_file()]
        if missing:
            raise errors.UsageError(
                f"--tls {tls}: expected ca.pem and NAME.pem, NAME.key for every process, "
                f"got no {', '.join(missing[:4])}{' ...' if len(missing) > 4 else ''}"
            )


def has_display() -> bool:
    """Whether a window can be opened."""
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def check_display(view: str) -> None:
    """Raise UsageError when a window is asked for where there is no screen."""
    if view == "native" and not has_display():
        raise errors.UsageError(
            "--view native: expected a display (DISPLAY or WAYLAND_DISPLAY), got none; "
            "use --view web, or open run.rrd on a machine that has one"
        )


def _run_in_memory(order: supervisor.Plan, watcher: supervisor.Watcher) -> Conducted:
    from swarm.run import lockstep

    stop = lifetime.Stop()
    interrupted: list[int] = []
    overtime: list[str] = []

    def interrupt(number: int, _: object) -> None:
        interrupted.append(number)
        stop.request("interrupted")

    due_s = math.inf if order.stop_after_s is None else time.monotonic() + order.stop_after_s

    def on_status(status: messages.Status) -> None:
        watcher.status(status)
        if time.monotonic() >= due_s and status.state != "ended":
            overtime.append("stopped by --stop-after")
            stop.request(overtime[0])

    previous = {n: signal.signal(n, interrupt) for n in (signal.SIGINT, signal.SIGTERM)}
    try:
        watcher.started(runs.card_of(order.run, order.name, "memory", order.folder), [])
        summary = lockstep.record(
            order.scenario,
            order.name,
            order.run,
            order.scenario_toml,
            order.folder,
            stop,
            on_status,
        )
        return Conducted(summary, bool(interrupted), bool(overtime))
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


def summary_of(folder: Path, name: str, run: str, world_restarts: int = 0) -> metrics.Summary:
    """Summary the world wrote; when it could not, what its recording still tells."""
    path = folder / runs.SUMMARY
    with contextlib.suppress(OSError, msgspec.DecodeError):
        return msgspec.json.decode(path.read_bytes(), type=metrics.Summary)
    plan = scenarios.decode((folder / runs.SCENARIO).read_bytes(), str(folder / runs.SCENARIO))
    score = metrics.begin(plan)
    with contextlib.suppress(errors.RecordingError):  # nothing of it can be read
        for record in recording.read(folder / runs.MCAP).ticks:
            if record.tick != score.tick + 1:
                break
            metrics.observe(score, record)
    facts = metrics.Facts(
        scenario=name,
        run=run,
        bus="zenoh",
        clock=plan.clock.mode,
        world_restarts=world_restarts,
    )
    summary = msgspec.structs.replace(metrics.summary(score, facts), outcome="failed")
    runs.write_whole(path, msgspec.json.format(msgspec.json.encode(summary)))
    return summary
