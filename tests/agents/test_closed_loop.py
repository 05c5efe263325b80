"""The robots in the world, in lock-step: the paper's scenes, within bounds, not to the digit."""

from __future__ import annotations

from math import inf, sqrt

import msgspec
import pytest

from agents import formation, robot
from swarm import scenario
from swarm.scenario import Scenario
from world import simulation

TABLE_I = [
    ("leader", 0.0, 0.0),
    ("robot1", -1.0, 1.0),
    ("robot2", -1.0, -1.0),
    ("robot3", -2.0, 2.0),
    ("robot4", -2.0, 0.0),
    ("robot5", -2.0, -2.0),
]


class Outcome(msgspec.Struct):
    """What became of a run."""

    arrived_s: float = inf
    contacts: int = 0
    clearance_m: float = inf  # to obstacles
    gap_m: float = inf  # between bodies
    error_m: float = 0.0  # formation error at the end
    settling_s: float = inf  # after the last AVOID
    symmetry_m: float = 0.0
    axis_m: float = 0.0  # largest |y| of leader and robot4
    yields: dict[str, int] = {}


def run(text: str, *settings: str, duration_s: float = 60.0) -> Outcome:
    """A scenario until two seconds after everybody has arrived."""
    header = f"title = 'test'\nseed = 3\ndt_s = 0.08\nduration_s = {duration_s}\n"
    world = simulation.build(scenario.decode((header + text).encode(), "test", settings=settings))
    setups = {one.name: world.scenario.setup(one.name) for one in world.scenario.robots}
    minds = {name: robot.init(setup) for name, setup in setups.items()}
    state = simulation.init(world)
    outcome = Outcome(yields=dict.fromkeys(setups, 0))
    last_avoid, settled = 0, 0
    tick, end = 0, inf
    while tick * 0.08 < min(duration_s, end + 2.0):
        commands = {}
        for frame in simulation.sense(world, state):
            minds[frame.robot], command = robot.step(setups[frame.robot], minds[frame.robot], frame)
            commands[frame.robot] = command
            outcome.yields[frame.robot] += command.beacon.yields_to is not None
        outcome.contacts = sum(body.contact for body in state.bodies)
        outcome.clearance_m = min(outcome.clearance_m, *(b.clearance_m for b in state.bodies))
        bodies = dict(zip(setups, state.bodies, strict=True))
        places = [(body.pose.x_m, body.pose.y_m) for body in state.bodies]
        for i, a in enumerate(places):
            for b in places[:i]:
                apart_m = sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2)
                outcome.gap_m = min(outcome.gap_m, apart_m - 0.44)
        if world.scenario.formation is not None:
            outcome.error_m = error_m(world.scenario, bodies, commands)
            mirror(outcome, bodies)
            if any(command.beacon.mode == "AVOID" for command in commands.values()):
                last_avoid = tick
            if outcome.error_m >= 0.1:
                settled = tick + 1
        everybody = all(command.beacon.arrived for command in commands.values())
        end = min(end, tick * 0.08) if everybody else inf
        state = simulation.step(world, state, commands)
        tick += 1
    outcome.arrived_s = end
    outcome.settling_s = max(0, settled - last_avoid) * 0.08
    return outcome


def error_m(
    whole: Scenario,
    bodies: dict[str, simulation.Body],
    commands: dict[str, simulation.Command],
) -> float:
    """Largest distance of a follower from its nominal slot."""
    worst_m = 0.0
    heading_rad = commands["leader"].beacon.formation_heading_rad
    for row, one in enumerate(whole.robots):
        slot = whole.slot(row)
        if slot is not None:
            x_m, y_m = formation.waypoint(
                bodies["leader"].pose, heading_rad, slot.distance_m, slot.bearing_rad
            )
            pose = bodies[one.name].pose
            worst_m = max(worst_m, sqrt((pose.x_m - x_m) ** 2 + (pose.y_m - y_m) ** 2))
    return worst_m


def mirror(outcome: Outcome, bodies: dict[str, simulation.Body]) -> None:
    for left, right in (("robot1", "robot2"), ("robot3", "robot5")):
        a, b = bodies[left].pose, bodies[right].pose
        outcome.symmetry_m = max(outcome.symmetry_m, abs(a.x_m - b.x_m), abs(a.y_m + b.y_m))
    for name in ("leader", "robot4"):
        outcome.axis_m = max(outcome.axis_m, abs(bodies[name].pose.y_m))


