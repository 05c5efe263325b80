"""Faults of processes, exact to the tick: in memory, and the same between processes.

Repeat by hand:  swarm run SCENARIO --fault SPEC --json;  the same with --bus memory
"""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from swarm import lifetime, messages, metrics, scenario
from swarm.messages import ControlRequest, Event, Reply, TickRecord
from swarm.run import library, lockstep
from swarm.scenario import Scenario
from tests.run import processes
from world import checkpoint, conductor


def plan(name: str, *faults: str, settings: tuple[str, ...] = ()) -> Scenario:
    _, where, data = library.read_scenario(name)
    return scenario.decode(data, where, faults=faults, settings=settings)


class Run:
    """One run in memory, and what it left."""

    def __init__(self, name: str, *faults: str, settings: tuple[str, ...] = ()) -> None:
        self.records: dict[int, TickRecord] = {}
        self.seen: list[int] = []
        self.plan = plan(name, *faults, settings=settings)
        self.conduct = lockstep.run(self.plan, [self._keep])
        facts = metrics.Facts(scenario=name, run="r", bus="memory", restarts=self.conduct.restarts)
        self.summary = metrics.summary(self.conduct.score, facts)

    def _keep(self, record: TickRecord) -> None:
        self.records[record.tick] = record
        self.seen.append(record.tick)

    @property
    def hash(self) -> str:
        return self.conduct.score.hash.hexdigest()

    def events(self, kind: str) -> list[Event]:
        return [
            event
            for record in self.records.values()
            for event in record.events
            if event.kind == kind
        ]

    def has_frame(self, row: int, tick: int) -> bool:
        return any(frame.row == row for frame in self.records[tick].frames)


SHORT = ("duration_s=8.0",)


def test_hung_robot_gets_no_frame_and_goes_on_with_what_it_remembers() -> None:
    run = Run("head-on-pairs", "hang:robot2@1.6+2.0", settings=SHORT)
    present = [tick for tick in run.records if run.has_frame(1, tick)]
    assert [tick for tick in run.records if tick not in present] == list(range(20, 45))
    assert not run.records[20].robots[1].alive
    assert run.records[44].robots[1].twist.speed_mps == 0.0
    assert run.records[45].robots[1].alive
    assert run.records[45].commands[1].beacon.incarnation == 0
    assert [(event.tick, event.robot) for event in run.events("fault-over")] == [(45, "robot2")]
    assert run.records[60].robots[1].twist.speed_mps > 0.3


def test_restarted_robot_remembers_nothing_and_says_so() -> None:
    run = Run("head-on-pairs", "restart:robot2@1.6+0.8", settings=SHORT)
    (event,) = run.events("robot-started")
    assert (event.tick, event.robot, event.incarnation) == (30, "robot2", 1)
    assert not run.has_frame(1, 29)
    assert run.has_frame(1, 30)
    assert run.records[30].commands[1].beacon.incarnation == 1
    assert run.summary.per_robot[1].restarts == 1


def test_killed_robot_comes_back_by_policy_until_the_limit() -> None:
    run = Run(
        "head-on-pairs",
        *("kill:robot2@1.6", "kill:robot2@3.2", "kill:robot2@4.8"),
        settings=(
            *SHORT,
            "restart.robot=on-failure",
            "restart.restart_delay_s=0.4",
            "restart.restart_max=2",
        ),
    )
    starts = [(event.tick, event.incarnation) for event in run.events("robot-started")]
    assert starts == [(25, 1), (50, 2)]
    assert not run.records[100].robots[1].alive


def test_run_waits_for_a_robot_that_is_due_to_come_back() -> None:
    quick = Run("head-on-pairs")
    end_s = quick.conduct.score.tick * quick.plan.dt_s
    at_s = round(end_s / 0.08 - 5) * 0.08
    late = Run("head-on-pairs", f"restart:robot2@{at_s:.2f}+4.0")
    assert late.summary.outcome == "succeeded"
    assert late.conduct.score.tick > quick.conduct.score.tick + 40


@pytest.mark.parametrize("ticks", [(0,), (1,), (37,), (36, 38, 38), (20, 90)])
def test_killed_world_goes_on_as_if_nothing_had_been(ticks: tuple[int, ...]) -> None:
    plain = Run("head-on-pairs", settings=SHORT)
    kills = [f"kill:world@{tick * 0.08:.2f}" for tick in ticks]
    killed = Run("head-on-pairs", *kills, settings=SHORT)
    assert killed.hash == plain.hash
    assert killed.seen == sorted(killed.seen)  # an exact kill repeats nothing
    assert len(killed.events("world-resumed")) == len(set(ticks))


