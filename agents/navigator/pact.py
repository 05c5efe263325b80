"""The guard between robots: nobody touches, whatever the stages before it ask for.

    own and peers' braking ways as announced --half-planes, instant by instant--> what is admitted
    asked, slewed --less and less of it--> first whose own braking way is admitted --> set-point

At each future instant two announced places lie some way apart. Each robot may move its own towards
the other by its part of what that is more than both need, so the next two announced ways keep apart
as well; and braking as announced changes nothing, so there is always something admitted.

A beacon that was not heard: its sender has used at most its part of what was free, and this robot
knows a lower bound of that from what it did itself. It then uses a quarter of that bound towards
wherever the sender may be by now, and knows the next bound: however many are lost, on either side.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import cos, sin

import msgspec
import numpy as np

from agents.navigator import announce, brake
from agents.navigator.brake import slower
from agents.navigator.compiled import compiled
from agents.navigator.estimate import Doubt
from agents.navigator.estimate import State as Estimate
from agents.peers import Peer
from swarm.geometry import STILL, Floats, Pose, Twist
from swarm.messages import Beacon, Name, Promise
from swarm.scenario import RobotSetup

# Own beacons remembered: as many as a peer's may be ticks late.
SENT_MAX = 8
# Two that can get no nearer than this by what they do now leave each other free.
FREE_M = 0.4
# Places may differ by rounding from what was announced.
ROUNDING_M = 1e-9
# The body may be off the announced way by this: what noise makes of it is in the pad. Beyond, it
# missed a tick or its motors do not follow, and only what it can do from here counts.
OFF_M = 0.02
# Parts of what is asked for, the first admitted is taken.
PARTS = tuple([part / 20.0 for part in (20, 19, 18, 17, 16, 14, 12, 10, 8, 6, 4, 2, 1, 0)])
# Kept between bodies over what errors ask for, by each of two.
GAP_M = 0.02

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
NO_DOUBT = Doubt()


class Link(msgspec.Struct, frozen=True):
    """What is surely free between this robot and one peer."""

    name: Name
    tick: int  # of its newest beacon
    slack: bytes  # (ticks,) float64 m at the coming ticks; as the last one from there on


class State(msgspec.Struct, frozen=True):
    """Own beacons, newest first, and links in order of names."""

    tick: int = -1  # of the newest beacon
    sent: tuple[tuple[float, ...], ...] = ()  # rows of `announce.path`
    links: tuple[Link, ...] = ()


class Held(msgspec.Struct, frozen=True):
    """What the guard admits."""

    set_point: Twist
    part: float  # of what was asked for
    by: str  # "" | "brake" | a peer's name
    corrects: bool = True  # announced from the pose, else from the one carried


@lru_cache(maxsize=1024)
def pad_m(setup: RobotSetup, clock_error_s: float = 0.0) -> float:
    """Room around a body for what is not as announced even where all poses are exact.

    Between two ticks a straight relative way of (v_i + v_j) dt comes nearer than its ends by its
    square over 8 times the distance, of which each robot's part is at most v^2 dt^2 / (8 r), and
    an arc leaves its chord by v dt omega dt / 8.
    """
    robot, dt_s = setup.robot, setup.dt_s
    step_m = robot.speed_mps_max * dt_s
    chord_m = step_m * step_m / (8.0 * robot.body_radius_m)
    arc_m = step_m * robot.turn_rate_radps_max * dt_s / 8.0
    lag_m = robot.speed_mps_max / robot.velocity_gain_1ps if robot.motion == "dynamic" else 0.0
    return GAP_M + chord_m + arc_m + lag_m + robot.speed_mps_max * clock_error_s


def promise(
    setup: RobotSetup,
    set_point: Twist = STILL,
    doubt: Doubt = NO_DOUBT,
    pending: tuple[Twist, ...] = (),
) -> Promise:
    """What this robot promises in a beacon.

    Args:
        doubt: about the pose in it.
        pending: twists under way.
    """
    if not pending and doubt == NO_DOUBT and setup.disturbance.speed_error == 0.0:
        return _exact(setup)
    return _promise(setup, set_point, doubt, pending)


@lru_cache(maxsize=1024)
def _exact(setup: RobotSetup) -> Promise:
    """Promise at any set-point where nothing is off: then the room is the same all the way."""
    return _promise(setup, STILL, NO_DOUBT, ())


def _promise(
    setup: RobotSetup, set_point: Twist, doubt: Doubt, pending: tuple[Twist, ...]
) -> Promise:
    robot = setup.robot
    brakes_mps2 = brake.brakes_mps2(setup)
    brakes_radps2 = robot.turn_acceleration_radps2_max
    rates = (set_point.speed_mps, set_point.turn_rate_radps)
    body = np.array((*(0.0,) * 4, *rates, brakes_mps2 * setup.dt_s, brakes_radps2 * setup.dt_s))
    return Promise(
        deceleration_mps2=brakes_mps2,
        turn_deceleration_radps2=brakes_radps2,
        keep_m=float(keep(body, _doubts(setup, doubt, pending), setup.dt_s)),
        pending=pending,
    )


def _doubts(setup: RobotSetup, doubt: Doubt, pending: tuple[Twist, ...]) -> Floats:
    """(6,) of `keep`."""
    if not pending and doubt == NO_DOUBT:
        return _no_doubts(setup)
    return _some_doubts(setup, doubt, pending)


@lru_cache(maxsize=1024)
def _no_doubts(setup: RobotSetup) -> Floats:
    return _some_doubts(setup, NO_DOUBT, ())


def _some_doubts(setup: RobotSetup, doubt: Doubt, pending: tuple[Twist, ...]) -> Floats:
    way_m = sum([abs(twist.speed_mps) * setup.dt_s for twist in pending])
    turn_rad = sum([abs(twist.turn_rate_radps) * setup.dt_s for twist in pending])
    room_m = setup.robot.body_radius_m + pad_m(setup) + doubt.position_m
    share = setup.disturbance.speed_error
    return np.array((room_m, doubt.yaw_rad, way_m, turn_rad, share, 0.0))


@lru_cache(maxsize=1024)
def jumps(setup: RobotSetup) -> Floats:
    """(2,) m and rad by which a peer's pose may jump between two beacons, by declared bounds."""
    declared = setup.disturbance
    step_m = declared.speed_error * setup.robot.speed_mps_max * setup.dt_s
    return np.array(
        (
            2.0 * (declared.position_error_m_max + step_m) + 2.0 * OFF_M,
            2.0 * declared.yaw_error_rad_max + declared.speed_error,
        )
    )


