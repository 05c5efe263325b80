"""Segments of successive scans that are one body, and whether that body moves.

    segments --nearest--> tracks --line through places--> velocity
    hits where a scan before saw nothing --evidence--> it moves, it is not only seen differently

A place where a beam passed through a moment ago and that is occupied now is what no static scene
can show, however its visible parts change with the robot's own motion. Only such tracks count.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from agents.navigator.compiled import compiled
from agents.navigator.points import bin_of
from agents.navigator.segments import DIRECTION_X, DIRECTION_Y, FIRST, LAST, RANGE, SIZE
from swarm.geometry import Floats

Flags = npt.NDArray[np.bool_]

# Columns of a track: centre and velocity now, world; radius; number of its places; ticks since it
# was seen; whether it moves; ticks with evidence for that; whether it was where it was expected;
# then WINDOW places, newest first: age in s, x, y.
X, Y, V_X, V_Y, RADIUS, COUNT, MISSED, MOVES, EVIDENCE, STRIKES = range(10)
PLACES, WINDOW = 10, 10
COLUMNS = PLACES + 3 * WINDOW
# Columns of a fit: centre, world; radius; how many hits lie on it, 0: it is not seen.
PLACE_X, PLACE_Y, ROUND, HITS = range(4)
FIT_COLUMNS = 4
TRACKS_MAX = 40

GATE_M = 0.3  # a segment belongs to a track expected within this
ALIKE_SHARE = 0.3  # and only if it is as large, by this part of its radius
# Further off the expected place it has turned: only so many places count then, two when it is near.
STRIKE_M, STRIKE_NEAR_M = 0.05, 0.025
NEAR_M = 2.0
STRIKES_MAX = 2
FRESH = 3
COUNT_MIN = 4  # places before it may move
SPEED_MPS = 0.12  # what moves is faster, by three standard errors
STILL_MPS = 0.06  # slower over all its window, it has stopped
GONE_TICKS, LOST_TICKS = 3, 12  # unseen for longer: forgotten; one that moves, behind something
FREE_M = 0.07  # by how much beyond a place beams must have gone
EVIDENCE_HITS, EVIDENCE_TICKS = 2, 2
HIDE_M = 0.12  # hits this near to what moves are its own


@compiled
def follow(
    tracks: Floats,
    fits: Floats,
    found: Floats,
    raw_m: Floats,
    units: Floats,
    bounds: Floats,
    x_m: float,
    y_m: float,
    ahead: float,
    aside: float,
    beam_rad: float,
    elapsed_s: float,
    unsure_m: float,
    old_m: Floats,
    old_pose: Floats,
) -> Floats:
    """Tracks after a scan with these segments.

    Args:
        fits: (tracks, ...) as `arcs` has them: where those are that move.
        old_m: (beams,) scan of before, perhaps empty; old_pose: (4,) x, y, cosine, sine.
    """
    known = len(tracks)
    result = np.zeros((known + len(found), COLUMNS))
    taken = np.zeros(known, dtype=np.bool_)
    count = 0
    beams = len(raw_m)
    for index in range(known):
        if fits[index, HITS] == 0.0:
            continue
        taken[index] = True
        track = result[count]
        count += 1
        track[:] = tracks[index]
        track[RADIUS] = fits[index, ROUND]
        at_x, at_y = fits[index, PLACE_X], fits[index, PLACE_Y]
        away_m = np.sqrt((at_x - x_m) * (at_x - x_m) + (at_y - y_m) * (at_y - y_m))
        put(track, at_x, at_y, away_m, 0.0, elapsed_s, unsure_m)
    for number in range(len(found)):
        segment = found[number]
        seen_x = x_m + (segment[RANGE] + segment[SIZE]) * segment[DIRECTION_X]
        seen_y = y_m + (segment[RANGE] + segment[SIZE]) * segment[DIRECTION_Y]
        best = -1
        best2 = GATE_M * GATE_M
        for index in range(known):
            if taken[index]:
                continue
            if tracks[index, COUNT] > COUNT_MIN:
                unlike_m = abs(tracks[index, RADIUS] - segment[SIZE])
                if unlike_m > ALIKE_SHARE * tracks[index, RADIUS] + beam_rad * segment[RANGE]:
                    continue
            dx = tracks[index, X] + elapsed_s * tracks[index, V_X] - seen_x
            dy = tracks[index, Y] + elapsed_s * tracks[index, V_Y] - seen_y
            if dx * dx + dy * dy < best2:
                best = index
                best2 = dx * dx + dy * dy
        track = result[count]
        count += 1
        radius_m = segment[SIZE]
        if best >= 0:
            taken[best] = True
            track[:] = tracks[best]
            weight = 1.0 / min(track[COUNT] + 1.0, 2.0 * WINDOW)
            radius_m = track[RADIUS] + weight * (segment[SIZE] - track[RADIUS])
        track[RADIUS] = radius_m
        # The nearest hit is sure, how far behind it the centre lies is as sure as the radius.
        away_m = segment[RANGE] + radius_m
        at_x, at_y = x_m + away_m * segment[DIRECTION_X], y_m + away_m * segment[DIRECTION_Y]
        per = put(track, at_x, at_y, away_m, 0.6 * beam_rad * away_m, elapsed_s, unsure_m)
        places = int(track[COUNT])
        if places < 2 or track[MOVES] > 0.0:
            continue
        v_x, v_y = track[V_X], track[V_Y]
        speed_mps = np.sqrt(v_x * v_x + v_y * v_y)
        if len(old_m) == 0:
            continue
        beyond_m = FREE_M + unsure_m
        hits = 0
        width = int(segment[LAST] - segment[FIRST]) % beams + 1
        for number_of in range(width):
            beam = (int(segment[FIRST]) + number_of) % beams
            hit_x = x_m + raw_m[beam] * (ahead * units[beam, 0] - aside * units[beam, 1])
            hit_y = y_m + raw_m[beam] * (aside * units[beam, 0] + ahead * units[beam, 1])
            if was_free(
                old_m, bounds, old_pose[0], old_pose[1], old_pose[2], old_pose[3],
                hit_x, hit_y, beyond_m,
            ):  # fmt: skip
                hits += 1
        oldest = PLACES + 3 * (places - 1)
        left = was_free(
            raw_m, bounds, x_m, y_m, ahead, aside, track[oldest + 1], track[oldest + 2], beyond_m
        )
        if hits >= EVIDENCE_HITS or left:
            track[EVIDENCE] += 1.0
        error_mps = (0.3 * beam_rad * away_m + unsure_m / 3.0) * np.sqrt(per)
        if (
            places >= COUNT_MIN
            and track[EVIDENCE] >= EVIDENCE_TICKS
            and speed_mps > SPEED_MPS + 2.0 * error_mps
        ):
            track[MOVES] = 1.0
    # Those not seen go on.
    for index in range(known):
        if taken[index]:
            continue
        missed = tracks[index, MISSED] + 1.0
        moves = tracks[index, MOVES] > 0.0
        if count >= TRACKS_MAX and not moves:
            continue
        if missed > (LOST_TICKS if moves else GONE_TICKS):
            continue
        at_x = tracks[index, X] + elapsed_s * tracks[index, V_X]
        at_y = tracks[index, Y] + elapsed_s * tracks[index, V_Y]
        if missed > GONE_TICKS and was_free(
            raw_m, bounds, x_m, y_m, ahead, aside, at_x, at_y, tracks[index, RADIUS]
        ):
            continue
        track = result[count]
        count += 1
        track[:] = tracks[index]
        track[X], track[Y], track[MISSED] = at_x, at_y, missed
        for place in range(int(track[COUNT])):
            track[PLACES + 3 * place] += elapsed_s
    if count <= TRACKS_MAX:
        return result[:count]
    # What moves is never forgotten for the sake of what stands.
    kept = np.empty((TRACKS_MAX, COLUMNS))
    chosen = 0
    for moves in (True, False):
        for index in range(count):
            if (result[index, MOVES] > 0.0) == moves and chosen < TRACKS_MAX:
                kept[chosen] = result[index]
                chosen += 1
    return kept


@compiled
def put(
    track: Floats,
    at_x: float,
    at_y: float,
    away_m: float,
    blur_m: float,
    elapsed_s: float,
    unsure_m: float,
) -> float:
    """Put a body at its newest place, give it the velocity; 1 / sum of squares, as `line` has it.

    Args:
        track: in place; without places when it is new.
        away_m: from the robot; blur_m: by which places differ without any motion.
    """
    kept = min(int(track[COUNT]), WINDOW - 1)
    for place in range(kept, 0, -1):
        to, at = PLACES + 3 * place, PLACES + 3 * (place - 1)
        track[to] = track[at] + elapsed_s
        track[to + 1], track[to + 2] = track[at + 1], track[at + 2]
    track[COUNT] = kept + 1
    track[MISSED] = 0.0
    track[PLACES], track[PLACES + 1], track[PLACES + 2] = 0.0, at_x, at_y
    if track[COUNT] > COUNT_MIN:
        dx = track[X] + elapsed_s * track[V_X] - at_x
        dy = track[Y] + elapsed_s * track[V_Y] - at_y
        is_near = away_m < NEAR_M and unsure_m == 0.0 and track[MOVES] > 0.0
        off_m = (STRIKE_NEAR_M if is_near else STRIKE_M) + unsure_m + blur_m
        track[STRIKES] = track[STRIKES] + 1.0 if dx * dx + dy * dy > off_m * off_m else 0.0
        if is_near and track[STRIKES] > 0.0:
            track[COUNT] = FRESH - 1
        elif track[STRIKES] >= STRIKES_MAX:
            track[STRIKES] = 0.0
            track[COUNT] = FRESH
    places = int(track[COUNT])
    if places < 2:
        track[X], track[Y], track[V_X], track[V_Y] = at_x, at_y, 0.0, 0.0
        return np.inf
    track[X], track[Y], v_x, v_y, per = line(track, places)
    if places < FRESH and track[MOVES] == 0.0:
        track[X], track[Y], v_x, v_y = at_x, at_y, 0.0, 0.0
    track[V_X], track[V_Y] = v_x, v_y
    stands = v_x * v_x + v_y * v_y < STILL_MPS * STILL_MPS
    if track[MOVES] > 0.0 and places == WINDOW and stands:
        track[MOVES] = track[EVIDENCE] = 0.0
    return per


@compiled
def line(track: Floats, count: int) -> tuple[float, float, float, float, float]:
    """Place now and velocity by least squares over the newest places, and 1 / sum of squares."""
    t_mean = x_mean = y_mean = 0.0
    for place in range(count):
        at = PLACES + 3 * place
        t_mean -= track[at] / count
        x_mean += track[at + 1] / count
        y_mean += track[at + 2] / count
    square = by_x = by_y = 0.0
    for place in range(count):
        at = PLACES + 3 * place
        t = -track[at] - t_mean
        square += t * t
        by_x += t * (track[at + 1] - x_mean)
        by_y += t * (track[at + 2] - y_mean)
    if square <= 0.0:
        return x_mean, y_mean, 0.0, 0.0, np.inf
    v_x, v_y = by_x / square, by_y / square
    return x_mean - v_x * t_mean, y_mean - v_y * t_mean, v_x, v_y, 1.0 / square


@compiled
def was_free(
    ranges_m: Floats,
    bounds: Floats,
    x_m: float,
    y_m: float,
    ahead: float,
    aside: float,
    at_x: float,
    at_y: float,
    beyond_m: float,
) -> bool:
    """Whether three beams side by side of a scan from (x, y) went beyond a place."""
    dx, dy = at_x - x_m, at_y - y_m
    beams = len(ranges_m)
    beam = bin_of(bounds, ahead * dx + aside * dy, ahead * dy - aside * dx)
    before = beam - 1 if beam > 0 else beams - 1
    after = beam + 1 if beam + 1 < beams else 0
    far_m = np.sqrt(dx * dx + dy * dy) + beyond_m
    return bool(ranges_m[before] > far_m and ranges_m[beam] > far_m and ranges_m[after] > far_m)


@compiled
def hide(
    tracks: Floats,
    hits_m: Floats,
    units: Floats,
    x_m: float,
    y_m: float,
    ahead: float,
    aside: float,
    unsure_m: float,
) -> Flags:
    """(beams,) whether a hit lies on what moves."""
    hidden = np.zeros(len(hits_m), dtype=np.bool_)
    for beam in range(len(hits_m)):
        if not hits_m[beam] < 1e6:
            continue
        at_x = x_m + hits_m[beam] * (ahead * units[beam, 0] - aside * units[beam, 1])
        at_y = y_m + hits_m[beam] * (aside * units[beam, 0] + ahead * units[beam, 1])
        for index in range(len(tracks)):
            if tracks[index, MOVES] > 0.0:
                dx, dy = at_x - tracks[index, X], at_y - tracks[index, Y]
                reach_m = tracks[index, RADIUS] + HIDE_M + unsure_m
                if dx * dx + dy * dy < reach_m * reach_m:
                    hidden[beam] = True
    return hidden
