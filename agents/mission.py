"""Where a formation goes: known from the leaders that one followed, taken over from the last.

leader's beacon --learn--> Mission        Mission, bodies --take_over--> the new leader's
"""

from __future__ import annotations

from collections.abc import Collection, Iterable

import msgspec

from agents.peers import Body, Peer
from swarm import geometry
from swarm.geometry import Pose, Vec2
from swarm.scenario import RobotSetup

# A place that is taken is approached no further than this beyond touching.
BESIDE_M = 0.5


class Mission(msgspec.Struct, frozen=True):
    """Goal, and the way-points still ahead of it."""

    goal: Vec2 | None
    via: tuple[Vec2, ...] = ()


def learn(known: Mission | None, leader: Peer | None, others: Iterable[Peer]) -> Mission | None:
    """What the leader says, or without one, for who knows nothing, what anybody has heard."""
    if leader is not None:
        beacon = leader.beacon
        if known is not None and known.goal == beacon.goal and known.via == beacon.via:
            return known
        return Mission(beacon.goal, beacon.via)
    if known is None:
        for peer in others:
            if peer.beacon.leadership is not None and peer.beacon.goal is not None:
                return Mission(peer.beacon.goal, peer.beacon.via)
    return known


def take_over(mission: Mission, pose: Pose, radius_m: float, bodies: Collection[Body]) -> Mission:
    """Mission of a new leader: where a body stands it cannot go, so it stops beside that.

    The leader before it may have come to grief on a way-point, which then counts as passed, or on
    the goal itself, which then moves towards the new leader.
    """
    via = mission.via
    while via and any(_away(body, via[0]) < radius_m + body.radius_m + BESIDE_M for body in bodies):
        via = via[1:]
    goal = mission.goal
    if goal is None:
        return Mission(None, via)
    for body in bodies:
        clear_m = radius_m + body.radius_m + BESIDE_M
        if _away(body, goal) >= clear_m:
            continue
        x_m, y_m = pose.x_m - body.x_m, pose.y_m - body.y_m
        away_m = geometry.length(x_m, y_m)
        if away_m > 0.0:
            goal = (body.x_m + clear_m * x_m / away_m, body.y_m + clear_m * y_m / away_m)
    return Mission(goal, via)


def bound_for(setup: RobotSetup, mission: Mission) -> RobotSetup:
    """Setup with the goal and way-points of a mission for the robot's own."""
    robot = setup.robot
    if robot.goal == mission.goal and robot.via == mission.via:
        return setup
    robot = msgspec.structs.replace(robot, goal=mission.goal, via=mission.via)
    return msgspec.structs.replace(setup, robot=robot)


def _away(body: Body, point: Vec2) -> float:
    return geometry.length(point[0] - body.x_m, point[1] - body.y_m)
