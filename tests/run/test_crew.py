"""Real children: signals reach them, deaths are noticed, requests are answered when it is so."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from multiprocessing import connection, forkserver
from pathlib import Path
from typing import Any, Literal

import psutil
import pytest

from swarm.messages import ProcessRequest, Reply
from swarm.run import crew, supervision
from swarm.run.child import Child
from swarm.run.inbox import Ask, Inbox

OBEDIENT = "import time; time.sleep(60)"
STUBBORN = "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); time.sleep(60)"
FAILING = "import sys; print('no wheels', file=sys.stderr, flush=True); sys.exit(3)"
POLICY = supervision.of_robot(start_timeout_s=60.0, stop_timeout_s=0.3)
WORLD = supervision.Policy(restart="on-failure", restart_delay_s=0.0, stop_timeout_s=0.3)


class Team:
    """A crew whose children run a line of Python, and the loop that a supervisor has round it."""

    def __init__(self, folder: Path, **lines: str) -> None:
        self.lines = lines
        self.folder = folder
        self.said: list[str] = []
        policies = {name: WORLD if name == crew.WORLD else POLICY for name in lines}
        self.crew = crew.Crew(policies, self.start, self.said.append)
        self.inbox = Inbox()
        for name in lines:
            self.crew.tell(name, supervision.Start())

    def start(self, name: str, incarnation: int) -> Child:
        log = self.folder / f"{name}.log"
        line = f"import os; os.dup2(os.open({str(log)!r}, os.O_CREAT | os.O_WRONLY, 0o644), 2)\n"
        run: Any = exec
        arguments: Any = line + self.lines[name]
        return Child(name, run, arguments, log)

    def turn(self) -> None:
        for ask in self.inbox.take():
            self.crew.take(ask)
        self.crew.notice()
        waitables = [self.inbox.fileno(), *self.crew.waitables()]
        connection.wait(waitables, timeout=self.crew.patience_s(0.1))

    def until(self, condition: Callable[[], object]) -> None:
        deadline_s = time.monotonic() + 10.0
        while not condition():
            assert time.monotonic() < deadline_s
            self.turn()

    def ask(
        self,
        name: str,
        action: Literal["kill", "stop", "continue", "start", "inspect"],
        incarnation: int = 0,
    ) -> Reply:
        """As the world asks, from another thread."""
        replies: list[Reply] = []
        request = ProcessRequest(name, action, incarnation)
        asking = threading.Thread(target=lambda: replies.append(self.inbox.ask(request)))
        asking.start()
        self.until(lambda: replies)
        asking.join()
        return replies[0]

    def pid(self, name: str) -> int:
        return int(self.crew.state_of(name).rsplit(" ", 1)[1])

    def close(self) -> None:
        self.crew.stop_all()
        self.until(self.crew.is_over)
        self.inbox.close()


@pytest.fixture
def team(tmp_path: Path) -> Iterator[Callable[..., Team]]:
    teams: list[Team] = []

    def make(**lines: str) -> Team:
        teams.append(Team(tmp_path, **lines))
        return teams[-1]

    yield make
    for one in teams:
        one.close()


def test_requests_are_answered_when_they_are_so(team: Callable[..., Team]) -> None:
    one = team(robot1=OBEDIENT)
    first = one.pid("robot1")
    assert one.ask("robot1", "stop").ok
    assert psutil.Process(first).status() == psutil.STATUS_STOPPED
    assert one.ask("robot1", "inspect").text == f"stopped: pid {first}"
    assert one.ask("robot1", "continue").ok
    assert psutil.Process(first).status() != psutil.STATUS_STOPPED
    assert one.ask("robot1", "inspect").text == f"running: pid {first}"
    assert one.ask("robot1", "start", 1).ok
    assert not psutil.pid_exists(first)
    second = one.pid("robot1")
    assert one.crew.lives["robot1"].incarnation == 1
    assert one.ask("robot1", "kill").ok
    assert not psutil.pid_exists(second)
    assert one.ask("robot1", "inspect").text == "dead: killed by SIGKILL"
    assert one.ask("robot1", "kill") == Reply(True, "was dead already")
    refused = one.ask("robot1", "stop")
    assert not refused.ok
    assert refused.text.startswith("dead")


def test_strangers_and_the_world_are_not_signalled(team: Callable[..., Team]) -> None:
    one = team(robot1=OBEDIENT)
    for name, action in (("nobody", "kill"), ("world", "stop"), ("world", "start")):
        reply = one.ask(name, action)  # type: ignore[arg-type]
        assert not reply.ok
        assert "expected a robot of this run" in reply.text


def test_one_that_fails_says_how_and_why(team: Callable[..., Team]) -> None:
    one = team(robot1=FAILING)
    one.until(lambda: one.crew.lives["robot1"].phase == "dead")
    assert one.ask("robot1", "inspect").text == "dead: ended with exit code 3: no wheels"
    assert one.said[0].startswith("robot1 ended with exit code 3: no wheels (log: ")


def test_killed_world_is_started_again(team: Callable[..., Team]) -> None:
    one = team(world=OBEDIENT)
    first = one.pid("world")
    one.ask("world", "kill")
    one.until(lambda: one.crew.lives["world"].incarnation == 1)
    assert one.pid("world") != first
    assert one.crew.lives["world"].restarts == 1


def test_child_that_ignores_sigterm_is_killed(team: Callable[..., Team]) -> None:
    one = team(robot1=STUBBORN, robot2=OBEDIENT)
    ignored = 1 << (signal.SIGTERM - 1)
    one.until(lambda: _ignored(one.pid("robot1")) & ignored)
    one.crew.stop_all()
    one.until(one.crew.is_over)
    assert one.crew.exit_code("robot1") == -signal.SIGKILL
    assert one.crew.exit_code("robot2") == -signal.SIGTERM
    assert one.said == ["robot1 did not end within 0.3 s when asked: killed"]


def _ignored(pid: int) -> int:
    status = Path(f"/proc/{pid}/status").read_text()
    return int(next(line.split()[1] for line in status.splitlines() if "SigIgn" in line), 16)


def test_stopped_child_ends_when_asked(team: Callable[..., Team]) -> None:
    one = team(robot1=OBEDIENT)
    one.ask("robot1", "stop")
    one.crew.stop_all()
    one.until(one.crew.is_over)
    assert one.crew.exit_code("robot1") == -signal.SIGTERM


def test_nothing_is_started_after_the_end(team: Callable[..., Team]) -> None:
    one = team(robot1=OBEDIENT)
    one.crew.stop_all()
    one.until(one.crew.is_over)
    assert one.ask("robot1", "start", 1) == Reply(False, "the run is over")


def test_starting_again_and_again_leaves_nothing_behind(team: Callable[..., Team]) -> None:
    one = team(robot1=OBEDIENT)
    one.ask("robot1", "start", 1)
    me = psutil.Process()
    open_before, threads_before = me.num_fds(), me.num_threads()
    for incarnation in range(2, 22):
        assert one.ask("robot1", "start", incarnation).ok
    assert me.num_fds() == open_before
    assert me.num_threads() == threads_before
    states = [child.status() for child in me.children(recursive=True)]
    assert psutil.STATUS_ZOMBIE not in states


def test_one_that_cannot_be_started_is_dead_and_the_rest_goes_on(
    team: Callable[..., Team], monkeypatch: pytest.MonkeyPatch
) -> None:
    one = team(robot1=OBEDIENT)

    def fail(*_: object) -> Child:
        raise OSError(24, "Too many open files")

    monkeypatch.setattr(one.crew, "_start", fail)
    reply = one.ask("robot1", "start", 1)
    assert reply == Reply(False, "could not be started")
    assert one.said == ["robot1 cannot be started: [Errno 24] Too many open files"]


def test_forkserver_that_is_killed_is_replaced(team: Callable[..., Team]) -> None:
    one = team(robot1=OBEDIENT)
    server: Any = forkserver._forkserver
    pid = one.pid("robot1")
    os.kill(server._forkserver_pid, signal.SIGKILL)
    assert one.ask("robot1", "inspect").text == f"running: pid {pid}"
    assert one.ask("robot1", "start", 1).ok
    assert one.pid("robot1") != pid


def test_what_we_slept_through_counts_against_nobody(
    team: Callable[..., Team], monkeypatch: pytest.MonkeyPatch
) -> None:
    one = team(robot1=OBEDIENT)
    before_s = one.crew.now_s()
    clock = time.monotonic
    monkeypatch.setattr(time, "monotonic", lambda: clock() + 3600.0)
    assert one.crew.now_s() - before_s < 2.0


def test_inbox_answers_those_who_still_wait_when_it_closes() -> None:
    inbox = Inbox()
    replies: list[Reply] = []
    request = ProcessRequest("robot1", "kill")
    asking = threading.Thread(target=lambda: replies.append(inbox.ask(request)))
    asking.start()
    connection.wait([inbox.fileno()], timeout=10.0)
    inbox.close()
    asking.join(10.0)
    assert replies == [Reply(False, "the run is over")]
    assert inbox.ask(request) == Reply(False, "the run is over")


def test_ask_that_nobody_answers_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("swarm.run.inbox.ANSWER_S", 0.01)
    reply = Ask(ProcessRequest("robot1", "kill")).wait()
    assert not reply.ok
    assert "did not answer" in reply.text


def test_child_never_signals_another_process_with_its_number(
    team: Callable[..., Team],
) -> None:
    one = team(robot1=OBEDIENT)
    held = one.crew._children["robot1"]
    one.ask("robot1", "kill")
    held.pid = os.getpid()  # as if the number had been given away
    held.send(signal.SIGKILL)  # we would not come back from this
