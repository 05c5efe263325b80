"""Inner loops along a way: distances between cells, where the robot is on it, how far it sees.

All in mm from the middle of the window; a way is in mm of the world, hence the origin.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from agents.navigator import search
from agents.navigator.compiled import compiled
from agents.navigator.law import Ints
from agents.navigator.points import Field, nearest
from swarm.geometry import Floats

Path = npt.NDArray[np.int64]  # (cells, 2) mm, world

AHEAD_CELLS = 25  # where along the way the robot is looked for
REFUSED_MAX = 6  # sub-goals in a row; beyond them none is looked for
CHORD_MM = 10.0  # a chord may cost this much more in any case


@compiled
def distance_at(field_mm: Field, x_mm: float, y_mm: float, cell_mm: int) -> float:
    """Distance to the nearest point, between four cells; beyond the window that of its border."""
    side = field_mm.shape[0]
    x = min(max(x_mm / cell_mm + side // 2, 0.0), side - 1.000001)
    y = min(max(y_mm / cell_mm + side // 2, 0.0), side - 1.000001)
    i, j = int(x), int(y)
    u, w = x - i, y - j
    low = float(field_mm[i, j]) * (1.0 - u) + float(field_mm[i + 1, j]) * u
    high = float(field_mm[i, j + 1]) * (1.0 - u) + float(field_mm[i + 1, j + 1]) * u
    return float(low * (1.0 - w) + high * w)


@compiled
def share_at(shares: Floats, away_mm: float) -> float:
    """v(c) / v_max at a distance to the nearest point."""
    return float(shares[min(int(away_mm), len(shares) - 1)])


@compiled
def progress(
    path_mm: Path, origin_x: int, origin_y: int, index: int, x_mm: float, y_mm: float
) -> tuple[int, float]:
    """Cell of the way that the robot is nearest to, not before the last one, and how far off."""
    best, off2 = index, -1.0
    for place in range(index, min(index + AHEAD_CELLS, len(path_mm))):
        dx = path_mm[place, 0] - origin_x - x_mm
        dy = path_mm[place, 1] - origin_y - y_mm
        away2 = dx * dx + dy * dy
        if off2 < 0.0 or away2 < off2:
            best, off2 = place, away2
    return best, np.sqrt(off2)


@compiled
def cost_along(
    field_mm: Field,
    path_mm: Path,
    origin_x: int,
    origin_y: int,
    index: int,
    x_mm: float,
    y_mm: float,
    cell_mm: int,
    straight: Ints,
    diagonal: Ints,
    near_straight: int,
    near_diagonal: int,
) -> int:
    """Cost of the rest of the way as the field is now, like the search has it; -1: blocked."""
    side = field_mm.shape[0]
    half = side // 2
    robot_i, robot_j = nearest(x_mm / cell_mm) + half, nearest(y_mm / cell_mm) + half
    cost = 0
    for place in range(index, len(path_mm) - 1):  # a step costs what its cell on this side does
        i = nearest((path_mm[place, 0] - origin_x) / cell_mm) + half
        j = nearest((path_mm[place, 1] - origin_y) / cell_mm) + half
        if i < 0 or j < 0 or i >= side or j >= side:
            continue
        next_i = nearest((path_mm[place + 1, 0] - origin_x) / cell_mm) + half
        next_j = nearest((path_mm[place + 1, 1] - origin_y) / cell_mm) + half
        across = i != next_i and j != next_j
        away_mm = int(field_mm[i, j])
        more = int(diagonal[away_mm] if across else straight[away_mm])
        near_cells = search.NEAR_CELLS
        if abs(i - robot_i) <= near_cells and abs(j - robot_j) <= near_cells:
            near = near_diagonal if across else near_straight
            if more < 0 or more > near:
                more = near
        if more < 0:
            return -1
        cost += more
    return cost


@compiled
def chord(
    field_mm: Field,
    from_x: float,
    from_y: float,
    to_x: float,
    to_y: float,
    cell_mm: int,
    shares: Floats,
    radius_mm: float,
    hard_mm: float,
) -> float:
    """Cost of a straight line in free mm, -1 where it is blocked.

    It is blocked where there is less room than the hardest way has; beside a wall that is allowed
    for the first bit, as long as there is more and more of it.
    """
    dx, dy = to_x - from_x, to_y - from_y
    length = np.sqrt(dx * dx + dy * dy)
    count = int(2.0 * length / cell_mm) + 1
    here_mm = distance_at(field_mm, from_x, from_y, cell_mm) - radius_mm
    cost = 0.0
    for step in range(1, count + 1):
        part = step / count
        away_mm = distance_at(field_mm, from_x + part * dx, from_y + part * dy, cell_mm)
        clear_mm = away_mm - radius_mm
        if clear_mm < hard_mm - 10.0 and clear_mm < here_mm + 0.3 * part * length - 10.0:
            return -1.0
        cost += length / count / share_at(shares, away_mm)
    return cost


@compiled
def farthest(
    field_mm: Field,
    path_mm: Path,
    origin_x: int,
    origin_y: int,
    index: int,
    x_mm: float,
    y_mm: float,
    cell_mm: int,
    shares: Floats,
    radius_mm: float,
    hard_mm: float,
    look_mm: float,
    factor: float,
) -> int:
    """Farthest cell of the way whose chord costs hardly more than the way to it."""
    best = index
    before_x, before_y = x_mm, y_mm
    cost = way_mm = 0.0
    refused = 0
    for place in range(index, len(path_mm)):
        to_x = float(path_mm[place, 0] - origin_x)
        to_y = float(path_mm[place, 1] - origin_y)
        dx, dy = to_x - before_x, to_y - before_y
        step_mm = np.sqrt(dx * dx + dy * dy)
        before_x, before_y = to_x, to_y
        cost += step_mm / share_at(shares, distance_at(field_mm, to_x, to_y, cell_mm))
        if place > index:
            way_mm += step_mm
            if way_mm > look_mm:
                break
        straight_on = chord(field_mm, x_mm, y_mm, to_x, to_y, cell_mm, shares, radius_mm, hard_mm)
        if 0.0 <= straight_on <= factor * cost + CHORD_MM:
            best = place
            refused = 0
        else:
            refused += 1
            if refused == REFUSED_MAX:
                break
    dx = path_mm[best, 0] - origin_x - x_mm
    dy = path_mm[best, 1] - origin_y - y_mm
    if best + 1 < len(path_mm) and dx * dx + dy * dy < cell_mm * cell_mm:
        best += 1  # it is there already; whether it can go on is for the guard to say
    return best
