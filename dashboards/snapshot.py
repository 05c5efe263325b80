"""What every picture needs of a tick, as arrays; worked out once for all who draw it.

    TickRecord --motion--> (robots, 7)      --scan--> (hits, 2) m

The recorder's channels and the live view ask for the same tick one after the other, so each
function remembers its newest answer.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from math import ceil

import numpy as np

from swarm import geometry
from swarm.geometry import Floats
from swarm.messages import TickRecord

DETAIL_ROBOTS = 20  # a larger swarm's scans, forces, errors and distances are drawn less often
SCAN_TICKS = 3  # scans cost as much as all the rest, and what they see mostly stands still
X, Y, YAW, SPEED, CLEARANCE, ALIVE, CONTACT = range(7)  # columns of motion


def detail_ticks(robots: int) -> int:
    """Every how many ticks a swarm is drawn in full: 1 up to 20 robots, 5 for 100."""
    return ceil(robots / DETAIL_ROBOTS)


def scan_ticks(robots: int) -> int:
    """Every how many ticks the scans are drawn."""
    return max(SCAN_TICKS, detail_ticks(robots))


def _remembered(function: Callable[[TickRecord], Floats]) -> Callable[[TickRecord], Floats]:
    newest: list[tuple[TickRecord, Floats]] = []

    def ask(record: TickRecord) -> Floats:
        if not newest or newest[0][0] is not record:
            newest[:] = [(record, function(record))]
        return newest[0][1]

    return ask


@_remembered
def motion(record: TickRecord) -> Floats:
    """(robots, 7): x_m, y_m, yaw_rad, speed_mps, clearance to obstacles in m, alive, contact.

    One flat list is four times faster than an array of tuples.
    """
    flat: list[float] = []
    for robot in record.robots:
        pose = robot.pose
        flat += (
            pose.x_m,
            pose.y_m,
            pose.yaw_rad,
            robot.twist.speed_mps,
            robot.obstacle_clearance_m,
            robot.alive,
            robot.contact,
        )
    return np.fromiter(flat, np.float64, len(flat)).reshape(-1, 7)


@_remembered
def placements(record: TickRecord) -> Floats:
    """(robots, 4): x_m, y_m, and the z and w of the heading's quaternion."""
    poses = motion(record)
    half_rad = 0.5 * poses[:, YAW]
    result = np.empty((len(poses), 4))
    result[:, :2] = poses[:, :2]
    np.sin(half_rad, out=result[:, 2])
    np.cos(half_rad, out=result[:, 3])
    return result


@_remembered
def scan(record: TickRecord) -> Floats:
    """(hits, 2) m, world frame: where the beams of all robots ended; misses are left out."""
    frames = record.frames
    if not frames:
        return np.empty((0, 2))
    beams = frames[0].ranges.shape[0]
    ranges_m = np.frombuffer(b"".join([frame.ranges.data for frame in frames]), "<f4")
    hits = np.flatnonzero(np.isfinite(ranges_m))
    rows, beam = np.divmod(hits, beams)
    poses = np.array([(frame.pose.x_m, frame.pose.y_m, frame.pose.yaw_rad) for frame in frames])
    angles_rad = poses[rows, 2] + _centres(beams)[beam]
    points = poses[rows, :2]
    reach_m = ranges_m[hits]
    points[:, 0] += reach_m * np.cos(angles_rad)
    points[:, 1] += reach_m * np.sin(angles_rad)
    return points


@cache
def _centres(beams: int) -> Floats:
    return np.array(geometry.sector_centres(beams))