def test_killed_world_remembers_faults_at_work() -> None:
    faults = (
        *("hang:robot2@1.6+2.0", "restart:robot3@1.6+1.2", "loss:all@0.8+3,probability=0.4"),
        *("sensor-stuck:robot1@2.0+1", "slow:robot4@2.0+2", "delay:robot5@1.6+3,delay_s=0.24"),
    )
    plain = Run("head-on-pairs", *faults, settings=SHORT)
    killed = Run("head-on-pairs", *faults, "kill:world@2.4", "kill:world@3.2", settings=SHORT)
    assert killed.hash == plain.hash


def test_world_that_was_killed_between_checkpoints_repeats_their_ticks() -> None:
    """A kill from outside, at any moment: what was not kept is done again, with the same bytes."""
    plain = Run("head-on-pairs", settings=SHORT)
    seats = lockstep.Seats(plain.plan, "memory")
    kept: list[bytes] = []
    records: dict[int, TickRecord] = {}

    class Keeper(conductor.Nowhere):
        def save(self, checkpoint: bytes) -> None:
            kept.append(checkpoint)

    def die_at_50(record: TickRecord) -> None:
        records[record.tick] = record
        if record.tick == 50:
            raise lockstep.WorldKilled

    first = seats.world_bus()
    with pytest.raises(lockstep.WorldKilled):
        conductor.conduct(first, plain.plan, [die_at_50], lifetime.Stop(), keeper=Keeper())
    first.close()
    state = checkpoint.decode(kept[-1], "here")
    assert 50 - 12 < state.state.tick <= 50
    resumed = conductor.Resumed(
        state,
        metrics.of_records(plain.plan, [records[tick] for tick in range(state.state.tick)]),
    )
    second = seats.world_bus()
    again = conductor.conduct(second, plain.plan, [], lifetime.Stop(), resumed=resumed)
    assert again.score.hash.hexdigest() == plain.hash


def test_fault_asked_for_while_it_runs_strikes_at_the_next_tick() -> None:
    run_plan = plan("head-on-pairs", settings=SHORT)
    seats = lockstep.Seats(run_plan, "memory")
    bus = seats.world_bus()
    person = seats.world_bus()
    replies: list[Reply] = []
    records: list[TickRecord] = []

    def observe(record: TickRecord) -> None:
        records.append(record)
        specs = {20: "kill:robot2", 21: "kill:robot9", 22: "kill:robot3@0.8", 23: "loss:all@4+1"}
        if record.tick in specs:
            request = ControlRequest("fault", specs[record.tick])
            replies.append(person.ask(messages.CONTROL, request, 1.0))

    conductor.conduct(bus, run_plan, [observe], lifetime.Stop())
    assert [reply.ok for reply in replies] == [True, False, False, True]
    assert replies[0].text == "kill:robot2@1.68"
    assert "got 'robot9'" in replies[1].text
    assert "still to come" in replies[2].text
    struck = [(e.tick, e.robot, e.fault) for record in records for e in record.events if e.fault]
    assert struck[0] == (21, "robot2", "kill")
    assert (50, "robot1", "loss") in struck


@pytest.mark.parametrize(
    "faults",
    [
        ("hang:robot2@4+3", "corrupt:robot1@4+2"),
        ("restart:robot3@9.6+1", "kill:world@9.6", "loss:all@0"),
        ("partition:any:0.5@9.6+3", "slow:robot4@4+4", "kill:world@5.04"),
    ],
    ids=lambda faults: faults[0].partition(":")[0],
)
def test_processes_suffer_the_same_faults_with_the_same_bytes(
    folder: Path, faults: tuple[str, ...]
) -> None:
    line = ("run", "two-obstacles", "--json", "-q", *(f"--fault={fault}" for fault in faults))
    over_zenoh = processes.swarm(folder, *line, "--out", "zenoh")
    in_memory = processes.swarm(folder, *line, "--out", "memory", "--bus", "memory")
    one, other = json.loads(over_zenoh.stdout), json.loads(in_memory.stdout)
    assert one["state_hash"] == other["state_hash"], over_zenoh.stderr
    assert one["world_restarts"] == other["world_restarts"] == ("kill:world" in str(faults))
    assert one["faults"] == other["faults"]
    assert one["recording"]["lost"] == 0
    verdict = processes.swarm(folder, "verify", "zenoh")
    assert verdict.returncode == 0, verdict.stdout


def test_world_killed_while_the_disk_is_full_dies_of_it_only_once(folder: Path) -> None:
    faults = ("--fault=disk-full:world@4+6", "--fault=kill:world@8.0")  # no checkpoint for 4 s
    line = ("run", "two-obstacles", "--json", "-q")
    plain = processes.swarm(folder, *line, "--out", "plain", "--bus", "memory")
    done = processes.swarm(folder, *line, *faults, "--out", "killed", "--bus", "memory")
    one, other = json.loads(plain.stdout), json.loads(done.stdout)
    assert other["state_hash"] == one["state_hash"], done.stderr
    assert other["world_restarts"] == 1
    assert processes.swarm(folder, "verify", "killed").returncode == 0
