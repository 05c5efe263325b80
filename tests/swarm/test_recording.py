"""A recording gives back what was written, says what is missing, and survives what befalls it.

mcap's own reader is the second opinion on whole and repaired files.
"""

from __future__ import annotations

import contextlib
import os
import resource
import struct
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import hypothesis
import msgspec
import numpy as np
import pytest
from hypothesis import strategies
from mcap.reader import make_reader
from mcap.writer import Writer as McapWriter

from swarm import container, errors, messages, recording, salvage
from swarm.messages import TickRecord

Ticks = tuple[TickRecord, ...]
MakeTicks = Callable[..., Ticks]

SCENARIO = b'title = "made up"\n'
METADATA = {"seed": "7", "scenario": "made up"}
PLACE = {"segment": "0", "first_tick": "0"}
COUNT = 30  # ticks: two whole flushes of 12 and a bit


def even_ticks(record: TickRecord) -> bytes | None:
    return str(record.tick).encode() if record.tick % 2 == 0 else None


EVEN = recording.Channel("even", "text", "text", b"a number", "text", even_ticks)


def write(path: Path, ticks: Ticks, *, close: bool = True, extra: bool = True) -> recording.Writer:
    writer = recording.Writer(
        path, SCENARIO, METADATA, (EVEN,) if extra else (), flush_s=1e9, now=lambda: 0.0
    )
    for record in ticks:
        writer.write(record)
    if close:
        writer.close()
    return writer


