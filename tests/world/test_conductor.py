"""The world's shell over a memory bus and a virtual clock: who is missing, late or strange."""

from __future__ import annotations

from collections.abc import Callable

import msgspec
import pytest

from agents.process import RobotShell
from swarm import lifetime, metrics, scenario
from swarm.bus import Hub, MemoryBus
from swarm.messages import COMMAND, PROCESS, Command, Event, ProcessRequest, Reply, TickRecord
from swarm.run import library
from swarm.scenario import Scenario
from world import conductor


class Clock:
    """Time that passes when it is looked at or slept through."""

    def __init__(self) -> None:
        self.time_s = 0.0

    def now(self) -> float:
        self.time_s += 0.001
        return self.time_s

    def sleep(self, duration_s: float) -> None:
        self.time_s += duration_s


class Stage:
    """A swarm in memory whose robots can be kept away, stilled or delayed."""

    def __init__(
        self, name: str, *settings: str, robots: int | None = None, faults: tuple[str, ...] = ()
    ) -> None:
        _, where, data = library.read_scenario(name)
        self.scenario: Scenario = scenario.decode(
            data, where, settings=settings, robots=robots, faults=faults
        )
        self.hub = Hub()
        self.records: list[TickRecord] = []
        self.clock = Clock()
        self.stop = lifetime.Stop()
        self.bus = MemoryBus(self.hub, "stage")
        self.buses: dict[str, MemoryBus] = {}

    def enter(self, *absent: str) -> None:
        for row in self.scenario.robots:
            if row.name not in absent:
                bus = self.buses[row.name] = MemoryBus(self.hub, "stage")
                shell = RobotShell(bus, self.scenario.setup(row.name))
                self.hub.workers[row.name] = shell.work

    def play(self, *observers: conductor.Observer) -> conductor.Conduct:
        return conductor.conduct(
            self.bus,
            self.scenario,
            [self.records.append, *observers],
            self.stop,
            now=self.clock.now,
            sleep=self.clock.sleep,
        )

    def events(self) -> list[Event]:
        return [event for record in self.records for event in record.events]

    def kinds(self) -> list[tuple[str, str | None]]:
        return [(event.kind, event.robot) for event in self.events()]


def test_run_begins_without_a_robot_that_does_not_come() -> None:
    stage = Stage("empty", "clock.start_timeout_s=3.0", "duration_s=0.8")
    stage.enter("robot2")
    result = stage.play()
    assert ("robot-missing", "robot2") in stage.kinds()
    assert stage.clock.time_s > 3.0
    assert not stage.records[0].robots[1].alive
    assert len(stage.records[0].frames) == 5
    summary = metrics.summary(result.score, metrics.Facts(scenario="empty", run="r", bus="memory"))
    assert summary.outcome == "failed"
    assert summary.per_robot[1].outcome == "failed"


def test_robot_that_does_not_answer_is_hung_at_the_deadline_and_braked() -> None:
    stage = Stage("head-on-pairs", "clock.command_deadline_s=2.0", "duration_s=4.0")
    stage.enter()
    work = stage.hub.workers["robot3"]

    def until_tick_20() -> None:
        if len(stage.records) < 20:
            work()

    stage.hub.workers["robot3"] = until_tick_20
    stage.play()
    (event,) = [event for event in stage.events() if event.kind == "robot-hung"]
    assert (event.robot, event.tick) == ("robot3", 20)
    before, after = stage.records[19].robots[2], stage.records[-1].robots[2]
    assert before.twist.speed_mps > 0.5
    assert not after.alive
    assert after.twist.speed_mps == 0.0
    assert "robot3" not in [command.robot for command in stage.records[-1].commands]
    assert len(stage.records[-1].commands) == 5


def test_robot_whose_token_goes_is_lost_at_once() -> None:
    stage = Stage("empty", "duration_s=1.6")
    stage.enter()

    def leave(record: TickRecord) -> None:
        if record.tick == 4:
            stage.buses["robot5"].close()
            del stage.hub.workers["robot5"]

    stage.play(leave)
    (event,) = [event for event in stage.events() if event.kind == "robot-lost"]
    assert (event.robot, event.tick) == ("robot5", 5)
    assert stage.clock.time_s < 2.0


def forged(name: str, tick: int, beacon_name: str | None = None) -> Command:
    stage = Stage("empty")
    stage.enter()
    stage.stop.request("one tick is enough")
    stage.play()
    command = next(one for one in stage.records[0].commands if one.robot == "robot1")
    beacon = msgspec.structs.replace(command.beacon, name=beacon_name or name, tick=tick)
    return msgspec.structs.replace(command, robot=name, tick=tick, beacon=beacon)


FORGED = {
    "from a stranger": lambda: forged("nobody", 3),
    "in another's name": lambda: forged("robot1", 3, "robot2"),
    "for a tick that has not come": lambda: forged("robot1", 10_000),
    "for a tick that is over": lambda: forged("robot1", 0),
}


