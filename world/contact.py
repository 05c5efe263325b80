"""Who touches what on the way through one tick.

    ways (start, end) -> near something? -> first touch -> both stop there -> next touch -> ...

A body moves along the chord of its arc. The arc leaves the chord by at most its sagitta,
v omega dt^2 / 8: 2 mm for the default body at full speed and full turn in 0.08 s.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, sqrt

import msgspec
import numpy as np

from swarm.geometry import Floats, Vec2, length
from world.scene import Scene


class Way(msgspec.Struct, frozen=True, array_like=True):
    """A circular body's way through one tick, world frame: from start to start + chord."""

    start: Vec2
    chord: Vec2
    radius_m: float

    def at(self, share: float) -> Vec2:
        """Centre after this share of the tick."""
        return (self.start[0] + share * self.chord[0], self.start[1] + share * self.chord[1])


class Touch(msgspec.Struct, frozen=True, array_like=True):
    """What became of one body: the share of its way that it went, and whether it touched."""

    share: float
    touched: bool


_FREE = Touch(1.0, False)


def sweep(scene: Scene, ways: Sequence[Way], clearances_m: Sequence[float]) -> tuple[Touch, ...]:
    """First contacts of all bodies with each other and with the obstacles.

    Both robots of a pair touch, also one that stood. Whoever touches stops there, and what comes
    later in the tick meets it standing. Bodies that stand do not touch anew.

    Args:
        clearances_m: (robots,) from each body's surface to the nearest obstacle at the start.
    Returns:
        (robots,)
    """
    lengths_m = [length(*way.chord) for way in ways]
    beside = [row for row, way_m in enumerate(lengths_m) if way_m >= clearances_m[row]]
    pairs = _near_pairs(ways, lengths_m)
    stops = [1.0 if way_m > 0.0 else 0.0 for way_m in lengths_m]
    if not pairs and all(stops[row] == 0.0 for row in beside):
        return (_FREE,) * len(ways)
    touched = [False] * len(ways)
    walls = {row: _first_obstacle(scene, ways[row]) for row in beside if stops[row] > 0.0}
    met: set[tuple[int, int]] = set()
    while True:  # each round uses up a pair or a body's wall
        share, one, other = min(
            (
                *((at, row, row) for row, at in walls.items() if at <= stops[row]),
                *(
                    (_first_meeting(ways[i], ways[j], stops[i], stops[j]), i, j)
                    for i, j in pairs
                    if (i, j) not in met
                ),
            ),
            default=(inf, 0, 0),
        )
        if share > 1.0:
            break
        met.add((one, other))
        for row in (one, other):
            stops[row] = min(stops[row], share)
            touched[row] = True
            walls.pop(row, None)
    return tuple(
        Touch(stop, True) if touch else _FREE for stop, touch in zip(stops, touched, strict=True)
    )


def _near_pairs(ways: Sequence[Way], lengths_m: Sequence[float]) -> list[tuple[int, int]]:
    """Pairs whose ways could meet: the gap between them is at most what both go."""
    starts_m = np.array([way.start for way in ways])
    reach_m = np.array([way.radius_m for way in ways]) + np.array(lengths_m)
    dx_m = starts_m[:, 0, None] - starts_m[:, 0]
    dy_m = starts_m[:, 1, None] - starts_m[:, 1]
    both_m: Floats = reach_m[:, None] + reach_m
    i, j = (dx_m * dx_m + dy_m * dy_m <= both_m * both_m).nonzero()
    return [
        (one, other)
        for one, other in zip(i.tolist(), j.tolist(), strict=True)
        if one < other and (lengths_m[one] > 0.0 or lengths_m[other] > 0.0)
    ]


def _first_obstacle(scene: Scene, way: Way) -> float:
    """Share of the way at which a body first touches an obstacle, inf when it does not."""
    first = inf
    for x_m, y_m, radius_m in scene.circles.tolist():
        first = min(first, _first_circle(way.start, way.chord, (x_m, y_m), radius_m + way.radius_m))
    for ax_m, ay_m, bx_m, by_m in scene.edges.tolist():
        first = min(first, _first_edge(way, (ax_m, ay_m), (bx_m, by_m)))
    return first


def _first_meeting(one: Way, other: Way, one_stop: float, other_stop: float) -> float:
    """Share of the tick at which two bodies first touch, each standing from its stop on."""
    radius_m = one.radius_m + other.radius_m
    first_stop, last_stop = min(one_stop, other_stop), max(one_stop, other_stop)
    start, origin = one.start, other.start
    if first_stop > 0.0:
        chord = (one.chord[0] - other.chord[0], one.chord[1] - other.chord[1])
        share = _first_circle(start, chord, origin, radius_m)
        if share <= first_stop:
            return share
    if last_stop > first_stop:
        start, origin = one.at(first_stop), other.at(first_stop)
        mover = one if one_stop > other_stop else other
        sign = 1.0 if one_stop > other_stop else -1.0
        chord = (sign * mover.chord[0], sign * mover.chord[1])
        share = first_stop + _first_circle(start, chord, origin, radius_m)
        if share <= last_stop:
            return share
    return inf


def _first_circle(start: Vec2, chord: Vec2, centre: Vec2, radius_m: float) -> float:
    """Share s >= 0 at which |start + s chord - centre| = radius_m on the way in; 0 when within.

    The smaller root of a quadratic equation, in the form that does not cancel.
    """
    x_m, y_m = start[0] - centre[0], start[1] - centre[1]
    closing = -(x_m * chord[0] + y_m * chord[1])
    outside = x_m * x_m + y_m * y_m - radius_m * radius_m
    if outside <= 0.0:
        return 0.0
    squared = chord[0] * chord[0] + chord[1] * chord[1]
    discriminant = closing * closing - squared * outside
    if closing <= 0.0 or discriminant < 0.0:
        return inf
    return outside / (closing + sqrt(discriminant))


def _first_edge(way: Way, a: Vec2, b: Vec2) -> float:
    """Share of the way at which a body first touches the edge from a to b, inf when it does not.

    The outline at distance radius_m around an edge: a circle at each end, a line on each side.
    """
    first = min(
        _first_circle(way.start, way.chord, a, way.radius_m),
        _first_circle(way.start, way.chord, b, way.radius_m),
    )
    edge_m = length(b[0] - a[0], b[1] - a[1])
    along = ((b[0] - a[0]) / edge_m, (b[1] - a[1]) / edge_m)
    x_m, y_m = way.start[0] - a[0], way.start[1] - a[1]
    off_m = along[0] * y_m - along[1] * x_m
    side = 1.0 if off_m >= 0.0 else -1.0
    closing_m = -side * (along[0] * way.chord[1] - along[1] * way.chord[0])
    gap_m = max(side * off_m - way.radius_m, 0.0)
    if closing_m > 0.0:
        share = gap_m / closing_m
    elif gap_m == 0.0:
        share = 0.0
    else:
        return first
    foot_m = along[0] * (x_m + share * way.chord[0]) + along[1] * (y_m + share * way.chord[1])
    return min(first, share) if 0.0 <= foot_m <= edge_m else first
