"""Faults that the world carries out: begin and end, commands, motors, the blame for contacts."""

from __future__ import annotations

from math import inf, nan

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from swarm.faults import (
    ActuatorStuck,
    Bias,
    Corrupt,
    Dead,
    Deaf,
    Delay,
    DiskFull,
    Dropout,
    Duplicate,
    Fault,
    Loss,
    Mute,
    Nan,
    Noise,
    Partition,
    SensorStuck,
    Slow,
    Weak,
)
from swarm.geometry import STILL, Twist
from swarm.messages import Array, Command, SensorFrame
from tests.world.test_simulation import CROWD, TWO, command, drive, orders, world_of
from world import simulation
from world.simulation import World, WorldState

AHEAD = Twist(0.3, 0.0)
BACK = Twist(-0.2, 0.5)
ANY_FAULT = st.one_of(
    st.builds(Slow, target=st.just("all"), at_s=st.just(0.0), late_s=st.floats(0.01, 0.6)),
    st.builds(Loss, target=st.just("all"), at_s=st.just(0.0), probability=st.floats(0.0, 1.0)),
    st.builds(Delay, target=st.just("all"), at_s=st.just(0.0), delay_s=st.floats(0.01, 0.6)),
    st.builds(Duplicate, target=st.just("all"), at_s=st.just(0.0), probability=st.floats(0.0, 1.0)),
    st.builds(Dropout, target=st.just("all"), at_s=st.just(0.0), probability=st.floats(0.0, 1.0)),
    st.builds(Noise, target=st.just("all"), at_s=st.just(0.0), sigma_m=st.floats(0.001, 1.0)),
    st.builds(Bias, target=st.just("all"), at_s=st.just(0.0), bias_m=st.floats(-5.0, 5.0)),
    st.builds(Weak, target=st.just("all"), at_s=st.just(0.0), factor=st.floats(0.0, 1.0)),
    *(
        st.builds(kind, target=st.just("all"), at_s=st.just(0.0))
        for kind in (Partition, Deaf, Mute, SensorStuck, Nan, ActuatorStuck, Dead)
    ),
)


def fault(kind: type[Fault], **values: float) -> Fault:
    """A fault whose rows are chosen by hand."""
    return msgspec.convert(
        {"kind": kind.__struct_config__.tag, "target": "all", "at_s": 0.0, **values}, kind
    )


def inflicted(
    world: World, state: WorldState, *faults: tuple[Fault, tuple[int, ...]]
) -> WorldState:
    for number, (one, rows) in enumerate(faults):
        state = simulation.inflict(world, state, number, one, rows)
    return state


def tick(
    world: World, state: WorldState, **set_points: Twist
) -> tuple[WorldState, tuple[SensorFrame, ...], tuple[Command, ...]]:
    """One tick as the shell does it; the frames and the commands that took effect in it."""
    state, _ = simulation.relieve(world, state)
    frames = simulation.sense(world, state)
    arrived = orders(state.tick, **set_points).values()
    state, due = simulation.hold_back(world, state, arrived)
    return simulation.step(world, state, {one.robot: one for one in due}), frames, due


# --- begin and end ------------------------------------------------------------------------------


def test_fault_is_over_after_its_ticks_and_relieve_names_it_once() -> None:
    world = world_of(TWO)
    state = drive(world, simulation.init(world), 4, a=AHEAD, b=STILL)
    state = inflicted(world, state, (fault(Weak, for_s=0.24), (0, 1)), (fault(Deaf), (1,)))
    over = []
    for _ in range(5):
        state, ended = simulation.relieve(world, state)
        over.append([(one.number, one.rows, one.first_tick, one.until_tick) for one in ended])
        state = drive(world, state, 1, a=AHEAD, b=STILL)
    assert over == [[], [], [], [(0, (0, 1), 4, 7)], []]
    assert [one.number for one in state.active] == [1]
    assert state.active[0].until_tick is None


