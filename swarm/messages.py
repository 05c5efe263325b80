"""Who says what to whom: every message of the swarm, then the one table of topics.

    world --frame--> robot --command--> world        every tick, nothing may be lost
    world --event, status--> whoever watches         when it happens; twice a second
    robot ?scenario world    anyone ?control world    world ?process supervisor

A key is written nowhere else. On the wire a message is msgpack: structs as arrays, numeric arrays
as raw little-endian bytes with dtype and shape. Every message carries its tick and `stamp_ns`
(simulation time) and the names of those it concerns, so nobody parses keys.
"""

from __future__ import annotations

import functools
import re
import struct
from collections.abc import Sequence
from math import prod
from typing import Annotated, Any, Literal

import msgspec
import numpy as np
import numpy.typing as npt

from swarm import errors
from swarm.geometry import Finite, Pose, Ranges, Twist, Vec2

Name = Annotated[str, msgspec.Meta(pattern=r"^[a-z][a-z0-9_-]{0,31}\Z")]
RunId = Annotated[str, msgspec.Meta(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,95}\Z")]
Tick = Annotated[int, msgspec.Meta(ge=0, le=2**40)]
Coordinate = Annotated[float, msgspec.Meta(ge=-1e6, le=1e6)]
Goal = tuple[Coordinate, Coordinate]  # x_m, y_m in the world, as a person gives it
Stamp = Annotated[int, msgspec.Meta(ge=0, le=2**62)]

# ROUND is of recordings made before there were ways by memory only.
Mode = Literal["GO", "ROUND", "FORM", "AVOID", "ARRIVED", "HOLD", "FAILED"]
# Why a robot says FAILED or HOLD: it touched something; its sensors cannot be trusted; its motors
# do not follow; it walked round all that is between it and its goal, both ways; it tried for too
# long; its leader has failed; its way is closed, where its pose says.
Reason = Literal["", "contact", "sensors", "motors", "enclosed", "too-long", "leader", "blocked"]


# Of an array. Where one side is 0 the others could be anything, and numpy does not take that.
SIDES_MAX = 3
SIDE_MAX = 65_536


# --- pieces -------------------------------------------------------------------------------------


_TYPES: dict[str, np.dtype[Any]] = {name: np.dtype(name) for name in ("<f4", "<f8", "<i4")}


class Array(msgspec.Struct, frozen=True, array_like=True):
    """A numeric array as raw little-endian bytes; raises ValueError when the size does not fit."""

    dtype: Literal["<f4", "<f8", "<i4"]
    shape: tuple[int, ...]
    data: bytes

    def __post_init__(self) -> None:
        sides = self.shape
        expected = (sides[0] if len(sides) == 1 else prod(sides)) * (
            8 if self.dtype == "<f8" else 4
        )
        if len(self.data) != expected:
            raise ValueError(
                f"expected {expected} bytes for shape {self.shape} of {self.dtype}, "
                f"got {len(self.data)}"
            )
        if len(sides) > SIDES_MAX or (sides and not 0 <= min(sides) <= max(sides) <= SIDE_MAX):
            raise ValueError(
                f"expected at most {SIDES_MAX} sides of 0 to {SIDE_MAX}, got {self.shape}"
            )

    def numpy(self) -> npt.NDArray[Any]:
        """Read-only view of the bytes."""
        return np.ndarray(self.shape, _TYPES[self.dtype], self.data)


def array(values: npt.NDArray[Any]) -> Array:
    """Wire form of a float32, float64 or int32 array."""
    little = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<"))
    return Array(little.dtype.str, little.shape, little.tobytes())  # type: ignore[arg-type]


def floats(values: Sequence[float]) -> Array:
    """Wire form of a few numbers as float32; four times as fast as by way of numpy."""
    return Array("<f4", (len(values),), _packer(len(values)).pack(*values))


@functools.lru_cache(maxsize=32)
def _packer(count: int) -> struct.Struct:
    """Of so many float32."""
    return struct.Struct(f"<{count}f")


class Wheels(msgspec.Struct, frozen=True, array_like=True):
    """Rim speeds of the two wheels, the (v_r, v_l) of eq. 1 and 2."""

    right_mps: Finite
    left_mps: Finite


class Slot(msgspec.Struct, frozen=True, array_like=True):
    """Place in a formation, eq. 39: behind the leader at `bearing_rad`, positive to its right."""

    distance_m: Finite
    bearing_rad: Finite


class Leadership(msgspec.Struct, frozen=True, array_like=True):
    """A claim to lead: higher term first, then the better (smaller) priority key, then the name."""

    term: Annotated[int, msgspec.Meta(ge=0, le=2**40)]
    key: tuple[int, int, int, int]
    name: Name


def leadership_order(leadership: Leadership) -> tuple[int, tuple[int, int, int, int], str]:
    """Sorting key of leaderships, the highest first: later term, better claim, name."""
    return (-leadership.term, leadership.key, leadership.name)


class Promise(msgspec.Struct, frozen=True, array_like=True):
    """How its sender comes to rest if it is told nothing more: exactly so, from pose and twist.

    It goes on with the beacon's twist for one tick, then brakes, on that curve as far as its motors
    can. The promises of two never come nearer to each other than the sum of their `keep_m`. With
    late motors all that begins after the twists under way, one a tick.
    """

    deceleration_mps2: Annotated[float, msgspec.Meta(gt=0.0, le=1e6)]
    turn_deceleration_radps2: Annotated[float, msgspec.Meta(gt=0.0, le=1e6)]
    keep_m: Annotated[float, msgspec.Meta(gt=0.0, le=1e6)]  # body radius and what is not exact
    pending: Annotated[tuple[Twist, ...], msgspec.Meta(max_length=8)] = ()  # before the beacon's


class Intent(msgspec.Struct, frozen=True, array_like=True):
    """Where its sender wants to go, so that others can choose how to pass."""

    velocity: Vec2 = (0.0, 0.0)  # m/s, world: chosen for now, whatever the guards left of it
    target: Vec2 | None = None  # world, next point on its way; None: nowhere
    active: bool = False  # on its way there: neither waits nor is parked


class Passage(msgspec.Struct, frozen=True, array_like=True):
    """Claim to a gap in which two cannot pass each other."""

    holds: bool  # it goes through; else it wants to
    mouth: Vec2  # m, world: middle of the gap
    axis: Vec2  # unit vector, world: the way through, in the sender's direction
    since: Tick  # of the claim; the older one goes first


class Beacon(msgspec.Struct, frozen=True, array_like=True):
    """What a robot tells its peers about itself; the only thing they ever know of it.

    `priority` is the claim of eq. 65 and 66 in rounded integers, smaller passes first. Everybody in
    a formation passes on the highest leadership, the newest sign of life of its leader, and where
    the formation goes; so these reach whoever does not hear the leader. The formation heading
    theta_F and its rate are those of a leader, zero otherwise.
    """

    name: Name
    tick: Tick
    incarnation: Annotated[int, msgspec.Meta(ge=0, le=2**31)]
    pose: Pose
    twist: Twist  # from this tick to the next: the set-point
    body_radius_m: Annotated[float, msgspec.Meta(gt=0.0, le=100.0)]
    speed_mps_max: Annotated[float, msgspec.Meta(gt=0.0, le=100.0)]
    mode: Mode
    arrived: bool
    priority: tuple[int, int, int, int]
    slot: Slot | None = None
    bearing_now_rad: Finite = 0.0  # alpha_now, the slot's bearing after the bearing switch
    leadership: Leadership | None = None  # the highest this robot knows; its own when it leads
    leader_tick: Tick | None = None  # newest at which that leader led; None: silent for too long
    fit: bool = False  # whether it would lead
    assignments: tuple[tuple[Name, Slot], ...] = ()  # of a leader: slots that are to change
    goal: Vec2 | None = None
    via: tuple[Vec2, ...] = ()  # way-points still ahead, before the goal
    formation_heading_rad: Finite = 0.0
    formation_turn_rate_radps: Finite = 0.0
    yields_to: Name | None = None
    reason: Reason = ""  # of FAILED and HOLD
    promise: Promise | None = None  # None: its guard knows nothing of promises
    intent: Intent | None = None
    passage: Passage | None = None


class Arc(msgspec.Struct, frozen=True, array_like=True):
    """One virtual circle of the MSAM (eq. 19 to 21): a run of occupied cells, body frame."""

    bearing_rad: Finite
    range_m: Finite  # r_o, inner edge of the nearest cell
    width_rad: Finite
    weight: Finite


class Forces(msgspec.Struct, frozen=True, array_like=True):
    """The terms of eq. 38, world frame."""

    attractive: Vec2 = (0.0, 0.0)
    repulsive: Vec2 = (0.0, 0.0)
    rotating: Vec2 = (0.0, 0.0)
    robots: Vec2 = (0.0, 0.0)
    resultant: Vec2 = (0.0, 0.0)


class Trace(msgspec.Struct, frozen=True, array_like=True):
    """Why a robot did what it did: what it saw, what it added up, what held it back."""

    sectors: Array  # (sectors,) float32 m, body frame, inf where free: the MSAM after quantising
    arcs: tuple[Arc, ...] = ()
    forces: Forces = Forces()
    waypoint: Vec2 | None = None  # world frame, what it steered for
    gains: tuple[Finite, Finite, Finite, Finite, Finite, Finite] = (0.0,) * 6
    error: Vec2 = (0.0, 0.0)  # e of eq. 47: m, rad
    speed_limit_mps: Finite = 0.0  # what braking guard and peer guard allowed
    limited_by: str = ""  # "" | "brake" | the peer's name

    def __post_init__(self) -> None:
        if self.sectors.dtype != "<f4" or len(self.sectors.shape) != 1:
            raise ValueError(f"expected sectors as (sectors,) of <f4, got {self.sectors.dtype}")


# --- what travels -------------------------------------------------------------------------------


class SensorFrame(msgspec.Struct, frozen=True, array_like=True):
    """All that one robot senses and hears at one tick."""

    robot: Name
    tick: Tick
    stamp_ns: Stamp
    pose: Pose
    twist: Twist
    wheels: Wheels
    contact: bool
    ranges: (
        Array  # (beams,) float32 m; beam k looks to geometry.sector_centres(beams)[k]; inf: miss,
        # NaN: nothing is known there, as in REP 117
    )
    beacons: tuple[Beacon, ...] = ()  # those audible, normally of the tick before
    goal: Goal | None = None  # an order, from now on: go there instead

    def __post_init__(self) -> None:
        if self.ranges.dtype != "<f4" or len(self.ranges.shape) != 1:
            raise ValueError(f"expected ranges as (beams,) of <f4, got {self.ranges.dtype}")
        if (self.ranges.numpy() < 0.0).any():
            raise ValueError("expected ranges >= 0, inf or NaN")

    def ranges_m(self) -> Ranges:
        """(beams,) float32, read-only."""
        return self.ranges.numpy()


class Command(msgspec.Struct, frozen=True, array_like=True):
    """A robot's answer to the frame of the same tick."""

    robot: Name
    tick: Tick
    stamp_ns: Stamp
    set_point: Twist
    beacon: Beacon
    trace: Trace


EventKind = Literal[
    "start",
    "robot-started",
    "robot-missing",
    "robot-lost",
    "robot-hung",
    "robot-returned",
    "fault",
    "fault-over",
    "fault-failed",
    "world-resumed",
    "collision",
    "message-rejected",
    "recording",
    "control",
    "end",
]


Level = Literal["info", "warn", "error"]
_LEVELS: dict[EventKind, Level] = {
    "fault": "warn",
    "fault-failed": "error",
    "world-resumed": "warn",
    "robot-missing": "error",
    "robot-lost": "warn",
    "robot-hung": "warn",
    "collision": "error",
    "message-rejected": "warn",
    "recording": "error",
}


def level_of(kind: EventKind) -> Level:
    """How bad it is."""
    return _LEVELS.get(kind, "info")


class Event(msgspec.Struct, frozen=True, array_like=True):
    """Something worth telling a person, and replay.

    `robot-started` with an incarnation above 0 tells that the robot begins again, remembering
    nothing. What one fault does to several robots is an event for each, with the same number.
    """

    tick: Tick
    stamp_ns: Stamp
    kind: EventKind
    robot: Name | None = None
    text: str = ""
    incarnation: int = 0
    fault: str = ""  # kind, of the events about faults
    number: int = -1  # of the fault in this run


# What the world makes of a robot. Neither waited for nor sent anything: those that are lost (its
# token has gone), hung (it does not answer), killed (by a fault), restarting, missing (never came).
RobotState = Literal[
    "starting", "running", "collided", "lost", "hung", "killed", "restarting", "missing"
]


class RobotStatus(msgspec.Struct, frozen=True):
    """One row of `swarm status`."""

    name: Name
    state: RobotState
    mode: str
    leader: str
    arrived: bool
    late_commands: int
    error_m: float | None
    reason: str = ""  # why it says FAILED
    restarts: int = 0
    heard: int = 0  # peers whose beacons were in its newest frame
    yields_to: str = ""
    commands_per_s: float = 0.0  # wall, since the status before
    command_age_s: float | None = None  # wall, since its newest command; None before the first
    unanswered: int = 0  # ticks from the newest frame that it answered to the newest it was sent


class Status(msgspec.Struct, frozen=True):
    """The world's own account of the run."""

    run: RunId
    scenario: str
    tick: Tick
    stamp_ns: Stamp
    clock: Literal["lockstep", "realtime"]
    state: Literal["starting", "running", "paused", "ended"]
    duration_s: float  # simulation time at which the run times out
    real_time_factor: float  # over all of it, pauses left out
    robots: tuple[RobotStatus, ...]
    rejected_messages: int = 0
    rate: float = 0.0  # x real time that is kept to; 0: as fast as it goes
    real_time_factor_now: float = 0.0  # since the status before


class ScenarioRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A robot asks for what it needs to know."""

    robot: Name


class ControlRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The command line asks something of the world."""

    action: Literal["status", "stop", "fault", "pause", "resume", "step", "rate", "goal", "select"]
    spec: Annotated[str, msgspec.Meta(max_length=2000)] = ""  # of the fault; without @ it is now
    count: Annotated[int, msgspec.Meta(ge=1, le=10**9)] = 1  # ticks of `step`, then it pauses
    rate: Annotated[float, msgspec.Meta(ge=0.0, le=1000.0)] = 0.0  # x real time; 0: no limit
    robot: str = ""  # of `goal` and `select`; `leader` is whoever leads
    goal: Goal = (0.0, 0.0)


ProcessAction = Literal["kill", "stop", "continue", "start", "inspect"]


class ProcessRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The world asks the supervisor to do something to a process, exactly now.

    The answer comes when it is done: kill, when the process is gone; stop and continue, when the
    signal has its effect; start, when the new process runs (it says itself when it is ready).
    `inspect` answers with a text that begins with dead, stopped or running.
    """

    robot: Name  # or `world`, which can only be killed
    action: ProcessAction
    incarnation: Annotated[int, msgspec.Meta(ge=0, le=2**31)] = 0  # of the one to start


class Reply(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What every query returns; `body` is the msgpack of what was asked for."""

    ok: bool
    text: str = ""
    body: bytes = b""


# --- what the recording keeps -------------------------------------------------------------------


class RobotRecord(msgspec.Struct, frozen=True, array_like=True):
    """The truth about one robot at one tick, with the set-point its command asked for."""

    alive: bool
    contact: bool
    pose: Pose
    twist: Twist
    applied: Twist  # the set-point of this tick's command, zero when there is none in force
    beacon: Beacon | None  # newest it published, this tick's included; None before its first
    obstacle_clearance_m: float  # body surface to the nearest obstacle's; inf without obstacles
    excused: bool = False  # the contact: motors or a lidar with a fault, its own or the other's


class FrameRecord(msgspec.Struct, frozen=True, array_like=True):
    """A SensorFrame whose beacons are named by (robot's row, tick) instead of repeated."""

    row: int
    pose: Pose
    twist: Twist
    wheels: Wheels
    contact: bool
    ranges: Array
    heard: Array  # (beacons, 2) int32: row of the speaker, tick of its beacon
    goal: Goal | None = None

    def __post_init__(self) -> None:
        if self.ranges.dtype != "<f4" or len(self.ranges.shape) != 1:
            raise ValueError(f"expected ranges as (beams,) of <f4, got {self.ranges.dtype}")
        if self.heard.dtype != "<i4" or self.heard.shape[1:] != (2,):
            raise ValueError(f"expected heard as (beacons, 2) of <i4, got {self.heard.shape}")


class TickRecord(msgspec.Struct, frozen=True, array_like=True):
    """One whole tick, lossless: what was so, what was sensed, what was answered, what happened.

    Order within tick k: integrate, contacts, faults due, raycast, frames(k), commands(k).
    `commands` are those that arrived in this tick; each names the frame it answers.
    """

    tick: Tick
    stamp_ns: Stamp
    robots: tuple[RobotRecord, ...]  # in scenario order
    frames: tuple[FrameRecord, ...]  # of the live robots
    commands: tuple[Command, ...]
    events: tuple[Event, ...] = ()


# --- the table ----------------------------------------------------------------------------------


class Topic(msgspec.Struct, frozen=True):
    """A stream of messages of one type."""

    name: str
    key: str  # {run} and {robot} are filled in
    type: Any
    sender: Literal["world", "robot"]
    delivery: Literal["block", "drop"]  # block: never lost, may wait; drop: never waits, may lose
    size_max: int  # bytes
    rate_hz: float | None = None  # None: once a tick, or when it happens
    recorded: bool = False  # counted by the recording as expected / received / written


class Query(msgspec.Struct, frozen=True):
    """A question with exactly one answer."""

    name: str
    key: str
    type: Any
    answered_by: Literal["world", "supervisor"]
    size_max: int = 4096


FRAME = Topic(
    "frame", "swarm/{run}/robot/{robot}/frame", SensorFrame, "world", "block", 262_144, None, True
)
COMMAND = Topic(
    "command", "swarm/{run}/robot/{robot}/command", Command, "robot", "block", 65_536, None, True
)
EVENT = Topic("event", "swarm/{run}/event", Event, "world", "drop", 4096, None, True)
STATUS = Topic("status", "swarm/{run}/status", Status, "world", "drop", 262_144, 2.0)
TOPICS = {topic.name: topic for topic in (FRAME, COMMAND, EVENT, STATUS)}

SCENARIO = Query("scenario", "swarm/{run}/scenario", ScenarioRequest, "world")
CONTROL = Query("control", "swarm/{run}/control", ControlRequest, "world")
PROCESS = Query("process", "swarm/{run}/process", ProcessRequest, "supervisor")
QUERIES = {query.name: query for query in (SCENARIO, CONTROL, PROCESS)}

Role = Literal["world", "robot", "supervisor"]
ALIVE_KEY = "swarm/{run}/alive/{role}/{name}"
_ALIVE = re.compile(r"^swarm/[^/]+/alive/(world|robot|supervisor)/([^/]+)\Z")

_encoder = msgspec.msgpack.Encoder()
_rows: list[Topic | Query] = [*TOPICS.values(), *QUERIES.values()]
_decoders = {row.name: msgspec.msgpack.Decoder(row.type) for row in _rows}
_reply_decoder = msgspec.msgpack.Decoder(Reply)


@functools.lru_cache(maxsize=4096)
def key(row: Topic | Query, run: str, robot: str = "*") -> str:
    """Key of a topic or query; `robot` is `*` for all of them."""
    return row.key.format(run=run, robot=robot)


def alive_key(run: str, role: str = "*", name: str = "*") -> str:
    """Key of a liveliness token."""
    return ALIVE_KEY.format(run=run, role=role, name=name)


def token_name(robot: str, incarnation: int) -> str:
    """Name in a robot's liveliness token; each process of it has its own."""
    return robot if incarnation == 0 else f"{robot}.{incarnation}"


def parse_alive_key(text: str) -> tuple[str, str] | None:
    """(role, name) of a liveliness key, None when it is not one."""
    match = _ALIVE.match(text)
    return None if match is None else (match[1], match[2])


def encode(message: msgspec.Struct) -> bytes:
    """msgpack of any message."""
    return _encoder.encode(message)


def decode(row: Topic | Query, payload: bytes) -> Any:
    """Message of a topic or query; raises MessageError for anything that is not exactly one."""
    if len(payload) > row.size_max:
        raise errors.MessageError(
            f"{row.name}: expected at most {row.size_max} bytes, got {len(payload)}"
        )
    try:
        return _decoders[row.name].decode(payload)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError, ValueError) as error:
        raise errors.MessageError(f"{row.name}: {error}") from error


def decode_reply(payload: bytes) -> Reply:
    """Answer to a query; raises MessageError."""
    try:
        return _reply_decoder.decode(payload)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError, ValueError) as error:
        raise errors.MessageError(f"reply: {error}") from error
