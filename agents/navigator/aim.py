"""What the stages of the navigator hand on to each other."""

from __future__ import annotations

import msgspec

from swarm.geometry import Vec2
from swarm.messages import Reason


class Aim(msgspec.Struct, frozen=True):
    """Where to go at this tick, and how fast at most: out of the way, into the cells and forces."""

    direction_rad: float  # world, of the sub-goal; that of the way where there is none
    speed_mps: float  # cap: clearance along the way, distance to the goal
    subgoal: Vec2  # world, the point that the robot is drawn to
    distance_m: float  # straight to the goal, or to the way-point that comes next
    is_last: bool  # whether the goal itself comes next, not a way-point
    reason: Reason = ""  # why there is no way; "" when there is one
    held: bool = False  # it waits for others, so that clocks of the way stand
    open_mps: float = 0.0  # cap by the goal alone, where the cells see to clearances
