"""Obstacles that move: where they are is a function of time alone."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm import movers
from swarm.geometry import Vec2, length
from swarm.movers import Mover
from swarm.scenario import Obstacle


def mover(*path: Vec2, speed_mps: float = 0.5) -> Mover:
    obstacle = Obstacle(circle=(1.0, 1.0, 0.25), path=path, speed_mps=speed_mps)
    (found,) = movers.moving([Obstacle(circle=(9.0, 9.0, 1.0)), obstacle])
    return found


def test_mover_goes_to_the_end_and_back_the_same_way() -> None:
    found = mover((3.0, 1.0), (3.0, 2.0))
    places = [movers.place(found, time_s) for time_s in (0.0, 2.0, 5.0, 6.0, 7.0, 11.0, 12.0, 14.0)]
    assert places == [
        *((1.0, 1.0), (2.0, 1.0), (3.0, 1.5), (3.0, 2.0)),
        *((3.0, 1.5), (1.5, 1.0), (1.0, 1.0), (2.0, 1.0)),
    ]


def test_mover_goes_round_when_its_path_ends_where_it_began() -> None:
    found = mover((3.0, 1.0), (3.0, 3.0), (1.0, 3.0), (1.0, 1.0))
    places = [movers.place(found, time_s) for time_s in (4.0, 10.0, 14.0, 16.0, 18.0)]
    assert places == [(3.0, 1.0), (2.0, 3.0), (1.0, 2.0), (1.0, 1.0), (2.0, 1.0)]


coordinates = st.floats(-50.0, 50.0).map(lambda value: round(value, 3))
points = st.tuples(coordinates, coordinates)


@given(
    path=st.lists(points, min_size=1, max_size=6, unique=True).filter(
        lambda path: (1.0, 1.0) not in path
    ),
    closed=st.booleans(),
    speed_mps=st.floats(0.01, 5.0),
    tick=st.integers(0, 100_000),
)
def test_mover_never_goes_faster_than_its_speed(
    path: list[Vec2], closed: bool, speed_mps: float, tick: int
) -> None:
    found = mover(*path, *([(1.0, 1.0)] if closed else []), speed_mps=speed_mps)
    before, after = (movers.place(found, time_s * 0.08) for time_s in (tick, tick + 1))
    gone_m = length(after[0] - before[0], after[1] - before[1])
    assert gone_m <= speed_mps * 0.08 + 1e-6
    assert movers.places_m([found], tick * 0.08).tolist() == [list(before)]


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"circle": (0.0, 0.0, 1.0), "path": ((1.0, 0.0),)}, "path and speed_mps together"),
        ({"circle": (0.0, 0.0, 1.0), "speed_mps": 1.0}, "path and speed_mps together"),
        (
            {"polygon": ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0)), "path": ((1.0, 0.0),)}
            | {"speed_mps": 1.0},
            "expected a circle with path",
        ),
        (
            {"circle": (0.0, 0.0, 1.0), "path": ((0.0, 0.0),), "speed_mps": 1.0},
            "got the same twice",
        ),
    ],
)
def test_obstacle_with_half_a_path_is_refused(fields: dict[str, object], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        Obstacle(**fields)  # type: ignore[arg-type]
