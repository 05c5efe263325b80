"""Formations by name: where the followers of a leader belong, in row order.

    shape, followers, spacing --slots--> [Slot]      a slot is eq. 39's (distance, bearing)

Neighbours are `spacing_m` apart in every shape. Where there are two sides the first follower goes
to the left, as in Table I.
"""

from __future__ import annotations

from functools import lru_cache
from math import atan2, cos, pi, sin, sqrt
from typing import Literal, get_args

from swarm import geometry
from swarm.geometry import TAU, Vec2
from swarm.messages import Slot

Shape = Literal["line", "column", "wedge", "diamond", "circle"]
SHAPES: tuple[Shape, ...] = get_args(Shape)


@lru_cache(maxsize=64)
def slots(shape: Shape, followers: int, spacing_m: float) -> tuple[Slot, ...]:
    """Slots of so many followers: `line` abreast with the leader in the middle, `column` behind
    it, `wedge` a right angle and `diamond` a square standing on a corner, the leader in front,
    `circle` a ring with the leader in front.
    """
    return tuple([slot_at(*place) for place in _places(shape, followers, spacing_m)])


def slot_at(x_m: float, y_m: float, leader_yaw_rad: float = 0.0) -> Slot:
    """Slot at a place that is so far from a leader of that heading (eq. 39 has a minus)."""
    bearing_rad = geometry.wrap_angle(atan2(y_m, x_m) - leader_yaw_rad + pi)
    return Slot(geometry.length(x_m, y_m), bearing_rad)


def _places(shape: Shape, followers: int, spacing_m: float) -> list[Vec2]:
    """Places from the leader, x ahead, y to its left."""
    numbers = range(1, followers + 1)
    match shape:
        case "column":
            return [(-number * spacing_m, 0.0) for number in numbers]
        case "line":
            return [(0.0, side * step * spacing_m) for side, step in map(_side_step, numbers)]
        case "wedge":
            arm_m = spacing_m / sqrt(2.0)
            return [(-step * arm_m, side * step * arm_m) for side, step in map(_side_step, numbers)]
        case "circle":
            turn_rad = TAU / (followers + 1)
            radius_m = spacing_m / (2.0 * sin(turn_rad / 2.0))
            return [
                (
                    radius_m * (cos(step * turn_rad) - 1.0),
                    side * radius_m * sin(step * turn_rad),
                )
                for side, step in map(_side_step, numbers)
            ]
        case "diamond":
            return _diamond(followers, spacing_m)


def _side_step(number: int) -> tuple[int, int]:
    """Side (+1: left) and how many steps out: left and right in turn."""
    return (1 if number % 2 else -1), (number + 1) // 2


def _diamond(followers: int, spacing_m: float) -> list[Vec2]:
    """The smallest square that holds all, filled row by row, each from its middle."""
    side = 1
    while side * side < followers + 1:
        side += 1
    cells = [(i + j, i - j) for i in range(side) for j in range(side)]  # steps back, to the left
    cells.sort(key=lambda cell: (cell[0], abs(cell[1]), -cell[1]))
    step_m = spacing_m / sqrt(2.0)
    return [(-back * step_m, left * step_m) for back, left in cells[1 : followers + 1]]
