"""Where bodies that are known to move are now, from whatever is seen of them.

    hits --nearest circle--> owners --least squares--> centres, and again

Two that pass each other are one run of beams, and who passes behind shows a part only. But what a
body looks like is known by then, and about where it is: each hit belongs to the circle on whose
near side it lies, and each circle fits its own hits.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from agents.navigator.compiled import compiled
from agents.navigator.tracks import (
    FIT_COLUMNS,
    GATE_M,
    HITS,
    MOVES,
    PLACE_X,
    PLACE_Y,
    RADIUS,
    ROUND,
    V_X,
    V_Y,
    X,
    Y,
)
from swarm.geometry import Floats

Owners = npt.NDArray[np.int64]

# Hits may lie so far off the circle, round by round; where few lie on it after that it may have
# turned back, and is 2 v dt off.
GATES_M = np.array((0.06, 0.06, 0.05))
WIDE_M = np.array((0.2, 0.2, 0.12, 0.08, 0.05))
FEW_SHARE, OPEN_M = 0.6, 0.1  # of beams that nothing stops before it, by so much
OWN_M = 0.03  # and so far in the end
BEYOND_SHARE = 0.3  # by this part of the radius a hit may lie beyond the centre
HITS_MIN = 3
# How far off a place is that is only expected, and how far off the radius; a hit is off by that.
EXPECTED_M, RADIUS_OFF_M, HIT_M = 0.05, 0.02, 0.004
RADIUS_HITS, RADIUS_WEIGHT = 5, 0.1  # hits that tell something of the radius, and how much
THROUGH_SHARE, THROUGH_MAX = 0.7, 2  # so many beams through this part of it: it is not there

# Sums over a circle's hits: of products of their directions from its centre, of how far off it.
XX, XY, YY, X1, Y1, ONES, X_OFF, Y_OFF, OFF = range(9)
SUMS = 9


@compiled
def locate(
    tracks: Floats,
    raw_m: Floats,
    hits_m: Floats,
    units: Floats,
    x_m: float,
    y_m: float,
    ahead: float,
    aside: float,
    elapsed_s: float,
    unsure_m: float,
    owners: Owners,
) -> Floats:
    """(tracks, FIT_COLUMNS) of those that move; into `owners`, (beams,), whose hit it is, or -1.

    Args:
        raw_m: (beams,) all hits; hits_m: those of obstacles.
    """
    known = len(tracks)
    fits = np.zeros((known, FIT_COLUMNS))
    for index in range(known):
        fits[index, PLACE_X] = tracks[index, X] + elapsed_s * tracks[index, V_X] - x_m
        fits[index, PLACE_Y] = tracks[index, Y] + elapsed_s * tracks[index, V_Y] - y_m
        fits[index, ROUND] = tracks[index, RADIUS]
    owners[:] = -1
    near, beams = _near(tracks, fits, hits_m, units, ahead, aside)
    if len(near) > 0:
        expected = fits.copy()
        sums = np.empty((known, SUMS))
        hit2_m2 = (HIT_M + unsure_m / 3.0) * (HIT_M + unsure_m / 3.0)
        own_m = OWN_M + unsure_m
        gates_m = np.zeros(known)
        for gate_m in GATES_M:
            for index in range(known):
                gates_m[index] = gate_m + unsure_m if tracks[index, MOVES] > 0.0 else 0.0
            _fit(fits, expected, near, gates_m, own_m, hit2_m2, sums)
        _count(fits, tracks, near, own_m, gates_m)
        few = np.zeros(known, dtype=np.bool_)
        some = False
        for index in range(known):
            if tracks[index, MOVES] > 0.0:
                unhidden, _ = _crossing(fits[index], raw_m, units, ahead, aside)
                few[index] = fits[index, HITS] < max(HITS_MIN, FEW_SHARE * unhidden)
                some = some or few[index]
        if some:
            before = fits.copy()
            for index in range(known):
                if few[index]:
                    fits[index] = expected[index]
            for gate_m in WIDE_M:
                for index in range(known):
                    if tracks[index, MOVES] > 0.0:
                        gates_m[index] = gate_m + unsure_m if few[index] else own_m
                _fit(fits, expected, near, gates_m, own_m, hit2_m2, sums)
            _count(fits, tracks, near, own_m, gates_m)
            for index in range(known):
                if few[index] and fits[index, HITS] <= before[index, HITS]:
                    fits[index] = before[index]
        for index in range(known):
            dx = fits[index, PLACE_X] - expected[index, PLACE_X]
            dy = fits[index, PLACE_Y] - expected[index, PLACE_Y]
            seen = fits[index, HITS] >= HITS_MIN and dx * dx + dy * dy < GATE_M * GATE_M
            if seen:
                _, through = _crossing(fits[index], raw_m, units, ahead, aside)
                seen = through < THROUGH_MAX
            gates_m[index] = own_m if seen else 0.0
        for index in range(known):
            fits[index, HITS] = 0.0
        for number in range(len(near)):
            owner, _ = _owner(fits, near[number, 0], near[number, 1], gates_m)
            owners[beams[number]] = owner
            if owner >= 0:
                fits[owner, HITS] += 1.0
        _add_up(fits, near, gates_m, sums)
        _grow(fits, sums, hit2_m2)
    for index in range(known):
        fits[index, PLACE_X] += x_m
        fits[index, PLACE_Y] += y_m
    return fits


@compiled
def _near(
    tracks: Floats, fits: Floats, hits_m: Floats, units: Floats, ahead: float, aside: float
) -> tuple[Floats, Owners]:
    """(hits, 2) m, from the robot, world axes: those near to anything that moves; their beams."""
    near = np.empty((len(hits_m), 2))
    beams = np.empty(len(hits_m), dtype=np.int64)
    count = 0
    for beam in range(len(hits_m)):
        if not hits_m[beam] < 1e6:
            continue
        at_x = hits_m[beam] * (ahead * units[beam, 0] - aside * units[beam, 1])
        at_y = hits_m[beam] * (aside * units[beam, 0] + ahead * units[beam, 1])
        for index in range(len(fits)):
            dx, dy = at_x - fits[index, PLACE_X], at_y - fits[index, PLACE_Y]
            reach_m = fits[index, ROUND] + GATE_M
            if tracks[index, MOVES] > 0.0 and dx * dx + dy * dy < reach_m * reach_m:
                near[count, 0], near[count, 1] = at_x, at_y
                beams[count] = beam
                count += 1
                break
    return near[:count], beams[:count]


@compiled
def _count(fits: Floats, tracks: Floats, near: Floats, own_m: float, gates_m: Floats) -> None:
    """How many hits lie on each circle."""
    for index in range(len(fits)):
        fits[index, HITS] = 0.0
        gates_m[index] = own_m if tracks[index, MOVES] > 0.0 else 0.0
    for number in range(len(near)):
        owner, _ = _owner(fits, near[number, 0], near[number, 1], gates_m)
        if owner >= 0:
            fits[owner, HITS] += 1.0


@compiled
def _fit(
    fits: Floats,
    expected: Floats,
    near: Floats,
    gates_m: Floats,
    own_m: float,
    hit2_m2: float,
    sums: Floats,
) -> None:
    """Move circles to where their hits lie on them; what these leave open is as expected."""
    _add_up(fits, near, gates_m, sums)
    prior = hit2_m2 / (EXPECTED_M * EXPECTED_M)
    for index in range(len(fits)):
        if sums[index, ONES] == 0.0 or gates_m[index] <= own_m:
            continue
        xx, xy, yy = sums[index, XX] + prior, sums[index, XY], sums[index, YY] + prior
        to_x = sums[index, X_OFF] + prior * (expected[index, PLACE_X] - fits[index, PLACE_X])
        to_y = sums[index, Y_OFF] + prior * (expected[index, PLACE_Y] - fits[index, PLACE_Y])
        determinant = xx * yy - xy * xy
        fits[index, PLACE_X] += (yy * to_x - xy * to_y) / determinant
        fits[index, PLACE_Y] += (xx * to_y - xy * to_x) / determinant


@compiled
def _add_up(fits: Floats, near: Floats, gates_m: Floats, sums: Floats) -> None:
    """Normal equations of each circle's own hits, into `sums`."""
    sums[:] = 0.0
    for number in range(len(near)):
        owner, off_m = _owner(fits, near[number, 0], near[number, 1], gates_m)
        if owner < 0:
            continue
        apart_m = off_m + fits[owner, ROUND]
        to_x = (near[number, 0] - fits[owner, PLACE_X]) / apart_m
        to_y = (near[number, 1] - fits[owner, PLACE_Y]) / apart_m
        sums[owner, XX] += to_x * to_x
        sums[owner, XY] += to_x * to_y
        sums[owner, YY] += to_y * to_y
        sums[owner, X1] += to_x
        sums[owner, Y1] += to_y
        sums[owner, ONES] += 1.0
        sums[owner, X_OFF] += to_x * off_m
        sums[owner, Y_OFF] += to_y * off_m
        sums[owner, OFF] += off_m