@compiled
def keep(body: Floats, doubts: Floats, dt_s: float) -> float:
    """Room to keep around a body all the way until it stands, by declared bounds.

    Its pose is off by so much already; until it stands it gets too far by the speed error, and
    aside by what its yaw is off. Whoever just brakes keeps no more room from tick to tick: what it
    has slipped is then in its doubts, and less of the way is left.

    Args:
        body: of `announce.path`, but for the room.
        doubts: m around its place now, rad of its yaw; m and rad of the way under way; share by
            which ways are longer or shorter.
    """
    way_m, turn_rad = announce.length(body, dt_s)
    share = doubts[4]
    aside = doubts[1] + share * (doubts[3] + turn_rad)
    slip = np.sqrt(share * share + aside * aside)
    return float(doubts[0] + slip * (doubts[2] + way_m))


@lru_cache(maxsize=1024)
def is_kept(setup: RobotSetup) -> bool:
    """Whether this robot stops fast enough for its promise to be of use."""
    ticks = announce.ticks(setup.robot.speed_mps_max, brake.brakes_mps2(setup), setup.dt_s)
    return ticks <= announce.TICKS_MAX


def send(setup: RobotSetup, state: State, beacon: Beacon) -> State:
    """State after a beacon went out; what was sent before a missed tick is not to be relied on."""
    if beacon.promise is None:
        return State(tick=beacon.tick)
    row = announce.row(beacon, beacon.promise, setup.dt_s)
    before = state.sent if beacon.tick == state.tick + 1 else ()
    return State(beacon.tick, (tuple(row), *before)[:SENT_MAX], state.links)


