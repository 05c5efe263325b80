"""Where a run can be watched: ports of the live pictures, and the viewer that was asked for."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import msgspec

from swarm.run.child import free_port

View = Literal["none", "web", "native"]
END_S = 1.0


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
        self.addresses = (
            [] if ports.foxglove is None else [f"Foxglove: ws://127.0.0.1:{ports.foxglove}"]
        )
        if ports.rerun is None:
            return
        from dashboards import live  # rerun takes half a second to import: only who views pays

        uri = live.uri(ports.rerun)
        if view == "native":
            command, shown = live.native_command(uri), uri
        else:
            web_port = free_port()
            command, shown = live.web_command(web_port, uri), live.web_address(web_port, uri)
        try:
            with log.open("wb") as out:
                self._process = subprocess.Popen(
                    command,
                    stdout=out,
                    stderr=out,
                    stdin=subprocess.DEVNULL,
                    start_new_session=True,
                )
        except OSError as error:
            note(f"viewer: expected to start {command[0]}, got: {error.strerror}")
            return
        self.addresses.append(f"Rerun: {shown}")

    def close(self) -> None:
        """End the server of the web viewer; a native one belongs to the person who looks at it."""
        if self._process is None or self._view != "web":
            return
        self._process.terminate()
        try:
            self._process.wait(END_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