def test_fault_lasts_for_a_tick_at_least_and_strikes_nobody_without_rows() -> None:
    world = world_of(TWO)
    state = simulation.init(world)
    assert inflicted(world, state, (fault(Dead), ())) == state
    state = inflicted(world, state, (fault(Dead, for_s=0.001), (0,)))
    assert state.active[0].until_tick == 1


def test_faults_of_what_is_around_are_kept_until_they_are_over() -> None:
    world = world_of(TWO)
    full = DiskFull(at_s=0.0, for_s=0.16)
    state = inflicted(world, simulation.init(world), (full, ()), (fault(Corrupt), (1,)))
    assert [one.rows for one in state.active] == [(), (1,)]
    state, over = simulation.relieve(world, drive(world, state, 2, a=STILL, b=STILL))
    assert [one.fault for one in over] == [full]
    assert len(state.active) == 1


# --- minds --------------------------------------------------------------------------------------


def test_revive_stands_silent_until_the_first_command_and_ignores_those_from_before() -> None:
    world = world_of(TWO)
    state = drive(world, simulation.init(world), 3, a=AHEAD, b=STILL)
    state = drive(world, simulation.lose(world, state, "a"), 2, a=AHEAD, b=STILL)
    state = simulation.revive(world, state, "a")
    body = state.bodies[0]
    assert (body.alive, body.set_point, body.command_tick, body.beacon) == (True, STILL, 4, None)
    frames = simulation.sense(world, state)
    assert [frame.robot for frame in frames] == ["a", "b"]
    assert [[beacon.name for beacon in frame.beacons] for frame in frames] == [["b"], []]
    old = simulation.step(world, state, {"a": command("a", 4, AHEAD)})
    assert old.bodies[0].twist == STILL
    new = simulation.step(world, state, {"a": command("a", 5, AHEAD)})
    assert new.bodies[0].twist == AHEAD
    assert new.bodies[0].beacon == command("a", 5, AHEAD).beacon


def test_revive_leaves_a_body_that_has_touched_where_it_stands() -> None:
    world = world_of(TWO + "[[obstacles]]\ncircle = [1.0, 0.0, 0.7]\n")
    state = drive(world, simulation.init(world), 5, a=Twist(1.0, 0.0), b=STILL)
    assert state.bodies[0].contact
    state = simulation.revive(world, simulation.lose(world, state, "a"), "a")
    assert state.bodies[0].contact
    assert drive(world, state, 3, a=BACK).bodies[0].pose == state.bodies[0].pose


def test_revive_forgets_what_the_robot_said_before_when_beacons_are_late() -> None:
    world = world_of(TWO)
    state = drive(world, simulation.init(world), 3, a=STILL, b=STILL)
    state = inflicted(world, state, (fault(Delay, delay_s=0.16), (1,)))
    state = drive(world, state, 4, a=STILL, b=STILL)
    state = simulation.revive(world, simulation.lose(world, state, "a"), "a")
    heard = []
    for _ in range(5):
        state, frames, _ = tick(world, state, a=STILL, b=STILL)
        heard.append([beacon.tick for beacon in frames[1].beacons])
    assert heard == [[], [], [], [7], [8]]


# --- commands -----------------------------------------------------------------------------------


def test_slow_commands_take_effect_so_many_ticks_later_and_all_at_once_at_the_end() -> None:
    world = world_of(TWO)
    state = inflicted(world, simulation.init(world), (fault(Slow, late_s=0.16, for_s=0.4), (0,)))
    effects, speeds_mps = [], []
    for now in range(7):
        state, _, due = tick(world, state, a=Twist(0.01 * now, 0.0), b=STILL)
        effects.append([one.tick for one in due if one.robot == "a"])
        assert [one.tick for one in due if one.robot == "b"] == [now]
        speeds_mps.append(state.bodies[0].twist.speed_mps)
    assert effects == [[], [], [0], [1], [2], [3, 4, 5], [6]]
    assert speeds_mps == [0.0, 0.0, 0.0, 0.01, 0.02, 0.05, 0.06]
    assert state.held == ()