def table_i(goal_x_m: float, *circles: tuple[float, float, float]) -> str:
    rows = [
        f"[[robots]]\nname = '{name}'\nstart = [{x_m}, {y_m}, 0.0]\n" for name, x_m, y_m in TABLE_I
    ]
    rows[0] += f"goal = [{goal_x_m}, 0.0]\n"
    obstacles = [f"[[obstacles]]\ncircle = {list(circle)}\n" for circle in circles]
    return "".join(["[formation]\nleader = 'leader'\n", *rows, *obstacles])


TWO = [(7.0, 2.5, 1.5), (7.0, -2.5, 1.5)]


def test_formation_passes_two_obstacles_as_in_figure_13() -> None:
    outcome = run(table_i(18.0, *TWO))
    assert outcome.contacts == 0
    assert outcome.arrived_s < 40.0
    assert outcome.clearance_m >= 0.3
    assert outcome.gap_m >= 0.08
    assert outcome.error_m <= 0.02
    assert outcome.settling_s <= 3.0
    assert outcome.symmetry_m <= 0.05
    assert outcome.axis_m <= 0.01


def test_formation_of_the_strict_controller_passes_two_obstacles() -> None:
    outcome = run(table_i(18.0, *TWO), "robot.controller=paper")
    assert outcome.contacts == 0
    assert outcome.arrived_s < 55.0
    assert outcome.error_m <= 0.02


def test_formation_passes_three_obstacles_as_in_figure_15() -> None:
    outcome = run(table_i(24.0, *TWO, (14.0, 1.3, 1.5)))
    assert outcome.contacts == 0
    assert outcome.arrived_s < 60.0
    assert outcome.error_m <= 0.03


@pytest.mark.parametrize("strategy", ["priority", "mutual"])
def test_pairs_pass_head_on_as_in_figure_12(strategy: str) -> None:
    rows = []
    for pair, y_m in enumerate((3.0, 0.0, -3.0)):
        for way, yaw_rad in ((-7.0, 0.0), (7.0, -3.141592653589793)):
            number = 2 * pair + (1 if way < 0.0 else 2)
            rows.append(
                f"[[robots]]\nname = 'robot{number}'\nstart = [{way}, {y_m}, {yaw_rad}]\n"
                f"goal = [{-way}, {y_m}]\n"
            )
    outcome = run("".join(rows), f"priority.strategy={strategy}", "robot.controller=paper")
    assert outcome.contacts == 0
    assert outcome.arrived_s < 25.0
    assert outcome.yields["robot1"] == 0
    assert (sum(outcome.yields.values()) > 0) == (strategy == "priority")


@pytest.mark.parametrize("controller", ["navigator", "paper"])
def test_robot_finds_through_random_circles_as_in_figure_10(controller: str) -> None:
    outcome = run(
        "[[robots]]\nname = 'robot1'\nstart = [0.0, 0.0, 0.785]\ngoal = [20.0, 20.0]\n"
        "[random_obstacles]\ncount = 13\narea = [1.0, 1.0, 19.0, 19.0]\n",
        f"robot.controller={controller}",
    )
    assert outcome.contacts == 0
    assert outcome.arrived_s < 50.0
    assert outcome.clearance_m > 0.15


def test_robot_leaves_a_trap_by_its_memory() -> None:
    # A U of three walls, open to the start; the goal lies behind its back.
    outcome = run(
        "[[robots]]\nname = 'robot1'\nstart = [0.0, 0.1, 0.0]\ngoal = [12.0, 0.0]\n"
        "[[obstacles]]\npolygon = [[6.0, -2.0], [6.3, -2.0], [6.3, 2.0], [6.0, 2.0]]\n"
        "[[obstacles]]\npolygon = [[3.5, 2.0], [6.3, 2.0], [6.3, 2.3], [3.5, 2.3]]\n"
        "[[obstacles]]\npolygon = [[3.5, -2.3], [6.3, -2.3], [6.3, -2.0], [3.5, -2.0]]\n"
    )
    assert outcome.contacts == 0
    assert outcome.arrived_s < 60.0
