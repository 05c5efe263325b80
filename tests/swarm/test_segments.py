"""A world that was killed and started again leaves several files, and every reader sees one run."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from swarm import errors, messages, recording
from swarm.messages import TickRecord

Ticks = tuple[TickRecord, ...]
MakeTicks = Callable[..., Ticks]

SCENARIO = b'title = "made up"\n[[robots]]\nname = "robot1"\n[[robots]]\nname = "robot2"\n'
REALTIME = SCENARIO + b'[clock]\nmode = "realtime"\n'


@pytest.fixture(scope="module")
def ticks(made_ticks: MakeTicks) -> Ticks:
    return made_ticks(2, 60, beams=24)


def write(
    folder: Path,
    number: int,
    ticks: Ticks,
    *,
    close: bool = False,
    run: str = "one",
    first_tick: int | None = None,
    scenario: bytes = SCENARIO,
) -> recording.Writer:
    """One segment; not closed it is what a killed world leaves, its last ticks in no file."""
    begin = ticks[0].tick if first_tick is None and ticks else first_tick or 0
    writer = recording.Writer(
        folder, scenario, {"run": run}, flush_s=1e9, now=lambda: 0.0,
        segment=number, first_tick=begin,
    )  # fmt: skip
    for record in ticks:
        writer.write(record)
    if close:
        writer.close()
    return writer


def changed(record: TickRecord) -> TickRecord:
    """The same tick with one number that is not the same."""
    moved = msgspec.structs.replace(record.robots[1], obstacle_clearance_m=1.5)
    return msgspec.structs.replace(record, robots=(record.robots[0], moved))


def test_segments_are_one_run_when_each_begins_at_a_checkpoint(
    ticks: Ticks, tmp_path: Path
) -> None:
    write(tmp_path, 0, ticks[:30])  # 0..23 are in the file, the rest had not been flushed
    write(tmp_path, 1, ticks[20:50])  # 20..43
    write(tmp_path, 2, ticks[44:], close=True)
    found = recording.read(tmp_path)
    assert [path.name for path in found.paths] == ["run.mcap", "run.1.mcap", "run.2.mcap"]
    assert tuple(found.ticks) == ticks
    assert not found.cut
    assert found.scenario_toml == SCENARIO
    verdict = recording.verify(tmp_path / "run.mcap")
    assert verdict.ok
    assert verdict.complete
    assert [(row.first_tick, row.last_tick, row.complete) for row in verdict.segments] == [
        (0, 23, False),
        (20, 43, False),
        (44, 59, True),
    ]
    assert verdict.topics == (
        recording.TopicCount("tick", 60, 60, 60, 0),
        recording.TopicCount("frame", 120, 120, 120, 0),
        recording.TopicCount("command", 118, 118, 118, 0),
        recording.TopicCount("event", 1, 1, 1, 0),
    )
    said = "\n".join(verdict.text)
    assert "segment 0 ends at tick 23 (world killed), continued from tick 20 by run.1.mcap" in said
    assert "segment 1 ends at tick 43 (world killed), continued from tick 44 by run.2.mcap" in said


def test_later_segment_counts_where_two_overlap(ticks: Ticks, tmp_path: Path) -> None:
    write(tmp_path, 0, ticks[:24])
    later = tuple(changed(record) for record in ticks[12:36])
    write(tmp_path, 1, later, close=True)
    assert tuple(recording.read(tmp_path).ticks) == ticks[:12] + later


def test_earlier_segment_fills_what_the_later_one_lost(ticks: Ticks, tmp_path: Path) -> None:
    write(tmp_path, 0, ticks[:24])
    write(tmp_path, 1, ticks[12:16] + ticks[20:36], close=True, first_tick=12)
    assert tuple(recording.read(tmp_path).ticks) == ticks[:36]


def test_verify_names_the_first_tick_that_segments_tell_differently(
    ticks: Ticks, tmp_path: Path
) -> None:
    write(tmp_path, 0, ticks[:24])
    write(tmp_path, 1, (*ticks[12:17], changed(ticks[17]), *ticks[18:36]), close=True)
    verdict = recording.verify(tmp_path)
    assert not verdict.ok
    assert verdict.disagreement == (
        "tick 17: robot2: robot.obstacle_clearance_m: 2.0 in run.mcap, 1.5 in run.1.mcap"
    )
    assert verdict.gaps == ()


def test_segments_need_not_agree_in_real_time_nor_on_events(ticks: Ticks, tmp_path: Path) -> None:
    again = changed(ticks[17])
    for name, scenario, record in (("realtime", REALTIME, again), ("events", SCENARIO, ticks[17])):
        folder = tmp_path / name
        folder.mkdir()
        restarted = msgspec.structs.replace(
            record, events=(messages.Event(17, record.stamp_ns, "recording", None, "x"),)
        )
        write(folder, 0, ticks[:24], scenario=scenario)
        write(folder, 1, (restarted, *ticks[18:36]), close=True, scenario=scenario)
        assert recording.verify(folder).ok


def test_gap_between_segments_is_lost_ticks(ticks: Ticks, tmp_path: Path) -> None:
    write(tmp_path, 0, ticks[:24])
    write(tmp_path, 1, ticks[30:], close=True)
    verdict = recording.verify(tmp_path)
    assert not verdict.ok
    assert verdict.gaps == (recording.TickRange(24, 29),)
    assert verdict.topics[0] == recording.TopicCount("tick", 60, 54, 54, 6)
    assert "  lost ticks: 24..29" in verdict.text


def test_run_is_not_whole_when_its_last_segment_is_cut(ticks: Ticks, tmp_path: Path) -> None:
    write(tmp_path, 0, ticks[:24])
    write(tmp_path, 1, ticks[20:44])
    verdict = recording.verify(tmp_path)
    assert (verdict.ok, verdict.complete, verdict.last_tick) == (False, False, 43)
    found = recording.read(tmp_path)
    assert tuple(found.ticks) == ticks[:44]
    assert found.cut


@pytest.mark.parametrize("empty", [0, 1])
def test_segment_that_was_killed_before_its_first_byte_is_passed_over(
    ticks: Ticks, tmp_path: Path, empty: int
) -> None:
    files = [ticks[:24], ticks[20:]] if empty == 0 else [ticks[:24], (), ticks[20:]]
    if empty == 0:
        (tmp_path / "run.mcap").write_bytes(b"")
        write(tmp_path, 1, ticks, close=True)
    else:
        write(tmp_path, 0, files[0])
        write(tmp_path, 1, (), first_tick=20)  # header only
        write(tmp_path, 2, files[2], close=True)
    found = recording.read(tmp_path)
    assert found.scenario_toml == SCENARIO
    assert tuple(found.ticks) == ticks
    verdict = recording.verify(tmp_path)
    assert verdict.ok, verdict.text
    assert f"segment {empty} holds no tick (world killed), continued" in "\n".join(verdict.text)


def test_file_of_another_run_is_noticed(ticks: Ticks, tmp_path: Path) -> None:
    write(tmp_path, 0, ticks[:24])
    write(tmp_path, 1, ticks[20:], close=True, run="another")
    verdict = recording.verify(tmp_path)
    assert not verdict.ok
    assert "  missing: one run in all files: got another, one" in verdict.text


def test_damage_in_an_earlier_segment_is_no_ordinary_end(ticks: Ticks, tmp_path: Path) -> None:
    write(tmp_path, 0, ticks[:24])
    path = tmp_path / "run.mcap"
    damaged = bytearray(path.read_bytes())
    damaged[damaged.rindex(b"\x03\x00\x00\x00lz4") + 500] ^= 1  # in the last of its chunks
    path.write_bytes(damaged)
    write(tmp_path, 1, ticks[12:], close=True)
    verdict = recording.verify(tmp_path)
    assert (verdict.ok, verdict.crc_errors, verdict.gaps) == (False, 1, ())
    assert tuple(recording.read(tmp_path).ticks) == ticks


def test_one_segment_alone_is_whole_from_where_it_begins(ticks: Ticks, tmp_path: Path) -> None:
    write(tmp_path, 0, ticks[:24])
    write(tmp_path, 1, ticks[20:], close=True)
    verdict = recording.verify(tmp_path / "run.1.mcap")
    assert (verdict.ok, verdict.first_tick, verdict.last_tick) == (True, 20, 59)
    assert not recording.verify(tmp_path / "run.mcap").segments[0].complete


def test_repair_makes_every_segment_whole_and_changes_no_tick(ticks: Ticks, tmp_path: Path) -> None:
    write(tmp_path, 0, ticks[:24])
    write(tmp_path, 1, ticks[20:44])
    write(tmp_path, 2, ticks[40:], close=True)
    (tmp_path / "run.3.mcap").write_bytes(b"")
    assert not recording.verify(tmp_path).ok  # a fourth world that never came to write
    (tmp_path / "run.3.mcap").unlink()
    repaired = recording.repair(tmp_path)
    assert [Path(path).name for path in repaired.paths] == ["run.mcap", "run.1.mcap"]
    assert repaired.kept_ticks == 60
    assert repaired.lost_bytes == 0
    assert tuple(recording.read(tmp_path).ticks) == ticks
    verdict = recording.verify(tmp_path)
    assert verdict.ok
    assert [row.complete for row in verdict.segments] == [True, True, True]
    assert recording.repair(tmp_path).paths == ()


def test_ticks_before_gives_what_a_resumed_world_needs(ticks: Ticks, tmp_path: Path) -> None:
    assert recording.next_segment(tmp_path) == 0
    write(tmp_path, 0, ticks[:24])
    assert recording.next_segment(tmp_path) == 1
    write(tmp_path, 1, (), first_tick=20)
    assert recording.next_segment(tmp_path) == 2
    assert tuple(recording.ticks_before(tmp_path, 20)) == ticks[:20]
    assert tuple(recording.ticks_before(tmp_path, 0)) == ()
    with pytest.raises(errors.RecordingError, match="every tick before 25, got no tick 24"):
        list(recording.ticks_before(tmp_path, 25))


def test_flush_puts_everything_written_so_far_on_disk(ticks: Ticks, tmp_path: Path) -> None:
    writer = write(tmp_path, 0, ticks[:5])
    assert list(recording.read(tmp_path).ticks) == []
    assert writer.flush()
    assert tuple(recording.read(tmp_path).ticks) == ticks[:5]
    writer.disk_full = True
    writer.write(ticks[5])
    assert not writer.flush()
    writer.disk_full = False
    assert writer.flush()
    assert tuple(recording.read(tmp_path).ticks) == ticks[:6]


def test_disk_full_for_a_while_loses_nothing_and_is_said_once(ticks: Ticks, tmp_path: Path) -> None:
    writer = write(tmp_path, 0, ticks[:12])
    writer.disk_full = True
    for record in ticks[12:40]:
        writer.write(record)
    said = writer.failure
    assert said is not None
    assert "at tick 23, got: No space left on device; still trying" in said
    writer.disk_full = False
    for record in ticks[40:]:
        writer.write(record)
    assert writer.close().total.lost == 0
    assert writer.failure == said
    assert writer.lost_ticks == ()
    assert recording.verify(tmp_path).ok


def test_disk_full_to_the_end_names_the_ticks_it_cost(
    ticks: Ticks, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recording, "BACKLOG_BYTES_MAX", 100)
    writer = write(tmp_path, 0, ticks[:12])
    for full, begin, end in ((True, 12, 26), (False, 26, 38), (True, 38, 60)):
        writer.disk_full = full
        for record in ticks[begin:end]:
            writer.write(record)
    writer.close()
    # A batch of 12 waits in memory, what comes while it does is lost, and so is what waits at last.
    assert writer.lost_ticks == (recording.TickRange(24, 25), recording.TickRange(38, 59))
    assert writer.counts.topics[0].lost == 24


def test_counts_go_on_from_the_segments_before(ticks: Ticks, tmp_path: Path) -> None:
    write(tmp_path, 0, ticks[:24])
    writer = write(tmp_path, 1, (), first_tick=20)
    for record in recording.ticks_before(tmp_path, 20):
        writer.has(record)
    for record in ticks[20:]:
        writer.write(record)
    writer.close()
    assert writer.counts.topics[0] == recording.TopicCount("tick", 60, 60, 60, 0)
    assert recording.verify(tmp_path / "run.1.mcap").topics[0].expected == 40


def test_run_whose_first_file_was_never_opened_is_read_and_one_that_lost_it_is_not_whole(
    ticks: Ticks, tmp_path: Path
) -> None:
    write(tmp_path, 1, ticks, close=True)
    assert recording.next_segment(tmp_path) == 2
    assert recording.verify(tmp_path).ok
    assert tuple(recording.read(tmp_path / "run.mcap").ticks) == ticks
    (tmp_path / "run.1.mcap").unlink()
    write(tmp_path, 1, ticks[20:], close=True)
    verdict = recording.verify(tmp_path)
    assert not verdict.ok
    assert verdict.gaps == (recording.TickRange(0, 19),)
    assert recording.verify(tmp_path / "run.1.mcap").ok
