"""What adds up over a run: ways, clearances, errors, arrivals, waiting, leaders, the state's hash.

    begin(scenario) -> Score    observe(score, record) every tick    ended(score)? -> why

A Score is the one thing of the pure core that changes in place; metrics.summary reads it at last.
"""

from __future__ import annotations

import hashlib
import struct
from math import cos, inf, sin
from typing import Literal

import msgspec
import numpy as np
import numpy.typing as npt

from swarm import geometry, passages
from swarm.geometry import Vec2
from swarm.messages import Beacon, Leadership, RobotRecord, Slot, TickRecord
from swarm.scenario import Scenario

LINGER_S = 2.0  # a run goes on for so long after the last arrival
PATIENCE_S = 10.0  # and for so much longer while a formation error exceeds what is expected
SILENCING = ("kill", "restart", "hang")  # faults that take the mind away
SETTLED_M = 0.1  # a formation has settled while every error is below this

Ending = Literal["arrived", "blocked", "duration", "timeout", "stranded"]
Indices = npt.NDArray[np.intp]


class Tally(msgspec.Struct):
    """One robot, so far."""

    alive: bool = True
    contact: bool = False
    excused: bool = False  # that contact
    killed: bool = False  # by an injected fault, and not back yet
    x_m: float = 0.0
    y_m: float = 0.0
    path_m: float = 0.0
    target: Vec2 | None = None  # where it should be now: the goal, or the slot
    error_m: float | None = None  # from there
    follows: bool = False  # whether that is a slot behind a live leader
    arrival_tick: int | None = None  # of the stay at hand
    yields: int = 0
    waiting_ticks: int = 0
    yielding: bool = False
    held_back: bool = False  # by a guard, now
    mode: str = ""
    reason: str = ""  # of FAILED
    failed_tick: int | None = None  # since when it says that it has failed


class Fault(msgspec.Struct):
    """One injected fault, so far."""

    kind: str
    row: int
    tick: int
    number: int = -1  # in the run; several robots may share it
    over_tick: int | None = None
    lost: bool = False  # the world has taken the robot as lost
    detected_tick: int | None = None
    recovered_tick: int | None = None


class Score(msgspec.Struct, eq=False):
    """A whole run, so far; see `begin`."""

    scenario: Scenario
    rows: dict[str, int]
    tallies: list[Tally]
    slots: list[Slot | None]  # at the start, of the followers
    members: list[int]  # rows of the formation
    missions: list[bool]  # who has somewhere to arrive
    firsts: Indices  # (pairs,) row of the first of each pair of robots
    seconds: Indices
    touching_m: geometry.Floats  # (pairs,) distance of the centres at which they touch
    mirror_rows: list[tuple[int, int]]
    hash: hashlib._Hash
    tick: int = -1
    commands_total: int = 0
    guard_interventions: int = 0
    grants: int = 0
    double_grants: int = 0
    holders: frozenset[int] = frozenset()  # rows of those that hold a passage
    against: frozenset[tuple[int, int]] = frozenset()  # pairs of them, in opposite directions
    faults_failed: int = 0  # injected, but nobody delivered them
    clearance_obstacle_m: float = inf
    clearance_robot_m: float = inf
    error_m: float | None = None  # of the formation, now
    error_m_max: float | None = None
    unsettled_tick: int | None = None  # last with an error of SETTLED_M or more
    avoid_tick: int | None = None  # last with a follower in AVOID
    symmetry_m: float | None = None
    leadership: Leadership | None = None  # agreed last
    agreed: bool = False  # now
    leaders: list[tuple[int, Leadership]] = []  # from this tick on
    faults: list[Fault] = []


def begin(scenario: Scenario) -> Score:
    """Score of a run that has not begun."""
    count = len(scenario.robots)
    slots, formation = scenario.slots(), scenario.formation
    radii_m = np.array([robot.body_radius_m for robot in scenario.robots])
    firsts, seconds = np.triu_indices(count, 1)
    rows = {robot.name: row for row, robot in enumerate(scenario.robots)}
    return Score(
        scenario=scenario,
        rows=rows,
        tallies=[Tally() for _ in range(count)],
        slots=slots,
        members=[
            row
            for row, (robot, slot) in enumerate(zip(scenario.robots, slots, strict=True))
            if slot is not None or (formation is not None and formation.leader == robot.name)
        ],
        missions=_missions(scenario),
        firsts=firsts,
        seconds=seconds,
        touching_m=radii_m[firsts] + radii_m[seconds],
        mirror_rows=[(rows[one], rows[other]) for one, other in scenario.expect.mirror_pairs],
        hash=hashlib.sha256(),
        leaders=[],
        faults=[],
    )


