"""A run as arrays: what is taken from the ticks, and errors computed by hand."""

from __future__ import annotations

from collections.abc import Callable
from math import atan2, pi, sqrt

import numpy as np
import pytest

from dashboards import tracks
from swarm import errors, metrics
from swarm.messages import TickRecord
from swarm.scenario import Scenario

MadeTicks = Callable[..., tuple[TickRecord, ...]]
MadeScenario = Callable[[int], Scenario]


def test_collect_takes_poses_forces_and_states_of_every_tick(
    made_ticks: MadeTicks, made_scenario: MadeScenario
) -> None:
    records = made_ticks(3, 30)
    path = tracks.collect(made_scenario(3), (), records)
    assert path.times_s == pytest.approx([0.08 * tick for tick in range(30)])
    pose = records[17].robots[2].pose
    assert tuple(path.poses[17, 2]) == (pose.x_m, pose.y_m, pose.yaw_rad)
    assert np.isnan(path.forces_rad[0]).all()  # tick 0 has no commands
    assert path.forces_rad[1:] == pytest.approx(np.full((29, 3), atan2(0.7, 1.2)))
    assert path.states[0] == ("AVOID", "FORM", "FORM")
    assert path.states[20] == ("FORM", "FORM", "AVOID")


def test_slots_are_those_of_the_metrics_at_every_tick(
    made_ticks: MadeTicks, made_scenario: MadeScenario
) -> None:
    plan, records = made_scenario(4), made_ticks(4, 10)
    path = tracks.collect(plan, (), records)
    assert list(tracks.followers(path)) == [1, 2, 3]
    off_m = tracks.tracking_errors(path)[2]
    score = metrics.begin(plan)
    for tick, record in enumerate(records):
        metrics.observe(score, record)
        for row in (1, 2, 3):
            expected_m = metrics.formation_error_now(score, f"robot{row + 1}")
            assert off_m[tick, row] == pytest.approx(expected_m, abs=1e-12)


def test_tracking_errors_are_desired_minus_actual(
    made_ticks: MadeTicks, made_scenario: MadeScenario
) -> None:
    path = tracks.collect(made_scenario(2), (), made_ticks(2, 1))
    path.poses[0, :, :2] = [[5.0, 1.0], [5.0, 3.0]]  # 2 m to the left of the leader
    path.slots[0, 1] = [4.0, 0.0]  # sqrt(2) m behind it on the right
    distance_m, bearing_rad, off_m = tracks.tracking_errors(path)
    assert distance_m[0, 1] == pytest.approx(sqrt(2.0) - 2.0)
    assert bearing_rad[0, 1] == pytest.approx(3.0 * pi / 4.0)  # from 90 to -135 degrees, wrapped
    assert off_m[0, 1] == pytest.approx(sqrt(10.0))
    assert np.isnan(off_m[0, 0])


def test_collect_raises_when_there_is_no_tick(made_scenario: MadeScenario) -> None:
    with pytest.raises(errors.RecordingError, match="expected ticks"):
        tracks.collect(made_scenario(1), (), ())
