"""Which set-point is admitted: half-planes between announced braking ways, instant by instant.

    own and peers' announced ways --> normals, bounds --first part of what is asked--> set-point

All of it are inner loops; `pact` says what goes in.
"""

from __future__ import annotations

import numpy as np

from agents.navigator import announce, brake
from agents.navigator.brake import slower
from agents.navigator.compiled import compiled
from agents.navigator.pledge import OFF_M, keep
from swarm.geometry import Floats

# Two that can get no nearer than this by what they do now leave each other free.
FREE_M = 0.4
# Places may differ by rounding from what was announced.
ROUNDING_M = 1e-9
# Of what is free each may use its part, the one that drives towards the other more, but no more
# than that; equal parts where neither is faster towards the other than the other by much.
EVEN, MOST, EVEN_MPS = 0.5, 0.6, 0.1
# Part of what is surely free that may be used when nothing was heard. The peer may have heard and
# use MOST of it: what both leave is surely left.
UNHEARD = 0.25
LEFT = 1.0 - MOST - UNHEARD

PROMISED, STATIC = 0.0, 1.0
# Columns of a peer after those of `announce.path`
AGE, KIND, FRESH, RADIUS, FASTEST = (announce.COLUMNS + column for column in range(5))
BY_NONE, BY_OBSTACLE = -1, -2
# One that stops at once instead, as a body does without a mind or without motors, is not touched
# by so much.
SUDDEN_M = 0.012


@compiled
def reached(
    v_mps: float,
    w_radps: float,
    set_v_mps: float,
    set_w_radps: float,
    change: Floats,
    most: Floats,
    half_track_m: float,
) -> tuple[float, float]:
    """Rates after a tick under a set-point: bounds, accelerations, rims; as the world has it.

    Args:
        change: (2,) greatest change of both rates in a tick.
        most: (3,) forwards, backwards, turning.
    """
    v = max(-most[1], min(most[0], set_v_mps))
    w = max(-most[2], min(most[2], set_w_radps))
    v = max(v_mps - change[0], min(v_mps + change[0], v))
    w = max(w_radps - change[1], min(w_radps + change[1], w))
    rim_mps = abs(v) + half_track_m * abs(w)
    if rim_mps > most[0]:
        scale = most[0] / rim_mps
        v *= scale
        w *= scale
    return v, w


