"""Where the robot will be when what it decides now takes effect.

pose, twist measured; set-points under way --predict--> pose, twist
"""

from __future__ import annotations

import msgspec

from agents import lateness
from agents.navigator import brake
from swarm import geometry
from swarm.messages import SensorFrame
from swarm.scenario import RobotSetup


def ahead(setup: RobotSetup, late: lateness.State, frame: SensorFrame) -> SensorFrame:
    """The frame with pose and twist moved on by the set-points that have no effect yet."""
    pose, twist = frame.pose, frame.twist
    for set_point in reversed(late.sent[: late.late_ticks]):
        twist = brake.reached(setup.robot, twist, set_point, setup.dt_s)
        pose = geometry.advance(pose, twist, setup.dt_s)
    if pose is frame.pose:
        return frame
    return msgspec.structs.replace(frame, pose=pose, twist=twist)
