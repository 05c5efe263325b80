"""Whether a recording is all that there was to record.

run.mcap --playback--> Part ... --verify--> Verdict: what is there, damaged, missing
"""

from __future__ import annotations

import os
import zlib
from collections.abc import Mapping
from pathlib import Path

import msgspec

from swarm import errors, salvage
from swarm.messages import TickRecord
from swarm.playback import (
    COUNTS_METADATA,
    REPAIR_METADATA,
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
    is_tick,
    tick_content,
)

LISTED_MAX = 100  # damages and gaps named one by one; the rest is only counted
BLOCK_BYTES = 1 << 20  # read at a time for a crc


class Verdict(msgspec.Struct, frozen=True):
    """What `verify` found."""

    ok: bool  # whole, undamaged, nothing lost
    complete: bool  # closed properly: footer and summary are there
    crc_errors: int
    damages: tuple[str, ...]
    topics: tuple[TopicCount, ...]
    gaps: tuple[TickRange, ...]
    duplicates: int  # ticks that are there more than once
    first_tick: int | None
    last_tick: int | None
    sim_time_s: float
    text: tuple[str, ...]  # the same in lines for a person


class _Findings:
    """What has been seen of a file so far."""

    def __init__(self) -> None:
        self.damages: list[str] = []
        self.damage_count = 0
        self.crc_errors = 0
        self.complete = False
        self.metadata: dict[str, Mapping[str, str]] = {}
        self.attachments: set[str] = set()
        self.channels: dict[int, str] = {}
        self.found: dict[str, int] = {}  # by topic, of the ticks' content
        self.others: dict[int, int] = {}  # by channel, which the summary may name
        self.ticks: list[TickRange] = []  # runs of consecutive ticks, in the order of the file
        self.tick_count = 0
        self.stamp_ns_last = 0
        self.stamp_ns_first: int | None = None

    def damage(self, text: str, *, crc: bool = False) -> None:
        self.damage_count += 1
        self.crc_errors += crc
        if len(self.damages) < LISTED_MAX:
            self.damages.append(text)

    def tick(self, record: TickRecord) -> None:
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


def verify(path: str | os.PathLike[str]) -> Verdict:
    """Reads all of a recording and says what is there, damaged or missing; never raises."""
    findings = _Findings()
    try:
        with Source(Path(path)) as source:
            name = str(source.path)
            for part in source.parts():
                _look_at(part, source, findings)
    except errors.RecordingError as error:
        return Verdict(False, False, 0, (), (), (), 0, None, None, 0.0, (str(error),))
    return _verdict(name, findings)


def _look_at(part: Part, source: Source, findings: _Findings) -> None:
    match part:
        case salvage.Damage():
            findings.damage(f"byte {part.offset}, {part.size} bytes: {part.text}", crc=part.crc)
        case Metadata():
            findings.metadata[part.name] = part.values
        case Attachment():
            findings.attachments.add(part.name)
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


def _verdict(name: str, findings: _Findings) -> Verdict:
    gaps, duplicates, first, last = _continuity(findings.ticks)
    topics = _topics(findings)
    lost = sum(count.lost for count in topics)
    missing = [RUN_METADATA] if RUN_METADATA not in findings.metadata else []
    missing += [SCENARIO_NAME] if SCENARIO_NAME not in findings.attachments else []
    repaired = findings.metadata.get(REPAIR_METADATA)
    ok = (
        findings.complete
        and not (findings.damage_count or gaps or duplicates or lost or missing)
        and findings.tick_count > 0
    )
    sim_time_s = (findings.stamp_ns_last - (findings.stamp_ns_first or 0)) * 1e-9
    lines = [
        f"{name}: {'whole' if ok else 'NOT WHOLE'}"
        + ("" if findings.complete else ", not closed: the end of the run may be missing"),
        f"  ticks {first}..{last}, {sim_time_s:.2f} s"
        if findings.tick_count
        else "  holds no tick",
        *(
            f"  {count.topic[:40]:<12} expected {count.expected}, written {count.written}, "
            f"lost {count.lost}"
            for count in topics
        ),
        *(f"  missing: {what}" for what in missing),
        *(f"  lost ticks: {gap}" for gap in gaps),
        *([f"  {duplicates} ticks are there more than once"] if duplicates else []),
        *(f"  damaged: {text}" for text in findings.damages),
    ]
    if findings.damage_count > len(findings.damages):
        lines.append(f"  ... {findings.damage_count - len(findings.damages)} more damages")
    if repaired is not None:
        lines.append(f"  repaired: {repaired.get('text', '')}")
    return Verdict(
        ok=ok,
        complete=findings.complete,
        crc_errors=findings.crc_errors,
        damages=tuple(findings.damages),
        topics=topics,
        gaps=gaps,
        duplicates=duplicates,
        first_tick=first,
        last_tick=last,
        sim_time_s=sim_time_s,
        text=tuple(lines),
    )


def _continuity(
    ranges: list[TickRange],
) -> tuple[tuple[TickRange, ...], int, int | None, int | None]:
    """(gaps, duplicates, first, last) of runs of ticks in any order."""
    gaps: list[TickRange] = []
    duplicates = 0
    if not ranges:
        return (), 0, None, None
    ordered = sorted(ranges, key=lambda run: run.first)
    end = ordered[0].first - 1
    for run in ordered:
        if run.first > end + 1 and len(gaps) < LISTED_MAX:
            gaps.append(TickRange(end + 1, run.first - 1))
        duplicates += max(0, min(end, run.last) - run.first + 1)
        end = max(end, run.last)
    return tuple(gaps), duplicates, ordered[0].first, end


def _topics(findings: _Findings) -> tuple[TopicCount, ...]:
    """Counts of the file against those that the writer left in it, if it came to that."""
    try:
        text = findings.metadata.get(COUNTS_METADATA, {}).get("counts", "{}")
        noted = msgspec.json.decode(text, type=Counts)
    except (msgspec.DecodeError, ValueError, RecursionError):
        noted = Counts()
    expected = {count.topic: count for count in noted.topics}
    all_found = dict(findings.found)
    for channel, topic in findings.channels.items():
        all_found[topic] = all_found.get(topic, 0) + findings.others.pop(channel, 0)
    if findings.others:
        all_found["unknown"] = sum(findings.others.values())
    names = [*expected, *(topic for topic in all_found if topic not in expected)]
    result = []
    for topic in names:
        found = all_found.get(topic, 0)
        note = expected.get(topic, TopicCount(topic, found, found, found, 0))
        result.append(
            TopicCount(topic, note.expected, note.received, found, max(0, note.expected - found))
        )
    return tuple(result)
