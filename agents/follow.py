"""A robot with a slot: FORM while nothing is in the way, AVOID while something is (section 3.3.2).

    leader's beacon --way-point--> bearing switch --> FORM: adaptive PID
                                                  '-> AVOID: forces, moving with the slot

The two never act together: the gradient of the field and the PID term would make new minima.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import cos, sin
from typing import Literal

import msgspec

from agents import avoid, formation, msam, navigator, pid, pilot, steering, stray
from agents.formation import Goal
from agents.peers import Peer, safe_distance
from agents.priority import Claim
from agents.steering import Wish
from swarm import geometry
from swarm.geometry import Floats, Pose, Vec2, wrap_angle
from swarm.messages import SensorFrame, Slot
from swarm.scenario import RobotSetup

# Triggers of AVOID: a bearing this far from the nominal one, obstacles within this angle ahead,
BEARING_CHANGE_RAD = 0.02
AHEAD_RAD = 1.9
# a peer this near beyond the safe distance; it must go a little further before FORM returns.
PEER_MARGIN_M = 0.2
PEER_MARGIN_LEAVE_M = 0.25
# Obstacle points at the rim of the map are left out of the bearing switch.
RIM_M = 0.1
# Once the leader has arrived a follower this near goes straight into its slot, with this margin.
PARK_FROM_M = 1.5
PARK_MARGIN_M = 0.1
PARKED_M = 0.03
# Arrived: in its slot and this slow for so long.
REST_SPEED_MPS = 0.05
REST_S = 1.0


class State(msgspec.Struct, frozen=True):
    """Which law is in force, the bearing of the moment, and what the tracking has learned."""

    mode: Literal["FORM", "AVOID"] = "FORM"
    clear_s: float = 0.0  # since the last trigger of AVOID
    bearing_now_rad: float = 0.0
    rest_s: float = 0.0
    late_s: float = 0.0  # since the leader arrived, without rest in the slot
    tracking: pid.State = pid.State()
    astray: stray.State = stray.State()


def init(setup: RobotSetup) -> State:
    """Before the first frame: in the nominal slot."""
    return State(bearing_now_rad=0.0 if setup.slot is None else setup.slot.bearing_rad)


def step(
    setup: RobotSetup,
    state: State,
    navigating: navigator.State | None,
    frame: SensorFrame,
    map: msam.Map,
    others: list[Peer],
    goal: Goal,
    slot: Slot,
    claim: Claim,
    *,
    held_by: str,
    frozen: bool,
    waiting: bool,
    elapsed_s: float,
) -> tuple[State, navigator.State | None, Wish]:
    """One tick of a follower that hears its leader.

    Args:
        navigating: what it remembers of obstacles and ways; None: nothing.
        others: peers to keep apart from.
        claim: own one.
        held_by: peer that let it not move in the tick before, "" when there is none.
        frozen: the set-point of the tick before was not the one asked for, or it gave way.
        waiting: it gave way in the tick before.
    """
    assert setup.formation is not None
    pose, twist = frame.pose, frame.twist
    if navigating is not None:
        navigating = pilot.remember(setup, navigating, frame, map, elapsed_s)
    # A slot that stands is a place like any other: nobody passes along a corridor there.
    bearing_rad = slot.bearing_rad
    if not goal.arrived and navigating is not None:
        points_m = pilot.around(setup, navigating, frame, map, setup.sensor.range_m)
        bearing_rad = free_bearing(setup, state, pose, points_m, goal, slot)
    elif not goal.arrived:
        bearing_rad = switch_bearing(setup, state, pose, map, goal, slot)
    bearing_now_rad = formation.slew_bearing(
        setup.formation, state.bearing_now_rad, bearing_rad, elapsed_s
    )
    nominal = formation.waypoint(goal.leader, goal.heading_rad, slot.distance_m, slot.bearing_rad)
    away_m = geometry.length(nominal[0] - pose.x_m, nominal[1] - pose.y_m)
    changed_rad = abs(wrap_angle(bearing_rad - slot.bearing_rad))
    parks = goal.arrived and away_m < PARK_FROM_M and can_park(setup, map, pose, nominal)
    mode, clear_s = switch_mode(
        setup, state, None if parks else map, others, 0.0 if parks else changed_rad, elapsed_s
    )
    rests = (
        goal.arrived
        and away_m < setup.formation.tolerance_m
        and abs(twist.speed_mps) < REST_SPEED_MPS
    )
    rest_s = state.rest_s + elapsed_s if rests else 0.0
    point = formation.waypoint(goal.leader, goal.heading_rad, slot.distance_m, bearing_now_rad)
    tracking, astray, away_rad = state.tracking, state.astray, None
    if navigating is not None:
        if state.mode == "AVOID" and held_by == "" and not waiting:
            held_by = avoid.blocked_by(setup, frame, others, goal, point)
        astray, away_rad = stray.step(astray, others, claim, held_by, elapsed_s)
        if mode == "FORM" and away_rad is None:
            navigating = pilot.stay(navigating)
    if navigating is not None and away_rad is not None:
        mode = "AVOID"
        navigating, wish = avoid.back_off(
            setup, navigating, frame, map, others, away_rad, elapsed_s=elapsed_s
        )
    elif navigating is not None and mode == "AVOID":
        held = waiting or held_by != ""
        navigating, wish = avoid.by_way(
            setup, navigating, frame, map, others, goal, point, held=held, elapsed_s=elapsed_s
        )
    elif mode == "AVOID":
        wish = avoid.by_field(setup, pose, map, others, goal, point)
    elif parks and is_skew(setup, pose, goal):
        tracking = pid.reset(tracking)
        wish = park(setup, pose, nominal, away_m)
    else:
        if state.mode != "FORM":
            tracking = pid.reset(tracking)
        tracking, wish = track(setup, tracking, pose, goal, slot, nominal, frozen)
    late_s = state.late_s + elapsed_s if goal.arrived and not rests else 0.0
    if rest_s >= REST_S:
        wish = msgspec.structs.replace(wish, mode="ARRIVED", arrived=True)
    elif late_s > setup.navigator.give_up_s:
        wish = Wish(mode="FAILED", waypoint=nominal, reason="too-long")
    return (
        State(mode, clear_s, bearing_now_rad, rest_s, late_s, tracking, astray),
        navigating,
        wish,
    )


def switch_bearing(
    setup: RobotSetup, state: State, pose: Pose, map: msam.Map, goal: Goal, slot: Slot
) -> float:
    """Bearing that keeps the follower's corridor free, the nominal one where nothing is near."""
    reach_m = setup.sensor.range_m - RIM_M
    assert setup.formation is not None
    if map.nearest_m >= reach_m:
        return slot.bearing_rad
    x_m, y_m = pose.x_m - goal.leader.x_m, pose.y_m - goal.leader.y_m
    ahead, aside = cos(goal.heading_rad), sin(goal.heading_rad)
    points = msam.cell_points(
        map,
        setup.sensor.range_m / setup.msam.rings,
        reach_m,
        origin=(x_m * ahead + y_m * aside, y_m * ahead - x_m * aside),
        turn_rad=pose.yaw_rad - goal.heading_rad,
    )
    return formation.choose_bearing(
        setup.formation,
        slot,
        state.bearing_now_rad,
        points,
        setup.robot.body_radius_m + setup.formation.corridor_margin_m,
    )


