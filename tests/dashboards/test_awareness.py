"""The map of the leading robot, by hand: robot1 at (1, 2) looks along y, in 72 sectors of 5 deg."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import msgspec
import numpy as np
import pytest

from dashboards import awareness, batches, stage
from swarm import geometry, messages
from swarm.messages import TickRecord
from swarm.scenario import Scenario

MakeTicks = Callable[..., tuple[TickRecord, ...]]
MakeScenario = Callable[[int], Scenario]

POSE = geometry.Pose(1.0, 2.0, math.pi / 2.0)
SECTORS, BEAMS = 72, 216
RANGE_M = 5.0
FAR = geometry.Pose(40.0, 40.0, 0.0)


def alone(
    tick: TickRecord,
    *,
    ranges: dict[int, float] | None = None,
    sectors: dict[int, float] | None = None,
    count: int = SECTORS,
    other: geometry.Pose = FAR,
    **trace: object,
) -> TickRecord:
    """The tick with robot1 at POSE, who sees and has mapped just this, and hears robot2."""
    replace = msgspec.structs.replace
    robots = (replace(tick.robots[0], pose=POSE), replace(tick.robots[1], pose=other))
    frame = replace(
        tick.frames[0],
        pose=POSE,
        ranges=messages.array(table(BEAMS, ranges)),
        heard=messages.array(np.array([(1, 0)], np.int32)),
    )
    own = replace(
        tick.commands[0].trace,
        **{"arcs": (), "waypoint": None, **trace},
        sectors=messages.array(table(count, sectors)),
    )
    commands = (replace(tick.commands[0], trace=own), tick.commands[1])
    return replace(tick, robots=robots, frames=(frame, tick.frames[1]), commands=commands)


def table(count: int, values: dict[int, float] | None) -> np.ndarray:
    result = np.full(count, np.inf, np.float32)
    for index, value in (values or {}).items():
        result[index] = value
    return result


@pytest.fixture
def ticks(made_ticks: MakeTicks) -> Sequence[TickRecord]:
    return made_ticks(2, 4)


def draw(scenario: Scenario, record: TickRecord) -> dict[str, dict[str, np.ndarray]]:
    """Components by entity; the tick is one of those at which the map is drawn."""
    record = msgspec.structs.replace(record, tick=3)
    batch = batches.batch(scenario, [batches.shot(record)], batches.Before())
    return {
        drawing.path: {
            column.component_descriptor().component.split(":")[1]: np.array(
                column.as_arrow_array()[0].as_py()
            )
            for column in drawing.columns
        }
        for drawing in awareness.draw(batch)
    }


def at(angle_deg: float, distance_m: float) -> tuple[float, float]:
    """Point in a direction of robot1's."""
    x, y = geometry.unit(POSE.yaw_rad + math.radians(angle_deg))
    return POSE.x_m + distance_m * x, POSE.y_m + distance_m * y


def of(cells: dict[str, np.ndarray], colour: int) -> np.ndarray:
    """(lines, 3, 2) of one kind of cell."""
    found: np.ndarray = cells["strips"][cells["colors"] == colour]
    return found


def test_scan_is_where_the_beams_of_the_leader_ended(
    made_scenario: MakeScenario, ticks: Sequence[TickRecord]
) -> None:
    drawn = draw(made_scenario(2), alone(ticks[3], ranges={108: 2.0, 0: 3.0}))
    centre_deg = 360.0 / BEAMS / 2.0
    expected = [at(-180.0 + centre_deg, 3.0), at(centre_deg, 2.0)]
    assert drawn["world/scan"]["positions"] == pytest.approx(np.array(expected), abs=1e-5)


def test_ways_are_free_up_to_what_is_there(
    made_scenario: MakeScenario, ticks: Sequence[TickRecord]
) -> None:
    cells = draw(made_scenario(2), alone(ticks[3], sectors={40: 1.5}))["world/msam/cells"]
    rays = of(cells, stage.CELL_FREE)
    assert rays.shape == (SECTORS, awareness.ARC_POINTS, 2)
    assert rays[40, -1] == pytest.approx(at(22.5, 1.5), abs=1e-5)
    assert rays[36, 0] == pytest.approx(at(2.5, 0.22), abs=1e-5)  # from the rim of the body
    assert rays[36, -1] == pytest.approx(at(2.5, RANGE_M), abs=1e-5)