@pytest.fixture(scope="module")
def whole(made_ticks: MakeTicks, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("whole") / "run.mcap"
    write(path, made_ticks(3, COUNT, beams=24))
    return path.read_bytes()


@pytest.fixture(scope="module")
def ticks(made_ticks: MakeTicks) -> Ticks:
    return made_ticks(3, COUNT, beams=24)


def messages_read_by_mcap(path: Path) -> dict[str, int]:
    counts: dict[str, int] = {}
    with path.open("rb") as file:
        for _, channel, _ in make_reader(file, validate_crcs=True).iter_messages():
            counts[channel.topic] = counts.get(channel.topic, 0) + 1
    return counts


# --- whole files ----------------------------------------------------------------------------------


@pytest.mark.parametrize(("robots", "beams"), [(1, 24), (6, 216), (100, 216)])
def test_read_gives_back_the_same_ticks(
    made_ticks: MakeTicks, tmp_path: Path, robots: int, beams: int
) -> None:
    ticks = made_ticks(robots, 15, beams=beams)
    write(tmp_path, ticks)
    found = recording.read(tmp_path)
    assert tuple(found.ticks) == ticks
    assert tuple(found.ticks) == ticks  # and again
    assert not found.cut
    assert (found.metadata, found.scenario_toml) == (METADATA | PLACE, SCENARIO)


def test_read_gives_back_every_bit_of_the_ranges(ticks: Ticks, tmp_path: Path) -> None:
    odd = np.array([np.inf, 0.0, 1e-45, 3.4e38, 0.1], np.float32)
    frame = msgspec.structs.replace(ticks[0].frames[0], ranges=messages.array(odd))
    write(tmp_path, (msgspec.structs.replace(ticks[0], frames=(frame,)),))
    (back,) = recording.read(tmp_path).ticks
    assert back.frames[0].ranges.numpy().tobytes() == odd.tobytes()


def test_file_is_read_by_mcap_itself(ticks: Ticks, tmp_path: Path) -> None:
    write(tmp_path / "run.mcap", ticks)
    with (tmp_path / "run.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        rows = list(reader.iter_messages(topics="tick"))
        metadata = {record.name: record.metadata for record in reader.iter_metadata()}
        attached = {record.name: record.data for record in reader.iter_attachments()}
    assert [message.sequence for _, _, message in rows] == list(range(COUNT))
    assert [message.log_time for _, _, message in rows] == [tick.stamp_ns for tick in ticks]
    assert metadata["run"] == METADATA | PLACE
    assert attached == {"scenario.toml": SCENARIO}
    assert messages_read_by_mcap(tmp_path / "run.mcap") == {"tick": COUNT, "even": COUNT // 2}


def test_schema_text_names_every_field_of_a_tick() -> None:
    text = container.schema_text()
    for struct_type in (TickRecord, messages.Beacon, messages.Trace):
        for field in struct_type.__struct_fields__:
            assert f"{field}:" in text
    assert text.startswith("TickRecord = [tick: Tick, stamp_ns: Stamp, robots: ")


def test_counts_are_those_of_the_ticks(ticks: Ticks, tmp_path: Path) -> None:
    counts = write(tmp_path, ticks).counts
    expected = {"tick": 30, "frame": 90, "command": 87, "event": 1, "even": 15}
    assert {row.topic: row.expected for row in counts.topics} == expected
    assert {row.topic: row.received for row in counts.topics} == expected
    assert {row.topic: row.written for row in counts.topics} == expected
    assert counts.total == recording.TopicCount("total", 223, 223, 223, 0)
    verdict = recording.verify(tmp_path)
    assert verdict.ok
    assert verdict.topics == counts.topics
    assert (verdict.first_tick, verdict.last_tick) == (0, 29)
    assert verdict.sim_time_s == pytest.approx(29 * 0.08)


def test_verify_is_not_content_when_ticks_never_came(ticks: Ticks, tmp_path: Path) -> None:
    writer = write(tmp_path, ticks[:5] + ticks[8:])
    assert writer.counts.topics[0] == recording.TopicCount("tick", 30, 27, 27, 3)
    verdict = recording.verify(tmp_path)
    assert not verdict.ok
    assert verdict.complete
    assert verdict.gaps == (recording.TickRange(5, 7),)
    assert "  lost ticks: 5..7" in verdict.text


def test_verify_counts_ticks_that_are_there_twice(ticks: Ticks, tmp_path: Path) -> None:
    write(tmp_path, ticks[:10] + ticks[7:12])
    verdict = recording.verify(tmp_path)
    assert (verdict.ok, verdict.duplicates, verdict.gaps) == (False, 3, ())


# --- how soon it is safe --------------------------------------------------------------------------


def test_writer_is_readable_at_once_when_killed_before_the_first_tick(tmp_path: Path) -> None:
    write(tmp_path, (), close=False)
    found = recording.read(tmp_path)
    assert (found.metadata, found.scenario_toml) == (METADATA | PLACE, SCENARIO)
    assert (list(found.ticks), found.cut) == ([], True)


def test_writer_loses_less_than_a_flush_when_killed(ticks: Ticks, tmp_path: Path) -> None:
    write(tmp_path, ticks, close=False)  # nothing more reaches the file, as after kill -9
    found = recording.read(tmp_path)
    assert tuple(found.ticks) == ticks[:24]
    assert found.cut


def test_writer_flushes_by_the_wall_clock_when_ticks_are_slow(ticks: Ticks, tmp_path: Path) -> None:
    clock = iter([0.0, 0.0, 0.1, 0.3, 0.6, 0.6, 0.7])
    writer = recording.Writer(tmp_path, SCENARIO, METADATA, flush_s=0.5, now=lambda: next(clock))
    for record in ticks[:3]:
        writer.write(record)
    assert tuple(recording.read(tmp_path).ticks) == ticks[:3]
    writer.write(ticks[3])
    assert tuple(recording.read(tmp_path).ticks) == ticks[:3]


def test_close_can_be_called_twice(ticks: Ticks, tmp_path: Path) -> None:
    with write(tmp_path, ticks, close=False) as writer:
        pass
    assert writer.close() == writer.counts
    assert recording.verify(tmp_path).ok


# --- disks ----------------------------------------------------------------------------------------


@pytest.fixture
def small_disk() -> Iterator[Callable[[int], None]]:
    """Files may not grow beyond so many bytes: real, partial, failing writes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)

    def limit(size: int) -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))

    yield limit
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_writer_refuses_a_folder_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(errors.RecordingError, match="expected a place for the recording, got: No"):
        recording.Writer(tmp_path / "none" / "run.mcap", SCENARIO, METADATA)


def test_writer_goes_on_and_loses_nothing_when_the_disk_is_full_for_a_while(
    ticks: Ticks, tmp_path: Path, small_disk: Callable[[int], None]
) -> None:
    writer = write(tmp_path, ticks[:12], close=False)
    small_disk((tmp_path / "run.mcap").stat().st_size + 100)
    for record in ticks[12:27]:
        writer.write(record)
    assert writer.failure is not None
    assert "File too large; still trying" in writer.failure
    assert writer.counts.topics[0] == recording.TopicCount("tick", 27, 27, 12, 0)
    small_disk(resource.RLIM_INFINITY)
    for record in ticks[27:]:
        writer.write(record)
    assert writer.close().total.lost == 0
    assert recording.verify(tmp_path).ok
    assert tuple(recording.read(tmp_path).ticks) == ticks
    assert messages_read_by_mcap(tmp_path / "run.mcap")["tick"] == COUNT


def test_close_names_what_is_lost_when_the_disk_stays_full(
    ticks: Ticks, tmp_path: Path, small_disk: Callable[[int], None]
) -> None:
    writer = write(tmp_path, ticks[:12], close=False)
    size = (tmp_path / "run.mcap").stat().st_size
    small_disk(size + 100)
    for record in ticks[12:]:
        writer.write(record)
    counts = writer.close()
    small_disk(resource.RLIM_INFINITY)
    assert counts.topics[0] == recording.TopicCount("tick", 30, 30, 12, 18)
    assert writer.lost_ticks == (recording.TickRange(12, 29),)
    assert (tmp_path / "run.mcap").stat().st_size == size  # no half of anything stays
    found = recording.read(tmp_path)
    assert tuple(found.ticks) == ticks[:12]
    assert found.cut


def test_writer_loses_ticks_in_the_middle_when_too_much_waits(
    ticks: Ticks,
    tmp_path: Path,
    small_disk: Callable[[int], None],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(recording, "BACKLOG_BYTES_MAX", 100)
    writer = write(tmp_path, ticks[:12], close=False)
    small_disk((tmp_path / "run.mcap").stat().st_size)
    for record in ticks[12:27]:
        writer.write(record)
    small_disk(resource.RLIM_INFINITY)
    for record in ticks[27:]:
        writer.write(record)
    counts = writer.close()
    assert counts.topics[0] == recording.TopicCount("tick", 30, 30, 27, 3)
    assert writer.lost_ticks == (recording.TickRange(24, 26),)
    verdict = recording.verify(tmp_path)
    assert (verdict.ok, verdict.complete, verdict.damages) == (False, True, ())
    assert verdict.gaps == (recording.TickRange(24, 26),)
    assert verdict.topics[0].lost == 3


def test_writer_survives_a_disk_that_takes_nothing(ticks: Ticks) -> None:
    writer = write(Path("/dev/full"), ticks)
    assert writer.failure is not None
    assert "No space left on device" in writer.failure
    assert writer.counts.topics[0] == recording.TopicCount("tick", 30, 30, 0, 30)


# --- files that are not ours ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "an empty file"),
        (b"\x89MCAP0\r\n", "something else"),
        (b"hello", "something else"),
        (b"\x00" * 100_000, "something else"),
        (np.random.default_rng(1).bytes(100_000), "something else"),
    ],
)
def test_read_says_what_it_got_when_it_is_not_a_recording(
    tmp_path: Path, content: bytes, said: str
) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(content)
    with pytest.raises(errors.RecordingError, match=said):
        recording.read(path)
    with pytest.raises(errors.RecordingError, match=said):
        recording.repair(path)
    assert not recording.verify(path).ok
    assert os.listdir(tmp_path) == ["run.mcap"]


def test_read_names_the_profile_of_a_strange_mcap(tmp_path: Path) -> None:
    with (tmp_path / "run.mcap").open("wb") as file:
        writer = McapWriter(file)
        writer.start(profile="ros2")
        writer.finish()
    with pytest.raises(errors.RecordingError, match="profile 'ros2'"):
        recording.read(tmp_path)


def test_verify_does_not_raise_when_there_is_no_file(tmp_path: Path) -> None:
    verdict = recording.verify(tmp_path / "none")
    assert not verdict.ok
    assert "No such file" in verdict.text[0]


# --- damage ---------------------------------------------------------------------------------------


def test_read_and_repair_keep_all_that_is_whole_when_the_file_is_cut_anywhere(
    ticks: Ticks, whole: bytes, tmp_path: Path
) -> None:
    ends = [*range(8, len(whole), 997), *record_ends(whole)]
    path = tmp_path / "run.mcap"
    kept_before = 0
    for end in sorted(ends):
        path.write_bytes(whole[:end])
        try:
            found = recording.read(path)
        except errors.RecordingError:
            assert end < frames(whole)[0][2]  # not even the header
            continue
        kept = tuple(found.ticks)
        assert kept == ticks[: len(kept)]
        assert len(kept) >= kept_before
        assert found.cut or end == len(whole)
        verdict = recording.verify(path)
        assert not verdict.ok or end == len(whole)
        kept_before = len(kept)
    assert kept_before == COUNT


@pytest.mark.parametrize("share", [0.5, 0.6, 0.7, 0.9, 0.99])
def test_repair_makes_a_whole_file_of_a_cut_one(
    ticks: Ticks, whole: bytes, tmp_path: Path, share: float
) -> None:
    path = tmp_path / "run.mcap"
    cut = whole[: int(share * len(whole))]
    path.write_bytes(cut)
    kept = tuple(recording.read(path).ticks)
    assert kept
    repaired = recording.repair(tmp_path)
    assert (tmp_path / "run.mcap.damaged").read_bytes() == cut
    assert repaired.kept_ticks == len(kept)
    assert tuple(recording.read(path).ticks) == kept
    assert recording.verify(path).ok
    assert recording.verify(path).text[-1].startswith("  repaired: ")
    assert messages_read_by_mcap(path) == {"tick": len(kept), "even": (len(kept) + 1) // 2}
    assert sorted(os.listdir(tmp_path)) == ["run.mcap", "run.mcap.damaged"]
    assert recording.repair(tmp_path).paths == ()  # nothing left to do


def test_repair_leaves_the_first_damaged_file_alone_when_it_is_needed_again(
    whole: bytes, tmp_path: Path
) -> None:
    for end in (len(whole) // 2, len(whole) // 2 + 1000):
        (tmp_path / "run.mcap").write_bytes(whole[:end])
        recording.repair(tmp_path)
    assert (tmp_path / "run.mcap.damaged").stat().st_size == len(whole) // 2
    assert (tmp_path / "run.mcap.damaged1").stat().st_size == len(whole) // 2 + 1000


@pytest.mark.parametrize("chunk", [0, 1, 2])
def test_repair_loses_one_chunk_when_its_length_is_damaged(
    ticks: Ticks, whole: bytes, tmp_path: Path, chunk: int
) -> None:
    """The frame is unreadable, so the next chunk has to be found by its looks."""
    damaged = bytearray(whole)
    damaged[chunks(whole)[chunk] + 6] ^= 0x40  # the length is now 2^46 more
    path = tmp_path / "run.mcap"
    path.write_bytes(damaged)
    missing = [range(12), range(12, 24), range(24, COUNT)][chunk]
    left = tuple(record for record in ticks if record.tick not in missing)
    found = recording.read(path)
    assert tuple(found.ticks) == left
    assert found.cut
    assert not recording.verify(path).ok
    recording.repair(path)
    assert tuple(recording.read(path).ticks) == left
    assert messages_read_by_mcap(path)["tick"] == len(left)


def test_repair_knows_all_channels_from_the_summary_when_the_first_chunk_is_lost(
    ticks: Ticks, whole: bytes, tmp_path: Path
) -> None:
    damaged = bytearray(whole)
    damaged[chunks(whole)[0] + 200] ^= 1
    path = tmp_path / "run.mcap"
    path.write_bytes(damaged)
    verdict = recording.verify(path)
    assert verdict.crc_errors == 2  # of the chunk, and of the data as a whole
    assert verdict.topics[0] == recording.TopicCount("tick", 30, 30, 18, 12)
    assert recording.repair(path).kept_ticks == 18
    assert messages_read_by_mcap(path) == {"tick": 18, "even": 9}
    after = recording.verify(path)
    assert (after.complete, after.damages, after.ok) == (True, (), False)
    assert after.topics[0].lost == 12  # it is whole again, and says what it lost


@hypothesis.given(data=strategies.data())
def test_verify_notices_every_flipped_bit(whole: bytes, data: strategies.DataObject) -> None:
    at = data.draw(strategies.integers(0, len(whole) - 1))
    bit = data.draw(strategies.integers(0, 7))
    damaged = bytearray(whole)
    damaged[at] ^= 1 << bit
    with temporary(bytes(damaged)) as path:
        assert not recording.verify(path).ok


@hypothesis.given(data=strategies.data())
def test_readers_survive_any_damage(
    ticks: Ticks, whole: bytes, data: strategies.DataObject
) -> None:
    """Cuts, overwritten and inserted pieces: no crash, and never a tick that was not written."""
    damaged = bytearray(whole)
    for _ in range(data.draw(strategies.integers(1, 4))):
        at = data.draw(strategies.integers(0, len(damaged)))
        length = data.draw(strategies.sampled_from([0, 1, 8, 300, 5000]))
        damaged[at : at + length] = data.draw(strategies.binary(max_size=40))
    with temporary(bytes(damaged)) as path:
        verdict = recording.verify(path)
        assert bytes(damaged) == whole or not verdict.ok
        try:
            kept = tuple(recording.read(path).ticks)
        except errors.RecordingError:
            return
        assert all(record == ticks[record.tick] for record in kept)
        try:
            repaired = recording.repair(path)
        except errors.RecordingError:
            return
        assert repaired.kept_ticks == len(kept)
        assert messages_read_by_mcap(path).get("tick", 0) == len(kept)


@hypothesis.given(strategies.binary(max_size=400))
def test_readers_survive_garbage_behind_a_good_beginning(garbage: bytes) -> None:
    header = salvage.FRAME.pack(1, 18) + struct.pack("<I10sI", 10, b"msam-swarm", 0)
    with temporary(salvage.MAGIC + header + garbage) as path:
        assert not recording.verify(path).ok
        assert list(recording.read(path).ticks) == []


@pytest.mark.parametrize("compression", [b"lz4", b"zstd"])
def test_chunk_is_not_unpacked_when_it_is_a_bomb(compression: bytes) -> None:
    """80 MiB of zeros in some kB that tell of less, of as much, and of far more."""
    zeros = bytes(1 << 20)
    packed = (
        salvage.lz4.frame.compress(zeros * 80)
        if compression == b"lz4"
        else salvage.zstandard.compress(zeros * 80)
    )
    for size in (1000, 80 << 20, 1 << 60):
        body = struct.pack("<QQQI", 0, 0, size, 0)
        body += struct.pack("<I", len(compression)) + compression
        body += struct.pack("<Q", len(packed)) + packed
        with pytest.raises(ValueError, match="chunk"):
            list(salvage.chunk_parts(body))


# --- helpers --------------------------------------------------------------------------------------


@contextlib.contextmanager
def temporary(content: bytes) -> Iterator[Path]:
    """A file of its own for each example of hypothesis."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "run.mcap"
        path.write_bytes(content)
        yield path


def frames(content: bytes) -> list[tuple[int, int, int]]:
    """(opcode, begin, end) of each record of a whole file."""
    found, at = [], len(salvage.MAGIC)
    while at < len(content) - len(salvage.MAGIC):
        opcode, length = struct.unpack_from("<BQ", content, at)
        found.append((opcode, at, at + 9 + length))
        at += 9 + length
    return found


def chunks(content: bytes) -> list[int]:
    return [begin for opcode, begin, _ in frames(content) if opcode == 6]


def record_ends(content: bytes) -> list[int]:
    return [end for _, _, end in frames(content)] + [len(content)]
