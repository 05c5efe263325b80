"""Reading a recording back, whole or not.

    run.mcap   --salvage--> Part ... --\\
    run.1.mcap --salvage--> Part ... ----read--> TickRecord, one after the other, each tick once

A world that is started again goes on in a file of its own, a segment. It begins at a checkpoint,
so segments overlap, and where they do the later one counts. No file is trusted: every size is
bounded, every crc checked, every tick decoded strictly, and what cannot be read is named and
passed over.
"""

from __future__ import annotations

import heapq
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import msgspec

from swarm import errors, salvage
from swarm.messages import TickRecord

FILE_NAME = "run.mcap"
PROFILE = "msam-swarm"  # in the header: the file is one of ours
TICK_TOPIC = "tick"
TICK_CONTENT = (TICK_TOPIC, "frame", "command", "event")  # what a tick's message stands for
TICK_CHANNEL_ID = 1  # the writer registers it first; tells ticks when the first chunk is lost
RUN_METADATA = "run"
SEGMENT_KEY = "segment"  # in the run's metadata: number of the file
FIRST_TICK_KEY = "first_tick"  # and where it begins
COUNTS_METADATA = "recording"
REPAIR_METADATA = "repair"
SCENARIO_NAME = "scenario.toml"

Damaged = Callable[[int, "salvage.Damage | None"], None]  # number of the segment, what

_decoder = msgspec.msgpack.Decoder(TickRecord)


class TickRange(msgspec.Struct, frozen=True):
    """Ticks first..last, both included."""

    first: int
    last: int

    def __str__(self) -> str:
        return f"{self.first}" if self.first == self.last else f"{self.first}..{self.last}"


class TopicCount(msgspec.Struct, frozen=True):
    """Messages of one kind: how many there should be, reached the writer, are in the file."""

    topic: str
    expected: int
    received: int
    written: int
    lost: int


class Counts(msgspec.Struct, frozen=True):
    """Account of a recording, by topic."""

    topics: tuple[TopicCount, ...] = ()

    @property
    def total(self) -> TopicCount:
        """Sum over the topics."""
        return TopicCount(
            "total",
            sum(count.expected for count in self.topics),
            sum(count.received for count in self.topics),
            sum(count.written for count in self.topics),
            sum(count.lost for count in self.topics),
        )

    def plus(self, more: Counts) -> Counts:
        """Sum of two accounts, topic by topic; those of the other are among those of this one."""
        added = {count.topic: count for count in more.topics}
        return Counts(
            tuple(
                one
                if (other := added.get(one.topic)) is None
                else TopicCount(
                    one.topic,
                    one.expected + other.expected,
                    one.received + other.received,
                    one.written + other.written,
                    one.lost + other.lost,
                )
                for one in self.topics
            )
        )


class Metadata(msgspec.Struct, frozen=True):
    """A metadata record."""

    name: str
    values: Mapping[str, str]


class Attachment(msgspec.Struct, frozen=True):
    """An attached file."""

    name: str
    media_type: str
    data: bytes


Part = (
    salvage.Record
    | salvage.Damage
    | salvage.Schema
    | salvage.Channel
    | salvage.Message
    | Metadata
    | Attachment
)


class Source:
    """A file open for reading at any place; a context manager."""

    def __init__(self, path: Path) -> None:
        """Raises RecordingError when it cannot be opened or is empty."""
        self.path = path
        try:
            self._file = os.open(self.path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
            self.size = os.fstat(self._file).st_size
        except OSError as error:
            raise errors.RecordingError(
                f"{self.path}: expected a recording, got: {error.strerror}"
            ) from error
        if self.size == 0:
            os.close(self._file)
            raise errors.RecordingError(
                f"{self.path}: expected a recording, got an empty file: "
                "nothing had been written when the run ended"
            )

    def __enter__(self) -> Source:
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._file)

    def read_at(self, offset: int, size: int) -> bytes:
        """At most `size` bytes; fewer at the end, or where the disk cannot be read."""
        try:
            return os.pread(self._file, size, offset)
        except OSError:
            return b""

    def parts(self) -> Iterator[Part]:
        """Everything readable in order, chunks opened; what is not becomes a Damage.

        Records that hold no content (indexes, summary, footer) are given as they are.
        """
        for item in salvage.walk(self.read_at, self.size):
            if isinstance(item, salvage.Damage):
                yield item
                continue
            try:
                match item.opcode:
                    case salvage.Opcode.CHUNK:
                        yield from salvage.chunk_parts(item.body)
                    case salvage.Opcode.METADATA:
                        yield Metadata(*salvage.metadata(item.body))
                    case salvage.Opcode.ATTACHMENT:
                        yield Attachment(*salvage.attachment(item.body))
                    case _:
                        yield salvage.record_part(item.opcode, item.body) or item
            except ValueError as error:
                crc = isinstance(error, salvage.CrcError)
                yield salvage.Damage(item.offset, item.size, str(error), crc=crc)


def decode_tick(data: bytes) -> TickRecord | None:
    """TickRecord, None when the bytes are none."""
    try:
        return _decoder.decode(data)
    except (msgspec.DecodeError, ValueError, RecursionError):
        return None


def is_tick(message: salvage.Message, topics: Mapping[int, str]) -> bool:
    """Whether a message is on the tick channel, by its id alone when the channel is not known."""
    by_id = TICK_TOPIC if message.channel_id == TICK_CHANNEL_ID else ""
    return topics.get(message.channel_id, by_id) == TICK_TOPIC


def is_end(damage: salvage.Damage) -> bool:
    """Whether a file of ours just ends there, as that of a killed world does."""
    return damage.cut and (damage.offset > 0 or damage.size == 0)


def tick_content(record: TickRecord) -> list[int]:
    """How many messages of each TICK_CONTENT one tick holds."""
    return [1, len(record.frames), len(record.commands), len(record.events)]


# --- files of a run -------------------------------------------------------------------------------


def segment_path(first: Path, number: int) -> Path:
    """File of a segment: run.mcap, run.1.mcap, run.2.mcap ..."""
    return first if number == 0 else first.with_name(f"{first.stem}.{number}{first.suffix}")


def segment_paths(path: Path) -> tuple[Path, ...]:
    """Files of one run in order, given its folder or its first file, which need not exist."""
    first = path / FILE_NAME if path.is_dir() else path
    pattern = re.compile(rf"{re.escape(first.stem)}\.([1-9][0-9]{{0,8}}){re.escape(first.suffix)}")
    try:
        names = os.listdir(first.parent)
    except OSError:
        names = []
    numbers = sorted(int(match[1]) for name in names if (match := pattern.fullmatch(name)))
    return (first, *(segment_path(first, number) for number in numbers))


def next_segment(path: Path) -> int:
    """Number of the segment with which a recording goes on; 0 when there is none yet."""
    paths = segment_paths(path)
    if len(paths) > 1:
        return int(paths[-1].stem.rpartition(".")[2]) + 1
    return 1 if paths[0].exists() else 0


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
