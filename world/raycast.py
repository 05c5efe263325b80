"""The lidar: every beam of every robot against circles, bodies, what moves and edges, all at once.

    pairs (robot, thing) within range -> the beams that can meet it -> exact distances -> nearest

Each thing is first moved into the body frame, and beam directions come from angles that are
exactly antisymmetric, so mirrored robots in mirrored scenes measure bit-for-bit mirrored ranges.
Which beams can meet a thing is estimated from its bearing with a margin: that only saves work,
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
Flags = npt.NDArray[np.bool_]

MARGIN_BEAMS = 0.01  # each side; rounding moves a bearing by less than 1e-7 rad even at a tangent
NONE_M: Floats = np.empty(0)
NOWHERE_M: Floats = np.empty((0, 2))
EDGE_ON_RAD = 0.01  # an edge seen under more than pi less this has the lidar nearly on it


class Lidar(msgspec.Struct, frozen=True, eq=False):
    """All that stays the same from one scan to the next."""

    range_m: float
    beams: Floats  # (2, beams) forward and left part of each direction, body frame
    circles_m: Floats  # (2, obstacles) centres
    # things: circles, then bodies, then what moves
    radii_m: Floats  # (things,)
    reach_m2: Floats  # (things,) squared distance from which they can be seen
    others: Flags  # (robots, things) false for a robot's own body
    corners_m: Floats  # (2, 2, edges) x or y; from or to
    middles_m: Floats  # (2, edges)
    middle_reach_m2: Floats  # (edges,)


def lidar(
    beams: int, range_m: float, scene: Scene, radii_m: Floats, mover_radii_m: Floats = NONE_M
) -> Lidar:
    """Lidars of robots whose bodies are circles of radii_m (robots,), among some obstacles.

    The beams are equal and cover the whole circle, beam k towards sector_centres(beams)[k].
    """
    centres_rad = geometry.sector_centres(beams)
    things_m = np.concatenate((scene.circles[:, 2], radii_m, mover_radii_m))
    reach_m = things_m + range_m
    robots = len(radii_m)
    corners_m = scene.edges.reshape(-1, 2, 2).transpose(2, 1, 0)
    halves_m = (corners_m[:, 1] - corners_m[:, 0]) / 2.0
    middle_reach_m = range_m + np.sqrt((halves_m * halves_m).sum(axis=0))
    return Lidar(
        range_m=range_m,
        beams=np.array(
            [[cos(angle_rad) for angle_rad in centres_rad], [sin(a) for a in centres_rad]]
        ),
        circles_m=np.ascontiguousarray(scene.circles[:, :2].T),
        radii_m=things_m,
        reach_m2=reach_m * reach_m,
        others=~np.eye(robots, len(things_m), len(scene.circles), dtype=np.bool_),
        corners_m=corners_m,
        middles_m=corners_m[:, 0] + halves_m,
        middle_reach_m2=middle_reach_m * middle_reach_m,
    )


def cast(
    sensor: Lidar, poses: Sequence[Pose], rows: Sequence[int], movers_m: Floats = NOWHERE_M
) -> Ranges:
    """What the lidars of some robots measure: from the axle centre to the nearest surface.

    A lidar is never inside a thing, bodies stop at the first contact and have a radius, but for
    what moves and has run over it: then every beam measures 0.

    Args:
        poses: of all robots.
        rows: whose lidars are asked.
        movers_m: (movers, 2) centres, world frame.
    Returns:
        (rows, beams) m, inf where nothing is hit within range; read-only.
    """
    beams = sensor.beams.shape[1]
    nearest_m = np.full(len(rows) * beams, np.inf)
    if rows:
        positions_m = np.array([(pose.x_m, pose.y_m) for pose in poses]).T
        own = np.array(rows)
        axes = np.array([(cos(poses[row].yaw_rad), sin(poses[row].yaw_rad)) for row in rows]).T
        _cast_circles(sensor, positions_m, own, axes, movers_m.T, nearest_m)
        if sensor.corners_m.size:
            _cast_edges(sensor, positions_m[:, own], axes, nearest_m)
    nearest_m[nearest_m > sensor.range_m] = np.inf
    ranges_m: Ranges = nearest_m.astype(np.float32).reshape(len(rows), beams)
    ranges_m.flags.writeable = False
    return ranges_m


def _cast_circles(
    sensor: Lidar,
    positions_m: Floats,
    own: Indices,
    axes: Floats,
    movers_m: Floats,
    nearest_m: Floats,
) -> None:
    """Lowers nearest_m to the obstacles' circles, the other robots' bodies and what moves."""
    centres_m = np.concatenate((sensor.circles_m, positions_m, movers_m), axis=1)
    offsets_m = centres_m[:, None] - positions_m[:, own, None]  # (2, rows, things)
    squares_m2 = offsets_m * offsets_m
    distances_m2 = squares_m2[0] + squares_m2[1]
    near = ((distances_m2 <= sensor.reach_m2) & sensor.others[own]).ravel().nonzero()[0]
    observer, thing = np.divmod(near, len(sensor.radii_m))
    radius_m = sensor.radii_m[thing]
    ahead_m, aside_m = _into_body(offsets_m.reshape(2, -1)[:, near], axes[:, observer])
    distance_m = np.sqrt(distances_m2.ravel()[near])
    inside = distance_m < radius_m
    half_rad = np.arcsin(np.where(inside, 1.0, radius_m) / np.where(inside, 1.0, distance_m))
    half_rad[inside] = np.pi
    bearing_rad = np.arctan2(aside_m, ahead_m)
    pair, beam = _beams(sensor.beams.shape[1], bearing_rad - half_rad, bearing_rad + half_rad)
    along_m, across_m = _into_body((ahead_m[pair], aside_m[pair]), sensor.beams[:, beam])
    square_m2 = (radius_m * radius_m)[pair] - across_m * across_m  # of half the chord
    range_m = along_m - np.sqrt(np.maximum(square_m2, 0.0))
    range_m[square_m2 < 0.0] = np.inf
    range_m[inside[pair]] = 0.0
    np.minimum.at(nearest_m, observer[pair] * sensor.beams.shape[1] + beam, range_m)


def _cast_edges(sensor: Lidar, positions_m: Floats, axes: Floats, nearest_m: Floats) -> None:
    """Lowers nearest_m to the polygons' edges."""
    offsets_m = sensor.middles_m[:, None] - positions_m[:, :, None]  # (2, rows, edges)
    squares_m2 = offsets_m * offsets_m
    observer, edge = (squares_m2[0] + squares_m2[1] <= sensor.middle_reach_m2).nonzero()
    corners_m = sensor.corners_m[:, :, edge] - positions_m[:, None, observer]
    ahead_m, aside_m = _into_body(corners_m, axes[:, None, observer])  # (2, pairs) from, to
    from_rad, to_rad = np.arctan2(aside_m, ahead_m)
    turn_rad = (to_rad - from_rad + np.pi) % geometry.TAU - np.pi
    start_rad = np.where(turn_rad >= 0.0, from_rad, to_rad)
    width_rad = np.abs(turn_rad)
    # Seen edge-on from between its corners an edge may lie on either side: ask every beam.
    width_rad[width_rad > np.pi - EDGE_ON_RAD] = geometry.TAU
    pair, beam = _beams(sensor.beams.shape[1], start_rad, start_rad + width_rad)
    along_m, across_m = _into_body(
        (ahead_m[:, pair], aside_m[:, pair]), sensor.beams[:, None, beam]
    )
    # Neighbouring edges share a corner and hence these numbers: no beam slips between them. A beam
    # along an edge is left to the neighbours.
    apart_m = across_m[0] - across_m[1]
    hit = (across_m[0] * across_m[1] <= 0.0) & (apart_m != 0.0)
    crossed_m2 = across_m[0] * along_m[1] - across_m[1] * along_m[0]
    range_m = np.full(len(hit), np.inf)
    np.divide(crossed_m2, apart_m, out=range_m, where=hit)
    range_m[range_m < 0.0] = np.inf
    np.minimum.at(nearest_m, observer[pair] * sensor.beams.shape[1] + beam, range_m)


def _into_body(vectors: Floats | tuple[Floats, Floats], axes: Floats) -> tuple[Floats, Floats]:
    """Part of vectors (2, ...) along directions (2, ...), and part to their left."""
    (x, y), (forward, left) = vectors, axes
    return x * forward + y * left, y * forward - x * left


def _beams(beams: int, low_rad: Floats, high_rad: Floats) -> tuple[Indices, Indices]:
    """Every (pair, beam) whose direction lies between two body angles of that pair, and few more.

    Args:
        low_rad, high_rad: (pairs,) not wrapped, low <= high.
    Returns:
        (candidates,) number of the pair; (candidates,) number of the beam.
    """
    per_rad = beams / geometry.TAU
    middle = (beams - 1) / 2.0
    first = np.ceil(low_rad * per_rad + (middle - MARGIN_BEAMS)).astype(np.int64)
    last = np.floor(high_rad * per_rad + (middle + MARGIN_BEAMS)).astype(np.int64)
    count = np.minimum(last - first + 1, beams)
    ends = count.cumsum()
    pair = np.repeat(np.arange(len(count)), count)
    beam = np.arange(len(pair)) + (first - ends + count)[pair]
    return pair, beam % beams
