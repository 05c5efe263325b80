"""Watching in a terminal: what fits, how robots answer, the table of a swarm that runs."""

from __future__ import annotations

import functools
import io
import json
import os
import pty
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import pytest
from rich.console import Console
from rich.text import Text

from swarm import runs
from swarm.messages import RobotStatus, Status
from swarm.run import board, census, columns
from swarm.run.columns import Column
from tests.run import processes

Here = Callable[[str], subprocess.CompletedProcess[str]]


@pytest.fixture
def here(folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Here:
    return functools.partial(processes.here, monkeypatch, capsys, folder)


def robot(**changes: Any) -> RobotStatus:
    status = RobotStatus("robot1", "running", "GO", "", False, 0, None, command_age_s=0.1)
    return msgspec.structs.replace(status, **changes)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, "ok"),
        ({"command_age_s": 30.0}, "ok"),  # nobody asked it anything: the world waits for another
        ({"command_age_s": 0.5, "unanswered": 1}, "ok"),
        ({"command_age_s": 0.6, "unanswered": 1}, "slow"),
        ({"command_age_s": 2.1, "unanswered": 9}, "silent"),
        ({"command_age_s": 2.1, "unanswered": 9, "state": "collided"}, "silent"),
        ({"command_age_s": 9.0, "unanswered": 9, "state": "killed"}, ""),
        ({"command_age_s": None, "unanswered": 1}, "ok"),
    ],
)
def test_health_is_the_age_of_an_answer_that_is_owed(
    changes: dict[str, Any], expected: str
) -> None:
    assert census.health(robot(**changes)) == expected


def test_columns_go_by_rank_until_the_rest_fits() -> None:
    wide = (Column("NAME"), Column("AAAA", 1), Column("BB", 2), Column("STATE"))
    row = [Text("robot1"), Text("a"), Text("bbb"), Text("ok")]
    # 6 + 4 + 3 + 5 letters, 2 between
    assert columns.fitting(wide, [row], None) == [0, 1, 2, 3]
    assert columns.fitting(wide, [row], 24) == [0, 1, 2, 3]
    assert columns.fitting(wide, [row], 23) == [0, 1, 3]
    assert columns.fitting(wide, [row], 18) == [0, 3]
    assert columns.fitting(wide, [row], 3) == [0, 3]


def rows(count: int) -> list[census.Row]:
    own = [census.Row(name="run", pid=10), census.Row(name="world", pid=11, state="running")]
    return own + [
        census.Row(
            name=f"robot{number + 1}",
            pid=100 + number,
            state="killed" if number == 7 else "running",
            health="" if number == 7 else "ok",
            age_s=75.0,
            cpu_percent=3.2,
            memory_bytes=11 << 20,
            commands_per_s=12.5,
            heard=5,
        )
        for number in range(count)
    ]


def drawn(width: int, height: int | None = None, count: int = 3) -> list[str]:
    console = Console(width=width, file=io.StringIO(), color_system=None)
    status = Status("run", "Gap", 10, 800_000_000, "lockstep", "running", 60.0, 2.0, ())
    console.print(board.board(status, rows(count), {}, width=width, height=height))
    assert isinstance(console.file, io.StringIO)
    return [line.rstrip() for line in console.file.getvalue().splitlines()]


def test_board_has_every_column_where_there_is_room() -> None:
    lines = drawn(120)
    assert lines[0].startswith("running at 0.8 s of at most 60 s, 0.0 x real time")
    assert lines[2].split() == [column.title for column in board.COLUMNS]
    assert lines[5].split() == ["robot1", "100", "running", "ok", "1m15s", "3%", "11M", "12.5", "5"]


@pytest.mark.parametrize("width", [10, 20, 30, 40, 60, 80])
def test_board_never_wraps_and_keeps_names(width: int) -> None:
    lines = drawn(width)
    assert len(lines) == 3 + 5
    assert max(map(len, lines)) <= width
    assert lines[2].split()[0] == "NAME"


def test_those_in_trouble_are_shown_when_not_all_fit() -> None:
    lines = drawn(120, height=10, count=20)
    names = [line.split()[0] for line in lines[3:]]
    assert names == ["run", "world", "robot1", "robot2", "robot3", "robot8", "..."]
    assert "... 16 more" in lines[-1]


def test_top_shows_every_process_once_where_there_is_no_terminal(here: Here, folder: Path) -> None:
    line = ("run", "empty", "--robots", "3", "--duration", "300", "--rate", "1", "--out", "one")
    run = processes.start(folder, *line)
    processes.until(lambda: len(processes.named(folder, "swarm-robot")) == 3, 30.0, "3 robots")

    def found() -> dict[str, Any]:
        done = here("top --json --run one")
        rows = json.loads(done.stdout)["processes"] if done.returncode == 0 else []
        return {row["name"]: row for row in rows}

    by_name: dict[str, Any] = {}

    def all_hear() -> bool:
        by_name.clear()
        by_name.update(found())
        robots = [row for name, row in by_name.items() if name.startswith("robot")]
        return len(robots) == 3 and all(one["heard"] and one["commands_per_s"] for one in robots)

    processes.until(all_hear, 30.0, "three that hear and answer")
    assert list(by_name) == ["run", "world", "robot1", "robot2", "robot3"]
    assert by_name["run"]["pid"] == run.pid
    assert by_name["robot1"]["heard"] == 2
    assert by_name["robot1"]["health"] == "ok"
    assert by_name["robot1"]["commands_per_s"] > 0.0
    assert all(row["memory_bytes"] > 1 << 20 for row in by_name.values())
    text = here("top --run one").stdout
    assert text.splitlines()[2].split() == [column.title for column in board.COLUMNS]
    assert "\x1b" not in text
    run.send_signal(signal.SIGINT)
    run.communicate()


