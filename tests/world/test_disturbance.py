"""Declared errors: within their bounds, with their shares, and of nobody else's making."""

from __future__ import annotations

import itertools
from math import inf, sqrt

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm.geometry import STILL, Pose, Twist, length, wrap_angle
from swarm.messages import RobotRecord
from swarm.run import lockstep
from swarm.scenario import Disturbance, Scenario, decode
from tests.world.test_simulation import HEAD, TWO, drive, world_of
from world import disturbance, motion, simulation

RANGE_M = 5.0
NONE = Disturbance()
BOTH = TWO + "[disturbance]\n"


def test_nothing_is_touched_when_nothing_is_declared() -> None:
    scans_m = np.full((2, 8), 2.0, np.float32)
    heard = np.ones((2, 2), np.bool_)
    pose = Pose(1.0, 2.0, 3.0)
    shown_m = disturbance.scans(NONE, scans_m, (0, 1), range_m=RANGE_M, seed=1, tick=3)
    assert shown_m is scans_m
    assert disturbance.carried(NONE, heard, b"", seed=1, tick=3) is heard
    assert disturbance.pose(NONE, pose, 0, seed=1, tick=3) is pose
    assert disturbance.creep(NONE, disturbance.NO_DRIFT, 0.1, 0, seed=1, tick=3) is (
        disturbance.NO_DRIFT
    )
    assert disturbance.speed_factors(NONE, 3, seed=1) == (1.0, 1.0, 1.0)
    assert disturbance.late(NONE, (), STILL) == (STILL, ())
    assert disturbance.fade(NONE, b"", 3, seed=1, tick=3) == b""


def test_ranges_are_off_normally_within_three_sigma_and_misses_stay() -> None:
    declared = Disturbance(range_sigma_m=0.01)
    scans_m = np.tile(np.array([2.0, inf], np.float32), (3, 500))
    shown_m = disturbance.scans(declared, scans_m, (0, 2, 3), range_m=RANGE_M, seed=1, tick=3)
    off_m = shown_m[:, ::2].astype(np.float64).ravel() - 2.0
    assert np.isinf(shown_m[:, 1::2]).all()
    assert off_m.std() == pytest.approx(0.01, rel=0.06)
    assert abs(off_m.mean()) < 3 * 0.01 / sqrt(1500)
    assert np.abs(off_m).max() <= declared.range_error_m_max + 1e-6
    one = disturbance.scans(declared, scans_m[:1], (2,), range_m=RANGE_M, seed=1, tick=3)
    assert one[0].tobytes() == shown_m[1].tobytes()  # whoever else is asked
    again = disturbance.scans(declared, scans_m[:1], (2,), range_m=RANGE_M, seed=1, tick=4)
    assert again[0].tobytes() != one[0].tobytes()


@given(seed=st.integers(0, 2**53), tick=st.integers(0, 10**6), row=st.integers(0, 499))
def test_pose_is_never_further_off_than_declared(seed: int, tick: int, row: int) -> None:
    declared = Disturbance(position_sigma_m=0.01, yaw_sigma_rad=0.02)
    true = Pose(3.0, -4.0, 3.14)
    shown = disturbance.pose(declared, true, row, seed=seed, tick=tick)
    off_m = length(shown.x_m - true.x_m, shown.y_m - true.y_m)
    assert 0.0 < off_m <= declared.position_error_m_max + 1e-12
    off_rad = wrap_angle(shown.yaw_rad - true.yaw_rad)
    assert 0.0 < abs(off_rad) <= declared.yaw_error_rad_max + 1e-12
    assert wrap_angle(shown.yaw_rad) == shown.yaw_rad


def test_pose_errors_have_their_sigma_in_each_coordinate() -> None:
    declared = Disturbance(position_sigma_m=0.01, yaw_sigma_rad=0.02)
    shown = [disturbance.pose(declared, Pose(0.0, 0.0, 0.0), 0, seed=1, tick=i) for i in range(900)]
    off = np.array([(pose.x_m, pose.y_m, pose.yaw_rad) for pose in shown])
    assert off.std(axis=0) == pytest.approx([0.01, 0.01, 0.02], rel=0.08)
    assert np.abs(off.mean(axis=0)).max() < 4 * 0.02 / 30