def test_a_cell_is_an_arc_behind_the_edge_that_is_mapped(
    made_scenario: MakeScenario, ticks: Sequence[TickRecord]
) -> None:
    cells = draw(made_scenario(2), alone(ticks[3], sectors={40: 1.5}))["world/msam/cells"]
    (arc,) = of(cells, stage.CELL_OBSTACLE)
    middle_m = 1.5 + awareness.CELL_M / 2.0
    expected = [at(angle_deg, middle_m) for angle_deg in (20.0, 22.5, 25.0)]
    assert arc == pytest.approx(np.array(expected), abs=1e-5)
    thick = cells["radii"][cells["colors"] == stage.CELL_OBSTACLE]
    assert 2.0 * thick == pytest.approx([awareness.CELL_M])


def test_a_robot_that_is_heard_covers_the_sectors_of_its_body(
    made_scenario: MakeScenario, ticks: Sequence[TickRecord]
) -> None:
    """2 m ahead: asin(0.22 / 2) = 6.3 deg to either side, so the sectors at +-2.5 and +-7.5."""
    record = alone(ticks[3], other=geometry.Pose(1.0, 4.0, 0.0))
    arcs = of(draw(made_scenario(2), record)["world/msam/cells"], stage.CELL_ROBOT)
    middle_m = 1.78 + awareness.CELL_M / 2.0
    expected = [at(angle_deg, middle_m) for angle_deg in (-7.5, -2.5, 2.5, 7.5)]
    assert arcs[:, 1] == pytest.approx(np.array(expected), abs=1e-5)


@pytest.mark.parametrize(("away_m", "drawn_m"), [(3.0, 3.0), (30.0, RANGE_M)])
def test_the_target_is_the_cell_it_steers_for_as_far_as_it_sees(
    made_scenario: MakeScenario, ticks: Sequence[TickRecord], away_m: float, drawn_m: float
) -> None:
    record = alone(ticks[3], waypoint=at(11.0, away_m))
    (arc,) = of(draw(made_scenario(2), record)["world/msam/cells"], stage.CELL_TARGET)
    assert arc[1] == pytest.approx(at(12.5, drawn_m), abs=1e-5)


def test_circles_are_those_of_the_arcs_and_the_range_of_the_lidar(
    made_scenario: MakeScenario, ticks: Sequence[TickRecord]
) -> None:
    """Eq. 19 to 21: radius r_o, centre at 2 r_o cos(width / 2)."""
    arc = messages.Arc(math.radians(30.0), 1.2, 0.8, 1.0)
    rings = draw(made_scenario(2), alone(ticks[3], arcs=(arc,)))["world/msam/circles"]
    sight, circle = rings["strips"]
    assert np.linalg.norm(sight - (1.0, 2.0), axis=1) == pytest.approx(RANGE_M, abs=1e-4)
    centre = at(30.0, 2.4 * math.cos(0.4))
    assert np.linalg.norm(circle - centre, axis=1) == pytest.approx(1.2, abs=1e-4)
    assert rings["colors"].tolist() == [stage.SENSOR_RANGE, stage.CIRCLE]


def test_a_map_of_another_size_is_not_drawn(
    made_scenario: MakeScenario, ticks: Sequence[TickRecord]
) -> None:
    """A robot may say anything; what was drawn before goes."""
    drawn = draw(made_scenario(2), alone(ticks[3], count=10))
    assert set(drawn) == {"world/scan", "world/msam/cells", "world/msam/circles"}
    assert [len(one) for columns in drawn.values() for one in columns.values()] == [0] * 6


def test_another_is_in_focus_when_the_leader_is_dead(
    made_scenario: MakeScenario, ticks: Sequence[TickRecord]
) -> None:
    record = alone(ticks[3])
    dead = msgspec.structs.replace(record.robots[0], alive=False)
    record = msgspec.structs.replace(
        record, robots=(dead, record.robots[1]), frames=record.frames[1:]
    )
    rings = draw(made_scenario(2), record)["world/msam/circles"]["strips"]
    pose = record.frames[0].pose
    assert np.linalg.norm(rings[0] - (pose.x_m, pose.y_m), axis=1) == pytest.approx(
        RANGE_M, abs=1e-4
    )


def test_who_is_selected_is_looked_at_while_it_lives(
    made_scenario: MakeScenario, ticks: Sequence[TickRecord]
) -> None:
    scenario, shots = made_scenario(2), [batches.shot(ticks[3])]

    def focus(selected: str) -> int:
        return batches.batch(scenario, shots, batches.Before(), selected).companies[0].focus

    assert [focus(name) for name in ("", "robot1", "robot2", "nobody")] == [0, 0, 1, 0]
    fallen = msgspec.structs.replace(ticks[3].robots[1], alive=False)
    shots = [batches.shot(msgspec.structs.replace(ticks[3], robots=(ticks[3].robots[0], fallen)))]
    assert focus("robot2") == 0
