"""The whole world: commands in, frames out, records that rebuild them."""

from __future__ import annotations

from math import inf, pi, sqrt

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm.geometry import STILL, Pose, Twist
from swarm.messages import Array, Beacon, Command, Event, SensorFrame, TickRecord, Trace
from swarm.scenario import decode
from world import motion, simulation
from world.simulation import World, WorldState

HEAD = 'title = "test"\nseed = 7\ndt_s = 0.08\nduration_s = 1.0\n'
TWO = HEAD + (
    '[[robots]]\nname = "a"\nstart = [0.0, 0.0, 0.0]\n'
    '[[robots]]\nname = "b"\nstart = [3.0, 4.0, 0.0]\n'
)
NO_TRACE = Trace(Array("<f4", (0,), b""))


def world_of(text: str) -> World:
    return simulation.build(decode(text.encode(), "test.toml"))


def command(name: str, tick: int, set_point: Twist) -> Command:
    beacon = Beacon(name, tick, 0, Pose(0.0, 0.0, 0.0), STILL, 0.22, 1.0, "GO", False, (1, 2, 3, 4))
    return Command(name, tick, tick * 80_000_000, set_point, beacon, NO_TRACE)


def orders(tick: int, **set_points: Twist) -> dict[str, Command]:
    return {name: command(name, tick, set_point) for name, set_point in set_points.items()}


def drive(world: World, state: WorldState, ticks: int, **set_points: Twist) -> WorldState:
    for _ in range(ticks):
        state = simulation.step(world, state, orders(state.tick, **set_points))
    return state


def test_init_stands_at_the_starts_and_has_heard_nothing() -> None:
    world = world_of(TWO)
    state = simulation.init(world)
    frames = simulation.sense(world, state)
    assert [frame.robot for frame in frames] == ["a", "b"]
    assert [frame.pose for frame in frames] == [Pose(0.0, 0.0, 0.0), Pose(3.0, 4.0, 0.0)]
    assert all(frame.tick == 0 and frame.stamp_ns == 0 for frame in frames)
    assert all(frame.twist == STILL and frame.beacons == () for frame in frames)
    record = simulation.record(world, state, frames, ())
    assert [robot.applied for robot in record.robots] == [STILL, STILL]
    assert [robot.beacon for robot in record.robots] == [None, None]
    assert [robot.obstacle_clearance_m for robot in record.robots] == [inf, inf]


def test_step_moves_by_the_commands_of_its_tick() -> None:
    world = world_of(TWO)
    state = drive(world, simulation.init(world), 1, a=Twist(0.25, 0.0))
    assert state.tick == 1
    assert state.bodies[0].pose == Pose(0.25 * 0.08, 0.0, 0.0)
    assert state.bodies[1].pose == Pose(3.0, 4.0, 0.0)
    frame = simulation.sense(world, state)[0]
    assert frame.stamp_ns == 80_000_000
    assert frame.twist == Twist(0.25, 0.0)
    assert frame.wheels.right_mps == frame.wheels.left_mps == 0.25


def test_step_keeps_the_set_point_until_it_is_older_than_its_time_to_live() -> None:
    world = world_of(TWO)  # command_ttl: 3 ticks
    state = drive(world, simulation.init(world), 1, a=Twist(0.3, 0.0))
    speeds_mps = []
    for _ in range(6):
        state = simulation.step(world, state, {})
        speeds_mps.append(state.bodies[0].twist.speed_mps)
    assert speeds_mps == [0.3, 0.3, 0.3, 0.0, 0.0, 0.0]  # ticks 1, 2, 3, then it brakes


def test_step_brakes_within_the_acceleration_limit_when_commands_stop() -> None:
    world = world_of(TWO)
    state = drive(world, simulation.init(world), 5, a=Twist(1.0, 0.0))
    state = drive(world, state, 3)
    speeds_mps = []
    for _ in range(4):
        state = simulation.step(world, state, {})
        speeds_mps.append(state.bodies[0].twist.speed_mps)
    assert speeds_mps == pytest.approx([0.68, 0.36, 0.04, 0.0])  # 4 m/s^2 in 0.08 s: 0.32 each


