"""The MSAM in time: the cheapest of some hundred velocities, by when each would touch something.

    way, peers' intents, obstacles --time to contact--> cost of each cell --least--> velocity

A cell is a direction and a speed; the peers move in it as they have announced.
"""

from __future__ import annotations

from math import cos, pi, sin

import msgspec
import numpy as np

from agents.navigator import table
from agents.navigator.compiled import compiled
from swarm.geometry import Floats, Vec2, wrap_angle
from swarm.scenario import Robot

DIRECTIONS = 48
STEP_RAD = 2.0 * pi / DIRECTIONS
SPEEDS = np.array((1.0, 0.8, 0.6, 0.4, 0.2))  # of the top speed
PARKED_SPEED = 0.6  # a parked robot moves aside no faster

OBSTACLE_M = 0.06  # room beside the strip that has to be free
PEER_M = 0.1  # room to peers
NEAR_PEER_M = 0.01  # where it is less already, it may not become less: the guard would not let it
NEARER_M = 0.02  # but for what keeps no rules, of which the guard does not know what it will do
OBSTACLE_S, PEER_S = 1.5, 2.5  # contacts after this do not matter
PARKED_PEER_S = 0.6  # who stands at its goal stays until somebody is this near
CONTACT_COST = 0.3
CONTACT_COST_MAX = 20.0  # times that
RIGHT_COST, RIGHT_RAD = 0.5, 0.8  # of going left when somebody comes
MEET_S = 4.0  # so soon
CHANGE_COST = 0.1
TURN_COST = 0.1
# In directions that bring it near to its goal the robot stops there: square of that cosine.
TO_GOAL = 0.5
TIE = 1e-9


class Choice(msgspec.Struct, frozen=True):
    """What the cells tell."""

    direction_rad: float  # world
    speed_mps: float
    meets: bool  # somebody, on the preferred velocity


def reach_m(robot: Robot) -> float:
    """How far off obstacles matter."""
    return OBSTACLE_S * robot.speed_mps_max + robot.body_radius_m + OBSTACLE_M


