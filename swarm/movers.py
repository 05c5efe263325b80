"""Obstacles that move: where each of them is, as a pure function of time.

    circle, path, speed --moving--> Mover --place(time)--> centre

From the circle's centre through the corners of the path and back the same way, or round when the
path ends where it began, always at the same speed. Nothing stops them, nothing needs to be stored.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import msgspec
import numpy as np

from swarm.geometry import Floats, Vec2, length
from swarm.scenario import Obstacle


class Mover(msgspec.Struct, frozen=True):
    """One circle on its way."""

    radius_m: float
    speed_mps: float
    corners: tuple[Vec2, ...]  # the first is where it is at the start
    lengths_m: tuple[float, ...]  # (corners - 1,)
    closed: bool

    @property
    def way_m(self) -> float:
        """From the first corner to the last."""
        return sum(self.lengths_m)


def moving(obstacles: Sequence[Obstacle]) -> tuple[Mover, ...]:
    """Those that move, in order."""
    found = []
    for obstacle in obstacles:
        if obstacle.circle is None or obstacle.path is None or obstacle.speed_mps is None:
            continue
        x_m, y_m, radius_m = obstacle.circle
        corners = ((x_m, y_m), *obstacle.path)
        lengths_m = tuple(length(b[0] - a[0], b[1] - a[1]) for a, b in pairwise(corners))
        closed = corners[-1] == corners[0]
        found.append(Mover(radius_m, obstacle.speed_mps, corners, lengths_m, closed))
    return tuple(found)


def place(mover: Mover, time_s: float) -> Vec2:
    """Centre at a simulation time."""
    way_m = mover.way_m
    along_m = mover.speed_mps * time_s % (way_m if mover.closed else 2.0 * way_m)
    if along_m > way_m:
        along_m = 2.0 * way_m - along_m
    for (begin, end), leg_m in zip(pairwise(mover.corners), mover.lengths_m, strict=True):
        if along_m < leg_m:
            share = along_m / leg_m
            return (
                begin[0] + share * (end[0] - begin[0]),
                begin[1] + share * (end[1] - begin[1]),
            )
        along_m -= leg_m
    return mover.corners[-1]


def places_m(movers: Sequence[Mover], time_s: float) -> Floats:
    """(movers, 2) centres at a simulation time, world frame."""
    return np.array([place(mover, time_s) for mover in movers]).reshape(-1, 2)


def radii_m(movers: Sequence[Mover]) -> Floats:
    """(movers,)"""
    return np.array([mover.radius_m for mover in movers])
