"""What is to be seen of one file of a recording, and what it should hold by its own account.

run.mcap --parts--> Findings --topics--> TopicCount: expected, received, written, lost
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path

import msgspec

from swarm import errors, salvage
from swarm.messages import TickRecord
from swarm.source import (
    COUNTS_METADATA,
    FIRST_TICK_KEY,
    RUN_METADATA,
    SCENARIO_NAME,
    TICK_CONTENT,
    TICK_TOPIC,
    Attachment,
    Counts,
    Metadata,
    Part,
    Source,
    TickRange,
    TopicCount,
    decode_tick,
    is_end,
    is_tick,
    tick_content,
)

LISTED_MAX = 100  # damages and gaps named one by one; the rest is only counted
BLOCK_BYTES = 1 << 20  # read at a time for a crc


class SegmentRow(msgspec.Struct, frozen=True):
    """One file of a run."""

    path: str
    first_tick: int | None  # None when it holds no tick
    last_tick: int | None
    complete: bool  # closed properly: footer and summary are there


class Findings:
    """What has been seen of a file so far."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.failure = ""  # why nothing of it can be read
        self.size = 0
        self.damages: list[str] = []
        self.damage_count = 0
        self.cuts: list[str] = []  # damages that are nothing but the end of a file
        self.crc_errors = 0
        self.complete = False
        self.metadata: dict[str, Mapping[str, str]] = {}
        self.scenario_toml: bytes | None = None
        self.channels: dict[int, str] = {}
        self.found: dict[str, int] = {}  # by topic, of the ticks' content
        self.others: dict[int, int] = {}  # by channel, which the summary may name
        self.ticks: list[TickRange] = []  # runs of consecutive ticks, in the order of the file
        self.tick_count = 0
        self.stamp_ns_last = 0
        self.stamp_ns_first: int | None = None

    def damage(self, text: str, *, crc: bool = False) -> None:
        """Note what cannot be read."""
        self.damage_count += 1
        self.crc_errors += crc
        if len(self.damages) < LISTED_MAX:
            self.damages.append(text)

    def row(self) -> SegmentRow:
        """The file in short."""
        first = min((run.first for run in self.ticks), default=None)
        last = max((run.last for run in self.ticks), default=None)
        return SegmentRow(self.path.name, first, last, self.complete)

    @property
    def first_tick(self) -> int:
        """Where it says that it begins."""
        text = self.metadata.get(RUN_METADATA, {}).get(FIRST_TICK_KEY, "0")
        return int(text) if text.isascii() and text.isdigit() and len(text) < 16 else 0

    def tick(self, record: TickRecord) -> None:
        """Count what a tick holds."""
        for topic, number in zip(TICK_CONTENT, tick_content(record), strict=True):
            self.found[topic] = self.found.get(topic, 0) + number
        self.tick_count += 1
        self.stamp_ns_last = max(self.stamp_ns_last, record.stamp_ns)
        if self.stamp_ns_first is None:
            self.stamp_ns_first = record.stamp_ns
        if self.ticks and record.tick == self.ticks[-1].last + 1:
            self.ticks[-1] = TickRange(self.ticks[-1].first, record.tick)
        else:
            self.ticks.append(TickRange(record.tick, record.tick))


def look(path: Path) -> Findings:
    findings = Findings(path)
    try:
        with Source(path) as source:
            findings.size = source.size
            for part in source.parts():
                _look_at(part, source, findings)
    except errors.RecordingError as error:
        findings.failure = str(error)
    return findings


