"""The whole world, one tick: pure.

    commands(k) -> heed -> motors -> motion -> contact -> state(k + 1)     step
                  (faults due at k + 1: relieve, inflict, lose, revive)
    state(k) -> raycast, disturbance, lidars, radio -> one SensorFrame per live robot   sense
    commands that arrive -> hold_back -> commands(k)
    state(k), frames(k), commands(k) -> TickRecord(k)                      record

World is constant, WorldState is all that changes: plain numbers, so it can be stored and restored.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping, Sequence
from itertools import compress
from math import inf

import msgspec
import numpy as np

from swarm import movers
from swarm.faults import ActuatorStuck, DiskFull, Fault, SensorStuck
from swarm.geometry import STILL, Floats, Pose, Ranges, Twist, Vec2, length, wrap_angle
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
from swarm.movers import Mover
from swarm.scenario import Obstacle, Scenario
from world import contact, disturbance, faults, motion, radio, raycast, scene, sensors
from world.faults import Active, Held
from world.scene import Scene

TOUCH_M = 1e-9  # two bodies no further apart than this touch; sweep stops them to rounding


class World(msgspec.Struct, frozen=True, eq=False):
    """What stays as it is for a whole run."""

    scenario: Scenario
    obstacles: tuple[Obstacle, ...]  # given and drawn
    scene: Scene  # those that stand still
    movers: tuple[Mover, ...]  # the others
    lidar: raycast.Lidar
    radii_m: Floats  # (robots,)
    rows: dict[str, int]  # name -> row
    speed_factors: tuple[float, ...]  # (robots,) of the bodies' speeds over those of the wheels


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
    excused: bool = False  # of that touch: a fault of its motors or lidar, or of the other's
    pending: tuple[Twist, ...] = ()  # set-points on their way to late motors, oldest first
    drift: disturbance.Drift = disturbance.NO_DRIFT  # of the pose that its mind is shown


class WorldState(msgspec.Struct, frozen=True):
    """All that changes from tick to tick."""

    tick: int
    bodies: tuple[Body, ...]  # in scenario order
    active: tuple[Active, ...] = ()  # faults, in the order in which they began
    history: radio.History = ()  # what was said, while a fault may bring it late or twice
    held: tuple[Held, ...] = ()  # commands of slow robots, in order of arrival
    fades: bytes = b""  # (robots * robots) for how many ticks each link carries nothing, if so


def build(scenario: Scenario) -> World:
    """World of a scenario; raises ScenarioError when it cannot be laid out."""
    obstacles = scene.obstacles(scenario)
    standing = scene.build(obstacles)
    radii_m = np.array([robot.body_radius_m for robot in scenario.robots])
    sensor = scenario.sensor
    passing = movers.moving(obstacles)
    return World(
        scenario=scenario,
        obstacles=obstacles,
        scene=standing,
        movers=passing,
        lidar=raycast.lidar(
            sensor.beams, sensor.range_m, standing, radii_m, movers.radii_m(passing)
        ),
        radii_m=radii_m,
        rows={robot.name: row for row, robot in enumerate(scenario.robots)},
        speed_factors=disturbance.speed_factors(
            scenario.disturbance, len(scenario.robots), seed=scenario.seed
        ),
    )


def init(world: World) -> WorldState:
    """Tick 0: every robot stands at its start; no commands, no beacons."""
    poses = [
        Pose(robot.start[0], robot.start[1], wrap_angle(robot.start[2]))
        for robot in world.scenario.robots
    ]
    clearances_m = _clearances_m(world, _positions_m(poses), 0)
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
    taken = [_taken(world, state, body) for body in bodies]
    set_points = [set_point for set_point, _ in taken]
    if state.active:
        set_points = faults.driven(state.active, set_points, [body.alive for body in bodies])
    moved = [
        (body.pose, STILL)
        if body.contact
        else motion.step(
            robot,
            body.pose,
            body.twist,
            set_point,
            dt_s=scenario.dt_s,
            speed_factor=factor,
        )
        for robot, body, set_point, factor in zip(
            scenario.robots, bodies, set_points, world.speed_factors, strict=True
        )
    ]

    # Nobody gets further than to what it touches.
    starts_m = _positions_m(body.pose for body in bodies)
    ends_m = _positions_m(pose for pose, _ in moved)
    clearances_m = np.array([body.clearance_m for body in bodies])
    touches = contact.sweep(
        world.scene, starts_m, ends_m, world.radii_m, clearances_m, _passing(world, state.tick)
    )
    for row, share in touches.items():
        ends_m[row] = starts_m[row] + share * (ends_m[row] - starts_m[row])
        x_m, y_m = ends_m[row].tolist()
        moved[row] = (Pose(x_m, y_m, moved[row][0].yaw_rad), STILL)
    excused = _excused(world, state, ends_m, touches)
    cleared_m = _clearances_m(world, ends_m, state.tick + 1)
    if world.movers:  # they go on over whom they touch
        cleared_m = [
            max(0.0, clearance_m) if body.contact or row in touches else clearance_m
            for row, (body, clearance_m) in enumerate(zip(bodies, cleared_m, strict=True))
        ]

    history = state.history
    if history:
        beacons = [body.beacon for body in bodies]
        history = radio.remember(
            history, beacons, state.active, tick=state.tick, dt_s=scenario.dt_s
        )
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
                body.excused or (row in excused and not body.contact),
                pending,
                disturbance.creep(
                    scenario.disturbance,
                    body.drift,
                    length(pose.x_m - body.pose.x_m, pose.y_m - body.pose.y_m),
                    row,
                    seed=scenario.seed,
                    tick=state.tick + 1,
                ),
            )
            for row, (body, (pose, twist), clearance_m, (_, pending)) in enumerate(
                zip(bodies, moved, cleared_m, taken, strict=True)
            )
        ),
        state.active,
        history,
        state.held,
        disturbance.fade(
            scenario.disturbance,
            state.fades,
            len(bodies),
            seed=scenario.seed,
            tick=state.tick + 1,
        ),
    )


def lose(world: World, state: WorldState, name: str) -> WorldState:
    """World in which a robot's mind is gone: silent, braking to rest, then an obstacle."""
    row = world.rows[name]
    body = msgspec.structs.replace(state.bodies[row], alive=False, set_point=STILL, pending=())
    return _with_body(state, row, body)