@given(
    ways_m=st.lists(st.floats(0.0, 0.2), min_size=1, max_size=60),
    rate=st.floats(0.001, 0.2),
    most_m=st.floats(0.005, 0.5),
    seed=st.integers(0, 2**53),
)
def test_drift_grows_with_the_way_and_never_beyond_its_bound(
    ways_m: list[float], rate: float, most_m: float, seed: int
) -> None:
    declared = Disturbance(drift_m_per_m=rate, drift_m_max=most_m)
    drift, true = disturbance.NO_DRIFT, Pose(3.0, -4.0, 1.0)
    for tick, way_m in enumerate(ways_m, 1):
        before = drift
        drift = disturbance.creep(declared, before, way_m, 1, seed=seed, tick=tick)
        crept_m = length(drift.x_m - before.x_m, drift.y_m - before.y_m)
        assert crept_m <= rate * way_m + 1e-12
        assert length(drift.x_m, drift.y_m) <= most_m + 1e-12
        shown = disturbance.pose(declared, true, 1, drift, seed=seed, tick=tick)
        off_m = length(shown.x_m - true.x_m, shown.y_m - true.y_m)
        assert off_m <= declared.position_error_m_max + 1e-12
        assert shown.yaw_rad == true.yaw_rad


def test_a_robot_drifts_by_its_share_of_the_way_and_its_peer_another_way() -> None:
    world = world_of(BOTH + "drift_m_per_m = 0.05\ndrift_m_max = 1.0\n")
    state = simulation.init(world)
    state = drive(world, state, 60, a=Twist(0.5, 0.0), b=Twist(0.5, 0.0))
    frames = simulation.sense(world, state)
    off_m = [
        (frame.pose.x_m - body.pose.x_m, frame.pose.y_m - body.pose.y_m)
        for frame, body in zip(frames, state.bodies, strict=True)
    ]
    ways_m = [
        body.pose.x_m - robot.start[0]
        for body, robot in zip(state.bodies, world.scenario.robots, strict=True)
    ]
    for (x_m, y_m), way_m in zip(off_m, ways_m, strict=True):
        assert 0.02 * abs(way_m) < length(x_m, y_m) <= 0.05 * abs(way_m) + 1e-9
    assert off_m[0] != off_m[1]


def test_frames_show_errors_and_records_keep_the_truth() -> None:
    text = BOTH + "position_sigma_m = 0.01\nyaw_sigma_rad = 0.01\nrange_sigma_m = 0.01\n"
    world = world_of(text)
    state = simulation.init(world)
    frames = simulation.sense(world, state)
    assert frames == simulation.sense(world, state)
    record = simulation.record(world, state, frames, ())
    for frame, kept, robot in zip(frames, record.frames, record.robots, strict=True):
        assert frame.pose != robot.pose
        assert kept.pose == frame.pose
        assert kept.ranges == frame.ranges
    assert record.robots[0].pose == Pose(0.0, 0.0, 0.0)


def test_motors_take_set_points_so_many_ticks_later() -> None:
    world = world_of(BOTH + "latency_ticks = 2\n")
    state = simulation.init(world)
    speeds_mps = []
    for number in range(6):
        state = drive(world, state, 1, a=Twist(0.1 * number, 0.0))
        speeds_mps.append(state.bodies[0].twist.speed_mps)
    assert speeds_mps == pytest.approx([0.0, 0.0, 0.0, 0.1, 0.2, 0.3])
    assert state.bodies[0].beacon is not None  # beacons are not late
    assert state.bodies[0].beacon.tick == 5


def test_robot_without_a_mind_brakes_at_once_however_late_its_motors_are() -> None:
    world = world_of(BOTH + "latency_ticks = 3\n")
    state = drive(world, simulation.init(world), 6, a=Twist(0.3, 0.0))
    state = simulation.lose(world, state, "a")
    assert simulation.step(world, state, {}).bodies[0].twist == STILL


def test_body_goes_so_many_times_as_fast_as_its_wheels_say() -> None:
    world = world_of(BOTH + "speed_error = 0.05\n")
    factors = world.speed_factors
    assert set(factors) <= {0.95, 1.05}
    state = drive(world, simulation.init(world), 5, a=Twist(1.0, 0.0), b=Twist(1.0, 0.5))
    for frame, body, factor in zip(
        simulation.sense(world, state), state.bodies, factors, strict=True
    ):
        believed = motion.limited(world.scenario.robots[0], frame.twist, frame.twist, dt_s=0.08)
        assert believed == frame.twist  # within the limits, and the wheels alike
        assert body.twist.speed_mps == pytest.approx(factor * frame.twist.speed_mps)
        assert body.twist.turn_rate_radps == pytest.approx(factor * frame.twist.turn_rate_radps)
    assert state.bodies[0].twist.speed_mps == pytest.approx(factors[0])
    state = drive(world, state, 4, a=STILL, b=STILL)
    assert [body.twist for body in state.bodies] == [STILL, STILL]


