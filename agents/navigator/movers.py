"""What moves and is seen by the lidar only: found in successive scans, as circles with velocities.

    hits --links--> round segments --nearest--> tracks --line through places--> velocity
    hits where a scan before saw nothing --evidence--> it moves, it is not only seen differently

A place where a beam passed through a moment ago and that is occupied now is what no static scene
can show, however its visible parts change with the robot's own motion. Only such tracks count.
They are kept out of the memory, and are peers that give no way to anybody.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import cos, pi, sin

import msgspec
import numpy as np
import numpy.typing as npt

from agents.navigator import memory, table
from agents.navigator.compiled import compiled
from agents.navigator.points import bin_of
from agents.peers import COORDINATE_M_MAX, Peer
from swarm import geometry
from swarm.geometry import Floats, Ranges
from swarm.messages import SensorFrame
from swarm.scenario import RobotSetup

Flags = npt.NDArray[np.bool_]

# Columns of a track: centre and velocity now, world; radius; number of its places; ticks since it
# was seen; whether it moves; ticks with evidence for that; whether it was where it was expected;
# then WINDOW places, newest first: age in s, x, y.
X, Y, V_X, V_Y, RADIUS, COUNT, MISSED, MOVES, EVIDENCE, STRIKES = range(10)
PLACES, WINDOW = 10, 10
COLUMNS = PLACES + 3 * WINDOW
TRACKS_MAX = 40
# Columns of a segment: direction of its middle, world; nearest range; radius; first and last beam.
DIRECTION_X, DIRECTION_Y, RANGE, SIZE, FIRST, LAST = range(6)
SEGMENT_COLUMNS = 6

LINK_M = 0.2  # between hits of one body, and so much more for each m of the beams' spacing
RADIUS_M = (0.04, 0.8)  # of what may move
ROUND_M, ROUND_SHARE = 0.04, 0.25  # hits lie this near to the circle, and by this part of it
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
PAUSE_TICKS = 6  # without a scan: then all is new
SCANS = 6  # that are kept; the oldest one tells what was free
FREE_M = 0.07  # by how much beyond it beams must have gone
EVIDENCE_HITS, EVIDENCE_TICKS = 2, 2
HIDE_M = 0.12  # hits this near to what moves are its own
EDGE_M = 0.2  # within this of the lidar's range a body may go on unseen
PEER_M = 0.35  # what is this near to a peer is a peer
# As peers: it may turn, and its place is not sure; who crosses passes behind it.
ROOM_M, ROOM_S, LEAD_S = 0.12, 0.2, 0.1
SIGHT_M = 5.0


class Scan(msgspec.Struct, frozen=True):
    """One look, as far as it tells what was free."""

    x_m: float
    y_m: float
    ahead: float
    aside: float
    ranges: bytes  # (beams,) float32, as it was sent


class State(msgspec.Struct, frozen=True):
    """Tracks, and scans of before, newest first."""

    tracks: bytes = b""  # (tracks, COLUMNS) float64
    scans: tuple[Scan, ...] = ()
    hidden: bytes = b""  # (beams,) bool: hits on what moves, in the newest scan; none: no hit is
    tick: int = -1  # of that
    moves: int = 0  # tracks that move; mostly there are none, and then nothing is looked at

    def rows(self) -> Floats:
        """Read-only view of all tracks."""
        return np.frombuffer(self.tracks).reshape(-1, COLUMNS)

    def moving(self) -> Floats:
        """(movers, COLUMNS) those that move."""
        if not self.moves:
            return _NO_TRACKS
        rows = self.rows()
        return rows[rows[:, MOVES] > 0.0]

    def without(self, ranges_m: Ranges, tick: int) -> Ranges:
        """The newest scan without what moves; the same array when nothing does."""
        if tick != self.tick or not self.hidden:
            return ranges_m
        left_m = ranges_m.copy()
        left_m[np.frombuffer(self.hidden, dtype=np.bool_)] = np.inf
        left_m.setflags(write=False)
        return left_m


# Where there is nothing; not read-only, which inner loops would take for another type.
_NO_SCAN = Scan(0.0, 0.0, 0.0, 0.0, b"")
_NO_TRACKS: Floats = np.empty((0, COLUMNS))
_NO_BODIES: Floats = np.empty((0, 3))
_NO_ROWS: Floats = np.empty((0, table.COLUMNS))
_NO_MOVERS: Floats = np.empty((0, 5))


@lru_cache(maxsize=32)
def _half_beam(count: int) -> tuple[float, float]:
    """Cosine and sine of half the angle between two beams."""
    return cos(pi / count), sin(pi / count)


def step(
    setup: RobotSetup,
    state: State,
    frame: SensorFrame,
    hits_m: Ranges,
    others: Sequence[Peer],
    elapsed_s: float,
) -> State:
    """State after one scan.

    Args:
        frame: as it was measured.
        hits_m: (beams,) without peers.
    """
    if max(abs(frame.pose.x_m), abs(frame.pose.y_m)) > COORDINATE_M_MAX:
        return State()
    if frame.tick - state.tick > PAUSE_TICKS:
        state = State()
    pose = frame.pose
    ahead, aside = geometry.unit(pose.yaw_rad)
    rays = memory.beams(len(hits_m))
    noise = setup.disturbance
    # 3 sigma of whatever is declared, at some range: two scans differ by that without any motion
    unsure_m = 3.0 * (
        noise.range_sigma_m + 2.0 * noise.position_sigma_m + 4.0 * noise.yaw_sigma_rad
    )
    range_m = setup.sensor.range_m
    bodies = _NO_BODIES
    if others and (
        near := [
            (pose.x_m + one.offset[0], pose.y_m + one.offset[1], one.beacon.body_radius_m + PEER_M)
            for one in others
            if one.distance_m < range_m + 1.0
        ]
    ):
        bodies = np.array(near)
    old = state.scans[-1] if len(state.scans) >= SCANS - 1 else _NO_SCAN
    tracks, moves, hidden = watch(
        frame.ranges_m(), hits_m, rays.units, rays.bounds, pose.x_m, pose.y_m, ahead, aside,
        *_half_beam(len(hits_m)), bodies, unsure_m, range_m, float(np.float32(range_m)),
        state.rows(), elapsed_s,
        np.frombuffer(old.ranges, dtype=np.float32), old.x_m, old.y_m, old.ahead, old.aside,
    )  # fmt: skip
    scan = Scan(pose.x_m, pose.y_m, ahead, aside, frame.ranges.data)
    return State(
        tracks.tobytes(), (scan, *state.scans)[:SCANS], hidden.tobytes(), frame.tick, moves
    )


def trail(before: State, now: State) -> Floats:
    """(places, 3) m: x, y, radius, world: where what moves has been seen lately; kept small.

    All of its window when it has just been found out, else where it is.
    """
    if not now.moves:
        return _NO_BODIES
    moving = now.moving()
    known = before.moving()
    found: list[tuple[float, float, float]] = []
    for row in moving:
        radius_m = float(row[RADIUS]) + HIDE_M
        if row[MISSED] == 0.0:
            found.append((float(row[X]), float(row[Y]), radius_m))
        reach_m = radius_m + GATE_M
        if any(abs(one[X] - row[X]) + abs(one[Y] - row[Y]) < reach_m for one in known):
            continue
        for place in range(int(row[COUNT])):
            at = PLACES + 3 * place
            found.append((float(row[at + 1]), float(row[at + 2]), radius_m))
    return np.array(found).reshape(-1, 3)


def as_peers(state: State, x_m: float, y_m: float, after_s: float) -> Floats:
    """Rows of `table` from a place, after some time.

    Their circles reach ahead of them, so that the cheaper way is the one behind.
    """
    if not state.moves:
        return _NO_ROWS
    rows: list[tuple[float, ...]] = []
    for row in state.moving():
        v_x, v_y = float(row[V_X]), float(row[V_Y])
        speed_mps = geometry.length(v_x, v_y)
        off_x = float(row[X]) + v_x * (after_s + LEAD_S) - x_m
        off_y = float(row[Y]) + v_y * (after_s + LEAD_S) - y_m
        if geometry.length(off_x, off_y) > SIGHT_M:
            continue
        radius_m = float(row[RADIUS]) + ROOM_M + ROOM_S * speed_mps
        rows.append(
            (off_x, off_y, v_x, v_y, 0.0, 0.0, speed_mps, radius_m, 0.0, 1.0, table.LAWLESS)
        )
    return np.array(rows) if rows else _NO_ROWS


def ahead(state: State, x_m: float, y_m: float, after_s: float) -> Floats:
    """(movers, 5) x, y, m, from a place after some time; velocity, m/s; radius."""
    if not state.moves:
        return _NO_MOVERS
    moving = state.moving()
    found = np.empty((len(moving), 5))
    found[:, 0] = moving[:, X] + after_s * moving[:, V_X] - x_m
    found[:, 1] = moving[:, Y] + after_s * moving[:, V_Y] - y_m
    found[:, 2:4] = moving[:, V_X : V_Y + 1]
    found[:, 4] = moving[:, RADIUS]
    return found


# --- inner loops --------------------------------------------------------------------------------


@compiled
def watch(
    seen_m: Ranges,
    hits_m: Ranges,
    units: Floats,
    bounds: Floats,
    x_m: float,
    y_m: float,
    ahead: float,
    aside: float,
    cosine: float,
    sine: float,
    bodies: Floats,
    unsure_m: float,
    range_m: float,
    clear_m: float,
    tracks: Floats,
    elapsed_s: float,
    old_m: Ranges,
    old_x: float,
    old_y: float,
    old_ahead: float,
    old_aside: float,
) -> tuple[Floats, int, Flags]:
    """Tracks after a scan, how many move, (beams,) hits that lie on these; empty: none does.

    Args:
        seen_m: (beams,) all hits; hits_m: those of obstacles.
        clear_m: the lidar's range, of which beyond no beam tells what is free.
        old_m: (beams,) scan of before, perhaps empty, and from where.
    """
    beams = len(hits_m)
    raw_m = np.empty(beams)
    far_m = np.empty(beams)
    for beam in range(beams):
        seen = float(seen_m[beam])
        raw_m[beam] = clear_m if seen > clear_m else seen
        far_m[beam] = float(hits_m[beam])
    found = segments(
        raw_m, far_m, units, x_m, y_m, ahead, aside, cosine, sine, bodies, unsure_m, range_m
    )
    # The old scan tells something of segments only.
    before_m = np.empty(len(old_m) if len(found) > 0 else 0)
    for beam in range(len(before_m)):
        seen = float(old_m[beam])
        before_m[beam] = clear_m if seen > clear_m else seen
    result = follow(
        tracks, found, raw_m, units, bounds, x_m, y_m, ahead, aside, 2.0 * sine, elapsed_s,
        unsure_m, before_m, np.array((old_x, old_y, old_ahead, old_aside)),
    )  # fmt: skip
    moves = 0
    for index in range(len(result)):
        if result[index, MOVES] > 0.0:
            moves += 1
    hidden = np.zeros(0, dtype=np.bool_)
    if moves > 0:
        on = hide(result, far_m, units, x_m, y_m, ahead, aside, unsure_m)
        for beam in range(beams):
            if on[beam]:
                hidden = on
                break
    return result, moves, hidden


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
    """(segments, SEGMENT_COLUMNS) round ones that nothing hides in part.

    Args:
        raw_m: (beams,) all hits; hits_m: those of obstacles.
        units: (beams, 2) body frame.
        cosine, sine: of half the angle between beams.
        bodies: (peers, 3) x, y, m, world, and how near to them nothing counts.
    """
    beams = len(hits_m)
    found = np.empty((TRACKS_MAX, SEGMENT_COLUMNS))
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
    while step < beams and count < TRACKS_MAX:
        first = (start + step) % beams
        step += 1
        if not hits_m[first] < 1e6:
            continue
        last = first
        width = 1
        while step < beams:
            after = (start + step) % beams
            if not _linked(hits_m, units, last, after, sine):
                break
            last = after
            width += 1
            step += 1
        if width < 3 or width > beams // 3:
            continue
        # Nothing nearer may hide a part of it, nor may it reach out of sight.
        before = first - 1 if first > 0 else beams - 1
        after = last + 1 if last + 1 < beams else 0
        if raw_m[before] < hits_m[first] or raw_m[after] < hits_m[last]:
            continue
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
            keep_m = bodies[body, 2] + radius_m
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
def follow(
    tracks: Floats,
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
        old_m: (beams,) scan of before, perhaps empty; old_pose: (4,) x, y, cosine, sine.
    """
    known = len(tracks)
    result = np.zeros((known + len(found), COLUMNS))
    taken = np.zeros(known, dtype=np.bool_)
    count = 0
    beams = len(raw_m)
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
            kept = min(int(track[COUNT]), WINDOW - 1)
            for place in range(kept, 0, -1):
                to, at = PLACES + 3 * place, PLACES + 3 * (place - 1)
                track[to] = track[at] + elapsed_s
                track[to + 1], track[to + 2] = track[at + 1], track[at + 2]
            track[COUNT] = kept + 1
        else:
            track[COUNT] = 1
        track[RADIUS] = radius_m
        track[MISSED] = 0.0
        # The nearest hit is sure, how far behind it the centre lies is as sure as the radius.
        away_m = segment[RANGE] + radius_m
        at_x, at_y = x_m + away_m * segment[DIRECTION_X], y_m + away_m * segment[DIRECTION_Y]
        track[PLACES], track[PLACES + 1], track[PLACES + 2] = 0.0, at_x, at_y
        if best >= 0 and track[COUNT] > COUNT_MIN:
            dx = track[X] + elapsed_s * track[V_X] - at_x
            dy = track[Y] + elapsed_s * track[V_Y] - at_y
            is_near = away_m < NEAR_M and unsure_m == 0.0 and track[MOVES] > 0.0
            off_m = (STRIKE_NEAR_M if is_near else STRIKE_M) + unsure_m + 0.6 * beam_rad * away_m
            track[STRIKES] = track[STRIKES] + 1.0 if dx * dx + dy * dy > off_m * off_m else 0.0
            if is_near and track[STRIKES] > 0.0:
                track[COUNT] = FRESH - 1
            elif track[STRIKES] >= STRIKES_MAX:
                track[STRIKES] = 0.0
                track[COUNT] = FRESH
        places = int(track[COUNT])
        if places < 2:
            track[X], track[Y], track[V_X], track[V_Y] = at_x, at_y, 0.0, 0.0
            continue
        track[X], track[Y], v_x, v_y, per = line(track, places)
        if places < FRESH and track[MOVES] == 0.0:
            track[X], track[Y], v_x, v_y = at_x, at_y, 0.0, 0.0
        track[V_X], track[V_Y] = v_x, v_y
        speed_mps = np.sqrt(v_x * v_x + v_y * v_y)
        if track[MOVES] > 0.0:
            if places == WINDOW and speed_mps < STILL_MPS:
                track[MOVES] = track[EVIDENCE] = 0.0
            continue
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
        if taken[index] or count >= TRACKS_MAX:
            continue
        missed = tracks[index, MISSED] + 1.0
        moves = tracks[index, MOVES] > 0.0
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
    return result[: min(count, TRACKS_MAX)]


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
