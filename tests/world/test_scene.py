"""Obstacles: given, drawn from the seed, and how far away their surfaces are."""

from __future__ import annotations

from math import inf, sqrt

import numpy as np
import pytest

from swarm import errors
from swarm.scenario import Obstacle, Scenario, decode
from world import scene

HEAD = 'title = "test"\nseed = 7\ndt_s = 0.08\nduration_s = 1.0\n'
ROBOT = '[[robots]]\nname = "robot1"\nstart = [0.0, 0.0, 0.0]\ngoal = [20.0, 20.0]\n'
FIELD = "[random_obstacles]\ncount = {count}\narea = [0.0, 0.0, 20.0, 20.0]\n"
SQUARE = Obstacle(polygon=((1.0, 1.0), (3.0, 1.0), (3.0, 3.0), (1.0, 3.0)))


def scenario(text: str, **changes: int) -> Scenario:
    return decode((HEAD + text).encode(), "test.toml", **changes)  # type: ignore[arg-type]


def test_obstacles_are_the_given_ones_then_the_drawn_ones() -> None:
    given = "[[obstacles]]\ncircle = [30.0, 30.0, 1.0]\n"
    every = scene.obstacles(scenario(ROBOT + given + FIELD.format(count=3)))
    assert every[0].circle == (30.0, 30.0, 1.0)
    assert len(every) == 4


def test_obstacles_are_the_same_when_the_seed_is_the_same_and_others_when_not() -> None:
    text = ROBOT + FIELD.format(count=5)
    assert scene.obstacles(scenario(text)) == scene.obstacles(scenario(text))
    assert scene.obstacles(scenario(text)) != scene.obstacles(scenario(text, seed=8))


def test_obstacles_that_were_drawn_first_stay_when_more_are_wanted() -> None:
    few = scene.obstacles(scenario(ROBOT + FIELD.format(count=4)))
    assert scene.obstacles(scenario(ROBOT + FIELD.format(count=9)))[:4] == few


@pytest.mark.parametrize("seed", range(6))
def test_obstacles_keep_gaps_and_clear_places_when_drawn(seed: int) -> None:
    given = "[[obstacles]]\npolygon = [[9.0, 9.0], [11.0, 9.0], [11.0, 11.0], [9.0, 11.0]]\n"
    plan = scenario(ROBOT + given + FIELD.format(count=20) + "gap_m_min = 0.6\n", seed=seed)
    circles = [one.circle for one in scene.obstacles(plan) if one.circle is not None]
    assert len(circles) == 20
    for number, (x_m, y_m, radius_m) in enumerate(circles):
        assert 0.4 <= radius_m <= 1.0
        assert 0.0 <= x_m <= 20.0
        assert 0.0 <= y_m <= 20.0
        for other_x_m, other_y_m, other_radius_m in circles[:number]:
            apart_m = sqrt((x_m - other_x_m) ** 2 + (y_m - other_y_m) ** 2)
            assert apart_m - radius_m - other_radius_m >= 0.6 - 1e-12
        assert sqrt(x_m**2 + y_m**2) - radius_m >= 1.0 - 1e-12
        assert sqrt((x_m - 20.0) ** 2 + (y_m - 20.0) ** 2) - radius_m >= 1.0 - 1e-12
        off_x_m, off_y_m = max(abs(x_m - 10.0) - 1.0, 0.0), max(abs(y_m - 10.0) - 1.0, 0.0)
        assert sqrt(off_x_m**2 + off_y_m**2) - radius_m >= 0.6 - 1e-12


def test_obstacles_say_what_to_relax_when_they_do_not_fit() -> None:
    crowd = "[random_obstacles]\ncount = 30\narea = [0.0, 0.0, 5.0, 5.0]\n"
    with pytest.raises(errors.ScenarioError, match=r"got \d+ of 30 .* lower count, radius_m"):
        scene.obstacles(scenario(ROBOT + crowd))


def test_obstacles_are_refused_when_a_robot_starts_in_one() -> None:
    with pytest.raises(errors.ScenarioError, match=r"'robot1' to start clear .* got -0\.120 m"):
        scene.obstacles(scenario(ROBOT + "[[obstacles]]\ncircle = [1.0, 0.0, 0.9]\n"))


@pytest.mark.parametrize(
    "corners",
    [
        "[[5.0, 0.0], [6.0, 1.0], [6.0, 0.0], [5.0, 1.0]]",  # a bow tie
        "[[5.0, 0.0], [5.0, 0.0], [6.0, 1.0]]",  # a corner twice
        "[[5.0, 0.0], [7.0, 0.0], [7.0, 1.0], [6.0, 0.0], [5.0, 1.0]]",  # a corner on an edge
    ],
)
def test_obstacles_are_refused_when_a_polygon_meets_itself(corners: str) -> None:
    with pytest.raises(errors.ScenarioError, match=r"obstacles\[0\]\.polygon: expected corners in"):
        scene.obstacles(scenario(ROBOT + f"[[obstacles]]\npolygon = {corners}\n"))


@pytest.mark.parametrize(
    ("point", "expected_m"),
    [
        ((0.0, 2.0), 1.0),  # left of the square
        ((2.0, 2.5), -0.5),  # inside, nearest to the upper edge
        ((4.0, 4.0), sqrt(2.0)),  # beyond a corner
        ((2.0, 7.0), 1.0),  # below the circle
        ((2.0, 10.0), -2.0),  # in its centre
        ((2.0, 1.0), 0.0),  # on an edge
    ],
)
def test_clearance_is_the_nearest_surface(point: tuple[float, float], expected_m: float) -> None:
    standing = scene.build((SQUARE, Obstacle(circle=(2.0, 10.0, 2.0))))
    assert scene.clearance(standing, np.array([point]))[0] == pytest.approx(expected_m, abs=1e-15)


def test_clearance_is_negative_only_inside_a_polygon_that_is_not_convex() -> None:
    notched = ((0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (2.0, 1.0), (0.0, 4.0))
    standing = scene.build((SQUARE, Obstacle(polygon=notched)))
    in_notch, below_notch = scene.clearance(standing, np.array([[2.0, 3.5], [2.0, 0.5]]))
    assert in_notch > 0.0
    assert below_notch == -0.5


def test_clearance_is_inf_when_nothing_stands_there() -> None:
    assert scene.clearance(scene.build(()), np.zeros((2, 2))).tolist() == [inf, inf]
