"""The channels' bytes against Foxglove's own encoders, built object by object."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import foxglove.messages as fm
import msgspec
import numpy as np
import pytest

from dashboards import foxglove, stage
from swarm import geometry, messages, recording
from swarm.messages import TickRecord
from swarm.scenario import Obstacle, Scenario

MakeTicks = Callable[..., tuple[TickRecord, ...]]
MakeScenario = Callable[[int], Scenario]

STAMPS_NS = [0, 80_000_000, 1_000_000_000, 1_040_000_001, 200_999_999_999, 10**15 + 7]


def at(record: TickRecord, stamp_ns: int) -> TickRecord:
    return msgspec.structs.replace(record, stamp_ns=stamp_ns)


def channel(scenario: Scenario, topic: str) -> recording.Channel:
    (found,) = (c for c in foxglove.channels(scenario, scenario.obstacles) if c.topic == topic)
    return found


def timestamp(record: TickRecord) -> fm.Timestamp:
    return fm.Timestamp(record.stamp_ns // 10**9, record.stamp_ns % 10**9)


def quaternion(pose: geometry.Pose) -> fm.Quaternion:
    return fm.Quaternion(z=float(np.sin(0.5 * pose.yaw_rad)), w=float(np.cos(0.5 * pose.yaw_rad)))


def test_transforms_are_the_bytes_of_foxglove(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    scenario = made_scenario(12)
    encode = channel(scenario, "/tf").encode
    for tick, stamp_ns in enumerate(STAMPS_NS * 2, start=1):
        record = at(made_ticks(12, 14)[tick], stamp_ns)
        assert (
            encode(record)
            == fm.FrameTransforms(
                transforms=[
                    fm.FrameTransform(
                        timestamp=timestamp(record),
                        parent_frame_id="world",
                        child_frame_id=setup.name,
                        translation=fm.Vector3(x=robot.pose.x_m, y=robot.pose.y_m),
                        rotation=quaternion(robot.pose),
                    )
                    for setup, robot in zip(scenario.robots, record.robots, strict=True)
                ]
            ).encode()
        )


def test_poses_are_the_bytes_of_foxglove(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    encode = channel(made_scenario(12), "/poses").encode
    for tick, stamp_ns in enumerate(STAMPS_NS * 2, start=1):
        record = at(made_ticks(12, 14)[tick], stamp_ns)
        assert (
            encode(record)
            == fm.PosesInFrame(
                timestamp=timestamp(record),
                frame_id="world",
                poses=[
                    fm.Pose(
                        position=fm.Vector3(x=robot.pose.x_m, y=robot.pose.y_m),
                        orientation=quaternion(robot.pose),
                    )
                    for robot in record.robots
                ],
            ).encode()
        )


@pytest.mark.parametrize("topic", ["/bodies", "/scans", "/obstacles"])
@pytest.mark.parametrize("stamp_ns", STAMPS_NS)
def test_clouds_are_the_bytes_of_foxglove(
    made_ticks: MakeTicks, made_scenario: MakeScenario, topic: str, stamp_ns: int
) -> None:
    scenario = made_scenario(3)
    record = at(made_ticks(3, 1)[0], stamp_ns)
    data = channel(scenario, topic).encode(record)
    assert data is not None
    points = cloud(data)
    number = fm.PackedElementFieldNumericType
    kinds = [("x", 0, number.Float32), ("y", 4, number.Float32), ("z", 8, number.Float32)]
    kinds += [
        (name, 12 + place, number.Uint8)
        for place, name in enumerate(("red", "green", "blue", "alpha"))
    ]
    assert (
        data
        == fm.PointCloud(
            timestamp=timestamp(record),
            frame_id="world",
            pose=fm.Pose(position=fm.Vector3(), orientation=fm.Quaternion(w=1.0)),
            point_stride=16,
            fields=[fm.PackedElementField(name=n, offset=o, type=t) for n, o, t in kinds],
            data=points.tobytes(),
        ).encode()
    )


def cloud(data: bytes) -> np.ndarray:
    """Points of a cloud, whose bytes stand last in the message, behind a length in two bytes."""
    for size in range(16, len(data), 16):
        length = bytes([size & 0x7F | 0x80, size >> 7]) if size > 0x7F else bytes([size])
        if data[-size - len(length) - 1 : -size] == b"\x32" + length:
            kind = np.dtype([("position", "<f4", 3), ("colour", "u1", 4)])
            return np.frombuffer(data[-size:], kind)
    raise AssertionError("expected a cloud with points")


def test_body_points_its_nose_where_the_robot_looks(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    scenario = made_scenario(1)
    record = made_ticks(1, 1)[0]
    robot = msgspec.structs.replace(record.robots[0], pose=geometry.Pose(1.0, 2.0, math.pi / 2.0))
    record = msgspec.structs.replace(record, robots=(robot,))
    data = channel(scenario, "/bodies").encode(record)
    assert data is not None
    points = cloud(data)
    from_centre_m = np.linalg.norm(points["position"][:, :2] - [1.0, 2.0], axis=1)
    assert from_centre_m[:16] == pytest.approx(0.22)
    assert points["position"][-1][:2] == pytest.approx([1.0, 2.22])
    assert int.from_bytes(points["colour"][0].tobytes(), "big") == 0xFFE08AFF


def test_bodies_that_stopped_for_good_turn_red(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    (record,) = made_ticks(3, 1)
    one, two, three = record.robots
    dead = msgspec.structs.replace(one, alive=False)
    touching = msgspec.structs.replace(three, contact=True)
    record = msgspec.structs.replace(record, robots=(dead, two, touching))
    data = channel(made_scenario(3), "/bodies").encode(record)
    assert data is not None
    colours = cloud(data)["colour"].reshape(3, -1, 4)
    numbers = [{int.from_bytes(point.tobytes(), "big") for point in body} for body in colours]
    assert numbers == [{stage.STOPPED}, {int(stage.colours(made_scenario(3))[1])}, {stage.STOPPED}]


def test_outlines_lie_on_the_obstacles(made_ticks: MakeTicks, made_scenario: MakeScenario) -> None:
    data = channel(made_scenario(1), "/obstacles").encode(made_ticks(1, 1)[0])
    assert data is not None
    positions = cloud(data)["position"]
    on_circle = np.isclose(np.linalg.norm(positions[:, :2] - [7.0, 2.5], axis=1), 1.5, atol=1e-5)
    x, y = positions[~on_circle, 0], positions[~on_circle, 1]
    on_base, on_side = np.isclose(y, -3.0), np.isclose(x, 8.0)
    on_slope = np.isclose(y, -3.0 + (x - 5.0) / 3.0, atol=1e-5)
    assert on_circle.sum() == math.ceil(2.0 * math.pi * 1.5 / 0.1)
    assert (on_base | on_side | on_slope).all()


def test_what_stands_still_is_sent_now_and_then(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    encode = channel(made_scenario(2), "/obstacles").encode
    sent = [record.tick for record in made_ticks(2, 60) if encode(record) is not None]
    assert sent == [0, 25, 50]


def test_log_holds_all_events_of_a_tick_at_the_worst_level(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    encode = channel(made_scenario(2), "/log").encode
    quiet = made_ticks(2, 2)[1]
    assert encode(quiet) is None
    events = (
        messages.Event(1, quiet.stamp_ns, "collision", "robot2", "with robot1"),
        messages.Event(1, quiet.stamp_ns, "start", None, ""),
    )
    loud = msgspec.structs.replace(quiet, events=events)
    assert (
        encode(loud)
        == fm.Log(
            timestamp=timestamp(loud),
            level=fm.LogLevel.Error,
            message="collision robot2: with robot1\nstart",
            name="swarm",
        ).encode()
    )


def test_every_channel_is_in_the_file_with_the_schema_of_foxglove(
    made_ticks: MakeTicks, made_scenario: MakeScenario, tmp_path: Path
) -> None:
    scenario, ticks = made_scenario(3), made_ticks(3, 30)
    channels = foxglove.channels(scenario, scenario.obstacles)
    with recording.Writer(tmp_path, b"", {}, channels) as writer:
        for record in ticks:
            writer.write(record)
    verdict = recording.verify(tmp_path)
    assert verdict.ok
    counts = {row.topic: row.written for row in verdict.topics}
    assert {name: counts[name] for name in ("/tf", "/poses", "/bodies")} == dict.fromkeys(
        ("/tf", "/poses", "/bodies"), 30
    )
    assert (counts["/scans"], counts["/obstacles"], counts["/log"]) == (10, 2, 1)
    for one in channels:
        assert one.schema_name.startswith("foxglove.")
        assert one.schema_data == getattr(fm, one.schema_name[9:]).get_schema().data


def test_what_moves_has_a_channel_of_its_own(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    mover = Obstacle(circle=(1.0, 4.0, 0.25), path=((1.0, 9.0),), speed_mps=0.5)
    scenario = made_scenario(2)
    standing = channel(scenario, "/obstacles").encode(made_ticks(2, 1)[0])
    scenario = msgspec.structs.replace(scenario, obstacles=(*scenario.obstacles, mover))
    assert channel(scenario, "/obstacles").encode(made_ticks(2, 1)[0]) == standing
    for tick, record in enumerate(made_ticks(2, 4)):
        encoded = channel(scenario, "/movers").encode(record)
        assert encoded is not None
        data = encoded[-16 * 16 :]  # a rim of 16 points, four float32 each
        points = np.frombuffer(data, "<f4").reshape(-1, 4)[:, :2]
        off_m = points - np.array([1.0, 4.0 + 0.5 * 0.08 * tick])
        assert np.sqrt((off_m**2).sum(axis=1)) == pytest.approx(np.full(16, 0.25), abs=1e-5)
