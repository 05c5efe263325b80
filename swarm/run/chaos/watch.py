"""What must hold in every run, checked tick by tick: a stream of records -> what was broken.

begin -> Watch    observe every tick    conclude -> Findings(violations, figures)

contact      nobody touches anything, but who has a fault of motors or lidar
two-leaders  in one group two leaders are followed for TICKS_PER_LINK x its diameter at most
no-leader    once the faults are over, each group has one live leader of its own
falls        the leadership that a robot follows only rises; a claim is made once
waits        nobody gives way for ever
stuck        once the faults are over, all who live and can, arrive
lost         no process is gone or hangs that was not struck; no fault misses its target
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

import msgspec

from swarm import faults, messages, metrics
from swarm.messages import Beacon, Leadership, RobotRecord, TickRecord
from swarm.run.chaos import groups, reach
from swarm.run.chaos.groups import Group
from swarm.scenario import Scenario

TICKS_PER_LINK = 13  # of an election: silence twice, and one more
WAIT_S_MAX = 60.0  # where robots without a formation let each other pass
NAMED_MAX = 20  # violations of a run that are kept; the rest is like them


class Violation(msgspec.Struct, frozen=True):
    """Something that must not be."""

    invariant: str
    tick: int
    robots: tuple[str, ...]
    text: str


class Findings(msgspec.Struct, frozen=True, kw_only=True):
    """What a run came to; times in simulated seconds."""

    violations: tuple[Violation, ...] = ()
    detected_s: tuple[float, ...] = ()  # from a kill, restart or hang to its being noticed
    recovered_s: tuple[float, ...] = ()  # from there until all had a live leader again
    agreed_s: tuple[float, ...] = ()  # from a group's change to its one live leader
    converged_s: float | None = None  # from the last fault's end to the last arrival
    clearance_obstacle_m: float | None = None
    clearance_robot_m: float | None = None
    sim_time_s: float = 0.0


class _Robot(msgspec.Struct):
    """What is remembered of one robot."""

    contact: bool = False
    incarnation: int = -1
    leadership: Leadership | None = None
    claimed_term: int = -1  # highest that it has claimed itself, in this life
    yields_to: str | None = None
    yielding_ticks: int = 0
    told: bool = False  # of its waiting


class _Grouping(msgspec.Struct):
    """What is remembered of one group."""

    since_tick: int
    settled: bool = False  # it has one live leader of its own
    agreed_tick: int = -1  # newest with at most one leader
    told: bool = False


class Watch:
    """The eyes of one run."""

    def __init__(self, scenario: Scenario, healed_tick: int) -> None:
        self._scenario = scenario
        self._healed_tick = healed_tick
        self._names = [robot.name for robot in scenario.robots]
        self._rows = {name: row for row, name in enumerate(self._names)}
        self._robots = [_Robot() for _ in self._names]
        self._links = groups.Links(scenario)
        self._working = groups.Working({})
        self._groups: dict[tuple[Group, tuple[int, ...]], _Grouping] = {}
        self._violations: list[Violation] = []
        self._agreed_s: list[float] = []
        self._tick = -1
        self._last: TickRecord | None = None
        patience_s = scenario.priority.yield_s_max + 2.0 * scenario.dt_s
        self._patience_ticks = scenario.tick_of(
            WAIT_S_MAX if scenario.formation is None else patience_s
        )

    def observe(self, record: TickRecord) -> None:
        """One tick; those that are told twice, because a world was killed, count once."""
        if record.tick <= self._tick:
            return
        self._tick = record.tick
        self._last = record
        changed = self._working.observe(record, self._rows)
        self._look_for_losses(record)
        for row, robot in enumerate(record.robots):
            self._look_for_contact(row, robot)
            if robot.alive and robot.beacon is not None:
                self._look_at_claims(row, robot.beacon)
                self._look_at_waiting(row, robot.beacon)
            else:
                self._robots[row].yielding_ticks = 0
        if self._scenario.formation is not None:
            self._look_at_leaders(record, changed)

    @property
    def violations(self) -> tuple[Violation, ...]:
        """Of the ticks so far."""
        return tuple(self._violations[:NAMED_MAX])

    @property
    def agreed_s(self) -> tuple[float, ...]:
        """How long each group took to agree on a live leader, as far as it has."""
        return tuple(self._agreed_s)

    def conclude(self, score: metrics.Score, ended: str | None) -> Findings:
        """After the last tick.

        Args:
            ended: why it was the last; None: nobody knows, the rest was lost.
        """
        scenario = self._scenario
        if ended not in ("arrived", None):
            self._look_for_stuck(score, ended)
        arrivals = [tally.arrival_tick for tally in score.tallies if tally.arrival_tick is not None]
        converged_s = None
        if ended == "arrived":
            converged_s = max(0, max(arrivals) - self._healed_tick) * scenario.dt_s
        rows = metrics.summary(score, _FACTS).faults
        return Findings(
            violations=self.violations,
            detected_s=tuple(
                row.detected_s for row in rows if _is_blow(row) and row.detected_s is not None
            ),
            recovered_s=tuple(
                row.recovered_s for row in rows if _is_blow(row) and row.recovered_s is not None
            ),
            agreed_s=self.agreed_s,
            converged_s=converged_s,
            clearance_obstacle_m=_finite(score.clearance_obstacle_m),
            clearance_robot_m=_finite(score.clearance_robot_m),
            sim_time_s=score.tick * scenario.dt_s,
        )

    # --- safety ---

    def _look_for_contact(self, row: int, robot: RobotRecord) -> None:
        known = self._robots[row]
        if robot.contact and not known.contact:
            known.contact = True
            if not robot.excused:
                at = f"at ({robot.pose.x_m:.2f}, {robot.pose.y_m:.2f}) m"
                self._break("contact", [row], f"touched something {at}")

    def _look_for_losses(self, record: TickRecord) -> None:
        for event in record.events:
            if event.kind in ("robot-lost", "robot-hung", "robot-missing", "fault-failed"):
                row = self._rows.get(event.robot or "")
                self._break("lost", [] if row is None else [row], f"{event.kind}: {event.text}")

    # --- leaders ---

    def _look_at_claims(self, row: int, beacon: Beacon) -> None:
        known, claim = self._robots[row], beacon.leadership
        if beacon.incarnation != known.incarnation:
            known.incarnation, known.leadership, known.claimed_term = beacon.incarnation, None, -1
        before = known.leadership
        if claim == before:
            return
        known.leadership = claim
        if before is not None and (
            claim is None or messages.leadership_order(claim) > messages.leadership_order(before)
        ):
            self._break("falls", [row], f"followed {_said(before)}, then {_said(claim)}")
        if claim is not None and claim.name == self._names[row]:
            if claim.term <= known.claimed_term or (before and claim.term <= before.term):
                self._break("falls", [row], f"claims {_said(claim)} after {_said(before)}")
            known.claimed_term = max(known.claimed_term, claim.term)

    def _look_at_leaders(self, record: TickRecord, changed: bool) -> None:
        planned = self._scenario.faults
        working = self._working.rows
        found, links = self._links.groups(record, working, planned)
        one_way = any(
            isinstance(planned[number], groups.ONE_WAY)
            for number in working
            if number < len(planned)
        )
        kept: dict[tuple[Group, tuple[int, ...]], _Grouping] = {}
        for group in found:
            lives = tuple(
                beacon.incarnation
                for row in sorted(group)
                if (beacon := record.robots[row].beacon) is not None
            )
            known = self._groups.get((group, lives))
            if known is None:
                known = _Grouping(record.tick)
            elif changed and not known.settled:
                known.since_tick = record.tick  # what it has to cope with is new
            kept[group, lives] = known
            self._look_at_group(record, group, known, links, one_way)
        self._groups = kept

    def _look_at_group(
        self,
        record: TickRecord,
        group: Group,
        known: _Grouping,
        links: groups.Flags,
        one_way: bool,
    ) -> None:
        tick = record.tick
        followed: set[str] = set()
        everyone = True
        for row in group:
            beacon = record.robots[row].beacon
            if beacon is None or beacon.leadership is None:
                everyone = False
            else:
                followed.add(beacon.leadership.name)
        if len(followed) < 2:
            known.agreed_tick = tick
        leader = self._rows[next(iter(followed))] if len(followed) == 1 else -1
        if everyone and leader in group:
            if not known.settled:
                known.settled = True
                known.told = False
                if 0 < known.since_tick < tick:
                    self._agreed_s.append((tick - known.since_tick) * self._scenario.dt_s)
            return
        if known.settled:
            known.settled, known.since_tick = False, tick
        since_tick = max(known.since_tick, known.agreed_tick) if one_way else known.since_tick
        is_split = len(followed) > 1
        if not is_split:
            since_tick = max(since_tick, self._healed_tick)
        if known.told or (not is_split and tick < self._healed_tick):
            return
        bound = (TICKS_PER_LINK + self._late_ticks()) * groups.diameter(links, group)
        if tick - since_tick > bound:
            known.told = True
            names = ", ".join(sorted(followed)) or "nobody"
            self._break(
                "two-leaders" if is_split else "no-leader",
                sorted(group),
                f"{tick - since_tick} ticks after the last change of their group, {bound} are "
                f"allowed: they follow {names}",
            )

    def _late_ticks(self) -> int:
        """How much later than at once anybody may hear of anything now."""
        late_s = 0.0
        slow_s = 0.0
        for number in self._working.rows:
            fault = self._scenario.faults[number] if number < len(self._scenario.faults) else None
            if isinstance(fault, faults.Delay):
                late_s = max(late_s, fault.delay_s)
            elif isinstance(fault, faults.Slow):
                slow_s = max(slow_s, fault.late_s)
        return self._scenario.tick_of(late_s + slow_s)

    # --- progress ---

    def _look_at_waiting(self, row: int, beacon: Beacon) -> None:
        known = self._robots[row]
        if beacon.yields_to is None:
            known.yielding_ticks, known.told = 0, False
            return
        known.yielding_ticks += 1
        if known.yielding_ticks > self._patience_ticks and not known.told:
            known.told = True
            waited_s = known.yielding_ticks * self._scenario.dt_s
            text = f"has given way to {beacon.yields_to} for {waited_s:.1f} s without a break"
            self._break("waits", [row], text)

    def _look_for_stuck(self, score: metrics.Score, ended: str | None) -> None:
        assert self._last is not None
        robots = self._last.robots
        late = [
            row
            for row, (tally, mission) in enumerate(zip(score.tallies, score.missions, strict=True))
            if mission and tally.alive and not tally.contact and tally.arrival_tick is None
        ]
        able = [
            row
            for row in late
            if reach.can_arrive(self._scenario, robots, row, score.tallies[row].target)
        ]
        for row in able:
            tally = score.tallies[row]
            off = "no place to go" if tally.error_m is None else f"{tally.error_m:.2f} m off"
            said = f"{tally.mode}: {tally.reason}" if tally.reason else tally.mode
            self._break("stuck", [row], f"{ended}: {said}, {off}")

    # --- what was broken ---

    def _break(self, invariant: str, rows: Sequence[int], text: str) -> None:
        robots = tuple(self._names[row] for row in rows)
        self._violations.append(Violation(invariant, self._tick, robots, text))


_FACTS = metrics.Facts(scenario="", run="", bus="memory")


def _is_blow(row: metrics.FaultRow) -> bool:
    """Whether a fault takes a robot away, so that there is something to detect."""
    return row.kind in ("kill", "restart", "hang")


def _said(leadership: Leadership | None) -> str:
    return "nobody" if leadership is None else f"{leadership.name} in term {leadership.term}"


def _finite(value: float) -> float | None:
    return value if value < inf else None
