"""Lidars that fail: true scans in, what the robots are shown out.

    declared noise (world.disturbance) -> bias -> noise -> dropout -> nan -> stuck

whichever began first. A stuck lidar repeats what it showed, so it comes last. No fault touches
poses and twists.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from swarm.faults import Bias, Dropout, Nan, Noise, SensorFault, SensorStuck
from swarm.geometry import Floats, Ranges
from swarm.messages import Array
from swarm.scenario import DEVIATES_MAX
from world import faults
from world.faults import Active

ORDER = (Bias, Noise, Dropout, Nan, SensorStuck)


def disturb(
    ranges_m: Ranges,
    rows: Sequence[int],
    active: Sequence[Active],
    *,
    range_m: float,
    seed: int,
    tick: int,
) -> Ranges:
    """What the lidars of some robots show instead of what is so.

    Args:
        ranges_m: (rows, beams) true ones, inf where nothing is hit within range_m.
        rows: whose lidars they are.
    Returns:
        (rows, beams) m: in [0, range_m], inf or NaN.
    """
    found = [one for one in active if isinstance(one.fault, SensorFault)]
    if not found:
        return ranges_m
    shown_m = ranges_m.copy()
    places = {row: place for place, row in enumerate(rows)}
    for one in sorted(found, key=lambda one: ORDER.index(type(one.fault))):
        for number, row in enumerate(one.rows):
            if row in places:
                place = places[row]
                shown_m[place] = (
                    one.scans[number].numpy()
                    if isinstance(one.fault, SensorStuck)
                    else _shown(one, row, shown_m[place].astype(np.float64), range_m, seed, tick)
                )
    return shown_m


def scan(ranges_m: Ranges) -> Array:
    """Wire form of one scan (beams,)."""
    return Array("<f4", ranges_m.shape, ranges_m.astype("<f4").tobytes())


def _shown(
    active: Active, row: int, ranges_m: Floats, range_m: float, seed: int, tick: int
) -> Floats:
    """One scan (beams,) as it comes out; what was hit stays hit unless the beam drops out."""
    fault = active.fault
    if isinstance(fault, Nan):
        return np.full_like(ranges_m, np.nan)
    if isinstance(fault, Bias):
        return off(ranges_m, fault.bias_m, range_m)
    generator = faults.draws(seed, faults.STREAM_LIDARS, active.number, row, tick)
    if isinstance(fault, Noise):
        deviates = generator.standard_normal(len(ranges_m))
        return off(
            ranges_m, fault.sigma_m * np.clip(deviates, -DEVIATES_MAX, DEVIATES_MAX), range_m
        )
    assert isinstance(fault, Dropout)
    ranges_m[generator.random(len(ranges_m)) < fault.probability] = np.inf
    return ranges_m


def off(ranges_m: Floats, error_m: float | Floats, range_m: float) -> Floats:
    """Ranges with an error, those that hit something kept in [0, range_m]."""
    return np.where(np.isfinite(ranges_m), np.clip(ranges_m + error_m, 0.0, range_m), ranges_m)
