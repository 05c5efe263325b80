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
import numpy.typing as npt

from swarm.geometry import Floats, Vec2, length
from world.scene import Scene

Flags = npt.NDArray[np.bool_]


class Way(msgspec.Struct, frozen=True, array_like=True):
    """A circular body's way through one tick, world frame: from start to start + chord."""

    start: Vec2
    chord: Vec2
    radius_m: float

    def at(self, share: float) -> Vec2:
        """Centre after this share of the tick."""
        return (self.start[0] + share * self.chord[0], self.start[1] + share * self.chord[1])


class Passing(msgspec.Struct, frozen=True, eq=False):
    """Obstacles on their way through one tick, world frame; nothing stops them."""

    starts_m: Floats  # (movers, 2)
    ends_m: Floats  # (movers, 2)
    radii_m: Floats  # (movers,)


def sweep(
    scene: Scene,
    starts_m: Floats,
    ends_m: Floats,
    radii_m: Floats,
    clearances_m: Floats,
    passing: Passing | None = None,
) -> dict[int, float]:
    """First contacts of all bodies with each other and with the obstacles in one tick.

    Both robots of a pair touch, also one that stood. Whoever touches stops there, and what comes
    later in the tick meets it standing. Bodies that stand do not touch anew, but what moves
    touches them: a robot that is run over has touched it like any other.

    Args:
        starts_m, ends_m: (robots, 2) world frame.
        radii_m: (robots,)
        clearances_m: (robots,) from each body's surface to the nearest obstacle at the start.
    Returns:
        Of those that touch, by row: the share of its way that it went, in [0, 1].
    """
    chords_m = ends_m - starts_m
    lengths_m = np.sqrt(chords_m[:, 0] * chords_m[:, 0] + chords_m[:, 1] * chords_m[:, 1])
    moving = lengths_m > 0.0
    beside = (moving & (clearances_m <= lengths_m)).nonzero()[0].tolist()
    pairs = _near_pairs(starts_m, radii_m + lengths_m, moving)
    passers = [] if passing is None else _near_passers(starts_m, radii_m + lengths_m, passing)
    if not beside and not pairs and not passers:
        return {}
    ways = [
        Way((x_m, y_m), (chord_x_m, chord_y_m), radius_m)
        for (x_m, y_m), (chord_x_m, chord_y_m), radius_m in zip(
            starts_m.tolist(), chords_m.tolist(), radii_m.tolist(), strict=True
        )
    ]
    walls = {row: _first_obstacle(scene, ways[row]) for row in beside}
    stops = [1.0 if moves else 0.0 for moves in moving.tolist()]
    if passing is not None:
        ways += [
            Way((x_m, y_m), (end_x_m - x_m, end_y_m - y_m), radius_m)
            for (x_m, y_m), (end_x_m, end_y_m), radius_m in zip(
                passing.starts_m.tolist(),
                passing.ends_m.tolist(),
                passing.radii_m.tolist(),
                strict=True,
            )
        ]
        stops += [1.0] * len(passing.radii_m)
    return _settle(ways, walls, [*pairs, *passers], stops, len(starts_m))


def _near_passers(starts_m: Floats, reach_m: Floats, passing: Passing) -> list[tuple[int, int]]:
    """Pairs (robot, mover) that could meet; movers are numbered behind the robots."""
    chords_m = passing.ends_m - passing.starts_m
    lengths_m = np.sqrt(chords_m[:, 0] * chords_m[:, 0] + chords_m[:, 1] * chords_m[:, 1])
    dx_m = starts_m[:, 0, None] - passing.starts_m[:, 0]
    dy_m = starts_m[:, 1, None] - passing.starts_m[:, 1]
    both_m = reach_m[:, None] + (passing.radii_m + lengths_m)
    robots, movers = (dx_m * dx_m + dy_m * dy_m <= both_m * both_m).nonzero()
    return list(zip(robots.tolist(), (movers + len(starts_m)).tolist(), strict=True))


def _near_pairs(starts_m: Floats, reach_m: Floats, moving: Flags) -> list[tuple[int, int]]:
    """Pairs whose ways could meet: the gap between them is at most what both go."""
    dx_m = starts_m[:, 0, None] - starts_m[:, 0]
    dy_m = starts_m[:, 1, None] - starts_m[:, 1]
    both_m = reach_m[:, None] + reach_m
    near = dx_m * dx_m + dy_m * dy_m <= both_m * both_m
    if np.count_nonzero(near) == len(starts_m):  # each one near itself only
        return []
    i, j = (near & (moving[:, None] | moving)).nonzero()
    return [(one, other) for one, other in zip(i.tolist(), j.tolist(), strict=True) if one < other]


def _settle(
    ways: Sequence[Way],
    walls: dict[int, float],
    pairs: Sequence[tuple[int, int]],
    stops: list[float],
    count: int,
) -> dict[int, float]:
    """Touches in the order in which they happen, each one changing what can happen after it.

    Args:
        walls: share of the way at which a body alone would touch an obstacle, by row.
        pairs: that could meet.
        stops: share at which each body stands, unless it touches before.
        count: of robots; what is numbered behind them is never stopped.
    """
    touches: dict[int, float] = {}
    met: set[tuple[int, int]] = set()
    while True:  # each round uses up a wall or a pair
        share, one, other = min(
            (
                *((at, row, row) for row, at in walls.items() if row not in touches),
                *(
                    (_first_meeting(ways[i], ways[j], stops[i], stops[j]), i, j)
                    for i, j in pairs
                    if (i, j) not in met
                ),
            ),
            default=(inf, 0, 0),
        )
        if share > 1.0:
            return touches
        met.add((one, other))
        for row in (one, other):
            if row >= count:
                continue
            stops[row] = min(stops[row], share)
            touches[row] = stops[row]


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
