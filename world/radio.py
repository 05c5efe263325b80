"""Who hears whom: the radio between the robots, which only the world knows."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from swarm.geometry import Floats

Flags = npt.NDArray[np.bool_]


def audible(range_m: float, positions_m: Floats, alive: Flags) -> Flags:
    """Which robot hears which: within range of each other, both alive, never itself.

    Args:
        positions_m: (robots, 2) world frame.
        alive: (robots,) the dead say nothing and hear nothing.
    Returns:
        (robots, robots) row: listener, column: speaker. Symmetric.
    """
    dx_m = positions_m[:, 0, None] - positions_m[:, 0]
    dy_m = positions_m[:, 1, None] - positions_m[:, 1]
    heard: Flags = dx_m * dx_m + dy_m * dy_m <= range_m * range_m
    heard &= alive
    heard &= alive[:, None]
    np.fill_diagonal(heard, False)
    return heard