def _units() -> Floats:
    """(DIRECTIONS, 2) from -180 degrees on, relative to the way."""
    angles = [STEP_RAD * (k - DIRECTIONS // 2) for k in range(DIRECTIONS)]
    return np.array([(cos(angle), sin(angle)) for angle in angles])


UNITS = _units()


def choose(
    direction_rad: float,
    speed_mps: float,
    yaw_rad: float,
    last: Vec2,
    said: Vec2,
    radius_m: float,
    speed_mps_max: float,
    peers: Floats,
    points: Floats,
    *,
    keeps_right: bool,
    parked: bool,
    slow_mps: float,
    free_m: float = 0.0,
    goal: Vec2 = (0.0, 0.0),
) -> Choice:
    """Cheapest cell.

    Args:
        direction_rad, speed_mps: preferred; world.
        last: m/s, world: velocity that was chosen last.
        said: m/s, world: velocity that was announced last, which peers count on.
        peers: rows of `table`.
        points: (n, 2) m from here, world axes: obstacles.
        slow_mps: no cell is faster.
        free_m: straight on, the way is known to be free as far as this.
        goal: m from here, world axes: where it stops; (0, 0) if it goes on from there.
    """
    found = np.zeros(3)
    least(
        cos(direction_rad),
        sin(direction_rad),
        speed_mps,
        wrap_angle(direction_rad - yaw_rad),
        last[0],
        last[1],
        said[0],
        said[1],
        radius_m,
        speed_mps_max,
        peers,
        points,
        UNITS,
        SPEEDS,
        keeps_right,
        min(slow_mps, PARKED_SPEED * speed_mps_max) if parked else slow_mps,
        free_m,
        goal[0],
        goal[1],
        PARKED_PEER_S if parked else PEER_S,
        found,
    )
    index = int(found[0])
    angle_rad = direction_rad + STEP_RAD * (index - DIRECTIONS // 2)
    return Choice(wrap_angle(angle_rad), float(found[1]), bool(found[2]))


@compiled
def contact_s(x_m: float, y_m: float, v_x: float, v_y: float, keep_m: float) -> float:
    """When something at (x, y) comes nearer than `keep_m` at that velocity towards it, or inf."""
    apart2_m2 = x_m * x_m + y_m * y_m
    closing = x_m * v_x + y_m * v_y
    if closing <= 0.0:
        return np.inf
    speed2 = v_x * v_x + v_y * v_y
    beyond = apart2_m2 - keep_m * keep_m
    root = closing * closing - speed2 * beyond
    if root <= 0.0:
        return np.inf
    return max(0.0, float(beyond / (closing + np.sqrt(root))))


@compiled
def keeps(radius_m: float, peers: Floats) -> Floats:
    """(peers,) how near their centres may come, m; no nearer where one is too near already."""
    keeps_m = np.empty(peers.shape[0])
    for row in range(peers.shape[0]):
        touch_m = radius_m + peers[row, table.RADIUS]
        keep_m = touch_m + PEER_M
        x_m, y_m = peers[row, table.X], peers[row, table.Y]
        apart2_m2 = x_m * x_m + y_m * y_m
        if apart2_m2 < keep_m * keep_m:
            nearer_m = NEARER_M if peers[row, table.RISK] >= table.LAWLESS else 0.0
            keep_m = max(touch_m + NEAR_PEER_M, np.sqrt(apart2_m2) - nearer_m)
        keeps_m[row] = keep_m
    return keeps_m


@compiled
def peer_s(
    u_x: float, u_y: float, said_x: float, said_y: float, peers: Floats, row: int, keep_m: float
) -> float:
    """When a velocity brings this robot too near to a peer that does its share, s, inf if never."""
    share = peers[row, table.SHARE]
    v_x = (u_x - (1.0 - share) * said_x) / share - peers[row, table.U_X]
    v_y = (u_y - (1.0 - share) * said_y) / share - peers[row, table.U_Y]
    return contact_s(peers[row, table.X], peers[row, table.Y], v_x, v_y, keep_m)


@compiled
def stands(peers: Floats, row: int) -> bool:
    """Whether a peer means to stay where it is."""
    return bool(peers[row, table.U_X] == 0.0 and peers[row, table.U_Y] == 0.0)


@compiled
def beyond_s(u_x: float, u_y: float, end_s: float, peers: Floats, row: int, keep_m: float) -> float:
    """When a peer that stands comes too near to a robot that stops after `end_s`, inf if never."""
    after_s = contact_s(peers[row, table.X], peers[row, table.Y], u_x, u_y, keep_m)
    return after_s if after_s < end_s else np.inf


@compiled
def free_along(points: Floats, unit_x: float, unit_y: float, strip_m: float) -> float:
    """How far a strip in some direction is free of points, m, inf where it has none."""
    free_m = np.inf
    for point in range(points.shape[0]):
        ahead_m = points[point, 0] * unit_x + points[point, 1] * unit_y
        if ahead_m <= 0.0 or ahead_m - strip_m >= free_m:
            continue
        aside_m = points[point, 1] * unit_x - points[point, 0] * unit_y
        inside = strip_m * strip_m - aside_m * aside_m
        if inside > 0.0:
            free_m = min(free_m, max(0.0, ahead_m - np.sqrt(inside)))
    return free_m


@compiled
def least(
    way_x: float,
    way_y: float,
    speed_mps: float,
    turn_rad: float,
    last_x: float,
    last_y: float,
    said_x: float,
    said_y: float,
    radius_m: float,
    speed_mps_max: float,
    peers: Floats,
    points: Floats,
    units: Floats,
    speeds: Floats,
    keeps_right: bool,
    slow_mps: float,
    known_m: float,
    goal_x: float,
    goal_y: float,
    ahead_s: float,
    found: Floats,
) -> None:
    """Index of direction and speed of the cheapest cell; whether the preferred one meets anybody.

    Args:
        turn_rad: from the heading to the way.
        goal_x, goal_y: m from here to where it stops; zero if it goes on from there.
        ahead_s: contacts with peers after this do not matter.
        found: (3,) filled.
    """
    count = peers.shape[0]
    keeps_m = keeps(radius_m, peers)
    want_x, want_y = speed_mps * way_x, speed_mps * way_y
    meets = False
    for row in range(count):
        # What keeps no rules is passed on whichever side is nearer.
        if (
            0.0 < peers[row, table.RISK] < table.LAWLESS
            and peer_s(want_x, want_y, said_x, said_y, peers, row, keeps_m[row]) < MEET_S
        ):
            meets = True
            break
    right = keeps_right or meets

    # Standing.
    risk = 0.0
    for row in range(count):
        if peers[row, table.RISK] > 0.0:
            after_s = peer_s(0.0, 0.0, said_x, said_y, peers, row, keeps_m[row])
            if after_s < ahead_s:
                risk = max(risk, min(CONTACT_COST_MAX, ahead_s / max(after_s, 1e-3) - 1.0))
    best = (
        np.sqrt(want_x * want_x + want_y * want_y) / speed_mps_max
        + CHANGE_COST * np.sqrt(last_x * last_x + last_y * last_y) / speed_mps_max
        + CONTACT_COST * risk
    )
    found[0] = units.shape[0] // 2
    found[1] = 0.0
    found[2] = 1.0 if meets else 0.0

    strip_m = radius_m + OBSTACLE_M
    for index in range(units.shape[0]):
        unit_x = way_x * units[index, 0] - way_y * units[index, 1]
        unit_y = way_y * units[index, 0] + way_x * units[index, 1]
        free_m = -1.0  # looked for where a cell might be the cheapest
        if index == units.shape[0] // 2 and known_m > 0.0:
            free_m = np.inf
        end_m = goal_x * unit_x + goal_y * unit_y  # how far it goes at all
        if end_m <= 0.0 or end_m * end_m < TO_GOAL * (goal_x * goal_x + goal_y * goal_y):
            end_m = np.inf
        off_rad = (index - units.shape[0] // 2) * STEP_RAD
        left = min(1.0, off_rad / RIGHT_RAD) if right and off_rad > 0.0 else 0.0
        turned_rad = abs(turn_rad + off_rad)
        if turned_rad > pi:
            turned_rad = abs(2.0 * pi - turned_rad)
        for number in range(speeds.shape[0]):
            share = speeds[number]
            u_mps = share * speed_mps_max
            if u_mps > slow_mps:
                continue
            u_x, u_y = u_mps * unit_x, u_mps * unit_y
            off_x, off_y = u_x - want_x, u_y - want_y
            by_x, by_y = u_x - last_x, u_y - last_y
            cost = (
                np.sqrt(off_x * off_x + off_y * off_y) / speed_mps_max
                + RIGHT_COST * left * share
                + CHANGE_COST * np.sqrt(by_x * by_x + by_y * by_y) / speed_mps_max
                + TURN_COST * turned_rad / pi * share
            )
            if cost >= best - TIE:
                continue
            if free_m < 0.0:
                free_m = free_along(points, unit_x, unit_y, strip_m)
            after_s = free_m / u_mps
            if after_s < OBSTACLE_S:
                soon = OBSTACLE_S / max(after_s, 1e-3) - 1.0
                cost += CONTACT_COST * min(CONTACT_COST_MAX, soon)
                if cost >= best - TIE:
                    continue
            # Costs only grow: who cannot become the cheapest any more is left at once.
            risk_max = (best - TIE - cost) / CONTACT_COST
            risk = 0.0
            for row in range(count):
                if peers[row, table.RISK] <= 0.0:
                    continue
                after_s = peer_s(u_x, u_y, said_x, said_y, peers, row, keeps_m[row])
                if after_s < ahead_s and end_m < np.inf and stands(peers, row):
                    after_s = beyond_s(u_x, u_y, end_m / u_mps, peers, row, keeps_m[row])
                if after_s < ahead_s:
                    soon = ahead_s / max(after_s, 1e-3) - 1.0
                    risk = max(risk, min(CONTACT_COST_MAX, soon))
                    if risk >= risk_max:
                        break
            cost += CONTACT_COST * risk
            if cost < best - TIE:
                best = cost
                found[0] = index
                found[1] = u_mps
