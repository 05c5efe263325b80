"""The logs of a run, merged by time, for people or as they are.

logs/*.log --Tail--> entries --by time--> lines on standard output
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import msgspec
from rich.console import Console
from rich.text import Text

from swarm import errors, log, runs
from swarm.log import Entry, Tail

LOOK_S = 0.2  # how often files that grow are looked at
OWN_STYLES = {"run": "bold", "world": "bold", "viewer": "dim"}
LEVEL_STYLES = {"warn": "yellow", "error": "bold red", "raw": "dim"}


def show(
    folder: Path,
    names: Sequence[str],
    *,
    follow: bool,
    as_json: bool,
    styles: Mapping[str, str],
) -> None:
    """Print the logs of a run; while it runs, with `follow`, go on as they grow.

    Raises UsageError for a name that has no log.
    """
    card = _card(folder)
    tails: dict[Path, Tail] = {}
    console = Console()
    if not console.is_terminal:
        console = Console(width=1 << 16)  # a pipe gets whole lines
    width = 0
    while True:
        # asked before the look, of the process: robots still write when the card is gone
        runs_on = follow and card is not None and runs.is_alive(card)
        paths = sorted((folder / runs.LOGS).glob("*.log"))
        known = [path.stem for path in paths]
        if not runs_on:
            _check(names, known)
        for path in paths:
            if not names or path.stem in names:
                tails.setdefault(path, Tail(path))
        width = max([width, *(len(path.stem) for path in tails)])
        entries = log.merged(
            entry for tail in tails.values() for entry in tail.read(final=not runs_on)
        )
        if as_json:
            print_json(entries)
        else:
            for entry in entries:
                console.print(line(entry, width, styles), highlight=False, soft_wrap=True)
        if not runs_on:
            return
        time.sleep(LOOK_S)


def _card(folder: Path) -> runs.Card | None:
    """Card of the run in a folder, None when it is over."""
    try:
        return msgspec.json.decode((folder / runs.CARD).read_bytes(), type=runs.Card)
    except (OSError, msgspec.DecodeError):
        return None


def _check(names: Sequence[str], known: Sequence[str]) -> None:
    for name in names:
        if name not in known:
            hint = errors.did_you_mean(name, known)
            raise errors.UsageError(f"expected one of {', '.join(known)}, got '{name}'{hint}")


def print_json(entries: Iterable[Entry]) -> None:
    """One object a line."""
    for entry in entries:
        sys.stdout.write(msgspec.json.encode(entry).decode() + "\n")
    sys.stdout.flush()


def line(entry: Entry, width: int, styles: Mapping[str, str]) -> Text:
    """An entry for people: time of day, process, tick, text, and the traceback under it."""
    style = styles.get(entry.process, OWN_STYLES.get(entry.process, ""))
    clock = entry.time[11:23] if len(entry.time) >= 23 else entry.time
    when = "" if entry.tick is None else f"tick {entry.tick}: "
    text = Text.assemble(
        (clock, "dim"),
        "  ",
        (entry.process.ljust(width), style),
        "  ",
        (when, "dim"),
        (entry.text, LEVEL_STYLES.get(entry.level, "")),
    )
    for trace in entry.traceback.splitlines():
        text.append(f"\n{' ' * (width + 16)}{trace}", "dim")
    return text
