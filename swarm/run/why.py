"""What one robot saw, weighed and did at one moment, all of it from the recording.

    TickRecord ... --to the tick and a little beyond--> Why --explain--> text for a person

A robot tells in its Trace what it made of its frame, in its Beacon whom it follows and yields to;
the frame names what it heard. Numbers are as recorded: SI units, radians.
"""

from __future__ import annotations

from math import atan2, inf
from pathlib import Path

import msgspec

from swarm import errors, geometry, movers, recording, scenario
from swarm.geometry import Pose, Twist, Vec2
from swarm.messages import (
    Beacon,
    Command,
    Event,
    FrameRecord,
    Intent,
    Leadership,
    Passage,
    Slot,
    TickRecord,
)
from swarm.run.replay import Beacons, history_ticks, misfit
from swarm.scenario import Scenario

AROUND_S = 2.0  # events so near in time are told
FORCES = ("attractive", "repulsive", "rotating", "robots", "resultant")
GONE = ("fault", "robot-lost", "robot-hung", "robot-missing")  # why a robot is not there


class Sector(msgspec.Struct, frozen=True):
    """One occupied sector of the MSAM, or its nearest."""

    bearing_rad: float  # body frame, positive to the left
    range_m: float


class Arc(msgspec.Struct, frozen=True):
    """One virtual circle of the MSAM."""

    bearing_rad: float
    range_m: float
    width_rad: float
    weight: float


class Force(msgspec.Struct, frozen=True):
    """One term of eq. 38."""

    term: str
    x: float  # world frame
    y: float
    size: float
    angle_rad: float  # world frame
    bearing_rad: float  # from the robot's heading, positive to the left


class Tracking(msgspec.Struct, frozen=True):
    """How well a follower keeps its slot."""

    slot: Slot
    bearing_now_rad: float
    error_along_m: float
    error_across_rad: float
    gains: tuple[float, ...]  # P, I, D along, then across


class Heard(msgspec.Struct, frozen=True):
    """One message of a peer."""

    name: str
    tick: int
    age_ticks: int
    age_s: float
    mode: str
    distance_m: float  # from where the peer said that it was
    bearing_rad: float
    claim: tuple[int, ...]
    passes_first: bool  # its claim is better than this robot's
    yields_to: str | None
    passage: Passage | None  # that it claims or holds


class Passing(msgspec.Struct, frozen=True):
    """An obstacle that moved, as it truly was."""

    centre: Vec2  # world frame
    radius_m: float
    speed_mps: float
    gap_m: float  # between its surface and the body's
    bearing_rad: float


class Around(msgspec.Struct, frozen=True):
    """Something that happened about then."""

    tick: int
    time_s: float
    kind: str
    robot: str | None
    text: str


class Why(msgspec.Struct, frozen=True, kw_only=True):
    """Everything about one robot at one tick."""

    scenario: str
    robot: str
    tick: int
    time_s: float
    alive: bool
    incarnation: int
    contact: bool
    pose: Pose
    twist: Twist
    # What it saw: as it told, when it answered.
    sectors_m: tuple[float, ...]  # (sectors,) rear over right, ahead and left; inf where free
    occupied: tuple[Sector, ...]
    nearest: Sector | None
    passing: tuple[Passing, ...]  # within reach of its lidar, nearest first
    blind_beams: int  # of its lidar that showed no number
    arcs: tuple[Arc, ...]
    # What it made of it; all empty when it gave no answer.
    answered: bool
    mode: str
    reason: str
    arrived: bool
    forces: tuple[Force, ...]
    waypoint: Vec2 | None
    waypoint_distance_m: float | None
    waypoint_bearing_rad: float | None
    tracking: Tracking | None
    # Whom it heeded.
    claim: tuple[int, ...]
    yields_to: str | None
    passage: Passage | None  # that it claimed or held
    intent: Intent | None  # where it told that it wanted to go
    leadership: Leadership | None
    leader_age_s: float | None  # since the leader's newest sign of life, whoever passed it on
    fit: bool  # whether it would lead
    heard: tuple[Heard, ...]
    unheard: tuple[str, ...]  # peers that lived, and of which nothing came
    # What it did.
    speed_limit_mps: float | None
    limited_by: str
    commanded: Twist | None
    late_ticks: int  # after the frame until the command was there
    applied: Twist  # in force in this tick
    events: tuple[Around, ...]


