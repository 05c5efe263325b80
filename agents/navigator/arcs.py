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

# Hits may lie so far off the circle, round by round: one that has turned back is 2 v dt off.
GATES_M = np.array((0.2, 0.2, 0.12, 0.08, 0.05))
OWN_M = 0.03  # and so far in the end
BEYOND_SHARE = 0.3  # by this part of the radius a hit may lie beyond the centre
HITS_MIN = 3
# How far off a place is that is only expected, and how far off the radius; a hit is off by that.
EXPECTED_M, RADIUS_OFF_M, HIT_M = 0.05, 0.02, 0.004
RADIUS_HITS, RADIUS_WEIGHT = 5, 0.1  # hits that tell something of the radius, and how much
THROUGH_SHARE, THROUGH_MAX = 0.7, 2  # so many beams through this part of it: it is not there


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
    known, beams = len(tracks), len(hits_m)
    fits = np.zeros((known, FIT_COLUMNS))
    owners[:] = -1
    for index in range(known):
        fits[index, PLACE_X] = tracks[index, X] + elapsed_s * tracks[index, V_X]
        fits[index, PLACE_Y] = tracks[index, Y] + elapsed_s * tracks[index, V_Y]
        fits[index, ROUND] = tracks[index, RADIUS]
    # Hits near to any, from the robot, world axes.
    some = np.empty((beams, 2))
    some_of = np.empty(beams, dtype=np.int64)
    count = 0
    for beam in range(beams):
        if not hits_m[beam] < 1e6:
            continue
        at_x = hits_m[beam] * (ahead * units[beam, 0] - aside * units[beam, 1])
        at_y = hits_m[beam] * (aside * units[beam, 0] + ahead * units[beam, 1])
        for index in range(known):
            if tracks[index, MOVES] > 0.0:
                dx, dy = at_x + x_m - fits[index, PLACE_X], at_y + y_m - fits[index, PLACE_Y]
                reach_m = fits[index, ROUND] + GATE_M
                if dx * dx + dy * dy < reach_m * reach_m:
                    some[count, 0], some[count, 1] = at_x, at_y
                    some_of[count] = beam
                    count += 1
                    break
    if count == 0:
        return fits
    hit2_m2 = (HIT_M + unsure_m / 3.0) * (HIT_M + unsure_m / 3.0)
    prior = hit2_m2 / (EXPECTED_M * EXPECTED_M)
    first = fits.copy()
    sums = np.empty((known, 9))
    for gate_m in GATES_M:
        sums[:] = 0.0
        for number in range(count):
            owner, off_m = _owner(
                tracks, fits, some[number, 0], some[number, 1], x_m, y_m, gate_m + unsure_m
            )
            if owner < 0:
                continue
            dx = some[number, 0] + x_m - fits[owner, PLACE_X]
            dy = some[number, 1] + y_m - fits[owner, PLACE_Y]
            apart_m = off_m + fits[owner, ROUND]
            dx, dy = dx / apart_m, dy / apart_m
            sums[owner, 0] += dx * dx
            sums[owner, 1] += dx * dy
            sums[owner, 2] += dy * dy
            sums[owner, 3] += dx * off_m
            sums[owner, 4] += dy * off_m
            sums[owner, HITS_SUM] += 1.0
            sums[owner, 6] += dx
            sums[owner, 7] += dy
            sums[owner, 8] += off_m
        for index in range(known):
            if sums[index, HITS_SUM] == 0.0:
                continue
            a, b, c = sums[index, 0] + prior, sums[index, 1], sums[index, 2] + prior
            to_x = sums[index, 3] + prior * (first[index, PLACE_X] - fits[index, PLACE_X])
            to_y = sums[index, 4] + prior * (first[index, PLACE_Y] - fits[index, PLACE_Y])
            determinant = a * c - b * b
            fits[index, PLACE_X] += (c * to_x - b * to_y) / determinant
            fits[index, PLACE_Y] += (a * to_y - b * to_x) / determinant
    # Whose is what in the end?
    for number in range(count):
        owner, _ = _owner(
            tracks, fits, some[number, 0], some[number, 1], x_m, y_m, OWN_M + unsure_m
        )
        owners[some_of[number]] = owner
        if owner >= 0:
            fits[owner, HITS] += 1.0
    for index in range(known):
        dx = fits[index, PLACE_X] - first[index, PLACE_X]
        dy = fits[index, PLACE_Y] - first[index, PLACE_Y]
        seen = fits[index, HITS] >= HITS_MIN and dx * dx + dy * dy < GATE_M * GATE_M
        if seen and _seen_through(fits[index], raw_m, units, x_m, y_m, ahead, aside):
            seen = False
        if seen:
            continue
        fits[index, HITS] = 0.0
        for number in range(count):
            if owners[some_of[number]] == index:
                owners[some_of[number]] = -1
    # The radius too, little by little.
    prior_radius = hit2_m2 / (RADIUS_OFF_M * RADIUS_OFF_M)
    for index in range(known):
        if fits[index, HITS] < RADIUS_HITS:
            continue
        size = sums[index, HITS_SUM] + prior_radius
        a = sums[index, 0] + prior - sums[index, 6] * sums[index, 6] / size
        b = sums[index, 1] - sums[index, 6] * sums[index, 7] / size
        c = sums[index, 2] + prior - sums[index, 7] * sums[index, 7] / size
        to_x = sums[index, 3] - sums[index, 6] * sums[index, 8] / size
        to_y = sums[index, 4] - sums[index, 7] * sums[index, 8] / size
        determinant = a * c - b * b
        if determinant <= 0.0:
            continue
        dx, dy = (c * to_x - b * to_y) / determinant, (a * to_y - b * to_x) / determinant
        more_m = (sums[index, 8] - sums[index, 6] * dx - sums[index, 7] * dy) / size
        more_m = max(-RADIUS_OFF_M, min(RADIUS_OFF_M, more_m))
        fits[index, ROUND] += RADIUS_WEIGHT * more_m
    return fits