def free_bearing(
    setup: RobotSetup, state: State, pose: Pose, points_m: Floats, goal: Goal, slot: Slot
) -> float:
    """The same by all that is remembered: the far side of an obstacle is not seen, but was.

    Args:
        points_m: (points, 2) from the robot, world axes.
    """
    assert setup.formation is not None
    if len(points_m) == 0:
        return slot.bearing_rad
    return formation.choose_bearing_among(
        setup.formation,
        slot,
        state.bearing_now_rad,
        points_m,
        (pose.x_m - goal.leader.x_m, pose.y_m - goal.leader.y_m),
        goal.heading_rad,
        setup.robot.body_radius_m + setup.formation.corridor_margin_m,
    )


def switch_mode(
    setup: RobotSetup,
    state: State,
    map: msam.Map | None,
    others: Iterable[Peer],
    changed_rad: float,
    elapsed_s: float,
) -> tuple[Literal["FORM", "AVOID"], float]:
    """Mode of this tick and how long nothing has asked for AVOID, in s.

    Args:
        map: None where obstacles do not count.
        changed_rad: from the slot's bearing to the chosen one.
    """
    assert setup.formation is not None
    margin_m = PEER_MARGIN_M if state.mode == "FORM" else PEER_MARGIN_LEAVE_M
    triggered = (
        changed_rad > BEARING_CHANGE_RAD
        or (map is not None and map.nearest_m < setup.formation.avoid_around_m)
        or any(peer.distance_m < safe_distance(setup, peer) + margin_m for peer in others)
        or (map is not None and nearest_ahead(map, setup.formation.avoid_ahead_m))
    )
    if triggered:
        return "AVOID", 0.0
    clear_s = state.clear_s + elapsed_s
    if state.mode == "AVOID" and clear_s < setup.formation.reform_after_s:
        return "AVOID", clear_s
    return "FORM", clear_s


