"""Lidars that fail: what each fault makes of a scan whose truth is known."""

from __future__ import annotations

from math import inf

import numpy as np
import pytest

from swarm.faults import Bias, Dropout, Fault, Nan, Noise, SensorStuck
from swarm.geometry import STILL, Ranges, Twist
from tests.world.test_faults import fault, inflicted
from tests.world.test_simulation import HEAD, drive, world_of
from world import sensors, simulation
from world.faults import Active

BEAMS = 1000
RANGE_M = 5.0
# one half hits something at 2 m, the other nothing
SCANS = np.tile(np.array([2.0, inf], np.float32), (3, BEAMS // 2))


def shown(*struck: tuple[Fault, tuple[int, ...]], tick: int = 0, seed: int = 1) -> Ranges:
    """Scans of the live robots 0, 2 and 3 under these faults."""
    active = [Active(number, one, rows, 0, None) for number, (one, rows) in enumerate(struck)]
    return sensors.disturb(SCANS, (0, 2, 3), active, range_m=RANGE_M, seed=seed, tick=tick)


def test_scans_stay_as_they_are_without_a_fault_of_lidars() -> None:
    assert shown() is SCANS
    assert shown((fault(Nan), (1,))).tolist() == SCANS.tolist()  # nobody who is asked


def test_dropout_takes_its_share_of_the_beams_anew_in_every_tick() -> None:
    scans_m = shown((fault(Dropout, probability=0.3), (2,)))
    assert (scans_m[[0, 2]] == SCANS[[0, 2]]).all()
    kept = np.isfinite(scans_m[1, ::2])
    assert (scans_m[1, ::2][kept] == 2.0).all()
    assert kept.mean() == pytest.approx(0.7, abs=0.06)  # 3 sigma of 500 draws
    other = np.isfinite(shown((fault(Dropout, probability=0.3), (2,)), tick=1)[1, ::2])
    assert (other != kept).mean() == pytest.approx(2 * 0.3 * 0.7, abs=0.07)
    assert np.isinf(shown((fault(Dropout, probability=1.0), (2,)))[1]).all()


def test_noise_is_normal_clipped_at_three_sigma_and_leaves_misses_alone() -> None:
    scans_m = shown((fault(Noise, sigma_m=0.1), (0, 2, 3)))
    off_m = scans_m[:, ::2].astype(np.float64).ravel() - 2.0
    assert np.isinf(scans_m[:, 1::2]).all()
    assert abs(off_m.mean()) < 3 * 0.1 / np.sqrt(1500)
    assert off_m.std() == pytest.approx(0.1, rel=0.06)
    assert np.abs(off_m).max() <= 0.3 + 1e-6
    assert len(np.unique(off_m)) > 1400  # no two robots, no two beams draw the same


def test_bias_and_noise_stay_between_zero_and_the_range() -> None:
    assert shown((fault(Bias, bias_m=0.5), (0,)))[0, :2].tolist() == [2.5, inf]
    assert shown((fault(Bias, bias_m=-2.5), (0,)))[0, :2].tolist() == [0.0, inf]
    assert shown((fault(Bias, bias_m=4.0), (0,)))[0, :2].tolist() == [5.0, inf]
    wild_m = shown((fault(Bias, bias_m=-1.5), (0,)), (fault(Noise, sigma_m=1.0), (0,)))[0, ::2]
    assert wild_m.min() == 0.0
    assert wild_m.max() > 1.5


def test_nan_is_every_beam_and_dropout_comes_before_it() -> None:
    scans_m = shown((fault(Nan), (3,)), (fault(Dropout), (3,)))
    assert np.isnan(scans_m[2]).all()
    assert (scans_m[:2] == SCANS[:2]).all()


def test_draws_depend_on_seed_fault_robot_and_tick_and_on_nobody_else() -> None:
    dropout = fault(Dropout, probability=0.5)
    alone = shown((dropout, (2,)))[1].tobytes()
    together = shown((dropout, (0, 1, 2, 3)))
    assert together[1].tobytes() == alone
    assert together[0].tobytes() != alone
    active = [Active(0, dropout, (0, 1, 2, 3), 0, None)]
    survivor = sensors.disturb(SCANS[:1], (2,), active, range_m=RANGE_M, seed=1, tick=0)
    assert survivor[0].tobytes() == alone
    assert shown((dropout, (2,)), seed=2)[1].tobytes() != alone
    assert shown((fault(Nan), (1,)), (dropout, (2,)))[1].tobytes() != alone  # another number


DRIVING = HEAD + (
    '[[robots]]\nname = "a"\nstart = [0.0, 0.0, 0.0]\n'
    '[[robots]]\nname = "b"\nstart = [0.0, 3.0, 0.0]\n'
    "[[obstacles]]\ncircle = [4.0, 0.0, 0.5]\n"
)


def test_stuck_lidar_repeats_the_scan_of_the_tick_when_it_began_then_tells_the_truth() -> None:
    world = world_of(DRIVING)
    state = drive(world, simulation.init(world), 3, a=Twist(0.5, 0.0), b=STILL)
    truth = simulation.sense(world, state)[0]
    undisturbed = drive(world, state, 3, a=Twist(0.5, 0.0), b=STILL)
    state = inflicted(world, state, (fault(SensorStuck, for_s=0.24), (0,)))
    for _ in range(3):
        state, _ = simulation.relieve(world, state)
        frames = simulation.sense(world, state)
        assert frames[0].ranges == truth.ranges
        state = drive(world, state, 1, a=Twist(0.5, 0.0), b=STILL)
    assert frames[0].pose.x_m > truth.pose.x_m  # the pose is true
    state, _ = simulation.relieve(world, state)
    assert simulation.sense(world, state) == simulation.sense(world, undisturbed)


def test_stuck_lidar_keeps_the_faults_that_it_had_then() -> None:
    world = world_of(DRIVING)
    state = simulation.init(world)
    state = inflicted(
        world, state, (fault(Noise, sigma_m=0.1, for_s=0.08), (0,)), (fault(SensorStuck), (0,))
    )
    first = simulation.sense(world, state)[0].ranges
    assert first != simulation.sense(world, simulation.init(world))[0].ranges
    state, _ = simulation.relieve(world, drive(world, state, 1, a=STILL, b=STILL))
    assert len(state.active) == 1
    assert simulation.sense(world, state)[0].ranges == first