def test_slow_faults_do_not_add_up_the_longest_counts() -> None:
    world = world_of(TWO)
    struck = (fault(Slow, late_s=0.24, for_s=0.4), (0,)), (fault(Slow, late_s=0.08), (0,))
    state = inflicted(world, simulation.init(world), *struck)
    effects = []
    for _ in range(7):
        state, _, due = tick(world, state, a=STILL, b=STILL)
        effects.append([one.tick for one in due if one.robot == "a"])
    assert effects == [[], [], [], [0], [1], [2, 3, 4], [5]]


def test_slow_robot_is_heard_late_too() -> None:
    world = world_of(TWO)
    state = inflicted(world, simulation.init(world), (fault(Slow, late_s=0.24), (0,)))
    heard = []
    for _ in range(6):
        state, frames, _ = tick(world, state, a=STILL, b=STILL)
        heard.append([beacon.tick for beacon in frames[1].beacons])
    assert heard == [[], [], [], [], [0], [1]]


def test_slow_robot_brakes_when_its_commands_are_older_than_their_time_to_live() -> None:
    world = world_of(TWO)  # command_ttl: 3 ticks
    speeds_mps = {}
    for late_ticks in (3, 4):
        late = fault(Slow, late_s=late_ticks * 0.08)
        state = inflicted(world, simulation.init(world), (late, (0,)))
        for _ in range(8):
            state, _, _ = tick(world, state, a=AHEAD, b=STILL)
        speeds_mps[late_ticks] = state.bodies[0].twist.speed_mps
    assert speeds_mps == {3: 0.3, 4: 0.0}


def test_slow_commands_of_a_robot_that_dies_are_let_go_and_move_nothing() -> None:
    world = world_of(TWO)
    state = inflicted(world, simulation.init(world), (fault(Slow, late_s=0.4), (0,)))
    for _ in range(3):
        state, _, _ = tick(world, state, a=AHEAD, b=STILL)
    state = simulation.lose(world, state, "a")
    state, _, due = tick(world, state, b=STILL)
    assert [one.tick for one in due if one.robot == "a"] == [0, 1, 2]
    assert state.bodies[0].set_point == STILL
    assert state.bodies[0].beacon is None
    assert state.held == ()


@settings(max_examples=40, deadline=None)
@given(
    st.lists(st.tuples(st.floats(0.01, 0.7), st.floats(0.05, 1.0), st.integers(0, 12)), max_size=4)
)
def test_hold_back_loses_nothing_and_keeps_the_order(spans: list[tuple[float, float, int]]) -> None:
    world = world_of(TWO)
    state = simulation.init(world)
    came: list[int] = []
    for now in range(40):
        for number, (late_s, for_s, begin) in enumerate(spans):
            if begin == now:
                late = fault(Slow, late_s=late_s, for_s=for_s)
                state = simulation.inflict(world, state, number, late, (0,))
        state, _, due = tick(world, state, a=STILL, b=STILL)
        came += [one.tick for one in due if one.robot == "a"]
    assert came == list(range(40))


# --- motors -------------------------------------------------------------------------------------


def test_stuck_motors_keep_what_was_in_force_and_the_record_what_was_asked_for() -> None:
    world = world_of(TWO)
    state = drive(world, simulation.init(world), 3, a=AHEAD, b=STILL)
    state = inflicted(world, state, (fault(ActuatorStuck, for_s=0.24), (0,)))
    twists = []
    for _ in range(4):
        state, _ = simulation.relieve(world, state)
        told = orders(state.tick, a=Twist(0.1, 0.0), b=STILL)
        record = simulation.record(world, state, (), told.values())
        assert record.robots[0].applied == Twist(0.1, 0.0)
        state = simulation.step(world, state, told)
        twists.append(state.bodies[0].twist)
    assert twists == [AHEAD, AHEAD, AHEAD, Twist(0.1, 0.0)]


def test_stuck_motors_of_a_robot_that_stood_keep_it_standing() -> None:
    world = world_of(TWO)
    state = inflicted(world, simulation.init(world), (fault(ActuatorStuck), (0,)))
    assert drive(world, state, 5, a=AHEAD).bodies[0].pose == simulation.init(world).bodies[0].pose