@compiled
def admit(
    body: Floats,
    start: Floats,
    body_doubts: Floats,
    start_doubts: Floats,
    sent: Floats,
    sent_count: int,
    limits: Floats,
    asked_v_mps: float,
    asked_w_radps: float,
    peers: Floats,
    slack: Floats,
    points: Floats,
    faster: float,
    errors: Floats,
    parts: Floats,
    result: Floats,
) -> None:
    """First part of what is asked for whose braking way is admitted, else braking as announced.

    Args:
        body: (COLUMNS,) of `announce.path`: as its wheels say since what it announced.
        start: likewise, corrected by what was measured: what it announces if it goes on.
        body_doubts, start_doubts: (6,) of `keep` for both.
        sent: (n, COLUMNS) own beacons of the last ticks, newest first; `sent_count` of them.
        limits: of `brake.limits`.
        peers: (peers, COLUMNS + 5): AGE in ticks, KIND, FRESH: heard since the last tick, RADIUS,
            FASTEST.
        slack: (peers, ticks) m, surely free at the coming ticks, negative where nothing is known;
            filled with what is after this tick.
        points: (points, 2) m from `start`, world axes: obstacles.
        faster: so many times as far as announced the body may get before obstacles.
        errors: of `pledge.shown_errors`.
        result: (5,) v, omega, part, by whom it is less than one, whether from `start`.
    """
    ticks = slack.shape[1]
    count = peers.shape[0]
    dt_s, radius_m = limits[brake.DT], limits[brake.BODY]
    most, change = limits[: brake.V_CHANGE], limits[brake.V_CHANGE : brake.BRAKES]

    # Own braking way as announced; where the body is not on it, the one from where it is.
    own = np.empty((max(1, sent_count), ticks, 2))
    keeps_m = np.empty(max(1, sent_count))
    for age in range(sent_count):
        announce.path(sent[age], dt_s, age + 1, own[age])
        keeps_m[age] = sent[age, announce.KEEP]
    on_way = False
    if sent_count > 0:
        now = np.empty((1, 2))
        announce.path(sent[0], dt_s, 0, now)
        off_x, off_y = now[0, 0] - body[0], now[0, 1] - body[1]
        on_way = off_x * off_x + off_y * off_y <= OFF_M * OFF_M
    v, w = slower(body[4], body[5], body[6], body[7])
    trial = body.copy()
    if not on_way:
        trial[4], trial[5] = v, w
        announce.path(trial, dt_s, 0, own[0])
        keeps_m[0] = keep(trial, body_doubts, dt_s)
    result[0], result[1], result[2], result[3], result[4] = v, w, 0.0, BY_NONE, 0.0

    # What each peer allows at each tick: along a normal, or in all directions.
    normals = np.zeros((count, ticks, 2))
    bounds = np.empty((count, ticks))
    # Half the angle of the cone about the normal in which that is which now counts: its sine.
    sines = np.zeros((count, ticks))
    moved = np.empty(announce.TICKS_MAX)
    place = np.empty((ticks, 2))
    for peer in range(count):
        age = int(peers[peer, AGE])
        static = peers[peer, KIND] == STATIC
        announce.path(peers[peer, : announce.COLUMNS], dt_s, age, place)
        back = age - 1
        known = on_way and back < sent_count
        part = EVEN if static or sent_count == 0 else share(sent[0], peers[peer])
        if back > 0:
            changed(peers[peer], errors, dt_s, moved)
        for tick in range(ticks):
            if static:
                x_m, y_m = place[tick, 0] - body[0], place[tick, 1] - body[1]
            elif age == 1 or not known:
                x_m, y_m = place[tick, 0] - own[0, tick, 0], place[tick, 1] - own[0, tick, 1]
            else:
                x_m = place[tick, 0] - own[back, tick, 0]
                y_m = place[tick, 1] - own[back, tick, 1]
            apart_m = np.sqrt(x_m * x_m + y_m * y_m)
            free_m = apart_m - peers[peer, announce.KEEP] - keeps_m[back if known else 0]
            free_m = max(0.0, free_m)
            if static or age == 1:
                bounds[peer, tick] = part * free_m
                if apart_m > 0.0:
                    normals[peer, tick, 0] = x_m / apart_m
                    normals[peer, tick, 1] = y_m / apart_m
            else:
                least_m = max(0.0, slack[peer, tick]) if on_way else 0.0
                if known and (peers[peer, FRESH] > 0.0 or slack[peer, tick] < 0.0):
                    late_m = min(free_m, FREE_M)
                    for _ in range(back):
                        late_m *= LEFT
                    least_m = max(least_m, late_m)
                bounds[peer, tick] = UNHEARD * least_m
                x_m, y_m = place[tick, 0] - own[0, tick, 0], place[tick, 1] - own[0, tick, 1]
                apart_m = np.sqrt(x_m * x_m + y_m * y_m)
                sines[peer, tick] = 1.0
                moved_m = back * moved[min(tick + back, announce.TICKS_MAX) - 1]
                if on_way and moved_m < apart_m:
                    sines[peer, tick] = moved_m / apart_m
                    normals[peer, tick, 0] = x_m / apart_m
                    normals[peer, tick, 1] = y_m / apart_m

    # Obstacles within reach of the fastest braking way.
    fastest_mps = faster * (max(abs(body[4]), abs(asked_v_mps)) + change[0])
    # No nearer to them than this, or than they are now.
    room_m = brake.room_of(points, radius_m, limits[brake.MARGIN])
    reach_m = room_m + fastest_mps * dt_s * 2.0
    reach_m += fastest_mps * fastest_mps * dt_s / (2.0 * faster * body[6])
    near = np.empty((points.shape[0], 2))
    keeps2_m2 = np.empty(points.shape[0])
    nears = 0
    for point in range(points.shape[0]):
        x_m, y_m = points[point, 0] + start[0], points[point, 1] + start[1]
        to_x, to_y = x_m - start[0], y_m - start[1]
        apart2_m2 = to_x * to_x + to_y * to_y
        if apart2_m2 < reach_m * reach_m:
            near[nears, 0], near[nears, 1] = x_m, y_m
            keeps2_m2[nears] = min(room_m * room_m, apart2_m2 - 1e-9)
            nears += 1

    # Where each peer heard just now is if it brakes as hard as it can instead, and how near may be
    # come to that: no nearer than would touch, or than what was announced comes anyway.
    sudden = np.empty((count, ticks, 2))
    touches2_m2 = np.zeros((count, ticks))
    for peer in range(count):
        if peers[peer, KIND] == STATIC or peers[peer, AGE] != 1.0:
            continue
        hard = peers[peer, : announce.COLUMNS].copy()
        hard[6] /= brake.BRAKES_SHARE
        hard[4], hard[5] = slower(hard[4], hard[5], hard[6], hard[7])
        announce.path(hard, dt_s, 1, sudden[peer])
        for tick in range(ticks):
            x_m = sudden[peer, tick, 0] - own[0, tick, 0]
            y_m = sudden[peer, tick, 1] - own[0, tick, 1]
            touch_m = radius_m + peers[peer, RADIUS] + SUDDEN_M
            touches2_m2[peer, tick] = min(touch_m * touch_m, x_m * x_m + y_m * y_m - 1e-9)

    way = np.empty((ticks, 2))
    longer = np.empty((ticks, 2))
    # From the corrected pose first; where that is nearer to a peer than may be nothing at all is
    # admitted from there, and the robot goes on from where its wheels say that it is.
    corrected = False
    for column in range(4):
        corrected = corrected or start[column] != body[column]
    last = parts.shape[0]
    tries = 2 * last if corrected else last
    blamed = BY_NONE
    for number in range(tries + 1):
        # The last one stands for braking: it is what was announced, and taken come what may.
        part = parts[number % last] if number < tries else 0.0
        if number < tries:
            set_v_mps, half_track_m = part * asked_v_mps, limits[brake.HALF_TRACK]
            v, w = reached(body[4], body[5], set_v_mps, asked_w_radps, change, most, half_track_m)
        else:
            v, w = slower(body[4], body[5], body[6], body[7])
        corrects = number < last
        for column in range(4):
            trial[column] = start[column] if corrects else body[column]
        trial[4], trial[5] = v, w
        announce.path(trial, dt_s, 0, way)
        keep_m = keep(trial, start_doubts if corrects else body_doubts, dt_s)
        more_m = keep_m - keeps_m[0]
        if number < tries:
            by = refused_by_peers(way, body, own[0], more_m, peers, normals, bounds, sines)
            if by == BY_NONE:
                by = refused_by_sudden(way, sudden, touches2_m2)
            if by == BY_NONE and nears > 0:
                if faster == 1.0 and corrects:
                    longer[:] = way
                else:  # obstacles are where they are seen from the corrected pose
                    for column in range(4):
                        trial[column] = start[column]
                    for column in range(4, announce.COLUMNS):
                        trial[column] *= faster
                    announce.path(trial, dt_s, 0, longer)
                    for column in range(6, announce.COLUMNS):
                        trial[column] = body[column]
                by = refused_by_points(longer, start, near[:nears], keeps2_m2)
            if by != BY_NONE:
                if blamed == BY_NONE:
                    blamed = by
                continue
        result[0], result[1], result[2], result[3] = v, w, part, blamed
        result[4] = 1.0 if corrects else 0.0
        break

    # What is surely free from now on.
    for peer in range(count):
        age = int(peers[peer, AGE])
        for tick in range(ticks):
            x_m, y_m = way[tick, 0] - own[0, tick, 0], way[tick, 1] - own[0, tick, 1]
            if age == 1:
                left_m = bounds[peer, tick]
                used_m = normals[peer, tick, 0] * x_m + normals[peer, tick, 1] * y_m
            else:
                left_m = (1.0 - MOST) / UNHEARD * bounds[peer, tick]
                used_m = used(x_m, y_m, normals[peer, tick], sines[peer, tick])
            slack[peer, tick] = max(0.0, left_m - used_m - more_m)