@compiled
def _grow(fits: Floats, sums: Floats, hit2_m2: float) -> None:
    """Radii too, little by little: the same equations with one unknown more."""
    prior = hit2_m2 / (EXPECTED_M * EXPECTED_M)
    for index in range(len(fits)):
        if fits[index, HITS] < RADIUS_HITS:
            continue
        size = sums[index, ONES] + hit2_m2 / (RADIUS_OFF_M * RADIUS_OFF_M)
        x1, y1, off_m = sums[index, X1] / size, sums[index, Y1] / size, sums[index, OFF] / size
        xx = sums[index, XX] + prior - x1 * sums[index, X1]
        xy = sums[index, XY] - x1 * sums[index, Y1]
        yy = sums[index, YY] + prior - y1 * sums[index, Y1]
        to_x, to_y = sums[index, X_OFF] - x1 * sums[index, OFF], sums[index, Y_OFF]
        to_y -= y1 * sums[index, OFF]
        determinant = xx * yy - xy * xy
        if determinant <= 0.0:
            continue
        dx, dy = (yy * to_x - xy * to_y) / determinant, (xx * to_y - xy * to_x) / determinant
        more_m = max(-RADIUS_OFF_M, min(RADIUS_OFF_M, off_m - x1 * dx - y1 * dy))
        fits[index, ROUND] += RADIUS_WEIGHT * more_m


