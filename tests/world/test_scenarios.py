"""One contract for every built-in scenario; a file without it cannot exist."""

from __future__ import annotations

from math import cos, pi, sin, sqrt
from pathlib import Path

import numpy as np
import pytest

import world.scenarios
from swarm import metrics
from swarm.geometry import STILL
from swarm.messages import Array, Beacon, Command, Trace
from swarm.scenario import Scenario, decode
from world import scene, simulation

FOLDER = Path(world.scenarios.__file__).parent
NAMES = sorted(path.stem for path in FOLDER.glob("*.toml"))


def scenario(name: str) -> Scenario:
    return decode((FOLDER / f"{name}.toml").read_bytes(), f"{name}.toml")


def test_scenarios_hold_those_of_the_paper() -> None:
    assert set(NAMES) >= {
        "empty",
        "head-on-pairs",
        "head-on-star",
        "random-field",
        "single-robot",
        "three-obstacles",
        "two-obstacles",
    }


@pytest.mark.parametrize("name", NAMES)
def test_scenarios_begin_with_a_comment_and_expect_an_outcome(name: str) -> None:
    assert (FOLDER / f"{name}.toml").read_text().startswith("# ")
    expect = scenario(name).expect
    assert expect.outcome == ("timeout" if expect.blocked else "succeeded")
    assert expect.collisions == 0
    if any(robot.goal is not None for robot in scenario(name).robots):
        assert (expect.arrived or 0) + (expect.blocked or 0) == len(scenario(name).robots)


@pytest.mark.parametrize("name", NAMES)
def test_scenarios_start_clear_of_everything_and_run_when_everyone_stands(name: str) -> None:
    standing = simulation.build(scenario(name))
    state = simulation.init(standing)
    for tick in range(3):
        frames = simulation.sense(standing, state)
        commands = {}
        for frame in frames:
            beacon = Beacon(
                frame.robot, tick, 0, frame.pose, STILL, 0.22, 1.0, "HOLD", False, (0, 0, 0, 0)
            )
            trace = Trace(Array("<f4", (0,), b""))
            commands[frame.robot] = Command(frame.robot, tick, frame.stamp_ns, STILL, beacon, trace)
        state = simulation.step(standing, state, commands)
    assert [body.pose for body in state.bodies] == [
        body.pose for body in simulation.init(standing).bodies
    ]
    assert min(body.clearance_m for body in state.bodies) > 0.5
    assert not any(body.contact for body in state.bodies)


@pytest.mark.parametrize("name", NAMES)
def test_scenarios_leave_room_at_every_goal_and_final_slot(name: str) -> None:
    plan = scenario(name)
    standing = scene.build(scene.obstacles(plan))
    goals = [robot.goal for robot in plan.robots if robot.goal is not None]
    if plan.formation is not None:
        leader = plan.robots[plan.row(plan.formation.leader)]
        assert leader.goal is not None
        goals += [
            (
                leader.goal[0] - slot.distance_m * cos(slot.bearing_rad),
                leader.goal[1] - slot.distance_m * sin(slot.bearing_rad),
            )
            for slot in plan.slots()
            if slot is not None
        ]
    if goals:
        assert scene.clearance(standing, np.array(goals)).min() > 0.6


@pytest.mark.parametrize(
    ("name", "distance_m"),
    [("two-obstacles", 1.0), ("three-obstacles", 1.0), ("random-field", 2.0)],
)
def test_scenarios_have_the_slots_of_tables_one_and_three(name: str, distance_m: float) -> None:
    plan = scenario(name)
    slots = [plan.slot(row) for row in range(6)]
    assert slots[0] is None
    found = [(slot.distance_m, slot.bearing_rad) for slot in slots if slot is not None]
    near_m, far_m = distance_m * sqrt(2.0), distance_m * sqrt(8.0)
    expected = [
        (near_m, -pi / 4.0),
        (near_m, pi / 4.0),
        (far_m, -pi / 4.0),
        (distance_m * 2.0, 0.0),
        (far_m, pi / 4.0),
    ]
    for one, other in zip(found, expected, strict=True):
        assert one == pytest.approx(other, abs=1e-12)


def test_two_obstacles_is_its_own_mirror_image() -> None:
    plan = scenario("two-obstacles")
    starts = {robot.start for robot in plan.robots}
    assert starts == {(x_m, -y_m, yaw_rad) for x_m, y_m, yaw_rad in starts}
    circles = {obstacle.circle for obstacle in plan.obstacles if obstacle.circle is not None}
    assert circles == {(x_m, -y_m, radius_m) for x_m, y_m, radius_m in circles}


@pytest.mark.parametrize("name", NAMES)
def test_scenarios_expect_only_what_a_summary_has(name: str) -> None:
    plan = scenario(name)
    facts = metrics.Facts(scenario=name, run="test", bus="memory")
    result = metrics.summary(metrics.begin(plan), facts)
    asked = [
        key
        for key in plan.expect.__struct_fields__
        if key != "mirror_pairs" and getattr(plan.expect, key) is not None
    ]
    assert len(result.expect.met) + len(result.expect.missed) == len(asked)
