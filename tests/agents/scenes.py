"""Small exact worlds for the tests of one robot: discs, a scan of them, frames and beacons."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from typing import Any

import numpy as np

from agents import msam, peers
from agents.peers import Peer
from swarm import geometry, messages
from swarm.geometry import STILL, Pose, Ranges, Twist
from swarm.messages import Beacon, SensorFrame, Slot, Wheels
from swarm.scenario import Formation, Robot, RobotSetup

BEAMS = 216
RANGE_M = 5.0
DT_S = 0.08
ORIGIN = Pose(0.0, 0.0, 0.0)
Disc = tuple[float, float, float]  # x_m, y_m, radius_m


def scan(discs: Sequence[Disc], pose: Pose, beams: int = BEAMS) -> Ranges:
    """Ranges from a pose to the nearest disc along each beam, inf for a miss."""
    angles = np.array(geometry.sector_centres(beams)) + pose.yaw_rad
    ranges_m = np.full(beams, inf)
    for x_m, y_m, radius_m in discs:
        dx_m, dy_m = x_m - pose.x_m, y_m - pose.y_m
        along_m = dx_m * np.cos(angles) + dy_m * np.sin(angles)
        inside_m2 = radius_m**2 - (dx_m**2 + dy_m**2 - along_m**2)
        hit_m = along_m - np.sqrt(np.maximum(inside_m2, 0.0))
        hits = (inside_m2 > 0.0) & (hit_m >= 0.0) & (hit_m < RANGE_M)
        ranges_m = np.minimum(ranges_m, np.where(hits, hit_m, inf))
    return ranges_m.astype(np.float32)


def wall(distance_m: float, half_width: float = 0.4) -> Ranges:
    """Scan of a wall straight ahead, across x, seen within `half_width` rad of the heading."""
    angles = np.array(geometry.sector_centres(BEAMS))
    seen = np.abs(angles) < half_width
    return np.where(seen, distance_m / np.cos(angles), inf).astype(np.float32)


def nothing() -> Ranges:
    return np.full(BEAMS, inf, dtype=np.float32)


def alone(**changes: Any) -> RobotSetup:
    """A robot with a goal at (10, 0) and no formation; keywords of Robot or RobotSetup."""
    return _setup({"goal": (10.0, 0.0)}, {}, changes)


def leader(**changes: Any) -> RobotSetup:
    """The leader of Table I."""
    formation = {"formation": Formation(leader="leader"), "leads": True}
    return _setup(
        {"name": "leader", "goal": (18.0, 0.0)},
        {**formation, "slot_distance_m_max": 2.0 * 2.0**0.5},
        changes,
    )


def follower(slot: Slot, row: int = 1, **changes: Any) -> RobotSetup:
    """A follower of `leader` in a slot."""
    return _setup(
        {"name": f"robot{row}"},
        {
            "formation": Formation(leader="leader"),
            "slot": slot,
            "row": row,
            "slot_distance_m_max": 2.0 * 2.0**0.5,
        },
        changes,
    )


def _setup(robot: dict[str, Any], shared: dict[str, Any], changes: dict[str, Any]) -> RobotSetup:
    own = {key: value for key, value in changes.items() if key in Robot.__struct_fields__}
    rest = {key: value for key, value in changes.items() if key not in own}
    fields = {"row": 0, "dt_s": DT_S, "leads": False, "slot": None, "formation": None}
    fields |= {"slot_distance_m_max": 0.0, "places": ()}
    body = Robot(**{"name": "robot1", "start": (0.0, 0.0, 0.0), **robot, **own})
    return RobotSetup(robot=body, **{**fields, **shared, **rest})


def beacon(name: str, pose: Pose, twist: Twist = STILL, tick: int = 0, **changes: Any) -> Beacon:
    fields: dict[str, Any] = {
        "incarnation": 0,
        "body_radius_m": 0.22,
        "speed_mps_max": 1.0,
        "mode": "GO",
        "arrived": False,
        "priority": (1, 0, 0, 5),
    }
    if changes.get("leadership") is not None:
        fields["leader_tick"] = tick
    return Beacon(name=name, tick=tick, pose=pose, twist=twist, **{**fields, **changes})


def peer(beacon: Beacon, pose: Pose = ORIGIN, tick: int = 0) -> Peer:
    """A beacon as the robot at `pose` takes it at `tick`."""
    return peers.now((beacon,), pose, tick, DT_S)[0]


def frame(
    robot: str = "robot1",
    tick: int = 1,
    pose: Pose = ORIGIN,
    twist: Twist = STILL,
    ranges_m: Ranges | None = None,
    beacons: tuple[Beacon, ...] = (),
    contact: bool = False,
) -> SensorFrame:
    return SensorFrame(
        robot=robot,
        tick=tick,
        stamp_ns=round(tick * DT_S * 1e9),
        pose=pose,
        twist=twist,
        wheels=Wheels(0.0, 0.0),
        contact=contact,
        ranges=messages.array(nothing() if ranges_m is None else ranges_m),
        beacons=beacons,
    )


def look(setup: RobotSetup, ranges_m: Ranges, others: Sequence[Peer] = ()) -> msam.Map:
    return msam.update(setup, ranges_m, others)


def map_of(sectors_m: Sequence[float]) -> msam.Map:
    """Map with these sectors, to the ring."""
    ranges_m = np.repeat(np.array(sectors_m, dtype=np.float32) + np.float32(0.01), 3)
    return look(alone(), ranges_m)
