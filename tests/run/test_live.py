"""Verbs on a running swarm: they strike, and when they cannot they say who is in the way."""

from __future__ import annotations

import functools
import json
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest

from swarm import errors, messages, runs
from swarm.run import processes as standing
from swarm.run.cli import live
from tests.run import processes

Here = Callable[[str], subprocess.CompletedProcess[str]]


@pytest.fixture
def here(folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Here:
    return functools.partial(processes.here, monkeypatch, capsys, folder)


def _tick(card: runs.Card) -> int:
    """Tick of a run, -1 while its world does not answer."""
    try:
        status = live.status_of(card)
    except errors.BusError:
        return -1
    return status.tick if status.state == "running" else -1


@pytest.fixture
def card(folder: Path) -> Iterator[runs.Card]:
    """Card of a swarm that runs, and of which every robot has moved."""
    run = processes.start(folder, "run", "two-obstacles", "--rate", "1", "--out", "live", "-q")
    cards: list[runs.Card] = []

    def found() -> bool:
        cards[:] = [card for card in runs.running() if Path(card.folder).parent == folder]
        return bool(cards) and _tick(cards[0]) > 2

    try:
        processes.until(found, 60.0, "ticks")
        yield cards[0]
    finally:
        run.kill()
        run.communicate()


def test_kill_restart_and_fault_strike(here: Here, card: runs.Card) -> None:
    done = here(f"kill robot5 --run {card.run} --json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["done"].startswith("kill:robot5@")
    assert here(f"restart robot3 --run {card.run}").returncode == 0
    assert here(f"fault hang:robot1+0.5 --run {card.run}").returncode == 0

    def is_done() -> bool:
        rows = {row.name: row for row in live.status_of(card).robots}
        back = rows["robot3"].restarts == 1 and rows["robot3"].state == "running"
        return back and rows["robot5"].state == "killed" and rows["robot1"].state == "running"

    processes.until(is_done, 20.0, "robot3 is back, robot5 is dead, robot1 goes on")


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("kill robto3", ("expected one of leader", "world", "did you mean 'robot3'?")),
        ("restart world", ("expected one of leader", "got 'world'")),
        ("fault kill:robot9", ("fault", "got 'robot9'")),
        ("fault nonsense", ("fault", "kind:target", "'nonsense'")),
    ],
)
def test_what_is_not_there_is_a_usage_error(
    here: Here, monkeypatch: pytest.MonkeyPatch, line: str, words: tuple[str, ...]
) -> None:
    names = ("leader", "robot1", "robot2", "robot3")
    rows = tuple(
        messages.RobotStatus(name, "running", "GO", "leader", False, 0, None) for name in names
    )
    told = messages.Status("one", "", 1, 0, "lockstep", "running", 1.0, 1.0, rows)
    monkeypatch.setattr(live, "pick", lambda _: runs.Card("one", "", 1, 0.0, "", ""))
    monkeypatch.setattr(live, "status_of", lambda _: told)
    done = here(line)
    assert done.returncode == 2
    for word in words:
        assert word in done.stderr


def test_a_stopped_world_is_named_and_does_not_keep_the_swarm_from_stopping(
    here: Here, folder: Path, card: runs.Card, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live, "ASK_TIMEOUT_S", 0.5)
    (world,) = processes.named(folder, "swarm-world")
    world.suspend()
    done = here(f"kill robot2 --run {card.run}")
    assert done.returncode == 1
    assert f"world (pid {world.pid}) is stopped" in done.stderr
    assert "Traceback" not in done.stderr
    done = here(f"stop --run {card.run} --json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == {"run": card.run, "stopped": True}
    assert processes.named(folder, "swarm-") == []


def test_stop_names_the_supervisor_that_is_stopped(
    here: Here, folder: Path, card: runs.Card, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(live, "STOP_TIMEOUT_S", 0.5)
    supervisor = psutil.Process(card.pid)
    supervisor.suspend()
    done = here(f"stop --run {card.run}")
    assert done.returncode == 1
    assert f"the supervisor (pid {card.pid}) is stopped" in done.stderr
    supervisor.resume()
    processes.until(lambda: not processes.named(folder, "swarm-"), 10.0, "all end")


def test_kill_world_reaches_one_that_is_stopped_and_another_takes_its_place(
    here: Here, folder: Path, card: runs.Card
) -> None:
    before = _tick(card)
    (world,) = processes.named(folder, "swarm-world")
    world.suspend()
    done = here(f"kill world --run {card.run}")
    assert done.returncode == 0, done.stderr
    assert "there is no world" in standing.what_blocks(card)

    processes.until(lambda: _tick(card) > before, 60.0, "ticks of another world")
    assert processes.named(folder, "swarm-world")[0].pid != world.pid
