"""What a viewer costs the world that is being watched, above all one that has stalled or died.

    world in memory, its live picture served; the viewer a process of its own
    windows take turns:  nobody watches | SIGSTOP in mid-stream | SIGKILL in mid-stream

A picture that waited for its viewer would show in the wall time of a tick.
"""

from __future__ import annotations

import contextlib
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import msgspec
import psutil

from dashboards import live
from swarm import errors, lifetime
from swarm.messages import TickRecord
from swarm.run import lockstep
from swarm.run.bench import figures, rehearsal, system
from swarm.run.bench.figures import Row
from swarm.run.child import free_port

ROBOTS = 20
TURNS = 3
WINDOW_S = 10.0  # so a viewer is stopped for 30 s in all
PACE_S = 0.01  # of a tick, for the batches of the picture: 20 in each
TINY_ROBOTS = 2
TINY_WINDOW_S = 0.2
CONNECT_S = 30.0  # wall; a viewer that has got nothing by then is a failure
CPU_OVER_ALONE_MAX = 1.1  # with a stalled viewer over without any
MEMORY_MB_MAX = 320.0  # the server's limit of 256 MiB, and what it takes to hold it

KINDS = ("alone", "stopped", "killed")


class Window(msgspec.Struct, frozen=True):
    """Means of a tick."""

    cpu_us: float
    wall_us: float


def measure(*, tiny: bool, progress: Callable[[str], None]) -> tuple[Row, ...]:
    """Rows of CPU and wall time with a stopped and with a killed viewer, and of memory."""
    robots, turns = (TINY_ROBOTS, 1) if tiny else (ROBOTS, TURNS)
    with tempfile.TemporaryDirectory() as folder:
        watched = Watched(
            robots, turns, TINY_WINDOW_S if tiny else WINDOW_S, Path(folder), progress
        )
        watched.run()
    found = watched.windows
    rows: list[Row] = []
    for kind in KINDS[1:]:
        for what in ("cpu", "wall"):
            values = [getattr(one, f"{what}_us") for one in found[kind]]
            floors = [getattr(one, f"{what}_us") for one in found["alone"]]
            budget = None if tiny or what == "wall" else CPU_OVER_ALONE_MAX
            name = f"watched: viewer {kind}, {what}"
            rows.append(
                figures.row(
                    name,
                    robots,
                    values,
                    "us",
                    floors=floors,
                    over="alone",
                    budget=budget,
                    bound="ratio <=",
                )
            )
    budget = None if tiny else MEMORY_MB_MAX
    grown = [watched.grown_mb]
    return (
        *rows,
        figures.at_most("watched: memory of the world, more", robots, grown, "MB", budget),
    )


class Watched:
    """One run in memory that is watched in turns, until all windows have passed."""

    def __init__(
        self,
        robots: int,
        turns: int,
        window_s: float,
        folder: Path,
        progress: Callable[[str], None],
    ) -> None:
        self.windows: dict[str, list[Window]] = {kind: [] for kind in KINDS}
        self.grown_mb = 0.0
        self._window_s = window_s
        self._folder = folder
        self._progress = progress
        self._todo = [kind for _ in range(turns) for kind in KINDS]
        self._plan = rehearsal.built_in(system.SCENARIO, robots=robots, settings=[system.LONG])
        self._port = free_port()
        self._ticks = 0
        # By its own clock a busy machine would send smaller batches, which cost more.
        self._picture = live.Live(
            self._plan, (), system.RUN, None, self._port, now=lambda: self._ticks * PACE_S
        )
        self._stop = lifetime.Stop()
        self._begin: tuple[int, float, float] | None = None
        self._viewer: subprocess.Popen[bytes] | None = None

    def run(self) -> None:
        """To the end of the last window."""
        before = _memory_bytes()
        try:
            lockstep.run(self._plan, [self._observe], self._stop)
            self.grown_mb = max(0.0, (_memory_bytes() - before) / 1e6)
        finally:
            self._picture.close()
            self._end()

    def _observe(self, record: TickRecord) -> None:
        self._ticks = record.tick
        self._picture.observe(record)
        if self._begin is None:
            if self._todo:
                self._prepare(self._todo[0])
            self._begin = (record.tick, time.process_time(), time.monotonic())
            return
        tick, cpu_s, begin_s = self._begin
        now_s, ticks = time.monotonic(), record.tick - tick
        if not self._todo or now_s - begin_s < self._window_s:
            return
        window = Window(
            cpu_us=1e6 * (time.process_time() - cpu_s) / ticks,
            wall_us=1e6 * (now_s - begin_s) / ticks,
        )
        self.windows[self._todo.pop(0)].append(window)
        self._begin = None
        self._end()
        if not self._todo:
            self._stop.request("measured")

    def _prepare(self, kind: str) -> None:
        """Nobody, or a viewer that has begun to read and then is stopped or killed."""
        self._progress(f"watched: viewer {kind}")
        if kind == "alone":
            return
        seen = self._folder / "seen.rrd"
        seen.unlink(missing_ok=True)
        command = [str(live.viewer_binary()), "--save", str(seen), live.uri(self._port)]
        self._viewer = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        end_s = time.monotonic() + CONNECT_S
        while not (seen.exists() and seen.stat().st_size):
            if time.monotonic() > end_s or self._viewer.poll() is not None:
                raise errors.SwarmError(f"expected a viewer to read within {CONNECT_S} s, got none")
            time.sleep(0.01)
        self._viewer.send_signal(signal.SIGSTOP if kind == "stopped" else signal.SIGKILL)

    def _end(self) -> None:
        if self._viewer is not None:
            self._viewer.kill()
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._viewer.wait(1.0)
            self._viewer = None


def _memory_bytes() -> int:
    """Memory in use without pages of files, which come and go as the kernel likes."""
    memory = psutil.Process().memory_info()
    return int(memory.rss - memory.shared)
