"""What a process has to say: JSON Lines in its log file, plain text for who started it by hand.

    say, crashes --> {"time": ..., "process": ..., "level": ..., "text": ...} --> logs/NAME.log
                     whatever else lands there (Rust, faulthandler), as it is --'    |
                                                              Entry by Entry <--Tail-'

Reading takes every line: one that is no record is an entry of level `raw`, at the time of the
record before it.
"""

from __future__ import annotations

import contextlib
import datetime
import faulthandler
import os
import sys
import threading
import traceback
from collections.abc import Iterable
from pathlib import Path
from typing import Literal

import msgspec

Level = Literal["info", "warn", "error", "raw"]

LINE_BYTES_MAX = 1 << 16  # of what is read at once: a longer line is cut into several


class Entry(msgspec.Struct, frozen=True, omit_defaults=True):
    """One line of a log."""

    time: str  # UTC, RFC 3339 to the microsecond: sorts as text
    process: str
    level: Level
    text: str
    tick: int | None = None
    traceback: str = ""


_decoder = msgspec.json.Decoder(Entry)
_process = ""  # whose standard error is a log file


def begin(process: str) -> None:
    """From now on standard error is the log of this process; crashes too become one record."""
    global _process
    _process = process
    faulthandler.enable()
    sys.excepthook = lambda kind, error, trace: _crashed(error)
    threading.excepthook = lambda about: _crashed(about.exc_value)


def say(process: str, text: str, *, level: Level = "info", tick: int | None = None) -> None:
    """One line."""
    if _process:
        _write(Entry(_now(), process, level, text, tick))
    else:
        when = "" if tick is None else f"tick {tick}: "
        print(f"swarm-{process}: {when}{text}", file=sys.stderr, flush=True)


def append(path: Path, process: str, text: str) -> None:
    """One line of a process whose standard error is for people; dropped when the disk is full."""
    with contextlib.suppress(OSError), path.open("ab") as file:
        file.write(msgspec.json.encode(Entry(_now(), process, "info", text)) + b"\n")


def crash(error: BaseException) -> None:
    """The last line of a process that ends with an error nobody has caught."""
    if _process:
        _crashed(error)
    else:
        traceback.print_exception(error)


def _crashed(error: BaseException | None) -> None:
    lines = traceback.format_exception(error)
    _write(Entry(_now(), _process, "error", lines[-1].strip(), traceback="".join(lines)))


def _write(entry: Entry) -> None:
    """In one piece: other threads write there too. Dropped when the disk is full."""
    with contextlib.suppress(OSError):
        os.write(2, msgspec.json.encode(entry) + b"\n")


def _now() -> str:
    return _rfc3339(datetime.datetime.now(datetime.UTC))


def _rfc3339(time: datetime.datetime) -> str:
    return time.isoformat(timespec="microseconds").replace("+00:00", "Z")


# --- reading ------------------------------------------------------------------------------------


class Tail:
    """A log file that is read as it grows."""

    def __init__(self, path: Path, begins: int = 0) -> None:
        """Nothing has been read; `begins` is the byte where to begin."""
        self.path = path
        self._offset = begins
        self._rest = b""
        self._time = ""  # of the newest record

    def read(self, *, final: bool = False) -> list[Entry]:
        """What is new; `final` takes a last line that is not complete, too."""
        data = self._rest + self._new()
        lines = data.split(b"\n")
        self._rest = lines.pop()
        if final or len(self._rest) > LINE_BYTES_MAX:
            lines.append(self._rest)
            self._rest = b""
        return self._entries(line for line in lines if line.strip())

    def _new(self) -> bytes:
        try:
            with self.path.open("rb") as file:
                file.seek(self._offset)
                data = file.read()
        except OSError:
            return b""
        self._offset += len(data)
        return data

    def _entries(self, lines: Iterable[bytes]) -> list[Entry]:
        found = [_parse(line, self.path.stem) for line in lines]
        first = next((entry.time for entry in found if entry.time), "")
        self._time = self._time or first or self._modified()
        for number, entry in enumerate(found):
            if entry.time:
                self._time = entry.time
            else:
                found[number] = msgspec.structs.replace(entry, time=self._time)
        return found

    def _modified(self) -> str:
        try:
            modified_s = self.path.stat().st_mtime
        except OSError:
            return ""
        return _rfc3339(datetime.datetime.fromtimestamp(modified_s, datetime.UTC))


def _parse(line: bytes, process: str) -> Entry:
    try:
        return _decoder.decode(line)
    except (msgspec.DecodeError, RecursionError):  # not ours
        return Entry("", process, "raw", line.decode(errors="replace").rstrip())


def last_words(path: Path, begins: int = 0) -> str:
    """What the end of a log tells of why it ends: a crash of native code, an error, or its last."""
    try:
        size = path.stat().st_size
    except OSError:
        return ""
    begins = max(begins, size - LINE_BYTES_MAX)
    entries = Tail(path, begins).read(final=True)
    raw: list[str] = []
    for entry in reversed(entries):
        if entry.level != "raw":
            break
        raw.insert(0, entry.text)
    if raw:
        return raw[0].strip()  # of a panic, or of faulthandler's, the line that says what
    errors = [entry.text for entry in entries if entry.level == "error"]
    return (errors or [entry.text for entry in entries] or [""])[-1]


def merged(entries: Iterable[Entry]) -> list[Entry]:
    """In order of time; those of one process stay in the order in which they were written."""
    return sorted(entries, key=lambda entry: entry.time)
