"""One look around in one inner loop: what is known, without peers, and the sectors of the MSAM.

    ranges --NaN: nothing is known--> --without peers--> hits --nearest of each sector--> msam.Map

The same as `health.known_ranges` and `msam.update` make of it, for a robot that hears many.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos

import numpy as np
import numpy.typing as npt

from agents import msam
from agents.navigator import memory
from agents.navigator.compiled import compiled
from agents.navigator.points import bin_of
from agents.peers import Peer
from swarm.geometry import TAU, Floats, Ranges
from swarm.scenario import RobotSetup

BEYOND_M = 1.0  # beyond the lidar's range: whose body is further off hides no hit
ROUNDING_M = 1e-9

# Columns of a peer: where it is, body frame; how far off that is; how near to it hits are its own.
X, Y, AWAY, REACH = range(4)
_NOBODY: Floats = np.empty((0, 4))

Ends = npt.NDArray[np.int64]


def look(setup: RobotSetup, ranges_m: Ranges, others: Sequence[Peer]) -> tuple[msam.Map, bool]:
    """Map of a scan, and whether something is known of every beam.

    Args:
        ranges_m: (beams,) m, inf for a miss, NaN where nothing is known.
        others: those whose bodies are no obstacles.
    """
    bodies = _NOBODY
    if others:
        bodies = _bodies(setup, others)
    rays = memory.beams(len(ranges_m))
    count = setup.msam.sectors
    ends = np.empty((count, 2), dtype=np.int64)
    known_m, sectors_m, complete, runs = scan(
        ranges_m,
        bodies,
        rays.units,
        rays.bounds,
        count,
        setup.sensor.range_m / setup.msam.rings,
        setup.field.rho_m,
        setup.msam.link_distance_m,
        cos(TAU / count),
        ends,
    )
    known_m.setflags(write=False)
    linked = [range(start, stop) for start, stop in ends[:runs].tolist()]
    return msam.of(setup, known_m, sectors_m.tolist(), [], linked), complete


def surely(setup: RobotSetup, hits_m: Ranges, others: Sequence[Peer]) -> Ranges:
    """Hits that can be no peer's, even one that is not quite where it is believed to be.

    The rest is only looked at: were it remembered, peers would leave obstacles behind them. It is
    the same array where nothing is declared and all are heard.

    Args:
        hits_m: (beams,) of obstacles.
        others: those whose bodies are no obstacles, as seen from where the scan was made.
    """
    declared, dt_s = setup.disturbance, setup.dt_s
    tolerance_m = setup.msam.peer_tolerance_m
    off_m = declared.range_error_m_max + 2.0 * declared.position_error_m_max
    far_m = setup.sensor.range_m + BEYOND_M
    yaw_error_rad, speed_error = declared.yaw_error_rad_max, declared.speed_error
    if off_m == yaw_error_rad == speed_error == 0.0:
        others = [peer for peer in others if peer.missed_ticks]
    flat: list[float] = []
    for peer in others:
        away_m, beacon = peer.distance_m, peer.beacon
        more_m = off_m + yaw_error_rad * away_m
        ticks = peer.missed_ticks + speed_error * (1 + peer.missed_ticks)
        reach_m = beacon.body_radius_m + tolerance_m + more_m + ticks * dt_s * beacon.speed_mps_max
        if away_m - reach_m < far_m:
            flat += (*peer.offset_body, away_m, reach_m)
    if not flat:
        return hits_m
    rays = memory.beams(len(hits_m))
    left_m = hits_m.copy()
    hide(hits_m, np.array(flat).reshape(-1, 4), rays.units, rays.bounds, left_m)
    left_m.setflags(write=False)
    return left_m


def _bodies(setup: RobotSetup, others: Sequence[Peer]) -> Floats:
    """(peers, 4) as `scan` has them."""
    far_m = setup.sensor.range_m + BEYOND_M
    tolerance_m, more_m = setup.msam.peer_tolerance_m, setup.msam.peer_tolerance_per_missed_tick_m
    flat: list[float] = []
    for peer in others:
        reach_m = peer.beacon.body_radius_m + tolerance_m + more_m * peer.missed_ticks
        if peer.distance_m - reach_m < far_m:
            flat += (*peer.offset_body, peer.distance_m, reach_m)
    return np.array(flat, dtype=np.float64).reshape(-1, 4)


# --- inner loops --------------------------------------------------------------------------------


@compiled
def scan(
    ranges_m: Ranges,
    bodies: Floats,
    units: Floats,
    bounds: Floats,
    sectors: int,
    ring_m: float,
    rho_m: float,
    link_m: float,
    cosine: float,
    ends: Ends,
) -> tuple[Ranges, Floats, bool, int]:
    """Hits without peers, inner edge of the nearest ring of each sector, whether none is unknown.

    The last one is how many runs of sectors are linked, as `msam.linked_runs` has them.

    Args:
        bodies: (peers, 4) as above.
        units: (beams, 2) body frame; `bounds` as `bin_of` has them.
        cosine: of the angle between two sectors.
        ends: (sectors, 2) filled with the first sector of each run and the one after its last.
    """
    beams = len(ranges_m)
    known_m = ranges_m.copy()
    complete = True
    for beam in range(beams):
        if np.isnan(known_m[beam]):
            known_m[beam] = np.inf
            complete = False
    hide(ranges_m, bodies, units, bounds, known_m)
    nearest_m = np.empty(sectors)
    per_sector = beams // sectors
    for sector in range(sectors):
        least_m = np.inf
        for beam in range(sector * per_sector, (sector + 1) * per_sector):
            least_m = min(least_m, float(known_m[beam]))
        nearest_m[sector] = np.floor(least_m / ring_m) * ring_m
    return known_m, nearest_m, complete, link(nearest_m, rho_m, link_m, cosine, ends)


@compiled
def link(sectors_m: Floats, rho_m: float, link_m: float, cosine: float, ends: Ends) -> int:
    """How many runs of sectors within rho are linked; `ends` is filled with theirs."""
    count = len(sectors_m)
    runs = 0
    for sector in range(count):
        range_m = sectors_m[sector]
        if not range_m < rho_m:
            continue
        before_m = sectors_m[sector - 1]
        if (
            runs > 0
            and ends[runs - 1, 1] == sector
            and range_m * range_m + before_m * before_m - 2.0 * range_m * before_m * cosine
            < link_m * link_m
        ):
            ends[runs - 1, 1] = sector + 1
        else:
            ends[runs, 0], ends[runs, 1] = sector, sector + 1
            runs += 1
    if runs > 1 and ends[0, 0] == 0 and ends[runs - 1, 1] == count:  # across the back
        a_m, b_m = sectors_m[count - 1], sectors_m[0]
        if a_m * a_m + b_m * b_m - 2.0 * a_m * b_m * cosine < link_m * link_m:
            ends[runs - 1, 1] = count + ends[0, 1]
            for run in range(runs - 1):
                ends[run, 0], ends[run, 1] = ends[run + 1, 0], ends[run + 1, 1]
            runs -= 1
    return runs


@compiled
def hide(ranges_m: Ranges, bodies: Floats, units: Floats, bounds: Floats, left_m: Ranges) -> None:
    """Make misses of the hits that lie on bodies.

    Args:
        bodies, units, bounds: of `scan`.
        left_m: (beams,) changed.
    """
    beams = len(ranges_m)
    # From the beam that looks at the middle of a body to both sides, as far as they cross it.
    for row in range(len(bodies)):
        x_m, y_m = bodies[row, X], bodies[row, Y]
        away_m, reach_m = bodies[row, AWAY], bodies[row, REACH]
        inside = away_m <= reach_m
        middle = bin_of(bounds, x_m, y_m)
        for side in range(-1, 2, 2):
            for step in range(beams // 2 + 1):
                beam = (middle + side * step) % beams
                unit_x, unit_y = units[beam, 0], units[beam, 1]
                if not inside and step > 0:
                    off_m = abs(unit_x * y_m - unit_y * x_m)
                    if off_m > reach_m + ROUNDING_M or unit_x * x_m + unit_y * y_m < 0.0:
                        break
                hit_m = float(ranges_m[beam])
                if away_m - reach_m <= hit_m <= away_m + reach_m:
                    dx_m, dy_m = hit_m * unit_x - x_m, hit_m * unit_y - y_m
                    if dx_m * dx_m + dy_m * dy_m <= reach_m * reach_m:
                        left_m[beam] = np.inf