def is_skew(setup: RobotSetup, pose: Pose, goal: Goal) -> bool:
    """Whether the tracked points may meet while the robot is not in its slot.

    They lie ahead of both axles, so that centres match when headings agree, which they do not
    after a turn in a narrow place.
    """
    skew_rad = wrap_angle(pose.yaw_rad - goal.leader.yaw_rad)
    return 2.0 * setup.pid.off_axle_m * abs(sin(skew_rad / 2.0)) > PARKED_M


def park(setup: RobotSetup, pose: Pose, slot: Vec2, away_m: float) -> Wish:
    """Straight into a slot that stands, whatever the heading."""
    if away_m < PARKED_M:
        return Wish(mode="FORM", waypoint=slot)
    speed_mps, turn_rate_radps = steering.head(
        setup.steering,
        setup.robot,
        (slot[0] - pose.x_m, slot[1] - pose.y_m),
        pose.yaw_rad,
        min(setup.robot.speed_mps_max, setup.steering.approach_gain_1ps * away_m),
    )
    return Wish("FORM", speed_mps, turn_rate_radps, waypoint=slot)


def can_park(setup: RobotSetup, map: msam.Map, pose: Pose, slot: Vec2) -> bool:
    """Whether the straight way into a slot that stands is free.

    What is near it, a wall or the body of a robot that was lost, would else push the follower off
    for good: the field has its rest where forces cancel, not in the slot.
    """
    clear_m = setup.robot.body_radius_m + PARK_MARGIN_M
    x_m, y_m = slot[0] - pose.x_m, slot[1] - pose.y_m
    away_m = geometry.length(x_m, y_m)
    if map.nearest_m >= away_m + clear_m:
        return True
    ahead, aside = (x_m / away_m, y_m / away_m) if away_m > 0.0 else (1.0, 0.0)
    cos_yaw, sin_yaw = cos(pose.yaw_rad), sin(pose.yaw_rad)
    ahead, aside = ahead * cos_yaw + aside * sin_yaw, aside * cos_yaw - ahead * sin_yaw
    units = msam.layout(len(map.beams_m), len(map.sectors_m)).sector_units
    for range_m, unit in zip(map.sectors_m, units, strict=True):
        if range_m < away_m + clear_m:
            along_m = range_m * (unit[0] * ahead + unit[1] * aside)
            across_m = range_m * (unit[1] * ahead - unit[0] * aside)
            beyond_m = along_m - max(0.0, min(away_m, along_m))
            if across_m * across_m + beyond_m * beyond_m < clear_m * clear_m:
                return False
    return True


def nearest_ahead(map: msam.Map, reach_m: float) -> bool:
    """Whether anything is nearer than `reach_m` in the wide angle ahead."""
    if map.nearest_m >= reach_m:
        return False
    count = len(map.sectors_m)
    angles = msam.layout(count, count).sector_angles
    return any(
        range_m < reach_m and abs(angle_rad) <= AHEAD_RAD
        for range_m, angle_rad in zip(map.sectors_m, angles, strict=True)
    )


def track(
    setup: RobotSetup,
    tracking: pid.State,
    pose: Pose,
    goal: Goal,
    slot: Slot,
    nominal: Vec2,
    frozen: bool,
) -> tuple[pid.State, Wish]:
    """FORM: adaptive PID on the nominal slot.

    It learns by one tick per frame, even when frames were missed: the adaptation is stable for
    short steps only.
    """
    seen = pid.observe(
        setup.pid, pose, goal.leader, goal.twist, goal.heading_rad, goal.turn_rate_radps, slot
    )
    tracking, u = pid.step(setup.pid, tracking, seen, setup.dt_s, frozen=frozen)
    speed_mps, turn_rate_radps = pid.invert(setup.pid, seen, u)
    robot = setup.robot
    return tracking, Wish(
        mode="FORM",
        speed_mps=max(-robot.speed_mps_reverse_max, min(robot.speed_mps_max, speed_mps)),
        turn_rate_radps=steering.clip(turn_rate_radps, robot.turn_rate_radps_max),
        waypoint=nominal,
        error=seen.error,
        saturated=not (
            -robot.speed_mps_reverse_max <= speed_mps <= robot.speed_mps_max
            and abs(turn_rate_radps) <= robot.turn_rate_radps_max
        ),
    )
