"""How fast a robot may be at a clearance, and what a way costs there: one law for all stages.

    v(c) / v_max = 1 from comfort_m on, falling to crawl_share in touch, slit_share in slits

A way costs the time that it takes, integral ds / v(c). Costs of the search are whole numbers, in
thousandths of what a free cell costs: sums do not depend on the order in which they are made, so
that mirrored scenes have mirrored ways.
"""

from __future__ import annotations

from functools import lru_cache
from math import ceil, sqrt

import msgspec
import numpy as np
import numpy.typing as npt

from swarm.geometry import Floats
from swarm.scenario import Navigator

Ints = npt.NDArray[np.int32]

FREE = 1000  # cost of a free cell, straight on
BLOCKED = -1
# Cells grow with large bodies: what a point costs grows with the square of their number.
RADIUS_CELLS_MAX = 6.0
SLIT_M = 0.03  # so much above hard_m a way is a slit
# Less room than hard_m: the field's cells make slits look up to this much narrower than they are.
# Such a way is taken only when there is no other: as long as so many free cells for each of its.
DOUBTFUL_M, DOUBTFUL_CELLS = -0.015, 200
DESPERATE_M, DESPERATE_CELLS = -0.05, 600


class Law(msgspec.Struct, frozen=True, eq=False):
    """Tables over the distance from the robot's centre to the nearest point, in whole mm."""

    cell_mm: int
    half_cells: int  # of the window to each side of its middle cell
    reach_mm: int  # distances are known up to here; further off all is free
    radius_mm: float
    hard_mm: float
    shares: Floats  # (reach_mm + 1,) v(c) / v_max
    straight: Ints  # (reach_mm + 1,) cost of a step to such a cell; BLOCKED: none
    diagonal: Ints
    near_straight: int  # the same beside the robot, where it must get away from whatever is there
    near_diagonal: int

    @property
    def side_cells(self) -> int:
        """Of the window."""
        return 2 * self.half_cells + 1


@lru_cache(maxsize=64)
def law(navigator: Navigator, radius_m: float) -> Law:
    """Tables of one kind of robot."""
    cell_mm = round(1000.0 * max(navigator.cell_m, radius_m / RADIUS_CELLS_MAX))
    reach_m = radius_m + navigator.comfort_m + cell_mm / 1000.0
    reach_mm = ceil(1000.0 * reach_m)
    clearances_m = [mm / 1000.0 - radius_m for mm in range(reach_mm + 1)]
    shares = [share(navigator, clearance_m) for clearance_m in clearances_m]
    straight = [_cost(navigator, clearance_m, 1.0) for clearance_m in clearances_m]
    diagonal = [_cost(navigator, clearance_m, sqrt(2.0)) for clearance_m in clearances_m]
    worst = share(navigator, 0.0)
    return Law(
        cell_mm=cell_mm,
        half_cells=max(8, round(500.0 * navigator.window_m / cell_mm)),
        reach_mm=reach_mm,
        radius_mm=1000.0 * radius_m,
        hard_mm=1000.0 * navigator.hard_m,
        shares=np.array(shares),
        straight=np.array(straight, dtype=np.int32),
        diagonal=np.array(diagonal, dtype=np.int32),
        near_straight=round(FREE / worst),
        near_diagonal=round(sqrt(2.0) * FREE / worst),
    )


def share(navigator: Navigator, clearance_m: float) -> float:
    """v(c) / v_max."""
    tight = navigator.slit_share
    if clearance_m >= navigator.comfort_m:
        return 1.0
    if clearance_m <= 0.0:
        return 0.5 * tight
    crawl = navigator.crawl_share
    some = crawl + (1.0 - crawl) * clearance_m / navigator.comfort_m
    return min(some, tight) if clearance_m < navigator.hard_m + SLIT_M else some


def _cost(navigator: Navigator, clearance_m: float, cells: float) -> int:
    more = 0
    if clearance_m < DESPERATE_M:
        return BLOCKED
    if clearance_m < DOUBTFUL_M:
        more = DESPERATE_CELLS
    elif clearance_m < navigator.hard_m:
        more = DOUBTFUL_CELLS
    return round(cells * FREE * (more + 1.0 / share(navigator, clearance_m)))
