"""Whether a recording is all that there was to record.

    run.mcap, run.1.mcap ... --look--> Findings of each --judge--> Verdict: all there? readable?
                              \\-- where they overlap, do they agree? --/

A segment that another continues may end anywhere, since that is how a killed world leaves it: what
counts is that every tick from the first to the end is there in order, that all is readable, and
that the last segment is closed.
"""

from __future__ import annotations

import os
import tomllib
from collections.abc import Sequence
from pathlib import Path

import msgspec

from swarm import compare
from swarm.findings import (
    LISTED_MAX,
    Findings,
    SegmentRow,
    all_topics_of,
    is_empty,
    look,
    topics_of,
    with_tail,
)
from swarm.messages import TickRecord
from swarm.playback import first_path, merged, segment_paths
from swarm.source import (
    REPAIR_METADATA,
    RUN_METADATA,
    SCENARIO_NAME,
    TICK_CONTENT,
    TickRange,
    TopicCount,
    tick_content,
)


class Verdict(msgspec.Struct, frozen=True):
    """What `verify` found."""

    ok: bool  # whole, undamaged, nothing lost
    complete: bool  # the last segment was closed properly
    crc_errors: int
    damages: tuple[str, ...]
    topics: tuple[TopicCount, ...]
    gaps: tuple[TickRange, ...]
    duplicates: int  # ticks that are more than once in one file
    misplaced: int  # ticks that come after a later one, and are passed over
    first_tick: int | None
    last_tick: int | None
    sim_time_s: float
    segments: tuple[SegmentRow, ...]
    disagreement: str | None  # where segments that overlap tell different things first
    text: tuple[str, ...]  # the same in lines for a person


def verify(path: str | os.PathLike[str], last_tick: int | None = None) -> Verdict:
    """Reads all of a run's recording and says what is there, damaged or missing; never raises.

    Args:
        last_tick: of the run, when it is known from elsewhere: a file that was cut, or mended
            since, cannot tell what came behind.
    """
    files = [look(file) for file in segment_paths(Path(path))]
    alone = files[0].path == first_path(Path(path))  # else the first file is not there
    return _judge(files, files[0].first_tick if alone else 0, last_tick)


def verify_file(path: Path) -> Verdict:
    """The same of one file alone."""
    findings = look(path)
    return _judge([findings], findings.first_tick, None)


# --- judging --------------------------------------------------------------------------------------


def _judge(files: list[Findings], begin: int, end: int | None) -> Verdict:
    """Verdict on all files of a run that should hold the ticks begin..end, as far as is known."""
    last = files[-1]
    if all(file.failure for file in files):
        return _nothing(files, end)
    runs = [run for file in files for run in file.ticks]
    disorders = [_disorder(file.ticks) for file in files]
    duplicates = sum(number for number, _ in disorders)
    misplaced = sum(number for _, number in disorders)
    gaps, gap_ticks, last_tick = _continuity(runs, begin)
    first_tick = min((run.first for run in runs), default=None)
    damages = _damages(files)
    missing = _missing(files)
    topics, disagreement = topics_of(last), None
    if len(files) > 1:
        toml = next((file.scenario_toml for file in files if file.scenario_toml is not None), b"")
        content, disagreement = _run_through(files, toml)
        topics = all_topics_of(files, content, gap_ticks)
    if end is not None and end > (-1 if last_tick is None else last_tick):
        gaps = (*gaps, TickRange(begin if last_tick is None else last_tick + 1, end))
        topics = with_tail(topics, end + 1 - begin)
    ok = (
        last.complete
        and last_tick is not None
        and not (
            damages
            or gaps
            or duplicates
            or misplaced
            or missing
            or disagreement
            or sum(count.lost for count in topics)
        )
    )
    stamps_ns = [file.stamp_ns_first for file in files if file.stamp_ns_first is not None]
    end_ns = max(file.stamp_ns_last for file in files)
    sim_time_s = (end_ns - min(stamps_ns, default=end_ns)) * 1e-9
    verdict = Verdict(
        ok=ok,
        complete=last.complete,
        crc_errors=sum(file.crc_errors for file in files),
        damages=tuple(damages[:LISTED_MAX]),
        topics=topics,
        gaps=gaps,
        duplicates=duplicates,
        misplaced=misplaced,
        first_tick=first_tick,
        last_tick=last_tick,
        sim_time_s=sim_time_s,
        segments=tuple(file.row() for file in files),
        disagreement=disagreement,
        text=(),
    )
    return msgspec.structs.replace(verdict, text=_lines(verdict, files, missing, len(damages)))


def _lines(
    verdict: Verdict, files: list[Findings], missing: list[str], damage_count: int
) -> tuple[str, ...]:
    """The verdict for a person."""
    lines = [
        f"{files[0].path}: {'whole' if verdict.ok else 'NOT WHOLE'}"
        + ("" if verdict.complete else ", not closed: the end of the run may be missing"),
        f"  ticks {verdict.first_tick}..{verdict.last_tick}, {verdict.sim_time_s:.2f} s"
        if verdict.last_tick is not None
        else "  holds no tick",
        *_seams(files),
        *(
            f"  {count.topic[:40]:<12} expected {count.expected}, received {count.received}, "
            f"written {count.written}, lost {count.lost}"
            for count in verdict.topics
        ),
        *(f"  missing: {what}" for what in missing),
        *(f"  lost ticks: {gap}" for gap in verdict.gaps),
    ]
    if verdict.duplicates:
        lines.append(f"  {verdict.duplicates} ticks are there more than once")
    if verdict.misplaced:
        lines.append(f"  {verdict.misplaced} ticks are out of order")
    if verdict.disagreement:
        lines.append(f"  segments disagree: {verdict.disagreement}")
    lines += [f"  damaged: {text}" for text in verdict.damages]
    if damage_count > len(verdict.damages):
        lines.append(f"  ... {damage_count - len(verdict.damages)} more damages")
    for file in files:
        repaired = file.metadata.get(REPAIR_METADATA)
        if repaired is not None:
            lines.append(f"  repaired: {file.path.name}: {repaired.get('text', '')}")
    return tuple(lines)


