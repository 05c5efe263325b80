"""One file of a recording, taken apart as far as it can be read.

    run.mcap --salvage--> Record, chunk --parts--> Schema, Channel, Message, Metadata, Attachment
                                                   | Damage, where something cannot be read

No file is trusted: every size is bounded, every crc checked, every tick decoded strictly, and what
cannot be read is named and passed over.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
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