def test_step_ignores_commands_that_are_older_or_from_the_future() -> None:
    world = world_of(TWO)
    state = drive(world, simulation.init(world), 3, a=Twist(0.3, 0.0))
    for tick in (1, 2, 4):
        after = simulation.step(world, state, orders(tick, a=Twist(0.1, 0.0)))
        assert after.bodies[0].twist == Twist(0.3, 0.0)
    late = simulation.step(world, drive(world, state, 1), orders(3, a=Twist(0.1, 0.0)))
    assert late.bodies[0].twist == Twist(0.1, 0.0)  # one tick late, but news


def test_lose_brakes_the_body_and_leaves_it_to_be_seen_but_not_heard() -> None:
    world = world_of(TWO.replace("3.0, 4.0", "2.0, 0.0"))
    state = drive(world, simulation.init(world), 2, a=Twist(0.3, 0.0), b=STILL)
    assert [len(frame.beacons) for frame in simulation.sense(world, state)] == [1, 1]
    state = simulation.lose(world, state, "a")
    assert state.tick == 2
    (frame,) = simulation.sense(world, state)
    assert frame.robot == "b"
    assert frame.beacons == ()
    assert np.isfinite(frame.ranges_m()).any()
    record = simulation.record(world, state, (frame,), orders(2, b=STILL).values())
    assert [robot.alive for robot in record.robots] == [False, True]
    assert record.robots[0].applied == STILL
    assert record.robots[0].beacon == command("a", 1, STILL).beacon
    gone = drive(world, state, 2, a=Twist(1.0, 0.0), b=STILL)
    assert gone.bodies[0].twist == STILL
    assert gone.bodies[0].pose.x_m == pytest.approx(2 * 0.3 * 0.08)  # 0.3 to 0 within one tick
    assert gone.bodies[0].beacon == record.robots[0].beacon


def test_sense_hears_the_beacons_of_the_tick_before_within_range() -> None:
    far = HEAD + "".join(
        f'[[robots]]\nname = "{name}"\nstart = [{x_m}, 0.0, 0.0]\n'
        for name, x_m in (("a", 0.0), ("b", 9.9), ("c", 15.0))
    )
    world = world_of(far)  # radio range 10 m
    state = drive(world, simulation.init(world), 7, a=STILL, b=STILL, c=STILL)
    heard = [
        [(beacon.name, beacon.tick) for beacon in frame.beacons]
        for frame in simulation.sense(world, state)
    ]
    assert heard == [[("b", 6)], [("a", 6), ("c", 6)], [("b", 6)]]


def test_sense_lets_a_robot_listen_before_it_has_spoken() -> None:
    world = world_of(TWO)
    state = drive(world, simulation.init(world), 1, a=STILL)
    heard = [[beacon.name for beacon in frame.beacons] for frame in simulation.sense(world, state)]
    assert heard == [[], ["a"]]


def test_step_stops_a_robot_for_good_where_it_touches_an_obstacle() -> None:
    world = world_of(TWO + "[[obstacles]]\ncircle = [1.0, 0.0, 0.5]\n")
    state = drive(world, simulation.init(world), 10, a=Twist(1.0, 0.0), b=STILL)
    body = state.bodies[0]
    assert body.contact
    assert body.twist == STILL
    assert body.pose.x_m == pytest.approx(1.0 - 0.5 - 0.22, abs=1e-12)
    assert body.clearance_m == pytest.approx(0.0, abs=1e-12)
    later = drive(world, state, 10, a=Twist(-0.4, 1.0), b=STILL)
    assert later.bodies[0].pose == body.pose
    frames = simulation.sense(world, later)
    assert [frame.contact for frame in frames] == [True, False]
    record = simulation.record(world, later, frames, orders(20, a=Twist(-0.4, 1.0)).values())
    assert record.robots[0].applied == Twist(-0.4, 1.0)  # what it asked for, in vain


def test_step_marks_both_robots_when_one_runs_into_one_that_stands() -> None:
    world = world_of(TWO.replace("3.0, 4.0", "1.0, 0.0"))
    state = drive(world, simulation.init(world), 12, a=Twist(1.0, 0.0))
    assert [body.contact for body in state.bodies] == [True, True]
    assert state.bodies[0].pose.x_m == pytest.approx(1.0 - 0.44, abs=1e-12)
    assert state.bodies[1].pose == Pose(1.0, 0.0, 0.0)


