"""Declared errors, late motors, motors that die: what is believed, announced and said then."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, dist, pi, sin
from typing import Any

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from agents import lateness, navigator, peers, robot
from agents.lateness import State as Late
from agents.navigator import (
    admission,
    announce,
    brake,
    estimate,
    headway,
    pledge,
    predict,
    sight,
)
from agents.steering import Wish
from swarm import geometry
from swarm.geometry import STILL, Pose, Twist
from swarm.messages import Beacon, Command, Slot
from swarm.scenario import Disturbance, RobotSetup
from tests.agents import scenes
from world import disturbance, motion

DECLARED = Disturbance(
    range_sigma_m=0.01, position_sigma_m=0.01, yaw_sigma_rad=0.0087, speed_error=0.05
)
RATES = st.tuples(st.floats(-0.4, 1.0), st.floats(-2.5, 2.5))


def setup_of(declared: Disturbance = DECLARED, **changes: Any) -> RobotSetup:
    setup = scenes.alone(
        **{"controller": "navigator", "goal": (4.0, 0.0), "acceleration_mps2_max": 2.0, **changes}
    )
    return msgspec.structs.replace(setup, disturbance=declared)


@settings(max_examples=40)
@given(
    asked=st.lists(RATES, min_size=30, max_size=30),
    leans=st.lists(st.floats(-pi, pi), min_size=30, max_size=30),
    turned=st.sampled_from((-1.0, 0.3, 1.0)),
    faster=st.sampled_from((0.95, 1.05)),
    refused=st.sets(st.integers(0, 29)),
)
def test_where_it_believes_to_be_is_never_further_off_than_it_says(
    asked: list[tuple[float, float]],
    leans: list[float],
    turned: float,
    faster: float,
    refused: set[int],
) -> None:
    setup = setup_of()
    true, twist, where = Pose(1.0, 2.0, 0.3), STILL, estimate.State()
    for tick, (rates, lean_rad) in enumerate(zip(asked, leans, strict=True)):
        off_m = DECLARED.position_error_m_max
        shown = Pose(
            true.x_m + off_m * cos(lean_rad),
            true.y_m + off_m * sin(lean_rad),
            true.yaw_rad + turned * DECLARED.yaw_error_rad_max,
        )
        wheels = motion.scaled(twist, 1.0 / faster)
        where = estimate.step(setup, where, scenes.frame("robot1", tick, shown, wheels))
        if tick in refused:
            where = estimate.carry(where)
        assert where.pose is not None
        away_m = dist((where.pose.x_m, where.pose.y_m), (true.x_m, true.y_m))
        assert away_m <= where.doubt.position_m + 1e-4  # arcs are off their chords by less
        yaw_rad = geometry.wrap_angle(where.pose.yaw_rad - true.yaw_rad)
        assert abs(yaw_rad) <= where.doubt.yaw_rad + 1e-9
        true, twist = motion.step(
            setup.robot, true, twist, Twist(*rates), dt_s=setup.dt_s, speed_factor=faster
        )


@pytest.mark.parametrize(
    ("speed_mps", "rate_radps"), [(1e300, 1e-300), (40.0, 0.0), (0.0, 1e6), (1e308, 1e308)]
)
def test_wheels_that_say_what_cannot_be_do_not_spoil_the_poses_to_come(
    speed_mps: float, rate_radps: float
) -> None:
    setup, where = setup_of(), estimate.State()
    for tick in range(6):
        twist = Twist(speed_mps, rate_radps) if tick == 2 else STILL
        frame = scenes.frame("robot1", tick, Pose(1.0, 2.0, 0.3), twist)
        where = estimate.step(setup, where, frame)
        if tick == 2:
            assert where.pose == frame.pose
        assert where.pose is not None
        assert dist((where.pose.x_m, where.pose.y_m), (1.0, 2.0)) < 0.05


def test_where_nothing_is_declared_it_believes_what_it_is_shown() -> None:
    setup = setup_of(Disturbance())
    frame = scenes.frame("robot1", 3, Pose(1.0, 2.0, 0.5), Twist(0.5, 0.1))
    state, located = navigator.locate(setup, navigator.State(), frame)
    assert located is frame
    assert pledge.promise(setup, Twist(0.5, 0.0), state.where.doubt).keep_m == pytest.approx(
        setup.robot.body_radius_m + pledge.pad_m(setup)
    )


@pytest.mark.parametrize("controller", ["navigator", "paper"])
def test_members_of_a_formation_believe_in_a_smoother_pose_than_they_are_shown(
    controller: str,
) -> None:
    slot = Slot(1.5, 0.4)
    for setup in (
        scenes.leader(controller=controller, disturbance=DECLARED),
        scenes.follower(slot, controller=controller, disturbance=DECLARED),
    ):
        state, shown_m, said_m = robot.init(setup), [], []
        for tick in range(60):
            shown = disturbance.pose(DECLARED, scenes.ORIGIN, 0, seed=5, tick=tick)
            frame = scenes.frame(setup.robot.name, tick, shown)
            state, command = robot.step(setup, state, frame)
            said = command.beacon.pose
            shown_m.append(dist((shown.x_m, shown.y_m), (0.0, 0.0)))
            said_m.append(dist((said.x_m, said.y_m), (0.0, 0.0)))
        if controller == "paper":  # the strict reading takes what it is given
            assert said_m == shown_m
        else:
            assert sum(said_m[5:]) < 0.7 * sum(shown_m[5:])


@given(first=RATES, doubt_m=st.floats(0.0, 0.1), yaw_rad=st.floats(0.0, 0.1))
def test_who_brakes_as_announced_keeps_no_more_room(
    first: tuple[float, float], doubt_m: float, yaw_rad: float
) -> None:
    setup = setup_of()
    doubt = estimate.Doubt(doubt_m, yaw_rad)
    twist = motion.limited(setup.robot, Twist(*first), Twist(*first), dt_s=setup.dt_s)
    before = pledge.promise(setup, twist, doubt).keep_m
    for _ in range(8):
        doubt = estimate.driven(setup, doubt, twist)
        twist = brake.braked(setup, twist)
        now = pledge.promise(setup, twist, doubt).keep_m
        assert now <= before + 1e-9
        before = now


@given(sent=st.lists(RATES, min_size=3, max_size=3), late_ticks=st.integers(1, 3), now=RATES)
def test_what_late_motors_will_do_is_the_same_for_sender_and_hearer(
    sent: list[tuple[float, float]], late_ticks: int, now: tuple[float, float]
) -> None:
    declared = Disturbance(latency_ticks=late_ticks)
    setup = setup_of(declared)
    late = Late(tuple(Twist(*rates) for rates in sent), late_ticks)
    frame = scenes.frame("robot1", 7, Pose(0.5, -1.0, 2.0), Twist(*now))
    there = predict.ahead(setup, late, frame).pose
    pending = predict.pending(setup, late, frame)
    promise = pledge.promise(setup, Twist(0.3, 0.1), pending=pending)
    beacon = Beacon(
        "robot1", 7, 0, frame.pose, Twist(0.3, 0.1), 0.22, 1.0, "GO", False, (0, 0, 0, 0),
        promise=promise,
    )  # fmt: skip
    row = announce.row(beacon, promise, setup.dt_s)
    assert (row[0], row[1]) == (there.x_m, there.y_m)
    assert peers.moved(beacon, late_ticks, setup.dt_s) == there


def test_late_motors_that_are_declared_are_reckoned_with_from_the_first_tick_on() -> None:
    setup = setup_of(Disturbance(latency_ticks=2))
    state = robot.init(setup)
    assert state.lateness.late_ticks == 2
    for tick in range(3):
        state, command = robot.step(setup, state, scenes.frame("robot1", tick, scenes.ORIGIN))
        assert state.lateness.late_ticks == 2
        assert command.beacon.promise is not None
        assert len(command.beacon.promise.pending) == 2


def drive(setup: RobotSetup, ticks: int, dies: int) -> list[tuple[Pose, Command]]:
    """Poses and commands of a robot whose motors die at some tick: they brake at their hardest."""
    state, pose, twist = robot.init(setup), scenes.ORIGIN, STILL
    lines: list[tuple[Pose, Command]] = []
    for tick in range(ticks):
        frame = scenes.frame("robot1", tick, pose, twist, scenes.scan([], pose))
        state, command = robot.step(setup, state, frame)
        lines.append((pose, command))
        set_point = command.set_point if tick < dies else STILL
        pose, twist = motion.step(setup.robot, pose, twist, set_point, dt_s=setup.dt_s)
    return lines


def ends(setup: RobotSetup, beacon: Beacon) -> Sequence[float]:
    assert beacon.promise is not None
    row = announce.row(beacon, beacon.promise, setup.dt_s)
    places = announce.places(row, announce.TICKS_MAX, setup.dt_s)
    return [float(value) for value in places[-1]]


def test_motors_that_die_are_told_of_in_the_next_tick() -> None:
    setup = setup_of(Disturbance())
    lines = drive(setup, ticks=60, dies=20)
    stands = lines[-1][0]
    for _, command in lines[21:28]:  # promises where it does come to rest
        assert dist(ends(setup, command.beacon), (stands.x_m, stands.y_m)) < 0.02
    last = lines[-1][1].beacon
    assert (last.mode, last.reason, last.promise, last.passage) == ("HOLD", "motors", None, None)
    assert last.intent is not None
    assert not last.intent.active


def test_a_body_that_goes_slower_than_told_has_not_stopped() -> None:
    late = Late((Twist(0.8, 0.0),), 0)
    assert lateness.stops(late, Twist(0.8, 0.0), Twist(0.64, 0.0), 0.16)
    assert not lateness.stops(late, Twist(0.8, 0.0), Twist(0.7, 0.0), 0.16)
    assert not lateness.stops(late, Twist(0.8, 0.0), Twist(0.8, 0.0), 0.16)
    assert not lateness.stops(Late(), STILL, STILL, 0.16)


def test_it_says_that_it_is_blocked_until_it_gets_on() -> None:
    wish, state = Wish(mode="GO", waypoint=(1.0, 0.0)), navigator.State()
    said = []
    for tick in range(400):
        pose = Pose(0.2 if tick % 2 else 0.0, 0.0, 0.0)
        if tick > 350:
            pose = Pose(1.0, 0.0, 0.0)
        frame = scenes.frame("robot1", tick, pose, STILL)
        state, now = headway.say_blocked(state, frame, wish, 0.08, among=True)
        said.append((now.mode, now.reason))
    assert said.index(("HOLD", "blocked")) * 0.08 < 30.0
    assert said[350] == ("HOLD", "blocked")
    assert said[351:] == [("GO", "")] * 49
    arrived = msgspec.structs.replace(wish, arrived=True)
    lasting = navigator.State(since=(0.0, 0.0), since_s=40.0, best_s=90.0)
    frame = scenes.frame("robot1", 400, scenes.ORIGIN, STILL)
    assert headway.say_blocked(lasting, frame, arrived, 0.08, among=True)[1] == arrived


def test_who_drives_about_in_vain_says_so_and_rests_among_others() -> None:
    wish, frame = Wish(mode="GO", speed_mps=1.0), scenes.frame("robot1", 1, scenes.ORIGIN, STILL)
    said = {
        best_s: headway.say_blocked(navigator.State(best_s=best_s), frame, wish, 0.08, among=True)
        for best_s in (20.0, 60.0, 80.0, 140.0)
    }
    assert said[20.0][1] == wish
    assert [said[best_s][1].reason for best_s in (60.0, 80.0, 140.0)] == ["blocked"] * 3
    assert [said[best_s][1].speed_mps for best_s in (60.0, 80.0, 140.0)] == [1.0, 0.0, 1.0]
    alone = navigator.State(best_s=80.0)
    assert headway.say_blocked(alone, frame, wish, 0.08, among=False)[1] == wish


def test_kernels_and_plain_python_agree() -> None:
    body = np.array((0.0, 0.0, 1.0, 0.0, 0.9, 1.2, 0.144, 0.64, 0.3))
    doubts = np.array((0.3, 0.026, 0.08, 0.2, 0.05, 0.0))
    way, sudden = np.array([[0.1, 0.0], [0.2, 0.1]]), np.array([[[0.5, 0.1], [0.6, 0.1]]])
    touches = np.array([[0.2, 0.15]])
    for kernel, given_ in (
        (announce.length, (body, 0.08)),
        (pledge.keep, (body, doubts, 0.08)),
        (admission.refused_by_sudden, (way, sudden, touches)),
    ):
        plain: Any = getattr(kernel, "py_func", kernel)
        fast: Any = kernel
        assert fast(*given_) == plain(*given_)


@pytest.mark.parametrize(
    ("declared", "tick", "off_m"),
    [
        (DECLARED, 1, 0.08),  # noise of both poses and of the range
        (Disturbance(), 4, 0.27),  # three beacons have not come: it may have gone on elsewhere
    ],
)
def test_peers_leave_no_obstacles_behind_them(
    declared: Disturbance, tick: int, off_m: float
) -> None:
    """Hits beside where a peer is believed to be may be its own: seen now, but not remembered."""
    setup = setup_of(declared)
    body = Pose(1.5, 0.0, pi)
    promise = pledge.promise(setup_of(Disturbance()))
    said = scenes.beacon("robot2", body, tick=0, promise=promise)
    ranges_m = scenes.scan([(1.5 - off_m, 0.0, 0.22), (0.0, -1.0, 0.3)], scenes.ORIGIN)
    frame = scenes.frame("robot1", tick, ranges_m=ranges_m, beacons=(said,))
    state, command = robot.step(setup, robot.init(setup), frame)
    sectors_m = command.trace.sectors.numpy()
    assert sectors_m[len(sectors_m) // 2] < 1.5  # the guard keeps off it
    assert state.navigating.memory is not None
    points_m = state.navigating.memory.points_mm() / 1000.0
    assert len(points_m) > 5
    assert (points_m[:, 1] < -0.5).all()  # what stands beside it is remembered


def test_a_peer_that_promises_nothing_and_stands_is_remembered() -> None:
    """It is an obstacle to go round."""
    setup = setup_of()
    body = Pose(1.5, 0.0, 0.0)
    said = scenes.beacon("robot2", body, arrived=True)
    ranges_m = scenes.scan([(1.5, 0.0, 0.22)], scenes.ORIGIN)
    frame = scenes.frame("robot1", 1, ranges_m=ranges_m, beacons=(said,))
    state, _ = robot.step(setup, robot.init(setup), frame)
    assert state.navigating.memory is not None
    assert len(state.navigating.memory.points_mm()) > 5


def test_hits_are_remembered_as_they_are_where_nothing_is_declared_and_all_are_heard() -> None:
    setup = setup_of(Disturbance())
    near = scenes.peer(scenes.beacon("robot2", Pose(1.0, 0.0, 0.0), tick=0), tick=1)
    ranges_m = scenes.scan([(1.0, 0.5, 0.2)], scenes.ORIGIN)
    assert sight.surely(setup, ranges_m, [near]) is ranges_m