def revive(world: World, state: WorldState, name: str) -> WorldState:
    """World in which a robot has a mind again: it stands until its first command and is silent.

    What it said before is forgotten. Who has touched something stands for good all the same.
    """
    row = world.rows[name]
    body = msgspec.structs.replace(
        state.bodies[row],
        alive=True,
        set_point=STILL,
        command_tick=state.tick - 1,
        beacon=None,
    )
    revived = _with_body(state, row, body)
    if state.history:
        history = (*state.history[:row], (), *state.history[row + 1 :])
        revived = msgspec.structs.replace(revived, history=history)
    return revived


def inflict(
    world: World, state: WorldState, number: int, fault: Fault, rows: Sequence[int]
) -> WorldState:
    """World in which a fault has begun, before anything is sensed in this tick.

    Args:
        fault: any but those of processes.
        rows: of the robots that it strikes; none: nothing happens, unless it strikes the world.
    """
    if not rows and not isinstance(fault, DiskFull):
        return state
    scenario = world.scenario
    begun = faults.begin(number, fault, rows, state.tick, dt_s=scenario.dt_s)
    history = state.history
    if isinstance(fault, ActuatorStuck):
        asked = [_taken(world, state, body)[0] for body in state.bodies]
        taken = faults.stuck(state.active, asked)
        begun = msgspec.structs.replace(begun, set_points=tuple(taken[row] for row in rows))
    elif isinstance(fault, SensorStuck):
        scans = _scans_m(world, state, rows)
        begun = msgspec.structs.replace(begun, scans=tuple(sensors.scan(scan) for scan in scans))
    elif radio.needs_history((begun,)) and not history:
        beacons = [body.beacon for body in state.bodies]
        history = radio.remember(
            ((),) * len(beacons), beacons, (), tick=state.tick - 1, dt_s=scenario.dt_s
        )
    return msgspec.structs.replace(state, active=(*state.active, begun), history=history)


