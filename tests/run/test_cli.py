"""The command line as scripts see it: exit codes, texts, JSON."""

from __future__ import annotations

import functools
import json
import os
import socket
import subprocess
import tomllib
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from swarm import metrics, recording, runs
from tests.run import processes

Here = Callable[[str], subprocess.CompletedProcess[str]]


@pytest.fixture
def here(folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Here:
    return functools.partial(processes.here, monkeypatch, capsys, folder)


BAD_SETTINGS = {
    "dt_s=0.5": ("dt_s", "<= 0.1", "got 0.5"),
    "robots.0.colour=1": ("robots[0]", "expected one of the keys", "'colour'"),
    "field.k_g=nan": ("field.k_g", "> 0", "nan"),
    "formation.leader=nobody": ("formation.leader", "expected", "'nobody'"),
    "clock.rate": ("--set clock.rate", "PATH=VALUE", "got 'clock.rate'"),
}


@pytest.mark.parametrize("setting", BAD_SETTINGS)
def test_bad_setting_is_exit_2_and_starts_nothing(here: Here, folder: Path, setting: str) -> None:
    done = here(f"run two-obstacles --set {setting}")
    assert done.returncode == 2
    for part in BAD_SETTINGS[setting]:
        assert part in done.stderr
    assert list(folder.iterdir()) == []


BAD_LINES = {
    "run nowhere": "expected one of",
    "run two-obstacle": "did you mean 'two-obstacles'",
    "run missing.toml": "missing.toml",
    "run two-obstacles --fault kill:robot9@8": "robot9",
    "run two-obstacles --fault kill:robot3": "kind:target@start_s",
    "run two-obstacles --fault melt:robot3@8": "faults[0].kind",
    "run two-obstacles --fault kill:robot3@8.01": "multiple of dt_s",
    "run two-obstacles --robots 9": "--robots between 1 and 6",
    "run two-obstacles --bus memory --clock realtime": "expected --clock lockstep",
    "run two-obstacles --bus memory --view web": "--bus memory",
    "run two-obstacles --router nonsense": "tcp/127.0.0.1:7447",
    "run two-obstacles --stop-after -1": "--stop-after",
    "run two-obstacles --set robots=5 --robots 3": "expected rows [[robots]]",
    "run two-obstacles --set faults=3 --fault kill:robot1@0.8": "expected rows [[faults]]",
    "run two-obstacles --set robots.1.name=world": "got 'world'",
    "run empty --set robots.0.name=x": "[line] or [[robots]]",
    "run two-obstacles --tls nowhere": "ca.pem",
    "run two-obstacles --clock sundial": "sundial",
    "verify nowhere": "expected a run's folder",
    "replay .": "without run.mcap",
    "diff nowhere .": "expected a run's folder",
    "why nowhere robot1 1": "expected a run's folder",
    "validate missing.toml": "missing.toml",
    "frobnicate": "frobnicate",
    "bench nothing-of-the-kind": "nothing-of-the-kind",
    "reproduce fig13 fig9": "expected some of fig10, fig11, fig12",
}


@pytest.mark.parametrize("line", BAD_LINES)
def test_bad_command_line_is_exit_2_and_says_what_was_expected(
    here: Here, folder: Path, line: str
) -> None:
    done = here(line)
    assert done.returncode == 2, done.stderr
    assert BAD_LINES[line] in done.stderr + done.stdout
    assert "Traceback" not in done.stderr
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (b"", "the key 'title'"),
        (b"title = ", "expected TOML"),
        (b"\xff\xfe", "UTF-8"),
        (b"title = 3", "title: expected `str`, got `int`"),
        (b"[" * 5000, "expected TOML"),
    ],
)
def test_bad_scenario_file_is_named(
    here: Here, folder: Path, content: bytes, expected: str
) -> None:
    (folder / "bad.toml").write_bytes(content)
    done = here("run bad.toml")
    assert done.returncode == 2
    assert "bad.toml" in done.stderr
    assert expected in done.stderr
    done = here("validate bad.toml two-obstacles --json")
    assert done.returncode == 2
    rows = json.loads(done.stdout)["files"]
    assert [row["ok"] for row in rows] == [False, True]


