"""The formation's geometry: slots, way-points, heading, and the switch of bearings.

    leader --turn--> theta_F        leader, slot --waypoint--> P_f
    map, slot --choose_bearing--> alpha_now        followers --lag, pace--> the leader's speed

theta_F is the formation's own heading: it follows the leader's, no faster than the outermost slot
can be followed. With the leader's own heading a turn in place would sweep the slots away.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from math import cos, inf, pi, sin

import msgspec
import numpy as np

from agents.navigator import corridor
from agents.peers import Peer
from swarm.geometry import Floats, Pose, Twist, Vec2, wrap_angle
from swarm.messages import Slot
from swarm.scenario import Formation, RobotSetup

# How strongly the bearing of the moment attracts the choice of the next.
BEARING_MEMORY_WEIGHT = 0.15
# A leader leaves its slowest follower this much of its top speed, at least, to catch up with.
CRUISE_SHARE_MAX = 0.8
# Bearings up to a right angle to either side are tried.
BEARING_RAD_MAX = pi / 2.0


class Goal(msgspec.Struct, frozen=True):
    """Where the formation is now, moved on from the leader's beacon."""

    leader: Pose
    twist: Twist
    heading_rad: float  # theta_F
    turn_rate_radps: float
    arrived: bool


def goal_of(leader: Peer) -> Goal:
    """Formation at the tick of this robot's frame."""
    beacon = leader.beacon
    heading_rad = beacon.formation_heading_rad + beacon.formation_turn_rate_radps * leader.age_s
    return Goal(
        leader=leader.pose,
        twist=beacon.twist,
        heading_rad=wrap_angle(heading_rad),
        turn_rate_radps=beacon.formation_turn_rate_radps,
        arrived=beacon.arrived,
    )


def slowest(setup: RobotSetup, followers: Iterable[Peer]) -> float:
    """Top speed of the slowest robot of a formation, as far as its leader hears, in m/s."""
    return min([setup.robot.speed_mps_max, *[peer.beacon.speed_mps_max for peer in followers]])


def cruise(setup: RobotSetup, slowest_mps: float) -> float:
    """Speed of a leader whose slowest follower must be able to catch up, in m/s."""
    return min(setup.robot.cruise_speed_mps, CRUISE_SHARE_MAX * slowest_mps)


def turn(setup: RobotSetup, heading_rad: float, leader_yaw_rad: float, spare_mps: float) -> float:
    """Rate of theta_F in rad/s: after the leader's heading, within (v_max - v_lead) / d_max.

    Args:
        spare_mps: v_max - v_lead, what the slowest robot has left at cruise speed.
    """
    assert setup.formation is not None
    rate_radps = setup.formation.heading_gain_1ps * wrap_angle(leader_yaw_rad - heading_rad)
    if setup.slot_distance_m_max > 0.0:
        bound = max(0.0, spare_mps) / setup.slot_distance_m_max
        rate_radps = max(-bound, min(bound, rate_radps))
    return rate_radps


def waypoint(leader: Pose, heading_rad: float, distance_m: float, bearing_rad: float) -> Vec2:
    """P_f = P_l - d e(alpha + theta_F) of eq. 39, world frame."""
    angle_rad = bearing_rad + heading_rad
    return (leader.x_m - distance_m * cos(angle_rad), leader.y_m - distance_m * sin(angle_rad))


def slot_velocity(goal: Goal, point: Vec2) -> Vec2:
    """Velocity of a point that moves with the leader and turns with theta_F, m/s, world."""
    x_m, y_m = point[0] - goal.leader.x_m, point[1] - goal.leader.y_m
    return (
        goal.twist.speed_mps * cos(goal.leader.yaw_rad) - goal.turn_rate_radps * y_m,
        goal.twist.speed_mps * sin(goal.leader.yaw_rad) + goal.turn_rate_radps * x_m,
    )


def lag(heading_rad: float, leader: Pose, followers: Iterable[Peer]) -> float:
    """How far the last follower is behind its way-point along theta_F, in m; 0 when none is."""
    worst_m = 0.0
    for peer in followers:
        slot = peer.beacon.slot
        if slot is None:
            continue
        x_m, y_m = waypoint(leader, heading_rad, slot.distance_m, peer.beacon.bearing_now_rad)
        behind_m = (x_m - peer.pose.x_m) * cos(heading_rad) + (y_m - peer.pose.y_m) * sin(
            heading_rad
        )
        worst_m = max(worst_m, behind_m)
    return worst_m