def relieve(world: World, state: WorldState) -> tuple[WorldState, tuple[Active, ...]]:
    """World without the faults that are over at this tick, and those, for the events."""
    over = tuple(one for one in state.active if faults.is_over(one, state.tick))
    if not over:
        return state, ()
    active = tuple(one for one in state.active if not faults.is_over(one, state.tick))
    history = state.history if radio.needs_history(active) else ()
    return msgspec.structs.replace(state, active=active, history=history), over


def hold_back(
    world: World, state: WorldState, commands: Iterable[Command]
) -> tuple[WorldState, tuple[Command, ...]]:
    """Commands that take effect in this tick, of those that arrive in it and before.

    Those of a slow robot wait; when it is slow no more all the rest comes at once, likewise when
    its mind is gone: nobody heeds them any more, but what it has sent is recorded.

    Args:
        commands: that arrive in this tick.
    Returns:
        in order of arrival, so that the last one of a robot is its newest.
    """
    late = faults.late_ticks(state.active, world.scenario.dt_s)
    if not late and not state.held:
        return state, tuple(commands)
    due: list[Command] = []
    held: list[Held] = []
    for one in (*state.held, *(Held(state.tick, command) for command in commands)):
        row = world.rows[one.command.robot]
        ticks = late.get(row, 0) if state.bodies[row].alive else 0
        if one.tick + ticks <= state.tick:
            due.append(one.command)
        else:
            held.append(one)
    return msgspec.structs.replace(state, held=tuple(held)), tuple(due)


def sense(
    world: World, state: WorldState, goals: Mapping[str, Vec2] | None = None
) -> tuple[SensorFrame, ...]:
    """What each live robot senses and hears, in scenario order; to some of them orders, by name.

    It hears the newest beacon of every live robot within radio range: in lock-step that of the
    tick before. Faults of lidars and links have their say.
    """
    scenario = world.scenario
    bodies = state.bodies
    live = [row for row, body in enumerate(bodies) if body.alive]
    ranges_m = _scans_m(world, state, live)
    heard = _beacons(world, state, live)
    stamp_ns = scenario.stamp_ns(state.tick)
    beams = ranges_m.shape[1]
    scans = ranges_m.astype("<f4").tobytes()
    size = 4 * beams  # bytes of one scan; cut from the whole, which is cheaper than row by row
    return tuple(
        SensorFrame(
            robot=scenario.robots[row].name,
            tick=state.tick,
            stamp_ns=stamp_ns,
            pose=disturbance.pose(
                scenario.disturbance,
                bodies[row].pose,
                row,
                bodies[row].drift,
                seed=scenario.seed,
                tick=state.tick,
            ),
            twist=(twist := motion.scaled(bodies[row].twist, 1.0 / world.speed_factors[row])),
            wheels=motion.wheels(scenario.robots[row], twist),
            contact=bodies[row].contact,
            ranges=Array("<f4", (beams,), scans[number * size : (number + 1) * size]),
            beacons=heard[number],
            goal=goals.get(scenario.robots[row].name) if goals else None,
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
                body.excused,
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
        goal=frame.goal,
    )


def _scans_m(world: World, state: WorldState, rows: Sequence[int]) -> Ranges:
    """(rows, beams) what the lidars of some robots show."""
    scenario = world.scenario
    ranges_m = raycast.cast(
        world.lidar,
        [body.pose for body in state.bodies],
        rows,
        movers.places_m(world.movers, _time_s(world, state.tick)),
    )
    ranges_m = disturbance.scans(
        scenario.disturbance,
        ranges_m,
        rows,
        range_m=world.lidar.range_m,
        seed=scenario.seed,
        tick=state.tick,
    )
    if not state.active:
        return ranges_m
    return sensors.disturb(
        ranges_m,
        rows,
        state.active,
        range_m=world.lidar.range_m,
        seed=scenario.seed,
        tick=state.tick,
    )


def _beacons(world: World, state: WorldState, listeners: Sequence[int]) -> list[tuple[Beacon, ...]]:
    """What each listener hears, speakers in scenario order."""
    scenario, bodies = world.scenario, state.bodies
    alive = np.array([body.alive for body in bodies])
    positions_m = _positions_m(body.pose for body in bodies)
    heard = radio.audible(scenario.radio.range_m, positions_m, alive)
    heard = disturbance.carried(
        scenario.disturbance, heard, state.fades, seed=scenario.seed, tick=state.tick
    )
    if state.active:
        heard = radio.carried(heard, state.active, seed=scenario.seed, tick=state.tick)
    if state.history:
        return radio.arriving(
            heard,
            state.history,
            state.active,
            listeners,
            seed=scenario.seed,
            tick=state.tick,
            dt_s=scenario.dt_s,
        )
    beacons = [body.beacon for body in bodies if body.beacon is not None]
    speakers = [row for row, body in enumerate(bodies) if body.beacon is not None]
    hears = heard[:, speakers].tolist()
    return [tuple(compress(beacons, hears[row])) for row in listeners]


def _with_body(state: WorldState, row: int, body: Body) -> WorldState:
    bodies = list(state.bodies)
    bodies[row] = body
    return msgspec.structs.replace(state, bodies=tuple(bodies))


def _excused(
    world: World, state: WorldState, positions_m: Floats, touches: Mapping[int, float]
) -> set[int]:
    """Which of those that touch something in this tick have, or touch, who is not to blame."""
    faulty = faults.excusing_rows(state.active) if touches else frozenset()
    excused = faulty & touches.keys()
    for row in touches.keys() - excused:
        for other in faulty:
            dx_m, dy_m = (positions_m[row] - positions_m[other]).tolist()
            apart_m = length(dx_m, dy_m) - world.radii_m[row] - world.radii_m[other]
            if apart_m <= TOUCH_M:
                excused |= {row}
    return set(excused)


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
                body.excused,
                body.pending,
                body.drift,
            )
    return tuple(bodies)