def hold(
    setup: RobotSetup,
    state: State,
    tick: int,
    pose: Pose,
    twist: Twist,
    asked: Twist,
    others: Sequence[Peer],
    statics: Sequence[Peer],
    points_m: Floats,
    where: Estimate | None = None,
    carried: Pose | None = None,
    pending: tuple[Twist, ...] = (),
) -> tuple[State, Held | None]:
    """Set-point that keeps what was promised, None where nobody is near.

    Args:
        pose, twist: when the set-point takes effect.
        where: how sure it is of its poses in this tick; None: all are exact.
        carried: when the set-point takes effect, where the pose announced before has got to; None:
            the same. Who only brakes as announced goes on from there.
        pending: twists until the set-point takes effect.
        others: peers that promise, heard lately.
        statics: those that do not, each where it is believed to be; they get half of the gap.
        points_m: (n, 2) from the pose, world axes: obstacles, those near enough to matter.
    """
    if not others and not statics:
        return State(state.tick, state.sent), None
    robot, dt_s = setup.robot, setup.dt_s
    mine = promise(setup, twist, where.doubt if where else NO_DOUBT, pending)
    brakes = (mine.deceleration_mps2, mine.turn_deceleration_radps2)
    rates = (twist.speed_mps, twist.turn_rate_radps, brakes[0] * dt_s, brakes[1] * dt_s)
    body, start = (
        [one.x_m, one.y_m, cos(one.yaw_rad), sin(one.yaw_rad), *rates, mine.keep_m]
        for one in (carried or pose, pose)
    )
    count = announce.ticks(robot.speed_mps_max, brakes[0], dt_s)
    reach_m = announce.reach_m(robot.speed_mps_max, brakes[0], dt_s)
    rows: list[list[float]] = []
    names: list[str] = []
    known = {link.name: link for link in state.links}
    slacks: list[tuple[int, Link]] = []
    for peer in others:
        beacon = peer.beacon
        given = beacon.promise
        assert given is not None
        age = tick - beacon.tick
        fastest_mps = beacon.speed_mps_max
        if abs(beacon.twist.speed_mps) > fastest_mps:
            fastest_mps = abs(beacon.twist.speed_mps)
        near_m = mine.keep_m + given.keep_m + FREE_M + reach_m + age * dt_s * fastest_mps
        near_m += fastest_mps * dt_s + fastest_mps * fastest_mps / (2.0 * given.deceleration_mps2)
        if peer.distance_m > near_m:
            continue
        row = announce.row(beacon, given, dt_s)
        link = known.get(beacon.name)
        fresh = link is None or link.tick < beacon.tick
        rows.append([*row, age, PROMISED, float(fresh), beacon.body_radius_m, fastest_mps])
        need = announce.ticks(beacon.twist.speed_mps, given.deceleration_mps2, dt_s)
        count = max(count, need)
        if link is not None:
            slacks.append((len(names), link))
        names.append(beacon.name)
    for peer in statics:
        keep_m = peer.beacon.body_radius_m + pad_m(setup)
        keep_m += setup.disturbance.position_error_m_max
        if peer.distance_m <= mine.keep_m + keep_m + 2.0 * reach_m + FREE_M:
            there = [peer.pose.x_m, peer.pose.y_m, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, keep_m]
            rows.append([*there, 1.0, STATIC, 1.0, peer.beacon.body_radius_m, 0.0])
            names.append(peer.beacon.name)
    if not rows:
        return State(state.tick, state.sent), None
    count = min(count, announce.TICKS_MAX)
    sent = state.sent if state.tick == tick - 1 else ()
    slack = np.full((len(rows), count), -1.0)
    for number, link in slacks if sent else ():
        before = np.frombuffer(link.slack)[1:][:count]  # a tick has passed
        slack[number, : len(before)] = before
        slack[number, len(before) :] = before[-1] if len(before) else 0.0
    result = np.zeros(5)
    admit(
        np.array(body),
        np.array(start),
        _doubts(setup, where.carried_doubt if where else NO_DOUBT, pending),
        _doubts(setup, where.doubt if where else NO_DOUBT, pending),
        np.array(sent or [body]),
        len(sent),
        np.array((robot.speed_mps_max, robot.speed_mps_reverse_max, robot.turn_rate_radps_max)),
        robot.half_track_m,
        robot.body_radius_m,
        np.array((robot.acceleration_mps2_max * dt_s, robot.turn_acceleration_radps2_max * dt_s)),
        asked.speed_mps,
        asked.turn_rate_radps,
        np.array(rows),
        slack,
        points_m + np.array((pose.x_m, pose.y_m)) if len(points_m) else points_m,
        brake.room(setup, points_m),
        dt_s,
        1.0 + setup.disturbance.speed_error,
        jumps(setup),
        _PARTS,
        result,
    )
    links = tuple(
        [
            Link(name, tick - int(rows[number][AGE]), slack[number].tobytes())
            for number, name in enumerate(names)
            if rows[number][KIND] == PROMISED
        ]
    )
    by = int(result[3])
    return State(state.tick, state.sent, links), Held(
        Twist(float(result[0]), float(result[1])),
        float(result[2]),
        "" if by == BY_NONE else "brake" if by == BY_OBSTACLE else names[by],
        corrects=result[4] > 0.0,
    )


