"""The whole world, one tick: pure.

    commands(k) -> heed -> motion -> contact -> state(k + 1)          step
                          (faults due at k + 1: the shell calls lose)
    state(k) -> raycast, radio -> one SensorFrame per live robot      sense
    state(k), frames(k), commands(k) -> TickRecord(k)                 record

World is constant, WorldState is all that changes: plain numbers, so it can be stored and restored.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping, Sequence
from itertools import compress
from math import inf

import msgspec
import numpy as np

from swarm.geometry import STILL, Floats, Pose, Twist, wrap_angle
from swarm.messages import (
    Array,
    Beacon,
    Command,
    Event,
    FrameRecord,
    RobotRecord,
    SensorFrame,
    TickRecord,
)
from swarm.scenario import Obstacle, Scenario
from world import contact, motion, radio, raycast, scene
from world.scene import Scene


class World(msgspec.Struct, frozen=True, eq=False):
    """What stays as it is for a whole run."""

    scenario: Scenario
    obstacles: tuple[Obstacle, ...]  # given and drawn
    scene: Scene
    lidar: raycast.Lidar
    radii_m: Floats  # (robots,)
    rows: dict[str, int]  # name -> row


class Body(msgspec.Struct, frozen=True, array_like=True):
    """One robot as the world knows it."""

    pose: Pose
    twist: Twist
    clearance_m: float  # surface to the nearest obstacle's, inf without obstacles
    alive: bool = True
    contact: bool = False  # has touched something: stands where it is for good
    set_point: Twist = STILL  # of the newest command
    command_tick: int = -1  # the tick whose frame that command answers; -1 before the first
    beacon: Beacon | None = None  # of the newest command


class WorldState(msgspec.Struct, frozen=True):
    """All that changes from tick to tick."""

    tick: int
    bodies: tuple[Body, ...]  # in scenario order


def build(scenario: Scenario) -> World:
    """World of a scenario; raises ScenarioError when it cannot be laid out."""
    obstacles = scene.obstacles(scenario)
    standing = scene.build(obstacles)
    radii_m = np.array([robot.body_radius_m for robot in scenario.robots])
    sensor = scenario.sensor
    return World(
        scenario=scenario,
        obstacles=obstacles,
        scene=standing,
        lidar=raycast.lidar(sensor.beams, sensor.range_m, standing, radii_m),
        radii_m=radii_m,
        rows={robot.name: row for row, robot in enumerate(scenario.robots)},
    )


def init(world: World) -> WorldState:
    """Tick 0: every robot stands at its start; no commands, no beacons."""
    poses = [
        Pose(robot.start[0], robot.start[1], wrap_angle(robot.start[2]))
        for robot in world.scenario.robots
    ]
    clearances_m = _clearances_m(world, _positions_m(poses))
    return WorldState(
        0,
        tuple(
            Body(pose, STILL, clearance_m)
            for pose, clearance_m in zip(poses, clearances_m, strict=True)
        ),
    )


def step(world: World, state: WorldState, commands: Mapping[str, Command]) -> WorldState:
    """World at the next tick, moved by the commands of this one.

    Args:
        commands: newest of each robot, by name. A live robot without one keeps its set-point
            until that is older than clock.command_ttl ticks, then it brakes.
    """
    scenario = world.scenario
    bodies = _heed(world, state, commands.values())

    # Where each body would be, were it alone. A body that has touched something stands for good.
    moved = [
        (body.pose, STILL)
        if body.contact
        else motion.step(
            robot, body.pose, body.twist, _in_force(world, state, body), dt_s=scenario.dt_s
        )
        for robot, body in zip(scenario.robots, bodies, strict=True)
    ]

    # Nobody gets further than to what it touches.
    starts_m = _positions_m(body.pose for body in bodies)
    ends_m = _positions_m(pose for pose, _ in moved)
    clearances_m = np.array([body.clearance_m for body in bodies])
    touches = contact.sweep(world.scene, starts_m, ends_m, world.radii_m, clearances_m)
    for row, share in touches.items():
        ends_m[row] = starts_m[row] + share * (ends_m[row] - starts_m[row])
        x_m, y_m = ends_m[row].tolist()
        moved[row] = (Pose(x_m, y_m, moved[row][0].yaw_rad), STILL)

    return WorldState(
        state.tick + 1,
        tuple(
            Body(
                pose,
                twist,
                clearance_m,
                body.alive,
                body.contact or row in touches,
                body.set_point,
                body.command_tick,
                body.beacon,
            )
            for row, (body, (pose, twist), clearance_m) in enumerate(
                zip(bodies, moved, _clearances_m(world, ends_m), strict=True)
            )
        ),
    )


def lose(world: World, state: WorldState, name: str) -> WorldState:
    """World in which a robot's mind is gone: silent, braking to rest, then an obstacle."""
    bodies = list(state.bodies)
    row = world.rows[name]
    bodies[row] = msgspec.structs.replace(bodies[row], alive=False, set_point=STILL)
    return WorldState(state.tick, tuple(bodies))


