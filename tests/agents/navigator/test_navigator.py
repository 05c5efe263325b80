"""The navigator in small worlds: it arrives, mirrors, says when there is no way, bears lateness."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, inf
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents import msam, navigator, robot
from agents.lateness import State as Late
from agents.navigator import brake, predict, sight
from swarm import geometry
from swarm.geometry import STILL, TAU, Pose, Twist
from swarm.messages import Beacon, Command, Promise
from swarm.scenario import RobotSetup
from tests.agents import scenes

Line = tuple[Pose, Command]


def setup_of(**changes: Any) -> RobotSetup:
    return scenes.alone(
        **{"controller": "navigator", "goal": (4.0, 0.0), "acceleration_mps2_max": 2.0, **changes}
    )


def drive(
    setup: RobotSetup,
    discs: Sequence[scenes.Disc],
    start: Pose = scenes.ORIGIN,
    ticks: int = 200,
    late_ticks: int = 0,
) -> list[Line]:
    """Poses and commands until it has arrived or failed; the body does what it is told."""
    state, pose, twist = robot.init(setup), start, STILL
    told = [STILL] * late_ticks
    lines: list[Line] = []
    for tick in range(ticks):
        frame = scenes.frame("robot1", tick, pose, twist, scenes.scan(discs, pose))
        state, command = robot.step(setup, state, frame)
        lines.append((pose, command))
        if command.beacon.mode in ("ARRIVED", "FAILED"):
            break
        told.append(command.set_point)
        twist = brake.reached(setup.robot, twist, told.pop(0), setup.dt_s)
        pose = geometry.advance(pose, twist, setup.dt_s)
    return lines


def gap(discs: Sequence[scenes.Disc], lines: Sequence[Line], radius_m: float = 0.22) -> float:
    return min(
        geometry.length(x_m - pose.x_m, y_m - pose.y_m) - disc_m - radius_m
        for pose, _ in lines
        for x_m, y_m, disc_m in discs
    )


def modes(lines: Sequence[Line]) -> set[str]:
    return {command.beacon.mode for _, command in lines}


FIELD = [(1.3, 0.2, 0.3), (2.4, -0.7, 0.4), (2.9, 0.8, 0.35), (1.6, -1.2, 0.3)]


def test_it_arrives_between_discs_and_touches_none() -> None:
    lines = drive(setup_of(), FIELD)
    assert lines[-1][1].beacon.mode == "ARRIVED"
    assert gap(FIELD, lines) > 0.05
    assert len(lines) * scenes.DT_S < 1.5 * 4.0


def test_it_passes_its_way_points_in_order() -> None:
    lines = drive(setup_of(via=((1.0, 1.5), (2.5, 1.5)), via_tolerance_m=0.2), [])
    near = [
        next(i for i, (pose, _) in enumerate(lines) if abs(pose.x_m - x) + abs(pose.y_m - y) < 0.3)
        for x, y in ((1.0, 1.5), (2.5, 1.5), (4.0, 0.0))
    ]
    assert near == sorted(near)
    assert lines[-1][1].beacon.via == ()
    assert lines[-1][1].beacon.mode == "ARRIVED"


@pytest.mark.parametrize("yaw_rad", [0.0, 0.4, -0.6])
@pytest.mark.parametrize(
    "discs",
    [
        [],
        [(1.6, 0.4, 0.3)],
        [(1.2, -0.5, 0.2), (2.4, 0.6, 0.4)],
        [(1.5, 0.9, 0.4), (2.2, -0.7, 0.3), (3.0, 0.35, 0.2)],
    ],
)
def test_mirrored_worlds_have_mirrored_runs(discs: list[scenes.Disc], yaw_rad: float) -> None:
    """But where two ways cost the same to the last digit: then rounding decides."""
    # the goal does not lie on the axis: straight on a line one of two alike sides is taken
    setup, other = setup_of(goal=(4.0, 0.33)), setup_of(goal=(4.0, -0.33))
    one = drive(setup, discs, Pose(0.0, 0.021, yaw_rad), 60)
    two = drive(other, [(x, -y, r) for x, y, r in discs], Pose(0.0, -0.021, -yaw_rad), 60)
    assert len(one) == len(two)
    for (pose, command), (mirror, reply) in zip(one, two, strict=True):
        assert mirror.x_m == pytest.approx(pose.x_m, abs=1e-6)
        assert mirror.y_m == pytest.approx(-pose.y_m, abs=1e-6)
        assert reply.set_point.turn_rate_radps == pytest.approx(
            -command.set_point.turn_rate_radps, abs=1e-6
        )


def test_straight_behind_an_obstacle_it_goes_round_it_on_the_right() -> None:
    disc = [(2.0, 0.0, 0.5)]
    assert min(pose.y_m for pose, _ in drive(setup_of(), disc)) < -0.5


def test_state_is_pure_and_survives_the_wire() -> None:
    setup, state, pose = setup_of(), None, scenes.ORIGIN
    state = robot.init(setup)
    for tick in range(8):
        frame = scenes.frame("robot1", tick, pose, Twist(0.3, 0.1), scenes.scan(FIELD, pose))
        once = robot.step(setup, state, frame)
        assert robot.step(setup, state, frame) == once
        stored = msgspec.msgpack.decode(msgspec.msgpack.encode(state), type=robot.State)
        assert stored == state
        assert robot.step(setup, stored, frame) == once
        state, pose = once[0], geometry.advance(pose, Twist(0.3, 0.1), scenes.DT_S)


def ring(x_m: float, y_m: float, radius_m: float) -> list[scenes.Disc]:
    angles = [geometry.TAU * i / 24 for i in range(24)]
    return [
        (x_m + radius_m * x, y_m + radius_m * y, 0.16)
        for x, y in (geometry.unit(angle) for angle in angles)
    ]


@pytest.mark.parametrize("goal", [(1.0, 0.0), (4.0, 0.0)])
def test_a_goal_that_is_walled_in_is_said_to_be_enclosed(goal: tuple[float, float]) -> None:
    centre = goal if goal[0] == 4.0 else (0.0, 0.0)
    walls = ring(*centre, 0.9)
    setup = setup_of(goal=goal if goal[0] == 4.0 else (4.0, 0.0))
    lines = drive(setup, walls, ticks=900)
    assert lines[-1][1].beacon.reason == "enclosed"
    assert len(lines) * scenes.DT_S < 60.0
    assert gap(walls, lines) > 0.0


def test_a_peer_that_stands_in_sight_may_be_what_closes_the_way() -> None:
    walls, setup = ring(0.0, 0.0, 0.9), setup_of()
    state = robot.init(setup)
    for tick in range(200):
        peer = scenes.beacon("robot2", Pose(1.1, 0.0, 0.0), tick=tick - 1, arrived=True)
        scan = scenes.scan(walls, scenes.ORIGIN)
        frame = scenes.frame("robot1", tick, ranges_m=scan, beacons=(peer,) if tick else ())
        state, command = robot.step(setup, state, frame)
    assert state.navigating.way is not None
    assert state.navigating.way.closed
    assert command.beacon.mode == "GO"


def test_who_is_heard_for_the_first_time_was_never_an_obstacle() -> None:
    """In the first tick nobody is heard: a peer that starts on the goal seems to stand there."""
    setup = setup_of(goal=(2.0, 0.0))
    state, body = robot.init(setup), Pose(2.0, 0.0, 0.0)
    for tick in range(4):
        said = (peer_at(body, tick - 1),) if tick else ()
        scan = scenes.scan([(body.x_m, body.y_m, 0.22)], scenes.ORIGIN)
        frame = scenes.frame("robot1", tick, ranges_m=scan, beacons=said)
        state, command = robot.step(setup, state, frame)
        assert state.navigating.memory is not None
        assert state.navigating.way is not None
        assert (len(state.navigating.memory.points) > 0) == (tick == 0)
    assert command.set_point.speed_mps > 0.0


def peer_at(pose: Pose, tick: int) -> Beacon:
    promise = Promise(deceleration_mps2=1.0, turn_deceleration_radps2=4.0, keep_m=0.25)
    return scenes.beacon("robot2", pose, tick=tick, promise=promise)


def test_a_goal_in_an_obstacle_is_said_to_have_no_way() -> None:
    lines = drive(setup_of(goal=(3.0, 0.0)), [(3.0, 0.0, 0.15)], ticks=900)
    assert lines[-1][1].beacon.reason == "enclosed"
    assert lines[-1][1].beacon.mode == "FAILED"


def test_who_comes_no_nearer_gives_up_in_the_end() -> None:
    setup = setup_of()
    setup = msgspec.structs.replace(
        setup, navigator=msgspec.structs.replace(setup.navigator, give_up_s=2.0)
    )
    state = robot.init(setup)
    for tick in range(40):  # its motors do nothing
        frame = scenes.frame("robot1", tick, scenes.ORIGIN, Twist(0.1, 0.0))
        state, command = robot.step(setup, state, frame)
    assert command.beacon.reason == "too-long"


def test_who_has_arrived_neither_doubts_nor_gives_up() -> None:
    setup = setup_of(goal=(0.0, 0.0))
    setup = msgspec.structs.replace(
        setup, navigator=msgspec.structs.replace(setup.navigator, give_up_s=2.0)
    )
    state = robot.init(setup)
    scan = scenes.scan([(0.8, 0.0, 0.3)], scenes.ORIGIN)
    for tick in range(60):
        state, command = robot.step(setup, state, scenes.frame("robot1", tick, ranges_m=scan))
        assert command.beacon.mode == "ARRIVED"
    assert state.navigating.doubts == 0
    assert state.navigating.failed == ""


def test_another_goal_is_another_chance() -> None:
    state = navigator.State(via_index=1, failed="enclosed", closed_s=9.0, best_m=1.0)
    assert navigator.redirect(state) == navigator.State()


@pytest.mark.parametrize("late_ticks", [1, 2])
def test_commands_that_come_late_are_reckoned_with(late_ticks: int) -> None:
    lines = drive(setup_of(speed_mps_max=2.0), FIELD, ticks=300, late_ticks=late_ticks)
    assert lines[-1][1].beacon.mode == "ARRIVED"
    assert gap(FIELD, lines) > 0.0


def test_what_is_under_way_is_driven_before_what_is_decided_now() -> None:
    setup = setup_of()
    frame = scenes.frame("robot1", 5, scenes.ORIGIN, Twist(0.4, 0.0))
    late = Late((Twist(0.5, 0.0), Twist(0.45, 0.0), Twist(0.4, 0.0)), 2)
    moved = predict.ahead(setup, late, frame)
    assert moved.twist == Twist(0.5, 0.0)
    assert moved.pose.x_m == pytest.approx(0.08 * (0.45 + 0.5))
    assert predict.ahead(setup, Late(), frame) is frame


def test_it_says_why_it_does_what_it_does() -> None:
    wall = [(1.0, -0.5 + 0.1 * i, 0.05) for i in range(11)]
    lines = drive(setup_of(), wall, ticks=40)
    traces = [command.trace for _, command in lines]
    assert all(trace.waypoint is not None for trace in traces)
    assert all(trace.forces.attractive != (0.0, 0.0) for trace in traces)
    assert any(trace.forces.repulsive != (0.0, 0.0) for trace in traces)
    assert {trace.limited_by for trace in traces} <= {"", "brake"}


@given(sectors=st.lists(st.sampled_from((0.5, 0.6, 0.9, 1.4, inf)), min_size=24, max_size=24))
def test_sectors_are_linked_as_the_map_links_them(sectors: list[float]) -> None:
    ends = np.empty((24, 2), dtype=np.int64)
    runs = sight.link(np.array(sectors), 1.2, 0.32, cos(TAU / 24), ends)
    found = [range(start, stop) for start, stop in ends[:runs].tolist()]
    assert found == msam.linked_runs(sectors, 1.2, 0.32)