def pace(formation: Formation, lag_m: float) -> float:
    """Factor on the leader's speed for a follower that lags so much; 1 when none does."""
    factor = 1.0 - (lag_m - formation.pacing_lag_m) / formation.pacing_range_m
    return max(formation.pacing_factor_min, min(1.0, factor))


def choose_bearing(
    formation: Formation,
    slot: Slot,
    bearing_now_rad: float,
    points: Iterable[Vec2],
    clear_m: float,
) -> float:
    """Bearing nearest to the nominal one whose corridor along theta_F is free of obstacles.

    "Followers calculate their new desired bearing angles": the distance stays, alpha changes. The
    corridor reaches from behind the way-point to ahead of it; when all are blocked the follower
    goes behind the leader (alpha = 0), whose track is known to be free.

    Args:
        points: obstacle points in m from the leader, x along theta_F.
        clear_m: nearest that a point may be to the corridor's middle line.
    """
    d_m = slot.distance_m
    behind_m = formation.corridor_behind_m
    ahead_m = formation.corridor_ahead_m
    near = [
        point
        for point in points
        if abs(point[1]) < d_m + clear_m
        and -d_m - behind_m - clear_m < point[0] < d_m + ahead_m + clear_m
    ]
    best = inf
    chosen_rad = 0.0
    for cost, bearing_rad, x_m, y_m in _candidates(
        slot.bearing_rad, d_m, formation.bearing_step_rad
    ):
        if cost >= best:
            break
        cost += BEARING_MEMORY_WEIGHT * abs(wrap_angle(bearing_rad - bearing_now_rad))
        if cost < best and _is_free(near, x_m - behind_m, x_m + ahead_m, y_m, clear_m):
            best = cost
            chosen_rad = bearing_rad
    return chosen_rad


def choose_bearing_among(
    formation: Formation,
    slot: Slot,
    bearing_now_rad: float,
    points_m: Floats,
    origin: Vec2,
    heading_rad: float,
    clear_m: float,
) -> float:
    """The same in one inner loop, for many points.

    Args:
        points_m: (points, 2) from the robot, world axes; origin: the robot from the leader.
    """
    bearings = _candidates(slot.bearing_rad, slot.distance_m, formation.bearing_step_rad)
    rows = np.array(bearings)
    more = [
        BEARING_MEMORY_WEIGHT * abs(wrap_angle(bearing[1] - bearing_now_rad))
        for bearing in bearings
    ]
    rows[:, 1] = more
    row = corridor.cheapest(
        rows,
        points_m,
        *origin,
        cos(heading_rad),
        sin(heading_rad),
        formation.corridor_behind_m,
        formation.corridor_ahead_m,
        clear_m,
    )
    return bearings[row][1] if row >= 0 else 0.0


def slew_bearing(
    formation: Formation, bearing_now_rad: float, bearing_rad: float, elapsed_s: float
) -> float:
    """Bearing of the moment after it has moved towards the chosen one."""
    step_rad = formation.bearing_rate_radps * elapsed_s
    change_rad = wrap_angle(bearing_rad - bearing_now_rad)
    if abs(change_rad) <= step_rad:
        return bearing_rad
    return wrap_angle(bearing_now_rad + (step_rad if change_rad > 0.0 else -step_rad))


def _is_free(
    points: list[Vec2], rear_m: float, front_m: float, middle_m: float, clear_m: float
) -> bool:
    """Whether no point is nearer than `clear_m` to the segment from rear to front."""
    for x_m, y_m in points:
        aside_m = y_m - middle_m
        if -clear_m < aside_m < clear_m:
            beyond_m = rear_m - x_m if x_m < rear_m else max(0.0, x_m - front_m)
            if aside_m * aside_m + beyond_m * beyond_m < clear_m * clear_m:
                return False
    return True


@lru_cache(maxsize=256)
def _candidates(
    nominal_rad: float, distance_m: float, step_rad: float
) -> list[tuple[float, float, float, float]]:
    """(turn from nominal, bearing, way-point x and y from the leader), least turn first."""
    count = int(BEARING_RAD_MAX / step_rad + 1e-9)
    grid = [i * step_rad for i in range(-count, count + 1)]
    return sorted(
        (
            abs(wrap_angle(bearing_rad - nominal_rad)),
            bearing_rad,
            -distance_m * cos(bearing_rad),
            -distance_m * sin(bearing_rad),
        )
        for bearing_rad in [nominal_rad, *grid]
    )