def _missions(scenario: Scenario) -> list[bool]:
    """Who has somewhere to arrive: a goal of its own, or a slot behind one that has."""
    formation = scenario.formation
    led = formation is not None and scenario.robots[scenario.row(formation.leader)].goal is not None
    return [
        robot.goal is not None or (led and slot is not None)
        for robot, slot in zip(scenario.robots, scenario.slots(), strict=True)
    ]


def observe(score: Score, record: TickRecord) -> None:
    """Add one tick; ticks come in order. What a damaged recording lacks is not made up for."""
    assert record.tick > score.tick
    assert len(record.robots) == len(score.tallies)
    score.tick = record.tick
    score.commands_total += len(record.commands)
    _hash(score, record)
    _observe_faults(score, record)
    _observe_bodies(score, record.robots)
    _observe_clearances(score)
    _observe_guards(score, record)
    _observe_passages(score, record.robots)
    _observe_leadership(score, record.robots)
    _observe_errors(score, record.robots)
    _observe_recovery(score, record.robots)


def ended(score: Score) -> Ending | None:
    """Why the run is over after the ticks so far, None when it goes on.

    `blocked`: who has not arrived says that it never will. `stranded`: nobody is left who could
    still arrive, or move when there is nowhere to arrive.
    """
    scenario = score.scenario
    goals = any(score.missions)
    going = [
        tally
        for tally, mission in zip(score.tallies, score.missions, strict=True)
        if tally.alive and not tally.contact and (mission or not goals)
    ]
    if not going:
        return "stranded"
    arrivals = [tally.arrival_tick for tally in going if tally.arrival_tick is not None]
    if goals and len(arrivals) == len(going):
        limit_m = scenario.expect.formation_error_m_final
        rough = limit_m is not None and score.error_m is not None and score.error_m > limit_m
        linger_s = LINGER_S + PATIENCE_S if rough else LINGER_S
        if score.tick - max(arrivals) >= scenario.tick_of(linger_s):
            return "arrived"
    settled = [
        tally.failed_tick if tally.arrival_tick is None else tally.arrival_tick for tally in going
    ]
    known = [tick for tick in settled if tick is not None]
    if (
        goals
        and len(arrivals) < len(going) == len(known)
        and score.tick - max(known) >= scenario.tick_of(LINGER_S)
    ):
        return "blocked"
    if score.tick >= scenario.tick_of(scenario.duration_s):
        return "timeout" if goals else "duration"
    return None


def formation_error_now(score: Score, name: str) -> float | None:
    """Distance of a follower from its nominal slot at the newest tick, None for who has none."""
    tally = score.tallies[score.rows[name]]
    return tally.error_m if tally.follows else None


# --- one tick -----------------------------------------------------------------------------------

_TICK = struct.Struct("<q")
_ROBOT = struct.Struct("<?5d?2dI")  # alive, pose and twist, contact, set-point, beacon's bytes
_beacon_encoder = msgspec.msgpack.Encoder()


def _hash(score: Score, record: TickRecord) -> None:
    """The canonical stream: world states, set-points in force and published beacons, no more."""
    parts = [_TICK.pack(record.tick)]
    for robot in record.robots:
        pose, twist, applied = robot.pose, robot.twist, robot.applied
        beacon = b"" if robot.beacon is None else _beacon_encoder.encode(robot.beacon)
        parts.append(
            _ROBOT.pack(
                robot.alive,
                pose.x_m,
                pose.y_m,
                pose.yaw_rad,
                twist.speed_mps,
                twist.turn_rate_radps,
                robot.contact,
                applied.speed_mps,
                applied.turn_rate_radps,
                len(beacon),
            )
        )
        parts.append(beacon)
    score.hash.update(b"".join(parts))


