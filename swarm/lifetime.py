"""How a process of the swarm is born, named, asked to stop, and when it ends by itself.

A child of the supervisor lives in a session of its own (Ctrl-C reaches the supervisor alone, which
then asks everyone to stop), carries its name where `pgrep` looks, writes to its own log file, and
is told by the kernel when the supervisor is gone, whatever the bus is doing.
"""

from __future__ import annotations

import contextlib
import ctypes
import io
import os
import select
import signal
import sys
import threading
from collections.abc import Callable
from multiprocessing import forkserver
from pathlib import Path
from typing import Any

import setproctitle

from swarm import log as log_
from swarm.bus import Bus

PR_SET_PDEATHSIG = 1  # prctl(2)
ORPHAN_EXIT_S = 2.0  # an orphan that has not ended by itself after this is ended
ORPHAN_EXIT_CODE = 70  # EX_SOFTWARE


class Stop:
    """A request to stop, made by a signal, a query or a dead supervisor."""

    def __init__(self) -> None:
        self.reason: str | None = None
        self.wake: Callable[[], None] = lambda: None  # ends a blocked receive

    def request(self, reason: str) -> None:
        """Ask; the first reason counts."""
        if self.reason is None:
            self.reason = reason
        self.wake()


def adopt(name: str, log: Path | None, stop: Stop, supervisor_pid: int | None) -> None:
    """Become the process `name`: title, log file; a child of the supervisor if it has one.

    Raises OSError when the log cannot be written.
    """
    setproctitle.setproctitle(f"swarm-{name}")
    if log is not None:
        descriptor = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
        sys.stdout.flush()
        sys.stderr.flush()
        os.dup2(descriptor, 1)
        os.dup2(descriptor, 2)
        os.close(descriptor)
        sys.stdout, sys.stderr = _log(1), _log(2)
        log_.begin(name)
    if supervisor_pid is not None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        os.setsid()
        _leave_forkserver()
        watch = threading.Thread(target=_end_with, args=(supervisor_pid, stop), daemon=True)
        watch.start()


class _Log(io.FileIO):
    """A log on a full disk loses lines; it never stops the process that writes it."""

    def write(self, data: Any) -> int:
        with contextlib.suppress(OSError):
            return super().write(data)
        return len(data)


def _log(descriptor: int) -> io.TextIOWrapper:
    buffer = io.BufferedWriter(_Log(descriptor, "w", closefd=False))
    return io.TextIOWrapper(buffer, errors="backslashreplace", line_buffering=True)


def _leave_forkserver() -> None:
    """See to it that the forkserver ends with the supervisor, and wakes us when it does.

    Every child inherits the end of the pipe that keeps the forkserver alive; only the supervisor
    should hold it. A child that is stopped (SIGSTOP) cannot notice anything by itself: the kernel
    continues it when the forkserver dies.
    """
    server: Any = forkserver._forkserver
    alive = getattr(server, "_forkserver_alive_fd", None)
    if alive is not None:
        os.close(alive)
        server._forkserver_alive_fd = None
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGCONT)


def end_with_parent() -> None:
    """To be called in a child before it becomes another program: it ends when its parent does."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)


def heed_signals(stop: Stop) -> None:
    """From now on end in good order; until then a signal ends the process at once.

    To be called when nothing blocks any more in foreign code that does not look at signals, such
    as the wait for a router.
    """
    signal.signal(signal.SIGTERM, lambda *_: stop.request("asked to stop by SIGTERM"))
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, lambda *_: stop.request("interrupted"))


def _end_with(supervisor_pid: int, stop: Stop) -> None:
    """Wait for the supervisor's death, then see to it that this process ends too."""
    try:
        handle = os.pidfd_open(supervisor_pid)
        select.select([handle], [], [])  # readable once the process is gone
    except ProcessLookupError:
        pass
    stop.request("the supervisor is gone")
    threading.Event().wait(ORPHAN_EXIT_S)
    os._exit(ORPHAN_EXIT_CODE)


class Absence:
    """Notices that the supervisor's token, once seen, has been away for too long."""

    def __init__(self, bus: Bus, timeout_s: float) -> None:
        self._bus = bus
        self._timeout_s = timeout_s
        self._seen = False
        self._since_s: float | None = None

    def lasts(self, now_s: float) -> bool:
        """Whether supervisor and world have both been away for `timeout_s`."""
        roles = {role for role, _ in self._bus.alive()}
        if "supervisor" in roles:
            self._seen = True
        if not self._seen or "supervisor" in roles or "world" in roles:
            self._since_s = None
            return False
        if self._since_s is None:
            self._since_s = now_s
        return now_s - self._since_s >= self._timeout_s
