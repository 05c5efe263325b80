"""The supervisor's own log, beside those of its children: what it has told whoever watches."""

from __future__ import annotations

import importlib.metadata
import platform
from collections.abc import Sequence
from pathlib import Path

from swarm import log, runs
from swarm.messages import Event, Status
from swarm.run.supervisor import Watcher

FILE_NAME = "run.log"


class Journal(Watcher):
    """Writes down what is noted, and passes everything on."""

    def __init__(self, watcher: Watcher, folder: Path) -> None:
        """Of the run in a folder."""
        self._watcher = watcher
        self._path = folder / runs.LOGS / FILE_NAME

    def started(self, card: runs.Card, addresses: Sequence[str]) -> None:
        """Begin with what runs, and where."""
        version = importlib.metadata.version("msam-swarm")
        self._write(
            f"{card.scenario}: run {card.run} on {card.endpoint}, msam-swarm {version}, "
            f"Python {platform.python_version()}"
        )
        for address in addresses:
            self._write(f"watch in {address}")
        self._watcher.started(card, addresses)

    def status(self, status: Status) -> None:
        """Not written."""
        self._watcher.status(status)

    def event(self, event: Event) -> None:
        """The world writes those."""
        self._watcher.event(event)

    def note(self, text: str) -> None:
        """What happens to processes."""
        self._write(text)
        self._watcher.note(text)

    def close(self) -> None:
        """Nothing is kept open."""
        self._watcher.close()

    def _write(self, text: str) -> None:
        log.append(self._path, "run", text)
