"""Where the robot will be when what it decides now takes effect.

pose, twist measured; set-points under way --predict--> pose, twist
                                           --pending--> twists until then, as it announces them
"""

from __future__ import annotations

import msgspec

from agents import lateness
from agents.navigator import brake
from swarm import geometry
from swarm.geometry import STILL, Twist
from swarm.messages import SensorFrame
from swarm.scenario import RobotSetup


def ahead(setup: RobotSetup, late: lateness.State, frame: SensorFrame) -> SensorFrame:
    """The frame with pose and twist moved on by the set-points that have no effect yet."""
    pose, twist = frame.pose, frame.twist
    for twist in pending(setup, late, frame):
        pose = geometry.advance(pose, twist, setup.dt_s)
    if pose is frame.pose:
        return frame
    return msgspec.structs.replace(frame, pose=pose, twist=twist)


def pending(setup: RobotSetup, late: lateness.State, frame: SensorFrame) -> tuple[Twist, ...]:
    """What the body will do in the coming ticks, whatever is decided now.

    Before the first set-points motors stand still.
    """
    if not late.late_ticks:
        return ()
    twist = frame.twist
    under_way = late.sent[: late.late_ticks]
    under_way += (STILL,) * (late.late_ticks - len(under_way))
    twists: list[Twist] = []
    for set_point in reversed(under_way):
        twist = brake.reached(setup.robot, twist, set_point, setup.dt_s)
        twists.append(twist)
    return tuple(twists)