HITS_SUM = 5


@compiled
def _owner(
    tracks: Floats, fits: Floats, hit_x: float, hit_y: float, x_m: float, y_m: float, gate_m: float
) -> tuple[int, float]:
    """Whose near side a hit lies on, or -1; how far outside of it.

    Args:
        hit_x, hit_y: from the robot, world axes.
    """
    best, best_m = -1, 0.0
    away_m = np.sqrt(hit_x * hit_x + hit_y * hit_y)
    for index in range(len(fits)):
        if tracks[index, MOVES] == 0.0:
            continue
        dx = hit_x + x_m - fits[index, PLACE_X]
        dy = hit_y + y_m - fits[index, PLACE_Y]
        reach_m = fits[index, ROUND] + gate_m
        square_m2 = dx * dx + dy * dy
        if square_m2 >= reach_m * reach_m or square_m2 == 0.0:
            continue
        off_m = np.sqrt(square_m2) - fits[index, ROUND]
        if abs(off_m) >= gate_m or (best >= 0 and abs(off_m) >= abs(best_m)):
            continue
        if dx * hit_x + dy * hit_y > BEYOND_SHARE * fits[index, ROUND] * away_m:
            continue
        best, best_m = index, off_m
    return best, best_m


@compiled
def _seen_through(
    fit: Floats, raw_m: Floats, units: Floats, x_m: float, y_m: float, ahead: float, aside: float
) -> bool:
    """Whether beams go on behind it that would have to hit it."""
    dx, dy = fit[PLACE_X] - x_m, fit[PLACE_Y] - y_m
    to_x, to_y = ahead * dx + aside * dy, ahead * dy - aside * dx
    most_m = THROUGH_SHARE * fit[ROUND]
    through = 0
    for beam in range(len(raw_m)):
        along_m = units[beam, 0] * to_x + units[beam, 1] * to_y
        if along_m <= 0.0 or raw_m[beam] < along_m:
            continue
        if abs(units[beam, 0] * to_y - units[beam, 1] * to_x) < most_m:
            through += 1
    return through >= THROUGH_MAX
