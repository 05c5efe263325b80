"""One's own: a scenario that is written and runs, a finished run in the viewer."""

from __future__ import annotations

import functools
import json
import signal
import socket
import subprocess
import urllib.request
from collections.abc import Callable
from pathlib import Path

import pytest

from dashboards import live
from swarm import errors, metrics, runs, scenario, shapes
from swarm.run import draft, lockstep, viewers
from tests.run import processes

Here = Callable[[str], subprocess.CompletedProcess[str]]


@pytest.fixture
def here(folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Here:
    return functools.partial(processes.here, monkeypatch, capsys, folder)


# --- new ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", shapes.SHAPES)
def test_draft_runs_as_it_is(shape: shapes.Shape) -> None:
    for robots in (1, 4):
        plan = scenario.decode(draft.scenario("mine", robots, shape).encode(), "mine.toml")
        score = lockstep.run(plan).score
        facts = metrics.Facts(scenario="mine", run="r", bus="memory", clock="lockstep")
        summary = metrics.summary(score, facts)
        assert (summary.outcome, summary.expect.missed) == ("succeeded", [])


@pytest.mark.parametrize("robots", [2, 20, 100])
def test_draft_of_any_size_begins_in_its_slots(robots: int) -> None:
    for shape in shapes.SHAPES:
        plan = scenario.decode(draft.scenario("mine", robots, shape).encode(), "mine.toml")
        assert len(plan.robots) == robots
        for robot, slot in zip(plan.robots[1:], plan.slots()[1:], strict=True):
            assert slot is not None
            own = shapes.slot_at(robot.start[0], robot.start[1])
            assert own.distance_m == pytest.approx(slot.distance_m, abs=1e-3)


def test_new_writes_a_file_that_validates_and_never_overwrites(here: Here, folder: Path) -> None:
    done = here("new crossing --robots 3 --shape line --json")
    assert done.returncode == 0
    assert json.loads(done.stdout) == {"file": "crossing.toml", "robots": 3, "shape": "line"}
    text = (folder / "crossing.toml").read_text()
    assert "#" in text
    assert here("validate crossing.toml").returncode == 0
    again = here("new crossing")
    assert again.returncode == 2
    assert "expected a name that is free" in again.stderr
    assert (folder / "crossing.toml").read_text() == text


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("new mine!", "letters, digits"),
        ("new -- -x", "letters, digits"),
        ("new mine --robots 0", "--robots"),
        ("new mine --shape blob", "blob"),
        ("new nowhere/mine", "expected a file that can be written"),
        ("new", "NAME"),
    ],
)
def test_new_refuses_nonsense(here: Here, folder: Path, line: str, expected: str) -> None:
    done = here(line)
    assert done.returncode == 2, done.stderr
    assert expected in done.stderr + done.stdout
    assert list(folder.iterdir()) == []


# --- view -----------------------------------------------------------------------------------------


def test_pictures_are_those_of_every_world_that_ran(tmp_path: Path) -> None:
    for name in ("run.rrd", "run.1.rrd", "run.10.rrd", "run.2.rrd", "run.mcap", "other.rrd"):
        (tmp_path / name).write_bytes(b"")
    names = ["run.rrd", "run.1.rrd", "run.2.rrd", "run.10.rrd"]
    assert [path.name for path in viewers.pictures(tmp_path)] == names
    assert [path.name for path in viewers.pictures(tmp_path / "run.rrd")] == names
    for path in tmp_path.glob("run*.rrd"):
        path.unlink()
    assert viewers.pictures(tmp_path) == [tmp_path / "run.mcap"]


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("view nowhere", "nothing there"),
        ("view .", "a folder without them"),
        ("view text", "another kind of file"),
        ("view one --web --native", "got both"),
        ("view one --native", "expected a display"),
    ],
)
def test_view_refuses_what_cannot_be_shown(
    here: Here, folder: Path, monkeypatch: pytest.MonkeyPatch, line: str, expected: str
) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    (folder / "text").write_text("")
    (folder / "one").mkdir()
    (folder / "one" / runs.RRD).write_bytes(b"")
    done = here(line)
    assert done.returncode == 2, done.stderr
    assert expected in done.stderr


def test_viewer_that_does_not_come_up_is_an_error_with_its_words(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    binary = tmp_path / "rerun"
    monkeypatch.setattr(live, "viewer_binary", lambda: binary)
    (tmp_path / "run.rrd").write_bytes(b"")
    with pytest.raises(errors.SwarmError, match="No such file"):
        viewers.serve_web([tmp_path / "run.rrd"], print)
    binary.write_text("#!/bin/sh\necho no screen at all >&2\nexit 3\n")
    binary.chmod(0o755)
    for show in (viewers.open_native, lambda paths: viewers.serve_web(paths, print)):
        with pytest.raises(errors.SwarmError, match="no screen at all"):
            show([tmp_path / "run.rrd"])


def test_view_serves_a_run_on_loopback_until_interrupted(folder: Path) -> None:
    done = processes.swarm(
        folder, "run", "empty", "--robots", "2", "--duration", "1", "--bus", "memory", "--out", "a"
    )
    assert done.returncode == 0, done.stderr
    view = processes.start(folder, "view", "a", "--web")
    assert view.stderr is not None
    line = view.stderr.readline()
    assert "http://127.0.0.1:" in line, line
    address = next(word for word in line.split() if word.startswith("http"))
    port = int(address.split(":")[2].split("/")[0])
    with urllib.request.urlopen(address, timeout=10.0) as page:
        assert page.status == 200
    view.send_signal(signal.SIGINT)
    view.communicate()
    assert view.returncode == 130
    with socket.socket() as probe:
        assert probe.connect_ex(("127.0.0.1", port)) != 0