def _look_at(part: Part, source: Source, findings: Findings) -> None:
    match part:
        case salvage.Damage():
            text = f"byte {part.offset}, {part.size} bytes: {part.text}"
            if is_end(part):
                findings.cuts.append(text)
            else:
                findings.damage(text, crc=part.crc)
        case Metadata():
            findings.metadata[part.name] = part.values
        case Attachment():
            if part.name == SCENARIO_NAME:
                findings.scenario_toml = part.data
        case salvage.Channel():
            findings.channels[part.id] = part.topic
        case salvage.Message() if is_tick(part, findings.channels):
            record = decode_tick(part.data)
            if record is None:
                findings.damage(f"message {part.sequence} of '{TICK_TOPIC}' is not a tick")
            else:
                findings.tick(record)
        case salvage.Message():
            number = findings.others.get(part.channel_id, 0)
            findings.others[part.channel_id] = number + 1
        case salvage.Record(opcode=salvage.Opcode.DATA_END):
            stored = int.from_bytes(part.body[:4], "little")
            if stored != _crc(source, 0, part.offset):
                findings.damage("the data's crc does not fit: a byte has changed", crc=True)
        case salvage.Record(opcode=salvage.Opcode.FOOTER):
            start, _, stored = salvage.FOOTER_BODY.unpack(part.body)
            end = part.offset + part.size - 4  # the crc covers the footer up to itself
            findings.complete = 0 < start <= part.offset
            if not findings.complete or stored != _crc(source, start, end):
                findings.damage("the summary's crc does not fit: a byte has changed", crc=True)


def _crc(source: Source, start: int, end: int) -> int:
    crc = 0
    while start < end:
        block = source.read_at(start, min(BLOCK_BYTES, end - start))
        if not block:
            return -1
        crc = zlib.crc32(block, crc)
        start += len(block)
    return crc


def is_empty(file: Findings) -> bool:
    """Killed before it had written anything."""
    return file.path.is_file() and file.size == 0


# --- counting -------------------------------------------------------------------------------------


def _noted(findings: Findings) -> dict[str, TopicCount]:
    """Counts that the writer left in a file, if it came to that."""
    text = findings.metadata.get(COUNTS_METADATA, {}).get("counts", "{}")
    try:
        return {count.topic: count for count in msgspec.json.decode(text, type=Counts).topics}
    except (msgspec.DecodeError, ValueError, RecursionError):
        return {}


def _found(findings: Findings) -> dict[str, int]:
    """Messages of a file by topic: what ticks hold, and the viewers' channels."""
    found = dict(findings.found)
    others = dict(findings.others)
    for channel, topic in findings.channels.items():
        found[topic] = found.get(topic, 0) + others.pop(channel, 0)
    if others:
        found["unknown"] = sum(others.values())
    return found


def topics_of(findings: Findings) -> tuple[TopicCount, ...]:
    """Counts of one file against those that the writer left in it."""
    noted, found = _noted(findings), _found(findings)
    result = []
    for topic in [*noted, *(topic for topic in found if topic not in noted)]:
        number = found.get(topic, 0)
        note = noted.get(topic, TopicCount(topic, number, number, number, 0))
        lost = max(0, note.expected - number)
        result.append(TopicCount(topic, note.expected, note.received, number, lost))
    return tuple(result)


def all_topics_of(
    files: Sequence[Findings], content: Mapping[str, int], missing: int
) -> tuple[TopicCount, ...]:
    """Counts of a run in several files, where ticks that are in two of them count once.

    What a tick holds is lost with the tick, so ticks tell of all but the end of the run, and of
    that the last writer's own account tells what it could not keep.
    """
    last = {count.topic: count.lost for count in topics_of(files[-1])}
    row = files[-1].row()
    if row.first_tick is not None and row.last_tick is not None and TICK_TOPIC in last:
        here = sum(run.last - run.first + 1 for run in files[-1].ticks)
        last[TICK_TOPIC] -= row.last_tick - row.first_tick + 1 - here  # these are in `missing`
    found: dict[str, int] = dict(content)
    for file in files:
        for topic, number in _found(file).items():
            if topic not in TICK_CONTENT:
                found[topic] = found.get(topic, 0) + number
    result = []
    for topic, number in found.items():
        received = number + max(0, last.get(topic, 0))
        expected = received + (missing if topic == TICK_TOPIC else 0)
        result.append(TopicCount(topic, expected, received, number, expected - number))
    return tuple(result)


def with_tail(topics: Sequence[TopicCount], ticks: int) -> tuple[TopicCount, ...]:
    """Counts when so many ticks are known to have been."""
    found = {count.topic: count for count in topics}
    count = found.get(TICK_TOPIC, TopicCount(TICK_TOPIC, 0, 0, 0, 0))
    found[TICK_TOPIC] = TopicCount(
        TICK_TOPIC,
        max(count.expected, ticks),
        count.received,
        count.written,
        max(count.lost, ticks - count.written),
    )
    return tuple(found.values())
