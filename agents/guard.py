"""Never faster than can be braked: the last word on every set-point.

    asked --slew--> reached --brake, bend--> limit by obstacles --share--> limit by peers --> held
                       '--not even by full braking--> brake first, turn later

The force field guarantees nothing: it is these that keep robots from touching.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import cos, inf, sin, sqrt

import msgspec
import numpy as np

from agents import msam, steering
from agents.peers import Peer
from swarm.geometry import Twist, Vec2
from swarm.scenario import RobotSetup

# A peer more than 87 degrees off the way does not come nearer by driving on.
PEER_AHEAD_MIN = 0.05
# The limit applies to the part of the speed towards the peer, but no more than 3.3 times of it.
PEER_AHEAD_FACTOR_MIN = 0.3
# Of what the body can do; the rest makes up for what a tick takes and for turns that change.
BRAKES_SHARE = 0.75


class Limit(msgspec.Struct, frozen=True):
    """How fast a robot may drive, and what holds it back."""

    speed_mps: float
    by: str  # "" | "brake" | a peer's name


def hold(
    setup: RobotSetup,
    twist: Twist,
    asked: Twist,
    map: msam.Map,
    peers: Iterable[Peer],
    *,
    late_s: float = 0.0,
) -> tuple[Twist, Limit]:
    """Set-point within the body's accelerations from which the robot still stops in time.

    A turn swings the way ahead to what was beside it. Where that asks for more than the brakes
    can do, the robot brakes and goes straight on for as long as that is freer: it turns later.

    Args:
        twist: when the set-point takes effect; measured, unless that is late.
        late_s: by which set-points take effect later than at once.
    """
    robot = setup.robot
    onward_radps = asked.turn_rate_radps
    reached = steering.slew(robot, twist, asked.speed_mps, onward_radps, setup.dt_s)
    allowed = by_obstacles(setup, map, reached, onward_radps, late_s=late_s)
    if allowed.speed_mps < abs(twist.speed_mps) - robot.acceleration_mps2_max * setup.dt_s:
        straight = steering.slew(robot, twist, asked.speed_mps, 0.0, setup.dt_s)
        if by_obstacles(setup, map, straight, 0.0, late_s=late_s).speed_mps > allowed.speed_mps:
            reached = straight
    side = 1.0 if reached.speed_mps >= 0.0 else -1.0
    for peer in peers:
        speed_mps = share(setup, peer, side, late_s=late_s)
        if speed_mps < allowed.speed_mps:
            allowed = Limit(speed_mps, peer.beacon.name)
    speed_mps = steering.clip(reached.speed_mps, allowed.speed_mps)
    return Twist(speed_mps, reached.turn_rate_radps), allowed


def by_obstacles(
    setup: RobotSetup,
    map: msam.Map,
    reached: Twist,
    onward_radps: float,
    *,
    late_s: float = 0.0,
) -> Limit:
    """Highest speed from which the robot stops in time, straight on and as it turns."""
    most_mps = setup.robot.speed_mps_max
    near = hits(setup, map)
    speed_mps = min(most_mps, brake(setup, near, 1.0 if reached.speed_mps >= 0.0 else -1.0))
    slowed = Twist(steering.clip(reached.speed_mps, speed_mps), reached.turn_rate_radps)
    speed_mps = min(speed_mps, bend(setup, near, slowed, onward_radps))
    if late_s > 0.0:
        lost_mps = deceleration(setup) * late_s
        speed_mps = sqrt(speed_mps * speed_mps + lost_mps * lost_mps) - lost_mps
    return Limit(speed_mps, "brake" if speed_mps < most_mps else "")


def hits(setup: RobotSetup, map: msam.Map) -> list[Vec2]:
    """Obstacles near enough to matter to a robot that stops from its top speed, body frame."""
    reach_m = setup.robot.body_radius_m + setup.guard.strip_margin_m + setup.guard.stop_margin_m
    reach_m += setup.robot.speed_mps_max * setup.robot.speed_mps_max / (2.0 * deceleration(setup))
    if map.nearest_m >= reach_m:
        return []
    beams = len(map.beams_m)
    units = msam.layout(beams, len(map.sectors_m)).beam_units
    per_sector = beams // len(map.sectors_m)
    return [
        (range_m * units[beam][0], range_m * units[beam][1])
        for sector, nearest_m in enumerate(map.sectors_m)
        if nearest_m < reach_m
        for beam in range(sector * per_sector, (sector + 1) * per_sector)
        if (range_m := map.beams_m[beam]) < reach_m
    ]


def brake(setup: RobotSetup, near: list[Vec2], side: float) -> float:
    """sqrt(2 a free) with the free way in the strip straight ahead, inf when it is clear.

    free = x - sqrt(R^2 - y^2) - margin over the hits with |y| below the body radius R and a
    margin. A circular body sweeps nothing by turning on the spot.
    """
    guard = setup.guard
    radius_m = setup.robot.body_radius_m
    strip_m = radius_m + guard.strip_margin_m
    free_m = inf
    for x_m, y_m in near:
        if -strip_m < y_m < strip_m and side * x_m > 0.0:
            front_m = sqrt(max(0.0, radius_m * radius_m - y_m * y_m))
            free_m = min(free_m, side * x_m - front_m - guard.stop_margin_m)
    return sqrt(2.0 * deceleration(setup) * max(0.0, free_m))


def bend(setup: RobotSetup, near: list[Vec2], reached: Twist, onward_radps: float) -> float:
    """sqrt(2 a free) with the free way along the curve that the robot brakes on, inf when clear.

    It turns on at the rate asked for while it brakes as planned. What it comes nearer to than
    body and margin on that curve ends the free way; what it leaves behind does not.

    Args:
        reached: in the coming tick.
        onward_radps: turn rate that the body slews to from there.
    """
    guard = setup.guard
    planned_mps2 = deceleration(setup)
    keep_m = setup.robot.body_radius_m + guard.strip_margin_m
    stop_m = reached.speed_mps * reached.speed_mps / (2.0 * planned_mps2)
    reach2_m2 = (keep_m + stop_m) * (keep_m + stop_m)
    near = [(x_m, y_m) for x_m, y_m in near if x_m * x_m + y_m * y_m < reach2_m2]
    if stop_m == 0.0 or not near:
        return inf
    xs_m, ys_m, ways_m = curve(setup, reached, onward_radps, planned_mps2, stop_m)
    obstacles_m = np.array(near)
    dx_m = obstacles_m[:, :1] - np.array(xs_m)
    dy_m = obstacles_m[:, 1:] - np.array(ys_m)
    away_m = np.sqrt(dx_m * dx_m + dy_m * dy_m)  # (hits, points of the curve)
    touched = (away_m[:, 1:] < keep_m) & (away_m[:, 1:] < away_m[:, :-1])
    if not touched.any():
        return inf
    step = int(touched.any(axis=0).argmax())
    entered = touched[:, step]
    before_m, after_m = away_m[entered, step], away_m[entered, step + 1]
    share = float(np.min(np.maximum(before_m - keep_m, 0.0) / (before_m - after_m)))
    free_m = ways_m[step] + share * (ways_m[step + 1] - ways_m[step])
    free_m -= guard.stop_margin_m - guard.strip_margin_m  # head-on it is just what `brake` says
    return sqrt(2.0 * planned_mps2 * max(0.0, free_m))


def curve(
    setup: RobotSetup,
    reached: Twist,
    onward_radps: float,
    planned_mps2: float,
    stop_m: float,
) -> tuple[list[float], list[float], list[float]]:
    """Points of the way to a standstill, tick by tick, in the body frame, and the way to each."""
    dt_s = setup.dt_s
    speed_mps, turn_rate_radps = reached.speed_mps, reached.turn_rate_radps
    side = 1.0 if speed_mps >= 0.0 else -1.0
    speed_mps *= side
    change_radps = setup.robot.turn_acceleration_radps2_max * dt_s
    xs_m, ys_m, ways_m = [0.0], [0.0], [0.0]
    x_m = y_m = yaw_rad = way_m = 0.0
    while way_m < stop_m and speed_mps > 0.0:
        turn_rad = turn_rate_radps * dt_s
        step_m = speed_mps * dt_s
        x_m += side * step_m * cos(yaw_rad + turn_rad / 2.0)
        y_m += side * step_m * sin(yaw_rad + turn_rad / 2.0)
        yaw_rad += turn_rad
        way_m += step_m
        xs_m.append(x_m)
        ys_m.append(y_m)
        ways_m.append(way_m)
        speed_mps -= planned_mps2 * dt_s
        turn_rate_radps += steering.clip(onward_radps - turn_rate_radps, change_radps)
    return xs_m, ys_m, ways_m


def share(setup: RobotSetup, peer: Peer, side: float, *, late_s: float = 0.0) -> float:
    """Speed from which this robot stops within its half of the gap to a peer, inf if off its way.

    The peer may do the same at the same time, and each knows the other `latency_s` late; still
    later where set-points take effect late, or beacons are missed.
    """
    guard = setup.guard
    q_m = peer.distance_m
    touch_m = setup.robot.body_radius_m + peer.beacon.body_radius_m + guard.peer_margin_m
    if q_m == 0.0:
        return 0.0
    ahead = side * peer.offset_body[0] / q_m
    if ahead <= PEER_AHEAD_MIN or abs(peer.offset_body[1]) > touch_m + guard.peer_lateral_m:
        return inf
    half_m = max(0.0, (q_m - touch_m) / 2.0)
    planned_mps2 = deceleration(setup)
    lost_mps = planned_mps2 * (guard.latency_s + late_s + peer.missed_ticks * setup.dt_s)
    speed_mps = sqrt(2.0 * planned_mps2 * half_m + lost_mps * lost_mps) - lost_mps
    return speed_mps / max(ahead, PEER_AHEAD_FACTOR_MIN)


def deceleration(setup: RobotSetup) -> float:
    """Planned deceleration in m/s2: the guard's, or what weaker brakes can surely do."""
    return min(setup.guard.deceleration_mps2, BRAKES_SHARE * setup.robot.acceleration_mps2_max)
