"""Child processes of a measurement: started like those of a run, ended whatever happens.

with Children() as children:
    children.start(name, main, ...)      from the forkserver of the supervisor
    children.window()                    what the measuring child has sent
"""

from __future__ import annotations

import contextlib
import multiprocessing
import time
from collections.abc import Callable
from multiprocessing.connection import Connection
from multiprocessing.context import ForkServerProcess
from pathlib import Path
from types import TracebackType

import msgspec
import psutil

from swarm import errors
from swarm.run import supervisor

RESULT_S = 60.0  # wall, launch included; then the measurement has failed
END_S = 2.0  # from SIGTERM to SIGKILL


class Window(msgspec.Struct, frozen=True, array_like=True):
    """What all processes of a barrier spent between two ticks."""

    robots: int
    ticks: int
    cpu_s: float  # user and system, of all processes and threads
    wall_s: float

    @property
    def cpu_us(self) -> float:
        """Per robot and tick."""
        return 1e6 * self.cpu_s / (self.ticks * self.robots)


_decoder = msgspec.msgpack.Decoder(Window)


class Meter:
    """Counts ticks and CPU between a begin and an end, in the process that has the ticks."""

    def __init__(self, pids: list[int], window_s: float) -> None:
        self._pids = pids
        self._window_s = window_s
        self._begin: tuple[int, float, float] | None = None

    def look(self, tick: int) -> Window | None:
        """Begin at the first call, None until the window has passed, then what it held."""
        now_s = time.monotonic()
        if self._begin is None:
            self._begin = (tick, cpu_s(self._pids), now_s)
            return None
        begin_tick, begin_cpu_s, begin_s = self._begin
        if now_s - begin_s < self._window_s or tick == begin_tick:
            return None
        spent_s = cpu_s(self._pids) - begin_cpu_s
        return Window(len(self._pids) - 1, tick - begin_tick, spent_s, now_s - begin_s)


def cpu_s(pids: list[int]) -> float:
    """User and system seconds of processes with all their threads, so far.

    From schedstat in nanoseconds where the kernel has it; the other counters come in steps of
    10 ms, too coarse for a hundred processes that sleep most of the time.
    """
    total_ns = 0
    for pid in pids:
        for task in Path(f"/proc/{pid}/task").iterdir():
            with contextlib.suppress(FileNotFoundError, ProcessLookupError):  # a thread that ended
                total_ns += int((task / "schedstat").read_bytes().split()[0])
    if total_ns:
        return total_ns * 1e-9
    times = [psutil.Process(pid).cpu_times() for pid in pids]
    return sum(one.user + one.system for one in times)


class Children:
    """Children that are gone when the `with` is left, also by Ctrl-C.

    Should this process be killed, each child notices it by itself (swarm.lifetime).
    """

    def __init__(self) -> None:
        self._context = multiprocessing.get_context("forkserver")
        self._context.set_forkserver_preload(supervisor.PRELOAD)
        self._children: list[ForkServerProcess] = []
        self._results, self._sender = self._context.Pipe(duplex=False)

    def __enter__(self) -> Children:
        return self

    def start(self, name: str, main: Callable[..., object], *arguments: object) -> int:
        """Start one; gives its pid. A Connection is passed on as it is."""
        child = self._context.Process(target=main, args=arguments, name=name)
        self._children.append(child)
        with supervisor._without_main():
            child.start()
        assert child.pid is not None
        return child.pid

    @property
    def sender(self) -> Connection:
        """End of the pipe that the measuring child sends its Window into."""
        return self._sender

    def window(self) -> Window:
        """What the measuring child, the one started last, has sent.

        Raises SwarmError when it ends without, or takes too long.
        """
        self._sender.close()  # only the child's end is left: its death is an end of file
        measuring = self._children[-1]
        try:
            if not self._results.poll(RESULT_S):
                raise errors.SwarmError(
                    f"bench: expected a figure of {measuring.name} within {RESULT_S:g} s, got none"
                )
            return _decoder.decode(self._results.recv_bytes())
        except EOFError:
            measuring.join(END_S)
            raise errors.SwarmError(
                f"bench: expected a figure of {measuring.name}, got its end with exit code "
                f"{measuring.exitcode}"
            ) from None

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
            self._results.close()
            self._sender.close()


def send(sender: Connection, window: Window) -> None:
    """From the measuring child to the bench."""
    sender.send_bytes(msgspec.msgpack.encode(window))
