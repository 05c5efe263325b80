"""Declared errors that strike everybody in every tick: what is shown, heard and driven instead.

    true pose, scan -> shown pose, scan        asked set-point -> one some ticks old
    links that reach -> links that carry       wheels' speed -> the body's

Unlike faults they excuse nobody. Draws are per robot, or for all links at once, and per tick: none
depends on another or on who lives.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, pi, sin, sqrt

import msgspec
import numpy as np
import numpy.typing as npt

from swarm.geometry import STILL, Pose, Ranges, Twist, wrap_angle
from swarm.scenario import DEVIATES_MAX, Disturbance
from world import sensors

Flags = npt.NDArray[np.bool_]

# Second half of the Philox key, beside those of scene, faults and injector.
STREAM_RANGES = 20
STREAM_POSES = 21
STREAM_SPEEDS = 22
STREAM_LINKS = 23
STREAM_DRIFTS = 24
# How much the direction of a drift turns in a metre of the way, in the mean.
DRIFT_TURN_RAD = 0.5


class Drift(msgspec.Struct, frozen=True, array_like=True):
    """How far the position that a robot is shown has crept away, and which way it creeps."""

    x_m: float = 0.0
    y_m: float = 0.0
    towards_rad: float = 0.0


NO_DRIFT = Drift()


def draws(seed: int, stream: int, who: int, tick: int) -> np.random.Generator:
    """Randomness of one robot, or all links, in one tick."""
    return np.random.Generator(np.random.Philox(key=[seed, stream], counter=[0, tick, 0, who]))


def scans(
    declared: Disturbance,
    ranges_m: Ranges,
    rows: Sequence[int],
    *,
    range_m: float,
    seed: int,
    tick: int,
) -> Ranges:
    """(rows, beams) m what the lidars of some robots show; what was hit stays hit."""
    if not declared.range_sigma_m:
        return ranges_m
    shown_m = ranges_m.copy()
    for place, row in enumerate(rows):
        deviates = draws(seed, STREAM_RANGES, row, tick).standard_normal(ranges_m.shape[1])
        errors_m = declared.range_sigma_m * np.clip(deviates, -DEVIATES_MAX, DEVIATES_MAX)
        shown_m[place] = sensors.off(ranges_m[place].astype(np.float64), errors_m, range_m)
    return shown_m


def creep(
    declared: Disturbance, before: Drift, way_m: float, row: int, *, seed: int, tick: int
) -> Drift:
    """Drift after so much of the way, by the declared share of it; at its bound it slides along it.

    Args:
        tick: whose drift it is, from 1.
    """
    if not declared.drift_m_per_m:
        return before
    generator = draws(seed, STREAM_DRIFTS, row, tick)
    if tick == 1:
        before = Drift(towards_rad=pi * (2.0 * generator.random() - 1.0))
    turn_rad = DRIFT_TURN_RAD * sqrt(way_m) * float(generator.standard_normal())
    towards_rad = wrap_angle(before.towards_rad + turn_rad)
    step_m = declared.drift_m_per_m * way_m
    x_m, y_m = before.x_m + step_m * cos(towards_rad), before.y_m + step_m * sin(towards_rad)
    off_m = sqrt(x_m * x_m + y_m * y_m)
    share = min(1.0, declared.drift_m_max / off_m) if off_m else 1.0
    return Drift(share * x_m, share * y_m, towards_rad)


def pose(
    declared: Disturbance, true: Pose, row: int, drift: Drift = NO_DRIFT, *, seed: int, tick: int
) -> Pose:
    """Where a robot is told that it is.

    Its position is never further off than `declared.position_error_m_max`: what would be is drawn
    in along its direction.
    """
    if declared.drift_m_per_m:
        true = Pose(true.x_m + drift.x_m, true.y_m + drift.y_m, true.yaw_rad)
    if not declared.position_sigma_m and not declared.yaw_sigma_rad:
        return true
    deviates = draws(seed, STREAM_POSES, row, tick).standard_normal(3)
    along, across, turned = deviates.tolist()
    length = sqrt(along * along + across * across)
    sigma_m = declared.position_sigma_m * min(1.0, DEVIATES_MAX / length if length else 1.0)
    turned = min(max(turned, -DEVIATES_MAX), DEVIATES_MAX)
    return Pose(
        true.x_m + sigma_m * along,
        true.y_m + sigma_m * across,
        wrap_angle(true.yaw_rad + declared.yaw_sigma_rad * turned),
    )


def speed_factors(declared: Disturbance, count: int, *, seed: int) -> tuple[float, ...]:
    """(robots,) how many times as fast as its wheels say each body is, in the whole run."""
    if not declared.speed_error:
        return (1.0,) * count
    return tuple(
        1.0
        + declared.speed_error
        * (1.0 if draws(seed, STREAM_SPEEDS, row, 0).random() < 0.5 else -1.0)
        for row in range(count)
    )


def late(
    declared: Disturbance, pending: tuple[Twist, ...], asked: Twist
) -> tuple[Twist, tuple[Twist, ...]]:
    """Set-point that motors take in this tick, and those that they will take.

    Args:
        pending: asked for in the ticks before, oldest first; fewer than that many are still ones.
    """
    ticks = declared.latency_ticks
    if not ticks:
        return asked, ()
    taken = pending[0] if len(pending) == ticks else STILL
    return taken, (*pending, asked)[-ticks:]


def fade(declared: Disturbance, fades: bytes, count: int, *, seed: int, tick: int) -> bytes:
    """(robots * robots) for how many ticks, this one included, a link carries nothing.

    Bursts begin so often that the share lost is as declared: a burst of 1 to n ticks, evenly
    drawn, then links that carry for 1 / begin ticks in the mean, and for one at least.

    Args:
        fades: of the tick before; empty before the first.
        tick: whose fades they are.
    Returns:
        empty when losses do not come in bursts.
    """
    if not declared.loss_probability or not declared.loss_ticks_max:
        return b""
    left = np.frombuffer(fades or bytes(count * count), np.uint8)
    drawn = draws(seed, STREAM_LINKS, 0, tick).random((2, count * count))
    share = declared.loss_probability
    begin = share / (declared.loss_ticks_mean * (1.0 - share))
    lengths = 1 + (drawn[1] * declared.loss_ticks_max).astype(np.uint8)
    begun = (left == 0) & (drawn[0] < begin)
    return np.where(begun, lengths, np.maximum(left, 1) - 1).astype(np.uint8).tobytes()


def carried(declared: Disturbance, heard: Flags, fades: bytes, *, seed: int, tick: int) -> Flags:
    """Which of the links (listener, speaker) that reach far enough carry a beacon in this tick."""
    if not declared.loss_probability:
        return heard
    if declared.loss_ticks_max:
        left = np.frombuffer(fades or bytes(heard.size), np.uint8).reshape(heard.shape)
        reaching: Flags = heard & (left == 0)
        return reaching
    drawn = draws(seed, STREAM_LINKS, 0, tick).random(heard.shape)
    carries: Flags = heard & (drawn >= declared.loss_probability)
    return carries
