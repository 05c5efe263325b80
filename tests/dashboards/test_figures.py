"""Pictures: their size, what is in them, colours that stay with their robots."""

from __future__ import annotations

import struct
from collections.abc import Callable

import msgspec
import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from dashboards import drawing, figures, stage, tracks
from dashboards.tracks import Tracks
from swarm.messages import TickRecord
from swarm.scenario import Obstacle, Scenario

MadeTicks = Callable[..., tuple[TickRecord, ...]]
MadeScenario = Callable[[int], Scenario]


@pytest.fixture(scope="module")
def path(made_ticks: MadeTicks, made_scenario: MadeScenario) -> Tracks:
    plan = made_scenario(4)
    return tracks.collect(plan, plan.obstacles, made_ticks(4, 120))


FIGURES: dict[str, Callable[[Tracks], Figure]] = {
    "trajectories": figures.trajectories,
    "tracking": figures.tracking,
    "encounters": lambda path: figures.encounters({"one": path, "two": path, "three": path}),
    "fields": lambda path: figures.fields([{"paper": path, "navigator": path}] * 5),
    "force_angles": lambda path: figures.force_angles({"paper": path, "navigator": path}),
}


@pytest.fixture(scope="module")
def drawn(path: Tracks) -> dict[str, Figure]:
    return {name: draw(path) for name, draw in FIGURES.items()}


@pytest.mark.parametrize("name", FIGURES)
def test_png_has_the_size_of_its_figure_and_something_in_it(
    drawn: dict[str, Figure], name: str
) -> None:
    figure = drawn[name]
    data = figures.png(figure)
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    width, height = struct.unpack(">II", data[16:24])
    assert width == 1400
    assert height == pytest.approx(100.0 * figure.get_figheight(), abs=1.0)
    shown = [axes for axes in figure.axes if axes.get_visible()]
    assert all(axes.has_data() for axes in shown)
    labels = {axes.get_xlabel() for axes in shown} - {""}
    assert labels
    assert all(label.endswith("]") for label in labels)  # with its unit


@pytest.mark.parametrize("name", ["trajectories", "encounters", "fields"])
def test_ways_are_drawn_to_equal_scales(drawn: dict[str, Figure], name: str) -> None:
    ways = [axes for axes in drawn[name].axes if axes.get_aspect() != "auto"]
    assert len(ways) == {"trajectories": 1, "encounters": 3, "fields": 5}[name]
    assert all(axes.get_aspect() == 1.0 for axes in ways)


def test_bodies_have_their_size_colour_and_equal_times(
    path: Tracks, drawn: dict[str, Figure]
) -> None:
    axes = drawn["trajectories"].axes[0]
    bodies = [patch for patch in axes.patches if isinstance(patch, Circle) and patch.radius < 1.0]
    own = [f"#{rgba:08x}"[:7] for rgba in stage.colours(path.scenario)]
    by_robot = [[body for body in bodies if to_hex(body.get_facecolor()) == one] for one in own]
    assert [len(some) for some in by_robot] == [11, 11, 11, 11]  # 0 to 9 s, and 9.52 s
    assert {body.radius for body in bodies} == {0.22}
    for row, some in enumerate(by_robot):
        assert tuple(some[3].center) == tuple(path.poses[37, row, :2])  # 2.96 s, nearest to 3 s


def test_robot_has_the_same_colours_in_every_picture(
    path: Tracks, drawn: dict[str, Figure]
) -> None:
    lines = drawing.colours(path, drawing.LINE_SHARE)
    assert len(set(lines)) == 4
    ways = drawn["trajectories"].axes[0].lines
    errors = drawn["tracking"].axes[2].lines
    for row in (1, 2, 3):
        way = next(
            line for line in ways if len(line.get_xdata()) == 120 and line.get_color() == lines[row]
        )
        assert np.array_equal(np.asarray(way.get_xdata()), path.poses[:, row, 0])
        assert errors[row - 1].get_color() == lines[row]


def test_title_names_the_motors_where_wheels_are_not_ideal(path: Tracks) -> None:
    plain = path.scenario.title
    assert drawing.title(path) == plain
    robots = [
        msgspec.structs.replace(robot, motion="dynamic", wheel_torque_nm_max=1.5)
        for robot in path.scenario.robots
    ]
    plan = msgspec.structs.replace(path.scenario, robots=tuple(robots))
    driven = msgspec.structs.replace(path, scenario=plan)
    assert drawing.title(driven) == f"{plain}, motors of 1.5 N m"
    assert drawing.title(driven) in figures.tracking(driven).axes[0].get_title()


def test_controllers_can_be_told_apart(path: Tracks, drawn: dict[str, Figure]) -> None:
    ways = [line for line in drawn["fields"].axes[0].lines if len(line.get_xdata()) == 120]
    assert {(line.get_linestyle(), line.get_color()) for line in ways[:1] + ways[-1:]} == {
        ("-", drawing.colours(path, drawing.LINE_SHARE)[0]),
        ("--", drawing.INK),
    }


def test_body_that_stands_is_drawn_once(path: Tracks) -> None:
    path = Tracks(
        path.scenario,
        path.obstacles,
        path.times_s,
        np.repeat(path.poses[:1], 120, axis=0),
        path.slots,
        path.forces_rad,
        path.states,
        path.leaders,
    )
    axes = figures.encounters({"standing": path}).axes[0]
    assert len([text for text in axes.texts if text.get_text() == "1"]) == 1


def test_bars_show_each_state_as_long_as_it_lasted(drawn: dict[str, Figure]) -> None:
    axes = drawn["tracking"].axes[3]
    first = [bar for bar in axes.patches if round(bar.get_y() + bar.get_height() / 2.0) == 0]
    spans = [(bar.get_x(), bar.get_width()) for bar in first]
    # robot1 avoids for 20 ticks, then forms for 40, and again
    assert spans == [
        pytest.approx(one) for one in [(0.0, 1.6), (1.6, 3.2), (4.8, 1.6), (6.4, 3.12)]
    ]


def test_obstacles_that_move_are_rings_at_the_ticks_of_the_bodies(path: Tracks) -> None:
    mover = Obstacle(circle=(1.0, 4.0, 0.25), path=((1.0, 9.0),), speed_mps=0.5)
    moving = msgspec.structs.replace(path, obstacles=(*path.obstacles, mover))
    figure = figures.trajectories(moving)
    (axes,) = (axes for axes in figure.axes if axes.get_aspect() == 1.0)
    rings = [one for one in axes.patches if isinstance(one, Circle) and not one.get_fill()]
    ticks = [*drawing.moments(moving, drawing.equal_step_s(moving)), len(path.times_s) - 1]
    assert [ring.center for ring in rings] == [
        pytest.approx((1.0, 4.0 + 0.5 * path.times_s[tick])) for tick in ticks
    ]
    assert {ring.radius for ring in rings} == {0.25}
