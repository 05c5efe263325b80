"""The lidar: every beam of every robot against circles, bodies and edges, all at once.

    pairs (robot, object) within range -> the beams that can meet it -> exact distances -> nearest

Each object is first moved into the body frame, and beam directions come from angles that are
exactly antisymmetric, so mirrored robots in mirrored scenes measure bit-for-bit mirrored ranges.
Which beams can meet an object is estimated from its bearing with a margin: that only saves work,
the distances alone decide.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, sin

import msgspec
import numpy as np
import numpy.typing as npt

from swarm import geometry
from swarm.geometry import Floats, Pose, Ranges
from world.scene import Scene

Indices = npt.NDArray[np.int64]

MARGIN_BEAMS = 0.01  # each side; rounding moves a bearing by less than 1e-7 rad even at a tangent


class Lidar(msgspec.Struct, frozen=True, eq=False):
    """Beam directions in the body frame and how far they reach."""

    range_m: float
    forward: Floats  # (beams,) cosines
    left: Floats  # (beams,) sines


def lidar(beams: int, range_m: float) -> Lidar:
    """Lidar with equal beams over the whole circle, beam k towards sector_centres(beams)[k]."""
    centres_rad = geometry.sector_centres(beams)
    return Lidar(
        range_m,
        np.array([cos(angle_rad) for angle_rad in centres_rad]),
        np.array([sin(angle_rad) for angle_rad in centres_rad]),
    )


def cast(
    sensor: Lidar, scene: Scene, poses: Sequence[Pose], radii_m: Floats, rows: Sequence[int]
) -> Ranges:
    """What the lidars of some robots measure.

    From the axle centre to the nearest surface; zero for a beam that starts inside a circle.
    Polygons are outlines: a robot's contact ends its way before its axle could get inside.

    Args:
        poses: of all robots, whose bodies are circles of radii_m (robots,).
        rows: whose lidars are asked.
    Returns:
        (rows, beams) m, inf where nothing is hit within range; read-only.
    """
    beams = len(sensor.forward)
    nearest_m = np.full(len(rows) * beams, np.inf)
    positions_m = np.array([(pose.x_m, pose.y_m) for pose in poses]).reshape(-1, 2)
    own = np.array(rows, dtype=np.int64)
    axes = np.array([(cos(poses[row].yaw_rad), sin(poses[row].yaw_rad)) for row in rows]).reshape(
        -1, 2
    )
    _cast_circles(sensor, scene, positions_m, radii_m, own, axes, nearest_m)
    if len(scene.edges):
        _cast_edges(sensor, scene, positions_m[own], axes, nearest_m)
    nearest_m[nearest_m > sensor.range_m] = np.inf
    ranges_m: Ranges = nearest_m.astype(np.float32).reshape(len(rows), beams)
    ranges_m.flags.writeable = False
    return ranges_m


def _cast_circles(
    sensor: Lidar,
    scene: Scene,
    positions_m: Floats,
    radii_m: Floats,
    own: Indices,
    axes: Floats,
    nearest_m: Floats,
) -> None:
    """Lowers nearest_m to the obstacles' circles and the other robots' bodies."""
    obstacles = len(scene.circles)
    x_m = np.concatenate((scene.circles[:, 0], positions_m[:, 0]))
    y_m = np.concatenate((scene.circles[:, 1], positions_m[:, 1]))
    radius_m = np.concatenate((scene.circles[:, 2], radii_m))
    dx_m = x_m - positions_m[own, 0, None]
    dy_m = y_m - positions_m[own, 1, None]
    squared_m2 = dx_m * dx_m + dy_m * dy_m
    reach_m = radius_m + sensor.range_m
    near = squared_m2 <= reach_m * reach_m
    near[np.arange(len(own)), obstacles + own] = False
    observer, thing = near.nonzero()
    dx_m, dy_m = dx_m[near], dy_m[near]
    forward, left = axes[observer, 0], axes[observer, 1]
    ahead_m = forward * dx_m + left * dy_m
    aside_m = forward * dy_m - left * dx_m
    radius_m = radius_m[thing]
    distance_m = np.maximum(np.sqrt(squared_m2[near]), radius_m)
    half_rad = np.where(
        distance_m > radius_m, np.arcsin(radius_m / distance_m), np.pi
    )  # inside: every beam
    bearing_rad = np.arctan2(aside_m, ahead_m)
    pair, beam = _beams(len(sensor.forward), bearing_rad - half_rad, bearing_rad + half_rad)
    beam_forward, beam_left = sensor.forward[beam], sensor.left[beam]
    ahead_m, aside_m, radius_m = ahead_m[pair], aside_m[pair], radius_m[pair]
    along_m = ahead_m * beam_forward + aside_m * beam_left
    across_m = aside_m * beam_forward - ahead_m * beam_left
    squared_m2 = radius_m * radius_m - across_m * across_m
    half_chord_m = np.sqrt(np.maximum(squared_m2, 0.0))
    hit = (squared_m2 >= 0.0) & (along_m + half_chord_m >= 0.0)
    range_m = np.maximum(along_m - half_chord_m, 0.0)
    cell = observer[pair] * len(sensor.forward) + beam
    np.minimum.at(nearest_m, cell[hit], range_m[hit])


def _cast_edges(
    sensor: Lidar, scene: Scene, positions_m: Floats, axes: Floats, nearest_m: Floats
) -> None:
    """Lowers nearest_m to the polygons' edges."""
    ax_m, ay_m, bx_m, by_m = scene.edges.T
    half_x_m, half_y_m = (bx_m - ax_m) / 2.0, (by_m - ay_m) / 2.0
    reach_m = sensor.range_m + np.sqrt(half_x_m * half_x_m + half_y_m * half_y_m)
    dx_m = (ax_m + bx_m) / 2.0 - positions_m[:, 0, None]
    dy_m = (ay_m + by_m) / 2.0 - positions_m[:, 1, None]
    observer, edge = (dx_m * dx_m + dy_m * dy_m <= reach_m * reach_m).nonzero()
    forward, left = axes[observer, 0], axes[observer, 1]
    here_x_m, here_y_m = positions_m[observer, 0], positions_m[observer, 1]
    dx_m, dy_m = ax_m[edge] - here_x_m, ay_m[edge] - here_y_m
    a_ahead_m, a_aside_m = forward * dx_m + left * dy_m, forward * dy_m - left * dx_m
    dx_m, dy_m = bx_m[edge] - here_x_m, by_m[edge] - here_y_m
    b_ahead_m, b_aside_m = forward * dx_m + left * dy_m, forward * dy_m - left * dx_m
    a_rad, b_rad = np.arctan2(a_aside_m, a_ahead_m), np.arctan2(b_aside_m, b_ahead_m)
    turn_rad = (b_rad - a_rad + np.pi) % geometry.TAU - np.pi
    start_rad = np.where(turn_rad >= 0.0, a_rad, b_rad)
    width_rad = np.abs(turn_rad)
    # Seen edge-on from between its corners an edge may lie on either side: ask every beam.
    width_rad[width_rad > np.pi - 0.01] = geometry.TAU
    pair, beam = _beams(len(sensor.forward), start_rad, start_rad + width_rad)
    beam_forward, beam_left = sensor.forward[beam], sensor.left[beam]
    a_ahead_m, a_aside_m = a_ahead_m[pair], a_aside_m[pair]
    b_ahead_m, b_aside_m = b_ahead_m[pair], b_aside_m[pair]
    # Neighbouring edges share a corner and hence these numbers, so no beam slips between them.
    a_across_m = a_aside_m * beam_forward - a_ahead_m * beam_left
    b_across_m = b_aside_m * beam_forward - b_ahead_m * beam_left
    a_along_m = a_ahead_m * beam_forward + a_aside_m * beam_left
    b_along_m = b_ahead_m * beam_forward + b_aside_m * beam_left
    apart_m = a_across_m - b_across_m
    hit = (a_across_m * b_across_m <= 0.0) & (apart_m != 0.0)  # apart 0: the neighbours see it
    range_m = (a_across_m * b_along_m - b_across_m * a_along_m)[hit] / apart_m[hit]
    cell = (observer[pair] * len(sensor.forward) + beam)[hit]
    seen = range_m >= 0.0
    np.minimum.at(nearest_m, cell[seen], range_m[seen])


def _beams(beams: int, low_rad: Floats, high_rad: Floats) -> tuple[Indices, Indices]:
    """Every (pair, beam) whose direction lies between two body angles of that pair, and a few more.

    Args:
        low_rad, high_rad: (pairs,) not wrapped, low <= high.
    Returns:
        (candidates,) number of the pair; (candidates,) number of the beam.
    """
    width_rad = geometry.TAU / beams
    middle = (beams - 1) / 2.0
    first = np.ceil(low_rad / width_rad + (middle - MARGIN_BEAMS)).astype(np.int64)
    last = np.floor(high_rad / width_rad + (middle + MARGIN_BEAMS)).astype(np.int64)
    count = np.clip(last - first + 1, 0, beams)
    ends = count.cumsum()
    pair = np.repeat(np.arange(len(count)), count)
    beam = np.arange(len(pair)) + (first - ends + count)[pair]
    return pair, beam % beams
