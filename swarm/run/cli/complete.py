"""What a shell offers after Tab: scenarios, runs, robots. Looks at files only, never at the bus."""

from __future__ import annotations

import contextlib
import tomllib
from collections.abc import Iterable
from pathlib import Path

from swarm import runs
from swarm.run import library

SHOWN_MAX = 200


def scenarios(incomplete: str) -> list[str]:
    """Built-in names, and TOML files; folders on the way to those."""
    return _beginning(incomplete, [*library.built_in(), *_paths(incomplete, ".toml")])


def run_ids(incomplete: str) -> list[str]:
    """Swarms that run now."""
    return _beginning(incomplete, [card.run for card in runs.running()])


def finished(incomplete: str) -> list[str]:
    """Folders of runs, in runs/ and here."""
    cards = (path for place in (Path("runs"), Path()) for path in place.glob(f"*/{runs.SCENARIO}"))
    return _beginning(incomplete, [str(card.parent) for card in cards])


def robots(incomplete: str) -> list[str]:
    """Names in the swarms that run now."""
    return _beginning(incomplete, [name for card in runs.running() for name in _names(card.folder)])


def logs(incomplete: str) -> list[str]:
    """Processes of the swarms that run now, and folders of runs."""
    return [*_beginning(incomplete, ["run", "world"]), *robots(incomplete), *finished(incomplete)]


def _names(folder: str) -> list[str]:
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
        raw = tomllib.loads((Path(folder) / runs.SCENARIO).read_text())
        return [str(row["name"]) for row in raw["robots"]]
    return []


def _paths(incomplete: str, suffix: str) -> Iterable[str]:
    head, _, _ = incomplete.rpartition("/")
    folder = Path(head) if head else Path("/" if incomplete.startswith("/") else ".")
    with contextlib.suppress(OSError):
        for path in folder.iterdir():
            if path.suffix == suffix or (head and path.is_dir()):
                yield f"{path}/" if path.is_dir() else str(path)


def _beginning(incomplete: str, words: Iterable[str]) -> list[str]:
    return sorted({word for word in words if word.startswith(incomplete)})[:SHOWN_MAX]