def test_stuck_motors_brake_when_the_mind_is_gone() -> None:
    world = world_of(TWO)
    state = drive(world, simulation.init(world), 3, a=AHEAD)
    state = inflicted(world, state, (fault(ActuatorStuck), (0,)))
    state = drive(world, simulation.lose(world, state, "a"), 1)
    assert state.bodies[0].twist == STILL


def test_weak_motors_reach_their_share_and_dead_ones_brake_within_the_limits() -> None:
    world = world_of(TWO)
    state = inflicted(world, simulation.init(world), (fault(Weak, factor=0.5), (0,)))
    state = drive(world, state, 2, a=Twist(0.5, 0.25), b=Twist(0.5, 0.25))
    assert state.bodies[0].twist == Twist(0.25, 0.125)
    assert state.bodies[1].twist.speed_mps == 0.5
    state = inflicted(world, state, (fault(Dead), (1,)))
    state = drive(world, state, 1, a=AHEAD, b=Twist(0.5, 0.0))
    assert state.bodies[1].twist.speed_mps == pytest.approx(0.5 - 4.0 * 0.08)  # 4 m/s^2
    state = drive(world, state, 1, a=AHEAD, b=Twist(0.5, 0.0))
    assert state.bodies[1].twist == STILL
    assert state.bodies[1].set_point == Twist(0.5, 0.0)


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 1, 0), (1, 0, 2)])
def test_motor_faults_combine_whatever_their_order(order: tuple[int, ...]) -> None:
    world = world_of(TWO)
    state = drive(world, simulation.init(world), 3, a=Twist(0.4, 0.0), b=Twist(0.4, 0.0))
    all_of = [fault(ActuatorStuck), fault(Weak, factor=0.5), fault(Dead, for_s=0.4)]
    state = inflicted(world, state, *((all_of[index], (0,)) for index in order))
    state = drive(world, state, 5, a=Twist(0.1, 0.0), b=STILL)
    assert state.bodies[0].twist == STILL
    state, _ = simulation.relieve(world, state)
    assert drive(world, state, 1, a=Twist(0.1, 0.0)).bodies[0].twist == Twist(0.2, 0.0)


def test_motor_faults_strike_bodies_with_mass_too() -> None:
    world = world_of(TWO.replace("[[robots]]", '[[robots]]\nmotion = "dynamic"'))
    state = inflicted(world, simulation.init(world), (fault(Weak, factor=0.5), (0,)))
    state = drive(world, state, 25, a=Twist(0.4, 0.0), b=Twist(0.2, 0.0))
    assert state.bodies[0].twist == state.bodies[1].twist
    assert state.bodies[0].twist.speed_mps == pytest.approx(0.2, abs=0.02)


# --- blame --------------------------------------------------------------------------------------

MEETING = TWO.replace("3.0, 4.0", "1.0, 0.0")  # b stands in a's way
WALL = TWO + "[[obstacles]]\ncircle = [1.0, 0.0, 0.5]\n"


@pytest.mark.parametrize(
    ("one", "row", "excused"),
    [
        (fault(ActuatorStuck), 1, True),
        (fault(Weak), 0, True),
        (fault(Dead), 1, True),  # the one that stands could not get out of the way
        (fault(Dropout), 0, True),
        (fault(SensorStuck), 0, True),
        (fault(Nan), 1, True),
        (fault(Noise, sigma_m=0.021), 0, True),
        (fault(Noise, sigma_m=0.02), 0, False),
        (fault(Bias, bias_m=-0.051), 0, True),
        (fault(Bias, bias_m=-0.05), 0, False),
        (fault(Slow), 0, False),
        (fault(Loss), 0, False),
        (fault(Deaf), 1, False),
    ],
)
def test_contact_of_two_is_excused_when_motors_or_lidar_of_one_fail(
    one: Fault, row: int, excused: bool
) -> None:
    world = world_of(MEETING)
    state = inflicted(world, simulation.init(world), (one, (row,)))
    state = drive(world, state, 30, a=Twist(0.6, 0.0))
    assert [body.contact for body in state.bodies] == [True, True]
    assert [body.excused for body in state.bodies] == [excused, excused]
    record = simulation.record(world, state, (), ())
    assert [robot.excused for robot in record.robots] == [body.excused for body in state.bodies]


