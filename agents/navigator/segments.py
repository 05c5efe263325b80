"""Hits that follow each other on something round: what might move, as one scan shows it.

hits --links--> runs of beams --round, in full sight--> segments
"""

from __future__ import annotations

import numpy as np

from agents.navigator.compiled import compiled
from swarm.geometry import Floats

# Columns of a segment: direction of its middle, world; nearest range; radius; first and last beam.
DIRECTION_X, DIRECTION_Y, RANGE, SIZE, FIRST, LAST = range(6)
COLUMNS = 6
SEGMENTS_MAX = 40  # of a scan; those behind are not looked at

LINK_M = 0.2  # between hits of one body, and so much more for each m of the beams' spacing
RADIUS_M = (0.04, 0.8)  # of what may move
ROUND_M, ROUND_SHARE = 0.04, 0.25  # hits lie this near to the circle, and by this part of it
KINK_M = 0.02  # hits this far behind the chord of those beside them: two bodies meet there
# Of what is hidden in part, or touches another: hits, how far these may be off the circle, and how
# many times a hit's error they must bulge to tell the radius.
ARC_HITS, ARC_OFF_M, HIT_M, BULGES = 5, 0.006, 0.004, 6.0
EDGE_M = 0.2  # within this of the lidar's range a body may go on unseen


@compiled
def segments(
    raw_m: Floats,
    hits_m: Floats,
    units: Floats,
    x_m: float,
    y_m: float,
    ahead: float,
    aside: float,
    cosine: float,
    sine: float,
    bodies: Floats,
    unsure_m: float,
    range_m: float,
) -> Floats:
    """(segments, COLUMNS) round ones; what is hidden in part must be an arc of a circle.

    Args:
        raw_m: (beams,) all hits; hits_m: those of obstacles.
        units: (beams, 2) body frame.
        cosine, sine: of half the angle between beams.
        bodies: (peers, 3) x, y, m, world, and how near to these no middle of anything else lies.
    """
    beams = len(hits_m)
    found = np.empty((SEGMENTS_MAX, COLUMNS))
    count = 0
    start = -1
    for beam in range(beams):
        before = beam - 1 if beam > 0 else beams - 1
        if not _linked(hits_m, units, before, beam, sine):
            start = beam
            break
    if start < 0:
        return found[:0]
    step = 0
    arc = np.empty(3)
    cut = False  # the run of before ended at a body that it touches
    while step < beams and count < SEGMENTS_MAX:
        first = (start + step) % beams
        step += 1
        if not hits_m[first] < 1e6:
            continue
        last = first
        width = 1
        touches, cut = cut, False
        while step < beams:
            after = (start + step) % beams
            if not _linked(hits_m, units, last, after, sine):
                break
            if width > 1:
                turn = _kink(hits_m, units, last - 1 if last > 0 else beams - 1, last, after)
                if abs(turn) > KINK_M + unsure_m:
                    cut = touches = True
                    if turn < 0.0:  # it begins with this hit already
                        last = last - 1 if last > 0 else beams - 1
                        width -= 1
                        step -= 1
                    break
            last = after
            width += 1
            step += 1
        if width < 3 or width > beams // 3:
            continue
        # Nothing nearer may hide a part of it, nor may it reach out of sight.
        before = first - 1 if first > 0 else beams - 1
        after = last + 1 if last + 1 < beams else 0
        hidden = not (raw_m[before] >= hits_m[first] and raw_m[after] >= hits_m[last])
        if hidden or touches:  # or nothing is known of a beam beside it
            if not _arc(hits_m, units, first, width, unsure_m, arc):
                continue
            radius_m = arc[2]
            centre_m = np.sqrt(arc[0] * arc[0] + arc[1] * arc[1])
            middle_x, middle_y = arc[0] / centre_m, arc[1] / centre_m
            near_m = centre_m - radius_m
        else:
            if max(hits_m[first], hits_m[last]) > range_m - EDGE_M:
                continue
            middle_x, middle_y = units[first, 0] + units[last, 0], units[first, 1] + units[last, 1]
            scale = np.sqrt(middle_x * middle_x + middle_y * middle_y)
            middle_x, middle_y = middle_x / scale, middle_y / scale
            across = abs(units[first, 0] * middle_y - units[first, 1] * middle_x)
            along = units[first, 0] * middle_x + units[first, 1] * middle_y
            half = across * cosine + along * sine
            if half > 0.9:
                continue
            near_m = np.inf
            for number in range(width):
                near_m = min(near_m, hits_m[(first + number) % beams])
            radius_m = near_m * half / (1.0 - half)
            if radius_m < RADIUS_M[0] or radius_m > RADIUS_M[1]:
                continue
            centre_m = near_m + radius_m
            off_m = 0.0
            for number in range(width):
                beam = (first + number) % beams
                dx = hits_m[beam] * units[beam, 0] - centre_m * middle_x
                dy = hits_m[beam] * units[beam, 1] - centre_m * middle_y
                off_m += abs(np.sqrt(dx * dx + dy * dy) - radius_m)
            if off_m > width * (ROUND_M + unsure_m + ROUND_SHARE * radius_m):
                continue
        world_x = ahead * middle_x - aside * middle_y
        world_y = aside * middle_x + ahead * middle_y
        is_peer = False
        for body in range(len(bodies)):
            dx = x_m + centre_m * world_x - bodies[body, 0]
            dy = y_m + centre_m * world_y - bodies[body, 1]
            keep_m = bodies[body, 2]
            if dx * dx + dy * dy < keep_m * keep_m:
                is_peer = True
        if is_peer:
            continue
        found[count, DIRECTION_X], found[count, DIRECTION_Y] = world_x, world_y
        found[count, RANGE], found[count, SIZE] = near_m, radius_m
        found[count, FIRST], found[count, LAST] = first, last
        count += 1
    return found[:count]


