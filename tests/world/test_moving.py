"""Obstacles that move: seen by lidars, felt by bodies, stopped by nothing."""

from __future__ import annotations

from math import cos, inf, pi, sin
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm import errors, metrics, movers
from swarm.geometry import STILL, Floats, Pose, Twist
from swarm.run import lockstep, replay, why
from swarm.scenario import Obstacle, Scenario, decode
from tests.run import test_replay
from tests.world.test_simulation import HEAD, drive, world_of
from world import contact, raycast, scene, simulation

ALONE = HEAD + '[[robots]]\nname = "a"\nstart = [0.0, 0.0, 0.0]\n'
# comes from 3 m ahead to 3 m behind, through the robot
THROUGH = "[[obstacles]]\ncircle = [3.0, 0.0, 0.5]\npath = [[-3.0, 0.0]]\nspeed_mps = 1.0\n"
RADIUS_M = 0.22


def test_lidar_sees_it_where_it_is_at_every_tick() -> None:
    world = world_of(ALONE + THROUGH)
    state = simulation.init(world)
    for tick in range(20):
        (frame,) = simulation.sense(world, state)
        ahead_m = float(frame.ranges_m()[np.argmin(frame.ranges_m())])
        assert ahead_m == pytest.approx(3.0 - 0.08 * tick - 0.5, abs=5e-3)
        state = simulation.step(world, state, {})


def test_lidar_sees_the_same_as_of_a_circle_that_stands_there() -> None:
    world = world_of(ALONE + THROUGH)
    state = drive(world, simulation.init(world), 10, a=STILL)
    x_m, y_m = movers.place(world.movers[0], 10 * 0.08)
    standing = ALONE + f"[[obstacles]]\ncircle = [{x_m!r}, {y_m!r}, 0.5]\n"
    there = world_of(standing)
    (frame,), (other,) = (
        simulation.sense(world, state),
        simulation.sense(there, drive(there, simulation.init(there), 10, a=STILL)),
    )
    assert frame.ranges == other.ranges
    assert state.bodies[0].clearance_m == simulation.init(there).bodies[0].clearance_m


def test_robot_that_stands_is_run_over_once_and_sees_nothing_but_what_is_upon_it() -> None:
    world = world_of(ALONE + THROUGH)
    state = simulation.init(world)
    touched, least_m = [], inf
    for _ in range(60):
        state = simulation.step(world, state, {})
        body = state.bodies[0]
        touched.append(body.contact)
        least_m = min(least_m, body.clearance_m)
        ranges_m = simulation.sense(world, state)[0].ranges_m()
        assert (ranges_m >= 0.0).all()
        x_m, _ = movers.place(world.movers[0], state.tick * 0.08)
        assert (ranges_m == 0.0).all() == (abs(x_m) < 0.5)
    assert touched.index(True) == 28  # after 2.28 m: 28.5 ticks
    assert all(touched[28:])
    assert state.bodies[0].pose == Pose(0.0, 0.0, 0.0)
    assert least_m == 0.0


def test_robot_stops_where_it_meets_it_and_the_other_goes_on() -> None:
    world = world_of(ALONE + THROUGH)
    state = simulation.init(world)
    while not state.bodies[0].contact:
        state = drive(world, state, 1, a=Twist(1.0, 0.0))
    first = state.bodies[0].pose
    assert 0.5 < first.x_m < 1.6
    state = drive(world, state, 20, a=Twist(1.0, 0.0))
    assert state.bodies[0].pose == first


def test_start_upon_it_is_refused() -> None:
    text = ALONE + THROUGH.replace("3.0, 0.0, 0.5", "0.5, 0.0, 0.5")
    with pytest.raises(errors.ScenarioError, match="start clear of every obstacle"):
        world_of(text)


def touches(passing: contact.Passing, starts_m: Floats, ends_m: Floats) -> dict[int, float]:
    radii_m = np.full(len(starts_m), RADIUS_M)
    return contact.sweep(
        scene.build(()), starts_m, ends_m, radii_m, np.full(len(starts_m), inf), passing
    )