def test_record_holds_what_arrived_in_scenario_order() -> None:
    world = world_of(TWO)
    state = drive(world, simulation.init(world), 4, a=Twist(0.1, 0.0), b=STILL)
    events = (Event(4, 320_000_000, "start"),)
    arrived = [command("b", 4, Twist(0.2, 0.0)), command("a", 4, Twist(0.3, 0.0))]
    record = simulation.record(world, state, simulation.sense(world, state), arrived, events)
    assert [one.robot for one in record.commands] == ["a", "b"]
    assert [robot.applied for robot in record.robots] == [Twist(0.3, 0.0), Twist(0.2, 0.0)]
    assert [robot.beacon for robot in record.robots] == [one.beacon for one in record.commands]
    assert [frame.heard.numpy().tolist() for frame in record.frames] == [[[1, 3]], [[0, 3]]]
    assert record.events == events


def test_frame_of_rebuilds_every_frame_when_records_went_over_a_wire() -> None:
    world = world_of(TWO + "[[obstacles]]\ncircle = [2.0, 0.0, 0.5]\n")
    state = simulation.init(world)
    sent: list[SensorFrame] = []
    records: list[TickRecord] = []
    for tick in range(6):
        if tick == 4:
            state = simulation.lose(world, state, "b")
        frames = simulation.sense(world, state)
        commands = orders(tick, **{frame.robot: Twist(0.3, 0.5) for frame in frames})
        sent += frames
        records.append(simulation.record(world, state, frames, commands.values()))
        state = simulation.step(world, state, commands)
    beacons: dict[tuple[int, int], Beacon] = {}
    rebuilt = []
    for record in msgspec.msgpack.decode(msgspec.msgpack.encode(records), type=list[TickRecord]):
        rebuilt += [
            simulation.frame_of(world.scenario, frame, record.tick, record.stamp_ns, beacons)
            for frame in record.frames
        ]
        for one in record.commands:
            beacons[world.rows[one.robot], one.beacon.tick] = one.beacon
    assert rebuilt == sent
    assert len(sent) == 10
    assert sum(len(frame.beacons) for frame in sent) == 6


def test_state_survives_being_stored() -> None:
    world = world_of(TWO)
    state = drive(world, simulation.init(world), 3, a=Twist(0.3, 1.0), b=STILL)
    stored = msgspec.msgpack.decode(msgspec.msgpack.encode(state), type=WorldState)
    assert stored == state
    assert drive(world, stored, 3, a=STILL) == drive(world, state, 3, a=STILL)


CROWD = HEAD + "".join(
    f'[[robots]]\nname = "r{i}"\nstart = [{(i % 3) * 0.8}, {(i // 3) * 0.8}, {i * 0.7 - 3.0}]\n'
    for i in range(6)
)
CROWD += "[[obstacles]]\ncircle = [0.4, 2.0, 0.4]\n"
CROWD += "[[obstacles]]\npolygon = [[2.4, 0.0], [2.8, 0.2], [2.4, 0.9]]\n"
set_points = st.builds(Twist, st.floats(-2.0, 2.0), st.floats(-4.0, 4.0))


@given(st.lists(st.lists(set_points, min_size=6, max_size=6), min_size=1, max_size=12))
def test_step_keeps_bodies_apart_whatever_they_are_told(told: list[list[Twist]]) -> None:
    world = world_of(CROWD)
    state = simulation.init(world)
    for wishes in told:
        named = {f"r{row}": wish for row, wish in enumerate(wishes)}
        before, state = state, drive(world, state, 2, **named)
        for robot, old, new in zip(world.scenario.robots, before.bodies, state.bodies, strict=True):
            assert new.clearance_m > -1e-9
            wheels = motion.wheels(robot, new.twist)
            assert max(abs(wheels.right_mps), abs(wheels.left_mps)) <= 1.0 + 1e-12
            if old.contact:
                assert new.contact
                assert new.pose == old.pose
        for row, one in enumerate(state.bodies):
            for other in state.bodies[:row]:
                apart_m = sqrt(
                    (one.pose.x_m - other.pose.x_m) ** 2 + (one.pose.y_m - other.pose.y_m) ** 2
                )
                assert apart_m > 0.44 - 1e-9
        assert simulation.sense(world, state) == simulation.sense(world, state)


def test_init_wraps_the_heading_of_a_start() -> None:
    state = simulation.init(world_of(TWO.replace("3.0, 4.0, 0.0", "3.0, 4.0, 3.5")))
    assert state.bodies[1].pose.yaw_rad == pytest.approx(3.5 - 2.0 * pi)
