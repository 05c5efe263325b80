"""A colour for every robot: the same in pictures, in a terminal, and in every run of a scenario."""

from __future__ import annotations

Rgb = tuple[int, int, int]

GOLDEN_TURNS = 0.618033988749895  # its multiples fill the colour circle evenly
FIRST_TURNS = 0.55  # hue of the first row: blue
DARKEST = 0.35  # of any part, so that all are light on a dark ground
LEADER: Rgb = (0xFF, 0xE0, 0x8A)


def colours(count: int, leader: int | None = None) -> list[Rgb]:
    """Colours by row, far apart for neighbours in the table; the row that leads is gold."""
    return [LEADER if row == leader else _of_row(row) for row in range(count)]


def _of_row(row: int) -> Rgb:
    turns = (FIRST_TURNS + GOLDEN_TURNS * row) % 1.0
    red, green, blue = (_part(turns, shift) for shift in (0.0, 4.0, 2.0))
    return red, green, blue


def _part(turns: float, shift: float) -> int:
    wave = abs((turns * 6.0 + shift) % 6.0 - 3.0) - 1.0
    return round(255.0 * (DARKEST + (1.0 - DARKEST) * min(1.0, max(0.0, wave))))