@compiled
def _owner(fits: Floats, hit_x: float, hit_y: float, gates_m: Floats) -> tuple[int, float]:
    """Whose near side a hit lies on, or -1; how far outside of it."""
    best, best_m = -1, 0.0
    away_m = np.sqrt(hit_x * hit_x + hit_y * hit_y)
    for index in range(len(fits)):
        if gates_m[index] == 0.0:
            continue
        dx, dy = hit_x - fits[index, PLACE_X], hit_y - fits[index, PLACE_Y]
        reach_m = fits[index, ROUND] + gates_m[index]
        square_m2 = dx * dx + dy * dy
        if square_m2 >= reach_m * reach_m or square_m2 == 0.0:
            continue
        off_m = np.sqrt(square_m2) - fits[index, ROUND]
        if abs(off_m) >= gates_m[index] or (best >= 0 and abs(off_m) >= abs(best_m)):
            continue
        if dx * hit_x + dy * hit_y > BEYOND_SHARE * fits[index, ROUND] * away_m:
            continue
        best, best_m = index, off_m
    return best, best_m


@compiled
def _crossing(
    fit: Floats, raw_m: Floats, units: Floats, ahead: float, aside: float
) -> tuple[int, int]:
    """Of the beams through its middle: those that nothing stops before it, that go on behind it."""
    to_x = ahead * fit[PLACE_X] + aside * fit[PLACE_Y]
    to_y = ahead * fit[PLACE_Y] - aside * fit[PLACE_X]
    most_m = THROUGH_SHARE * fit[ROUND]
    unhidden = through = 0
    for beam in range(len(raw_m)):
        along_m = units[beam, 0] * to_x + units[beam, 1] * to_y
        if along_m <= 0.0 or abs(units[beam, 0] * to_y - units[beam, 1] * to_x) >= most_m:
            continue
        if raw_m[beam] > along_m - fit[ROUND] - OPEN_M:
            unhidden += 1
        if raw_m[beam] > along_m:
            through += 1
    return unhidden, through
