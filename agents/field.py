"""The improved artificial potential field (sections 3.1 and 3.3): forces on one robot.

    goal -> attractive      arcs -> repulsive      clusters, goal -> rotating      peers -> robots

Forces are in the world frame and have no unit: the heading controller takes their direction.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import cos, pi, sin

from agents import msam, peers
from agents.peers import Peer
from swarm.geometry import Vec2, wrap_angle
from swarm.messages import Arc
from swarm.scenario import Field, RobotSetup

# |sin gamma| below this means that goal and obstacle are in line: the robot then goes right.
IN_LINE = 1e-6


def attractive(field: Field, direction_rad: float, distance_m: float) -> Vec2:
    """F_att = -k_g (q - q_g) of eq. 24, towards `direction_rad` with the size for `distance_m`."""
    size = field.k_g * distance_m
    return (size * cos(direction_rad), size * sin(direction_rad))


def repulsive(field: Field, arcs: Iterable[Arc], yaw_rad: float, goal_distance_m: float) -> Vec2:
    """Sum of F_rep of eq. 27 and 30 over the arcs within rho, away from each.

    k_r (1/f - 1/rho) / f^2 with f = r_o, the distance from the robot's centre to the surface.
    An arc that is farther than the goal does not count: eq. 33 with the sign that (24) asks for
    cancels its repulsion, so a goal close to an obstacle can be reached. As printed, the plus
    sign of (32) doubles it.
    """
    x = 0.0
    y = 0.0
    for arc in arcs:
        if goal_distance_m < arc.range_m or arc.range_m >= field.rho_m:
            continue
        f_m = max(arc.range_m, field.distance_m_min)
        size = arc.weight * field.k_r * (1.0 / f_m - 1.0 / field.rho_m) / (f_m * f_m)
        x -= size * cos(arc.bearing_rad + yaw_rad)
        y -= size * sin(arc.bearing_rad + yaw_rad)
    return (x, y)


def rotating(field: Field, clusters: Iterable[Arc], yaw_rad: float, goal_rad: float) -> Vec2:
    """Sum of F_esc of eq. 35 over the clusters ahead: across the way to the goal, on its side.

    k_e |q - q_o|, to the left of the goal's direction when the goal is left of the obstacle, so
    that the robot passes there; straight behind it the robot goes right. Only obstacles within
    90 degrees of the goal count.
    """
    size = 0.0
    for cluster in clusters:
        gamma_rad = wrap_angle(goal_rad - (cluster.bearing_rad + yaw_rad))
        if abs(gamma_rad) < pi / 2.0:
            side = passing_side(gamma_rad)
            size += side * field.k_e * msam.circle_distance(cluster.range_m, cluster.width_rad)
    return (-size * sin(goal_rad), size * cos(goal_rad))


def passing_side(gamma_rad: float) -> int:
    """+1 when a goal at `gamma_rad` left of an obstacle is to be reached on its left, -1: right."""
    return 1 if sin(gamma_rad) > IN_LINE else -1


def between_robots(setup: RobotSetup, others: Iterable[Peer]) -> Vec2:
    """Sum of F_ij of eq. 37 over the peers within r_ij, away from each.

    k_ij (1/(q - r) - 1/(r_ij - r)) with q - r held at or above a bound: as printed the force
    turns into an attraction below r. Large bodies have a larger r; r_ij - r is the scenario's.
    """
    field = setup.field
    reach_m = field.robot_reach_m - field.safe_distance_m
    x = 0.0
    y = 0.0
    for peer in others:
        q_m = peer.distance_m
        safe_m = peers.safe_distance(setup, peer)
        if q_m > safe_m + reach_m or q_m == 0.0:
            continue
        gap_m = max(q_m - safe_m, field.distance_m_min)
        size = field.k_ij * max(0.0, 1.0 / gap_m - 1.0 / reach_m)
        x -= size * peer.offset[0] / q_m
        y -= size * peer.offset[1] / q_m
    return (x, y)


def without_opposition(force: Vec2, direction_rad: float) -> Vec2:
    """Force less its part against a direction that is known to be free (ours, not the paper's).

    The push to the middle of a gap stays, the barrier in front of it goes.
    """
    x, y = cos(direction_rad), sin(direction_rad)
    against = min(0.0, force[0] * x + force[1] * y)
    return (force[0] - against * x, force[1] - against * y)


def total(*forces: Vec2) -> Vec2:
    """Resultant of eq. 38."""
    return (sum([force[0] for force in forces]), sum([force[1] for force in forces]))
