"""Child processes of a measurement: started like those of a run, ended whatever happens.

    with Children() as children:                  from the forkserver of the supervisor
        children.start("world", main, children.child_end, ...)       it has the ticks and a Meter
        children.start("robot1", main, ...)
        windows = children.windows()

World first, as in a run. It learns the pids of all others from the pipe when it begins to measure.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import tempfile
import time
from collections.abc import Callable
from multiprocessing import connection
from multiprocessing.connection import Connection
from multiprocessing.context import ForkServerProcess
from pathlib import Path
from types import TracebackType

import msgspec
import psutil

from swarm import errors
from swarm.run.child import PRELOAD as SUPERVISOR_PRELOAD
from swarm.run.child import without_main

# what those of a measurement are made of, then what the children of any run have loaded
PRELOAD = ["swarm.run.bench.bare", "swarm.run.bench.system", *SUPERVISOR_PRELOAD]
RESULT_S = 90.0  # wall, launch included; then the measurement has failed
END_S = 2.0  # from SIGTERM to SIGKILL
WARM_UP_TICKS = 20  # before the first window; robots meet, caches fill


class Window(msgspec.Struct, frozen=True, array_like=True):
    """What all processes of a barrier spent between two ticks."""

    robots: int
    ticks: int
    cpu_s: float  # user and system, of all processes and threads
    own_s: float  # of it, what the cores needed; zero where there are none
    wall_s: float

    @property
    def cpu_us(self) -> float:
        """All of it, per robot and tick."""
        return 1e6 * self.cpu_s / (self.ticks * self.robots)

    @property
    def own_us(self) -> float:
        """The cores', per robot and tick."""
        return 1e6 * self.own_s / (self.ticks * self.robots)


_decoder = msgspec.msgpack.Decoder(tuple[Window, ...])


class Meter:
    """Windows over ticks and CPU, in the process that has the ticks."""

    def __init__(
        self,
        end: Connection,
        windows: int,
        window_s: float,
        settle_s: float,
        own: Callable[[], float] = lambda: 0.0,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        """`settle_s` is left out before each window, where what `number` decides has changed.

        Args:
            own: CPU seconds that the cores of all processes have needed so far.
        """
        self.number = 0  # of the window at hand, or being settled for
        self._end = end
        self._windows = windows
        self._window_s = window_s
        self._settle_s = settle_s
        self._own = own
        self._now = now
        self._pids: list[int] = []
        self._due_s = 0.0
        self._begin: tuple[int, float, float, float] | None = None
        self._done: list[Window] = []

    def look(self, tick: int) -> bool:
        """Once after every tick; True from the last window's end on, which has been sent then."""
        if tick < WARM_UP_TICKS or self.number == self._windows:
            return self.number == self._windows
        now_s = self._now()
        if not self._pids:
            self._pids = msgspec.msgpack.decode(self._end.recv_bytes(), type=list[int])
            self._due_s = now_s + self._settle_s
        if self._begin is None:
            if now_s >= self._due_s:
                self._begin = (tick, cpu_s(self._pids), self._own(), self._now())
            return False
        begin_tick, begin_cpu_s, begin_own_s, begin_s = self._begin
        if now_s - begin_s < self._window_s:
            return False
        self._done.append(
            Window(
                robots=len(self._pids) - 1,
                ticks=tick - begin_tick,
                cpu_s=cpu_s(self._pids) - begin_cpu_s,
                own_s=self._own() - begin_own_s,
                wall_s=now_s - begin_s,
            )
        )
        self._begin, self._due_s = None, now_s + self._settle_s
        self.number += 1
        if self.number == self._windows:
            self._end.send_bytes(msgspec.msgpack.encode(self._done))
        return self.number == self._windows


def cpu_s(pids: list[int]) -> float:
    """User and system seconds of processes with all their threads, so far.

    From schedstat in nanoseconds where the kernel has it; the other counters come in steps of
    10 ms, too coarse for a hundred processes that sleep most of the time.
    """
    total_ns = 0
    for pid in pids:
        for thread in os.listdir(f"/proc/{pid}/task"):
            with contextlib.suppress(FileNotFoundError, ProcessLookupError):  # it has just ended
                path = Path(f"/proc/{pid}/task/{thread}/schedstat")
                total_ns += int(path.read_bytes().split()[0])
    if total_ns:
        return total_ns * 1e-9
    times = [psutil.Process(pid).cpu_times() for pid in pids]
    return sum(one.user + one.system for one in times)


class Children:
    """Children, and a folder for their logs, that are gone when the `with` is left.

    Should this process be killed, each child notices it by itself (swarm.lifetime).
    """

    def __init__(self) -> None:
        self._context = multiprocessing.get_context("forkserver")
        self._context.set_forkserver_preload(PRELOAD)
        self._children: list[ForkServerProcess] = []
        self._end, self.child_end = self._context.Pipe()
        self._folder = tempfile.TemporaryDirectory(prefix="swarm-bench-")
        self.folder = Path(self._folder.name)

    def __enter__(self) -> Children:
        return self

    def log(self, name: str) -> Path:
        """Where a child is to write what it has to say."""
        return self.folder / f"{name}.log"

    def start(self, name: str, main: Callable[..., object], *arguments: object) -> None:
        """Start one; the Connection of `child_end` may be among the arguments."""
        child = self._context.Process(target=main, args=arguments, name=name)
        self._children.append(child)
        with without_main():
            child.start()

    def windows(self) -> tuple[Window, ...]:
        """What the child with the meter has sent.

        Raises SwarmError when any child ends before, or all of it takes too long.
        """
        pids = [child.pid for child in self._children]
        self._end.send_bytes(msgspec.msgpack.encode(pids))
        sentinels = {child.sentinel: child for child in self._children}
        ready = connection.wait([self._end, *sentinels], RESULT_S)
        if self._end in ready:
            return _decoder.decode(self._end.recv_bytes())
        if not ready:
            raise errors.SwarmError(f"bench: expected figures within {RESULT_S:g} s, got none")
        child = next(child for sentinel, child in sentinels.items() if sentinel in ready)
        child.join()
        raise errors.SwarmError(
            f"bench: expected all processes to last, got {child.name} that ended with exit code "
            f"{child.exitcode}{self._last_words(child.name)}"
        )

    def _last_words(self, name: str) -> str:
        try:
            lines = self.log(name).read_text(errors="replace").split("\n")
        except OSError:
            return ""
        return next((f": {line}" for line in reversed(lines) if line), "")

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        started = [child for child in self._children if child.pid is not None]
        try:
            for child in started:
                child.terminate()
            deadline_s = time.monotonic() + END_S
            for child in started:
                child.join(max(0.0, deadline_s - time.monotonic()))
        finally:
            for child in started:
                if child.exitcode is None:
                    child.kill()
                    child.join()
            self._end.close()
            self.child_end.close()
            self._folder.cleanup()
