"""The tables that a run is exported as: every column with its type, its unit and what it means.

    TickRecord --rows of a Table--> tuples, in the order of its columns

Angles are counter-clockwise from +x, in [-pi, pi). What does not apply is null.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import msgspec
import pyarrow as pa

from swarm.geometry import Pose, Twist, Vec2
from swarm.messages import Beacon, TickRecord
from swarm.scenario import Scenario

Row = tuple[Any, ...]


class Column(msgspec.Struct, frozen=True):
    """One column."""

    name: str
    type: Any  # of pyarrow
    unit: str  # "" for names, numbers and flags
    text: str


class Table(msgspec.Struct, frozen=True):
    """One kind of thing, a row each."""

    name: str
    text: str
    columns: tuple[Column, ...]
    rows: Callable[[Scenario, TickRecord], Iterator[Row]]


def _c(name: str, type_: Any, unit: str, text: str) -> Column:
    return Column(name, type_, unit, text)


INTEGER, NUMBER, TEXT, FLAG = pa.int64(), pa.float64(), pa.string(), pa.bool_()

_WHEN = (
    _c("tick", INTEGER, "", "number of the tick"),
    _c("time_s", NUMBER, "s", "simulation time of that tick"),
)
_ROBOT = _c("robot", TEXT, "", "name of the robot")
_POSE = (
    _c("x_m", NUMBER, "m", "position of the centre, world frame"),
    _c("y_m", NUMBER, "m", "position of the centre, world frame"),
    _c("yaw_rad", NUMBER, "rad", "heading"),
)
_TWIST = (
    _c("speed_mps", NUMBER, "m/s", "speed along the heading"),
    _c("turn_rate_radps", NUMBER, "rad/s", "turn rate"),
)


def _pose(pose: Pose) -> Row:
    return pose.x_m, pose.y_m, pose.yaw_rad


def _twist(twist: Twist) -> Row:
    return twist.speed_mps, twist.turn_rate_radps


def _point(point: Vec2 | None) -> Row:
    return (None, None) if point is None else (point[0], point[1])


def _when(record: TickRecord) -> Row:
    return record.tick, record.stamp_ns / 1e9


# --- the truth ----------------------------------------------------------------------------------


def _robots(scenario: Scenario, record: TickRecord) -> Iterator[Row]:
    when = _when(record)
    for setup, robot in zip(scenario.robots, record.robots, strict=True):
        yield (
            *when,
            setup.name,
            robot.alive,
            robot.contact,
            robot.excused,
            *_pose(robot.pose),
            *_twist(robot.twist),
            *_twist(robot.applied),
            robot.obstacle_clearance_m,
        )


ROBOTS = Table(
    "robots",
    "The truth about every robot at every tick.",
    (
        *_WHEN,
        _ROBOT,
        _c("alive", FLAG, "", "whether it takes part: neither killed, lost nor hung"),
        _c("contact", FLAG, "", "whether its body has touched something"),
        _c("contact_excused", FLAG, "", "that contact is owed to a fault of motors or lidar"),
        *_POSE,
        *_TWIST,
        _c("applied_speed_mps", NUMBER, "m/s", "set-point in force in this tick; 0 when none is"),
        _c("applied_turn_rate_radps", NUMBER, "rad/s", "the same of the turn rate"),
        _c(
            "obstacle_clearance_m",
            NUMBER,
            "m",
            "from its surface to the nearest obstacle's; inf without obstacles",
        ),
    ),
    _robots,
)


# --- what was sensed ----------------------------------------------------------------------------


def _frames(scenario: Scenario, record: TickRecord) -> Iterator[Row]:
    when = _when(record)
    for frame in record.frames:
        yield (
            *when,
            scenario.robots[frame.row].name,
            *_pose(frame.pose),
            *_twist(frame.twist),
            frame.wheels.right_mps,
            frame.wheels.left_mps,
            frame.contact,
            frame.ranges.numpy(),
        )


FRAMES = Table(
    "frames",
    "What each live robot sensed at every tick.",
    (
        *_WHEN,
        _ROBOT,
        *_POSE,
        *_TWIST,
        _c("wheel_right_mps", NUMBER, "m/s", "rim speed of the right wheel"),
        _c("wheel_left_mps", NUMBER, "m/s", "rim speed of the left wheel"),
        _c("contact", FLAG, "", "whether its bumper says that it touched something"),
        _c(
            "ranges_m",
            pa.list_(pa.float32()),
            "m",
            "lidar, beams at equal angles from -pi (rear) counter-clockwise, half a step in; inf: "
            "a miss; NaN: no reading. In CSV: joined by blanks",
        ),
    ),
    _frames,
)


def _heard(scenario: Scenario, record: TickRecord) -> Iterator[Row]:
    when = _when(record)
    for frame in record.frames:
        listener = scenario.robots[frame.row].name
        for row, tick in frame.heard.numpy().tolist():
            yield (*when, listener, scenario.robots[row].name, tick)


HEARD = Table(
    "heard",
    "Which beacons reached whom: one row for each beacon in each frame.",
    (
        *_WHEN,
        _ROBOT,
        _c("speaker", TEXT, "", "name of the robot whose beacon it is"),
        _c("beacon_tick", INTEGER, "", "tick of that beacon, a key into `beacons`"),
    ),
    _heard,
)


# --- what was answered --------------------------------------------------------------------------

_TERMS = ("attractive", "repulsive", "rotating", "robots", "resultant")
_GAINS = ("kp_distance", "ki_distance", "kd_distance", "kp_bearing", "ki_bearing", "kd_bearing")


def _commands(scenario: Scenario, record: TickRecord) -> Iterator[Row]:
    when = _when(record)
    for command in record.commands:
        trace = command.trace
        yield (
            *when,
            command.robot,
            command.beacon.incarnation,
            command.tick,
            record.tick - command.tick,
            *_twist(command.set_point),
            *(part for term in _TERMS for part in getattr(trace.forces, term)),
            *_point(trace.waypoint),
            *trace.gains,
            *trace.error,
            trace.speed_limit_mps,
            trace.limited_by,
        )


COMMANDS = Table(
    "commands",
    "Every command, in the tick in which it came, with why the robot gave it.",
    (
        *_WHEN,
        _ROBOT,
        _c("incarnation", INTEGER, "", "how often its process had been started again"),
        _c("frame_tick", INTEGER, "", "tick of the frame that it answers"),
        _c("late_ticks", INTEGER, "ticks", "how much later than that frame it came"),
        _c("speed_mps", NUMBER, "m/s", "set-point"),
        _c("turn_rate_radps", NUMBER, "rad/s", "set-point"),
        *(
            _c(f"force_{term}_{axis}", NUMBER, "1", f"{term} term of eq. 38, world frame")
            for term in _TERMS
            for axis in "xy"
        ),
        _c("waypoint_x_m", NUMBER, "m", "what it steered for, world frame"),
        _c("waypoint_y_m", NUMBER, "m", "what it steered for, world frame"),
        *(_c(gain, NUMBER, "1", "gain of the tracking controller") for gain in _GAINS),
        _c("error_distance_m", NUMBER, "m", "e of eq. 47, as the robot sees it"),
        _c("error_bearing_rad", NUMBER, "rad", "e of eq. 47, as the robot sees it"),
        _c("speed_limit_mps", NUMBER, "m/s", "what its guards allowed"),
        _c("limited_by", TEXT, "", "which guard held it: empty, `brake`, or a peer's name"),
    ),
    _commands,
)


def _beacons(scenario: Scenario, record: TickRecord) -> Iterator[Row]:
    for command in record.commands:
        beacon: Beacon = command.beacon
        slot, leadership = beacon.slot, beacon.leadership
        yield (
            beacon.tick,
            scenario.stamp_ns(beacon.tick) / 1e9,
            beacon.name,
            beacon.incarnation,
            record.tick,
            *_pose(beacon.pose),
            *_twist(beacon.twist),
            beacon.mode,
            beacon.reason,
            beacon.arrived,
            *beacon.priority,
            *((None, None) if slot is None else (slot.distance_m, slot.bearing_rad)),
            beacon.bearing_now_rad,
            *((None, None) if leadership is None else (leadership.name, leadership.term)),
            beacon.leader_tick,
            beacon.fit,
            *_point(beacon.goal),
            len(beacon.via),
            beacon.formation_heading_rad,
            beacon.formation_turn_rate_radps,
            beacon.yields_to,
        )


BEACONS = Table(
    "beacons",
    "What each robot told its peers about itself.",
    (
        _c("tick", INTEGER, "", "tick of the beacon"),
        _c("time_s", NUMBER, "s", "simulation time of that tick"),
        _ROBOT,
        _c("incarnation", INTEGER, "", "how often its process had been started again"),
        _c("came_tick", INTEGER, "", "tick in which the world had it"),
        *_POSE,
        *_TWIST,
        _c("mode", TEXT, "", "GO, ROUND, FORM, AVOID, ARRIVED, HOLD or FAILED"),
        _c("reason", TEXT, "", "why, of FAILED and HOLD"),
        _c("arrived", FLAG, "", "whether it says that it is where it should be"),
        *(
            _c(f"priority_{place}", INTEGER, "", "claim of eq. 65 and 66, compared in this order")
            for place in range(4)
        ),
        _c("slot_distance_m", NUMBER, "m", "its place in the formation, from the leader"),
        _c("slot_bearing_rad", NUMBER, "rad", "behind the leader, positive to its right"),
        _c("bearing_now_rad", NUMBER, "rad", "that bearing after the bearing switch"),
        _c("leader", TEXT, "", "whom it follows; itself when it leads"),
        _c("term", INTEGER, "", "of that leadership"),
        _c("leader_tick", INTEGER, "", "newest tick at which it knows that this one led"),
        _c("fit", FLAG, "", "whether it would lead itself"),
        _c("goal_x_m", NUMBER, "m", "where it is bound, world frame"),
        _c("goal_y_m", NUMBER, "m", "where it is bound, world frame"),
        _c("via_count", INTEGER, "", "way-points still ahead"),
        _c("formation_heading_rad", NUMBER, "rad", "theta_F of a leader, else 0"),
        _c("formation_turn_rate_radps", NUMBER, "rad/s", "its rate, of a leader, else 0"),
        _c("yields_to", TEXT, "", "whom it lets pass"),
    ),
    _beacons,
)


# --- what happened ------------------------------------------------------------------------------


def _events(scenario: Scenario, record: TickRecord) -> Iterator[Row]:
    for event in record.events:
        yield (
            event.tick,
            event.stamp_ns / 1e9,
            event.kind,
            event.robot,
            event.text,
            event.incarnation,
            event.fault,
            event.number,
        )


EVENTS = Table(
    "events",
    "Faults, restarts, losses, collisions.",
    (
        *_WHEN,
        _c("kind", TEXT, "", "what kind of event"),
        _c("robot", TEXT, "", "whom it is about"),
        _c("text", TEXT, "", "for people"),
        _c("incarnation", INTEGER, "", "of a robot that is started again"),
        _c("fault", TEXT, "", "kind of the fault, of events about faults"),
        _c("number", INTEGER, "", "of the fault in this run; -1 otherwise"),
    ),
    _events,
)

TABLES: Sequence[Table] = (ROBOTS, FRAMES, HEARD, COMMANDS, BEACONS, EVENTS)


def markdown(tables: Sequence[Table] = TABLES) -> str:
    """All columns, for people."""
    lines = ["# Columns", ""]
    lines += [
        "Units are SI; angles are counter-clockwise from +x, in [-pi, pi). "
        "What does not apply is null, in CSV an empty field."
    ]
    for table in tables:
        lines += ["", f"## {table.name}", "", table.text, "", "| column | type | unit | meaning |"]
        lines += ["|---|---|---|---|"]
        lines += [
            f"| `{one.name}` | {one.type} | {one.unit} | {one.text} |" for one in table.columns
        ]
    return "\n".join(lines) + "\n"
