"""What is drawn, from the numbers of the ticks; the metrics are the second opinion on errors."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence

import msgspec
import numpy as np
import pytest
import rerun as rr

from dashboards import batches, plots, stage, states, views
from swarm import faults, geometry, messages, metrics
from swarm.faults import ProcessFault
from swarm.messages import Event, Passage, TickRecord
from swarm.scenario import Obstacle, Scenario

MakeTicks = Callable[..., tuple[TickRecord, ...]]
MakeScenario = Callable[[int], Scenario]

ENTITIES_MAX = 40
START = batches.Before()


def draw(
    scenario: Scenario, ticks: Sequence[TickRecord], before: batches.Before | None = None
) -> dict[str, batches.Drawing]:
    shots = [batches.shot(record) for record in ticks]
    batch = batches.batch(scenario, shots, before or START)
    return {drawing.path: drawing for drawing in views.draw(batch)}


def values(drawing: batches.Drawing, column: int = 0) -> list[np.ndarray]:
    """Numbers of one component, an array per row."""
    arrow = drawing.columns[column].as_arrow_array()
    return [np.array(row.as_py(), dtype=np.float64) for row in arrow]


def component(drawing: batches.Drawing, name: str) -> list[np.ndarray]:
    """Instances of a component, an array per row."""
    (column,) = (one for one in drawing.columns if one.component_descriptor().component == name)
    return [np.array(row.as_py()) for row in column.as_arrow_array()]


def event_lines(drawn: dict[str, batches.Drawing]) -> list[tuple[str, str]]:
    texts, levels = (
        [row[0] for row in component(drawn["events"], f"TextLog:{name}")]
        for name in ("text", "level")
    )
    return [(str(text), str(level)) for text, level in zip(texts, levels, strict=True)]


def stage_words(scenario: Scenario, path: str) -> set[str]:
    """Words of a time line that have a colour."""
    (known,) = stage.statics(scenario, ())[path]
    (values, *_) = known.as_component_batches()
    return set(values.as_arrow_array().to_pylist())


def said(record: TickRecord, row: int, **changes: object) -> TickRecord:
    """The tick with another beacon of one robot."""
    robots = list(record.robots)
    beacon = msgspec.structs.replace(robots[row].beacon, **changes)  # type: ignore[type-var]
    robots[row] = msgspec.structs.replace(robots[row], beacon=beacon)
    return msgspec.structs.replace(record, robots=tuple(robots))


def traced(record: TickRecord, name: str, **changes: object) -> TickRecord:
    """The tick with another trace of one robot."""
    commands = tuple(
        msgspec.structs.replace(one, trace=msgspec.structs.replace(one.trace, **changes))
        if one.robot == name
        else one
        for one in record.commands
    )
    return msgspec.structs.replace(record, commands=commands)


def moved(record: TickRecord, poses: Sequence[geometry.Pose]) -> TickRecord:
    robots = tuple(
        msgspec.structs.replace(robot, pose=pose)
        for robot, pose in zip(record.robots, poses, strict=True)
    )
    return msgspec.structs.replace(record, robots=robots)


@pytest.mark.parametrize("robots", [1, 2, 6, 10, 11, 100])
def test_entities_stay_few_whatever_the_number_of_robots(
    made_ticks: MakeTicks, made_scenario: MakeScenario, robots: int
) -> None:
    scenario = made_scenario(robots)
    static = stage.statics(scenario, scenario.obstacles)
    drawn = draw(scenario, made_ticks(robots, 25))
    assert len({*static, *drawn}) <= ENTITIES_MAX
    assert set(drawn) <= set(static) | {
        "events",
        "swarm/leader",
    }  # each has its colours, sizes and names


def test_bodies_are_drawn_where_the_robots_are(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    ticks = made_ticks(6, 10)
    rows = values(draw(made_scenario(6), ticks)["world/bodies"])
    for row, record in zip(rows, ticks, strict=True):
        expected = [(robot.pose.x_m, robot.pose.y_m) for robot in record.robots]
        assert np.allclose(row, expected, atol=1e-5)


def test_noses_reach_the_rim_in_the_direction_of_the_robot(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    record = moved(made_ticks(1, 1)[0], [geometry.Pose(1.0, 2.0, math.pi / 2.0)])
    drawing = draw(made_scenario(1), [record])["world/bodies"]
    assert component(drawing, "Arrows2D:origins")[0] == pytest.approx(np.array([[1.0, 2.0]]))
    assert component(drawing, "Arrows2D:vectors")[0] == pytest.approx(
        np.array([[0.0, 0.22]]), abs=1e-6
    )


def test_trails_join_from_tick_to_tick_and_from_batch_to_batch(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    """Each piece of a trail, the older the longer its steps; cut anywhere they are the same."""
    scenario, ticks = made_scenario(3), made_ticks(3, 50)
    first = batches.batch(scenario, [batches.shot(record) for record in ticks[:7]], START)
    for trail in stage.TRAILS:
        rows = values(draw(scenario, ticks[:7])[trail.path])
        rows += values(draw(scenario, ticks[7:], batches.after(first))[trail.path])
        steps = np.array(rows)  # (corners, robots, 2, 2)
        corners = [ticks[tick] for tick in range(0, 50, trail.stride_ticks)]
        at = [[(robot.pose.x_m, robot.pose.y_m) for robot in one.robots] for one in corners]
        assert steps[:, :, 1] == pytest.approx(np.array(at), abs=1e-5)
        assert np.array_equal(steps[1:, :, 0], steps[:-1, :, 1])
        assert np.array_equal(steps[0, :, 0], steps[0, :, 1])  # nowhere to come from


def test_old_pieces_of_a_trail_reach_further_and_are_darker() -> None:
    for older, newer in itertools.pairwise(stage.TRAILS):
        assert older.last_s > newer.last_s
        assert older.brightness < newer.brightness
        assert older.stride_ticks * 0.08 < newer.last_s  # no gap between the two


def test_formation_errors_are_those_of_the_metrics(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    scenario, ticks = made_scenario(6), made_ticks(6, 30)
    rows = values(draw(scenario, ticks)["plots/formation_error"])
    score = metrics.begin(scenario)
    for record, (*error_m, most_m) in zip(ticks, rows, strict=True):
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
    (row,) = values(draw(made_scenario(3), [record])["plots/formation_error"])
    assert np.isnan(row).all()


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
    before = batches.after(batches.batch(scenario, [batches.shot(later)], START))
    (cleared,) = values(draw(scenario, [back], before)["world/stopped"])
    assert cleared.size == 0
    before = batches.after(batches.batch(scenario, [batches.shot(back)], before))
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
    drawn = draw(made_scenario(1), [traced(record, "robot1", forces=forces)])
    terms, resultant = (drawn[f"world/forces/{name}"] for name in ("terms", "resultant"))
    # |F| = 6 is half of the longest arrow, 1 m; what is zero is not there
    assert component(terms, "Arrows2D:vectors")[0] == pytest.approx(
        np.array([(0.3, 0.4), (0.0, -0.5), (1.0, 0.0)]), abs=1e-6
    )
    green, _, yellow, violet, white = stage.FORCE_COLOURS
    assert component(terms, "Arrows2D:colors")[0].tolist() == [green, yellow, violet]
    assert component(resultant, "Arrows2D:vectors")[0] == pytest.approx(np.array([(0.0, 0.25)]))
    assert component(resultant, "Arrows2D:colors")[0].tolist() == [white]
    origin = (record.robots[0].pose.x_m, record.robots[0].pose.y_m)
    assert component(terms, "Arrows2D:origins")[0] == pytest.approx(
        np.array([origin] * 3), abs=1e-5
    )


def test_angle_of_the_force_is_that_of_the_resultant_and_a_gap_without_one(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    record = traced(made_ticks(3, 2)[1], "robot1", forces=messages.Forces(resultant=(0.0, -2.0)))
    record = traced(record, "robot2", forces=messages.Forces())
    record = msgspec.structs.replace(record, commands=record.commands[:2])  # robot3: no command
    (angles_rad,) = values(draw(made_scenario(3), [record])["plots/force_angle"])
    assert angles_rad[0] == pytest.approx(-math.pi / 2.0)
    assert np.isnan(angles_rad[1:]).all()


def test_gains_are_the_mean_of_those_who_have_any(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    record = traced(made_ticks(3, 2)[1], "robot2", gains=(1.0, 2.0, 3.0, 4.0, 5.0, 6.0))
    record = traced(record, "robot3", gains=(3.0, 0.0, 3.0, 4.0, 5.0, 8.0))
    drawn = draw(made_scenario(3), [made_ticks(3, 1)[0], record])["plots/gains"]
    assert drawn.rows.tolist() == [1]
    assert values(drawn)[0] == pytest.approx([2.0, 1.0, 3.0, 4.0, 5.0, 7.0])


def test_tracking_errors_are_those_that_followers_report(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    record = traced(made_ticks(2, 2)[1], "robot2", error=(0.25, -0.125))
    drawn = draw(made_scenario(2), [record])
    for name, expected in (("tracking_distance", 0.25), ("tracking_bearing", -0.125)):
        (row,) = values(drawn[f"plots/{name}"])
        assert math.isnan(row[0])
        assert row[1] == expected


def test_cost_of_a_tick_is_drawn_in_ms(made_ticks: MakeTicks, made_scenario: MakeScenario) -> None:
    shots = [batches.shot(record, 0.08, 0.002) for record in made_ticks(1, 2)]
    (drawing,) = plots.tick_cost(batches.batch(made_scenario(1), shots, START))
    assert values(drawing)[1] == pytest.approx([80.0, 2.0])


def test_a_ring_is_around_everyone_who_says_that_it_leads(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    """robot1 leads; then robot3 with a higher term too, out of robot1's hearing; then nobody."""
    one, both, none = made_ticks(3, 3)
    own = messages.Leadership(4, (1, 0, 0, 2), "robot3")
    both = said(both, 2, leadership=own)
    none = msgspec.structs.replace(
        none, robots=tuple(msgspec.structs.replace(robot, alive=False) for robot in none.robots)
    )
    drawn = draw(made_scenario(3), [one, both, none])
    first, second, third = values(drawn["world/leaders"])
    assert (len(first), len(second), third.size) == (1, 2, 0)
    pose = both.robots[2].pose
    from_centre_m = np.linalg.norm(second[0] - [pose.x_m, pose.y_m], axis=1)  # the higher first
    assert from_centre_m == pytest.approx(1.45 * 0.22, abs=1e-5)
    words = drawn["swarm/leader"].columns[0].as_arrow_array().flatten().to_pylist()
    assert words == ["robot1 (term 1)", "robot3 (term 4) and robot1 (term 1)", "nobody"]
    assert set(words) - stage_words(made_scenario(3), "swarm/leader") == {words[1]}