_PARTS = np.array(PARTS)


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
    most: Floats,
    half_track_m: float,
    radius_m: float,
    change: Floats,
    asked_v_mps: float,
    asked_w_radps: float,
    peers: Floats,
    slack: Floats,
    points: Floats,
    room_m: float,
    dt_s: float,
    faster: float,
    jump: Floats,
    parts: Floats,
    result: Floats,
) -> None:
    """First part of what is asked for whose braking way is admitted, else braking as announced.

    Args:
        body: (COLUMNS,) of `announce.path`: as its wheels say since what it announced.
        start: likewise, corrected by what was measured: what it announces if it goes on.
        body_doubts, start_doubts: (6,) of `keep` for both.
        sent: (n, COLUMNS) own beacons of the last ticks, newest first; `sent_count` of them.
        most: (3,) bounds of the rates.
        change: (2,) greatest change of both in a tick.
        peers: (peers, COLUMNS + 5): AGE in ticks, KIND, FRESH: heard since the last tick, RADIUS,
            FASTEST.
        slack: (peers, ticks) m, surely free at the coming ticks, negative where nothing is known;
            filled with what is after this tick.
        points: (points, 2) m, world; `room_m`: no nearer to them, or no nearer than now.
        faster: so many times as far as announced the body may get before obstacles.
        jump: of `jumps`.
        result: (5,) v, omega, part, by whom it is less than one, whether from `start`.
    """
    ticks = slack.shape[1]
    count = peers.shape[0]

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
            changed(peers[peer], jump, dt_s, moved)
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
    reach_m = room_m + fastest_mps * dt_s * 2.0
    reach_m += fastest_mps * fastest_mps * dt_s / (2.0 * faster * body[6])
    near = np.empty((points.shape[0], 2))
    keeps2_m2 = np.empty(points.shape[0])
    nears = 0
    for point in range(points.shape[0]):
        x_m, y_m = points[point, 0] - start[0], points[point, 1] - start[1]
        apart2_m2 = x_m * x_m + y_m * y_m
        if apart2_m2 < reach_m * reach_m:
            near[nears, 0], near[nears, 1] = points[point, 0], points[point, 1]
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
            v, w = reached(
                body[4], body[5], part * asked_v_mps, asked_w_radps, change, most, half_track_m
            )
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
    if along_m * sine >= aside_m * cosine:  # it is inside
        return float(np.sqrt(length2_m2))
    return float(cosine * along_m + sine * aside_m)


@compiled
def changed(row: Floats, jump: Floats, dt_s: float, moved: Floats) -> None:
    """How far a peer's next announced way can at most lie off the one before, at each tick.

    Both begin at one place but for a jump of the pose shown; motors speed up no faster than they
    brake. The faster of both is no faster than the peer's top speed and braking from it allow.

    Args:
        row: of `admit`.
        jump: of `jumps`.
        moved: (TICKS_MAX,) m, filled.
    """
    change_mps = row[6] + row[6] / brake.BRAKES_SHARE
    change_radps = 2.0 * row[7]
    off_m = jump[0]
    for tick in range(moved.shape[0]):
        v_mps = row[FASTEST] - tick * row[6]
        if v_mps > 0.0:
            off_rad = jump[1] + change_radps * dt_s * (tick + 1)
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
                share = (x_m * along_x + y_m * along_y) / length2_m2
                share = max(0.0, min(1.0, share))
                x_m -= share * along_x
                y_m -= share * along_y
            elif tick > 0:
                break
            if x_m * x_m + y_m * y_m < keeps2_m2[point]:
                return BY_OBSTACLE
            from_x, from_y = to_x, to_y
    return BY_NONE