def _nothing(files: list[Findings], end: int | None) -> Verdict:
    """Verdict on what cannot be read at all."""
    gaps = () if end is None or end < 0 else (TickRange(0, end),)
    return Verdict(
        ok=False,
        complete=False,
        crc_errors=0,
        damages=(),
        topics=(),
        gaps=gaps,
        duplicates=0,
        misplaced=0,
        first_tick=None,
        last_tick=None,
        sim_time_s=0.0,
        segments=tuple(file.row() for file in files),
        disagreement=None,
        text=(*(file.failure for file in files), *(f"  lost ticks: {gap}" for gap in gaps)),
    )


def _damages(files: list[Findings]) -> list[str]:
    """All that cannot be read; the end of a file is none where another goes on with the run."""
    damages = []
    for number, file in enumerate(files):
        where = f"{file.path.name}: " if len(files) > 1 else ""
        continued = number < len(files) - 1
        if file.failure and not (continued and is_empty(file)):
            damages.append(file.failure)
        found = [*file.damages, *([] if continued else file.cuts)]
        more = file.damage_count - len(file.damages)
        found += [f"{more} more"] if more else []
        damages += [f"{where}{text}" for text in found]
    return damages


def _missing(files: list[Findings]) -> list[str]:
    """What every file should begin with, and whether they are of one run."""
    missing = []
    for number, file in enumerate(files):
        if file.failure or (number < len(files) - 1 and not file.ticks):
            continue
        where = f" in {file.path.name}" if len(files) > 1 else ""
        missing += [f"{RUN_METADATA}{where}"] if RUN_METADATA not in file.metadata else []
        missing += [f"{SCENARIO_NAME}{where}"] if file.scenario_toml is None else []
    identities = {
        file.metadata[RUN_METADATA].get("run", "")
        for file in files
        if RUN_METADATA in file.metadata
    }
    if len(identities) > 1:
        missing.append(f"one run in all files: got {', '.join(sorted(identities))[:200]}")
    return missing


def _seams(files: list[Findings]) -> list[str]:
    """How each segment ends and where the run goes on, in words."""
    lines = []
    for number, file in enumerate(files[:-1]):
        row, following = file.row(), files[number + 1].row()
        held = "holds no tick" if row.last_tick is None else f"ends at tick {row.last_tick}"
        how = "closed" if row.complete else "world killed"
        goes_on = (
            f"continued by {following.path}, which holds no tick"
            if following.first_tick is None
            else f"continued from tick {following.first_tick} by {following.path}"
        )
        lines.append(f"  segment {number} {held} ({how}), {goes_on}")
    return lines


def _run_through(
    files: Sequence[Findings], scenario_toml: bytes
) -> tuple[dict[str, int], str | None]:
    """(messages that the ticks of a run hold, first tick that two segments tell differently).

    In real time they may, and events are what happened to each world by itself.
    """
    mode, names = _clock_and_names(scenario_toml)
    content = dict.fromkeys(TICK_CONTENT, 0)
    disagreement: str | None = None
    later: TickRecord | None = None
    number_later = 0
    for record, number in merged([file.path for file in files], lambda number, damage: None):
        if later is None or later.tick != record.tick:
            later, number_later = record, number
            for topic, count in zip(TICK_CONTENT, tick_content(record), strict=True):
                content[topic] += count
        elif disagreement is None and mode == "lockstep":
            for robot, found in compare.tick_differences(record, later, names, events=False):
                disagreement = (
                    f"tick {record.tick}: {robot}: {found.field}: "
                    f"{compare.shown(found.one)} in {files[number].path.name}, "
                    f"{compare.shown(found.other)} in {files[number_later].path.name}"
                )
                break
    return content, disagreement


def _clock_and_names(scenario_toml: bytes) -> tuple[str, list[str]]:
    """Clock mode and robots' names of a resolved scenario, as far as it can be read."""
    try:
        raw = tomllib.loads(scenario_toml.decode())
        mode = str(raw.get("clock", {}).get("mode", "lockstep"))
        return mode, [str(row["name"]) for row in raw.get("robots", [])]
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return "lockstep", []


def _continuity(
    ranges: Sequence[TickRange], first_tick: int
) -> tuple[tuple[TickRange, ...], int, int | None]:
    """(gaps, ticks in them, last tick) of runs of ticks in any order, from `first_tick` on."""
    gaps: list[TickRange] = []
    missing = 0
    end = first_tick - 1
    for run in sorted(ranges, key=lambda run: run.first):
        if run.first > end + 1:
            missing += run.first - end - 1
            if len(gaps) < LISTED_MAX:
                gaps.append(TickRange(end + 1, run.first - 1))
        end = max(end, run.last)
    return tuple(gaps), missing, end if ranges else None


def _disorder(ranges: Sequence[TickRange]) -> tuple[int, int]:
    """(duplicates, misplaced): ticks of one file that are there again, or behind a later one."""
    passed_over, end = 0, -1
    for run in ranges:
        passed_over += max(0, min(end, run.last) - run.first + 1)
        end = max(end, run.last)
    duplicates, end = 0, -1
    for run in sorted(ranges, key=lambda run: run.first):
        duplicates += max(0, min(end, run.last) - run.first + 1)
        end = max(end, run.last)
    return duplicates, passed_over - duplicates