def _in_force(world: World, state: WorldState, body: Body) -> Twist:
    """Set-point that moves a body in this tick: still when it is dead or its command too old."""
    if not body.alive or body.command_tick < state.tick - world.scenario.clock.command_ttl:
        return STILL
    return body.set_point


def _taken(world: World, state: WorldState, body: Body) -> tuple[Twist, tuple[Twist, ...]]:
    """Set-point that the motors take in this tick, and those on their way; the dead just brake."""
    if not body.alive:
        return STILL, ()
    asked = _in_force(world, state, body)
    return disturbance.late(world.scenario.disturbance, body.pending, asked)


def _positions_m(poses: Iterable[Pose]) -> Floats:
    """(robots, 2) world frame."""
    return np.array([(pose.x_m, pose.y_m) for pose in poses])


def _clearances_m(world: World, positions_m: Floats, tick: int) -> list[float]:
    """(robots,) from each body's surface to the nearest obstacle's, inf without obstacles."""
    if not world.obstacles:
        return [inf] * len(positions_m)
    nearest_m = scene.clearance(world.scene, positions_m)
    if world.movers:
        passing = scene.at(world.movers, _time_s(world, tick))
        nearest_m = np.minimum(nearest_m, scene.clearance(passing, positions_m))
    clearances_m: list[float] = (nearest_m - world.radii_m).tolist()
    return clearances_m


def _passing(world: World, tick: int) -> contact.Passing | None:
    """What moves, from this tick to the next."""
    if not world.movers:
        return None
    return contact.Passing(
        movers.places_m(world.movers, _time_s(world, tick)),
        movers.places_m(world.movers, _time_s(world, tick + 1)),
        movers.radii_m(world.movers),
    )


def _time_s(world: World, tick: int) -> float:
    return tick * world.scenario.dt_s


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
        frame.goal,
    )
