"""What stands in the world: circles and polygons, given or drawn from the seed.

    scenario --obstacles--> given ones, then drawn ones --build--> Scene (flat arrays)
                                                     clearance(scene, points) -> nearest surface

What moves (swarm.movers) is not in a scene but for a moment; nor are robots' bodies: they are the
business of contact and raycast.
"""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np

from swarm import errors, geometry, movers
from swarm.geometry import Floats
from swarm.movers import Mover
from swarm.scenario import Obstacle, RandomObstacles, Scenario

STREAM_OBSTACLES = 1  # second half of the Philox key; every purpose of the world has its own
TRIES_MAX = 2000  # draws per obstacle; at the bound the field is taken to be too full
TINY_M2 = 1e-300  # keeps a division by an edge's squared length finite


class Scene(msgspec.Struct, frozen=True, eq=False):
    """All obstacles as flat arrays, world frame, metres."""

    circles: Floats  # (circles, 3): x, y, radius
    edges: Floats  # (edges, 4): x and y of one corner, x and y of the next
    first_edges: tuple[int, ...]  # (polygons,) where each polygon begins in `edges`


def obstacles(scenario: Scenario) -> tuple[Obstacle, ...]:
    """Every obstacle of a scenario: the given ones, then the ones drawn from its seed.

    Raises:
        ScenarioError: a polygon crosses itself, an obstacle stands on a robot, or the drawn ones
            do not fit.
    """
    for number, obstacle in enumerate(scenario.obstacles):
        if obstacle.polygon is not None and _crosses_itself(obstacle.polygon):
            raise errors.ScenarioError(
                f"obstacles[{number}].polygon: expected corners in order, "
                "got edges that touch or cross each other"
            )
    drawn: tuple[Obstacle, ...] = ()
    if scenario.random_obstacles is not None:
        drawn = _draw(scenario, scenario.random_obstacles)
    every = scenario.obstacles + drawn
    scenes = (build(every), at(movers.moving(every), 0.0))
    for robot in scenario.robots:
        start_m = np.array([robot.start[:2]])
        gap_m = min(float(clearance(scene, start_m)[0]) for scene in scenes) - robot.body_radius_m
        if gap_m <= 0.0:
            raise errors.ScenarioError(
                f"robots: expected '{robot.name}' to start clear of every obstacle, "
                f"got {gap_m:.3f} m between them; move its start or the obstacle"
            )
    return every


def build(every: tuple[Obstacle, ...]) -> Scene:
    """Flat arrays of those obstacles that stand still."""
    circles = [
        obstacle.circle
        for obstacle in every
        if obstacle.circle is not None and obstacle.path is None
    ]
    edges: list[tuple[float, float, float, float]] = []
    first_edges: list[int] = []
    for obstacle in every:
        if obstacle.polygon is None:
            continue
        first_edges.append(len(edges))
        corners = obstacle.polygon
        for number, corner in enumerate(corners):
            edges.append((*corner, *corners[(number + 1) % len(corners)]))
    return Scene(
        np.array(circles, dtype=np.float64).reshape(-1, 3),
        np.array(edges, dtype=np.float64).reshape(-1, 4),
        tuple(first_edges),
    )


def at(some: Sequence[Mover], time_s: float) -> Scene:
    """Those that move, where they are at a simulation time."""
    centres_m = movers.places_m(some, time_s)
    circles = np.column_stack((centres_m, movers.radii_m(some)))
    return Scene(circles, np.empty((0, 4)), ())


def clearance(scene: Scene, points_m: Floats) -> Floats:
    """Distance to the nearest obstacle's surface, negative inside, inf without obstacles.

    Args:
        points_m: (points, 2) world frame.
    Returns:
        (points,) m.
    """
    nearest_m = np.full(len(points_m), np.inf)
    x_m, y_m = points_m[:, 0, None], points_m[:, 1, None]
    if len(scene.circles):
        dx_m = x_m - scene.circles[:, 0]
        dy_m = y_m - scene.circles[:, 1]
        nearest_m = (np.sqrt(dx_m * dx_m + dy_m * dy_m) - scene.circles[:, 2]).min(axis=1)
    if len(scene.edges):
        ax_m, ay_m, bx_m, by_m = scene.edges.T
        along_x_m, along_y_m = bx_m - ax_m, by_m - ay_m
        squared_m2 = along_x_m * along_x_m + along_y_m * along_y_m
        squared_m2 = np.maximum(squared_m2, TINY_M2)  # an edge between equal corners is a point
        dx_m, dy_m = x_m - ax_m, y_m - ay_m
        share = np.clip((dx_m * along_x_m + dy_m * along_y_m) / squared_m2, 0.0, 1.0)
        off_x_m, off_y_m = dx_m - share * along_x_m, dy_m - share * along_y_m
        outline_m = np.sqrt(off_x_m * off_x_m + off_y_m * off_y_m)
        # Even-odd rule: a ray towards +x leaves a polygon as often as it enters, unless inside.
        spans = (ay_m > y_m) != (by_m > y_m)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            crossing_m = dy_m * along_x_m / along_y_m  # from corner a; level edges never span
        crossings = np.add.reduceat(
            (spans & (dx_m < crossing_m)).astype(np.int64), scene.first_edges, axis=1
        )
        surface_m = np.minimum.reduceat(outline_m, scene.first_edges, axis=1)
        surface_m = np.where(crossings % 2 == 1, -surface_m, surface_m)
        nearest_m = np.minimum(nearest_m, surface_m.min(axis=1))
    return nearest_m