def test_dry_run_prints_a_scenario_that_decodes_to_itself(folder: Path) -> None:
    line = ("run", "two-obstacles", "--dry-run", "--fault", "kill:robot3@9.6", "--seed", "9")
    done = processes.swarm(folder, *line)
    assert done.returncode == 0
    resolved = tomllib.loads(done.stdout)
    assert resolved["seed"] == 9
    assert resolved["faults"] == [{"kind": "kill", "target": "robot3", "at_s": 9.6}]
    (folder / "again.toml").write_text(done.stdout)
    again = processes.swarm(folder, "run", "again.toml", "--dry-run")
    assert again.stdout == done.stdout
    assert not (folder / "runs").exists()


def test_run_json_is_one_object_equal_to_the_summary(folder: Path) -> None:
    done = processes.swarm(
        folder, "run", "empty", "--robots", "3", "--duration", "2", "--json", "--out", "out"
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("\n") == 1
    printed = msgspec.json.decode(done.stdout, type=metrics.Summary)
    stored = msgspec.json.decode((folder / "out" / runs.SUMMARY).read_bytes(), type=metrics.Summary)
    assert printed == stored
    assert printed.outcome == "succeeded"
    assert printed.robots == 3
    assert printed.sim_time_s == 2.0
    assert printed.bus == "zenoh"
    assert printed.recording is not None
    assert printed.recording.lost == 0
    assert printed.recording.written == printed.recording.expected > 0
    assert {path.name for path in (folder / "out").iterdir()} == {
        runs.MCAP,
        runs.RRD,
        runs.SCENARIO,
        runs.SUMMARY,
        runs.LOGS,
    }
    logs = {path.name for path in (folder / "out" / runs.LOGS).iterdir()}
    names = ("run", "world", "robot1", "robot2", "robot3")
    assert logs == {*(f"{name}.log" for name in names), "processes.jsonl"}


def test_run_names_the_expectation_it_missed(folder: Path) -> None:
    done = processes.swarm(
        folder, "run", "empty", "--robots", "2", "--duration", "1", "--bus", "memory",
        "--set", "expect.min_clearance_robot_m=9.0", "--out", "out",
    )  # fmt: skip
    assert done.returncode == 1
    assert "min_clearance_robot_m >= 9" in done.stderr
    assert "outcome" not in done.stderr


def test_duration_that_is_too_short_is_a_timeout(folder: Path) -> None:
    done = processes.swarm(
        folder, "run", "two-obstacles", "--duration", "2", "--bus", "memory", "--json"
    )
    assert done.returncode == 1
    assert json.loads(done.stdout)["outcome"] == "timeout"
    assert len(list((folder / "runs").iterdir())) == 1


def test_stop_after_ends_the_run_with_exit_1(folder: Path) -> None:
    done = processes.swarm(
        folder, "run", "two-obstacles", "--rate", "1", "--stop-after", "1", "--out", "out"
    )
    assert done.returncode == 1
    assert "--stop-after" in done.stderr
    assert recording.verify(folder / "out" / runs.MCAP).complete


def test_run_without_goals_that_is_stopped_early_has_not_succeeded(folder: Path) -> None:
    line = ("run", "empty", "--duration", "60", "--rate", "1", "--stop-after", "1", "--json")
    for bus in ("zenoh", "memory"):
        done = processes.swarm(folder, *line, "--bus", bus, "--out", bus)
        assert done.returncode == 1
        assert json.loads(done.stdout)["outcome"] == "timeout"
        assert "--stop-after" in done.stderr


def test_runs_in_folders_of_one_name_have_ids_of_their_own(folder: Path) -> None:
    ids = set()
    for out in ("a/run", "b/run"):
        done = processes.swarm(
            folder, "run", "empty", "--duration", "1", "--bus", "memory", "--out", out, "--json"
        )
        ids.add(json.loads(done.stdout)["run"])
    assert len(ids) == 2


def test_out_with_a_run_in_it_is_refused_and_untouched(folder: Path) -> None:
    (folder / "out").mkdir()
    (folder / "out" / runs.MCAP).write_bytes(b"precious")
    done = processes.swarm(folder, "run", "empty", "--out", "out")
    assert done.returncode == 2
    assert "choose another" in done.stderr
    assert (folder / "out" / runs.MCAP).read_bytes() == b"precious"


def test_unwritable_out_is_exit_2_and_clear(here: Here, folder: Path) -> None:
    (folder / "file").write_text("")
    for out in ("file", "file/inside", "/proc/nowhere"):
        done = here(f"run empty --out {out}")
        assert done.returncode == 2, out
        assert "expected a folder" in done.stderr
        assert "Traceback" not in done.stderr


def test_missing_display_is_exit_2_and_names_the_way_out(
    here: Here, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    done = here("run empty --view native")
    assert done.returncode == 2
    assert "--view web" in done.stderr


def test_port_in_use_is_named_by_a_world_started_by_hand(folder: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        endpoint = f"tcp/127.0.0.1:{taken.getsockname()[1]}"
        done = processes.swarm(folder, "world", "empty", "--listen", endpoint, "--out", "out")
    assert done.returncode == 1
    assert endpoint in done.stderr
    assert "in use" in done.stderr


def test_status_and_stop_find_the_running_swarm(folder: Path) -> None:
    run = processes.start(folder, "run", "two-obstacles", "--rate", "1", "--out", "one", "-q")
    line = ("run", "empty", "--duration", "300", "--rate", "1", "--out", "other", "-q")
    other = processes.start(folder, *line)

    def cards() -> dict[str, runs.Card]:
        return {card.run: card for card in runs.running() if Path(card.folder).parent == folder}

    processes.until(lambda: len(cards()) == 2, 30.0, "two runs at once")
    endpoints = {card.endpoint for card in cards().values()}
    assert len(endpoints) == 2
    done = processes.swarm(folder, "status", "--run", "one", "--json")
    assert done.returncode == 0, done.stderr
    (row,) = json.loads(done.stdout)["runs"]
    assert row["card"]["pid"] == run.pid
    assert [robot["name"] for robot in row["status"]["robots"]][:2] == ["leader", "robot1"]
    assert "robot5" in processes.swarm(folder, "status", "--run", "one").stdout
    assert processes.swarm(folder, "stop", "--run", "nobody").returncode == 1
    stopped = processes.swarm(folder, "stop", "--run", "one", "--json")
    assert json.loads(stopped.stdout) == {"run": row["card"]["run"], "stopped": True}
    assert run.wait(5.0) == 1
    assert other.poll() is None
    assert processes.swarm(folder, "stop", "--run", "other").returncode == 0
    other.communicate(timeout=10.0)
    run.communicate()
    assert processes.belonging(folder) == []


def test_stale_card_is_recognised(folder: Path) -> None:
    stale = runs.Card("ghost", "empty", os.getpid(), 1.0, "tcp/127.0.0.1:1", str(folder))
    runs.runtime_folder().mkdir(parents=True, exist_ok=True)
    path = runs.runtime_folder() / "ghost.json"
    path.write_bytes(msgspec.json.encode(stale))
    assert "ghost" not in [card.run for card in runs.running()]
    assert not path.exists()


def test_injected_kill_is_exact_and_reported(folder: Path) -> None:
    hashes = set()
    for out in ("a", "b"):
        done = processes.swarm(
            folder, "run", "two-obstacles", "--fault", "kill:robot3@4.8", "--duration", "12",
            "--out", out, "--json",
        )  # fmt: skip
        summary = json.loads(done.stdout)
        assert [fault["tick"] for fault in summary["faults"]] == [60]
        outcome = {row["name"]: row["outcome"] for row in summary["per_robot"]}["robot3"]
        assert outcome == "killed"
        hashes.add(summary["state_hash"])
        assert processes.swarm(folder, "replay", out).returncode == 0
    memory = processes.swarm(
        folder, "run", "two-obstacles", "--fault", "kill:robot3@4.8", "--duration", "12",
        "--bus", "memory", "--json",
    )  # fmt: skip
    hashes.add(json.loads(memory.stdout)["state_hash"])
    assert len(hashes) == 1


def test_version_names_what_matters(here: Here) -> None:
    rows = json.loads(here("version --json").stdout)
    assert {"msam-swarm", "eclipse-zenoh", "rerun-sdk", "mcap", "python"} <= set(rows)
