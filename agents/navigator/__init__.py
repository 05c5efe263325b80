"""A robot that always arrives: a map with memory, a way through it, right of way, a safe speed.

    scan --insert--> memory --navigation function--> Aim
    Aim, peers --right of way: roundabout, gap claims--> Aim
    Aim, peers, memory --cells in time--> direction, speed --forces--> wish --guard--> set-point

Each stage is a module of pure functions with a state of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2

import msgspec

from agents import msam, steering
from agents.navigator.aim import Aim
from agents.peers import Peer
from agents.steering import Wish
from swarm import geometry
from swarm.messages import Forces, SensorFrame
from swarm.scenario import RobotSetup

__all__ = ["Aim", "State", "step"]


class State(msgspec.Struct, frozen=True):
    """What the stages remember."""

    via_index: int = 0


def step(
    setup: RobotSetup,
    state: State,
    frame: SensorFrame,
    map: msam.Map,
    others: Sequence[Peer],
    elapsed_s: float,
) -> tuple[State, Wish]:
    """One tick on the way to `setup.robot.goal` by way of its way-points."""
    state, aim = look(setup, state, frame, map)
    if aim.is_last and aim.distance_m < setup.robot.goal_tolerance_m:
        return state, Wish(mode="ARRIVED", arrived=True, waypoint=aim.subgoal)
    state, aim = give_way(setup, state, frame, others, aim, elapsed_s)
    direction_rad, speed_mps = choose(setup, state, frame, map, others, aim)
    return drive(setup, state, frame, map, direction_rad, speed_mps, aim)


def look(setup: RobotSetup, state: State, frame: SensorFrame, map: msam.Map) -> tuple[State, Aim]:
    """Memory and way: where to go were there no peers."""
    assert setup.robot.goal is not None
    x_m, y_m = setup.robot.goal[0] - frame.pose.x_m, setup.robot.goal[1] - frame.pose.y_m
    distance_m = geometry.length(x_m, y_m)
    speed_mps = min(setup.robot.speed_mps_max, setup.steering.approach_gain_1ps * distance_m)
    return state, Aim(atan2(y_m, x_m), speed_mps, setup.robot.goal, distance_m, True)


def give_way(
    setup: RobotSetup,
    state: State,
    frame: SensorFrame,
    others: Sequence[Peer],
    aim: Aim,
    elapsed_s: float,
) -> tuple[State, Aim]:
    """Right of way: virtual roundabout, claims to narrow gaps."""
    return state, aim


def choose(
    setup: RobotSetup,
    state: State,
    frame: SensorFrame,
    map: msam.Map,
    others: Sequence[Peer],
    aim: Aim,
) -> tuple[float, float]:
    """World direction and speed of the cheapest cell in time."""
    return aim.direction_rad, aim.speed_mps


def drive(
    setup: RobotSetup,
    state: State,
    frame: SensorFrame,
    map: msam.Map,
    direction_rad: float,
    speed_mps: float,
    aim: Aim,
) -> tuple[State, Wish]:
    """Forces along and across that direction, and what to ask of the motors."""
    pull = geometry.unit(direction_rad)
    speed_mps, turn_rate_radps = steering.head(
        setup.steering, setup.robot, pull, frame.pose.yaw_rad, speed_mps
    )
    forces = Forces(attractive=pull, resultant=pull)
    return state, Wish("GO", speed_mps, turn_rate_radps, forces=forces, waypoint=aim.subgoal)
