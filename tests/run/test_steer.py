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
