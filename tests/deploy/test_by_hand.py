"""World and robots started one by one, as on several hosts."""

from __future__ import annotations

import contextlib
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.deploy import files
from tests.run import processes

FINISH_S = 60.0
END_S = 5.0
ONE_SECOND = ("--set", "duration_s=1.0")

Start = Callable[..., "subprocess.Popen[str]"]


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Start]:
    """`start("robot", "robot1", ...)` executes `swarm robot robot1 ...`; all end with the test."""
    with contextlib.ExitStack() as started:

        def launch(*arguments: str) -> subprocess.Popen[str]:
            one = started.enter_context(processes.start(tmp_path, *arguments))
            started.callback(_end, one)
            return one

        yield launch


def _end(process: subprocess.Popen[str]) -> None:
    process.terminate()
    try:
        process.wait(END_S)
    except subprocess.TimeoutExpired:
        process.kill()


def robot(start: Start, name: str, endpoint: str, *arguments: str) -> subprocess.Popen[str]:
    return start("robot", name, "--run", "hand", "--connect", endpoint, *arguments)


def world(start: Start, endpoint: str, *arguments: str) -> subprocess.Popen[str]:
    command = ("world", "empty", "--robots", "2", "--run", "hand", "--listen", endpoint)
    return start(*command, *files.UNRECORDED, *arguments)


def succeeds(a_world: subprocess.Popen[str]) -> None:
    said, problems = a_world.communicate(timeout=FINISH_S)
    assert a_world.returncode == 0, problems
    assert "empty: succeeded" in said
    assert "2 of 2 arrived" in said


def test_worlds_succeed_when_their_robots_come_by_hand_before_and_after_them(
    start: Start, endpoint: str
) -> None:
    early = robot(start, "robot1", endpoint)
    a_world = world(start, endpoint, *ONE_SECOND)
    late = robot(start, "robot2", endpoint)
    succeeds(a_world)
    succeeds(world(start, endpoint, *ONE_SECOND))  # the robots have stayed and begin again
    for one in (early, late):
        one.terminate()
        _, problems = one.communicate(timeout=FINISH_S)
        assert one.returncode == 0, problems


def test_world_fails_and_names_the_robot_that_does_not_come(start: Start, endpoint: str) -> None:
    robot(start, "robot1", endpoint)
    a_world = world(start, endpoint, *ONE_SECOND, "--set", "clock.start_timeout_s=1")
    said, problems = a_world.communicate(timeout=FINISH_S)
    assert a_world.returncode == 1, said
    assert "expected succeeded, got failed" in problems
    outcome = {words[0]: words[1] for words in map(str.split, said.splitlines()) if words[1:]}
    assert (outcome["robot1"], outcome["robot2"]) == ("arrived", "failed")
    assert "robot-missing robot2" in problems


def test_world_and_robots_meet_over_tls_by_the_name_of_the_host(
    start: Start, endpoint: str, certificates: Path
) -> None:
    port = endpoint.rpartition(":")[2]
    tls = ("--tls", str(certificates))
    a_world = world(start, f"tls/0.0.0.0:{port}", *ONE_SECOND, *tls)
    for name in ("robot1", "robot2"):
        robot(start, name, f"tls/localhost:{port}", *tls)
    said, problems = a_world.communicate(timeout=FINISH_S)
    assert a_world.returncode == 0, problems
    assert "2 of 2 arrived" in said
