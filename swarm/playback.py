"""Reading a run back from its files, whole or not.

    run.mcap   --source--> ticks --\\
    run.1.mcap --source--> ticks ----read--> TickRecord, by ascending tick, each once

A world that is started again goes on in a file of its own, a segment. It begins at a checkpoint,
so segments overlap, and where they do the later one counts.
"""

from __future__ import annotations

import heapq
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

from swarm import errors, salvage
from swarm.messages import TickRecord
from swarm.source import (
    FILE_NAME,
    PROFILE,
    Attachment,
    Metadata,
    Source,
    decode_tick,
    is_end,
    is_tick,
)

Damaged = Callable[[int, "salvage.Damage | None"], None]  # number of the segment, what


# --- files of a run -------------------------------------------------------------------------------


def segment_path(first: Path, number: int) -> Path:
    """File of a segment: run.mcap, run.1.mcap, run.2.mcap ..."""
    return first if number == 0 else first.with_name(f"{first.stem}.{number}{first.suffix}")


def first_path(path: Path) -> Path:
    """First file of a run, given that or its folder."""
    return path / FILE_NAME if path.is_dir() else path


def segment_paths(path: Path) -> tuple[Path, ...]:
    """Files of one run in order, given its folder or its first file.

    A world that was killed before it opened that has left none; the first is named all the same
    when there is no other.
    """
    first = first_path(path)
    others = tuple(segment_path(first, number) for number in _numbers(first))
    return (first, *others) if first.exists() or not others else others


def next_segment(path: Path) -> int:
    """Number of the segment with which a recording goes on; 0 when there is none yet."""
    first = first_path(path)
    numbers = _numbers(first)
    return numbers[-1] + 1 if numbers else int(first.exists())


def _numbers(first: Path) -> list[int]:
    """Numbers of the files that go on with a first one, rising."""
    pattern = re.compile(rf"{re.escape(first.stem)}\.([1-9][0-9]{{0,8}}){re.escape(first.suffix)}")
    try:
        names = os.listdir(first.parent)
    except OSError:
        return []
    return sorted(int(match[1]) for name in names if (match := pattern.fullmatch(name)))


# --- reading --------------------------------------------------------------------------------------


class Recording:
    """A run that can be read; `cut` is known once its ticks have been read to the end."""

    def __init__(self, path: Path) -> None:
        """Raises RecordingError when all files are missing, empty or not ours."""
        self.paths = segment_paths(path)
        self.path = self.paths[0]
        self.metadata: Mapping[str, str] = {}
        self.scenario_toml = b""
        self.cut = False  # it ends in the middle, or something of it could not be read
        failures: list[errors.RecordingError] = []
        for part in self.paths:  # in the first, unless that was killed before it said anything
            try:
                metadata, scenario_toml = beginning(part)
            except errors.RecordingError as error:
                failures.append(error)
                continue
            self.metadata = self.metadata or metadata
            self.scenario_toml = self.scenario_toml or scenario_toml
            if self.metadata and self.scenario_toml:
                break
        if len(failures) == len(self.paths):
            raise failures[0]

    @property
    def ticks(self) -> Iterator[TickRecord]:
        """All that can be read, by ascending tick and each once."""
        before = -1
        for record, _ in merged(self.paths, self._damaged):
            if record.tick != before:
                before = record.tick
                yield record

    def _damaged(self, number: int, damage: salvage.Damage | None) -> None:
        """A segment that another continues may end anywhere."""
        if damage is None or not is_end(damage) or number == len(self.paths) - 1:
            self.cut = True


def read(path: str | os.PathLike[str]) -> Recording:
    """Opens a run folder's recording with all its segments, or its first file.

    Raises:
        RecordingError: missing, empty, or not one of ours; damage alone is no reason.
    """
    return Recording(Path(path))


def ticks_before(path: str | os.PathLike[str], tick: int) -> Iterator[TickRecord]:
    """Ticks 0 .. tick - 1, for a world that goes on at `tick`.

    Raises:
        RecordingError: one of them is not there.
    """
    expected = 0
    for record in read(path).ticks if tick > 0 else ():
        if record.tick != expected:
            break
        yield record
        expected += 1
        if expected == tick:
            return
    if expected < tick:
        raise errors.RecordingError(
            f"{path}: expected every tick before {tick}, got no tick {expected}; "
            "the run cannot go on from there"
        )


def merged(paths: Sequence[Path], damaged: Damaged) -> Iterator[tuple[TickRecord, int]]:
    """Ticks of all segments with the segment's number, ascending, of equal ticks the later first.

    One chunk of each file is in memory at a time.

    Args:
        damaged: told the number and what could not be read; None is a tick out of order, left out.
    """
    streams = [_ascending(path, number, damaged) for number, path in enumerate(paths)]
    yield from heapq.merge(*streams, key=lambda one: (one[0].tick, -one[1]))


def _ascending(path: Path, number: int, damaged: Damaged) -> Iterator[tuple[TickRecord, int]]:
    """Ticks of one file; it may be empty when it is not the only one."""
    topics: dict[int, str] = {}
    before = -1
    try:
        source = Source(path)
    except errors.RecordingError:
        damaged(number, salvage.Damage(0, 0, "nothing that can be read", cut=True))
        return
    with source:
        for part in source.parts():
            match part:
                case salvage.Damage():
                    damaged(number, part)
                case salvage.Channel():
                    topics[part.id] = part.topic
                case salvage.Message() if is_tick(part, topics):
                    record = decode_tick(part.data)
                    if record is None or record.tick <= before:
                        damaged(number, None)
                    else:
                        before = record.tick
                        yield record, number


def beginning(path: Path) -> tuple[Mapping[str, str], bytes]:
    """The run's metadata and scenario of one file, as far as they are there.

    Raises:
        RecordingError: it is missing, empty or not one of ours.
    """
    ours, profile = False, ""
    metadata: Mapping[str, str] = {}
    scenario_toml = b""
    with Source(path) as source:
        for part in source.parts():
            match part:
                case salvage.Record(opcode=salvage.Opcode.HEADER):
                    profile = _profile(part)
                    ours = ours or profile == PROFILE
                case Metadata(name="run"):
                    metadata, ours = part.values, True
                case Attachment(name="scenario.toml"):
                    scenario_toml = part.data
                case salvage.Message():
                    ours = ours or decode_tick(part.data) is not None
                    if metadata and scenario_toml:
                        break
    if not ours:
        raise errors.RecordingError(
            f"{path}: expected a recording of {PROFILE}, got "
            + (f"an MCAP file of profile '{profile}'" if profile else "something else")
        )
    return metadata, scenario_toml


def _profile(header: salvage.Record) -> str:
    try:
        return salvage.header_profile(header.body)
    except ValueError:
        return ""