@given(
    angle_rad=st.floats(-pi, pi),
    heading_rad=st.floats(-pi, pi),
    distance_m=st.floats(0.73, 1.2),
    speeds=st.tuples(st.sampled_from([0.0, 0.2, 0.6]), st.floats(0.01, 0.6)),
)
def test_sweep_meets_it_when_watching_every_instant_does(
    angle_rad: float, heading_rad: float, distance_m: float, speeds: tuple[float, float]
) -> None:
    start_m = np.array([[0.0, 0.0]])
    end_m = np.array([[speeds[0], 0.0]])
    from_m = distance_m * np.array([[cos(angle_rad), sin(angle_rad)]])
    to_m = from_m + speeds[1] * np.array([[cos(heading_rad), sin(heading_rad)]])
    found = touches(contact.Passing(from_m, to_m, np.array([0.5])), start_m, end_m)
    shares = np.linspace(0.0, 1.0, 2001)[:, None]
    apart_m = (start_m + shares * (end_m - start_m)) - (from_m + shares * (to_m - from_m))
    gaps_m = np.sqrt((apart_m**2).sum(axis=1)) - 0.5 - RADIUS_M
    if 0 in found:
        first = int(np.argmax(gaps_m < 1e-3))
        assert gaps_m.min() < 1e-3
        assert found[0] >= (shares[first, 0] - 1e-3 if speeds[0] else 0.0)
    else:
        assert gaps_m.min() > -1e-6


def test_robot_that_was_stopped_by_another_is_met_where_it_stands() -> None:
    # The first two meet half-way at 0.28 m each; what moves comes upon the one on the left later.
    starts_m = np.array([[0.0, 0.0], [1.0, 0.0]])
    ends_m = np.array([[0.56, 0.0], [0.44, 0.0]])
    passing = contact.Passing(np.array([[0.28, 1.0]]), np.array([[0.28, 0.5]]), np.array([0.5]))
    found = touches(passing, starts_m, ends_m)
    assert found == {0: pytest.approx(0.5), 1: pytest.approx(0.5)}


def test_scan_of_still_scenes_costs_no_beam_more() -> None:
    some = scene.build((Obstacle(circle=(2.0, 0.0, 0.5)),))
    sensor = raycast.lidar(16, 5.0, some, np.array([0.2]))
    poses = [Pose(0.0, 0.0, 0.0)]
    moved = raycast.lidar(16, 5.0, some, np.array([0.2]), np.array([0.3]))
    far_m = np.array([[40.0, 0.0]])
    assert raycast.cast(sensor, poses, [0]).tobytes() == (
        raycast.cast(moved, poses, [0], far_m).tobytes()
    )


CROSSING = HEAD.replace("duration_s = 1.0", "duration_s = 12.0") + (
    '[[robots]]\nname = "a"\nstart = [0.0, 0.0, 0.0]\ngoal = [6.0, 0.0]\n'
    "[[obstacles]]\ncircle = [3.0, -1.0, 0.3]\npath = [[3.0, 2.0]]\nspeed_mps = 0.4\n"
)


def crossing(*faults: str) -> Scenario:
    return decode(CROSSING.encode(), "crossing.toml", faults=faults)


def test_run_is_the_same_again_and_after_its_world_was_killed() -> None:
    first = lockstep.run(crossing()).score
    killed = lockstep.run(crossing("kill:world@3.2")).score
    assert first.hash.hexdigest() == killed.hash.hexdigest()
    assert first.clearance_obstacle_m == killed.clearance_obstacle_m < 3.0


def test_recording_replays_and_tells_where_it_was(tmp_path: Path) -> None:
    plan = crossing()
    records = test_replay.run(test_replay.Swarm(plan), lambda swarm, tick: None, ticks=60)
    path = test_replay.write(tmp_path, plan, records)
    assert replay.replay(path).ok
    found = why.why(path, "a", 3.2)
    (one,) = found.passing
    assert one.centre == movers.place(movers.moving(plan.obstacles)[0], 40 * 0.08)
    assert one.gap_m == pytest.approx(records[40].robots[0].obstacle_clearance_m)
    assert metrics.of_records(plan, records).clearance_obstacle_m <= one.gap_m