@compiled
def share(mine: Floats, theirs: Floats) -> float:
    """Part of what is free between two announced ways that the first one may use, of 1.

    Whoever drives towards the other needs more of it than who drives away: a follower may come
    nearer than two that meet. Both know both beacons, so the parts of both are 1 together.

    Args:
        mine, theirs: (COLUMNS,) of `announce.path`, announced in the same tick.
    """
    x_m, y_m = theirs[0] - mine[0], theirs[1] - mine[1]
    apart_m = np.sqrt(x_m * x_m + y_m * y_m)
    if apart_m <= 0.0:
        return EVEN
    here_mps = mine[4] * (mine[2] * x_m + mine[3] * y_m) / apart_m
    there_mps = -theirs[4] * (theirs[2] * x_m + theirs[3] * y_m) / apart_m
    here_mps, there_mps = max(0.0, here_mps) + EVEN_MPS, max(0.0, there_mps) + EVEN_MPS
    return float(max(1.0 - MOST, min(MOST, here_mps / (here_mps + there_mps))))


@compiled
def used(x_m: float, y_m: float, normal: Floats, sine: float) -> float:
    """How far a move leads along that direction of a cone about a normal along which it leads most.

    Args:
        sine: of half the angle of the cone; 1: all directions.
    """
    length2_m2 = x_m * x_m + y_m * y_m
    if sine >= 1.0:
        return float(np.sqrt(length2_m2))
    cosine = np.sqrt(1.0 - sine * sine)
    along_m = normal[0] * x_m + normal[1] * y_m
    aside_m = abs(normal[0] * y_m - normal[1] * x_m)
    if along_m > 0.0 and along_m * sine >= aside_m * cosine:  # it is inside
        return float(np.sqrt(length2_m2))
    return float(cosine * along_m + sine * aside_m)


