"""Contacts by hand, and against watching every instant of the way."""

from __future__ import annotations

from math import cos, pi, sin, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm.geometry import Floats
from swarm.scenario import Obstacle
from world import contact, scene

Move = tuple[tuple[float, float], tuple[float, float]]  # start, end
EMPTY = scene.build(())
CIRCLE = scene.build((Obstacle(circle=(3.0, 0.0, 1.0)),))
SQUARE = scene.build((Obstacle(polygon=((2.0, -1.0), (4.0, -1.0), (4.0, 1.0), (2.0, 1.0))),))
MIXED = (
    Obstacle(circle=(1.2, 0.3, 0.5)),
    Obstacle(polygon=((-2.0, -1.0), (-0.5, -1.2), (-0.8, 0.6), (-1.2, -0.4))),
)


def sweep(standing: scene.Scene, moves: list[Move], radius_m: float = 0.2) -> dict[int, float]:
    starts_m = np.array([start for start, _ in moves])
    ends_m = np.array([end for _, end in moves])
    return contact.sweep(
        standing,
        starts_m,
        ends_m,
        np.full(len(moves), radius_m),
        scene.clearance(standing, starts_m) - radius_m,
    )


@pytest.mark.parametrize(
    ("standing", "start", "end", "share"),
    [
        (CIRCLE, (0.0, 0.0), (4.0, 0.0), 1.8 / 4.0),  # straight at it: surface at 2, less 0.2
        (CIRCLE, (1.0, 0.0), (2.6, 0.0), 0.8 / 1.6),  # ends deep in it
        (CIRCLE, (0.0, 0.0), (1.7999, 0.0), None),  # ends just before
        (CIRCLE, (0.0, 1.21), (6.0, 1.21), None),  # passes beside
        (CIRCLE, (0.0, 0.72), (6.0, 0.72), (3.0 - 0.96) / 6.0),  # 0.72, 0.96, 1.2: a 3-4-5 triangle
        (CIRCLE, (1.5, 0.0), (0.0, 0.0), None),  # drives away
        (SQUARE, (0.0, 0.0), (4.0, 0.0), 1.8 / 4.0),  # an edge
        (SQUARE, (3.0, -4.0), (3.0, -2.0), None),
        (SQUARE, (3.0, -4.0), (3.0, -1.0), 2.8 / 3.0),
        (SQUARE, (0.0, 1.12), (4.0, 1.12), (2.0 - 0.16) / 4.0),  # a corner: 0.12, 0.16, 0.2
        (SQUARE, (0.0, 1.21), (6.0, 1.21), None),  # along a side
        (
            SQUARE,
            (1.0, 2.0),
            (3.0, 0.0),
            0.5 - 0.1 / sqrt(2.0) - 0.0,
        ),  # upon the corner, diagonally
    ],
)
def test_sweep_stops_a_body_at_the_surface(
    standing: scene.Scene, start: tuple[float, float], end: tuple[float, float], share: float | None
) -> None:
    touches = sweep(standing, [(start, end)])
    assert touches == ({} if share is None else {0: pytest.approx(share, abs=1e-12)})


@pytest.mark.parametrize(
    ("moves", "expected"),
    [
        # Head-on: 2 m apart, 1.6 between surfaces, both go 1 m.
        ([((0.0, 0.0), (1.0, 0.0)), ((2.0, 0.0), (1.0, 0.0))], {0: 0.8, 1: 0.8}),
        # One stands: it is touched as well, and has gone none of its way.
        ([((0.0, 0.0), (1.0, 0.0)), ((1.0, 0.0), (1.0, 0.0))], {0: 0.6, 1: 0.0}),
        # Side by side at the same speed.
        ([((0.0, 0.0), (1.0, 0.0)), ((0.0, 0.41), (1.0, 0.41))], {}),
        # The second one gets away in time.
        ([((0.0, 0.0), (1.0, 0.0)), ((1.0, 0.0), (1.8, 0.0))], {}),
        # 0 and 1 meet at 0.4; 2 would have followed 1 freely, but runs into it where it stopped.
        (
            [((0.0, 0.0), (1.0, 0.0)), ((1.2, 0.0), (0.2, 0.0)), ((2.2, 0.0), (1.2, 0.0))],
            {0: 0.4, 1: 0.4, 2: 1.0},
        ),
        # 0 stops 1 by standing in its way, so that 2 never meets 1.
        (
            [((1.0, 0.0), (1.0, 0.0)), ((0.0, 0.0), (2.0, 0.0)), ((2.0, 2.0), (2.0, 0.5))],
            {0: 0.0, 1: 0.3},
        ),
    ],
)
def test_sweep_stops_bodies_at_each_other(moves: list[Move], expected: dict[int, float]) -> None:
    assert sweep(EMPTY, moves) == pytest.approx(expected, abs=1e-12)


def test_sweep_meets_a_body_where_an_obstacle_has_stopped_it() -> None:
    # 0 stands at the circle from share 0.2 (x = 1.8) on; 1 comes from the side and hits it there.
    moves = [((1.6, 0.0), (2.6, 0.0)), ((1.8, 1.0), (1.8, 0.0))]
    assert sweep(CIRCLE, moves) == pytest.approx({0: 0.2, 1: 0.6}, abs=1e-12)


def test_sweep_touches_nobody_anew_when_all_stand_in_contact() -> None:
    moves = [((1.8, 0.0), (1.8, 0.0)), ((1.4, 0.0), (1.4, 0.0))]
    assert sweep(CIRCLE, moves) == {}


places = st.tuples(st.floats(-2.0, 2.0), st.floats(-1.5, 1.5))
strides = st.tuples(st.floats(0.0, 1.0), st.floats(-pi, pi))


@given(st.lists(st.tuples(places, strides), min_size=1, max_size=6))
def test_sweep_agrees_with_watching_every_instant(
    drawn: list[tuple[tuple[float, float], tuple[float, float]]],
) -> None:
    radius_m, standing = 0.2, scene.build(MIXED)
    moves: list[Move] = []
    for (x, y), (stride, angle) in drawn:
        if scene.clearance(standing, np.array([[x, y]]))[0] <= radius_m:
            continue
        if all((x - a) ** 2 + (y - b) ** 2 > 0.16 for (a, b), _ in moves):
            moves.append(((x, y), (x + stride * cos(angle), y + stride * sin(angle))))
    if not moves:
        return
    touches = sweep(standing, moves, radius_m)
    stops = np.array([touches.get(row, 1.0) for row in range(len(moves))])
    starts_m = np.array([start for start, _ in moves])
    ways_m = np.array([end for _, end in moves]) - starts_m

    def gaps_m(share: float) -> tuple[Floats, Floats]:
        centres_m = starts_m + np.minimum(share, stops)[:, None] * ways_m
        apart_m = np.sqrt(((centres_m[:, None] - centres_m) ** 2).sum(axis=2)) - 2.0 * radius_m
        np.fill_diagonal(apart_m, np.inf)
        return scene.clearance(standing, centres_m) - radius_m, apart_m

    # Nobody is ever inside anything, though only those that touch were stopped.
    for share in np.linspace(0.0, 1.0, 201).tolist():
        walls_m, apart_m = gaps_m(share)
        assert walls_m.min() > -1e-9
        assert apart_m.min() > -1e-9
    # And whoever touches has a reason: a wall or a body at no distance when the later one stops.
    walls_m, apart_m = gaps_m(1.0)
    for row in touches:
        assert min(walls_m[row], apart_m[row].min()) < 1e-9
