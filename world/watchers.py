r"""All that is told of each tick; what fails of it is said once, and the run goes on.

TickRecord --> recording.Writer --> run.mcap
\-> live.Live         --> run.rrd, viewers that connect
\-> bridge.Bridge     --> Foxglove clients that connect
"""

from __future__ import annotations

import importlib.metadata
from collections.abc import Callable
from pathlib import Path

import msgspec

from dashboards import bridge, foxglove, live
from swarm import log, metrics, recording, runs
from swarm.bus import Bus
from swarm.messages import EVENT, Event, TickRecord
from swarm.scenario import Scenario
from world import scene
from world.checkpoint import FILE_NAME, HANDLING_NAME, KILLS_NAME, Handling

RECORDED_VERSIONS = ("msam-swarm", "eclipse-zenoh", "msgspec", "numpy", "mcap", "rerun-sdk")

Observer = Callable[[TickRecord], None]


class Watchers:
    """Everyone who is told of the ticks of one run."""

    def __init__(self, bus: Bus, plan: Scenario, folder: Path) -> None:
        self._bus = bus
        self._plan = plan
        self._folder = folder
        self._writer: recording.Writer | None = None
        self._viewer: live.Live | None = None
        self._observers: list[Observer] = []
        self._closers: list[Callable[[], object]] = []
        self._said: set[str] = set()
        self._last: TickRecord | None = None

    def open(
        self,
        scenario_toml: bytes,
        serve_port: int | None,
        foxglove_port: int | None,
        *,
        segment: int = 0,
        first_tick: int = 0,
    ) -> None:
        """Open what the scenario and the command line ask for; may raise RecordingError."""
        plan, run, folder = self._plan, self._bus.run, self._folder
        obstacles = scene.obstacles(plan)
        if plan.recording.mcap:
            self._writer = recording.Writer(
                folder / runs.MCAP,
                scenario_toml,
                _metadata(run, plan),
                foxglove.channels(plan, obstacles),
                flush_ticks=plan.recording.flush_ticks,
                flush_s=plan.recording.flush_s,
                segment=segment,
                first_tick=first_tick,
            )
            self._add(self._writer.write, self._writer.close)
        if plan.recording.rerun or serve_port is not None:
            rrd = (
                recording.segment_path(folder / runs.RRD, segment) if plan.recording.rerun else None
            )
            self._viewer = live.Live(plan, obstacles, run, rrd, serve_port)
            self._add(self._viewer.observe, self._viewer.close)
        if foxglove_port is not None:
            served = bridge.Bridge(run, foxglove.channels(plan, obstacles), foxglove_port)
            self._add(served.observe, served.close)

    def _add(self, observe: Observer, close: Callable[[], object]) -> None:
        self._observers.append(observe)
        self._closers.append(close)

    def observe(self, record: TickRecord) -> None:
        """Tell all of one tick."""
        self._last = record
        for observe in self._observers:
            observe(record)
        self._say_failures()

    def close(self) -> None:
        """Complete all files."""
        for close in self._closers:
            close()
        self._say_failures()
        if self._writer is not None and self._writer.lost_ticks:
            lost = ", ".join(map(str, self._writer.lost_ticks))
            self._say(f"{self._writer.path}: lost ticks {lost}")

    def has(self, record: TickRecord) -> None:
        """Count a tick that an earlier segment holds, and show it."""
        self._last = record
        if self._writer is not None:
            self._writer.has(record)
        if self._viewer is not None:
            self._viewer.has(record)

    def save(self, checkpoint: bytes) -> None:
        """Keep a checkpoint, unless the ticks before it are not safe yet: then the one before."""
        if self._writer is None or not self._writer.flush():
            return
        problem = runs.write_whole(self._folder / FILE_NAME, checkpoint)
        if problem is not None:
            self._say(f"checkpoint: {problem}")

    def note_kill(self, fault: str) -> None:
        """Keep that a fault is about to kill this world."""
        try:
            with (self._folder / KILLS_NAME).open("a") as file:
                file.write(f"{fault}\n")
        except OSError as error:  # then the next world dies of it too; the supervisor gives up
            self._say(f"{KILLS_NAME}: {error.strerror}")

    def note_handling(self, handling: Handling) -> None:
        """Keep how people have set the run going, and show whom they have selected."""
        if self._viewer is not None:
            self._viewer.selected = handling.selected
        problem = runs.write_whole(self._folder / HANDLING_NAME, msgspec.json.encode(handling))
        if problem is not None:
            self._say(f"{HANDLING_NAME}: {problem}")

    def disk_full(self, full: bool) -> None:
        """From now on the recorder's disk takes nothing, or takes all again."""
        if self._writer is not None:
            self._writer.disk_full = full

    def kept(self) -> metrics.RecordingRow | None:
        """Account of the recording, None when there is none."""
        if self._writer is None:
            return None
        count = self._writer.counts.total
        return metrics.RecordingRow(expected=count.expected, written=count.written, lost=count.lost)

    def _say_failures(self) -> None:
        for source in (self._writer, self._viewer):
            if source is not None and source.failure is not None:
                self._say(source.failure)

    def _say(self, text: str) -> None:
        if text in self._said:
            return
        self._said.add(text)
        tick, stamp_ns = (self._last.tick, self._last.stamp_ns) if self._last else (0, 0)
        log.say("world", f"recording: {text}", level="error", tick=tick)
        self._bus.publish(EVENT, Event(tick, stamp_ns, "recording", None, text))


def _metadata(run: str, plan: Scenario) -> dict[str, str]:
    versions = {name: importlib.metadata.version(name) for name in RECORDED_VERSIONS}
    return {"run": run, "title": plan.title, "seed": str(plan.seed), **versions}
