"""Who can hear whom: connected groups of live robots, from their true places and the faults.

    TickRecord, faults at work --links--> who hears each other --components--> groups

A link counts where both hear the other. Where beacons are lost at random it counts while each has
heard the other lately, since nobody can know better.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence

import msgspec
import numpy as np
import numpy.typing as npt

from swarm import faults
from swarm.faults import Fault
from swarm.messages import TickRecord
from swarm.scenario import Scenario

Flags = npt.NDArray[np.bool_]
Group = frozenset[int]  # rows

LINK_FAULTS = (faults.Partition, faults.Deaf, faults.Mute, faults.Loss)
ONE_WAY = (faults.Deaf, faults.Mute)


class Working(msgspec.Struct):
    """Faults at work now: number -> rows that they strike."""

    rows: dict[int, set[int]] = {}

    def observe(self, record: TickRecord, rows: Mapping[str, int]) -> bool:
        """Take the events of a tick; whether anything has begun or ended."""
        changed = False
        for event in record.events:
            if event.number < 0 or event.kind not in ("fault", "fault-over"):
                continue
            changed = True
            struck = self.rows.setdefault(event.number, set())
            row = rows.get(event.robot or "", -1)
            if event.kind == "fault":
                struck.add(row)
            else:
                struck.discard(row)
                if not struck:
                    del self.rows[event.number]
        return changed


class Links:
    """Keeps what was heard lately, and tells the groups of each tick."""

    def __init__(self, scenario: Scenario) -> None:
        count = len(scenario.robots)
        self._range_m = scenario.radio.range_m
        self._lately_ticks = int(scenario.priority.stale_s / scenario.dt_s + 1e-9)
        self._is_lossy = any(isinstance(fault, faults.Loss) for fault in scenario.faults)
        self._heard_tick = np.full((count, count), -(10**9))  # listener, speaker

    def groups(
        self, record: TickRecord, working: Mapping[int, set[int]], planned: Sequence[Fault]
    ) -> tuple[list[Group], Flags]:
        """Groups of the live, and the links among all robots.

        Args:
            working: rows by number of fault.
            planned: the run's faults, by number.
        """
        alive = np.array([robot.alive for robot in record.robots])
        x_m = np.array([robot.pose.x_m for robot in record.robots])
        y_m = np.array([robot.pose.y_m for robot in record.robots])
        dx_m, dy_m = x_m[:, None] - x_m, y_m[:, None] - y_m
        links: Flags = dx_m * dx_m + dy_m * dy_m <= self._range_m * self._range_m
        links &= alive[:, None] & alive
        lossy = np.zeros_like(links)
        for number, rows in working.items():
            fault = planned[number] if number < len(planned) else None
            if not isinstance(fault, LINK_FAULTS):
                continue
            struck = np.zeros(len(alive), np.bool_)
            struck[[row for row in rows if row >= 0]] = True
            if isinstance(fault, faults.Partition):
                links &= struck[:, None] == struck
            elif isinstance(fault, faults.Loss):
                lossy |= struck[:, None] | struck
            else:
                links &= ~(struck[:, None] | struck)
        for frame in record.frames if self._is_lossy else ():
            speakers = frame.heard.numpy()[:, 0]
            self._heard_tick[frame.row, speakers] = record.tick
        if lossy.any():
            lately = self._heard_tick >= record.tick - self._lately_ticks
            links &= ~lossy | (lately & lately.T)
        return components(links, alive), links


def components(links: Flags, alive: Flags) -> list[Group]:
    """Connected groups, in order of their smallest row."""
    rows = np.flatnonzero(alive)
    if links[np.ix_(rows, rows)].all():
        return [frozenset(rows.tolist())] if len(rows) else []
    left = set(rows.tolist())
    found = []
    while left:
        reached = _reached(links, min(left))
        group = frozenset(row for row in reached if row in left)
        found.append(group)
        left -= group
    return found


def diameter(links: Flags, group: Group) -> int:
    """Longest of the shortest ways, in links, within a group; at least 1."""
    return max(1, *(max(_reached(links, row).values()) for row in group))


def _reached(links: Flags, begin: int) -> dict[int, int]:
    """Row -> links on the way there, of all that can be reached."""
    far = {begin: 0}
    todo = deque([begin])
    while todo:
        here = todo.popleft()
        for row in np.flatnonzero(links[here]).tolist():
            if row not in far:
                far[row] = far[here] + 1
                todo.append(row)
    return far
