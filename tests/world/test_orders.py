"""New goals for a swarm that runs: given at the desk, delivered once, obeyed, replayed."""

from __future__ import annotations

from pathlib import Path

import pytest
import tomli_w

from swarm import lifetime, messages, scenario
from swarm.bus import Hub, MemoryBus
from swarm.messages import CONTROL, ControlRequest, Reply, TickRecord
from swarm.run import lockstep, replay
from tests.world.test_conductor import Stage
from world import process

AT_TICK = 20


def ordered(
    name: str, request: ControlRequest, *settings: str, robots: int | None = None
) -> tuple[Stage, list[Reply]]:
    """A run in which a request comes at a tick, and what it was answered."""
    stage = Stage(name, *settings, robots=robots)
    stage.enter()
    replies: list[Reply] = []

    def ask(record: TickRecord) -> None:
        if record.tick == AT_TICK:
            replies.append(stage.hub.handlers[CONTROL.name](request))

    stage.play(ask)
    return stage, replies


def goals_sent(stage: Stage) -> list[tuple[int, int, tuple[float, float]]]:
    return [
        (record.tick, frame.row, frame.goal)
        for record in stage.records
        for frame in record.frames
        if frame.goal is not None
    ]


def test_robot_goes_where_it_is_sent_and_arrives_there() -> None:
    request = ControlRequest("goal", robot="robot1", goal=(2.0, 3.0))
    stage, replies = ordered("single-robot", request)
    assert [reply.ok for reply in replies] == [True], replies[0].text
    assert goals_sent(stage) == [(AT_TICK + 1, 0, (2.0, 3.0))]  # once, at the next tick
    last = stage.records[-1].robots[0]
    assert (last.pose.x_m, last.pose.y_m) == pytest.approx((2.0, 3.0), abs=0.15)
    assert last.beacon is not None
    assert last.beacon.goal == (2.0, 3.0)
    texts = [(event.robot, event.text) for event in stage.events() if event.kind == "control"]
    assert texts == [("robot1", "goal (2, 3)")]


def test_formation_follows_its_leader_to_the_new_goal() -> None:
    request = ControlRequest("goal", robot="leader", goal=(3.0, 4.0))
    stage, _ = ordered("two-obstacles", request)
    assert goals_sent(stage) == [(AT_TICK + 1, 0, (3.0, 4.0))]
    robots = stage.records[-1].robots
    assert (robots[0].pose.x_m, robots[0].pose.y_m) == pytest.approx((3.0, 4.0), abs=0.15)
    assert all(robot.beacon is not None and robot.beacon.arrived for robot in robots)


def test_goal_for_a_robot_that_is_away_waits_until_it_is_back() -> None:
    stage = Stage("single-robot", "duration_s=12.0", faults=("hang:robot1@1.6+2",))
    stage.enter()
    stage.hub.handlers[messages.PROCESS.name] = lambda request: Reply(True, "stopped")

    def ask(record: TickRecord) -> None:
        if record.tick == AT_TICK + 2:
            request = ControlRequest("goal", robot="robot1", goal=(2.0, 3.0))
            assert stage.hub.handlers[CONTROL.name](request).ok

    stage.play(ask)
    back = next(event.tick for event in stage.events() if event.kind == "fault-over")
    assert goals_sent(stage) == [(back, 0, (2.0, 3.0))]


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("robot3", "give the goal to its leader, leader"),
        ("robto3", "did you mean 'robot3'?"),
        ("world", "expected one of leader"),
    ],
)
def test_who_cannot_be_sent_somewhere_is_said(name: str, expected: str) -> None:
    request = ControlRequest("goal", robot=name, goal=(1.0, 1.0))
    stage, (reply,) = ordered("two-obstacles", request, "duration_s=2.0")
    assert not reply.ok
    assert expected in reply.text
    assert goals_sent(stage) == []


def test_killed_robot_is_sent_nowhere() -> None:
    stage = Stage("head-on-pairs", "duration_s=3.0", robots=2, faults=("kill:robot1@0.8",))
    stage.enter()
    stage.hub.handlers[messages.PROCESS.name] = lambda request: Reply(True)
    replies: list[Reply] = []

    def ask(record: TickRecord) -> None:
        if record.tick == AT_TICK:
            request = ControlRequest("goal", robot="robot1", goal=(1.0, 1.0))
            replies.append(stage.hub.handlers[CONTROL.name](request))

    stage.play(ask)
    assert "got one that is killed" in replies[0].text


def test_replay_of_a_run_with_orders_gives_the_same_bytes(tmp_path: Path) -> None:
    plan = Stage("two-obstacles", "duration_s=6.0", "recording.rerun=false").scenario
    toml = tomli_w.dumps(scenario.to_builtins(plan)).encode()
    seats = lockstep.Seats(plan, "orders")
    bus = seats.world_bus()
    told: list[messages.Status] = []

    def on_status(status: messages.Status) -> None:
        if not told:
            hub: Hub = bus._hub
            request = ControlRequest("goal", robot="leader", goal=(3.0, 4.0))
            assert hub.handlers[CONTROL.name](request).ok
        told.append(status)

    assert isinstance(bus, MemoryBus)
    summary = process.record_run(
        bus, "two", toml, tmp_path, lifetime.Stop(), bus_name="memory", on_status=on_status
    )
    found = replay.replay(tmp_path / "run.mcap", None)
    assert found.state_hash == summary.state_hash
    assert found.ok
    assert lockstep.run(plan).score.hash.hexdigest() != summary.state_hash