@pytest.mark.parametrize("what", FORGED)
def test_forged_command_is_ignored_and_reported_once(what: str) -> None:
    plain = Stage("empty", "duration_s=0.8")
    plain.enter()
    expected = plain.play().score.hash.hexdigest()
    stage = Stage("empty", "duration_s=0.8")
    stage.enter()
    command = FORGED[what]()
    liar = MemoryBus(stage.hub, "stage")

    def lie(record: TickRecord) -> None:
        liar.publish(COMMAND, command, command.robot)

    assert stage.play(lie).score.hash.hexdigest() == expected
    assert stage.kinds().count(("message-rejected", None)) == 1


def test_fault_that_nobody_delivers_fails_the_run_and_changes_nothing_else() -> None:
    stage = Stage("empty", "duration_s=0.8", faults=("kill:robot2@0.4",))
    stage.enter()
    result = stage.play()
    assert stage.records[-1].robots[1].alive
    assert ("fault-failed", "robot2") in stage.kinds()
    summary = metrics.summary(result.score, metrics.Facts(scenario="empty", run="r", bus="memory"))
    assert summary.outcome == "failed"


def test_fault_is_delivered_at_its_tick_before_the_frames() -> None:
    stage = Stage("empty", "duration_s=0.8", faults=("kill:robot2@0.4",))
    stage.enter()
    asked: list[int] = []

    def kill(request: object) -> Reply:
        asked.append(len(stage.records))
        stage.hub.workers.pop("robot2")
        stage.buses["robot2"].close()
        return Reply(True)

    stage.hub.handlers[PROCESS.name] = kill
    stage.play()
    assert asked == [5]
    assert [len(record.frames) for record in stage.records] == [6] * 5 + [5] * 6
    assert ("fault", "robot2") in stage.kinds()
    assert "robot-lost" not in [kind for kind, _ in stage.kinds()]


def test_stop_finishes_the_tick_and_says_why() -> None:
    stage = Stage("two-obstacles")
    stage.enter()

    def interrupt(record: TickRecord) -> None:
        if record.tick == 7:
            stage.stop.request("enough")

    assert stage.play(interrupt).ended == "enough"
    assert stage.records[-1].tick == 7
    assert len(stage.records[-1].commands) == 6


def realtime(deaf_ticks: Callable[[int], bool]) -> tuple[Stage, conductor.Conduct]:
    """Two robots in real time; robot1 does no work at the ticks that `deaf_ticks` picks."""
    stage = Stage("head-on-pairs", "clock.mode='realtime'", "duration_s=4.0", robots=2)
    stage.enter()
    workers = dict(stage.hub.workers)
    plain = stage.clock.sleep

    def sleep(duration_s: float) -> None:
        plain(duration_s)
        for name, work in workers.items():
            if name != "robot1" or not deaf_ticks(len(stage.records)):
                work()

    stage.clock.sleep = sleep  # type: ignore[method-assign]
    return stage, stage.play()


def test_real_time_keeps_the_pace_and_no_command_is_late_when_all_answer() -> None:
    stage, result = realtime(lambda tick: False)
    assert stage.records[-1].tick == 50
    assert stage.clock.time_s == pytest.approx(51 * 0.08, abs=0.2)
    assert result.late_commands == 0
    assert result.commands_total == 2 * 51


def test_real_time_goes_on_without_a_robot_that_stalls_and_brakes_it_after_the_ttl() -> None:
    stage, result = realtime(lambda tick: 20 <= tick < 40)
    speeds_mps = [record.robots[0].twist.speed_mps for record in stage.records]
    assert speeds_mps[23] == pytest.approx(speeds_mps[20], abs=0.05)  # command_ttl is 3 ticks
    assert speeds_mps[30] == 0.0
    assert speeds_mps[-1] > 0.5
    assert all(record.robots[0].alive for record in stage.records)
    assert result.commands_total == 2 * 51 - 20


def test_robot_that_did_not_come_up_is_started_by_the_policy() -> None:
    stage = Stage(
        "empty",
        *("clock.start_timeout_s=3.0", "duration_s=1.6"),
        *("restart.robot='on-failure'", "restart.restart_delay_s=0.4"),
    )
    stage.enter("robot2")
    asked: list[tuple[str, str, int]] = []

    def start(request: ProcessRequest) -> Reply:
        asked.append((request.robot, request.action, request.incarnation))
        bus = stage.buses[request.robot] = MemoryBus(stage.hub, "stage")
        setup = stage.scenario.setup(request.robot)
        stage.hub.workers[request.robot] = RobotShell(bus, setup, request.incarnation).work
        return Reply(True)

    stage.hub.handlers[PROCESS.name] = start
    stage.play()
    assert asked == [("robot2", "start", 1)]
    (event,) = [event for event in stage.events() if event.kind == "robot-started"]
    assert (event.robot, event.tick, event.incarnation) == ("robot2", 5, 1)
    assert stage.records[-1].robots[1].alive
