"""Processes of the swarm as the supervisor holds them: started, signalled, seen to be gone.

Every child is started from a forkserver that has the modules loaded and has never opened a
session. A child is held by a pidfd: a signal can never reach another process that got its number.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import select
import signal
import socket
import sys
import types
from collections.abc import Callable, Iterator
from multiprocessing.context import ForkServerProcess
from pathlib import Path

import msgspec
import psutil

from swarm import log

# the first brings numpy, zenoh, msgspec, agents and world, the last freezes what is there
PRELOAD = ["swarm.run.supervisor", "swarm.run.preload"]
CODE_S = 1.0  # after a death the forkserver tells how, within microseconds; then nobody knows
CODE_UNKNOWN = 255  # the forkserver was killed


class Child:
    """One live or dead process; `close` it once it is gone."""

    def __init__(
        self, name: str, main: Callable[..., int], arguments: msgspec.Struct, log_path: Path
    ) -> None:
        """Start it; raises OSError when that cannot be. Only the main thread may."""
        self.name = name
        self.log = log_path
        self._log_begins = log_path.stat().st_size if log_path.exists() else 0
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload(PRELOAD)
        with without_main():
            self._process: ForkServerProcess = context.Process(
                target=_exit_with, args=(main, arguments), name=name
            )
            self._process.start()
        self.pid = self._process.pid or 0
        self.handle: int | None = None  # a pidfd: readable once the process is gone
        with contextlib.suppress(ProcessLookupError):  # it has come and gone
            self.handle = os.pidfd_open(self.pid)
        self._code: int | None = None

    def exit_code(self) -> int | None:
        """How it ended, None while it lives."""
        if self._code is None and (
            self.handle is None or select.select([self.handle], [], [], 0.0)[0]
        ):
            self._process.join(CODE_S)
            code = self._process.exitcode
            self._code = CODE_UNKNOWN if code is None else code
        return self._code

    def send(self, number: signal.Signals) -> None:
        """Send a signal; nothing happens when it is gone."""
        if self.handle is not None:
            with contextlib.suppress(ProcessLookupError):
                signal.pidfd_send_signal(self.handle, number)

    def is_stopped(self) -> bool:
        """Whether SIGSTOP holds it."""
        try:
            return (
                self.exit_code() is None
                and psutil.Process(self.pid).status() == psutil.STATUS_STOPPED
            )
        except psutil.Error:
            return False

    def last_words(self) -> str:
        """How it ended, and what its log says of that."""
        code = self.exit_code()
        how = (
            "still runs"
            if code is None
            else f"killed by {_signal_name(-code)}"
            if code < 0
            else f"ended with exit code {code}"
        )
        # a killed one never saw it coming
        line = "" if code == -signal.SIGKILL else log.last_words(self.log, self._log_begins)
        return f"{how}: {line}" if line else how

    def close(self) -> None:
        """Let go of what the kernel and multiprocessing keep of one that is gone."""
        if self.handle is not None:
            os.close(self.handle)
            self.handle = None
        with contextlib.suppress(ValueError):  # it lives after all
            self._process.close()


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


def _exit_with(main: Callable[[msgspec.Struct], int], arguments: msgspec.Struct) -> None:
    try:
        code = main(arguments)
    except Exception as error:
        log.crash(error)
        code = 1
    sys.exit(code)


@contextlib.contextmanager
def without_main() -> Iterator[None]:
    """Hide `__main__`: multiprocessing would import the command line again in every child."""
    main = sys.modules["__main__"]
    sys.modules["__main__"] = types.ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


def free_port() -> int:
    """A port of loopback that nobody uses at this moment."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port
