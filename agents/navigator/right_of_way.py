"""Right of way: who goes first, and round what.

    Aim, peers --gap claims--> target --stuck? roundabout?--> Way
"""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2

import msgspec

from agents.navigator import roundabout, stuck
from agents.navigator.aim import Aim
from agents.peers import Peer
from swarm.geometry import Floats, Vec2, wrap_angle
from swarm.messages import Name, Passage, SensorFrame
from swarm.scenario import RobotSetup

SIGHT_M = 4.2  # as far as hits are looked at for gaps


class State(msgspec.Struct, frozen=True):
    """What the rules remember."""

    roundabout: roundabout.State = roundabout.State()
    stuck: stuck.State = stuck.State()
    passage: Passage | None = None


class Way(msgspec.Struct, frozen=True):
    """Where right of way sends the robot."""

    direction_rad: float  # world
    speed_mps: float
    target: Vec2  # m, world: announced
    active: bool  # on its way there
    round: bool = False  # it goes round a roundabout
    yields_to: Name | None = None


def step(
    setup: RobotSetup,
    state: State,
    frame: SensorFrame,
    aim: Aim,
    peers: Floats,
    seen: Sequence[Peer],
    points: Floats,
    elapsed_s: float,
    *,
    parked: bool,
) -> tuple[State, Way]:
    """State and way at this tick.

    Args:
        peers, seen: of `table.of`.
        points: (n, 2) m from here, world axes.
    """
    robot = setup.robot
    position = (frame.pose.x_m, frame.pose.y_m)
    direction_rad, speed_mps = aim.direction_rad, aim.speed_mps
    target = aim.subgoal
    if parked:
        return State(), Way(direction_rad, 0.0, target, False)
    stuck_ = stuck.step(state.stuck, position, aim.distance_m, elapsed_s, free=True)
    circle, round_ = state.roundabout, False
    if stuck_.escape_s > 0.0:
        direction_rad = wrap_angle(direction_rad + stuck_.turn_rad())
    elif speed_mps > roundabout.SPEED_MIN * robot.speed_mps_max:
        circle, turned_rad = roundabout.step(
            circle,
            position,
            target,
            direction_rad,
            robot.speed_mps_max,
            robot.body_radius_m,
            peers,
            elapsed_s,
        )
        if turned_rad is not None:
            direction_rad, round_ = turned_rad, True
    active = stuck_.escape_s <= 0.0
    state = State(circle, stuck_, state.passage)
    return state, Way(direction_rad, speed_mps, target, active, round_)
