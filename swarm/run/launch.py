"""Carry out one run, over Zenoh or in memory, and say what it came to."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path
from typing import Literal

import msgspec

from swarm import errors, lifetime, messages, metrics, recording, runs
from swarm import scenario as scenarios
from swarm.run import supervisor


def conduct(
    launch: supervisor.Plan, bus: Literal["zenoh", "memory"], watcher: supervisor.Watcher
) -> tuple[metrics.Summary, bool, str | None]:
    """Summary of a run, whether it was interrupted, and what went wrong with its processes."""
    if bus == "memory":
        return *_run_in_memory(launch, watcher), None
    ending = supervisor.supervise(launch, watcher)
    summary = summary_of(launch.folder, launch.name, bus)
    return summary, ending.interrupted, ending.problem


def check_flags(
    plan: scenarios.Scenario, bus: str, watched: bool, router: str | None, tls: Path | None
) -> None:
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


def check_display(view: str) -> None:
    if view == "native" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise errors.UsageError(
            "--view native: expected a display (DISPLAY or WAYLAND_DISPLAY), got none; "
            "use --view web, or open run.rrd on a machine that has one"
        )


def _run_in_memory(
    launch: supervisor.Plan, watcher: supervisor.Watcher
) -> tuple[metrics.Summary, bool]:
    from swarm.run import lockstep

    name, folder, stop_after_s = launch.name, launch.folder, launch.stop_after_s
    stop = lifetime.Stop()
    interrupted: list[int] = []

    def interrupt(number: int, _: object) -> None:
        interrupted.append(number)
        stop.request("interrupted")

    due_s = time.monotonic() + stop_after_s if stop_after_s is not None else None

    def on_status(status: messages.Status) -> None:
        watcher.status(status)
        if due_s is not None and time.monotonic() >= due_s:
            stop.request("stopped by --stop-after")

    previous = {n: signal.signal(n, interrupt) for n in (signal.SIGINT, signal.SIGTERM)}
    try:
        card = runs.card_of(runs.run_id(folder), name, "memory", folder)
        watcher.started(card, [])
        summary = lockstep.record(
            launch.scenario, name, launch.scenario_toml, folder, stop, on_status
        )
        return summary, bool(interrupted)
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


def summary_of(folder: Path, name: str, bus: str) -> metrics.Summary:
    """Summary the world wrote; when it could not, what its recording still tells."""
    path = folder / runs.SUMMARY
    if path.is_file():
        return msgspec.json.decode(path.read_bytes(), type=metrics.Summary)
    plan = scenarios.decode((folder / runs.SCENARIO).read_bytes(), str(folder / runs.SCENARIO))
    score = metrics.begin(plan)
    kept = 0
    if (folder / runs.MCAP).is_file():
        for record in recording.read(folder / runs.MCAP).ticks:
            if record.tick != score.tick + 1:
                break
            metrics.observe(score, record)
            kept += 1
    facts = metrics.Facts(scenario=name, run=runs.run_id(folder), bus=bus, clock=plan.clock.mode)
    summary = msgspec.structs.replace(metrics.summary(score, facts), outcome="failed")
    path.write_bytes(msgspec.json.format(msgspec.json.encode(summary)))
    return summary
