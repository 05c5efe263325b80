"""What is found wanting of a machine, and what is said about it."""

from __future__ import annotations

import functools
import json
import resource
import socket
import subprocess
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest

from swarm import errors, runs
from swarm.run import doctor
from tests.run import processes

Here = Callable[[str], subprocess.CompletedProcess[str]]


@pytest.fixture
def here(folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Here:
    return functools.partial(processes.here, monkeypatch, capsys, folder)


def test_this_machine_can_run_a_swarm(here: Here) -> None:
    done = here("doctor --json")
    found = json.loads(done.stdout)
    assert done.returncode == 0, found
    assert found["ok"]
    assert len(found["checks"]) == len(doctor.CHECKS)
    assert all(row["advice"] for row in found["checks"] if row["state"] != "ok")


def test_one_bad_finding_is_exit_1_with_what_to_do(
    here: Here, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = doctor.Finding("disk", "bad", "0.0 GB free", "make room")
    fine = doctor.Finding("python", "ok", "3.11")
    monkeypatch.setattr(doctor, "CHECKS", (lambda: fine, lambda: found))
    done = here("doctor")
    assert done.returncode == 1
    assert done.stdout.splitlines() == [
        "ok   python          3.11",
        "BAD  disk            0.0 GB free",
        "                     -> make room",
    ]
    monkeypatch.setattr(doctor, "CHECKS", (lambda: fine,))
    assert here("doctor").returncode == 0


@pytest.mark.parametrize(
    ("line", "name", "bounds"),
    [
        ("eclipse-zenoh<2,>=1.10.2", "eclipse-zenoh", "<2,>=1.10.2"),
        ("jinja2>=3.1", "jinja2", ">=3.1"),
        ("numpy", "numpy", ""),
    ],
)
def test_requirement_is_split(line: str, name: str, bounds: str) -> None:
    assert doctor.split_requirement(line) == (name, bounds)


@pytest.mark.parametrize(
    ("version", "bounds", "expected"),
    [
        ("1.10.2", "<2,>=1.10.2", True),
        ("1.9.9", "<2,>=1.10.2", False),
        ("2.0.0", "<2,>=1.10.2", False),
        ("3.1.6", ">=3.1", True),
        ("14", "", True),
    ],
)
def test_version_is_within_its_bounds(version: str, bounds: str, expected: bool) -> None:
    assert doctor.is_within(version, bounds) is expected


def test_wrong_and_missing_packages_are_bad_others_only_worth_knowing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    metadata = doctor.importlib.metadata
    monkeypatch.setattr(metadata, "requires", lambda name: ["mcap>=99", "no-such-thing>=1"])
    found = doctor.check_packages()
    assert found.state == "bad"
    assert "expected >=99" in found.text
    assert "no-such-thing is missing" in found.text
    monkeypatch.setattr(metadata, "requires", lambda name: ["mcap>=1", 'ruff>=1; extra == "test"'])
    monkeypatch.setattr(doctor, "read_pins", lambda: {"mcap": "0.0.1"})
    found = doctor.check_packages()
    assert (found.state, "tested with 0.0.1" in found.text) == ("warn", True)


@pytest.mark.parametrize(
    ("free", "speed_mbps", "state"),
    [(99 << 20, 500.0, "bad"), (500 << 20, 500.0, "warn"), (9 << 30, 5.0, "warn"),
     (9 << 30, 500.0, "ok")],
)  # fmt: skip
def test_room_and_speed_of_a_disk(free: int, speed_mbps: float, state: str) -> None:
    assert doctor.disk(Path("/somewhere"), free, speed_mbps).state == state


def test_folder_that_cannot_be_written_is_bad(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    assert doctor.check_disk().state == "bad"


@pytest.mark.parametrize(
    ("soft", "state"), [(64, "bad"), (512, "warn"), (1024, "ok"), (resource.RLIM_INFINITY, "ok")]
)
def test_few_descriptors_are_named(monkeypatch: pytest.MonkeyPatch, soft: int, state: str) -> None:
    monkeypatch.setattr(resource, "getrlimit", lambda kind: (soft, 4096))
    found = doctor.check_files()
    assert found.state == state
    assert found.advice == ("" if state == "ok" else "ulimit -n 4096")


def test_no_loopback_and_no_router_are_bad(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise errors.BusError("nobody there")

    monkeypatch.setattr(doctor.zenoh_bus, "open_router", refuse)
    assert doctor.check_router().state == "bad"

    def unreachable(*_: object) -> socket.socket:
        raise OSError(101, "Network is unreachable")

    monkeypatch.setattr(socket, "create_connection", unreachable)
    assert doctor.check_ports().state == "bad"


def test_viewer_that_does_not_start_is_said(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    from dashboards import live

    monkeypatch.setattr(live, "viewer_binary", lambda: tmp_path / "rerun")
    found = doctor.check_viewer()
    assert (found.state, "rerun" in found.text) == ("warn", True)


def test_stale_cards_are_removed_and_counted(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(runs, "runtime_folder", lambda: tmp_path)
    (tmp_path / "bad.json").write_text("{")
    (tmp_path / "ghost.json").write_text(
        '{"run":"ghost","scenario":"x","pid":1,"started_s":1.0,"endpoint":"","folder":""}'
    )
    found = doctor.check_cards()
    assert found.state == "warn"
    assert "1 stale cards were removed" in found.text
    assert "1 cards not readable" in found.text
    assert [path.name for path in tmp_path.iterdir()] == ["bad.json"]


def test_runtime_folder_in_the_way_is_said(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(runs, "runtime_folder", lambda: tmp_path / "file")
    assert doctor.check_runtime_folder().state == "warn"


def test_child_that_somebody_looks_after_is_no_orphan() -> None:
    child = subprocess.Popen(["sleep", "60"])
    try:
        assert not doctor.is_orphan(psutil.Process(child.pid))
    finally:
        child.kill()
        child.wait()
