"""Colours of robots."""

from __future__ import annotations

import itertools

from swarm import palette


def test_colour_of_a_row_is_the_same_however_many_there_are() -> None:
    assert palette.colours(500)[:7] == palette.colours(7)


def test_leader_is_gold_and_nobody_else_is() -> None:
    found = palette.colours(20, leader=3)
    assert [row for row, colour in enumerate(found) if colour == palette.LEADER] == [3]


def test_colours_are_light_and_neighbours_far_apart() -> None:
    found = palette.colours(50)
    assert min(part for colour in found for part in colour) == 89  # 0.35 of 255
    for one, other in itertools.pairwise(found):
        assert sum(abs(a - b) for a, b in zip(one, other, strict=True)) > 100
