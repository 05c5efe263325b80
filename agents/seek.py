"""A robot with a goal of its own, a formation's leader or alone: GO, ARRIVED, FAILED.

goal, map, peers --forces (eq. 38)--> heading --> wish          as the paper reads
way that a navigator has found --forces across it--> heading --> wish
"""

from __future__ import annotations

from collections.abc import Iterable
from math import atan2

import msgspec

from agents import field, msam, navigator, steering
from agents.peers import Peer
from agents.steering import Wish
from swarm import geometry
from swarm.geometry import Pose, Vec2
from swarm.messages import Forces
from swarm.scenario import RobotSetup

# A found way attracts as a goal this far away does, at most: repulsion across it must count.
ATTRACTION_M_MAX = 15.0


class State(msgspec.Struct, frozen=True):
    """How far along its way a robot is."""

    via_index: int = 0  # of the way-point it goes to; their number: the goal itself


def step(
    setup: RobotSetup,
    state: State,
    pose: Pose,
    map: msam.Map,
    others: Iterable[Peer],
    *,
    speed_mps: float,
) -> tuple[State, Wish]:
    """One tick on the way to the goal, by the paper's field alone.

    Args:
        others: peers that push this robot off (F_ij).
        speed_mps: to drive at.
    """
    state = pass_waypoints(setup, state, pose)
    target, is_goal = target_of(setup, state)
    dx_m, dy_m = target[0] - pose.x_m, target[1] - pose.y_m
    distance_m = geometry.length(dx_m, dy_m)
    if is_goal and distance_m < setup.robot.goal_tolerance_m:
        return state, Wish(mode="ARRIVED", arrived=True, waypoint=target)
    forces = add_up(setup, pose, map, others, atan2(dy_m, dx_m), distance_m)
    if is_goal:
        speed_mps = min(speed_mps, setup.steering.approach_gain_1ps * distance_m)
    speed_mps, turn_rate_radps = steering.head(
        setup.steering, setup.robot, forces.resultant, pose.yaw_rad, speed_mps
    )
    return state, Wish("GO", speed_mps, turn_rate_radps, forces=forces, waypoint=target)


def along(
    setup: RobotSetup,
    aim: navigator.Aim,
    pose: Pose,
    map: msam.Map,
    others: Iterable[Peer],
    *,
    speed_mps: float,
) -> Wish:
    """One tick on the way that a navigator has found.

    Args:
        others: peers that push this robot off (F_ij).
        speed_mps: to drive at where nothing is in the way.
    """
    target = aim.subgoal
    if aim.reason:
        return Wish(mode="FAILED", waypoint=target, reason=aim.reason)
    if aim.is_last and aim.distance_m < setup.robot.goal_tolerance_m:
        return Wish(mode="ARRIVED", arrived=True, waypoint=target)
    forces = add_up(
        setup,
        pose,
        map,
        others,
        aim.direction_rad,
        aim.distance_m,
        pull_m=min(aim.distance_m, ATTRACTION_M_MAX),
        free=True,
    )
    if aim.is_last:
        speed_mps = min(speed_mps, setup.steering.approach_gain_1ps * aim.distance_m)
    speed_mps, turn_rate_radps = steering.head(
        setup.steering,
        setup.robot,
        forces.resultant,
        pose.yaw_rad,
        min(speed_mps, aim.speed_mps),
    )
    return Wish("GO", speed_mps, turn_rate_radps, forces=forces, waypoint=target)


def add_up(
    setup: RobotSetup,
    pose: Pose,
    map: msam.Map,
    others: Iterable[Peer],
    goal_rad: float,
    distance_m: float,
    *,
    pull_m: float | None = None,
    free: bool = False,
) -> Forces:
    """Forces of eq. 38.

    Args:
        pull_m: it is attracted as by a goal so far away; None: at its distance.
        free: the way there is known to be free, so nothing repels against it.
    """
    attractive = field.attractive(setup.field, goal_rad, distance_m if pull_m is None else pull_m)
    repulsive = field.repulsive(setup.field, map.arcs, pose.yaw_rad, distance_m)
    if free:
        repulsive = field.without_opposition(repulsive, goal_rad)
    rotating = field.rotating(setup.field, map.clusters, pose.yaw_rad, goal_rad)
    robots = field.between_robots(setup, others)
    return Forces(
        attractive,
        repulsive,
        rotating,
        robots,
        field.total(attractive, repulsive, rotating, robots),
    )


def pass_waypoints(setup: RobotSetup, state: State, pose: Pose) -> State:
    """State after ticking off the way-points that are near enough, in their order."""
    index = state.via_index
    via = setup.robot.via
    while index < len(via):
        away_m = geometry.length(via[index][0] - pose.x_m, via[index][1] - pose.y_m)
        if away_m > setup.robot.via_tolerance_m:
            break
        index += 1
    if index == state.via_index:
        return state
    # The next target is elsewhere: what was remembered of the way to this one does not apply.
    return State(via_index=index)


def target_of(setup: RobotSetup, state: State) -> tuple[Vec2, bool]:
    """Where to go now, and whether that is the goal itself."""
    assert setup.robot.goal is not None
    if state.via_index < len(setup.robot.via):
        return setup.robot.via[state.via_index], False
    return setup.robot.goal, True