def why(path: Path, name: str, time_s: float) -> Why:
    """Look a robot up at a simulation time.

    Raises:
        RecordingError: the recording cannot be read, or lacks that tick.
        UsageError: no such robot, a time outside the run, or the robot was dead then.
    """
    source = recording.read(path)
    plan = scenario.decode(source.scenario_toml, f"{path}: {recording.SCENARIO_NAME}")
    names = [row.name for row in plan.robots]
    if name not in names:
        raise errors.UsageError(f"NAME: expected one of {', '.join(names)}, got '{name}'")
    if not 0.0 <= time_s < inf:
        raise errors.UsageError(f"T: expected simulated seconds >= 0, got {time_s:g}")
    tick = round(time_s / plan.dt_s)
    moment = _find(source, plan, name, tick, f"{path}")
    if moment.frame is None:
        raise errors.UsageError(_gone(plan, moment, name))
    return _why(plan, moment, moment.frame, name)


class _Moment(msgspec.Struct):
    """The tick that is asked for, with what belongs to it from before and after."""

    record: TickRecord
    frame: FrameRecord | None
    heard: list[Beacon] = []
    command: Command | None = None  # the answer to that frame, even if it came later
    command_tick: int = 0
    events: list[Event] = []
    gone: list[Event] = []  # why the robot is not there, oldest first
    last_alive: int | None = None


def _find(source: recording.Recording, plan: Scenario, name: str, tick: int, where: str) -> _Moment:
    names = [row.name for row in plan.robots]
    row = names.index(name)
    around = round(AROUND_S / plan.dt_s)
    history = history_ticks(plan)
    beacons = Beacons(len(names), history)
    moment: _Moment | None = None
    earlier: list[Event] = []
    gone: list[Event] = []
    last = last_alive = None
    for record in source.ticks:
        if record.tick > tick + history or (
            record.tick > tick + around and moment is not None and moment.command is not None
        ):
            break
        if problem := misfit(plan, record):
            raise errors.RecordingError(f"{where}: tick {record.tick}: {problem}")
        last = record.tick
        near = [event for event in record.events if abs(event.tick - tick) <= around]
        if record.tick <= tick:
            earlier += near
            gone += [one for one in record.events if one.robot == name and one.kind in GONE]
            if record.tick < tick and record.robots[row].alive:
                last_alive = record.tick
        elif moment is not None:
            moment.events += near
        if record.tick == tick:
            frame = next((one for one in record.frames if one.row == row), None)
            moment = _Moment(record, frame, [], None, 0, earlier, gone, last_alive)
            if frame is not None:
                moment.heard = _known(beacons, frame)
        if moment is not None and moment.command is None:
            moment.command = next(
                (one for one in record.commands if (one.robot, one.tick) == (name, tick)), None
            )
            moment.command_tick = record.tick
        beacons.hear(record, names)
    if moment is None and last is not None and tick > last:
        raise errors.UsageError(
            f"T: expected seconds from 0 to {last * plan.dt_s:.2f}, when the recording ends, "
            f"got {tick * plan.dt_s:.2f}"
        )
    if moment is None:
        raise errors.RecordingError(
            f"{where}: expected tick {tick}, got none: the recording lacks it; see swarm verify"
        )
    return moment


def _known(beacons: Beacons, frame: FrameRecord) -> list[Beacon]:
    """What a frame brought, except what a damaged recording does not hold any more."""
    found = []
    for row, tick in frame.heard.numpy().tolist():
        try:
            found.append(beacons[row, tick])
        except LookupError:
            continue
    return found


def _gone(plan: Scenario, moment: _Moment, name: str) -> str:
    tick = moment.record.tick
    text = f"T: expected a time at which {name} lived, got {tick * plan.dt_s:.2f} s (tick {tick})"
    if moment.gone:
        event = moment.gone[-1]
        text += f": {event.kind} at {event.tick * plan.dt_s:.2f} s: {event.text}"
    if moment.last_alive is None:
        return f"{text}; it had not lived before"
    return (
        f"{text}; the last one before is {moment.last_alive * plan.dt_s:.2f} s "
        f"(tick {moment.last_alive})"
    )


# --- putting it together ------------------------------------------------------------------------


