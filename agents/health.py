"""Whether a robot may trust its own sensors and motors.

    scan, pose --> blind? frozen?        set-point, measured twist --> motors that do not follow?

What cannot be true is never acted on: the robot stands, and says why. It goes on by itself as soon
as the sensors tell something new, or the motors move.
"""

from __future__ import annotations

import zlib
from math import inf

import msgspec
import numpy as np

from agents import msam
from agents.peers import Peer
from swarm import geometry
from swarm.geometry import Pose, Ranges, Twist, wrap_angle
from swarm.messages import Reason, SensorFrame
from swarm.scenario import RobotSetup

# So many scans in a row that are equal to the bit, while the robot moved this far, are one scan.
# After a false alarm (along a wall without end nothing changes) it takes more, up to a bound.
FROZEN_SCANS = 3
FROZEN_SCANS_FACTOR = 4
FROZEN_SCANS_MAX = 48
FROZEN_MOVED_M = 0.02
FROZEN_MOVED_RAD = 0.02
# A robot with a frozen scan turns on the spot at this rate, to see whether the scan does too.
PROBE_RADPS = 0.5
# Motors are asked for something beyond the first figures and do nothing, below the second.
ASKED_MPS, ASKED_RADPS = 0.1, 0.2
DONE_MPS, DONE_RADPS = 0.02, 0.05
DEAD_S = 1.5
# A leader that sees nothing hands over after this long.
BLIND_S = 0.5


class State(msgspec.Struct, frozen=True):
    """What the last scans were like, and for how long the motors have not followed."""

    scan: int = 0  # checksum of the last one
    scan_pose: Pose | None = None  # where it was first seen
    scans: int = 0  # equal to it, in a row
    scans_max: int = FROZEN_SCANS
    frozen: bool = False
    blind_s: float = 0.0  # nothing to be seen, in a row
    dead_s: float = 0.0  # motors asked in vain


def step(
    setup: RobotSetup,
    state: State,
    frame: SensorFrame,
    map: msam.Map,
    others: list[Peer],
    asked: Twist,
    *,
    trusted: bool,
) -> State:
    """Health at this tick.

    Args:
        map: of this scan.
        others: peers; they may move with the robot, and what is seen of them then stays the same.
        asked: set-point of the tick before.
        trusted: whether everything in the frame can be true.
    """
    scan = zlib.crc32(frame.ranges.data)
    pose, scans, scans_max, frozen = frame.pose, 1, state.scans_max, False
    if scan == state.scan and state.scan_pose is not None:
        pose, scans = state.scan_pose, state.scans + 1
        frozen = state.frozen or (
            scans >= scans_max
            and _has_moved(pose, frame.pose)
            and _sees_obstacles(setup, map, others)
        )
    elif state.frozen:
        scans_max = min(FROZEN_SCANS_MAX, FROZEN_SCANS_FACTOR * scans_max)
    blind_s = 0.0 if trusted and not frozen else state.blind_s + setup.dt_s
    dead_s = _dead_s(state.dead_s, frame.twist, asked, setup.dt_s)
    return State(scan, pose, scans, scans_max, frozen, blind_s, dead_s)


def known_ranges(ranges_m: Ranges) -> tuple[Ranges, bool]:
    """Scan with a miss for every beam of which nothing is known, and whether there is none."""
    unknown = np.isnan(ranges_m)
    if not unknown.any():
        return ranges_m, True
    return np.where(unknown, np.float32(np.inf), ranges_m), False


def complaint(state: State) -> Reason:
    """What is wrong, if anything."""
    if state.blind_s > 0.0:
        return "sensors"
    return "motors" if state.dead_s >= DEAD_S else ""


def _dead_s(dead_s: float, twist: Twist, asked: Twist, elapsed_s: float) -> float:
    """For how long motors stood when they should not; forgotten while nothing is asked of them."""
    if abs(twist.speed_mps) > DONE_MPS or abs(twist.turn_rate_radps) > DONE_RADPS:
        return 0.0
    if abs(asked.speed_mps) > ASKED_MPS or abs(asked.turn_rate_radps) > ASKED_RADPS:
        return dead_s + elapsed_s
    return max(0.0, dead_s - elapsed_s)


def _sees_obstacles(setup: RobotSetup, map: msam.Map, others: list[Peer]) -> bool:
    """Whether a map has hits that do not belong to peers."""
    beams_m: list[float] = map.ranges_m.tolist()
    directions = msam.layout(len(beams_m), len(map.sectors_m))
    hidden = set(msam.peer_beams(setup.msam, directions, beams_m, others))
    return any(range_m < inf and beam not in hidden for beam, range_m in enumerate(beams_m))


def _has_moved(before: Pose, pose: Pose) -> bool:
    return (
        geometry.length(pose.x_m - before.x_m, pose.y_m - before.y_m) > FROZEN_MOVED_M
        or abs(wrap_angle(pose.yaw_rad - before.yaw_rad)) > FROZEN_MOVED_RAD
    )
