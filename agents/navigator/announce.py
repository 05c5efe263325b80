"""Where a robot will come to rest, known to all: the braking way that its beacon announces.

    pose, set-point --one tick--> --braking on that curve, tick by tick--> (ticks, 2) places

Motors that are so many ticks late take their set-points so much later: places are then those of so
many ticks later, for all robots alike, and what is under way is announced.

Sender and hearers compute it from the same beacon by the same function, so they know the same. It
is what world.motion makes of a body whose set-point is followed by none, up to rounding.
"""

from __future__ import annotations

from math import ceil, cos, sin

import numpy as np

from agents.navigator.brake import slower
from agents.navigator.compiled import compiled
from swarm import geometry
from swarm.geometry import Floats
from swarm.messages import Beacon, Promise

# Who needs more ticks to stop announces nothing: its braking way would cost others too much.
TICKS_MAX = 64
# Taylor polynomials of this argument are exact to the last bit but one.
TURN_RAD_MAX = 0.25
# Rows of `path`: x_m, y_m, cosine and sine of the heading, v_mps, w_radps, what full braking
# takes from both rates in a tick, and the room that it keeps all that way.
COLUMNS = 9
KEEP = 8


@compiled
def turn(angle_rad: float) -> tuple[float, float]:
    """Cosine and sine by additions and products only: the same bits on every machine."""
    halvings = 0
    while angle_rad > TURN_RAD_MAX or angle_rad < -TURN_RAD_MAX:
        angle_rad *= 0.5
        halvings += 1
    q = angle_rad * angle_rad
    sine = angle_rad * (
        1.0 - q / 6.0 * (1.0 - q / 20.0 * (1.0 - q / 42.0 * (1.0 - q / 72.0 * (1.0 - q / 110.0))))
    )
    less = q / 2.0 * (1.0 - q / 12.0 * (1.0 - q / 30.0 * (1.0 - q / 56.0 * (1.0 - q / 90.0))))
    for _ in range(halvings):  # less is 1 - cos, which loses nothing for small angles
        sine, less = 2.0 * sine * (1.0 - less), 2.0 * sine * sine
    return 1.0 - less, sine


@compiled
def path(body: Floats, dt_s: float, skip: int, places: Floats) -> None:
    """Places of one body after 1, 2, ... ticks, the first `skip` of them left out.

    Args:
        body: (COLUMNS,) as above.
        places: (ticks, 2) m, world; filled.
    """
    x_m, y_m, cosine, sine = body[0], body[1], body[2], body[3]
    v_mps, w_radps = body[4], body[5]
    for tick in range(skip + places.shape[0]):
        if v_mps != 0.0 or w_radps != 0.0:
            half_rad = 0.5 * w_radps * dt_s
            cos_half, sin_half = turn(half_rad)
            chord_m = v_mps * dt_s
            if half_rad != 0.0:
                chord_m *= sin_half / half_rad
            cosine, sine = (
                cosine * cos_half - sine * sin_half,
                sine * cos_half + cosine * sin_half,
            )
            x_m += chord_m * cosine
            y_m += chord_m * sine
            cosine, sine = (
                cosine * cos_half - sine * sin_half,
                sine * cos_half + cosine * sin_half,
            )
            v_mps, w_radps = slower(v_mps, w_radps, body[6], body[7])
        if tick >= skip:
            places[tick - skip, 0] = x_m
            places[tick - skip, 1] = y_m


@compiled
def length(body: Floats, dt_s: float) -> tuple[float, float]:
    """How far a body goes until it stands, m, and how far it turns, rad, to and fro alike."""
    v_mps, w_radps = body[4], body[5]
    way_m = turn_rad = 0.0
    for _ in range(TICKS_MAX):
        if v_mps == 0.0 and w_radps == 0.0:
            break
        way_m += abs(v_mps) * dt_s
        turn_rad += abs(w_radps) * dt_s
        v_mps, w_radps = slower(v_mps, w_radps, body[6], body[7])
    return way_m, turn_rad


def ticks(speed_mps: float, deceleration_mps2: float, dt_s: float) -> int:
    """After how many ticks a body has come to rest, the first one at that speed included."""
    return 1 + ceil(abs(speed_mps) / (deceleration_mps2 * dt_s) - 1e-9)


def reach_m(speed_mps: float, deceleration_mps2: float, dt_s: float) -> float:
    """How far a body can get from where it is by a tick at that speed and braking from it."""
    return speed_mps * dt_s + speed_mps * speed_mps / (2.0 * deceleration_mps2)


def row(beacon: Beacon, promise: Promise, dt_s: float) -> list[float]:
    """Row of `path` for a beacon: from where its twists under way have taken it."""
    pose = beacon.pose
    for twist in promise.pending:
        pose = geometry.advance(pose, twist, dt_s)
    return [
        pose.x_m,
        pose.y_m,
        cos(pose.yaw_rad),
        sin(pose.yaw_rad),
        beacon.twist.speed_mps,
        beacon.twist.turn_rate_radps,
        promise.deceleration_mps2 * dt_s,
        promise.turn_deceleration_radps2 * dt_s,
        promise.keep_m,
    ]


def places(body: list[float], count: int, dt_s: float) -> Floats:
    """(count, 2) places of one body, m, world."""
    result = np.empty((count, 2))
    path(np.array(body), dt_s, 0, result)
    return result