def sense(world: World, state: WorldState) -> tuple[SensorFrame, ...]:
    """What each live robot senses and hears, in scenario order.

    It hears the newest beacon of every live robot within radio range: in lock-step that of the
    tick before.
    """
    scenario = world.scenario
    bodies = state.bodies
    live = [row for row, body in enumerate(bodies) if body.alive]
    poses = [body.pose for body in bodies]
    ranges_m = raycast.cast(world.lidar, poses, live)
    alive = np.array([body.alive for body in bodies])
    heard = radio.audible(scenario.radio.range_m, _positions_m(poses), alive)
    beacons = [body.beacon for body in bodies if body.beacon is not None]
    speakers = [row for row, body in enumerate(bodies) if body.beacon is not None]
    hears = heard[:, speakers].tolist()
    stamp_ns = scenario.stamp_ns(state.tick)
    beams = ranges_m.shape[1]
    scans = ranges_m.astype("<f4").tobytes()
    size = 4 * beams  # bytes of one scan; cut from the whole, which is cheaper than row by row
    return tuple(
        SensorFrame(
            robot=scenario.robots[row].name,
            tick=state.tick,
            stamp_ns=stamp_ns,
            pose=bodies[row].pose,
            twist=bodies[row].twist,
            wheels=motion.wheels(scenario.robots[row], bodies[row].twist),
            contact=bodies[row].contact,
            ranges=Array("<f4", (beams,), scans[number * size : (number + 1) * size]),
            beacons=tuple(compress(beacons, hears[row])),
        )
        for number, row in enumerate(live)
    )


def record(
    world: World,
    state: WorldState,
    frames: Sequence[SensorFrame],
    commands: Iterable[Command],
    events: Sequence[Event] = (),
) -> TickRecord:
    """The whole tick: the truth, what was sensed, what was answered, what happened.

    Args:
        commands: all that arrived in this tick, in any order.
    """
    commands = sorted(commands, key=lambda command: (world.rows[command.robot], command.tick))
    bodies = _heed(world, state, commands)
    return TickRecord(
        tick=state.tick,
        stamp_ns=world.scenario.stamp_ns(state.tick),
        robots=tuple(
            RobotRecord(
                body.alive,
                body.contact,
                body.pose,
                body.twist,
                _in_force(world, state, body),
                body.beacon,
                body.clearance_m,
            )
            for body in bodies
        ),
        frames=tuple(_frame_record(world, frame) for frame in frames),
        commands=tuple(commands),
        events=tuple(events),
    )


def frame_of(
    scenario: Scenario,
    frame: FrameRecord,
    tick: int,
    stamp_ns: int,
    beacons: Mapping[tuple[int, int], Beacon],
) -> SensorFrame:
    """The SensorFrame that was sent, exactly, from its record.

    Args:
        beacons: by (row of the robot, tick of the beacon).
    """
    return SensorFrame(
        robot=scenario.robots[frame.row].name,
        tick=tick,
        stamp_ns=stamp_ns,
        pose=frame.pose,
        twist=frame.twist,
        wheels=frame.wheels,
        contact=frame.contact,
        ranges=frame.ranges,
        beacons=tuple(beacons[row, heard] for row, heard in frame.heard.numpy().tolist()),
    )


def _heed(world: World, state: WorldState, commands: Iterable[Command]) -> tuple[Body, ...]:
    """Bodies with the newest command of each live robot taken to heart.

    The dead command nothing. A command that is not newer than the one in force, or that answers
    a frame which does not exist yet, changes nothing.
    """
    bodies = list(state.bodies)
    for command in commands:
        row = world.rows[command.robot]
        body = bodies[row]
        if body.alive and body.command_tick < command.tick <= state.tick:
            bodies[row] = Body(
                body.pose,
                body.twist,
                body.clearance_m,
                body.alive,
                body.contact,
                command.set_point,
                command.tick,
                command.beacon,
            )
    return tuple(bodies)


def _in_force(world: World, state: WorldState, body: Body) -> Twist:
    """Set-point that moves a body in this tick: still when it is dead or its command too old."""
    if not body.alive or body.command_tick < state.tick - world.scenario.clock.command_ttl:
        return STILL
    return body.set_point


def _positions_m(poses: Iterable[Pose]) -> Floats:
    """(robots, 2) world frame."""
    return np.array([(pose.x_m, pose.y_m) for pose in poses])


def _clearances_m(world: World, positions_m: Floats) -> list[float]:
    """(robots,) from each body's surface to the nearest obstacle's, inf without obstacles."""
    if not world.obstacles:
        return [inf] * len(positions_m)
    clearances_m: list[float] = (scene.clearance(world.scene, positions_m) - world.radii_m).tolist()
    return clearances_m


def _frame_record(world: World, frame: SensorFrame) -> FrameRecord:
    heard = [
        number for beacon in frame.beacons for number in (world.rows[beacon.name], beacon.tick)
    ]
    return FrameRecord(
        world.rows[frame.robot],
        frame.pose,
        frame.twist,
        frame.wheels,
        frame.contact,
        frame.ranges,
        Array("<i4", (len(frame.beacons), 2), struct.pack(f"<{len(heard)}i", *heard)),
    )
