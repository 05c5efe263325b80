"""What is drawn, from the numbers of the ticks; the metrics are the second opinion on errors."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import msgspec
import numpy as np
import pytest
import rerun as rr

from dashboards import stage, states, views
from swarm import faults, geometry, messages, metrics
from swarm.faults import ProcessFault
from swarm.messages import Event, TickRecord
from swarm.scenario import Scenario

MakeTicks = Callable[..., tuple[TickRecord, ...]]
MakeScenario = Callable[[int], Scenario]

ENTITIES_MAX = 40


def draw(
    scenario: Scenario, ticks: Sequence[TickRecord], before: views.Before | None = None
) -> dict[str, views.Drawing]:
    shots = [views.shot(record) for record in ticks]
    batch = views.batch(scenario, shots, before or views.Before())
    return {drawing.path: drawing for view in views.VIEWS for drawing in view(batch)}


def values(drawing: views.Drawing, column: int = 0) -> list[np.ndarray]:
    """Numbers of one component, an array per row."""
    arrow = drawing.columns[column].as_arrow_array()
    return [np.array(row.as_py(), dtype=np.float64) for row in arrow]


def moved(record: TickRecord, poses: Sequence[geometry.Pose]) -> TickRecord:
    robots = tuple(
        msgspec.structs.replace(robot, pose=pose)
        for robot, pose in zip(record.robots, poses, strict=True)
    )
    return msgspec.structs.replace(record, robots=robots)


@pytest.mark.parametrize("robots", [1, 2, 6, 12, 13, 100])
def test_entities_stay_few_whatever_the_number_of_robots(
    made_ticks: MakeTicks, made_scenario: MakeScenario, robots: int
) -> None:
    scenario = made_scenario(robots)
    static = stage.statics(scenario, scenario.obstacles)
    drawn = draw(scenario, made_ticks(robots, 25))
    assert len({*static, *drawn}) <= ENTITIES_MAX
    assert set(drawn) <= set(static) | {"events"}  # each has its colours, sizes and names


def test_bodies_are_drawn_where_the_robots_are(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    ticks = made_ticks(6, 10)
    rows = values(draw(made_scenario(6), ticks)["world/bodies"])
    for row, record in zip(rows, ticks, strict=True):
        expected = [(robot.pose.x_m, robot.pose.y_m) for robot in record.robots]
        assert np.allclose(row, expected, atol=1e-5)


def test_headings_reach_the_rim_in_the_direction_of_the_robot(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    record = moved(made_ticks(1, 1)[0], [geometry.Pose(1.0, 2.0, math.pi / 2.0)])
    drawing = draw(made_scenario(1), [record])["world/headings"]
    numbers = {column.component_descriptor().component: column for column in drawing.columns}
    assert len(numbers) == 2
    found = {tuple(np.round(values(drawing, i)[0][0], 6)) for i in range(2)}
    assert found == {(1.0, 2.0), (0.0, 0.22)}


def test_trails_join_from_tick_to_tick_and_from_batch_to_batch(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    scenario, ticks = made_scenario(3), made_ticks(3, 20)
    first = views.batch(scenario, [views.shot(record) for record in ticks[:7]], views.Before())
    rows = values(draw(scenario, ticks[:7])["world/trails"])
    rows += values(draw(scenario, ticks[7:], views.after(first))["world/trails"])
    steps = np.array(rows)  # (ticks, robots, 2, 2)
    assert steps.shape == (20, 3, 2, 2)
    assert np.array_equal(steps[1:, :, 0], steps[:-1, :, 1])
    assert np.array_equal(steps[0, :, 0], steps[0, :, 1])  # nowhere to come from


def test_formation_errors_are_those_of_the_metrics(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    scenario, ticks = made_scenario(6), made_ticks(6, 30)
    drawn = draw(scenario, ticks)
    errors_m = values(drawn["plots/formation_error"])
    largest_m = values(drawn["plots/formation_error_max"])
    score = metrics.begin(scenario)
    for record, error_m, most_m in zip(ticks, errors_m, largest_m, strict=True):
        metrics.observe(score, record)
        expected = [metrics.formation_error_now(score, robot.name) for robot in scenario.robots]
        assert expected[0] is None
        assert math.isnan(error_m[0])
        assert error_m[1:] == pytest.approx(expected[1:], abs=1e-9)
        assert most_m == pytest.approx(max(expected[1:]), abs=1e-9)


def test_formation_errors_end_when_the_leader_is_dead(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    record = made_ticks(3, 5)[4]
    dead = msgspec.structs.replace(record.robots[0], alive=False)
    record = msgspec.structs.replace(record, robots=(dead, *record.robots[1:]))
    drawn = draw(made_scenario(3), [record])
    assert "plots/formation_error" not in drawn


def test_the_dead_and_those_who_touched_are_crossed_out_until_none_is_left(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    scenario = made_scenario(3)
    well, later, back = made_ticks(3, 3)
    dead = msgspec.structs.replace(later.robots[0], alive=False)
    touching = msgspec.structs.replace(later.robots[2], contact=True)
    later = msgspec.structs.replace(later, robots=(dead, later.robots[1], touching))
    nobody, strokes = values(draw(scenario, [well, later])["world/stopped"])
    assert nobody.size == 0
    for at, robot in enumerate((dead, touching)):
        centre = np.array([robot.pose.x_m, robot.pose.y_m])
        expected = centre + 0.22 * np.array([[[-1, -1], [1, 1]], [[-1, 1], [1, -1]]])
        assert strokes[2 * at : 2 * at + 2] == pytest.approx(expected, abs=1e-5)
    before = views.after(views.batch(scenario, [views.shot(later)], views.Before()))
    (cleared,) = values(draw(scenario, [back], before)["world/stopped"])
    assert cleared.size == 0
    before = views.after(views.batch(scenario, [views.shot(back)], before))
    assert "world/stopped" not in draw(scenario, [back], before)


def test_clearance_is_the_smallest_of_all_pairs_and_of_all_robots(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    poses = [
        geometry.Pose(0.0, 0.0, 0.0),
        geometry.Pose(3.0, 4.0, 0.0),
        geometry.Pose(3.0, 5.0, 0.0),
    ]
    record = moved(made_ticks(3, 1)[0], poses)
    (smallest,) = values(draw(made_scenario(3), [record])["plots/clearance"])
    assert smallest == pytest.approx([2.0, 1.0 - 0.44])


def test_clearance_of_a_lonely_robot_in_the_open_is_not_a_number(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    record = made_ticks(1, 1)[0]
    alone = msgspec.structs.replace(record.robots[0], obstacle_clearance_m=math.inf)
    record = msgspec.structs.replace(record, robots=(alone,))
    (smallest,) = values(draw(made_scenario(1), [record])["plots/clearance"])
    assert np.isnan(smallest).all()


def test_forces_keep_their_direction_and_are_compressed(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    record = made_ticks(1, 2)[1]
    forces = messages.Forces((3.6, 4.8), (0.0, 0.0), (0.0, -6.0), (1e9, 0.0), (0.0, 2.0))
    trace = msgspec.structs.replace(record.commands[0].trace, forces=forces)
    command = msgspec.structs.replace(record.commands[0], trace=trace)
    drawn = draw(made_scenario(1), [msgspec.structs.replace(record, commands=(command,))])
    arrows = {
        name: [values(drawn[f"world/forces/{name}"], i)[0][0] for i in range(2)]
        for name in stage.FORCES
    }
    origin = np.array([record.robots[0].pose.x_m, record.robots[0].pose.y_m])
    expected = {
        "attractive": (0.3, 0.4),  # |F| = 6 is half of the longest arrow, 1 m
        "repulsive": (0.0, 0.0),
        "rotating": (0.0, -0.5),
        "robots": (1.0, 0.0),
        "resultant": (0.0, 0.25),
    }
    for name, vector in expected.items():
        assert any(np.allclose(arrow, vector, atol=1e-6) for arrow in arrows[name])
        assert any(np.allclose(arrow, origin, atol=1e-5) for arrow in arrows[name])


def test_details_are_drawn_at_fewer_ticks_when_the_swarm_is_large(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    drawn = draw(made_scenario(100), made_ticks(100, 25)[1:])
    assert drawn["world/bodies"].rows.tolist() == list(range(24))
    for path in (
        "world/forces/resultant",
        "world/scan",
        "plots/formation_error",
        "plots/clearance",
    ):
        assert drawn[path].rows.tolist() == [4, 9, 14, 19]  # ticks 5, 10, 15, 20


def test_states_have_a_row_only_where_they_change(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    scenario, ticks = made_scenario(3), made_ticks(3, 50)
    batch = views.batch(scenario, [views.shot(record) for record in ticks[:30]], views.Before())
    first = draw(scenario, ticks[:30])
    second = draw(scenario, ticks[30:], views.after(batch))
    for row, robot in enumerate(scenario.robots):
        modes = [record.robots[row].beacon.mode for record in ticks]  # type: ignore[union-attr]
        changes = [tick for tick in range(50) if tick == 0 or modes[tick] != modes[tick - 1]]
        path = f"robots/{robot.name}"
        found = first[path].rows.tolist()
        if path in second:
            found += [30 + tick for tick in second[path].rows.tolist()]
        assert found == changes
        words = first[path].columns[0].as_arrow_array().flatten().to_pylist()
        assert words == [modes[tick] for tick in changes if tick < 30]
        assert set(words) <= set(stage.state_colours())


def test_states_tell_of_faults_from_begin_to_end_also_from_batch_to_batch(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    """robot1: loss, then motors too; robot2: hung; robot3: dead, nobody says why."""
    scenario, made = made_scenario(3), made_ticks(3, 8)

    def event(tick: int, kind: messages.EventKind, robot: str, fault: str, number: int) -> Event:
        return Event(tick, 0, kind, robot, fault=fault, number=number)

    events = {
        1: [event(1, "fault", "robot1", "loss", 0), event(1, "fault", "robot2", "hang", 1)],
        2: [event(2, "fault", "robot1", "weak", 2)],
        4: [event(4, "fault-over", "robot1", "weak", 2)],
        5: [event(5, "fault-over", "robot1", "loss", 0), event(5, "fault-over", "robot2", "", 1)],
    }
    ticks = []
    for record in made:
        robots = list(record.robots)
        for row, beacon in enumerate(robot.beacon for robot in robots):
            said = msgspec.structs.replace(beacon, mode="FORM")  # type: ignore[type-var]
            alive = not (row == 1 and 1 <= record.tick < 5) and not (row == 2 and record.tick > 2)
            robots[row] = msgspec.structs.replace(robots[row], alive=alive, beacon=said)
        happened = tuple(events.get(record.tick, ()))
        ticks.append(msgspec.structs.replace(record, robots=tuple(robots), events=happened))
    found: dict[str, list[tuple[int, str]]] = {}
    before = views.Before()
    for part in (ticks[:3], ticks[3:4], ticks[4:]):
        for path, drawing in draw(scenario, part, before).items():
            if path.startswith("robots/"):
                words = drawing.columns[0].as_arrow_array().flatten().to_pylist()
                at = [part[row].tick for row in drawing.rows]
                found.setdefault(path, []).extend(zip(at, words, strict=True))
        before = views.after(views.batch(scenario, [views.shot(one) for one in part], before))
    assert found == {
        "robots/robot1": [
            (0, "FORM"),
            (1, "FORM, link fault"),
            (2, "FORM, motor fault"),
            (4, "FORM, link fault"),
            (5, "FORM"),
        ],
        "robots/robot2": [(0, "FORM"), (1, "hung"), (5, "FORM")],
        "robots/robot3": [(0, "FORM"), (3, "dead")],
    }


@pytest.mark.parametrize("kind", faults.KINDS)
def test_every_fault_is_seen_on_the_time_line_in_a_colour(
    made_ticks: MakeTicks, made_scenario: MakeScenario, kind: str
) -> None:
    (record,) = made_ticks(1, 1)
    lost = issubclass(faults.KINDS[kind], ProcessFault)
    robot = msgspec.structs.replace(record.robots[0], alive=not lost)
    event = Event(0, 0, "fault", "robot1", fault=kind, number=0)
    record = msgspec.structs.replace(record, robots=(robot,), events=(event,))
    troubles = states.follow(states.Troubles(), record)
    (word,) = states.words(made_scenario(1), troubles, record)
    seen = kind != "disk-full"  # it strikes no robot
    assert (word not in (*states.MODES, "dead")) == seen
    assert word in stage.state_colours()


def test_every_word_of_a_time_line_has_a_colour() -> None:
    assert set(states.MODES) <= set(stage.STATE_COLOURS)
    assert {*states.LOST_BY_FAULT.values(), *states.LOST_BY_ITSELF.values()} <= set(
        stage.STATE_COLOURS
    )
    assert set(states.TROUBLES) == set(stage.TROUBLE_COLOURS)


def test_events_are_told_at_their_level(made_ticks: MakeTicks, made_scenario: MakeScenario) -> None:
    drawing = draw(made_scenario(3), made_ticks(3, 20))["events"]
    assert drawing.rows.tolist() == [10]
    texts = {tuple(column.as_arrow_array().flatten().to_pylist()) for column in drawing.columns}
    assert texts == {("fault robot1: kill",), ("WARN",)}


def test_batches_do_not_change_what_is_drawn(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    scenario, ticks = made_scenario(6), made_ticks(6, 12)
    at_once = draw(scenario, ticks)
    before = views.Before()
    one_by_one: dict[str, list[np.ndarray]] = {}
    for record in ticks:
        for path, drawing in draw(scenario, [record], before).items():
            one_by_one.setdefault(path, []).extend(
                row for row in drawing.columns[0].as_arrow_array().to_pylist()
            )
        before = views.after(views.batch(scenario, [views.shot(record)], before))
    assert set(one_by_one) == set(at_once)
    for path, drawing in at_once.items():
        assert repr(one_by_one[path]) == repr(drawing.columns[0].as_arrow_array().to_pylist())


def test_colours_of_robots_differ_and_are_light(made_scenario: MakeScenario) -> None:
    colours = stage.colours(made_scenario(12))
    assert len(set(colours.tolist())) == 12
    assert colours[0] == 0xFFE08AFF
    for colour in colours.tolist():
        assert max(colour >> shift & 0xFF for shift in (24, 16, 8)) >= 0xE0
        assert colour & 0xFF == 0xFF


def test_dimmed_colour_keeps_its_hue() -> None:
    found = stage.dimmed(np.array([0xFF804020], np.uint32), 0.5)
    assert [hex(colour) for colour in found] == ["0x804020ff"]


def test_bounds_hold_everything_known_beforehand(made_scenario: MakeScenario) -> None:
    scenario = made_scenario(3)
    found = stage.bounds(scenario, scenario.obstacles, margin_m=0.5)
    assert found == (-2.5, -3.5, 18.5, 4.5)


def test_scene_without_obstacles_and_goals_can_be_drawn(made_scenario: MakeScenario) -> None:
    scenario = msgspec.structs.replace(made_scenario(2), obstacles=(), formation=None)
    statics = stage.statics(scenario, ())
    assert statics["world/obstacles"] == ()
    assert isinstance(statics["world"][0], rr.Transform3D)
