"""What moves and is seen by the lidar only: found in successive scans, as circles with velocities.

    hits --segments--> what is round --tracks--> bodies with velocities, and which of them move

Those that move are kept out of the memory, and are peers that give no way to anybody.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import cos, pi, sin

import msgspec
import numpy as np

from agents.navigator import memory, table
from agents.navigator.arcs import locate
from agents.navigator.compiled import compiled
from agents.navigator.segments import segments
from agents.navigator.tracks import (
    COLUMNS,
    COUNT,
    FIT_COLUMNS,
    GATE_M,
    HIDE_M,
    MISSED,
    MOVES,
    PLACES,
    RADIUS,
    V_X,
    V_Y,
    Flags,
    X,
    Y,
    follow,
    hide,
)
from agents.peers import COORDINATE_M_MAX, Peer
from swarm import geometry
from swarm.geometry import Floats, Ranges
from swarm.messages import SensorFrame
from swarm.scenario import RobotSetup

PAUSE_TICKS = 6  # without a scan: then all is new
SCANS = 6  # that are kept; the oldest one tells what was free
# What has its middle this near to a peer's body is that peer, of which some hits were not masked.
PEER_M = 0.1
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
        return np.ndarray((len(self.tracks) // (8 * COLUMNS), COLUMNS), np.float64, self.tracks)

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


@lru_cache(maxsize=1024)
def _unsure_m(setup: RobotSetup) -> float:
    """By how much two scans differ without any motion: 3 sigma of whatever is declared."""
    noise = setup.disturbance
    # at some range
    unsure_m = noise.range_sigma_m + 2.0 * noise.position_sigma_m + 4.0 * noise.yaw_sigma_rad
    drift_m = noise.drift_m_per_m * setup.robot.speed_mps_max * SCANS * setup.dt_s
    return 3.0 * unsure_m + drift_m


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
    unsure_m = _unsure_m(setup)
    range_m, more_m = setup.sensor.range_m, setup.msam.peer_tolerance_per_missed_tick_m
    bodies = _NO_BODIES
    if others:
        flat: list[float] = []
        for one in others:
            if one.distance_m < range_m + 1.0:
                x_m, y_m = one.offset
                flat += (pose.x_m + x_m, pose.y_m + y_m)
                flat.append(
                    one.beacon.body_radius_m + PEER_M + unsure_m + more_m * one.missed_ticks
                )
        bodies = np.array(flat, dtype=np.float64).reshape(-1, 3)
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
    fits = np.zeros((len(tracks), FIT_COLUMNS))
    left_m = far_m
    for index in range(len(tracks)):
        if tracks[index, MOVES] > 0.0:
            owners = np.empty(beams, dtype=np.int64)
            fits = locate(
                tracks, raw_m, far_m, units, x_m, y_m, ahead, aside, elapsed_s, unsure_m, owners
            )
            left_m = np.where(owners < 0, far_m, np.inf)
            break
    found = segments(
        raw_m, left_m, units, x_m, y_m, ahead, aside, cosine, sine, bodies, unsure_m, range_m
    )
    # The old scan tells something of segments only.
    before_m = np.empty(len(old_m) if len(found) > 0 else 0)
    for beam in range(len(before_m)):
        seen = float(old_m[beam])
        before_m[beam] = clear_m if seen > clear_m else seen
    result = follow(
        tracks, fits, found, raw_m, units, bounds, x_m, y_m, ahead, aside, 2.0 * sine, elapsed_s,
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
