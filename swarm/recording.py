"""A run's memory: an MCAP file, written as it goes, readable whatever happens to it.

    TickRecord --Writer--> run.mcap --read----> TickRecord ...    the same ticks
                               |------verify--> Verdict           all of them?
                               '------repair--> run.mcap          what can be kept of a damaged one

A world that was killed and started again goes on in run.1.mcap, run.2.mcap ...: segments, each a
whole recording of its own, all of them one run to every reader.

One lossless channel `tick` (msgpack of TickRecord, log time = simulation time, sequence = tick),
the scenario as an attachment and the run's metadata right behind the header, then whatever extra
channels a viewer likes.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import IO, cast

import msgspec

from swarm import container
from swarm.backlog import Account, Batch, Stream
from swarm.container import Channel
from swarm.mending import Repair, repair
from swarm.messages import TickRecord
from swarm.playback import Recording, next_segment, read, segment_path, segment_paths, ticks_before
from swarm.source import (
    COUNTS_METADATA,
    FILE_NAME,
    FIRST_TICK_KEY,
    RUN_METADATA,
    SCENARIO_NAME,
    SEGMENT_KEY,
    TICK_CHANNEL_ID,
    TICK_CONTENT,
    Counts,
    TickRange,
    TopicCount,
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
    "next_segment",
    "read",
    "repair",
    "segment_path",
    "segment_paths",
    "ticks_before",
    "verify",
]

BACKLOG_BYTES_MAX = 16 << 20  # kept in memory while the disk refuses; beyond it ticks are lost
SEQUENCE_MASK = 0xFFFF_FFFF  # MCAP counts in 32 bits
LOST_RANGES_MAX = 100  # named one by one; beyond, the last one grows

_encoder = msgspec.msgpack.Encoder()


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
        *,
        segment: int = 0,
        first_tick: int = 0,
    ) -> None:
        """Opens a new file: `path`, or run.mcap in it when it is a folder, or the segment's.

        Args:
            flush_ticks, flush_s: a kill loses at most the ticks since the last flush, which
                happens at the write that reaches either.
            now: wall clock in seconds.
            segment: number of the file, more than 0 when it goes on with a recording.
            first_tick: where it begins: 0, or the checkpoint's.
        Raises:
            RecordingError: the file cannot be created.
        """
        first = Path(path) / FILE_NAME if Path(path).is_dir() else Path(path)
        self.path = segment_path(first, segment)
        self.failure: str | None = None
        self.lost_ticks: tuple[TickRange, ...] = ()
        self._now = now
        self._flush_ticks = flush_ticks
        self._flush_s = flush_s
        self._flush_at_s = now() + flush_s
        self._channels = channels
        self._account = Account([*TICK_CONTENT, *(channel.topic for channel in channels)])
        self._earlier = Account(TICK_CONTENT)  # what the segments before this one hold
        self._last_tick = first_tick - 1
        self._batches: list[Batch] = []  # flushed by MCAP, not yet all on disk
        self._open = Batch()  # ticks since the last flush
        self._buffer = bytearray()
        self._stream = Stream(self.path)
        self._mcap = container.start(cast("IO[bytes]", self._stream))
        self._tick_channel = container.register_tick(self._mcap)
        assert self._tick_channel == TICK_CHANNEL_ID
        self._channel_ids = [container.register(self._mcap, channel) for channel in channels]
        place = {SEGMENT_KEY: str(segment), FIRST_TICK_KEY: str(first_tick)}
        self._mcap.add_metadata(RUN_METADATA, {**metadata, **place})
        self._mcap.add_attachment(0, 0, SCENARIO_NAME, "application/toml", scenario_toml)
        self.flush()

    @property
    def counts(self) -> Counts:
        """Expected, received, written and lost so far, by topic, in all segments."""
        return self._account.counts().plus(self._earlier.counts())

    @property
    def disk_full(self) -> bool:
        """An injected fault: while it is set the disk refuses every byte, as a full one does."""
        return self._stream.refuses

    @disk_full.setter
    def disk_full(self, full: bool) -> None:
        self._stream.refuses = full

    def has(self, record: TickRecord) -> None:
        """Counts a tick that an earlier segment holds."""
        numbers = tick_content(record)
        self._earlier.receive(numbers)
        self._earlier.wrote(numbers)

    def write(self, record: TickRecord) -> None:
        """Adds one tick; ticks left out since the one before count as expected, not received."""
        account = self._account
        if record.tick > self._last_tick + 1:
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
            self._lose(Batch(numbers, record.tick, record.tick))
            return
        _encoder.encode_into(record, self._buffer)
        self._add(self._tick_channel, record, self._buffer)  # copied, so it can be used again
        for channel_id, payload in payloads:
            self._add(channel_id, record, payload)
        self._open.add(numbers, record.tick)
        if self._open.ticks >= self._flush_ticks or self._now() >= self._flush_at_s:
            self.flush()

    def flush(self) -> bool:
        """Hands over all that was written so far; True when the kernel has taken every byte.

        Then a killed process loses nothing of it. It is not the medium's word: a machine that
        loses its power may.
        """
        if self._stream.closed:
            return not self._batches
        self._mcap.flush()  # type: ignore[no-untyped-call]
        self._open.end = self._stream.size
        self._batches.append(self._open)
        self._open = Batch()
        self._flush_at_s = self._now() + self._flush_s
        return self._drain()

    def close(self) -> Counts:
        """Completes the file and gives the final account; never raises, may be called again."""
        if self._stream.closed:
            return self.counts
        self.flush()
        # Behind everything else in the stream: whoever reads it knows that the rest arrived too,
        # so what still waits is counted as written.
        noted = self._account.counts(waiting=self._batches)
        text = msgspec.json.encode(noted).decode()
        self._mcap.add_metadata(COUNTS_METADATA, {"counts": text})
        self._mcap.finish()  # type: ignore[no-untyped-call]
        if not self._drain():
            for batch in self._batches:
                self._lose(batch)
            self._batches.clear()
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

    def _drain(self) -> bool:
        """Writes what waits; False, with `failure` set, when the disk does not take all of it."""
        try:
            self._stream.drain()
        except OSError as error:
            if self.failure is None:
                self.failure = (
                    f"{self.path}: expected to write {self._stream.backlog_bytes} bytes at tick "
                    f"{max(self._last_tick, 0)}, got: {error.strerror}; still trying"
                )
        while self._batches and self._batches[0].end <= self._stream.written_bytes:
            batch = self._batches.pop(0)
            self._account.wrote(batch.numbers)
            self._stream.boundary = batch.end
        return not self._batches

    def _lose(self, batch: Batch) -> None:
        self._account.lose(batch.numbers)
        if batch.ticks == 0:
            return
        # What waits at the end is lost after what came while it waited, so sort.
        new = TickRange(batch.first, batch.last)
        joined: list[TickRange] = []
        for one in sorted((*self.lost_ticks, new), key=lambda one: one.first):
            if joined and (one.first <= joined[-1].last + 1 or len(joined) >= LOST_RANGES_MAX):
                one = TickRange(joined[-1].first, max(joined.pop().last, one.last))
            joined.append(one)
        self.lost_ticks = tuple(joined)
