"""Any damage to a recording: what is left is read, judged, mended, and what is wrong is said."""

from __future__ import annotations

import os
import random
import struct
from itertools import pairwise
from pathlib import Path

import msgspec
import pytest
import tomli_w

from swarm import errors, recording, scenario
from swarm.messages import TickRecord
from swarm.run import difference, library, replay, why
from swarm.source import decode_tick
from swarm.verdict import verify_file
from tests.fuzz import mutations
from tests.fuzz.campaign import Campaign
from tests.run import test_replay

CASES = 20  # of a part
TICKS = 40
CUT_AFTER = 27  # the first segment, when there are two; the second begins at
CHECKPOINT = 20
REASONS = ("not closed", "missing: ", "lost ticks", "more than once", "out of order", "damaged: ",
           "segments disagree", "holds no tick", "expected a recording", "lost ")  # fmt: skip


class Good:
    """A recording of two robots, in one file and in two."""

    def __init__(self, folder: Path) -> None:
        settings = ("sensor.beams=72", "msam.sectors=36", "expect={}")
        _, where, data = library.read_scenario("two-obstacles")
        self.plan = scenario.decode(data, where, robots=2, settings=settings)
        self.toml = tomli_w.dumps(scenario.to_builtins(self.plan)).encode()
        swarm = test_replay.Swarm(self.plan)
        self.ticks = tuple(test_replay.run(swarm, lambda swarm, tick: None, TICKS))
        self.whole = self.write(folder / "whole.mcap", self.ticks)
        self.first = self.write(folder / "first.mcap", self.ticks[:CUT_AFTER], close=False)
        self.second = self.write(folder / "second.mcap", self.ticks[CHECKPOINT:], segment=1)

    def write(
        self,
        path: Path,
        ticks: tuple[TickRecord, ...],
        *,
        close: bool = True,
        segment: int = 0,
        toml: bytes | None = None,
    ) -> bytes:
        writer = recording.Writer(
            path, self.toml if toml is None else toml, {"run": "one"}, flush_ticks=8,
            now=lambda: 0.0, segment=segment, first_tick=CHECKPOINT if segment else 0,
        )  # fmt: skip
        for record in ticks:
            writer.write(record)
        writer.flush()
        if close:
            writer.close()
        return writer.path.read_bytes()


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Good:
    return Good(tmp_path_factory.mktemp("good"))


def blocks(data: bytes) -> list[bytes]:
    """Magic, then record by record, then the closing magic."""
    found, at = [data[:8]], 8
    while at + 9 <= len(data) - 8:
        end = at + 9 + int(struct.unpack_from("<Q", data, at + 1)[0])
        found.append(data[at:end])
        at = end
    return [*found, data[at:]]


def shuffled(draw: random.Random, data: bytes, other: bytes) -> bytes:
    """Whole records swapped, doubled, left out, borrowed, and garbage between them."""
    parts = blocks(data)
    for _ in range(draw.randrange(1, 4)):
        a, b = draw.randrange(len(parts)), draw.randrange(len(parts))
        match draw.randrange(5):
            case 0:
                parts[a], parts[b] = parts[b], parts[a]
            case 1:
                parts.insert(b, parts[a])
            case 2:
                del parts[a]
            case 3:
                parts.insert(a, draw.choice(blocks(other)))
            case _:
                parts.insert(a, draw.randbytes(draw.choice((1, 9, 500))))
        parts = parts or [b""]
    return b"".join(parts)


def retold(draw: random.Random, good: Good, path: Path) -> bytes:
    """A file in good order that tells of other things: fields altered, ticks gone, scenario too."""
    ticks = list(good.ticks)
    for _ in range(draw.randrange(1, 4)):
        at = draw.randrange(len(ticks))
        match draw.randrange(6):
            case 0:
                del ticks[at]
            case 1:
                ticks.insert(draw.randrange(len(ticks)), ticks[at])
            case _:
                ticks[at] = _other(draw, ticks[at])
    toml = mutations.damaged(draw, good.toml) if draw.random() < 0.2 else None
    return good.write(path, tuple(ticks), toml=toml)


def _other(draw: random.Random, record: TickRecord) -> TickRecord:
    """A tick with other fields that is one all the same; most alterations are none."""
    payload = msgspec.msgpack.encode(record)
    for _ in range(50):
        other = decode_tick(mutations.altered_message(draw, payload))
        if other is not None:
            return other
    return record


