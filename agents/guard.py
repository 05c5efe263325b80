"""Never faster than can be braked: the last word on every set-point.

    obstacle hits --brake--> limit      peers --share--> limit      (in the direction of travel)

The force field guarantees nothing: it is these two that keep robots from touching.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import inf, sqrt

import msgspec

from agents import msam
from agents.peers import Peer
from swarm.scenario import RobotSetup

# A peer more than 87 degrees off the way does not come nearer by driving on.
PEER_AHEAD_MIN = 0.05
# The limit applies to the part of the speed towards the peer, but no more than 3.3 times of it.
PEER_AHEAD_FACTOR_MIN = 0.3


class Limit(msgspec.Struct, frozen=True):
    """How fast a robot may drive, and what holds it back."""

    speed_mps: float
    by: str  # "" | "brake" | a peer's name


def limit(setup: RobotSetup, map: msam.Map, peers: Iterable[Peer], forward: bool) -> Limit:
    """Highest speed from which the robot still stops in time, driving forward or backward."""
    side = 1.0 if forward else -1.0
    allowed = Limit(setup.robot.speed_mps_max, "")
    speed_mps = brake(setup, map, side)
    if speed_mps < allowed.speed_mps:
        allowed = Limit(speed_mps, "brake")
    for peer in peers:
        speed_mps = share(setup, peer, side)
        if speed_mps < allowed.speed_mps:
            allowed = Limit(speed_mps, peer.beacon.name)
    return allowed


def brake(setup: RobotSetup, map: msam.Map, side: float) -> float:
    """sqrt(2 a free) with the free way in the strip that the body sweeps, inf when it is clear.

    free = x - sqrt(R^2 - y^2) - margin over the hits with |y| below the body radius R and a
    margin. A circular body sweeps nothing by turning.
    """
    guard = setup.guard
    radius_m = setup.robot.body_radius_m
    strip_m = radius_m + guard.strip_margin_m
    planned_mps2 = deceleration(setup)
    reach_m = strip_m + guard.stop_margin_m
    reach_m += setup.robot.speed_mps_max * setup.robot.speed_mps_max / (2.0 * planned_mps2)
    if map.nearest_m >= reach_m:
        return inf
    beams = len(map.beams_m)
    units = msam.layout(beams, len(map.sectors_m)).beam_units
    per_sector = beams // len(map.sectors_m)
    free_m = inf
    for sector in [index for index, range_m in enumerate(map.sectors_m) if range_m < reach_m]:
        for beam in range(sector * per_sector, (sector + 1) * per_sector):
            range_m = map.beams_m[beam]
            x_m = side * range_m * units[beam][0]
            y_m = range_m * units[beam][1]
            if x_m > 0.0 and abs(y_m) < strip_m:
                front_m = sqrt(max(0.0, radius_m * radius_m - y_m * y_m))
                free_m = min(free_m, x_m - front_m - guard.stop_margin_m)
    return sqrt(2.0 * planned_mps2 * max(0.0, free_m))


def share(setup: RobotSetup, peer: Peer, side: float) -> float:
    """Speed from which this robot stops within its half of the gap to a peer, inf if off its way.

    The peer may do the same at the same time, and each knows the other `latency_s` late.
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
    lost_mps = planned_mps2 * guard.latency_s
    speed_mps = sqrt(2.0 * planned_mps2 * half_m + lost_mps * lost_mps) - lost_mps
    return speed_mps / max(ahead, PEER_AHEAD_FACTOR_MIN)


def deceleration(setup: RobotSetup) -> float:
    """Planned deceleration in m/s2: the guard's, or the body's own where that is weaker."""
    return min(setup.guard.deceleration_mps2, setup.robot.acceleration_mps2_max)
