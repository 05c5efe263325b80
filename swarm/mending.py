"""A good file of a damaged one: everything that can be read, and an account of what cannot.

    run.mcap --salvage--> Part ... --> run.mcap.part --> run.mcap     the old one: run.mcap.damaged

Every segment of a run is mended by itself, so that any MCAP reader can open each.
"""

from __future__ import annotations

import os
from pathlib import Path

import msgspec

from swarm import container, errors, salvage
from swarm.container import Channel, McapWriter
from swarm.playback import beginning, read, segment_paths
from swarm.source import (
    REPAIR_METADATA,
    TICK_TOPIC,
    Attachment,
    Metadata,
    Source,
    TickRange,
    decode_tick,
    is_tick,
)
from swarm.verdict import Verdict, verify, verify_file


class Repair(msgspec.Struct, frozen=True):
    """What was kept of a damaged recording, and what was lost."""

    paths: tuple[str, ...]  # files that were written anew; none when nothing had to be done
    damaged: tuple[str, ...]  # where those are whose place they took
    kept_ticks: int  # of the whole run
    kept_bytes: int
    lost_ticks: tuple[TickRange, ...]  # known gaps; what came after a cut nobody knows
    lost_bytes: int  # that could not be read, or were there twice
    text: tuple[str, ...]  # the same in lines for a person


def repair(path: str | os.PathLike[str]) -> Repair:
    """Makes every file of a run whole, with everything that can be read of it.

    A good file takes the place of the damaged one, which stays beside it as `*.damaged`; at no
    moment is there no file. A whole file is left as it is, and so is one with nothing to read.

    Raises:
        RecordingError: there is nothing of ours in any, or a new file cannot be written.
    """
    paths = segment_paths(Path(path))
    read(path)
    written: list[Path] = []
    damaged: list[Path] = []
    lines: list[str] = []
    lost_bytes = 0
    for file in paths:
        before = verify_file(file)
        try:
            beginning(file)
        except errors.RecordingError as error:
            lines.append(f"{error}: left as it is")
            continue
        if before.complete and not (before.damages or before.duplicates or before.misplaced):
            lines.append(f"{file}: whole, nothing to repair")
            continue
        lost, aside = _mend(file, before)
        lost_bytes += lost
        written.append(file)
        damaged.append(aside)
        lines.append(f"{file}: kept {_ticks(verify_file(file))} ticks, lost {lost} bytes")
        lines.append(f"  the damaged file is {aside}")
    after = verify(path)
    lines += [f"  lost ticks: {gap}" for gap in after.gaps]
    return Repair(
        paths=tuple(map(str, written)),
        damaged=tuple(map(str, damaged)),
        kept_ticks=_ticks(after),
        kept_bytes=sum(file.stat().st_size for file in paths if file.exists()),
        lost_ticks=after.gaps,
        lost_bytes=lost_bytes,
        text=tuple(lines),
    )


def _mend(file: Path, before: Verdict) -> tuple[int, Path]:
    """Puts a good file in the place of a damaged one; (bytes lost, where that is now)."""
    part = file.with_name(f"{file.name}.part")
    try:
        lost_bytes = _copy(file, part, before)
        aside = _set_aside(file)
        os.replace(part, file)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise errors.RecordingError(
            f"{file}: expected to write the repaired file, got: {error.strerror}"
        ) from error
    return lost_bytes, aside


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
    """Everything readable into a new file, in order and once; returns how many bytes were not."""
    with Source(source_path) as source, part.open("wb") as file:
        writer = container.start(file)
        lost_bytes = _copy_content(source, writer)
        text = f"{lost_bytes} bytes could not be read" + (
            "" if before.complete else "; the file had not been closed, its end may be missing"
        )
        writer.add_metadata(REPAIR_METADATA, {"text": text})
        writer.finish()  # type: ignore[no-untyped-call]
    return lost_bytes


def _copy_content(source: Source, writer: McapWriter) -> int:
    topics, ids = _copy_channels(source, writer)
    newest: dict[int, int] = {}  # by new channel: tick of its last message
    lost_bytes = 0
    for piece in source.parts():
        match piece:
            case salvage.Damage():
                lost_bytes += piece.size
            case Metadata():
                writer.add_metadata(piece.name, dict(piece.values))
            case Attachment():
                writer.add_attachment(0, 0, piece.name, piece.media_type, piece.data)
            case salvage.Message():
                tick = piece.sequence
                if is_tick(piece, topics):
                    record = decode_tick(piece.data)
                    tick = -1 if record is None else record.tick
                    if record is not None and piece.channel_id not in ids:
                        ids[piece.channel_id] = container.register_tick(writer)
                channel_id = ids.get(piece.channel_id)
                if channel_id is None or tick <= newest.get(channel_id, -1):
                    lost_bytes += len(piece.data)
                    continue
                newest[channel_id] = tick
                writer.add_message(
                    channel_id,
                    piece.log_time_ns,
                    piece.data,
                    piece.publish_time_ns,
                    piece.sequence,
                )
    return lost_bytes


def _copy_channels(source: Source, writer: McapWriter) -> tuple[dict[int, str], dict[int, int]]:
    """Registers every channel that is named anywhere, the summary included.

    The tick channel comes first, as in every file of ours.

    Returns:
        by old id: its topic, and its new id.
    """
    schemas: dict[int, salvage.Schema] = {}
    found: dict[int, salvage.Channel] = {}
    for piece in source.parts():
        match piece:
            case salvage.Schema():
                schemas.setdefault(piece.id, piece)
            case salvage.Channel():
                found.setdefault(piece.id, piece)
    ids: dict[int, int] = {}
    for channel in sorted(found.values(), key=lambda channel: channel.topic != TICK_TOPIC):
        schema = schemas.get(channel.schema_id, salvage.Schema(0, "", "", b""))
        ids[channel.id] = container.register(
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
    return {channel.id: channel.topic for channel in found.values()}, ids
