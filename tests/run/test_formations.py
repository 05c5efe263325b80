"""Swarms in memory: shapes of all kinds, robots of all kinds, goals without a way."""

from __future__ import annotations

from math import cos, sin
from pathlib import Path

import pytest

import world.scenarios
from swarm import metrics, shapes
from swarm.run import lockstep
from swarm.scenario import decode
from swarm.shapes import Shape

FOLDER = Path(world.scenarios.__file__).parent
HEAD = "title = 'test'\nseed = 1\ndt_s = 0.08\nduration_s = 90.0\n"


def run(text: str, *settings: str) -> metrics.Summary:
    plan = decode(text.encode(), "test", settings=settings)
    conduct = lockstep.run(plan)
    return metrics.summary(conduct.score, metrics.Facts(scenario="test", run="test", bus="memory"))


@pytest.mark.parametrize("name", ["wedge-of-nine", "mixed-robots", "enclosed-goal"])
def test_scenario_meets_what_it_expects(name: str) -> None:
    assert run((FOLDER / f"{name}.toml").read_text()).expect.missed == []


def shaped(shape: Shape, robots: int, goal_m: float = 9.0) -> str:
    return (
        f"[line]\ncount = {robots}\ngoal = [{goal_m}, 0.0]\n"
        f"[formation]\nleader = 'robot1'\nshape = '{shape}'\nspacing_m = 1.2\n"
    )


@pytest.mark.parametrize("shape", shapes.SHAPES)
def test_robots_in_a_row_take_the_slots_of_a_shape(shape: Shape) -> None:
    summary = run(HEAD + shaped(shape, 5))
    assert summary.outcome == "succeeded"
    assert summary.formation is not None
    assert summary.formation.error_m_final is not None
    assert summary.formation.error_m_final < 0.05
    assert summary.min_clearance_robot_m is not None
    assert summary.min_clearance_robot_m > 0.05


def test_two_robots_are_a_formation() -> None:
    assert run(HEAD + shaped("wedge", 2, 5.0)).outcome == "succeeded"


def test_fifty_robots_are_a_formation() -> None:
    places = [(-slot.distance_m, slot.bearing_rad) for slot in shapes.slots("diamond", 49, 1.2)]
    rows = "".join(
        f"[[robots]]\nname = 'robot{row + 2}'\n"
        f"start = [{away_m * cos(bearing_rad)}, {away_m * sin(bearing_rad)}, 0.0]\n"
        for row, (away_m, bearing_rad) in enumerate(places)
    )
    leader = "[[robots]]\nname = 'robot1'\nstart = [0.0, 0.0, 0.0]\ngoal = [2.0, 0.0]\n"
    formation = "[formation]\nleader = 'robot1'\nshape = 'diamond'\nspacing_m = 1.2\n"
    summary = run(HEAD + formation + leader + rows, "radio.range_m=20.0")
    assert summary.outcome == "succeeded"
    assert summary.arrived == 50
    assert summary.formation is not None
    assert summary.formation.error_m_final is not None
    assert summary.formation.error_m_final < 0.05


def test_formation_waits_for_a_slow_follower_and_keeps_off_a_large_one() -> None:
    rows = ((0.0, 0.0, 0.22, 1.0), (-1.2, 1.2, 0.4, 0.45), (-1.2, -1.2, 0.15, 1.5))
    text = "[formation]\nleader = 'robot1'\nshape = 'wedge'\nspacing_m = 2.0\n" + "".join(
        f"[[robots]]\nname = 'robot{row + 1}'\nstart = [{x_m}, {y_m}, 0.0]\n"
        f"body_radius_m = {radius_m}\nspeed_mps_max = {speed_mps}\n"
        + ("goal = [10.0, 0.0]\n" if row == 0 else "controller = 'paper'\n" if row == 2 else "")
        for row, (x_m, y_m, radius_m, speed_mps) in enumerate(rows)
    )
    summary = run(HEAD + text)
    assert summary.outcome == "succeeded"
    assert summary.formation is not None
    assert summary.formation.error_m_final is not None
    assert summary.formation.error_m_final < 0.05
    assert summary.makespan_s is not None
    assert summary.makespan_s > 10.0 / 0.45


@pytest.mark.parametrize("strategy", ["priority", "mutual"])
@pytest.mark.parametrize("radii_m", [(0.15, 0.4), (0.4, 0.4), (0.4, 0.15)])
def test_mixed_robots_meet_head_on_without_contact(
    strategy: str, radii_m: tuple[float, float]
) -> None:
    one_m, other_m = radii_m
    text = (
        "[[robots]]\nname = 'robot1'\nstart = [-4.0, 0.0, 0.0]\ngoal = [4.0, 0.0]\n"
        f"body_radius_m = {one_m}\nspeed_mps_max = 1.6\n"
        "[[robots]]\nname = 'robot2'\nstart = [4.0, 0.1, -3.0]\ngoal = [-4.0, 0.1]\n"
        f"body_radius_m = {other_m}\nspeed_mps_max = 0.6\ncontroller = 'paper'\n"
    )
    summary = run(HEAD + text, f"priority.strategy={strategy}")
    assert summary.collisions == 0
    assert summary.outcome == "succeeded"


def test_followers_fail_with_a_leader_that_finds_no_way() -> None:
    text = HEAD + shaped("column", 3, 6.0) + "[[obstacles]]\ncircle = [6.0, 0.0, 1.5]\n"
    summary = run(text)
    assert summary.collisions == 0
    assert [(row.outcome, row.reason) for row in summary.per_robot] == [
        ("blocked", "enclosed"),
        ("blocked", "leader"),
        ("blocked", "leader"),
    ]
    assert summary.sim_time_s < 90.0  # before its time is up