def test_an_arrow_leads_from_who_waits_to_whom_it_waits_for_and_goes_again(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    scenario, (calm, waiting, after) = made_scenario(3), made_ticks(3, 3)
    waiting = said(waiting, 2, yields_to="robot1")
    assert "world/yields" not in draw(scenario, [calm])
    drawn = draw(scenario, [waiting, after])
    drawing = drawn["world/yields"]
    here, there = (waiting.robots[row].pose for row in (2, 0))
    assert component(drawing, "Arrows2D:origins")[0] == pytest.approx(
        np.array([(here.x_m, here.y_m)]), abs=1e-5
    )
    assert component(drawing, "Arrows2D:vectors")[0] == pytest.approx(
        np.array([(there.x_m - here.x_m, there.y_m - here.y_m)]), abs=1e-5
    )
    assert component(drawing, "Arrows2D:vectors")[1].size == 0
    assert event_lines(drawn)[-2:] == [
        ("robot3 yields to robot1", "DEBUG"),
        ("robot3 goes on", "DEBUG"),
    ]
    words = drawn["robots/robot3"].columns[0].as_arrow_array().flatten().to_pylist()
    assert words[0].endswith(", yields")
    assert not words[1].endswith(", yields")


def test_claims_to_gaps_are_told_when_they_change(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    ticks = list(made_ticks(3, 4))
    wants = Passage(False, (1.0, 2.0), (1.0, 0.0), 1)
    ticks[1] = said(ticks[1], 1, passage=wants)
    ticks[2] = said(ticks[2], 1, passage=msgspec.structs.replace(wants, holds=True))
    lines = event_lines(draw(made_scenario(3), ticks))
    assert [text for text, _ in lines if "gap" in text] == [
        "robot2 claims a gap",
        "robot2 holds a gap",
        "robot2 is through its gap",
    ]


def test_links_tell_who_hears_whom_one_way_in_another_colour(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    """robot1 and robot2 hear each other; robot3 hears robot1 and is not heard."""
    record = made_ticks(3, 2)[1]
    heard = ([1], [0], [0])
    frames = tuple(
        msgspec.structs.replace(
            frame, heard=messages.array(np.array([(row, 0) for row in rows], np.int32))
        )
        for frame, rows in zip(record.frames, heard, strict=True)
    )
    drawing = draw(made_scenario(3), [msgspec.structs.replace(record, frames=frames)])[
        "world/links"
    ]
    at = [(robot.pose.x_m, robot.pose.y_m) for robot in record.robots]
    assert component(drawing, "LineStrips2D:strips")[0] == pytest.approx(
        np.array([(at[1], at[0]), (at[0], at[2])]), abs=1e-5
    )
    assert component(drawing, "LineStrips2D:colors")[0].tolist() == [
        stage.LINK,
        stage.LINK_ONE_WAY,
    ]


def test_links_of_a_large_swarm_are_those_of_the_focus(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    drawing = draw(made_scenario(30), made_ticks(30, 3)[2:])["world/links"]
    assert len(component(drawing, "LineStrips2D:strips")[0]) == 20


def test_slots_and_errors_join_robots_and_places(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    record = made_ticks(3, 5)[4]
    drawn = draw(made_scenario(3), [record])
    lines = component(drawn["world/slots"], "LineStrips2D:strips")[0]
    (errors_m,) = values(drawn["plots/formation_error"])
    lengths_m = np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1)
    assert lengths_m == pytest.approx(errors_m[:3], abs=1e-5, nan_ok=True)


def test_details_are_drawn_at_fewer_ticks_when_the_swarm_is_large(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    drawn = draw(made_scenario(100), made_ticks(100, 25)[1:])
    assert drawn["world/bodies"].rows.tolist() == list(range(24))
    for path in (
        "world/forces/resultant",
        "world/scan",
        "world/msam/cells",
        "plots/formation_error",
        "plots/clearance",
    ):
        assert drawn[path].rows.tolist() == [4, 9, 14, 19]  # ticks 5, 10, 15, 20


def test_states_have_a_row_only_where_they_change(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    scenario, ticks = made_scenario(3), made_ticks(3, 50)
    batch = batches.batch(scenario, [batches.shot(record) for record in ticks[:30]], START)
    first = draw(scenario, ticks[:30])
    second = draw(scenario, ticks[30:], batches.after(batch))
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
    before = batches.Before()
    for part in (ticks[:3], ticks[3:4], ticks[4:]):
        for path, drawing in draw(scenario, part, before).items():
            if path.startswith("robots/"):
                words = drawing.columns[0].as_arrow_array().flatten().to_pylist()
                at = [part[row].tick for row in drawing.rows]
                found.setdefault(path, []).extend(zip(at, words, strict=True))
        before = batches.after(batches.batch(scenario, [batches.shot(one) for one in part], before))
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
    assert {*states.TROUBLES, states.YIELDS} == set(stage.MORE_COLOURS)


def test_events_are_told_at_their_level_and_marked_in_the_plots(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    ticks = list(made_ticks(3, 20))
    over = Event(15, 0, "fault-over", "robot1", fault="kill", number=0)
    ticks[15] = msgspec.structs.replace(ticks[15], events=(over,))
    drawn = draw(made_scenario(3), ticks)
    assert drawn["events"].rows.tolist() == [0, 10, 15]
    assert event_lines(drawn) == [
        ("leader: robot1 (term 1)", "INFO"),
        ("fault robot1: kill", "WARN"),
        ("fault-over robot1: kill", "INFO"),
    ]
    marks = drawn["plots/faults"]
    assert marks.rows.tolist() == [10, 15]
    assert np.array(values(marks)) == pytest.approx(
        np.array([(0.0, math.nan), (math.nan, 0.0)]), nan_ok=True
    )


def test_modes_of_a_large_swarm_are_counted(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    record = said(made_ticks(12, 1)[0], 5, yields_to="robot1")
    dead = msgspec.structs.replace(record.robots[0], alive=False)
    record = msgspec.structs.replace(record, robots=(dead, *record.robots[1:]))
    (row,) = values(draw(made_scenario(12), [record])["plots/modes"])
    avoid = sum(robot.alive and robot.beacon.mode == "AVOID" for robot in record.robots)  # type: ignore[union-attr]
    expected = {"AVOID": avoid, "FORM": 11 - avoid}
    assert row.tolist() == [*(expected.get(mode, 0) for mode in states.MODES), 1, 1]


@pytest.mark.parametrize("robots", [1, 6, 100])
def test_nothing_is_drawn_without_a_row(
    made_ticks: MakeTicks, made_scenario: MakeScenario, robots: int
) -> None:
    """Viewers panic over a column without one."""
    before = START
    for record in made_ticks(robots, 12):
        record = said(record, 0, yields_to="robot1") if record.tick == 5 else record
        shots = [batches.shot(record)]
        batch = batches.batch(made_scenario(robots), shots, before)
        drawn = [*views.draw(batch)]
        assert [drawing.path for drawing in drawn if not len(drawing.rows)] == []
        before = batches.after(batch)


def test_batches_do_not_change_what_is_drawn(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    scenario, ticks = made_scenario(6), made_ticks(6, 12)
    at_once = draw(scenario, ticks)
    before = START
    one_by_one: dict[str, list[list[object]]] = {}
    for record in ticks:
        for path, drawing in draw(scenario, [record], before).items():
            rows = [column.as_arrow_array().to_pylist() for column in drawing.columns]
            columns = one_by_one.setdefault(path, [[] for _ in rows])
            for column, more in zip(columns, rows, strict=True):
                column += more
        before = batches.after(batches.batch(scenario, [batches.shot(record)], before))
    assert set(one_by_one) == set(at_once)
    for path, drawing in at_once.items():
        expected = [column.as_arrow_array().to_pylist() for column in drawing.columns]
        assert repr(one_by_one[path]) == repr(expected)


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
    assert statics["world/obstacles"] == []
    assert isinstance(statics["world"][0], rr.Transform3D)


def test_what_moves_is_one_entity_and_drawn_where_it_is_at_every_tick(
    made_ticks: MakeTicks, made_scenario: MakeScenario
) -> None:
    still = made_scenario(3)
    assert "world/movers" not in draw(still, made_ticks(3, 4))
    assert "world/movers" not in stage.statics(still, still.obstacles)
    some = tuple(
        Obstacle(circle=(x_m, 4.0, 0.25), path=((x_m, 9.0),), speed_mps=0.5) for x_m in (1.0, 2.0)
    )
    scenario = msgspec.structs.replace(still, obstacles=(*still.obstacles, *some))
    drawn = draw(scenario, made_ticks(3, 4))["world/movers"]
    for tick, points in enumerate(component(drawn, "Points2D:positions")):
        y_m = 4.0 + 0.5 * 0.08 * tick
        assert points.tolist() == [pytest.approx([1.0, y_m]), pytest.approx([2.0, y_m])]
    static = stage.statics(scenario, scenario.obstacles)
    assert "world/movers" in static
    assert stage.bounds(scenario, scenario.obstacles)[3] >= 9.25