@compiled
def _linked(hits_m: Floats, units: Floats, one: int, other: int, sine: float) -> bool:
    """Whether two beams that follow each other hit the same body."""
    if not (hits_m[one] < 1e6 and hits_m[other] < 1e6):
        return False
    dx = hits_m[one] * units[one, 0] - hits_m[other] * units[other, 0]
    dy = hits_m[one] * units[one, 1] - hits_m[other] * units[other, 1]
    link_m = LINK_M + 2.0 * sine * min(hits_m[one], hits_m[other])
    return bool(dx * dx + dy * dy < link_m * link_m)


@compiled
def _kink(hits_m: Floats, units: Floats, one: int, two: int, three: int) -> float:
    """How far the middle one of three hits lies behind the chord of the others, 0: before it.

    Negative when it lies nearer to the third: it is the first one of the body there.
    """
    x, y = hits_m[two] * units[two, 0], hits_m[two] * units[two, 1]
    from_x, from_y = x - hits_m[one] * units[one, 0], y - hits_m[one] * units[one, 1]
    to_x, to_y = hits_m[three] * units[three, 0] - x, hits_m[three] * units[three, 1] - y
    area = from_x * to_y - from_y * to_x
    if area <= 0.0:
        return 0.0
    chord_x, chord_y = from_x + to_x, from_y + to_y
    depth_m = area / np.sqrt(chord_x * chord_x + chord_y * chord_y)
    nearer = to_x * to_x + to_y * to_y < from_x * from_x + from_y * from_y
    return float(-depth_m if nearer else depth_m)


@compiled
def _arc(
    hits_m: Floats, units: Floats, first: int, width: int, unsure_m: float, arc: Floats
) -> bool:
    """Whether a run of hits is an arc of a circle: its centre, body frame, and radius into `arc`.

    Kasa 1976: least squares of x^2 + y^2 - 2 x a - 2 y b - c, from the hits' own middle.
    """
    if width < ARC_HITS:
        return False
    beams = len(hits_m)
    x_mean = y_mean = 0.0
    for number in range(width):
        beam = (first + number) % beams
        x_mean += hits_m[beam] * units[beam, 0] / width
        y_mean += hits_m[beam] * units[beam, 1] / width
    xx = xy = yy = xz = yz = 0.0
    for number in range(width):
        beam = (first + number) % beams
        x, y = hits_m[beam] * units[beam, 0] - x_mean, hits_m[beam] * units[beam, 1] - y_mean
        square = x * x + y * y
        xx += x * x
        xy += x * y
        yy += y * y
        xz += 0.5 * x * square
        yz += 0.5 * y * square
    determinant = xx * yy - xy * xy
    if determinant <= 0.0:
        return False
    a, b = (yy * xz - xy * yz) / determinant, (xx * yz - xy * xz) / determinant
    radius_m = np.sqrt(a * a + b * b + (xx + yy) / width)
    if radius_m < RADIUS_M[0] or radius_m > RADIUS_M[1]:
        return False
    if (a + x_mean) * x_mean + (b + y_mean) * y_mean < x_mean * x_mean + y_mean * y_mean:
        return False  # it is hollow
    last = (first + width - 1) % beams
    x = hits_m[last] * units[last, 0] - hits_m[first] * units[first, 0]
    y = hits_m[last] * units[last, 1] - hits_m[first] * units[first, 1]
    if x * x + y * y < 8.0 * radius_m * BULGES * (HIT_M + unsure_m / 3.0):
        return False
    for number in range(width):
        beam = (first + number) % beams
        x, y = (
            hits_m[beam] * units[beam, 0] - x_mean - a,
            hits_m[beam] * units[beam, 1] - y_mean - b,
        )
        if abs(np.sqrt(x * x + y * y) - radius_m) > ARC_OFF_M + unsure_m:
            return False
    arc[0], arc[1], arc[2] = a + x_mean, b + y_mean, radius_m
    return True