def _why(plan: Scenario, moment: _Moment, frame: FrameRecord, name: str) -> Why:
    record, command = moment.record, moment.command
    truth = record.robots[frame.row]
    beacon = truth.beacon if command is None else command.beacon
    trace = None if command is None else command.trace
    pose = frame.pose
    sectors_m = () if trace is None else tuple(float(one) for one in trace.sectors.numpy().tolist())
    occupied = tuple(
        Sector(bearing_rad, range_m)
        for bearing_rad, range_m in zip(
            geometry.sector_centres(max(1, len(sectors_m))), sectors_m, strict=False
        )
        if range_m < inf
    )
    waypoint = None if trace is None else trace.waypoint
    claim = () if beacon is None else beacon.priority
    heard = _heard(plan, moment, pose, claim)
    there = {one.name for one in heard}
    return Why(
        scenario=plan.title,
        robot=name,
        tick=record.tick,
        time_s=record.tick * plan.dt_s,
        alive=truth.alive,
        incarnation=0 if beacon is None else beacon.incarnation,
        contact=frame.contact,
        pose=pose,
        twist=frame.twist,
        sectors_m=sectors_m,
        occupied=occupied,
        nearest=min(occupied, key=lambda one: one.range_m, default=None),
        passing=_passing(plan, record, frame.row),
        blind_beams=int((frame.ranges.numpy() != frame.ranges.numpy()).sum()),
        arcs=()
        if trace is None
        else tuple(
            Arc(*(getattr(one, key) for key in Arc.__struct_fields__)) for one in trace.arcs
        ),
        answered=command is not None,
        mode="" if beacon is None else beacon.mode,
        reason="" if beacon is None else beacon.reason,
        arrived=beacon is not None and beacon.arrived,
        forces=()
        if trace is None
        else tuple(_force(term, getattr(trace.forces, term), pose) for term in FORCES),
        waypoint=waypoint,
        waypoint_distance_m=None
        if waypoint is None
        else geometry.length(waypoint[0] - pose.x_m, waypoint[1] - pose.y_m),
        waypoint_bearing_rad=None if waypoint is None else _bearing(pose, waypoint),
        tracking=None
        if trace is None or beacon is None or beacon.slot is None
        else Tracking(beacon.slot, beacon.bearing_now_rad, *trace.error, trace.gains),
        claim=claim,
        yields_to=None if beacon is None else beacon.yields_to,
        passage=None if beacon is None else beacon.passage,
        intent=None if beacon is None else beacon.intent,
        leadership=None if beacon is None else beacon.leadership,
        leader_age_s=None
        if beacon is None or beacon.leader_tick is None
        else (record.tick - beacon.leader_tick) * plan.dt_s,
        fit=beacon is not None and beacon.fit,
        heard=heard,
        unheard=tuple(
            robot.name
            for robot, other in zip(plan.robots, record.robots, strict=True)
            if other.alive and robot.name not in there and robot.name != name
        ),
        speed_limit_mps=None if trace is None else trace.speed_limit_mps,
        limited_by="" if trace is None else trace.limited_by,
        commanded=None if command is None else command.set_point,
        late_ticks=0 if command is None else moment.command_tick - record.tick,
        applied=truth.applied,
        events=tuple(
            Around(one.tick, one.tick * plan.dt_s, one.kind, one.robot, one.text)
            for one in moment.events
        ),
    )


def _passing(plan: Scenario, record: TickRecord, row: int) -> tuple[Passing, ...]:
    pose, radius_m = record.robots[row].pose, plan.robots[row].body_radius_m
    found = []
    for mover in movers.moving(plan.obstacles):
        centre = movers.place(mover, record.tick * plan.dt_s)
        distance_m = geometry.length(centre[0] - pose.x_m, centre[1] - pose.y_m)
        if distance_m - mover.radius_m <= plan.sensor.range_m:
            found.append(
                Passing(
                    centre,
                    mover.radius_m,
                    mover.speed_mps,
                    distance_m - mover.radius_m - radius_m,
                    _bearing(pose, centre),
                )
            )
    return tuple(sorted(found, key=lambda one: one.gap_m))


def _heard(
    plan: Scenario, moment: _Moment, pose: Pose, claim: tuple[int, ...]
) -> tuple[Heard, ...]:
    tick = moment.record.tick
    return tuple(
        Heard(
            name=one.name,
            tick=one.tick,
            age_ticks=tick - one.tick,
            age_s=(tick - one.tick) * plan.dt_s,
            mode=one.mode,
            distance_m=geometry.distance(pose, one.pose),
            bearing_rad=_bearing(pose, (one.pose.x_m, one.pose.y_m)),
            claim=one.priority,
            passes_first=one.priority < claim,
            yields_to=one.yields_to,
            passage=one.passage,
        )
        for one in moment.heard
    )


def _force(term: str, force: Vec2, pose: Pose) -> Force:
    x, y = force
    angle_rad = atan2(y, x)
    bearing_rad = geometry.wrap_angle(angle_rad - pose.yaw_rad)
    return Force(term, x, y, geometry.length(x, y), angle_rad, bearing_rad)


def _bearing(pose: Pose, point: Vec2) -> float:
    return geometry.wrap_angle(geometry.bearing(pose, point[0], point[1]) - pose.yaw_rad)
