"""The swarm with masses and motors, `--set robot.motion=dynamic`: the paper's scene, in memory."""

from __future__ import annotations

from swarm import metrics, scenario
from swarm.metrics import Summary
from swarm.run import library, lockstep


def run(name: str, *settings: str) -> Summary:
    _, where, data = library.read_scenario(name)
    plan = scenario.decode(data, where, settings=("robot.motion=dynamic", *settings))
    score = lockstep.run(plan).score
    return metrics.summary(score, metrics.Facts(scenario=name, run="test", bus="memory"))


def test_formation_passes_two_obstacles_with_motors_of_3_nm() -> None:
    summary = run("two-obstacles")
    assert summary.outcome == "succeeded"
    assert summary.collisions == 0
    assert summary.min_clearance_robot_m is not None
    assert summary.min_clearance_robot_m >= 0.05
    assert summary.expect.missed == []  # all that the ideal wheels have to reach
    _, where, data = library.read_scenario("two-obstacles")
    ideal = lockstep.run(scenario.decode(data, where)).score
    assert summary.state_hash != ideal.hash.hexdigest()


def test_formation_keeps_apart_with_motors_of_1_nm_when_guards_plan_for_them() -> None:
    # 2 N m / 0.12 m / 12 kg = 1.4 m/s^2 straight on, of the 4 that the robots believe they have;
    # with the guards' usual 1 m/s^2, to which turning leaves too little, they pass as near as 1 cm.
    summary = run("two-obstacles", "robot.wheel_torque_nm_max=1.0", "guard.deceleration_mps2=0.7")
    assert summary.outcome == "succeeded"
    assert summary.min_clearance_robot_m is not None
    assert summary.min_clearance_robot_m >= 0.05
