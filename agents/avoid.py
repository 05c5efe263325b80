"""AVOID: what a follower does while something is in its way, moving with its slot (section 3.3.2).

    way-point, its velocity --wanted velocity--> by_field: the paper's field alone
                                             '-> by_way: on a way by all that is remembered
    a jam --back_off--> away from it

An attraction k_g (way-point - q) as for a goal would be some 5 N against a gap's barrier of 8 to
17: the follower would stop in front of it. So it is attracted along a velocity.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from math import atan2, cos, floor, inf, sin

from agents import field, formation, msam, navigator, pilot, steering, stray
from agents.formation import Goal
from agents.peers import Peer, safe_distance
from agents.steering import Wish
from swarm import geometry
from swarm.geometry import TAU, Floats, Pose, Vec2, wrap_angle
from swarm.messages import Forces, SensorFrame
from swarm.scenario import RobotSetup

# Error of the way-point to speed, and how far a robot may fall behind before it drives back.
CATCH_UP_GAIN_1PS = 1.0
BACKWARD_FROM_M = 1.5
# The speed from which on the attraction has its full size.
ATTRACTION_FULL_MPS = 0.3
# How near it is in its leader's way, and how fast it gets out of it.
AHEAD_OF_LEADER_M = 1.2
BESIDE_LEADER_M = 0.6
MAKE_WAY_MPS = 0.4
# A way-point that is hidden is looked for where it will be, up to so much later.
AHEAD_S_MAX = 4.0
# Slow, with less than this much room as far ahead as it looks beyond the way-point, it keeps to the
# formation's heading: it goes to a point this far along.
AHEAD_M_MIN = 0.4
ROOM_M = 0.1
LOOK_BEYOND_M, LOOK_M_MIN, LOOK_M_MAX = 0.9, 0.6, 1.8
# Slower than this it stands, and what is this near beyond the safe distance may be why.
STANDS_MPS = 0.03
BESIDE_M = 0.25


def wanted_velocity(pose: Pose, goal: Goal, point: Vec2) -> Vec2:
    """Velocity that takes a follower to its moving way-point, m/s, world."""
    x_m, y_m = point[0] - pose.x_m, point[1] - pose.y_m
    way = out_of_the_way(goal.leader, pose)
    if way is not None:
        return way
    v_x, v_y = formation.slot_velocity(goal, point)
    v_x += CATCH_UP_GAIN_1PS * x_m
    v_y += CATCH_UP_GAIN_1PS * y_m
    if geometry.length(x_m, y_m) < BACKWARD_FROM_M:
        return field.without_opposition((v_x, v_y), goal.heading_rad)
    return (v_x, v_y)


def out_of_the_way(leader: Pose, pose: Pose) -> Vec2 | None:
    """Velocity of a follower right in front of its leader: on ahead and aside, m/s, world.

    A leader never gives way. Elected among its followers it may have one in front of it, in a
    place too narrow for two, that wants to get past it to its slot.
    """
    x_m, y_m = pose.x_m - leader.x_m, pose.y_m - leader.y_m
    ahead, aside = cos(leader.yaw_rad), sin(leader.yaw_rad)
    along_m, across_m = x_m * ahead + y_m * aside, y_m * ahead - x_m * aside
    if not 0.0 < along_m < AHEAD_OF_LEADER_M or abs(across_m) > BESIDE_LEADER_M:
        return None
    side = MAKE_WAY_MPS if across_m >= 0.0 else -MAKE_WAY_MPS
    return (MAKE_WAY_MPS * ahead - side * aside, MAKE_WAY_MPS * aside + side * ahead)


def by_field(
    setup: RobotSetup,
    pose: Pose,
    map: msam.Map,
    others: Iterable[Peer],
    goal: Goal,
    point: Vec2,
) -> Wish:
    """The potential field, attracted along the wanted velocity."""
    robot = setup.robot
    v_x, v_y = wanted_velocity(pose, goal, point)
    speed_mps = min(robot.speed_mps_max, geometry.length(v_x, v_y))
    wanted_rad = atan2(v_y, v_x) if speed_mps > 0.0 else goal.heading_rad
    attractive = field.attractive(
        setup.field,
        wanted_rad,
        setup.field.attraction_follower_m * min(1.0, speed_mps / ATTRACTION_FULL_MPS),
    )
    # The rule for goals near obstacles (eq. 33) is for goals that stand: this one moves on.
    repulsive = field.repulsive(setup.field, map.arcs, pose.yaw_rad, inf)
    rotating = field.rotating(setup.field, map.clusters, pose.yaw_rad, wanted_rad)
    robots = field.between_robots(setup, others)
    resultant = field.total(attractive, repulsive, rotating, robots)
    forces = Forces(attractive, repulsive, rotating, robots, resultant)
    speed_mps, turn_rate_radps = steering.head(
        setup.steering, robot, resultant, pose.yaw_rad, speed_mps
    )
    return Wish("AVOID", speed_mps, turn_rate_radps, forces=forces, waypoint=point)


def by_way(
    setup: RobotSetup,
    navigating: navigator.State,
    frame: SensorFrame,
    map: msam.Map,
    others: Iterable[Peer],
    goal: Goal,
    point: Vec2,
    *,
    held: bool,
    elapsed_s: float,
) -> tuple[navigator.State, Wish]:
    """Attracted along the way to where the way-point will be.

    Args:
        held: something else than the way keeps it.
    """
    wanted = wanted_velocity(frame.pose, goal, point)
    wanted_mps = geometry.length(*wanted)
    there = point_ahead(setup, navigating, frame, map, goal, point, wanted)
    navigating, aim = pilot.to_point(
        setup,
        navigating,
        frame,
        map,
        there,
        held=held or wanted_mps < pilot.STANDS_MPS,
        elapsed_s=elapsed_s,
    )
    speed_mps = min(setup.robot.speed_mps_max, wanted_mps)
    share = min(1.0, wanted_mps / ATTRACTION_FULL_MPS)
    points_m = pilot.around(setup, navigating, frame, map, pilot.reach_m(setup))
    wish = _along(setup, aim, frame.pose, points_m, others, speed_mps, share, point)
    return navigating, wish


def point_ahead(
    setup: RobotSetup,
    navigating: navigator.State,
    frame: SensorFrame,
    map: msam.Map,
    goal: Goal,
    point: Vec2,
    wanted: Vec2,
) -> Vec2:
    """Where a follower goes whose way may not be straight: where its way-point will be, world.

    A second ahead the direction is that of the wanted velocity. Behind what hides it the point may
    lie in an obstacle: then the one that it reaches later, on the same side, is gone to.
    """
    pose = frame.pose
    x_m, y_m = wanted[0] / CATCH_UP_GAIN_1PS, wanted[1] / CATCH_UP_GAIN_1PS
    v_x, v_y = formation.slot_velocity(goal, point)
    off_x_m, off_y_m = point[0] - pose.x_m, point[1] - pose.y_m
    away_m, far_m = geometry.length(off_x_m, off_y_m), geometry.length(x_m, y_m)
    if not goal.arrived and 0.0 < far_m < AHEAD_M_MIN:
        look_m = max(LOOK_M_MIN, min(LOOK_M_MAX, away_m + LOOK_BEYOND_M))
        way_m = (look_m * x_m / far_m, look_m * y_m / far_m)
        if not pilot.is_clear(setup, navigating, frame, map, way_m, ROOM_M):
            x_m, y_m = field.without_opposition((off_x_m, off_y_m), goal.heading_rad)
            x_m += AHEAD_M_MIN * cos(goal.heading_rad)
            y_m += AHEAD_M_MIN * sin(goal.heading_rad)
    ahead_s = 1.0
    while ahead_s < AHEAD_S_MAX and is_hidden(map, pose, (x_m, y_m)):
        ahead_s += 1.0
        x_m = off_x_m + ahead_s * v_x
        y_m = off_y_m + ahead_s * v_y
    return (pose.x_m + x_m, pose.y_m + y_m)


def is_hidden(map: msam.Map, pose: Pose, way_m: Vec2) -> bool:
    """Whether something nearer lies in the direction of a point.

    Args:
        way_m: to there, m, world axes.
    """
    away_m = geometry.length(*way_m)
    if map.nearest_m >= away_m:
        return False
    count = len(map.sectors_m)
    place = (wrap_angle(atan2(way_m[1], way_m[0]) - pose.yaw_rad) / TAU + 0.5) * count
    # Between two sectors it counts for both, or mirrored robots would not see mirrored points.
    return all(map.sectors_m[floor(place + off) % count] < away_m for off in (-0.25, 0.25))


def back_off(
    setup: RobotSetup,
    navigating: navigator.State,
    frame: SensorFrame,
    map: msam.Map,
    others: Iterable[Peer],
    away_rad: float,
    *,
    elapsed_s: float,
) -> tuple[navigator.State, Wish]:
    """Out of a jam, in a direction or as near to it as there is a way."""
    pose, off = frame.pose, geometry.unit(away_rad)
    there = (pose.x_m + stray.BACK_M * off[0], pose.y_m + stray.BACK_M * off[1])
    navigating, aim = pilot.to_point(
        setup, navigating, frame, map, there, held=True, elapsed_s=elapsed_s
    )
    points_m = pilot.around(setup, navigating, frame, map, pilot.reach_m(setup))
    wish = _along(setup, aim, pose, points_m, others, stray.BACK_MPS, 1.0, there)
    return navigating, wish


def _along(
    setup: RobotSetup,
    aim: navigator.Aim,
    pose: Pose,
    points_m: Floats,
    others: Iterable[Peer],
    speed_mps: float,
    share: float,
    point: Vec2,
) -> Wish:
    """Wish that follows the forces on the way that was found.

    Args:
        points_m: (points, 2) from the robot, world axes: obstacles.
        share: of the full attraction.
    """
    pull = share * setup.field.k_g * setup.field.attraction_follower_m
    robots = field.between_robots(setup, others)
    forces = pilot.push(setup, aim.direction_rad, pull, robots, points_m)
    speed_mps, turn_rate_radps = steering.head(
        setup.steering, setup.robot, forces.resultant, pose.yaw_rad, min(speed_mps, aim.speed_mps)
    )
    return Wish("AVOID", speed_mps, turn_rate_radps, forces=forces, waypoint=point)


def blocked_by(
    setup: RobotSetup,
    frame: SensorFrame,
    others: Sequence[Peer],
    goal: Goal,
    point: Vec2,
) -> str:
    """Nearest peer of a follower that stands but wants to go on, "" when none is beside it.

    Pressed to an obstacle by each other they are held by that, not by the peer.
    """
    if not others or abs(frame.twist.speed_mps) > STANDS_MPS:
        return ""
    peer = min(others, key=_distance_of)
    beside_m = safe_distance(setup, peer) + BESIDE_M
    wants = geometry.length(*wanted_velocity(frame.pose, goal, point)) > pilot.STANDS_MPS
    return peer.beacon.name if wants and peer.distance_m < beside_m else ""


def _distance_of(peer: Peer) -> float:
    return peer.distance_m