def _observe_faults(score: Score, record: TickRecord) -> None:
    """Events first: who was alive until now tells a kill from a blow to the dead."""
    for event in record.events:
        score.faults_failed += event.kind == "fault-failed"
        if event.kind == "fault" and event.robot in score.rows:
            row = score.rows[event.robot]
            score.faults.append(Fault(event.fault, row, event.tick, event.number))
            if score.tallies[row].alive and event.fault in SILENCING:
                score.tallies[row].killed = True
        if event.kind == "fault-over" and event.robot in score.rows:
            for fault in score.faults:
                if (fault.number, fault.row) == (event.number, score.rows[event.robot]):
                    fault.over_tick = event.tick


def _observe_bodies(score: Score, robots: tuple[RobotRecord, ...]) -> None:
    """Ways, touches and waiting."""
    for tally, robot in zip(score.tallies, robots, strict=True):
        x_m, y_m = robot.pose.x_m, robot.pose.y_m
        if score.tick > 0:
            tally.path_m += geometry.length(x_m - tally.x_m, y_m - tally.y_m)
        tally.x_m, tally.y_m = x_m, y_m
        tally.alive, tally.contact = robot.alive, robot.contact
        tally.excused = robot.excused
        tally.killed &= not robot.alive
        if robot.alive and robot.obstacle_clearance_m < score.clearance_obstacle_m:
            score.clearance_obstacle_m = robot.obstacle_clearance_m
        yields_to = None
        if robot.alive and robot.beacon is not None:
            tally.mode, tally.reason = robot.beacon.mode, robot.beacon.reason
            if tally.mode != "FAILED":
                tally.failed_tick = None
            elif tally.failed_tick is None:
                tally.failed_tick = score.tick
            yields_to = robot.beacon.yields_to
        if yields_to is not None:
            tally.waiting_ticks += 1
            tally.yields += not tally.yielding
        tally.yielding = yields_to is not None
    for one, other in score.mirror_rows:
        a, b = score.tallies[one], score.tallies[other]
        off_m = max(abs(a.x_m - b.x_m), abs(a.y_m + b.y_m))
        score.symmetry_m = off_m if score.symmetry_m is None else max(score.symmetry_m, off_m)


def _observe_clearances(score: Score) -> None:
    """Nearest surfaces of any two robots of which one lives at least."""
    if len(score.firsts) == 0:
        return
    x_m = np.array([tally.x_m for tally in score.tallies])
    y_m = np.array([tally.y_m for tally in score.tallies])
    alive = np.array([tally.alive for tally in score.tallies])
    dx_m, dy_m = x_m[score.firsts] - x_m[score.seconds], y_m[score.firsts] - y_m[score.seconds]
    gaps_m = np.sqrt(dx_m * dx_m + dy_m * dy_m) - score.touching_m
    if not alive.all():
        gaps_m = gaps_m[alive[score.firsts] | alive[score.seconds]]
    score.clearance_robot_m = min(score.clearance_robot_m, float(gaps_m.min(initial=inf)))


def _observe_guards(score: Score, record: TickRecord) -> None:
    for command in record.commands:
        tally = score.tallies[score.rows[command.robot]]
        held_back = command.trace.limited_by != ""
        score.guard_interventions += held_back and not tally.held_back
        tally.held_back = held_back


def _observe_passages(score: Score, robots: tuple[RobotRecord, ...]) -> None:
    """Grants of passages, and those to two of opposite directions at once."""
    held = {
        row: robot.beacon.passage
        for row, robot in enumerate(robots)
        if robot.alive
        and robot.beacon is not None
        and robot.beacon.passage is not None
        and robot.beacon.passage.holds
    }
    if not held and not score.holders:
        return
    against = frozenset(
        (row, other)
        for row, mine in held.items()
        for other, theirs in held.items()
        if row < other and passages.same_line(mine, theirs.mouth, theirs.axis) < passages.OPPOSITE
    )
    score.grants += len(held.keys() - score.holders)
    score.double_grants += len(against - score.against)
    score.holders, score.against = frozenset(held), against


def _observe_leadership(score: Score, robots: tuple[RobotRecord, ...]) -> None:
    """Whether all live members of the formation follow one leader that lives, and which."""
    claims = {_followed(robots[row]) for row in score.members if robots[row].alive}
    claim = next(iter(claims), None)
    score.agreed = (
        len(claims) == 1
        and claim is not None
        and claim.name in score.rows
        and robots[score.rows[claim.name]].alive
    )
    if score.agreed and claim is not None and claim != score.leadership:
        score.leadership = claim
        score.leaders.append((score.tick, claim))


