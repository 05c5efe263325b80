"""A robot with a goal of its own, a formation's leader or alone: GO, ROUND, ARRIVED, FAILED.

goal, map, peers --gap, forces (eq. 38)--> heading --> wish
no progress --rotation memory--> ROUND --> wish
round everything, both ways, or for too long --> FAILED, for good
"""

from __future__ import annotations

from collections.abc import Iterable
from math import atan2

import msgspec

from agents import field, msam, rotation, steering
from agents.peers import Peer
from agents.steering import Wish
from swarm import geometry
from swarm.geometry import Pose, Vec2
from swarm.messages import Forces, Mode
from swarm.scenario import RobotSetup

# Where there is no room: this share of the margins, and looking for gaps no further than this.
NARROW = 0.6
NARROW_LOOK_M = 0.8


class State(msgspec.Struct, frozen=True):
    """How far along its way a robot is, and which way it went last."""

    via_index: int = 0  # of the way-point it goes to; their number: the goal itself
    direction_rad: float | None = None  # world, chosen last; None before the first
    rotation: rotation.State = rotation.State()


def step(
    setup: RobotSetup,
    state: State,
    pose: Pose,
    map: msam.Map,
    others: Iterable[Peer],
    *,
    speed_mps: float,
    extended: bool,
    waiting: bool,
    elapsed_s: float,
) -> tuple[State, Wish]:
    """One tick on the way to the goal.

    Args:
        others: peers that push this robot off (F_ij).
        speed_mps: to drive at where nothing is in the way.
        extended: gap choice, projection and rotation memory on; else the strict reading.
        waiting: whether it gave way in the tick before.
    """
    state = pass_waypoints(setup, state, pose)
    target, is_goal = target_of(setup, state)
    position = (pose.x_m, pose.y_m)
    dx_m, dy_m = target[0] - pose.x_m, target[1] - pose.y_m
    distance_m = geometry.length(dx_m, dy_m)
    if is_goal and distance_m < setup.robot.goal_tolerance_m:
        return state, Wish(mode="ARRIVED", arrived=True, waypoint=target)
    goal_rad = atan2(dy_m, dx_m)
    memory = state.rotation
    clear_m = setup.robot.body_radius_m + setup.steering.gap_margin_m
    keep_m = max(setup.steering.round_distance_m, clear_m + setup.steering.gap_margin_m)
    if extended:
        memory = rotation.step(
            setup.steering,
            memory,
            map,
            position,
            pose.yaw_rad,
            goal_rad,
            distance_m,
            clear_m=clear_m,
            keep_m=keep_m,
            waiting=waiting,
            elapsed_s=elapsed_s,
        )
        if memory.failed:
            failed = Wish(mode="FAILED", waypoint=target, reason=memory.failed)
            return State(state.via_index, state.direction_rad, memory), failed
    look_m = min(distance_m, setup.steering.gap_look_m)
    if rotation.is_confined(memory):
        clear_m = setup.robot.body_radius_m + NARROW * setup.steering.gap_margin_m
        keep_m, look_m = clear_m + NARROW * setup.steering.gap_margin_m, min(look_m, NARROW_LOOK_M)
    mode: Mode = "GO"
    direction_rad = state.direction_rad
    if memory.sense != 0:
        mode = "ROUND"
        along = rotation.follow_wall(keep_m, map, memory.sense, pose.yaw_rad)
        forces = Forces(rotating=along, resultant=along)
    else:
        free_rad = None
        if extended:
            free_rad = steering.choose_direction(
                setup.steering,
                map,
                pose.yaw_rad,
                goal_rad,
                goal_rad if direction_rad is None else direction_rad,
                clear_m=clear_m,
                look_m=look_m,
            )
            direction_rad = goal_rad if free_rad is None else free_rad
        forces = add_up(setup, pose, map, others, goal_rad, distance_m, free_rad, extended)
    if is_goal:
        speed_mps = min(speed_mps, setup.steering.approach_gain_1ps * distance_m)
    speed_mps, turn_rate_radps = steering.head(
        setup.steering, setup.robot, forces.resultant, pose.yaw_rad, speed_mps
    )
    next_state = State(state.via_index, direction_rad, memory)
    return next_state, Wish(mode, speed_mps, turn_rate_radps, forces=forces, waypoint=target)


def add_up(
    setup: RobotSetup,
    pose: Pose,
    map: msam.Map,
    others: Iterable[Peer],
    goal_rad: float,
    distance_m: float,
    free_rad: float | None,
    extended: bool,
) -> Forces:
    """Forces of eq. 38; along a free direction instead of the goal's when there is one."""
    pull_m = min(distance_m, setup.field.attraction_m_max) if extended else distance_m
    attractive = field.attractive(setup.field, goal_rad if free_rad is None else free_rad, pull_m)
    repulsive = field.repulsive(setup.field, map.arcs, pose.yaw_rad, distance_m)
    if free_rad is not None:
        repulsive = field.without_opposition(repulsive, free_rad)
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
