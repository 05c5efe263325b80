"""Formations by name: by hand for a few, spacing and symmetry for all sizes."""

from __future__ import annotations

from math import cos, hypot, pi, sin, sqrt

import pytest

from swarm import shapes
from swarm.geometry import Vec2
from swarm.shapes import Shape

FOLLOWERS = (1, 2, 3, 5, 8, 15, 24, 49)


def places(shape: Shape, followers: int) -> list[Vec2]:
    """Where the slots of eq. 39 are for a leader at the origin that looks along x."""
    slots = shapes.slots(shape, followers, 1.5)
    return [
        (-slot.distance_m * cos(slot.bearing_rad), -slot.distance_m * sin(slot.bearing_rad))
        for slot in slots
    ]


def test_wedge_has_the_first_slots_of_table_i() -> None:
    slots = shapes.slots("wedge", 4, sqrt(2.0))
    expected = [(1.0, pi / -4.0), (1.0, pi / 4.0), (2.0, pi / -4.0), (2.0, pi / 4.0)]
    for slot, (diagonals, bearing_rad) in zip(slots, expected, strict=True):
        assert slot.distance_m == pytest.approx(diagonals * sqrt(2.0))
        assert slot.bearing_rad == pytest.approx(bearing_rad)


@pytest.mark.parametrize(
    ("shape", "expected"),
    [
        ("column", [(-1.5, 0.0), (-3.0, 0.0), (-4.5, 0.0)]),
        ("line", [(0.0, 1.5), (0.0, -1.5), (0.0, 3.0)]),
        (
            "circle",
            [
                (-0.75 * sqrt(2.0), 0.75 * sqrt(2.0)),
                (-0.75 * sqrt(2.0), -0.75 * sqrt(2.0)),
                (-1.5 * sqrt(2.0), 0.0),
            ],
        ),
        (
            "diamond",
            [
                (-0.75 * sqrt(2.0), 0.75 * sqrt(2.0)),
                (-0.75 * sqrt(2.0), -0.75 * sqrt(2.0)),
                (-1.5 * sqrt(2.0), 0.0),
            ],
        ),
    ],
)
def test_slots_of_three_followers_are_where_the_shape_says(
    shape: Shape, expected: list[Vec2]
) -> None:
    for place, wanted in zip(places(shape, 3), expected, strict=True):
        assert place == pytest.approx(wanted, abs=1e-9)


@pytest.mark.parametrize("followers", FOLLOWERS)
@pytest.mark.parametrize("shape", shapes.SHAPES)
def test_neighbours_are_spaced_and_nobody_is_nearer(shape: Shape, followers: int) -> None:
    every = [(0.0, 0.0), *places(shape, followers)]
    assert len(every) == followers + 1
    for place in every:
        nearest_m = min(
            hypot(place[0] - other[0], place[1] - other[1]) for other in every if other is not place
        )
        assert nearest_m == pytest.approx(1.5)


@pytest.mark.parametrize("followers", FOLLOWERS)
@pytest.mark.parametrize("shape", shapes.SHAPES)
def test_nobody_is_ahead_of_the_leader_and_left_comes_first(shape: Shape, followers: int) -> None:
    every = places(shape, followers)
    assert max(x_m for x_m, _ in every) < 1e-9
    assert every[0][1] > -1e-9
    sides = sum((y_m > 1e-9) - (y_m < -1e-9) for _, y_m in every)
    assert sides in (0, 1)  # as many on the right, or one less
