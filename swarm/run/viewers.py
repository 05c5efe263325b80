"""Where a run can be watched: live, its ports and viewer; finished, its pictures in a viewer."""

from __future__ import annotations

import contextlib
import socket
import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import msgspec

from swarm import errors, lifetime, recording, runs
from swarm.run.child import free_port

if TYPE_CHECKING:
    from dashboards import doorway

View = Literal["none", "web", "native"]
END_S = 1.0
SERVE_S = 30.0  # until the web viewer must be up
POLL_S = 0.05
SERVER_MIB_MIN = 1024  # of a server's memory; what does not fit is forgotten


class Ports(msgspec.Struct, frozen=True):
    """Ports of the live pictures, None where there is none; a world started again reuses them."""

    rerun: int | None
    foxglove: int | None


def free_ports(view: str, foxglove: bool) -> Ports:
    """Ports for what is to be seen."""
    return Ports(
        rerun=None if view == "none" else free_port(), foxglove=free_port() if foxglove else None
    )


class Viewer:
    """The viewer of a run, if one was asked for."""

    def __init__(self, view: str, ports: Ports, log: Path, note: Callable[[str], None]) -> None:
        """Start it; `addresses` are then those of all live pictures."""
        self._view = view
        self._process: subprocess.Popen[bytes] | None = None
        self._command: list[str] = []
        self._log = log
        self._again: list[subprocess.Popen[bytes]] = []
        self._doorway: doorway.Doorway | None = None
        self.addresses = (
            [] if ports.foxglove is None else [f"Foxglove: ws://127.0.0.1:{ports.foxglove}"]
        )
        if ports.rerun is None:
            return
        from dashboards import live  # rerun takes half a second to import: only who views pays

        uri = live.uri(ports.rerun)
        if view == "native":
            command, shown = live.native_command(free_port(), uri), uri
        else:
            from dashboards.doorway import Doorway

            web_port = free_port()
            command = live.web_command(web_port, uri)
            self._doorway = Doorway()
            shown = self._doorway.address(web_port, ports.rerun)
        self._command = command
        try:
            self._process = self._start()
        except OSError as error:
            note(f"viewer: expected to start {command[0]}, got: {error.strerror}")
            return
        self.addresses.append(f"Rerun: {shown}")

    def _start(self) -> subprocess.Popen[bytes]:
        with self._log.open("ab") as out:
            return subprocess.Popen(
                self._command,
                stdout=out,
                stderr=out,
                stdin=subprocess.DEVNULL,
                start_new_session=True,
            )

    def world_is_back(self) -> None:
        """Show a world that was started again to a native viewer; the page sees it by itself."""
        if self._view == "native" and self._process is not None and self._process.poll() is None:
            with contextlib.suppress(OSError):  # the run goes on, so the picture may stand still
                self._again.append(self._start())

    def close(self) -> None:
        """End the server of the web viewer; a native one belongs to the person who looks at it."""
        if self._doorway is not None:
            self._doorway.close()
        for process in [*self._again, *([self._process] if self._view == "web" else [])]:
            if process is not None:
                _end(process)


def _end(process: subprocess.Popen[bytes]) -> None:
    process.terminate()
    try:
        process.wait(END_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


# --- finished runs ------------------------------------------------------------------------------


def pictures(run: Path) -> list[Path]:
    """Files that show a RUN given as folder or file, in order; raises UsageError.

    Those for Rerun, one of each world that ran; else those of the MCAP, which Rerun draws too.
    """
    if not run.exists():
        raise errors.UsageError(f"{run}: expected a run's folder or its run.rrd, got nothing there")
    firsts = [run / runs.RRD, run / runs.MCAP] if run.is_dir() else [run]
    for first in firsts:
        found = [path for path in recording.segment_paths(first) if path.is_file()]
        if found and all(path.suffix in (".rrd", ".mcap") for path in found):
            return found
    raise errors.UsageError(
        f"{run}: expected {runs.RRD} or {runs.MCAP}, got "
        f"{'a folder without them' if run.is_dir() else 'another kind of file'}"
    )


def open_native(paths: Sequence[Path]) -> None:
    """Show files in a window, and wait until it is closed; raises SwarmError when it fails."""
    from dashboards import live

    command = [str(live.viewer_binary()), "--bind", live.HOST, "--port", "auto"]
    with _Shown([*command, *map(str, paths)]) as shown:
        shown.wait()


def serve_web(paths: Sequence[Path], say: Callable[[str], None]) -> None:
    """Serve files to browsers on loopback until interrupted; raises SwarmError when it fails."""
    from dashboards import live

    web_port, port = free_port(), free_port()
    size = sum(path.stat().st_size for path in paths)
    command = [
        *(str(live.viewer_binary()), "--bind", live.HOST, "--port", str(port)),
        *("--serve-web", "--web-viewer-port", str(web_port)),
        *("--server-memory-limit", f"{max(SERVER_MIB_MIN, 2 * size >> 20)}MiB"),
    ]
    with _Shown([*command, *map(str, paths)]) as shown:
        shown.wait_for(live.HOST, web_port)
        say(f"watch in Rerun: {live.web_address(web_port, live.uri(port))}  (Ctrl-C ends it)")
        shown.wait()


class _Shown:
    """A viewer in the foreground: it ends with the `with`, and with this process."""

    def __init__(self, command: Sequence[str]) -> None:
        self._said = tempfile.TemporaryFile()  # noqa: SIM115 - closed with us
        try:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=self._said,
                stderr=self._said,
                preexec_fn=lifetime.end_with_parent,
            )
        except OSError as error:
            self._said.close()
            raise errors.SwarmError(f"viewer: {command[0]}: {error.strerror}") from error

    def __enter__(self) -> _Shown:
        return self

    def wait_for(self, host: str, port: int) -> None:
        """Wait until it serves a port."""
        deadline_s = time.monotonic() + SERVE_S
        while True:
            with socket.socket() as probe:
                if probe.connect_ex((host, port)) == 0:
                    return
            if self._process.poll() is not None or time.monotonic() > deadline_s:
                raise errors.SwarmError(f"viewer: expected it to serve, got: {self._words()}")
            time.sleep(POLL_S)

    def wait(self) -> None:
        """Wait until somebody ends it."""
        if self._process.wait() != 0:
            raise errors.SwarmError(f"viewer: expected it to show, got: {self._words()}")

    def _words(self) -> str:
        self._said.seek(0)
        lines = self._said.read().decode(errors="replace").splitlines()
        return lines[-1] if lines else f"exit code {self._process.poll()}"

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        self._process.wait()
        self._said.close()
