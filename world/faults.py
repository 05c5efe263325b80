"""Faults that the world carries out: which are active, and what they do to commands and motors.

    begin -> Active, at every tick until is_over
             links: world.radio      lidars: world.sensors      commands, motors: here

What a fault keeps from the moment it began is in its Active, so the world's state is all there is
to store. Whatever is drawn is drawn per fault, robot or link and tick: no draw depends on another.
"""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np

from swarm.faults import (
    ActuatorFault,
    ActuatorStuck,
    Bias,
    Corrupt,
    Dead,
    DiskFull,
    Fault,
    LinkFault,
    Noise,
    SensorFault,
    Slow,
    Weak,
)
from swarm.geometry import STILL, Twist
from swarm.messages import Array, Command

# Of the last two the world only keeps that they are there; bus and recorder do the rest.
Carried = Slow | LinkFault | SensorFault | ActuatorFault | Corrupt | DiskFull

STREAM_LINKS = 8  # second half of the Philox key; faults.STREAM is that of targets
STREAM_LIDARS = 9
# What a robot must bear without touching anything; a lidar that is worse excuses a contact.
NOISE_M_MAX = 0.02
BIAS_M_MAX = 0.05


class Active(msgspec.Struct, frozen=True):
    """A fault from the tick at which it began until it is over."""

    number: int  # of the fault in this run
    fault: Fault
    rows: tuple[int, ...]  # of the robots that it strikes, rising
    first_tick: int
    until_tick: int | None  # the first tick without it; None: never over
    set_points: tuple[Twist, ...] = ()  # of actuator-stuck, by its rows: what the motors keep
    scans: tuple[Array, ...] = ()  # of sensor-stuck, by its rows: what the lidars keep showing


class Held(msgspec.Struct, frozen=True, array_like=True):
    """A command of a slow robot, on its way."""

    tick: int  # in which it would have arrived
    command: Command


def begin(number: int, fault: Fault, rows: Sequence[int], tick: int, *, dt_s: float) -> Active:
    """A fault that strikes from this tick on; it lasts for at least one."""
    assert isinstance(fault, Carried)
    until_tick = None if fault.for_s is None else tick + max(1, round(fault.for_s / dt_s))
    return Active(number, fault, tuple(rows), tick, until_tick)


def is_over(active: Active, tick: int) -> bool:
    """Whether a fault does nothing any more at this tick."""
    return active.until_tick is not None and active.until_tick <= tick


def draws(seed: int, stream: int, number: int, who: int, tick: int) -> np.random.Generator:
    """Randomness of one fault for one robot, or all links, in one tick."""
    return np.random.Generator(np.random.Philox(key=[seed, stream], counter=[0, tick, number, who]))


def late_ticks(active: Sequence[Active], dt_s: float) -> dict[int, int]:
    """Ticks by which the commands of slow robots come too late, by row; the longest counts."""
    late: dict[int, int] = {}
    for one in active:
        if isinstance(one.fault, Slow):
            ticks = round(one.fault.late_s / dt_s)
            for row in one.rows:
                late[row] = max(late.get(row, 0), ticks)
    return late


def stuck(active: Sequence[Active], asked: Sequence[Twist]) -> list[Twist]:
    """(robots,) what the motors take for their set-points, from what was asked for."""
    taken = list(asked)
    for one in active:
        if isinstance(one.fault, ActuatorStuck):
            for row, set_point in zip(one.rows, one.set_points, strict=True):
                taken[row] = set_point
    return taken


def driven(active: Sequence[Active], asked: Sequence[Twist], alive: Sequence[bool]) -> list[Twist]:
    """(robots,) set-points that the bodies follow. Without a mind motors brake, stuck or not."""
    followed = stuck(active, asked)
    for one in active:
        if isinstance(one.fault, Weak):
            for row in one.rows:
                speed_mps, turn_rate_radps = followed[row].speed_mps, followed[row].turn_rate_radps
                followed[row] = Twist(
                    one.fault.factor * speed_mps, one.fault.factor * turn_rate_radps
                )
        elif isinstance(one.fault, Dead):
            for row in one.rows:
                followed[row] = STILL
    # Dead motors win over all others, whichever began first: scaling leaves STILL as it is.
    return [twist if lives else STILL for twist, lives in zip(followed, alive, strict=True)]


def excusing_rows(active: Sequence[Active]) -> frozenset[int]:
    """Robots that cannot be blamed for what they touch, nor can those whom they touch."""
    return frozenset(row for one in active if _excuses(one.fault) for row in one.rows)


def _excuses(fault: Fault) -> bool:
    if isinstance(fault, Noise):
        return fault.sigma_m > NOISE_M_MAX
    if isinstance(fault, Bias):
        return abs(fault.bias_m) > BIAS_M_MAX
    return isinstance(fault, SensorFault | ActuatorFault)
