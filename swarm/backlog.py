"""Bytes that wait for a disk, and the account of what becomes of them.

Writer --bytes----> Stream --when the disk is willing--> file
   '-----numbers--> Account: expected, received, written, lost
"""

from __future__ import annotations

import errno
import os
from collections import deque
from collections.abc import Sequence
from pathlib import Path

from swarm import errors
from swarm.source import Counts, TopicCount


class Batch:
    """Ticks written since the flush before: counts by topic, first and last, where they end."""

    def __init__(self, numbers: Sequence[int] = (), first: int = 0, last: int = 0) -> None:
        self.numbers = list(numbers)
        self.ticks = 1 if numbers else 0
        self.first = first
        self.last = last
        self.end = 0  # offset in the file, once flushed

    def add(self, numbers: Sequence[int], tick: int) -> None:
        """One more tick."""
        if self.ticks == 0:
            self.first, self.numbers = tick, [0] * len(numbers)
        self.ticks += 1
        self.last = tick
        self.numbers = [have + new for have, new in zip(self.numbers, numbers, strict=True)]


class Account:
    """Running counts by topic."""

    def __init__(self, topics: Sequence[str]) -> None:
        self._topics = topics
        self._expected = [0] * len(topics)
        self._received = [0] * len(topics)
        self._refused = [0] * len(topics)
        self._written = [0] * len(topics)

    def expect(self, index: int, number: int) -> None:
        """There should be so many more than were received."""
        self._expected[index] += number

    def receive(self, numbers: Sequence[int]) -> None:
        """They were handed over, by topic."""
        for index, number in enumerate(numbers):
            self._expected[index] += number
            self._received[index] += number

    def wrote(self, numbers: Sequence[int]) -> None:
        """They are in the file."""
        for index, number in enumerate(numbers):
            self._written[index] += number

    def lose(self, numbers: Sequence[int]) -> None:
        """They will never be."""
        for index, number in enumerate(numbers):
            self._refused[index] += number

    def counts(self, waiting: Sequence[Batch] = ()) -> Counts:
        """The account, with what still waits counted as written."""
        rows = zip(
            self._topics, self._expected, self._received, self._written, self._refused, strict=True
        )
        return Counts(
            tuple(
                TopicCount(
                    topic=topic,
                    expected=expected,
                    received=received,
                    written=written + sum(part.numbers[i] for part in waiting if part.ticks),
                    lost=expected - received + refused,
                )
                for i, (topic, expected, received, written, refused) in enumerate(rows)
            )
        )


class Stream:
    """Takes everything that MCAP writes and gives it to the disk when the disk is willing.

    MCAP keeps offsets of what it has written, so nothing may be left out in the middle: what the
    disk refuses waits here, in order, and is tried again.
    """

    def __init__(self, path: Path) -> None:
        """Raises RecordingError."""
        try:
            flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC
            self._file = os.open(path, flags, 0o666)
        except OSError as error:
            raise errors.RecordingError(
                f"{path}: expected a place for the recording, got: {error.strerror}; "
                "choose another folder or free this one"
            ) from error
        self.refuses = False  # an injected fault: as if the disk were full
        self._waiting: deque[memoryview] = deque()
        self.size = 0  # of all that was given to this stream
        self.written_bytes = 0
        self.boundary = 0  # end of the last batch that is all on disk
        self.closed = False

    @property
    def backlog_bytes(self) -> int:
        """Bytes that wait."""
        return self.size - self.written_bytes

    def write(self, data: bytes) -> int:
        """Takes bytes; never fails."""
        if data:
            self._waiting.append(memoryview(data))
            self.size += len(data)
        return len(data)

    def tell(self) -> int:
        """Offset of the next byte."""
        return self.size

    def flush(self) -> None:
        """MCAP calls this; the writer drains by itself."""

    def drain(self) -> None:
        """Writes what waits; raises OSError where the disk refuses, and keeps the rest."""
        while self._waiting:
            if self.refuses:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            piece = self._waiting[0]
            written = os.write(self._file, piece)
            self.written_bytes += written
            if written == len(piece):
                self._waiting.popleft()
            else:
                self._waiting[0] = piece[written:]

    def close(self) -> bool:
        """Closes the file, cut behind its last whole batch if bytes wait; True when none do."""
        self.closed = True
        whole = not self._waiting
        try:
            if not whole:
                os.ftruncate(self._file, self.boundary)
        except OSError:
            pass  # then a piece of a batch stays, which every reader passes over
        finally:
            try:
                os.close(self._file)
            except OSError:
                whole = False  # some file systems tell only now
        return whole