def test_contact_with_an_obstacle_is_excused_for_whom_the_fault_strikes_only() -> None:
    for row, excused in ((0, True), (1, False)):
        world = world_of(WALL)
        state = inflicted(world, simulation.init(world), (fault(Weak), (row,)))
        state = drive(world, state, 20, a=Twist(1.0, 0.0), b=STILL)
        assert state.bodies[0].contact
        assert [body.excused for body in state.bodies] == [excused, False]


def test_contact_is_judged_when_it_happens() -> None:
    world = world_of(MEETING)
    state = inflicted(world, simulation.init(world), (fault(Weak, for_s=0.16), (0,)))
    late = drive(world, simulation.relieve(world, drive(world, state, 2))[0], 30, a=AHEAD)
    assert [body.contact for body in late.bodies] == [True, True]
    assert [body.excused for body in late.bodies] == [False, False]  # over before
    later = inflicted(world, late, (fault(Dead), (0, 1)))
    assert not any(body.excused for body in drive(world, later, 3, a=AHEAD).bodies)  # begun after


def test_contact_stays_to_blame_when_a_faulty_robot_runs_into_it_later() -> None:
    world = world_of(WALL.replace("3.0, 4.0", "-1.0, 0.0"))
    state = drive(world, simulation.init(world), 10, a=Twist(1.0, 0.0), b=STILL)
    assert [body.contact for body in state.bodies] == [True, False]
    state = inflicted(world, state, (fault(Weak), (1,)))
    state = drive(world, state, 30, a=STILL, b=Twist(1.0, 0.0))
    assert [body.contact for body in state.bodies] == [True, True]
    assert [body.excused for body in state.bodies] == [False, True]


# --- all of them --------------------------------------------------------------------------------


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.tuples(ANY_FAULT, st.sets(st.integers(0, 5), min_size=1), st.integers(0, 6)),
        max_size=5,
    ),
    st.sampled_from([None, 0.16, 0.4]),
)
def test_faults_combine_within_what_can_be(
    struck: list[tuple[Fault, set[int], int]], for_s: float | None
) -> None:
    world = world_of(CROWD)
    state = simulation.init(world)
    for now in range(9):
        for number, (one, rows, begin) in enumerate(struck):
            if begin == now:
                lasting = msgspec.structs.replace(one, for_s=for_s)
                state = simulation.inflict(world, state, number, lasting, tuple(sorted(rows)))
        stored = msgspec.msgpack.decode(msgspec.msgpack.encode(state), type=WorldState)
        assert stored == state
        again, frames_again, _ = tick(world, stored, **dict.fromkeys(world.rows, BACK))
        state, frames, _ = tick(world, state, **dict.fromkeys(world.rows, BACK))
        assert (again, frames_again) == (state, frames)
        for frame in frames:
            ranges_m = frame.ranges_m()
            assert not (ranges_m < 0.0).any()
            assert not (np.isfinite(ranges_m) & (ranges_m > 5.0)).any()
            said = [(beacon.name, beacon.tick) for beacon in frame.beacons]
            assert frame.robot not in {name for name, _ in said}
            assert len(set(said)) == len(said)
            assert all(spoken < now for _, spoken in said)


def test_frame_takes_invalid_ranges_but_no_negative_ones() -> None:
    world = world_of(TWO)
    frame = simulation.sense(world, simulation.init(world))[0]
    for good in (nan, inf, 0.0):
        data = np.array([good, 1.0], "<f4").tobytes()
        assert msgspec.structs.replace(frame, ranges=Array("<f4", (2,), data)).tick == 0
    with pytest.raises(ValueError, match="expected ranges"):
        msgspec.structs.replace(
            frame, ranges=Array("<f4", (2,), np.array([nan, -0.1], "<f4").tobytes())
        )