def test_top_follows_in_a_terminal_until_q(here: Here, folder: Path) -> None:
    line = ("run", "empty", "--robots", "2", "--duration", "300", "--rate", "1", "--out", "one")
    run = processes.start(folder, *line)
    processes.until(lambda: (folder / "one" / "run.json").exists(), 30.0, "a run")
    processes.until(lambda: here("status --run one").returncode == 0, 30.0, "a world that answers")
    ours, theirs = pty.openpty()
    top = subprocess.Popen(
        [*processes.SWARM, "top", "--run", "one"],
        cwd=folder,
        stdin=theirs,
        stdout=theirs,
        stderr=theirs,
        env={**os.environ, "TERM": "xterm", "COLUMNS": "60", "NO_COLOR": "1"},
    )
    os.close(theirs)
    seen = b""
    deadline_s = time.monotonic() + 30.0
    while b"robot2" not in seen:
        assert time.monotonic() < deadline_s
        try:
            seen += os.read(ours, 4096)
        except OSError:  # it has ended
            pytest.fail(seen.decode())
    os.write(ours, b"q")
    os.set_blocking(ours, False)
    assert top.wait(10.0) == 0
    assert b"\x1b[32m" not in seen  # no colour
    os.close(ours)
    run.send_signal(signal.SIGINT)
    run.communicate()


def test_top_without_a_swarm_is_exit_1(here: Here) -> None:
    done = here("top --run nobody-at-all")
    assert done.returncode == 1
    assert "expected the run 'nobody-at-all'" in done.stderr


# --- logs ---------------------------------------------------------------------------------------


@pytest.fixture
def written(folder: Path) -> Path:
    """Folder of a run that never was, with two logs."""
    logs = folder / "one" / runs.LOGS
    logs.mkdir(parents=True)
    record = '{{"time":"2026-01-01T00:00:0{}.000000Z","process":"{}","level":"{}","text":"{}"{}}}\n'
    (logs / "world.log").write_text(
        record.format(1, "world", "info", "start", ',"tick":0')
        + record.format(3, "world", "warn", "fault robot1", ',"tick":50')
    )
    (logs / "robot1.log").write_text(
        record.format(2, "robot1", "error", "no wheels", ',"traceback":"Traceback\\n  line"')
        + "thread panicked\n"
    )
    return folder / "one"


def test_logs_are_merged_by_time_with_their_tracebacks(written: Path, here: Here) -> None:
    done = here("logs one")
    assert done.returncode == 0
    assert done.stdout.splitlines() == [
        "00:00:01.000  world   tick 0: start",
        "00:00:02.000  robot1  no wheels",
        "                      Traceback",
        "                        line",
        "00:00:02.000  robot1  thread panicked",
        "00:00:03.000  world   tick 50: fault robot1",
    ]
    assert here("logs one world").stdout.count("\n") == 2


def test_logs_as_json_are_the_records_one_a_line(written: Path, here: Here) -> None:
    lines = [json.loads(line) for line in here("logs one robot1 --json").stdout.splitlines()]
    assert [line["level"] for line in lines] == ["error", "raw"]
    assert lines[0]["traceback"] == "Traceback\n  line"


def test_logs_of_the_newest_run_are_shown_when_none_runs(
    written: Path, here: Here, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runs, "running", list)
    assert here("logs").returncode == 1
    (folder / "runs" / "20260101T000000Z-older" / runs.LOGS).mkdir(parents=True)
    written.rename(folder / "runs" / "20260102T000000Z-newer")
    assert "no wheels" in here("logs").stdout


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("logs one robto1", "did you mean 'robot1'"),
        ("logs nowhere/at-all", "expected a run's folder"),
        ("logs one --run other", "expected one run"),
    ],
)
def test_logs_refuse_what_is_not_there(written: Path, here: Here, line: str, expected: str) -> None:
    done = here(line)
    assert done.returncode == 2
    assert expected in done.stderr


def test_logs_follow_a_run_to_its_end(folder: Path) -> None:
    run = processes.start(
        folder, "run", "empty", "--robots", "2", "--duration", "3", "--rate", "1", "--out", "one",
        "--fault", "kill:robot2@1.6",
    )  # fmt: skip
    processes.until(lambda: (folder / "one" / "run.json").exists(), 30.0, "a run")
    done = processes.swarm(folder, "logs", "-f", "--run", "one", "--json")
    run.communicate()
    assert done.returncode == 0
    entries = [json.loads(line) for line in done.stdout.splitlines()]
    by_process: dict[str, list[str]] = {}
    for entry in entries:
        by_process.setdefault(entry["process"], []).append(entry["text"])
    assert set(by_process) == {"run", "world", "robot1"}
    assert "run one-" in by_process["run"][0]
    assert by_process["world"][1] == "fault robot2: kill:robot2@1.6"
    assert by_process["robot1"] == ["ends: asked to stop by SIGTERM"]
    assert [one.get("tick") for one in entries if one["process"] == "world"] == [0, 20, None]
