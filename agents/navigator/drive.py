"""From where to go to what to ask of the motors: among others a cell in time, then the forces."""

from __future__ import annotations

from math import atan2, cos, pi, sqrt

import msgspec

from agents import steering
from agents.navigator import cells, forces, right_of_way, table
from agents.navigator.aim import Aim
from agents.navigator.state import State
from agents.steering import Wish
from swarm import geometry
from swarm.geometry import Floats
from swarm.messages import Forces, Intent, Mode, SensorFrame
from swarm.scenario import RobotSetup

TURN_BRAKES_SHARE = 0.7
TURN_RAD_MAX = 1.2  # further off the direction it turns on the spot
# A robot this near to its goal does not hurry because somebody comes.
NEAR_GOAL_M, NEAR_GOAL_MPS = 0.6, 0.1
# Among others: further off the direction it drives slowly, from here on backwards if it may.
ASIDE_RAD, ASIDE_SHARE, BACK_RAD, BACK_SHARE = 0.9, 0.35, 2.0, 0.6
STAND_GAIN_1PS, STAND_RADPS_MAX = 2.0, 1.5  # standing, it turns to where it wants to go
# Less than this share of the speed it wants is being held up.
HELD_SHARE = 0.5
BEHIND_RAD = 3.09  # beyond it the goal is straight behind: it turns the way it turned last


def choose(
    setup: RobotSetup,
    state: State,
    frame: SensorFrame,
    rows: Floats,
    points_m: Floats,
    aim: Aim,
    course: right_of_way.Course,
) -> tuple[State, cells.Choice]:
    """World direction and speed of the cheapest cell in time; alone, those of the way."""
    robot = setup.robot
    choice = cells.Choice(course.direction_rad, course.speed_mps, False)
    if len(rows) and "cells" not in setup.navigator.without:
        slow_mps = robot.speed_mps_max
        if aim.is_last and aim.distance_m < NEAR_GOAL_M and not state.parked:
            slow_mps = max(course.speed_mps, NEAR_GOAL_MPS)
        choice = cells.choose(
            course.direction_rad,
            course.speed_mps,
            frame.pose.yaw_rad,
            state.chosen,
            table.believed(state.intent.velocity, frame.twist.speed_mps),
            robot.body_radius_m,
            robot.speed_mps_max,
            rows,
            points_m,
            keeps_right=course.round,
            parked=state.parked,
            slow_mps=slow_mps,
            free_m=geometry.length(aim.subgoal[0] - frame.pose.x_m, aim.subgoal[1] - frame.pose.y_m)
            if course.own
            else 0.0,
            goal=(course.target[0] - frame.pose.x_m, course.target[1] - frame.pose.y_m)
            if aim.is_last
            else (0.0, 0.0),
        )
    unit = geometry.unit(choice.direction_rad)
    u_mps = choice.speed_mps
    chosen = (u_mps * unit[0], u_mps * unit[1])
    # Whoever announced less than its top speed would keep those behind it from going faster, and
    # they it, for good; the guard sees to it that nobody relies on it.
    if u_mps > 0.0 and course.speed_mps >= robot.speed_mps_max:
        u_mps = robot.speed_mps_max
    intent = Intent((u_mps * unit[0], u_mps * unit[1]), course.target, course.active)
    held = len(rows) > 0 and (
        course.waits or state.parked or choice.speed_mps < HELD_SHARE * aim.speed_mps
    )
    if course.share < 1.0:
        choice = msgspec.structs.replace(choice, speed_mps=course.share * choice.speed_mps)
    return msgspec.structs.replace(state, intent=intent, chosen=chosen, held=held), choice


def ask(
    setup: RobotSetup,
    state: State,
    frame: SensorFrame,
    rows: Floats,
    points_m: Floats,
    aim: Aim,
    course: right_of_way.Course,
    choice: cells.Choice,
) -> tuple[State, Wish]:
    """Forces along and across that direction, and what to ask of the motors."""
    navigator, robot = setup.navigator, setup.robot
    pull = geometry.unit(choice.direction_rad)
    total = Forces(pull, resultant=pull)
    if "forces" not in navigator.without:
        total = forces.add_up(setup, pull, points_m)
    x, y = total.resultant
    error_rad = geometry.wrap_angle(atan2(y, x) - frame.pose.yaw_rad)
    sense = state.turn_sense
    if abs(error_rad) > BEHIND_RAD:
        error_rad = sense * abs(error_rad)
    elif error_rad != 0.0:
        sense = 1 if error_rad > 0.0 else -1
    if sense != state.turn_sense:
        state = msgspec.structs.replace(state, turn_sense=sense)
    arrived = aim.is_last and aim.distance_m < robot.goal_tolerance_m
    mode: Mode = "ARRIVED" if arrived else "GO"
    gain_1ps, most_radps = navigator.heading_gain_1ps, robot.turn_rate_radps_max
    speed_mps = choice.speed_mps
    if not len(rows):
        ahead = cos(error_rad) if abs(error_rad) <= TURN_RAD_MAX else 0.0
        speed_mps *= ahead * ahead
        if state.parked:
            gain_1ps = 0.0
    elif speed_mps == 0.0:
        error_rad = geometry.wrap_angle(course.direction_rad - frame.pose.yaw_rad)
        gain_1ps, most_radps = STAND_GAIN_1PS, min(STAND_RADPS_MAX, most_radps)
        if state.parked:
            gain_1ps = 0.0
    elif abs(error_rad) > BACK_RAD and speed_mps <= BACK_SHARE * robot.speed_mps_max:
        error_rad = geometry.wrap_angle(error_rad + pi)
        speed_mps *= -max(0.0, cos(error_rad))
    else:
        speed_mps *= max(0.0, cos(error_rad))
        if abs(error_rad) > ASIDE_RAD:
            speed_mps = min(speed_mps, ASIDE_SHARE * robot.speed_mps_max)
    # No faster than it can stop turning again: with weak motors it would swing to and fro.
    turning_radps2 = TURN_BRAKES_SHARE * robot.turn_acceleration_radps2_max
    most_radps = min(most_radps, sqrt(2.0 * turning_radps2 * abs(error_rad)))
    turn_rate_radps = steering.clip(gain_1ps * error_rad, most_radps)
    wish = Wish(
        mode, speed_mps, turn_rate_radps, arrived=arrived, forces=total, waypoint=aim.subgoal
    )
    return state, wish