class Case:
    """A folder with damaged files."""

    def __init__(self, draw: random.Random, good: Good, folder: Path) -> None:
        folder.mkdir()
        self.folder = folder
        self.told = True  # whether every tick in it was one of the good recording
        choice = draw.randrange(8)
        files = {"run.mcap": good.whole}
        if choice >= 5:
            files = {"run.mcap": good.first, "run.1.mcap": good.second}
        name = draw.choice(list(files))
        data, other = files[name], draw.choice((good.whole, good.first, good.second))
        if choice in (0, 1, 5):
            files[name] = mutations.damaged(draw, data, other)
        elif choice in (2, 3, 6):
            files[name] = shuffled(draw, data, other)
        elif choice == 4:
            self.told = False
            files[name] = retold(draw, good, folder / "run.mcap")
        else:
            files[name] = data[: draw.randrange(len(data) + 1)]
        self.data = files[name]
        self.same = files in (
            {"run.mcap": good.whole},
            {"run.mcap": good.first, "run.1.mcap": good.second},
        )
        for name, data in files.items():
            (folder / name).write_bytes(data)


def test_damaged_recordings_are_read_judged_mended_and_replayed(
    campaign: Campaign, good: Good, tmp_path: Path
) -> None:
    draw = campaign.draw
    for number in range(CASES):
        case = Case(draw, good, tmp_path / str(number))
        moment = draw.randrange(TICKS), draw.choice(("leader", "robot1"))
        with campaign.case(number, str(case.folder), case.data):
            kept = check_read(case, good)
            check_verdict(case, kept)
            check_replay(case)
            check_questions(case, good, *moment)
            check_repair(case, kept)


def check_read(case: Case, good: Good) -> list[TickRecord]:
    try:
        kept = list(recording.read(case.folder).ticks)
    except errors.RecordingError as error:
        assert "expected" in str(error)  # noqa: PT017
        return []
    assert all(a.tick < b.tick for a, b in pairwise(kept))
    if case.told:
        assert all(record == good.ticks[record.tick] for record in kept)
    return kept


def check_verdict(case: Case, kept: list[TickRecord]) -> None:
    verdict = recording.verify(case.folder)
    assert verdict.text
    if not verdict.ok:
        assert any(reason in line for line in verdict.text for reason in REASONS), verdict.text
    found = {count.topic: count.written for count in verdict.topics}.get("tick", 0)
    if len(verdict.segments) == 1:
        found -= verdict.duplicates + verdict.misplaced
    assert found == len(kept)
    if case.same:
        assert verdict.ok
    if verdict.ok:
        assert [record.tick for record in kept] == list(range(len(kept)))


def check_repair(case: Case, kept: list[TickRecord]) -> None:
    before = recording.verify(case.folder)
    try:
        repaired = recording.repair(case.folder)
    except errors.RecordingError as error:
        assert "expected" in str(error)  # noqa: PT017
        assert kept == []
        return
    assert repaired.text
    after = recording.verify(case.folder)
    assert list(recording.read(case.folder).ticks) == kept
    assert (after.duplicates, after.misplaced) == (0, 0)
    for path in repaired.paths:
        alone = verify_file(Path(path))
        assert alone.complete
        assert alone.crc_errors == 0
    if before.ok and before.segments[0].complete:
        assert repaired.paths == ()
    assert not [name for name in os.listdir(case.folder) if name.endswith(".part")]


def check_replay(case: Case) -> None:
    try:
        found = replay.replay(case.folder)
    except errors.SwarmError as error:
        assert "expected" in str(error)  # noqa: PT017
        return
    if not found.ok:
        hashes = found.state_hash != found.recorded_hash
        assert found.difference or found.missing or found.cut or found.ticks == 0 or hashes
    if case.told:
        assert found.difference is None


def check_questions(case: Case, good: Good, tick: int, name: str) -> None:
    for ask in (
        lambda: difference.difference(case.folder, case.folder),
        lambda: why.why(case.folder, name, tick * good.plan.dt_s),
    ):
        try:
            ask()
        except errors.SwarmError as error:
            assert "expected" in str(error)  # noqa: PT017
