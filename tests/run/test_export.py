"""Tables of a run: what is read back is what was recorded, to the bit, with units."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
import pytest
import tomli_w

from swarm import lifetime, recording
from swarm import scenario as scenarios
from swarm.messages import TickRecord
from swarm.run import export, library, lockstep
from swarm.run.export import columns
from tests.run import processes

NAMES = [table.name for table in columns.TABLES]
TICKS = 26
# Ends of names and the units that they stand for.
UNITS = {"_m": "m", "_rad": "rad", "_mps": "m/s", "_radps": "rad/s", "_s": "s", "_ticks": "ticks"}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of 2 s of two obstacles, in which robot2 is started again and robot4 is deaf."""
    name, where, data = library.read_scenario("two-obstacles")
    plan = scenarios.decode(
        data,
        where,
        settings=["recording.rerun=false"],
        faults=["restart:robot2@0.8+0.4", "deaf:robot4@0.4"],
        duration_s=2.0,
    )
    toml = tomli_w.dumps(scenarios.to_builtins(plan)).encode()
    folder = tmp_path_factory.mktemp("run")
    lockstep.record(plan, name, "run-1", toml, folder, lifetime.Stop(), lambda status: None)
    return folder


@pytest.fixture(scope="module")
def records(run: Path) -> list[TickRecord]:
    return list(recording.read(run).ticks)


