"""Holding a swarm of real processes, stepping it, changing its pace, letting it go on."""

from __future__ import annotations

import functools
import json
from pathlib import Path

import msgspec
import pytest

from swarm.messages import Status
from tests.run import processes


def test_swarm_is_paused_stepped_and_goes_on_to_the_same_end(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    here = functools.partial(processes.here, monkeypatch, capsys, folder)

    def told(line: str) -> Status:
        done = here(f"{line} --run one --json")
        assert done.returncode == 0, done.stderr
        return msgspec.convert(json.loads(done.stdout)["status"], Status)

    line = ("run", "two-obstacles", "--duration", "8", "--json")
    run = processes.start(folder, *line, "--rate", "1", "--out", "one")
    processes.until(lambda: (folder / "one" / "run.json").exists(), 30.0, "a run")
    processes.until(lambda: here("pause --run one").returncode == 0, 30.0, "a world that answers")
    held = told("pause")
    assert held.state == "paused"
    again = told("step")
    assert (again.state, again.tick) == ("paused", held.tick + 1)
    assert told("step 7").tick == held.tick + 8
    assert told("rate 0").rate == 0.0
    human = here("resume --run one")
    assert human.returncode == 0
    assert human.stdout.startswith("one-")
    printed, _ = run.communicate()
    alone = here(" ".join((*line, "--bus", "memory", "--out", "alone")))
    assert json.loads(printed)["state_hash"] == json.loads(alone.stdout)["state_hash"]
    assert here("replay one").returncode == 0


def test_a_world_that_comes_back_stays_as_people_have_set_it(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    here = functools.partial(processes.here, monkeypatch, capsys, folder)

    def told() -> Status | None:
        done = here("status --run one --json")
        if done.returncode != 0:
            return None
        return msgspec.convert(json.loads(done.stdout)["runs"][0]["status"], Status)

    run = processes.start(
        folder, *("run", "two-obstacles", "--rate", "1", "--out", "one", "--json", "-q")
    )
    processes.until(lambda: (folder / "one" / "run.json").exists(), 30.0, "a run")
    processes.until(lambda: here("rate 3 --run one").returncode == 0, 30.0, "a world that answers")
    assert here("select robot3 --run one").returncode == 0
    wrong = here("select robot33 --run one")
    assert wrong.returncode == 2
    assert "did you mean 'robot3'" in wrong.stderr
    assert here("step 2 --run one").returncode == 0  # by then it has heeded all
    kept = msgspec.json.decode((folder / "one" / "handling.json").read_bytes())
    assert kept == {"rate": 3.0, "paused": True, "selected": "robot3"}
    assert here("kill world --run one").returncode == 0

    def is_back() -> bool:
        status = told()
        return status is not None and status.state == "paused" and status.rate == 3.0

    processes.until(is_back, 30.0, "a new world that is paused")
    assert here("rate 0 --run one").returncode == 0
    assert here("resume --run one").returncode == 0
    printed, _ = run.communicate(timeout=60.0)
    assert run.returncode == 0
    assert json.loads(printed)["outcome"] == "succeeded"
    assert not (folder / "one" / "handling.json").exists()
