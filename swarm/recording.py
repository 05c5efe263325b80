"""A run's memory: one MCAP file, written as it goes, readable whatever happens to it.

    TickRecord --Writer--> run.mcap --read----> TickRecord ...    the same ticks
                               |------verify--> Verdict           all of them?
                               '------repair--> run.mcap          what can be kept of a damaged one

One lossless channel `tick` (msgpack of TickRecord, log time = simulation time, sequence = tick),
the scenario as an attachment and the run's metadata right behind the header, then whatever extra
channels a viewer likes. The only module that imports mcap; salvage reads without it.
"""

from __future__ import annotations

import os
import re
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import IO, cast

import msgspec
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter

from swarm import errors, messages, salvage
from swarm.backlog import Account, Segment, Stream
from swarm.messages import TickRecord
from swarm.playback import (
    COUNTS_METADATA,
    FILE_NAME,
    PROFILE,
    REPAIR_METADATA,
    RUN_METADATA,
    SCENARIO_NAME,
    TICK_CHANNEL_ID,
    TICK_CONTENT,
    TICK_TOPIC,
    Attachment,
    Counts,
    Metadata,
    Recording,
    Source,
    TickRange,
    TopicCount,
    decode_tick,
    read,
    tick_content,
)
from swarm.verdict import Verdict, verify

__all__ = [
    "SCENARIO_NAME",
    "Channel",
    "Counts",
    "Recording",
    "Repair",
    "TickRange",
    "TopicCount",
    "Verdict",
    "Writer",
    "read",
    "repair",
    "verify",
]

# Ticks of runs with 6 / 100 robots and 216 beams, 12 / 201 kB: lz4 makes 3.3 / 53 kB of them, zstd
# 2.7 / 36 kB in 3 / 2 times the time (51 / 730 us against 16 / 350). Time is what a tick lacks.
COMPRESSION = CompressionType.LZ4
TICK_SCHEMA_NAME = "swarm.messages.TickRecord"
BACKLOG_BYTES_MAX = 16 << 20  # kept in memory while the disk refuses; beyond it ticks are lost
SEQUENCE_MASK = 0xFFFF_FFFF  # MCAP counts in 32 bits

_encoder = msgspec.msgpack.Encoder()


class Channel(msgspec.Struct, frozen=True):
    """One more stream for viewers, derived from each tick; None is nothing at this tick."""

    topic: str
    schema_name: str
    schema_encoding: str
    schema_data: bytes
    message_encoding: str
    encode: Callable[[TickRecord], bytes | None]


