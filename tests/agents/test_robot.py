"""The whole step: pure, mirrored, finite whatever comes in, and what it does in each situation."""

from __future__ import annotations

from collections.abc import Callable
from math import inf, isfinite, nan, pi, sqrt

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents import follow, navigator, peers, robot
from swarm import messages
from swarm.geometry import STILL, Pose, Twist
from swarm.messages import Beacon, Command, Leadership, SensorFrame, Slot
from swarm.scenario import Priority, RobotSetup
from tests.agents import scenes

SLOT = Slot(sqrt(2.0), -pi / 4.0)
LEADERSHIP = Leadership(0, (0, 0, 0, 0), "leader")
seeds = st.integers(0, 2**32 - 1)


def leader_beacon(pose: Pose, twist: Twist = STILL, tick: int = 0, **changes: object) -> Beacon:
    fields = {"priority": (0, 0, 0, 0), "leadership": LEADERSHIP, **changes}
    return scenes.beacon("leader", pose, twist, tick, **fields)


def first(setup: RobotSetup, frame: SensorFrame) -> Command:
    return robot.step(setup, robot.init(setup), frame)[1]


# --- a generic situation from a seed, and its mirror image in the x axis ------------------------


def situation(seed: int) -> tuple[RobotSetup, list[SensorFrame]]:
    """A robot of any kind among discs and peers, for three ticks."""
    random = np.random.default_rng(seed)
    kind = seed % 3
    slot = Slot(float(random.uniform(1.0, 3.0)), float(random.uniform(-1.4, 1.4)))
    goal = (float(random.uniform(1.0, 9.0)), float(random.uniform(-9.0, 9.0)))
    controller = ("paper", "navigator")[seed // 3 % 2]
    setup = (
        scenes.alone(row=3, goal=goal, controller=controller),
        scenes.leader(goal=goal, via=((goal[0], 0.3),), controller=controller),
        scenes.follower(slot, controller=controller),
    )[kind]
    frames = []
    pose = Pose(*random.uniform(-1.0, 1.0, 3).tolist())
    discs = [
        (*random.uniform(-4.0, 4.0, 2).tolist(), float(random.uniform(0.1, 1.0)))
        for _ in range(random.integers(6))
    ]
    others = [random.uniform(-4.0, 4.0, 3).tolist() for _ in range(3)]
    for tick in (1, 2, 3):
        twist = Twist(*random.uniform(-0.4, 0.4, 2).tolist())
        beacons = [
            scenes.beacon(
                f"robot{7 + i}",
                Pose(other[0], other[1], other[2] % pi),
                Twist(*random.uniform(-0.5, 0.5, 2).tolist()),
                tick=tick - 1,
                priority=((1, 0, 0, 1), (2, 0, 0, 9))[i % 2] if kind == 0 else (2, 0, 0, 9),
                slot=slot if kind == 1 else None,
                bearing_now_rad=slot.bearing_rad if kind == 1 else 0.0,
            )
            for i, other in enumerate(others)
        ]
        if kind == 2:
            heading, rate = random.uniform(-0.5, 0.5, 2).tolist()
            beacons.append(
                leader_beacon(
                    Pose(*random.uniform(-1.0, 3.0, 3).tolist()),
                    Twist(*random.uniform(-0.5, 0.5, 2).tolist()),
                    tick - 1,
                    formation_heading_rad=heading,
                    formation_turn_rate_radps=rate,
                )
            )
        ranges_m = scenes.scan(discs, pose)
        frames.append(scenes.frame(setup.robot.name, tick, pose, twist, ranges_m, tuple(beacons)))
    return setup, frames


def mirrored_pose(pose: Pose) -> Pose:
    return Pose(pose.x_m, -pose.y_m, -pose.yaw_rad)


def mirrored_twist(twist: Twist) -> Twist:
    return Twist(twist.speed_mps, -twist.turn_rate_radps)


def mirrored_slot(slot: Slot | None) -> Slot | None:
    return None if slot is None else Slot(slot.distance_m, -slot.bearing_rad)


def mirrored_frame(frame: SensorFrame) -> SensorFrame:
    beacons = tuple(
        msgspec.structs.replace(
            beacon,
            pose=mirrored_pose(beacon.pose),
            twist=mirrored_twist(beacon.twist),
            slot=mirrored_slot(beacon.slot),
            bearing_now_rad=-beacon.bearing_now_rad,
            formation_heading_rad=-beacon.formation_heading_rad,
            formation_turn_rate_radps=-beacon.formation_turn_rate_radps,
        )
        for beacon in frame.beacons
    )
    return msgspec.structs.replace(
        frame,
        pose=mirrored_pose(frame.pose),
        twist=mirrored_twist(frame.twist),
        ranges=messages.array(frame.ranges_m()[::-1].copy()),
        beacons=beacons,
    )


def mirrored_setup(setup: RobotSetup) -> RobotSetup:
    goal = setup.robot.goal
    body = msgspec.structs.replace(
        setup.robot,
        goal=None if goal is None else (goal[0], -goal[1]),
        via=tuple((x_m, -y_m) for x_m, y_m in setup.robot.via),
    )
    return msgspec.structs.replace(setup, robot=body, slot=mirrored_slot(setup.slot))


@given(seeds)
def test_step_of_a_mirrored_robot_is_mirrored(seed: int) -> None:
    setup, frames = situation(seed)
    other_setup = mirrored_setup(setup)
    state, other_state = robot.init(setup), robot.init(other_setup)
    for frame in frames:
        state, command = robot.step(setup, state, frame)
        other_state, other = robot.step(other_setup, other_state, mirrored_frame(frame))
        if state.navigating.way is not None:
            return  # of two ways that are alike the right one is taken, in a mirror too
        expected = mirrored_twist(command.set_point)
        assert other.set_point.speed_mps == pytest.approx(expected.speed_mps, abs=1e-9)
        assert other.set_point.turn_rate_radps == pytest.approx(expected.turn_rate_radps, abs=1e-9)
        assert other.beacon.mode == command.beacon.mode
        assert other.beacon.yields_to == command.beacon.yields_to
        assert other.beacon.bearing_now_rad == pytest.approx(-command.beacon.bearing_now_rad)
        assert other.trace.limited_by == command.trace.limited_by


@given(seeds)
def test_step_is_pure_and_state_survives_the_wire(seed: int) -> None:
    setup, frames = situation(seed)
    state = robot.init(setup)
    for frame in frames:
        before = msgspec.msgpack.encode((setup, state, frame))
        once = robot.step(setup, state, frame)
        assert robot.step(setup, state, frame) == once
        assert msgspec.msgpack.encode((setup, state, frame)) == before
        stored = msgspec.msgpack.decode(msgspec.msgpack.encode(state), type=robot.State)
        assert stored == state
        assert robot.step(setup, stored, frame) == once
        state = once[0]


# --- nothing but finite numbers within the limits ever leaves -----------------------------------

finite = st.floats(-1e12, 1e12)  # what the decoder lets through
near = st.floats(-3.0, 3.0) | st.sampled_from([0.0, 5e-324, -1e-12]) | finite
poses = st.builds(Pose, near, near, st.floats(-pi, pi, exclude_max=True) | finite)
twists = st.builds(Twist, near, near)
slots = st.builds(Slot, near, near)
beacons = st.builds(
    Beacon,
    name=st.sampled_from(["leader", "robot1", "robot2", "robot3"]),
    tick=st.integers(0, 9),
    incarnation=st.integers(0, 2),
    pose=poses,
    twist=twists,
    body_radius_m=st.floats(0.001, 100.0),
    speed_mps_max=st.floats(0.001, 100.0),
    mode=st.sampled_from(["GO", "FORM", "HOLD", "FAILED"]),
    arrived=st.booleans(),
    priority=st.tuples(*[st.integers(-1000, 1000)] * 4),
    slot=st.none() | slots,
    bearing_now_rad=near,
    leadership=st.none() | st.just(LEADERSHIP),
    goal=st.none(),
    via=st.just(()),
    formation_heading_rad=near,
    formation_turn_rate_radps=near,
    yields_to=st.none() | st.just("robot1"),
)
ranges = st.lists(
    st.sampled_from([0.0, 1e-30, 0.04, 0.3, 0.9, 2.0, 4.99, 5.0, 3e38, inf]),
    min_size=24,
    max_size=24,
)
setups = st.sampled_from(
    [
        scenes.alone(),
        scenes.alone(controller="paper"),
        scenes.alone(controller="navigator"),
        scenes.alone(priority=Priority(strategy="mutual"), row=5),
        scenes.leader(),
        scenes.follower(SLOT),
        scenes.follower(SLOT, controller="paper"),
    ]
)


@given(
    setups, st.lists(st.tuples(poses, twists, ranges, st.lists(beacons, max_size=4)), max_size=3)
)
def test_step_answers_anything_with_finite_set_points(
    setup: RobotSetup, inputs: list[tuple[Pose, Twist, list[float], list[Beacon]]]
) -> None:
    state = robot.init(setup)
    for tick, (pose, twist, sectors_m, heard) in enumerate(inputs, start=7):
        frame = scenes.frame(
            setup.robot.name,
            tick,
            pose,
            twist,
            np.repeat(np.array(sectors_m, dtype=np.float32), 9),
            tuple(heard),
        )
        state, command = robot.step(setup, state, frame)
        v_mps, w_radps = command.set_point.speed_mps, command.set_point.turn_rate_radps
        assert isfinite(v_mps)
        assert isfinite(w_radps)
        assert abs(v_mps) + setup.robot.half_track_m * abs(w_radps) <= 1.0 + 1e-9
        # What leaves is what the wire takes: structs check their numbers as they are decoded.
        wire = messages.encode(command)
        assert messages.decode(messages.COMMAND, wire) == command


def test_frame_takes_nan_for_unknown_but_nothing_negative() -> None:
    ranges_m = scenes.nothing()
    ranges_m[3] = nan
    assert np.isnan(scenes.frame(ranges_m=ranges_m).ranges_m()[3])
    ranges_m[3] = -0.1
    with pytest.raises(ValueError, match=">= 0"):
        scenes.frame(ranges_m=ranges_m)


# --- what it does -------------------------------------------------------------------------------


def test_robot_that_touches_something_commands_zero() -> None:
    for setup in (scenes.alone(), scenes.leader(), scenes.follower(SLOT)):
        frame = scenes.frame(setup.robot.name, twist=Twist(0.5, 1.0), contact=True)
        command = first(setup, frame)
        assert command.set_point == STILL
        assert command.beacon.mode == "FAILED"


def test_robot_without_goal_and_slot_holds_still() -> None:
    command = first(scenes.alone(goal=None), scenes.frame())
    assert command.set_point == STILL
    assert command.beacon.mode == "HOLD"


def test_robot_drives_to_its_goal_at_its_own_speed_and_the_leader_at_cruise_speed() -> None:
    for setup, speed_mps in ((scenes.alone(), 1.0), (scenes.leader(), 0.6)):
        frame = scenes.frame(setup.robot.name, twist=Twist(0.6, 0.0))
        command = first(setup, frame)
        assert command.set_point.speed_mps == pytest.approx(min(speed_mps, 0.6 + 4.0 * 0.08))
        assert command.set_point.turn_rate_radps == 0.0
        assert command.beacon.mode == "GO"


def test_robot_arrives_within_its_tolerance_after_its_waypoints() -> None:
    setup = scenes.alone(goal=(2.0, 0.0), via=((1.0, 1.0), (2.0, 1.0)))
    at_goal = scenes.frame(pose=Pose(2.0, 0.05, 0.0))
    state, command = robot.step(setup, robot.init(setup), at_goal)
    assert not command.beacon.arrived
    assert command.beacon.via == ((1.0, 1.0), (2.0, 1.0))
    for tick, point in enumerate([(1.0, 1.4), (2.4, 1.0)], start=2):
        state, command = robot.step(setup, state, scenes.frame(tick=tick, pose=Pose(*point, 0.0)))
    assert command.beacon.via == ()
    state, command = robot.step(setup, state, scenes.frame(tick=4, pose=Pose(2.0, 0.05, 0.0)))
    assert command.beacon.arrived
    assert command.beacon.mode == "ARRIVED"
    assert command.set_point == STILL


def test_follower_holds_still_until_it_hears_a_leader() -> None:
    command = first(scenes.follower(SLOT), scenes.frame(tick=0))
    assert command.set_point == STILL
    assert command.beacon.mode == "HOLD"
    assert command.beacon.leadership is None


def test_follower_goes_on_for_a_while_without_its_leader_holds_and_takes_over() -> None:
    setup = scenes.follower(SLOT)
    twist = Twist(0.6, 0.0)
    heard = leader_beacon(
        Pose(1.0, -1.0, 0.0),
        twist,
        tick=0,
        goal=(9.0, -1.0),
        via=((5.0, -1.0),),
        formation_heading_rad=0.3,
    )
    state, command = robot.step(
        setup, robot.init(setup), scenes.frame(tick=1, twist=twist, beacons=(heard,))
    )
    assert command.beacon.mode == "FORM"
    assert command.beacon.leadership == LEADERSHIP
    assert command.beacon.leader_tick == 0
    assert command.beacon.goal == (9.0, -1.0)
    modes = []
    for tick in range(2, 9):
        pose = Pose(0.048 * (tick - 1), 0.0, 0.0)
        state, command = robot.step(setup, state, scenes.frame(tick=tick, pose=pose, twist=twist))
        modes.append(command.beacon.mode)
    # 0.5 s of silence are 6 ticks after the beacon's own; another, and it leads.
    assert modes == ["FORM"] * 5 + ["HOLD", "GO"]
    said = command.beacon
    assert said.leadership == Leadership(1, (1, -707, 785, 1), "robot1")
    assert said.leader_tick == 8
    assert said.slot is None
    assert said.priority == (0, 0, 0, 1)
    assert (said.goal, said.via) == ((9.0, -1.0), ((5.0, -1.0),))
    assert said.formation_heading_rad == pytest.approx(0.3)


def test_follower_that_knows_no_goal_holds_still_and_claims_nothing() -> None:
    setup = scenes.follower(SLOT)
    state = robot.init(setup)
    for tick in range(20):
        state, command = robot.step(setup, state, scenes.frame(tick=tick))
    assert command.beacon.leadership is None
    assert not command.beacon.fit
    assert command.set_point == STILL


def test_follower_takes_the_slot_that_its_leader_gives_it() -> None:
    setup = scenes.follower(SLOT)
    given = (("robot2", Slot(3.0, 0.0)), ("robot1", Slot(2.0, 0.0)))
    heard = leader_beacon(Pose(1.0, -1.0, 0.0), assignments=given)
    state, command = robot.step(setup, robot.init(setup), scenes.frame(beacons=(heard,)))
    assert command.beacon.slot == Slot(2.0, 0.0)
    assert command.beacon.priority == (1, -500, 0, 1)
    later = leader_beacon(Pose(1.0, -1.0, 0.0), tick=1)
    _, command = robot.step(setup, state, scenes.frame(tick=2, beacons=(later,)))
    assert command.beacon.slot == Slot(2.0, 0.0)


def test_restarted_leader_follows_whoever_was_elected_and_gets_a_slot() -> None:
    setup = scenes.leader()
    state = robot.init(setup, incarnation=1)
    state, command = robot.step(setup, state, scenes.frame("leader", tick=200))
    assert (command.beacon.mode, command.beacon.leadership) == ("HOLD", None)
    new = Leadership(1, (1, -707, 785, 1), "robot1")
    heard = scenes.beacon(
        "robot1",
        Pose(1.0, 0.0, 0.0),
        tick=200,
        leadership=new,
        goal=(9.0, 0.0),
        assignments=(("leader", SLOT),),
    )
    frame = scenes.frame("leader", tick=201, beacons=(heard,))
    state, command = robot.step(setup, state, frame)
    assert (command.beacon.leadership, command.beacon.slot) == (new, SLOT)
    assert command.beacon.mode == "FORM"


def test_robot_that_leads_gives_out_slots_until_they_are_taken() -> None:
    places = (Slot(1.0, -1.0), Slot(1.0, 1.0), Slot(2.0, 0.0))
    setup = scenes.follower(places[2], row=1, places=places)
    heard = leader_beacon(Pose(2.0, 0.0, 0.0), goal=(9.0, 0.0))
    state, _ = robot.step(setup, robot.init(setup), scenes.frame(beacons=(heard,)))
    for tick in range(2, 9):  # robot3 is on the right, but has a slot on the left; and so robot2
        others = (
            scenes.beacon("robot2", Pose(-0.5, 0.9, 0.0), tick=tick - 1, slot=places[1]),
            scenes.beacon("robot3", Pose(-0.5, -0.9, 0.0), tick=tick - 1, slot=places[0]),
        )
        state, command = robot.step(setup, state, scenes.frame(tick=tick, beacons=others))
    assert command.beacon.assignments == (("robot2", places[0]), ("robot3", places[1]))
    others = (
        scenes.beacon("robot2", Pose(-0.5, 0.9, 0.0), tick=8, slot=places[0]),
        scenes.beacon("robot3", Pose(-0.5, -0.9, 0.0), tick=8, slot=places[1]),
    )
    _, command = robot.step(setup, state, scenes.frame(tick=9, beacons=others))
    assert command.beacon.assignments == ()


def test_follower_obeys_the_highest_leadership_it_heard() -> None:
    setup = scenes.follower(SLOT)
    new = Leadership(1, (1, -500, 0, 4), "robot4")
    beacons = (
        leader_beacon(Pose(1.0, -1.0, 0.0)),
        scenes.beacon("robot4", Pose(5.0, 0.0, 0.0), leadership=new),
    )
    state, command = robot.step(setup, robot.init(setup), scenes.frame(beacons=beacons))
    assert command.beacon.leadership == new
    later = (leader_beacon(Pose(1.0, -1.0, 0.0), tick=1),)
    state, command = robot.step(setup, state, scenes.frame(tick=2, beacons=later))
    assert command.beacon.leadership == new


def test_follower_in_its_slot_moves_with_its_leader() -> None:
    setup = scenes.follower(SLOT)
    twist = Twist(0.6, 0.0)
    heard = leader_beacon(Pose(1.0 - 0.048, -1.0, 0.0), twist)
    command = first(setup, scenes.frame(twist=twist, beacons=(heard,)))
    assert command.set_point.speed_mps == pytest.approx(0.6)
    assert command.set_point.turn_rate_radps == pytest.approx(0.0, abs=1e-9)
    assert command.trace.error == pytest.approx((0.0, 0.0), abs=1e-9)


@pytest.mark.parametrize(("controller", "ticks"), [("paper", 9), ("navigator", 11)])
def test_follower_avoids_what_is_ahead_and_reforms_half_a_second_after(
    controller: str, ticks: int
) -> None:
    # What is remembered it keeps off until three beams have gone through where it was.
    setup = scenes.follower(SLOT, controller=controller)
    state = robot.init(setup)
    modes = []
    for tick in range(1, ticks + 5):
        heard = leader_beacon(Pose(1.0, -1.0, 0.0), tick=tick - 1)
        ranges_m = scenes.wall(1.2, half_width=0.05) if tick <= 3 else scenes.nothing()
        state, command = robot.step(
            setup, state, scenes.frame(tick=tick, ranges_m=ranges_m, beacons=(heard,))
        )
        modes.append(command.beacon.mode)
    assert modes == ["AVOID"] * ticks + ["FORM"] * 4


def test_follower_arrives_a_second_after_its_leader() -> None:
    setup = scenes.follower(SLOT)
    state = robot.init(setup)
    modes = []
    for tick in range(1, 16):
        heard = leader_beacon(Pose(1.0, -1.0, 0.0), tick=tick - 1, arrived=True)
        state, command = robot.step(setup, state, scenes.frame(tick=tick, beacons=(heard,)))
        modes.append(command.beacon.mode)
    assert modes == ["FORM"] * 12 + ["ARRIVED"] * 3
    assert command.beacon.arrived


def test_leader_announces_how_the_formation_turns() -> None:
    setup = scenes.leader()
    state, command = robot.step(
        setup, robot.init(setup), scenes.frame("leader", pose=Pose(0.0, 0.0, 0.4))
    )
    assert command.beacon.formation_heading_rad == 0.4
    assert command.beacon.formation_turn_rate_radps == 0.0
    state, command = robot.step(
        setup, state, scenes.frame("leader", tick=2, pose=Pose(0.0, 0.0, 0.5))
    )
    assert command.beacon.formation_turn_rate_radps == pytest.approx(0.05)
    state, command = robot.step(
        setup, state, scenes.frame("leader", tick=3, pose=Pose(0.0, 0.0, 0.5))
    )
    assert command.beacon.formation_heading_rad == pytest.approx(0.4 + 0.05 * 0.08)


def test_leader_slows_down_for_a_follower_that_lags() -> None:
    setup = scenes.leader()
    late = scenes.beacon("robot1", Pose(-2.6, 0.0, 0.0), slot=Slot(1.4, 0.0))
    command = first(setup, scenes.frame("leader", twist=Twist(0.4, 0.0), beacons=(late,)))
    # 1.2 m behind its way-point: 1 - (1.2 - 0.6) / 1.2 of 0.6 m/s
    assert command.set_point.speed_mps == pytest.approx(0.3)


def test_guard_holds_a_robot_that_drives_at_a_wall() -> None:
    frame = scenes.frame(twist=Twist(0.6, 0.0), ranges_m=scenes.wall(0.35))
    command = first(scenes.alone(controller="paper"), frame)
    assert command.trace.limited_by == "brake"
    assert command.set_point.speed_mps <= command.trace.speed_limit_mps < 0.6


def test_robot_goes_round_a_peer_that_stands_but_not_one_that_moves() -> None:
    setup = scenes.alone(row=1)
    ranges_m = scenes.scan([(1.5, 0.1, 0.22)], scenes.ORIGIN)
    arcs = {}
    for mode in ("GO", "HOLD"):
        heard = scenes.beacon("robot2", Pose(1.5, 0.1, 0.0), mode=mode, priority=(1, 0, 0, 2))
        arcs[mode] = first(setup, scenes.frame(ranges_m=ranges_m, beacons=(heard,))).trace.arcs
    assert not arcs["GO"]
    assert len(arcs["HOLD"]) == 1


def test_robots_that_are_moving_obstacles_stay_on_the_map_and_repel() -> None:
    mutual = Priority(strategy="mutual")
    setup = scenes.alone(row=1, priority=mutual, controller="paper")
    heard = scenes.beacon("robot2", Pose(0.9, 0.1, 0.0))
    ranges_m = scenes.scan([(0.9, 0.1, 0.22)], scenes.ORIGIN)
    trace = first(setup, scenes.frame(ranges_m=ranges_m, beacons=(heard,))).trace
    assert len(trace.arcs) == 1
    assert trace.forces.robots[0] < 0.0
    assert trace.forces.repulsive != (0.0, 0.0)


def test_trace_tells_what_was_seen_and_added_up() -> None:
    setup = scenes.alone(controller="paper")
    ranges_m = scenes.scan([(2.0, 0.7, 0.5)], scenes.ORIGIN)
    trace = first(setup, scenes.frame(ranges_m=ranges_m)).trace
    assert trace.sectors.numpy().tolist() == pytest.approx(
        np.float32(scenes.look(setup, ranges_m).sectors_m).tolist()
    )
    forces = trace.forces
    parts = (forces.attractive, forces.repulsive, forces.rotating, forces.robots)
    assert forces.resultant == pytest.approx(
        (sum(part[0] for part in parts), sum(part[1] for part in parts))
    )
    assert forces.attractive == (50.0, 0.0)
    assert trace.waypoint == (10.0, 0.0)


@pytest.mark.parametrize("role", [scenes.alone, scenes.leader])
def test_robot_that_has_failed_says_why_and_stands(role: Callable[..., RobotSetup]) -> None:
    setup = role(goal=(10.0, 0.0))
    given_up = msgspec.structs.replace(
        robot.init(setup), navigating=navigator.State(failed="enclosed")
    )
    state, command = robot.step(setup, given_up, scenes.frame(setup.robot.name))
    assert (command.beacon.mode, command.beacon.reason) == ("FAILED", "enclosed")
    assert command.set_point == STILL
    frame = scenes.frame(setup.robot.name, tick=2, contact=True)
    _, command = robot.step(setup, state, frame)
    assert command.beacon.reason == "contact"


@pytest.mark.parametrize(("reason", "mode"), [("enclosed", "FAILED"), ("contact", "AVOID")])
def test_follower_fails_with_a_leader_that_has_given_up(reason: str, mode: str) -> None:
    setup = scenes.follower(Slot(2.0, 0.0))
    leads = scenes.beacon(
        "leader",
        Pose(1.0, 0.0, 0.0),
        mode="FAILED",
        reason=reason,
        leadership=Leadership(0, (0, 0, 0, 0), "leader"),
    )
    ranges_m = scenes.scan([(1.0, 0.0, 0.22)], scenes.ORIGIN)
    frame = scenes.frame(ranges_m=ranges_m, beacons=(leads,))
    _, command = robot.step(setup, robot.init(setup), frame)
    assert command.beacon.mode == mode
    assert command.beacon.reason == ("leader" if mode == "FAILED" else "")


def test_follower_gives_up_150_s_after_its_leader_arrived() -> None:
    setup = scenes.follower(Slot(2.0, 0.0))
    leads = scenes.beacon(
        "leader",
        Pose(9.0, 0.0, 0.0),
        arrived=True,
        mode="ARRIVED",
        leadership=Leadership(0, (0, 0, 0, 0), "leader"),
    )
    state = msgspec.structs.replace(
        robot.init(setup), following=msgspec.structs.replace(follow.init(setup), late_s=149.9)
    )
    state, command = robot.step(setup, state, scenes.frame(beacons=(leads,)))
    assert command.beacon.mode == "FORM"
    _, command = robot.step(setup, state, scenes.frame(tick=2, beacons=(leads,)))
    assert (command.beacon.mode, command.beacon.reason) == ("FAILED", "too-long")


def test_leader_stops_beside_who_has_died_on_its_goal_since() -> None:
    setup = scenes.leader(goal=(3.0, 0.0))
    closed = navigator.State(failed="enclosed")
    state = msgspec.structs.replace(robot.init(setup), navigating=closed)
    died = msgspec.structs.replace(state, bodies=(peers.Body("robot2", 3.0, 0.0, 0.22),))
    frame = scenes.frame("leader")
    assert robot.step(setup, state, frame)[1].beacon.mode == "FAILED"
    state, command = robot.step(setup, died, frame)
    assert (command.beacon.mode, command.beacon.reason) == ("HOLD", "")
    assert command.beacon.goal == pytest.approx((2.06, 0.0))
    _, command = robot.step(setup, state, scenes.frame("leader", tick=2))
    assert command.beacon.mode == "GO"