@pytest.fixture(scope="module")
def tables(run: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Every table as Parquet gives it back."""
    folder = tmp_path_factory.mktemp("tables")
    found = export.export(run / "run.mcap", folder, "parquet")
    assert (found.first_tick, found.last_tick, found.cut) == (0, TICKS - 1, False)
    read = {name: pyarrow.parquet.read_table(folder / f"{name}.parquet") for name in NAMES}
    assert {name: table.num_rows for name, table in read.items()} == found.rows
    assert sorted(one.name for one in folder.iterdir()) == sorted(
        [f"{name}.parquet" for name in NAMES] + ["columns.md"]
    )
    return read


def test_robots_are_the_truth_of_every_tick(
    tables: dict[str, Any], records: list[TickRecord]
) -> None:
    names = ["leader", "robot1", "robot2", "robot3", "robot4", "robot5"]
    expected = [
        {
            "tick": record.tick,
            "time_s": record.stamp_ns / 1e9,
            "robot": names[row],
            "alive": robot.alive,
            "contact": robot.contact,
            "contact_excused": robot.excused,
            "x_m": robot.pose.x_m,
            "y_m": robot.pose.y_m,
            "yaw_rad": robot.pose.yaw_rad,
            "speed_mps": robot.twist.speed_mps,
            "turn_rate_radps": robot.twist.turn_rate_radps,
            "applied_speed_mps": robot.applied.speed_mps,
            "applied_turn_rate_radps": robot.applied.turn_rate_radps,
            "obstacle_clearance_m": robot.obstacle_clearance_m,
        }
        for record in records
        for row, robot in enumerate(record.robots)
    ]
    assert len(expected) == 6 * TICKS
    assert tables["robots"].to_pylist() == expected
    assert {row["alive"] for row in expected} == {True, False}


def test_frames_hold_every_beam(tables: dict[str, Any], records: list[TickRecord]) -> None:
    frames = [frame for record in records for frame in record.frames]
    table = tables["frames"]
    assert table.num_rows == len(frames) == 6 * TICKS - 5  # robot2 is away for 0.4 s
    assert table["ranges_m"].to_pylist() == [frame.ranges.numpy().tolist() for frame in frames]
    assert table["wheel_left_mps"].to_pylist() == [frame.wheels.left_mps for frame in frames]


def test_heard_names_speaker_and_tick(tables: dict[str, Any], records: list[TickRecord]) -> None:
    heard = tables["heard"].to_pylist()
    assert len(heard) == sum(frame.heard.shape[0] for record in records for frame in record.frames)
    assert not [row for row in heard if row["robot"] == "robot4" and row["tick"] > 5]  # it is deaf
    assert {row["speaker"] for row in heard if row["robot"] == "leader"} == {
        f"robot{number}" for number in range(1, 6)
    }
    assert {row["tick"] - row["beacon_tick"] for row in heard if row["robot"] == "leader"} >= {1}


def test_commands_and_beacons_are_what_was_said(
    tables: dict[str, Any], records: list[TickRecord]
) -> None:
    said = [(record, command) for record in records for command in record.commands]
    rows = tables["commands"].to_pylist()
    assert len(rows) == len(said)
    for row, (record, command) in zip(rows, said, strict=True):
        forces, waypoint = command.trace.forces, command.trace.waypoint
        assert (row["tick"], row["frame_tick"], row["robot"]) == (
            record.tick,
            command.tick,
            command.robot,
        )
        assert row["late_ticks"] == record.tick - command.tick
        assert row["speed_mps"] == command.set_point.speed_mps
        assert (row["force_repulsive_x"], row["force_repulsive_y"]) == forces.repulsive
        assert (row["force_resultant_x"], row["force_resultant_y"]) == forces.resultant
        assert (row["waypoint_x_m"], row["waypoint_y_m"]) == (waypoint or (None, None))
        assert (row["kp_distance"], row["kd_bearing"]) == (
            command.trace.gains[0],
            command.trace.gains[5],
        )
        assert (row["error_distance_m"], row["error_bearing_rad"]) == command.trace.error
    assert {row["incarnation"] for row in rows if row["robot"] == "robot2"} == {0, 1}
    for row, (_, command) in zip(tables["beacons"].to_pylist(), said, strict=True):
        beacon = command.beacon
        assert (row["tick"], row["robot"], row["mode"]) == (beacon.tick, beacon.name, beacon.mode)
        assert tuple(row[f"priority_{place}"] for place in range(4)) == beacon.priority
        assert row["yaw_rad"] == beacon.pose.yaw_rad
        assert (row["slot_distance_m"] is None) == (beacon.slot is None)
        assert (row["leader"], row["term"]) == (
            (None, None)
            if beacon.leadership is None
            else (beacon.leadership.name, beacon.leadership.term)
        )


def test_events_tell_the_faults(tables: dict[str, Any], records: list[TickRecord]) -> None:
    rows = tables["events"].to_pylist()
    assert len(rows) == sum(len(record.events) for record in records)
    faults = [(row["tick"], row["robot"], row["fault"]) for row in rows if row["kind"] == "fault"]
    assert faults == [(5, "robot4", "deaf"), (10, "robot2", "restart")]


def test_csv_gives_back_the_same_values(run: Path, tables: dict[str, Any], tmp_path: Path) -> None:
    export.export(run / "run.mcap", tmp_path, "csv")
    for table in columns.TABLES:
        lists = [one.name for one in table.columns if pa.types.is_list(one.type)]
        types = {one.name: pa.string() if one.name in lists else one.type for one in table.columns}
        read = pyarrow.csv.read_csv(
            tmp_path / f"{table.name}.csv",
            convert_options=pyarrow.csv.ConvertOptions(
                column_types=types, strings_can_be_null=True, quoted_strings_can_be_null=False
            ),
        )
        for one in table.columns:
            got, expected = read[one.name].to_pylist(), tables[table.name][one.name].to_pylist()
            if one.name in lists:
                got = [[float(text) for text in row.split()] for row in got]
            assert got == expected, f"{table.name}.{one.name}"


def test_batches_do_not_change_what_is_written(
    run: Path, tables: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(export, "BATCH_ROWS", 20)
    export.export(run / "run.mcap", tmp_path, "parquet")
    file = pyarrow.parquet.ParquetFile(tmp_path / "robots.parquet")
    assert file.num_row_groups == pytest.approx(6 * TICKS / 24, abs=1)  # four ticks at a time
    assert file.read().equals(tables["robots"])


# --- what is said of the columns ----------------------------------------------------------------


@pytest.mark.parametrize("table", columns.TABLES, ids=NAMES)
def test_every_column_has_its_unit_and_its_meaning(
    table: columns.Table, tables: dict[str, Any]
) -> None:
    text = columns.markdown()
    schema = tables[table.name].schema
    assert schema.metadata[b"run"] == b"run-1"
    assert b"[[robots]]" in schema.metadata[b"scenario"]
    assert f"## {table.name}" in text
    for one in table.columns:
        endings = [unit for end, unit in UNITS.items() if one.name.endswith(end)]
        assert one.unit == (endings[0] if endings else one.unit if one.unit == "1" else "")
        assert one.text
        told = schema.field(one.name).metadata
        assert (told[b"unit"], told[b"description"]) == (one.unit.encode(), one.text.encode())
        assert f"| `{one.name}` | {one.type} | {one.unit} | {one.text} |" in text


# --- the verb -----------------------------------------------------------------------------------


@pytest.fixture
def swarm(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> Callable[..., Any]:
    return lambda *arguments: processes.here(monkeypatch, capsys, tmp_path, " ".join(arguments))


def test_verb_says_what_it_wrote(swarm: Callable[..., Any], run: Path, tmp_path: Path) -> None:
    ended = swarm("export", str(run), "--format", "csv", "--out", "tables", "--json")
    assert ended.returncode == 0
    told = json.loads(ended.stdout)
    assert told["rows"]["robots"] == 6 * TICKS
    assert (tmp_path / "tables" / "robots.csv").read_text().count("\n") == 6 * TICKS + 1
    assert (tmp_path / "tables" / "columns.md").read_text() == columns.markdown()


def test_cut_recording_is_exported_up_to_there_and_exits_1(
    swarm: Callable[..., Any], run: Path, tmp_path: Path
) -> None:
    data = (run / "run.mcap").read_bytes()
    (tmp_path / "run.mcap").write_bytes(data[: len(data) * 2 // 3])
    ended = swarm("export", ".")
    assert ended.returncode == 1
    assert "cut or damaged" in ended.stderr
    rows = pyarrow.parquet.read_table(tmp_path / "export" / "robots.parquet").num_rows
    assert 0 < rows < 6 * TICKS


@pytest.mark.parametrize(
    ("content", "line", "code", "words"),
    [
        (None, "export .", 2, "expected a run's folder"),
        (b"hello" * 100, "export .", 1, "expected a recording"),
        (b"", "export . --format xls", 2, ""),
    ],
)
def test_what_cannot_be_done_is_refused(
    swarm: Callable[..., Any],
    tmp_path: Path,
    content: bytes | None,
    line: str,
    code: int,
    words: str,
) -> None:
    if content is not None:
        (tmp_path / "run.mcap").write_bytes(content)
    ended = swarm(line)
    assert ended.returncode == code
    assert words in ended.stderr
    assert not (tmp_path / "export").exists()


def test_folder_that_cannot_be_written_is_refused(
    swarm: Callable[..., Any], run: Path, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("")
    ended = swarm("export", str(run), "--out", "file/tables")
    assert ended.returncode == 2
    assert "--out" in ended.stderr


def test_failure_in_the_middle_leaves_no_half_table(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(run, tmp_path / "run")
    monkeypatch.setattr(export, "_check", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt):
        export.export(tmp_path / "run" / "run.mcap", tmp_path / "tables", "parquet")
    assert list((tmp_path / "tables").iterdir()) == []
