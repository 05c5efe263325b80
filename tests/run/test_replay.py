"""Replay holds whatever befalls robots, links and the world, and says where it does not."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest
import tomli_w

from agents import robot
from swarm import errors, faults, messages, recording, scenario
from swarm.messages import TickRecord
from swarm.run import difference, library, replay, why
from swarm.scenario import Scenario
from tests.run import processes
from world import simulation

TICKS = 90


def plan_of(name: str = "two-obstacles", *settings: str) -> Scenario:
    _, where, data = library.read_scenario(name)
    return scenario.decode(data, where, settings=settings)


class Swarm:
    """The pure cores joined by hand, so that anything can be done to them at any tick."""

    def __init__(self, plan: Scenario) -> None:
        self.plan = plan
        self.world = simulation.build(plan)
        self.state = simulation.init(self.world)
        self.minds = {row.name: robot.init(plan.setup(row.name)) for row in plan.robots}
        self.events: list[messages.Event] = []
        self.unheard: set[str] = set()  # whose answers get lost in this tick

    def inflict(self, spec: str) -> None:
        fault = msgspec.convert(faults.table(spec, at_s=0.0), faults.Fault)
        names = list(self.minds)
        rows = faults.choose(fault.target, names, [True] * len(names), None, seed=1, number=0)
        self.state = simulation.inflict(self.world, self.state, 0, fault, rows)

    def lose(self, name: str) -> None:
        self.state = simulation.lose(self.world, self.state, name)

    def revive(self, name: str) -> None:
        self.state = simulation.revive(self.world, self.state, name)

    def restart(self, name: str, incarnation: int) -> None:
        self.revive(name)
        self.minds[name] = robot.init(self.plan.setup(name), incarnation)
        self.say("robot-started", name, "", incarnation)

    def say(self, kind: messages.EventKind, name: str, text: str, incarnation: int = 0) -> None:
        tick = self.state.tick
        stamp_ns = self.plan.stamp_ns(tick)
        self.events.append(messages.Event(tick, stamp_ns, kind, name, text, incarnation))

    def tick(self) -> TickRecord:
        frames = simulation.sense(self.world, self.state)
        commands = []
        for frame in frames:
            setup = self.plan.setup(frame.robot)
            self.minds[frame.robot], command = robot.step(setup, self.minds[frame.robot], frame)
            if frame.robot not in self.unheard:
                commands.append(command)
        self.state, due = simulation.hold_back(self.world, self.state, commands)
        record = simulation.record(self.world, self.state, frames, due, tuple(self.events))
        self.events.clear()
        self.unheard.clear()
        newest = {command.robot: command for command in due}
        self.state = simulation.step(self.world, self.state, newest)
        self.state, _ = simulation.relieve(self.world, self.state)
        return record


def run(swarm: Swarm, befall: Callable[[Swarm, int], None], ticks: int = TICKS) -> list[TickRecord]:
    records = []
    for tick in range(ticks):
        befall(swarm, tick)
        records.append(swarm.tick())
    return records


def write(path: Path, plan: Scenario, records: list[TickRecord], *, segment: int = 0) -> Path:
    toml = tomli_w.dumps(scenario.to_builtins(plan)).encode()
    with recording.Writer(path, toml, {}, segment=segment, first_tick=records[0].tick) as writer:
        for record in records:
            writer.write(record)
    return path


def replayed(folder: Path, befall: Callable[[Swarm, int], None], *settings: str) -> replay.Replay:
    plan = plan_of("two-obstacles", *settings)
    return replay.replay(write(folder, plan, run(Swarm(plan), befall)))


FAULTS = [
    "loss:all,probability=0.4",
    "delay:robot2,delay_s=1.2",
    "duplicate:all,probability=0.5",
    "nan:robot1+1.6",
    "sensor-stuck:robot4",
    "slow:robot3+2.4,late_s=0.8",
    "actuator-stuck:leader+0.8",
    "dead:robot5",
    "partition:robot1/robot2+2.4",
]


def test_replay_is_equal_under_declared_disturbances(tmp_path: Path) -> None:
    found = replayed(
        tmp_path,
        lambda swarm, tick: None,
        *("disturbance.range_sigma_m=0.01", "disturbance.position_sigma_m=0.01"),
        *("disturbance.yaw_sigma_rad=0.0087", "disturbance.latency_ticks=1"),
        *("disturbance.speed_error=0.05", "disturbance.loss_probability=0.2"),
    )
    assert (found.difference, found.missing, found.ok) == (None, None, True)


@pytest.mark.parametrize("spec", FAULTS)
def test_replay_is_equal_under_a_fault(tmp_path: Path, spec: str) -> None:
    def befall(swarm: Swarm, tick: int) -> None:
        if tick == 20:
            swarm.inflict(spec)

    found = replayed(tmp_path, befall)
    assert (found.difference, found.missing, found.ok) == (None, None, True)
    assert found.ticks == TICKS
    assert found.state_hash == found.recorded_hash is not None


def test_replay_is_equal_under_all_faults_at_once_and_with_restarts(tmp_path: Path) -> None:
    def befall(swarm: Swarm, tick: int) -> None:
        if 10 <= tick < 10 + len(FAULTS):
            swarm.inflict(FAULTS[tick - 10])
        if tick in (30, 60):
            swarm.lose("robot2")
        if tick in (40, 61):
            swarm.restart("robot2", 1 if tick == 40 else 2)

    found = replayed(tmp_path, befall)
    assert (found.difference, found.missing, found.restarts) == (None, None, 2)
    assert found.ok


def test_replay_begins_again_with_a_robot_that_was_started_again(tmp_path: Path) -> None:
    def befall(swarm: Swarm, tick: int) -> None:
        if tick == 30:
            swarm.lose("robot2")
        if tick == 42:
            swarm.restart("robot2", 1)

    plan = plan_of()
    records = run(Swarm(plan), befall)
    found = replay.replay(write(tmp_path / "told.mcap", plan, records))
    assert (found.ok, found.restarts, found.commands) == (True, 1, 6 * TICKS - 12)
    records[42] = msgspec.structs.replace(records[42], events=())
    found = replay.replay(write(tmp_path / "untold.mcap", plan, records))
    assert not found.ok
    assert found.missing is not None
    assert "tick 42: expected that robot2 had been started as incarnation 1" in found.missing
    assert found.ticks == 42


def test_replay_hears_a_slow_robot_from_its_life_before(tmp_path: Path) -> None:
    """Its last commands arrive when the new process is already there."""

    def befall(swarm: Swarm, tick: int) -> None:
        if tick == 20:
            swarm.inflict("slow:robot2,late_s=0.8")
        if tick == 40:
            swarm.restart("robot2", 1)

    found = replayed(tmp_path, befall)
    assert (found.difference, found.missing, found.restarts) == (None, None, 1)
    # 60 ticks before it was slow or late for good, and the last 10 were never heard
    assert found.commands == 6 * TICKS - 10


def test_replay_goes_on_with_the_old_state_after_a_hang(tmp_path: Path) -> None:
    def befall(swarm: Swarm, tick: int) -> None:
        if tick == 30:
            swarm.lose("robot4")
        if tick == 50:
            swarm.revive("robot4")

    assert replayed(tmp_path, befall).ok


@pytest.mark.parametrize("lost", [[30], [30, 31, 32], [30, 31, 40, 55]])
def test_replay_finds_the_answers_that_nobody_heard(tmp_path: Path, lost: list[int]) -> None:
    def befall(swarm: Swarm, tick: int) -> None:
        if tick in lost:
            swarm.unheard.add("robot4")

    found = replayed(tmp_path, befall)
    assert (found.difference, found.missing) == (None, None)
    assert found.unheard == len(lost)
    assert found.ok


def test_replay_sees_segments_as_one_run(tmp_path: Path) -> None:
    plan = plan_of()
    records = run(Swarm(plan), lambda swarm, tick: None)
    write(tmp_path, plan, records[:50])
    write(tmp_path, plan, records[40:], segment=1)
    found = replay.replay(tmp_path)
    assert (found.ok, found.ticks) == (True, TICKS)
    assert replay.replay(tmp_path, "robot3").commands == TICKS


def test_replay_names_tick_robot_and_field_of_the_first_difference(tmp_path: Path) -> None:
    plan = plan_of()
    records = run(Swarm(plan), lambda swarm, tick: None)
    other = plan_of("two-obstacles", "field.k_r=31.0")
    found = replay.replay(write(tmp_path, other, records))
    assert found.difference is not None
    where = found.difference
    assert not found.ok
    assert where.field.startswith("command.")
    # the first frame in which anybody is within reach of an obstacle, by a plain search
    seen = next(
        record.tick
        for record in records
        if any(any(command.trace.arcs) for command in record.commands)
    )
    assert where.tick == seen
    assert found.recorded_hash != found.state_hash


def test_replay_tells_minus_zero_from_zero(tmp_path: Path) -> None:
    plan = plan_of("two-obstacles")
    records = run(Swarm(plan), lambda swarm, tick: None, ticks=5)
    command = records[3].commands[0]
    assert command.trace.error == (0.0, 0.0)
    trace = msgspec.structs.replace(command.trace, error=(0.0, -0.0))
    commands = (msgspec.structs.replace(command, trace=trace), *records[3].commands[1:])
    records[3] = msgspec.structs.replace(records[3], commands=commands)
    found = replay.replay(write(tmp_path, plan, records))
    assert found.difference == replay.Difference(
        3, command.robot, "command.trace.error[1]", "-0.0", "0.0"
    )


def test_beacons_are_kept_while_they_can_be_heard_and_no_longer(
    made_ticks: Callable[..., tuple[TickRecord, ...]],
) -> None:
    said = replay.Beacons(2, history_ticks=10)
    ticks = made_ticks(2, 60, beams=24)
    for record in ticks:
        commands = record.commands if record.tick < 5 else record.commands[:1]
        said.hear(msgspec.structs.replace(record, commands=commands), ["robot1", "robot2"])
    assert said[0, 49].tick == 49
    assert said[1, 4].tick == 4  # the newest two of who is silent since
    assert said[1, 3].tick == 3
    with pytest.raises(KeyError):
        said[0, 48]


def test_replay_and_diff_hold_for_processes_that_suffered(folder: Path) -> None:
    faults_ = ("restart:robot2@3.2+1.6", "hang:robot4@4+1.6", "kill:world@4.8", "loss:all@0.8+4")
    line = ("run", "two-obstacles", "--duration", "8", "-q", "--set", "recording.rerun=false")
    line = (*line, *(f"--fault={fault}" for fault in faults_))
    processes.swarm(folder, *line, "--out", "zenoh")
    processes.swarm(folder, *line, "--out", "memory", "--bus", "memory")
    found = replay.replay(folder / "zenoh")
    assert (found.difference, found.missing, found.restarts, found.ok) == (None, None, 1, True)
    assert difference.difference(folder / "zenoh", folder / "memory").first is None
    verdict = recording.verify(folder / "zenoh")
    assert verdict.ok
    assert "(world killed), continued from tick 60 by run.1.mcap" in "\n".join(verdict.text)


@pytest.mark.parametrize("what", ["robots", "row", "beams", "command"])
def test_record_of_another_scenario_is_told_apart(tmp_path: Path, what: str) -> None:
    plan = plan_of()
    records = run(Swarm(plan), lambda swarm, tick: None, ticks=6)
    record, frame = records[4], records[4].frames[1]
    stranger = msgspec.structs.replace(record.commands[0], robot="stranger")
    changes: dict[str, dict[str, object]] = {
        "robots": {"robots": record.robots[:2]},
        "row": {"frames": (msgspec.structs.replace(frame, row=6),)},
        "beams": {"frames": (msgspec.structs.replace(frame, ranges=messages.floats([1.0])),)},
        "command": {"commands": (stranger,)},
    }
    records[4] = msgspec.structs.replace(record, **changes[what])
    path = write(tmp_path, plan, records)
    found = replay.replay(path)
    assert (found.ok, found.ticks) == (False, 4)
    assert found.missing is not None
    assert found.missing.startswith("tick 4: expected ")
    with pytest.raises(errors.RecordingError, match="tick 4: expected "):
        why.why(path, "robot1", 0.32)
