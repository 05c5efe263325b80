"""The world as a process: router inside, recording and viewer inline, one conducted run."""

from __future__ import annotations

import importlib.metadata
import sys
from collections.abc import Callable
from pathlib import Path

import msgspec

from swarm import errors, lifetime, metrics, recording, runs, scenario, zenoh_bus
from swarm.bus import Bus
from swarm.messages import EVENT, Event, Status, TickRecord
from world import conductor, scene

PORT_TAKEN = 75  # exit code, EX_TEMPFAIL: the supervisor tries another port
RECORDED_VERSIONS = ("msam-swarm", "eclipse-zenoh", "msgspec", "numpy", "mcap", "rerun-sdk")


class Arguments(msgspec.Struct, frozen=True, kw_only=True):
    """What a world process needs to be told."""

    run: str
    name: str  # of the scenario
    scenario_toml: bytes  # resolved
    endpoint: str
    folder: Path
    external_router: bool = False
    tls: Path | None = None
    log: Path | None = None
    serve_port: int | None = None  # of the live Rerun server
    supervisor_pid: int | None = None


def main(arguments: Arguments) -> int:
    """Run one world; its summary lies in the folder afterwards."""
    stop = lifetime.Stop()
    lifetime.adopt("world", arguments.log, stop, arguments.supervisor_pid)
    try:
        bus = _open_bus(arguments)
    except errors.BusError as error:
        print(f"swarm-world: {error}", file=sys.stderr, flush=True)
        return PORT_TAKEN if "in use" in str(error) else error.exit_code
    lifetime.heed_signals(stop)
    try:
        summary = record_run(
            bus,
            arguments.name,
            arguments.scenario_toml,
            arguments.folder,
            stop,
            bus_name="zenoh",
            serve_port=arguments.serve_port,
            supervised=arguments.supervisor_pid is not None,
        )
    except errors.SwarmError as error:
        print(f"swarm-world: {error}", file=sys.stderr, flush=True)
        return error.exit_code
    finally:
        bus.close()
    print(f"swarm-world: {summary.outcome}: {stop.reason or 'ended'}", file=sys.stderr, flush=True)
    return 0


def _open_bus(arguments: Arguments) -> Bus:
    run, endpoint, tls = arguments.run, arguments.endpoint, arguments.tls
    if arguments.external_router:
        return zenoh_bus.open_client(run, endpoint, name="world", tls=tls)
    return zenoh_bus.open_router(run, endpoint, tls=tls)


def record_run(
    bus: Bus,
    name: str,
    scenario_toml: bytes,
    folder: Path,
    stop: lifetime.Stop,
    *,
    bus_name: str,
    serve_port: int | None = None,
    supervised: bool = False,
    on_status: Callable[[Status], None] = lambda status: None,
) -> metrics.Summary:
    """Conduct a run, record it in `folder`, write its summary there and return it.

    A recording that fails never stops the run; the summary then says what was lost.
    Raises RecordingError when the recording cannot even be opened.
    """
    plan = scenario.decode(scenario_toml, str(folder / runs.SCENARIO))
    watchers = _open_watchers(bus.run, plan, scenario_toml, folder, serve_port)
    failures = _Failures(bus, plan, watchers.writer)
    observers = [*watchers.observers, failures.look]
    try:
        run = conductor.conduct(
            bus, plan, observers, stop, supervised=supervised, on_status=on_status
        )
    finally:
        watchers.close()
    kept = None
    if watchers.writer is not None:
        count = watchers.writer.counts.total
        kept = metrics.RecordingRow(expected=count.expected, written=count.written, lost=count.lost)
    facts = metrics.Facts(
        scenario=name,
        run=bus.run,
        bus=bus_name,
        clock=plan.clock.mode,
        wall_time_s=run.wall_time_s,
        late_commands=run.late_commands,
        recording=kept,
    )
    summary = metrics.summary(run.score, facts)
    try:
        (folder / runs.SUMMARY).write_bytes(msgspec.json.format(msgspec.json.encode(summary)))
    except OSError as error:
        print(f"swarm-world: {runs.SUMMARY}: {error.strerror}", file=sys.stderr, flush=True)
    return summary


class _Watchers(msgspec.Struct):
    writer: recording.Writer | None
    observers: list[conductor.Observer]
    closers: list[Callable[[], object]]

    def close(self) -> None:
        for close in self.closers:
            close()


def _open_watchers(
    run: str,
    plan: scenario.Scenario,
    scenario_toml: bytes,
    folder: Path,
    serve_port: int | None,
) -> _Watchers:
    watchers = _Watchers(None, [], [])
    obstacles = scene.obstacles(plan)
    if plan.recording.mcap:
        # the viewers' libraries take half a second to import: only who records pays
        from dashboards import foxglove

        watchers.writer = recording.Writer(
            folder / runs.MCAP,
            scenario_toml,
            _metadata(run, plan),
            foxglove.channels(plan, obstacles),
            flush_ticks=plan.recording.flush_ticks,
            flush_s=plan.recording.flush_s,
        )
        watchers.observers.append(watchers.writer.write)
        watchers.closers.append(watchers.writer.close)
    if plan.recording.rerun or serve_port is not None:
        from dashboards import live

        rrd = folder / runs.RRD if plan.recording.rerun else None
        viewer = live.Live(plan, obstacles, run, rrd, serve_port)
        watchers.observers.append(viewer.observe)
        watchers.closers.append(viewer.close)
    return watchers


def _metadata(run: str, plan: scenario.Scenario) -> dict[str, str]:
    versions = {name: importlib.metadata.version(name) for name in RECORDED_VERSIONS}
    return {"run": run, "title": plan.title, "seed": str(plan.seed), **versions}


class _Failures:
    """Says once that the recording fails; the run goes on."""

    def __init__(self, bus: Bus, plan: scenario.Scenario, writer: recording.Writer | None) -> None:
        self._bus = bus
        self._plan = plan
        self._writer = writer
        self._said = False

    def look(self, record: TickRecord) -> None:
        """After each tick."""
        if self._said or self._writer is None or self._writer.failure is None:
            return
        self._said = True
        text = self._writer.failure
        print(f"swarm-world: recording: {text}", file=sys.stderr, flush=True)
        self._bus.publish(EVENT, Event(record.tick, record.stamp_ns, "recording", None, text))
