"""Arrays of a tick against the tick itself."""

from __future__ import annotations

import math
from collections.abc import Callable

import msgspec
import numpy as np
import pytest

from dashboards import snapshot
from swarm import geometry
from swarm.messages import TickRecord

MakeTicks = Callable[..., tuple[TickRecord, ...]]


def test_motion_is_that_of_the_robots_in_order(made_ticks: MakeTicks) -> None:
    record = made_ticks(3, 5)[4]
    touched = msgspec.structs.replace(record.robots[2], contact=True, alive=False)
    record = msgspec.structs.replace(record, robots=(*record.robots[:2], touched))
    found = snapshot.motion(record)
    for row, robot in zip(found, record.robots, strict=True):
        assert row[snapshot.X] == robot.pose.x_m
        assert row[snapshot.Y] == robot.pose.y_m
        assert row[snapshot.YAW] == robot.pose.yaw_rad
        assert row[snapshot.SPEED] == robot.twist.speed_mps
        assert row[snapshot.CLEARANCE] == robot.obstacle_clearance_m
    assert found[:, snapshot.ALIVE].tolist() == [1.0, 1.0, 0.0]
    assert found[:, snapshot.CONTACT].tolist() == [0.0, 0.0, 1.0]


def test_placement_of_a_robot_that_looks_left_is_a_quarter_turn(made_ticks: MakeTicks) -> None:
    record = made_ticks(1, 1)[0]
    robot = msgspec.structs.replace(record.robots[0], pose=geometry.Pose(1.0, 2.0, math.pi / 2.0))
    record = msgspec.structs.replace(record, robots=(robot,))
    half = math.sqrt(0.5)
    assert snapshot.placements(record)[0] == pytest.approx([1.0, 2.0, half, half])


def test_scan_puts_each_hit_where_its_beam_ended(made_ticks: MakeTicks) -> None:
    record = made_ticks(4, 8, beams=24)[7]
    expected = [
        (
            frame.pose.x_m + reach_m * math.cos(frame.pose.yaw_rad + angle_rad),
            frame.pose.y_m + reach_m * math.sin(frame.pose.yaw_rad + angle_rad),
        )
        for frame in record.frames
        for reach_m, angle_rad in zip(
            frame.ranges.numpy(), geometry.sector_centres(24), strict=True
        )
        if reach_m < math.inf
    ]
    assert len(expected) == 4 * 3
    assert np.allclose(snapshot.scan(record), expected, rtol=0.0, atol=1e-6)


def test_scan_is_empty_when_nobody_senses(made_ticks: MakeTicks) -> None:
    record = msgspec.structs.replace(made_ticks(1, 1)[0], frames=())
    assert snapshot.scan(record).shape == (0, 2)


def test_answers_are_those_of_the_record_asked_for_when_two_alternate(
    made_ticks: MakeTicks,
) -> None:
    one, other = made_ticks(2, 5)[3:5]
    for record in (one, other, one, one):
        assert snapshot.motion(record)[0, snapshot.X] == record.robots[0].pose.x_m


@pytest.mark.parametrize(
    ("robots", "detail", "scan"),
    [(1, 1, 3), (20, 1, 3), (21, 2, 3), (100, 5, 5), (500, 25, 25)],
)
def test_detail_is_rarer_when_the_swarm_is_larger(robots: int, detail: int, scan: int) -> None:
    assert snapshot.detail_ticks(robots) == detail
    assert snapshot.scan_ticks(robots) == scan