def test_half_of_the_robots_are_faster_and_none_depends_on_how_many_there_are() -> None:
    declared = Disturbance(speed_error=0.05)
    factors = disturbance.speed_factors(declared, 400, seed=1)
    assert factors.count(1.05) == pytest.approx(200, abs=35)
    assert disturbance.speed_factors(declared, 30, seed=1) == factors[:30]


def faded(declared: Disturbance, ticks: int, count: int = 12) -> np.ndarray:  # type: ignore[type-arg]
    """(ticks, count, count) whether a link carries."""
    fades, found = b"", []
    every = np.ones((count, count), np.bool_)
    for tick in range(ticks):
        fades = disturbance.fade(declared, fades, count, seed=5, tick=tick)
        found.append(disturbance.carried(declared, every, fades, seed=5, tick=tick))
    return np.array(found)


@pytest.mark.parametrize("longest", [0, 1, 5])
def test_links_lose_their_share_each_for_itself(longest: int) -> None:
    declared = Disturbance(loss_probability=0.2, loss_ticks_max=longest)
    carries = faded(declared, 400)
    assert carries.mean() == pytest.approx(0.8, abs=0.02)
    assert (carries != carries.transpose(0, 2, 1)).any()  # directed
    bursts = [
        len(list(some))
        for link in carries.reshape(len(carries), -1).T
        for carried, some in itertools.groupby(link.tolist())
        if not carried
    ]
    if longest:
        assert max(bursts) == longest
        assert np.mean(bursts) == pytest.approx(declared.loss_ticks_mean, rel=0.03)
    else:
        assert np.mean(bursts) == pytest.approx(1.25, rel=0.03)


def test_bursts_that_cannot_make_up_the_share_are_refused() -> None:
    with pytest.raises(ValueError, match=r"loss_probability <= 0\.5 with bursts of up to 1"):
        Disturbance(loss_probability=0.6, loss_ticks_max=1)


def test_robots_know_what_is_declared() -> None:
    plan = decode((BOTH + "range_sigma_m = 0.01\n").encode(), "test.toml")
    setup = plan.setup("a")
    assert setup.disturbance.range_error_m_max == pytest.approx(0.03)
    assert msgspec.msgpack.decode(msgspec.msgpack.encode(setup), type=type(setup)) == setup


CROSSING = HEAD.replace("duration_s = 1.0", "duration_s = 8.0") + (
    '[[robots]]\nname = "a"\nstart = [0.0, 0.0, 0.0]\ngoal = [6.0, 0.0]\n'
    '[[robots]]\nname = "b"\nstart = [6.0, 0.5, 3.14]\ngoal = [0.0, 0.5]\n'
    "[[obstacles]]\ncircle = [3.0, -1.5, 0.5]\n"
    "[disturbance]\nrange_sigma_m = 0.01\nposition_sigma_m = 0.01\nyaw_sigma_rad = 0.0087\n"
    "latency_ticks = 1\nspeed_error = 0.05\nloss_probability = 0.2\nloss_ticks_max = 5\n"
    "drift_m_per_m = 0.02\ndrift_m_max = 0.05\n"
)


def crossing(*faults: str) -> Scenario:
    return decode(CROSSING.encode(), "crossing.toml", faults=faults)


def test_run_is_the_same_again_and_after_its_world_was_killed() -> None:
    undisturbed = lockstep.run(crossing()).score
    again = lockstep.run(crossing()).score
    killed = lockstep.run(crossing("kill:world@3.2")).score
    assert undisturbed.hash.hexdigest() == again.hash.hexdigest() == killed.hash.hexdigest()


def test_links_fade_in_a_run_and_no_robot_is_lost_for_longer_than_declared() -> None:
    ages: list[int] = []
    records: list[tuple[RobotRecord, ...]] = []
    lockstep.run(
        crossing(),
        [
            lambda record: ages.extend(
                record.tick - 1 - tick
                for frame in record.frames
                for _, tick in frame.heard.numpy().tolist()
            ),
            lambda record: records.append(record.robots),
        ],
    )
    assert set(ages) == {0}  # what arrives is of the tick before
    assert len(ages) == pytest.approx(0.8 * 2 * len(records), rel=0.12)