class Writer:
    """Writes a recording. A disk that fails never stops the run: it is noted, counted, retried."""

    def __init__(
        self,
        path: str | os.PathLike[str],
        scenario_toml: bytes,
        metadata: Mapping[str, str],
        channels: Sequence[Channel] = (),
        flush_ticks: int = 12,
        flush_s: float = 0.5,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        """Opens a new file: `path`, or run.mcap in it when it is a folder.

        Args:
            flush_ticks, flush_s: a kill loses at most the ticks since the last flush, which
                happens at the write that reaches either.
            now: wall clock in seconds.
        Raises:
            RecordingError: the file cannot be created.
        """
        folder = Path(path)
        self.path = folder / FILE_NAME if folder.is_dir() else folder
        self.failure: str | None = None
        self.lost_ticks: TickRange | None = None  # from the first to the last that was lost
        self._now = now
        self._flush_ticks = flush_ticks
        self._flush_s = flush_s
        self._flush_at_s = now() + flush_s
        self._channels = channels
        self._account = Account([*TICK_CONTENT, *(channel.topic for channel in channels)])
        self._last_tick: int | None = None
        self._segments: list[Segment] = []  # flushed by MCAP, not yet all on disk
        self._open = Segment()  # ticks since the last flush
        self._buffer = bytearray()
        self._stream = Stream(self.path)
        self._mcap = _start(cast("IO[bytes]", self._stream))
        self._tick_channel = _register_tick(self._mcap)
        assert self._tick_channel == TICK_CHANNEL_ID
        self._channel_ids = [_register(self._mcap, channel) for channel in channels]
        self._mcap.add_metadata(RUN_METADATA, dict(metadata))
        self._mcap.add_attachment(0, 0, SCENARIO_NAME, "application/toml", scenario_toml)
        self._flush()

    @property
    def counts(self) -> Counts:
        """Expected, received, written and lost so far, by topic."""
        return self._account.counts()

    def write(self, record: TickRecord) -> None:
        """Adds one tick; ticks left out since the one before count as expected, not received."""
        account = self._account
        if self._last_tick is not None and record.tick > self._last_tick + 1:
            account.expect(0, record.tick - self._last_tick - 1)
        self._last_tick = record.tick
        payloads: list[tuple[int, bytes]] = []
        numbers = tick_content(record)
        for channel, channel_id in zip(self._channels, self._channel_ids, strict=True):
            payload = channel.encode(record)
            numbers.append(0 if payload is None else 1)
            if payload is not None:
                payloads.append((channel_id, payload))
        account.receive(numbers)
        if self._stream.backlog_bytes > BACKLOG_BYTES_MAX and not self._drain():
            self._lose(Segment(numbers, record.tick, record.tick))
            return
        _encoder.encode_into(record, self._buffer)
        self._add(self._tick_channel, record, self._buffer)  # copied, so it can be used again
        for channel_id, payload in payloads:
            self._add(channel_id, record, payload)
        self._open.add(numbers, record.tick)
        if self._open.ticks >= self._flush_ticks or self._now() >= self._flush_at_s:
            self._flush()

    def close(self) -> Counts:
        """Completes the file and gives the final account; never raises, may be called again."""
        if self._stream.closed:
            return self.counts
        self._flush()
        # Behind everything else in the stream: whoever reads it knows that the rest arrived too,
        # so what still waits is counted as written.
        noted = self._account.counts(waiting=self._segments)
        text = msgspec.json.encode(noted).decode()
        self._mcap.add_metadata(COUNTS_METADATA, {"counts": text})
        self._mcap.finish()  # type: ignore[no-untyped-call]
        if not self._drain():
            for segment in self._segments:
                self._lose(segment)
            self._segments.clear()
        whole = self._stream.close()
        if not whole and self.failure is None:
            self.failure = f"{self.path}: expected the file to be closed, got an error of the disk"
        return self.counts

    def __enter__(self) -> Writer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _add(self, channel_id: int, record: TickRecord, payload: bytes | bytearray) -> None:
        stamp_ns, sequence = record.stamp_ns, record.tick & SEQUENCE_MASK
        self._mcap.add_message(channel_id, stamp_ns, cast(bytes, payload), stamp_ns, sequence)

    def _flush(self) -> None:
        self._mcap.flush()  # type: ignore[no-untyped-call]
        self._open.end = self._stream.size
        self._segments.append(self._open)
        self._open = Segment()
        self._flush_at_s = self._now() + self._flush_s
        self._drain()

    def _drain(self) -> bool:
        """Writes what waits; False, with `failure` set, when the disk does not take all of it."""
        try:
            self._stream.drain()
        except OSError as error:
            if self.failure is None:
                self.failure = (
                    f"{self.path}: expected to write {self._stream.backlog_bytes} bytes at tick "
                    f"{self._last_tick or 0}, got: {error.strerror}; still trying"
                )
        while self._segments and self._segments[0].end <= self._stream.written_bytes:
            segment = self._segments.pop(0)
            self._account.wrote(segment.numbers)
            self._stream.boundary = segment.end
        return not self._segments

    def _lose(self, segment: Segment) -> None:
        self._account.lose(segment.numbers)
        if segment.ticks:
            first = segment.first if self.lost_ticks is None else self.lost_ticks.first
            self.lost_ticks = TickRange(min(first, segment.first), segment.last)


# --- the file -------------------------------------------------------------------------------------


def _start(file: IO[bytes]) -> McapWriter:
    writer = McapWriter(file, compression=COMPRESSION, enable_data_crcs=True)
    writer.start(profile=PROFILE)
    return writer


def _register_tick(writer: McapWriter) -> int:
    schema = writer.register_schema(TICK_SCHEMA_NAME, "text", schema_text().encode())
    return writer.register_channel(TICK_TOPIC, "msgpack", schema)


def _register(writer: McapWriter, channel: Channel) -> int:
    schema = writer.register_schema(
        channel.schema_name, channel.schema_encoding, channel.schema_data
    )
    return writer.register_channel(channel.topic, channel.message_encoding, schema)


def schema_text() -> str:
    """How to read a tick without this program: every struct is a msgpack array of these fields."""
    lines: list[str] = []
    names = ["TickRecord"]
    for name in names:  # grows while it is read
        struct = getattr(messages, name)
        fields = [f"{field}: {struct.__annotations__[field]}" for field in struct.__struct_fields__]
        lines.append(f"{name} = [{', '.join(fields)}]")
        for found in re.findall(r"\b[A-Z]\w+", lines[-1]):
            kind = getattr(messages, found, None)
            if isinstance(kind, type) and issubclass(kind, msgspec.Struct) and found not in names:
                names.append(found)
    return "\n".join(lines)


# --- mending --------------------------------------------------------------------------------------


class Repair(msgspec.Struct, frozen=True):
    """What was kept of a damaged recording, and what was lost."""

    path: str  # the good file
    original: str | None  # where the damaged one is now; None when nothing had to be done
    kept_ticks: int
    kept_bytes: int
    lost_ticks: tuple[TickRange, ...]  # known gaps; what came after a cut nobody knows
    lost_bytes: int
    text: tuple[str, ...]  # the same in lines for a person


def repair(path: str | os.PathLike[str], out: str | os.PathLike[str] | None = None) -> Repair:
    """Writes a whole file with everything that can be read of a damaged one.

    Without `out` it takes the place of the damaged file, which stays beside it as `*.damaged`;
    at no moment is there no file. A whole file is left as it is.

    Raises:
        RecordingError: there is nothing of ours in it, or the new file cannot be written.
    """
    before = verify(path)
    original = read(path).path
    if out is None and before.complete and not before.damages:
        line = f"{original}: whole, nothing to repair"
        size = original.stat().st_size
        return Repair(str(original), None, _ticks(before), size, before.gaps, 0, (line,))
    target = original if out is None else Path(out)
    part = target.with_name(target.name + ".part")
    try:
        lost_bytes = _copy(original, part, before)
        damaged = _set_aside(original) if out is None else original
        os.replace(part, target)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise errors.RecordingError(
            f"{target}: expected to write the repaired file, got: {error.strerror}"
        ) from error
    after = verify(target)
    kept_bytes = target.stat().st_size
    lines = (
        f"{target}: kept {_ticks(after)} ticks, {kept_bytes} bytes",
        f"  lost {lost_bytes} bytes that could not be read",
        *(f"  lost ticks: {gap}" for gap in after.gaps),
        f"  the damaged file is {damaged}",
    )
    return Repair(
        str(target), str(damaged), _ticks(after), kept_bytes, after.gaps, lost_bytes, lines
    )


def _ticks(verdict: Verdict) -> int:
    return sum(count.written for count in verdict.topics if count.topic == TICK_TOPIC)


def _set_aside(path: Path) -> Path:
    """Second name for the damaged file, one that was free."""
    number = 0
    while True:
        aside = path.with_name(f"{path.name}.damaged{number or ''}")
        try:
            os.link(path, aside)
        except FileExistsError:
            number += 1
            continue
        return aside


def _copy(source_path: Path, part: Path, before: Verdict) -> int:
    """Everything readable into a new file; returns how many bytes were not."""
    lost_bytes = 0
    with Source(source_path) as source, part.open("wb") as file:
        writer = _start(file)
        channels = _copy_channels(source, writer)
        for piece in source.parts():
            match piece:
                case salvage.Damage():
                    lost_bytes += piece.size
                case Metadata():
                    writer.add_metadata(piece.name, dict(piece.values))
                case Attachment():
                    writer.add_attachment(0, 0, piece.name, piece.media_type, piece.data)
                case salvage.Message():
                    if piece.channel_id not in channels and decode_tick(piece.data) is not None:
                        channels[piece.channel_id] = _register_tick(writer)
                    if piece.channel_id in channels:
                        writer.add_message(
                            channels[piece.channel_id],
                            piece.log_time_ns,
                            piece.data,
                            piece.publish_time_ns,
                            piece.sequence,
                        )
                    else:
                        lost_bytes += len(piece.data)
        text = f"{lost_bytes} bytes could not be read" + (
            "" if before.complete else "; the file had not been closed, its end may be missing"
        )
        writer.add_metadata(REPAIR_METADATA, {"text": text})
        writer.finish()  # type: ignore[no-untyped-call]
    return lost_bytes


def _copy_channels(source: Source, writer: McapWriter) -> dict[int, int]:
    """Registers every channel that is named anywhere, the summary included: old id -> new id.

    The tick channel comes first, as in every file of ours.
    """
    schemas: dict[int, salvage.Schema] = {}
    found: dict[int, salvage.Channel] = {}
    for piece in source.parts():
        match piece:
            case salvage.Schema():
                schemas.setdefault(piece.id, piece)
            case salvage.Channel():
                found.setdefault(piece.id, piece)
    channels: dict[int, int] = {}
    for channel in sorted(found.values(), key=lambda channel: channel.topic != TICK_TOPIC):
        schema = schemas.get(channel.schema_id, salvage.Schema(0, "", "", b""))
        channels[channel.id] = _register(
            writer,
            Channel(
                channel.topic,
                schema.name,
                schema.encoding,
                schema.data,
                channel.message_encoding,
                lambda _: None,
            ),
        )
    return channels
