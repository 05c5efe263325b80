"""The scenario that `swarm new` writes: small, commented, and it runs as it is."""

from __future__ import annotations

import math

from swarm import shapes
from swarm.messages import Slot

SPACING_M = 1.5
AHEAD_M = 14.0  # from the leader's start to its goal
SPEED_MPS = 0.6  # a leader's cruise speed, unless the scenario says otherwise
SPARE_S = 30.0  # beyond the time that the way takes
RANGE_M = 10.0  # of the radio, unless the scenario says otherwise

HEAD = """\
# {name}: {what}. Lengths in m, angles in rad, counter-clockwise from x.
#
#   swarm validate {name}.toml                 is it right?
#   swarm run {name}.toml --view web           watch it
#   swarm run {name}.toml --dry-run            every tunable there is, with its value
#   swarm run {name}.toml --fault kill:robot{last}@4.8

title = "{name}: {what}"
seed = 1               # of everything that is drawn at random; the same seed, the same run
dt_s = 0.08            # one tick
duration_s = {duration_s:.1f}      # simulated; then the run is over, arrived or not
"""
FORMATION = """
# Followers keep slots behind the leader, those of a shape (line, column, wedge, diamond, circle)
# or, without `shape`, those in which they start.
[formation]
leader = "robot1"
shape = "{shape}"
spacing_m = {spacing_m}
"""
RADIO = """
# The formation is larger than the radio reaches by default (10 m).
[radio]
range_m = {range_m:.1f}
"""
LEADER = """
# A row for every robot. Who has a goal goes there; `via = [[4.0, 1.0]]` leads through way-points.
[[robots]]
name = "robot1"
start = [0.0, 0.0, 0.0]     # x, y, yaw
goal = [{goal_m:.1f}, 0.0]
"""
FOLLOWER = """
[[robots]]
name = "robot{number}"
start = [{x_m:.3f}, {y_m:.3f}, 0.0]
"""
FOOT = """
# What is in the way: circles [x, y, radius], or polygons [[x, y], ...]. A circle moves with
# `path = [[8.0, 3.0]]` and `speed_mps = 0.5`: there and back again.
[[obstacles]]
circle = [{circle_x_m:.1f}, 0.4, 0.5]

# Uncomment, and something goes wrong at exactly that time; see `swarm fault --help`.
# [[faults]]
# kind = "kill"
# target = "robot{last}"
# at_s = 8.0

# Uncomment, and robots bear what no simulator spares them; see world/README.md.
# [disturbance]
# range_sigma_m = 0.01

# What the run must reach; `swarm run` exits with 1 when it does not.
[expect]
outcome = "succeeded"
arrived = {robots}
collisions = 0
"""


def scenario(name: str, robots: int, shape: shapes.Shape) -> str:
    """TOML of a scenario: a formation goes round a circle to its goal."""
    slots = shapes.slots(shape, robots - 1, SPACING_M)
    behind_m = max([-_place(slot)[0] for slot in slots], default=0.0)
    goal_m = AHEAD_M + max(0.0, behind_m)
    what = f"a {shape} of {robots} robots passes an obstacle" if slots else "one robot on its way"
    parts = [
        HEAD.format(name=name, what=what, last=robots, duration_s=goal_m / SPEED_MPS + SPARE_S)
    ]
    if slots:
        parts.append(FORMATION.format(shape=shape, spacing_m=SPACING_M))
    reach_m = max([slot.distance_m for slot in slots], default=0.0)
    if reach_m > 0.8 * RANGE_M:
        parts.append(RADIO.format(range_m=math.ceil(1.25 * reach_m)))
    parts.append(LEADER.format(goal_m=goal_m))
    for number, slot in enumerate(slots, start=2):
        x_m, y_m = _place(slot)
        parts.append(FOLLOWER.format(number=number, x_m=x_m + 0.0, y_m=y_m + 0.0))
    parts.append(FOOT.format(circle_x_m=0.5 * AHEAD_M, last=robots, robots=robots))
    return "".join(parts)


def _place(slot: Slot) -> tuple[float, float]:
    """Where a slot is, seen from the leader at the origin that looks along x (eq. 39)."""
    x_m = -slot.distance_m * math.cos(slot.bearing_rad)
    y_m = -slot.distance_m * math.sin(slot.bearing_rad)
    return round(x_m, 3) + 0.0, round(y_m, 3) + 0.0
