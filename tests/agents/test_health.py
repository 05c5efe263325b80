"""Sensors and motors that cannot be trusted: the robot stands, says why, and goes on by itself."""

from __future__ import annotations

from math import nan

import msgspec
import numpy as np
import pytest

from agents import health, robot
from swarm.geometry import STILL, Pose, Ranges, Twist
from swarm.messages import Command, Leadership, SensorFrame, Slot
from swarm.scenario import RobotSetup
from tests.agents import scenes

CLAIM = Leadership(0, (0, 0, 0, 0), "leader")
WALL = scenes.wall(3.0)


def drive(setup: RobotSetup, frames: list[SensorFrame]) -> list[Command]:
    state, answers = robot.init(setup), []
    for frame in frames:
        state, command = robot.step(setup, state, frame)
        answers.append(command)
    return answers


def moving(tick: int, ranges_m: Ranges | None, speed_mps: float = 0.6) -> SensorFrame:
    """Frame of a robot that drives along x."""
    pose = Pose(speed_mps * scenes.DT_S * tick, 0.0, 0.0)
    return scenes.frame(tick=tick, pose=pose, twist=Twist(speed_mps, 0.0), ranges_m=ranges_m)


def complaints(answers: list[Command]) -> list[tuple[str, str]]:
    return [(answer.beacon.mode, answer.beacon.reason) for answer in answers]


# --- the lidar ----------------------------------------------------------------------------------


def test_robot_stands_while_a_single_beam_is_unknown_and_then_goes_on() -> None:
    hole = scenes.wall(3.0)
    hole[7] = nan
    answers = drive(
        scenes.alone(), [moving(1, scenes.wall(3.1)), moving(2, hole), moving(3, scenes.wall(2.9))]
    )
    assert complaints(answers) == [("GO", ""), ("HOLD", "sensors"), ("GO", "")]
    assert answers[1].set_point == STILL
    assert np.isfinite(answers[1].trace.sectors.numpy()).any()  # the beams that are known


def test_robot_with_a_frozen_scan_turns_on_the_spot_until_it_changes() -> None:
    frames = [moving(tick, WALL) for tick in range(1, 6)]
    frames += [moving(6, scenes.wall(2.7)), moving(7, scenes.wall(2.65))]
    answers = drive(scenes.alone(), frames)
    assert complaints(answers) == [("GO", "")] * 2 + [("HOLD", "sensors")] * 3 + [("GO", "")] * 2
    assert [answer.set_point for answer in answers[2:5]] == [Twist(0.0, health.PROBE_RADPS)] * 3


def test_scan_that_stays_the_same_is_none_to_worry_about_at_rest_or_where_nothing_is() -> None:
    at_rest = [moving(tick, WALL, speed_mps=0.0) for tick in range(1, 9)]
    nowhere = [moving(tick, scenes.nothing()) for tick in range(1, 9)]
    for frames in (at_rest, nowhere):
        assert {reason for _, reason in complaints(drive(scenes.alone(), frames))} == {""}


def test_peer_that_moves_along_is_no_frozen_scan() -> None:
    body = scenes.scan([(1.5, 0.0, 0.22)], scenes.ORIGIN)
    frames = []
    for tick in range(1, 9):
        frame = moving(tick, body)
        before = scenes.beacon(
            "robot2",
            Pose(frame.pose.x_m + 1.5 - 0.048, 0.0, 0.0),
            Twist(0.6, 0.0),
            tick=tick - 1,
            priority=(1, 0, 0, 9),
        )
        frames.append(msgspec.structs.replace(frame, beacons=(before,)))
    assert {reason for _, reason in complaints(drive(scenes.alone(), frames))} == {""}


def test_false_alarms_become_fewer_along_a_wall_without_end() -> None:
    setup, state, alarms = scenes.alone(), health.State(), []
    for tick in range(1, 200):
        # The scan changes as soon as the robot turns.
        frame = moving(tick, scenes.wall(2.9) if state.frozen else WALL)
        map = scenes.look(setup, frame.ranges_m())
        state = health.step(setup, state, frame, map, [], STILL, trusted=True)
        if state.frozen:
            alarms.append(tick)
    assert np.diff(alarms).tolist() == [13, 49, 49, 49]


# --- the motors ---------------------------------------------------------------------------------


def standing(tick: int, twist: Twist = STILL) -> SensorFrame:
    return scenes.frame(tick=tick, twist=twist)


def test_robot_whose_motors_do_nothing_says_so_and_keeps_asking() -> None:
    frames = [standing(tick) for tick in range(1, 23)] + [standing(23, Twist(0.3, 0.0))]
    answers = drive(scenes.alone(), frames)
    said = complaints(answers)
    # 1.5 s are 19 ticks after the first that asked.
    assert said == [("GO", "")] * 19 + [("HOLD", "motors")] * 3 + [("GO", "")]
    assert answers[20].set_point.speed_mps > 0.1
    assert answers[20].beacon.twist == STILL  # which is what its peers should reckon with


def test_motors_are_not_blamed_for_a_contact_or_for_standing_at_the_goal() -> None:
    touching = [scenes.frame(tick=tick, contact=True) for tick in range(1, 40)]
    there = [scenes.frame(tick=tick, pose=Pose(10.0, 0.0, 0.0)) for tick in range(1, 40)]
    for frames in (touching, there):
        said = complaints(drive(scenes.alone(), frames))
        assert "motors" not in {reason for _, reason in said}


def test_leader_with_dead_motors_gives_no_more_signs_of_life() -> None:
    setup = scenes.leader()
    frames = [scenes.frame("leader", tick=tick) for tick in range(1, 23)]
    answers = drive(setup, frames)
    assert [answer.beacon.leader_tick for answer in answers[:20]] == list(range(1, 21))
    assert [answer.beacon.leader_tick for answer in answers[20:]] == [None, None]
    assert not answers[-1].beacon.fit


def test_leader_that_is_blind_for_a_moment_stays_leader() -> None:
    blind = scenes.nothing()
    blind[0] = nan
    frames = [scenes.frame("leader", tick=tick, ranges_m=blind) for tick in range(1, 12)]
    ticks = [answer.beacon.leader_tick for answer in drive(scenes.leader(), frames)]
    assert ticks == [1, 2, 3, 4, 5, 6, 7, None, None, None, None]


@pytest.mark.parametrize("reason", ["motors", "sensors"])
def test_follower_sees_one_that_has_come_to_grief_as_an_obstacle(reason: str) -> None:
    setup = scenes.follower(Slot(2.0, 0.0))
    leads = scenes.beacon("leader", Pose(2.0, 0.0, 0.0), leadership=CLAIM)
    ranges_m = scenes.scan([(1.0, 0.8, 0.22)], scenes.ORIGIN)
    arcs = {}
    for said in ("", reason):
        mate = scenes.beacon("robot2", Pose(1.0, 0.8, 0.0), slot=Slot(1.0, 0.5), reason=said)
        frame = scenes.frame(ranges_m=ranges_m, beacons=(leads, mate))
        arcs[said] = len(drive(setup, [frame])[0].trace.arcs)
    assert arcs == {"": 0, reason: 1}
