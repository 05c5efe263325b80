"""When two claims mean the same gap: gaps have no names, so their lines are compared."""

from __future__ import annotations

from swarm.geometry import Vec2
from swarm.messages import Passage

# Mouths of one gap lie no further apart than this along its axis, and beside it by no more than
# this and a share of that: both see it from afar, and at an angle.
ALONG_M, LATERAL_M, LATERAL_SHARE = 6.5, 0.6, 0.25
OPPOSITE, SAME = -0.5, 0.7  # product of the axes


def of_axis(mine: Passage, place: Vec2) -> Vec2:
    """(along, aside) m of a place, from the mouth in the direction of the claim."""
    x_m, y_m = place[0] - mine.mouth[0], place[1] - mine.mouth[1]
    return (
        x_m * mine.axis[0] + y_m * mine.axis[1],
        y_m * mine.axis[0] - x_m * mine.axis[1],
    )


def same_line(mine: Passage, mouth: Vec2, axis: Vec2) -> float:
    """Product of the axes of two claims to the same gap, 0 when they are not."""
    along_m, aside_m = of_axis(mine, mouth)
    if abs(along_m) > ALONG_M or abs(aside_m) >= LATERAL_M + LATERAL_SHARE * abs(along_m):
        return 0.0
    return mine.axis[0] * axis[0] + mine.axis[1] * axis[1]