@compiled
def changed(row: Floats, errors: Floats, dt_s: float, moved: Floats) -> None:
    """How far a peer's next announced way can at most lie off the one before, at each tick.

    Both begin at one place but for errors of both poses shown, of the way of one tick, which turns
    by no more than a radian, and for bodies off their ways; motors speed up no faster than they
    brake. The faster of both is no faster than the peer's top speed and braking from it allow.

    Args:
        row: of `admit`.
        errors: of `pledge.shown_errors`.
        moved: (TICKS_MAX,) m, filled.
    """
    change_mps = row[6] + row[6] / brake.BRAKES_SHARE
    change_radps = 2.0 * row[7]
    off_m = 2.0 * (errors[0] + errors[2] * row[FASTEST] * dt_s) + 2.0 * OFF_M
    jump_rad = 2.0 * errors[1] + errors[2]
    for tick in range(moved.shape[0]):
        v_mps = row[FASTEST] - tick * row[6]
        if v_mps > 0.0:
            off_rad = jump_rad + change_radps * dt_s * (tick + 1)
            off_m += dt_s * min(2.0 * v_mps, change_mps + v_mps * off_rad)
        moved[tick] = off_m


@compiled
def refused_by_peers(
    way: Floats,
    body: Floats,
    own: Floats,
    more_m: float,
    peers: Floats,
    normals: Floats,
    bounds: Floats,
    sines: Floats,
) -> int:
    """Row of the peer that a braking way comes too near to, or BY_NONE.

    Args:
        more_m: room that it keeps beyond what was announced.
    """
    for peer in range(peers.shape[0]):
        static = peers[peer, KIND] == STATIC
        for tick in range(way.shape[0]):
            x_m, y_m = way[tick, 0], way[tick, 1]
            if static:
                x_m -= body[0]
                y_m -= body[1]
            else:
                x_m -= own[tick, 0]
                y_m -= own[tick, 1]
            bound_m = bounds[peer, tick] + ROUNDING_M - more_m
            if static or peers[peer, AGE] == 1.0:
                if normals[peer, tick, 0] * x_m + normals[peer, tick, 1] * y_m > bound_m:
                    return peer
            elif used(x_m, y_m, normals[peer, tick], sines[peer, tick]) > bound_m:
                return peer
    return BY_NONE


@compiled
def refused_by_sudden(way: Floats, sudden: Floats, touches2_m2: Floats) -> int:
    """Row of the peer that a braking way would touch if that one stopped at once, or BY_NONE."""
    for peer in range(touches2_m2.shape[0]):
        for tick in range(way.shape[0]):
            x_m, y_m = sudden[peer, tick, 0] - way[tick, 0], sudden[peer, tick, 1] - way[tick, 1]
            limit2_m2 = touches2_m2[peer, tick]
            if limit2_m2 > 0.0 and x_m * x_m + y_m * y_m < limit2_m2:
                return peer
    return BY_NONE


@compiled
def refused_by_points(way: Floats, start: Floats, points: Floats, keeps2_m2: Floats) -> int:
    """BY_OBSTACLE where a braking way comes too near to a point, or BY_NONE."""
    for point in range(points.shape[0]):
        from_x, from_y = start[0], start[1]
        for tick in range(way.shape[0]):
            to_x, to_y = way[tick, 0], way[tick, 1]
            along_x, along_y = to_x - from_x, to_y - from_y
            x_m, y_m = points[point, 0] - from_x, points[point, 1] - from_y
            length2_m2 = along_x * along_x + along_y * along_y
            if length2_m2 > 0.0:
                along = (x_m * along_x + y_m * along_y) / length2_m2
                along = max(0.0, min(1.0, along))
                x_m -= along * along_x
                y_m -= along * along_y
            elif tick > 0:
                break
            if x_m * x_m + y_m * y_m < keeps2_m2[point]:
                return BY_OBSTACLE
            from_x, from_y = to_x, to_y
    return BY_NONE