def _draw(scenario: Scenario, wanted: RandomObstacles) -> tuple[Obstacle, ...]:
    """Circles by rejection sampling: uniform centre and radius, kept when they fit."""
    key = np.array([scenario.seed, STREAM_OBSTACLES], dtype=np.uint64)
    generator = np.random.Generator(np.random.Philox(key=key))
    given = build(scenario.obstacles)
    places = np.array(
        [
            point
            for robot in scenario.robots
            for point in (
                robot.start[:2],
                *robot.via,
                *(() if robot.goal is None else (robot.goal,)),
            )
        ]
    )
    x_min_m, y_min_m, x_max_m, y_max_m = wanted.area
    smallest_m, largest_m = wanted.radius_m
    drawn: list[tuple[float, float, float]] = []
    tries_left = TRIES_MAX * wanted.count
    while len(drawn) < wanted.count:
        if tries_left == 0:
            raise errors.ScenarioError(
                f"random_obstacles: expected circles that fit, got {len(drawn)} of "
                f"{wanted.count} into the area after {TRIES_MAX * wanted.count} tries; lower "
                "count, radius_m, gap_m_min or keep_clear_m, or widen area"
            )
        tries_left -= 1
        draw = generator.random(3)
        x_m = x_min_m + (x_max_m - x_min_m) * float(draw[0])
        y_m = y_min_m + (y_max_m - y_min_m) * float(draw[1])
        radius_m = smallest_m + (largest_m - smallest_m) * float(draw[2])
        if _fits(given, drawn, places, wanted, (x_m, y_m, radius_m)):
            drawn.append((x_m, y_m, radius_m))
    return tuple(Obstacle(circle=circle) for circle in drawn)


def _fits(
    given: Scene,
    drawn: list[tuple[float, float, float]],
    places_m: Floats,
    wanted: RandomObstacles,
    circle: tuple[float, float, float],
) -> bool:
    """Whether a circle keeps its distance from all obstacles so far and all places to be."""
    x_m, y_m, radius_m = circle
    for other_x_m, other_y_m, other_radius_m in drawn:
        centres_m = geometry.length(x_m - other_x_m, y_m - other_y_m)
        if centres_m < radius_m + other_radius_m + wanted.gap_m_min:
            return False
    for place_x_m, place_y_m in places_m.tolist():
        if geometry.length(x_m - place_x_m, y_m - place_y_m) < radius_m + wanted.keep_clear_m:
            return False
    return float(clearance(given, np.array([[x_m, y_m]]))[0]) >= radius_m + wanted.gap_m_min


def _crosses_itself(corners: tuple[tuple[float, float], ...]) -> bool:
    """Whether a polygon is not simple: corners coincide, or edges meet that are no neighbours."""
    count = len(corners)
    edges = [(corners[i], corners[(i + 1) % count]) for i in range(count)]
    if len(set(corners)) < count:
        return True
    return any(
        _meet(*edges[i], *edges[j])
        for i in range(count)
        for j in range(i + 2, count)
        if (j + 1) % count != i
    )


def _meet(
    a: tuple[float, float],
    b: tuple[float, float],
    c: tuple[float, float],
    d: tuple[float, float],
) -> bool:
    """Whether the segments ab and cd have a point in common, lines through corners included."""
    sides = (_side(a, b, c), _side(a, b, d), _side(c, d, a), _side(c, d, b))
    if sides == (0.0, 0.0, 0.0, 0.0):
        return max(a, b) >= min(c, d) and max(c, d) >= min(a, b)
    return sides[0] * sides[1] <= 0.0 and sides[2] * sides[3] <= 0.0


def _side(a: tuple[float, float], b: tuple[float, float], point: tuple[float, float]) -> float:
    """Positive when a point lies left of the line from a to b, zero on it."""
    return (b[0] - a[0]) * (point[1] - a[1]) - (b[1] - a[1]) * (point[0] - a[0])