def _followed(robot: RobotRecord) -> Leadership | None:
    """Leadership that a live robot follows; one that it knows to be silent does not count."""
    beacon = robot.beacon
    if not robot.alive or beacon is None or beacon.leader_tick is None:
        return None
    return beacon.leadership


def _observe_recovery(score: Score, robots: tuple[RobotRecord, ...]) -> None:
    """A fault is detected once nobody follows the lost robot, and over when the rest is in order:
    one leader for all, and every follower near its slot.
    """
    led = {claim.name for claim in map(_followed, robots) if claim is not None}
    settled = score.agreed and (score.error_m is None or score.error_m <= SETTLED_M)
    for fault in score.faults:
        if fault.kind not in SILENCING:
            continue
        fault.lost |= not robots[fault.row].alive
        gone = fault.lost and score.scenario.robots[fault.row].name not in led
        if fault.detected_tick is None and gone:
            fault.detected_tick = score.tick
        if fault.recovered_tick is None and fault.detected_tick is not None and settled:
            fault.recovered_tick = score.tick


def _observe_errors(score: Score, robots: tuple[RobotRecord, ...]) -> None:
    """How far everybody is from where it should be, and who is there.

    A leader is measured by the goal it publishes, a follower by its slot; it is there when its
    leader is too. Who neither leads nor follows is measured by the goal it publishes, too, or by
    that of the scenario. While the leader it follows is dead there is nothing to measure it by.
    """
    scenario = score.scenario
    followers: list[tuple[int, RobotRecord, int]] = []
    for row, (setup, robot, tally) in enumerate(
        zip(scenario.robots, robots, score.tallies, strict=True)
    ):
        tally.follows = False
        if not robot.alive:
            continue
        beacon, goal = robot.beacon, setup.goal
        claim = None if beacon is None else beacon.leadership
        leader = None if claim is None else score.rows.get(claim.name)
        if beacon is not None and (leader == row or row not in score.members):
            goal = beacon.goal or goal
        slot = score.slots[row] if beacon is None else beacon.slot or score.slots[row]
        if leader is not None and leader != row and slot is not None:
            followers.append((row, robot, leader))
        elif goal is not None:
            _place(score, tally, goal, setup.goal_tolerance_m, robot.contact)
        else:
            tally.target, tally.error_m, tally.arrival_tick = None, None, None
    score.error_m = None
    for row, robot, leader in followers:
        tally, there = score.tallies[row], score.tallies[leader]
        target = _slot_m(robot.beacon, robots[leader], score.slots[row])
        if target is None or scenario.formation is None:
            tally.target, tally.error_m, tally.arrival_tick = None, None, None
            continue
        tally.follows = True
        without = robot.contact or there.arrival_tick is None
        error_m = _place(score, tally, target, scenario.formation.tolerance_m, without)
        score.error_m = error_m if score.error_m is None else max(score.error_m, error_m)
        if robot.beacon is not None and robot.beacon.mode == "AVOID":
            score.avoid_tick = score.tick
    if score.error_m is not None:
        score.error_m_max = max(score.error_m, score.error_m_max or 0.0)
        if score.error_m >= SETTLED_M:
            score.unsettled_tick = score.tick


def _place(
    score: Score, tally: Tally, target: Vec2, tolerance_m: float, cannot_arrive: bool
) -> float:
    """Distance to where a robot should be, written down; its stay goes on, begins or breaks."""
    tally.target = target
    tally.error_m = geometry.length(tally.x_m - target[0], tally.y_m - target[1])
    if cannot_arrive or tally.error_m > tolerance_m:
        tally.arrival_tick = None
    elif tally.arrival_tick is None:
        tally.arrival_tick = score.tick
    return tally.error_m


def _slot_m(beacon: Beacon | None, leader: RobotRecord, slot: Slot | None) -> Vec2 | None:
    """Where the nominal slot is, eq. 39: P_l - d e(alpha + theta_F); None without a live leader.

    The slot is the one that the follower publishes, which an election may have changed, and the
    scenario's until then; the bearing switch does not move it.
    """
    if not leader.alive or leader.beacon is None:
        return None
    if beacon is not None and beacon.slot is not None:
        slot = beacon.slot
    if slot is None:
        return None
    angle_rad = slot.bearing_rad + leader.beacon.formation_heading_rad
    return (
        leader.pose.x_m - slot.distance_m * cos(angle_rad),
        leader.pose.y_m - slot.distance_m * sin(angle_rad),
    )
