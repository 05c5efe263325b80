"""A robot that always arrives: a map with memory, a way through it, right of way, a safe speed.

    scan --insert--> memory --navigation function--> Aim
    Aim, peers --right of way: roundabout, gap claims--> Aim
    Aim, peers, memory --cells in time--> direction, speed --forces--> wish --guard--> set-point

Each stage is a module of pure functions with a state of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2, cos, pi, sin, sqrt

import msgspec
import numpy as np

from agents import msam
from agents.navigator import cells, pact, right_of_way, table
from agents.navigator.aim import Aim
from agents.navigator.compiled import compiled
from agents.peers import Peer
from agents.steering import Wish, clip
from swarm import geometry
from swarm.geometry import Floats, Twist, Vec2
from swarm.messages import Beacon, Forces, Intent, Mode, Name, Promise, SensorFrame
from swarm.scenario import RobotSetup

__all__ = ["Aim", "State", "promise", "restrain", "send", "step"]

# Parked within this part of the goal's tolerance, until it is further off than the other part of it.
PARKED_IN, PARKED_OUT = 0.6, 0.95
# What it brakes with towards the goal, of what the body can do.
APPROACH = 0.7
# A robot this near to its goal does not hurry because somebody comes.
NEAR_GOAL_M, NEAR_GOAL_MPS = 0.6, 0.1


class State(msgspec.Struct, frozen=True):
    """What the stages remember."""

    via_index: int = 0
    giving: right_of_way.State = right_of_way.State()
    parked: bool = False
    intent: Intent = Intent()
    chosen: Vec2 = (0.0, 0.0)  # m/s, world: velocity of the newest cell
    yields_to: Name | None = None
    pact: pact.State = pact.State()


def step(
    setup: RobotSetup,
    state: State,
    frame: SensorFrame,
    map: msam.Map,
    others: Sequence[Peer],
    elapsed_s: float,
) -> tuple[State, Wish]:
    """One tick on the way to `setup.robot.goal` by way of its way-points."""
    state, aim = look(setup, state, frame, map)
    reach_m = cells.OBSTACLE_S * setup.robot.speed_mps_max + setup.robot.body_radius_m + 0.1
    points = hits(frame, map, max(reach_m, right_of_way.SIGHT_M))
    peers, seen = table.of(others, frame.pose.x_m, frame.pose.y_m)
    state, aim, way = give_way(
        setup, state, frame, aim, others, peers, seen, points, elapsed_s
    )
    state, choice = choose(setup, state, frame, aim, way, peers, points)
    return drive(setup, state, frame, aim, way, choice, points)


def look(setup: RobotSetup, state: State, frame: SensorFrame, map: msam.Map) -> tuple[State, Aim]:
    """Memory and way: where to go were there no peers."""
    assert setup.robot.goal is not None
    x_m, y_m = setup.robot.goal[0] - frame.pose.x_m, setup.robot.goal[1] - frame.pose.y_m
    distance_m = geometry.length(x_m, y_m)
    brake_mps2 = APPROACH * setup.robot.acceleration_mps2_max
    speed_mps = min(setup.robot.speed_mps_max, sqrt(2.0 * brake_mps2 * distance_m))
    return state, Aim(atan2(y_m, x_m), speed_mps, setup.robot.goal, distance_m, True)


def give_way(
    setup: RobotSetup,
    state: State,
    frame: SensorFrame,
    aim: Aim,
    others: Sequence[Peer],
    peers: Floats,
    seen: Sequence[Peer],
    points: Floats,
    elapsed_s: float,
) -> tuple[State, Aim, right_of_way.Way]:
    """Right of way: parking, virtual roundabout, claims to narrow gaps."""
    tolerance_m = setup.robot.goal_tolerance_m
    parked = aim.is_last and aim.distance_m < tolerance_m * (
        PARKED_OUT if state.parked else PARKED_IN
    )
    giving, way = right_of_way.step(
        setup, state.giving, frame, aim, others, peers, seen, points, elapsed_s, parked=parked
    )
    state = msgspec.structs.replace(
        state, giving=giving, parked=parked, yields_to=way.yields_to
    )
    return state, aim, way


def choose(
    setup: RobotSetup,
    state: State,
    frame: SensorFrame,
    aim: Aim,
    way: right_of_way.Way,
    peers: Floats,
    points: Floats,
) -> tuple[State, cells.Choice]:
    """World direction and speed of the cheapest cell in time."""
    robot = setup.robot
    slow_mps = robot.speed_mps_max
    if aim.is_last and aim.distance_m < NEAR_GOAL_M and not state.parked:
        slow_mps = max(way.speed_mps, NEAR_GOAL_MPS)
    choice = cells.choose(
        way.direction_rad,
        way.speed_mps,
        frame.pose.yaw_rad,
        state.chosen,
        state.intent.velocity,
        robot.body_radius_m,
        robot.speed_mps_max,
        peers,
        points,
        keeps_right=way.round,
        parked=state.parked,
        slow_mps=slow_mps,
    )
    # Whoever announced less than its top speed would keep those behind it from going faster, and
    # they it, for good; the guard sees to it that nobody relies on it.
    u_mps = choice.speed_mps
    if u_mps > 0.0 and way.speed_mps >= robot.speed_mps_max:
        u_mps = robot.speed_mps_max
    velocity = (u_mps * cos(choice.direction_rad), u_mps * sin(choice.direction_rad))
    intent = Intent(velocity, way.target, way.active)
    u_mps = choice.speed_mps
    chosen = (u_mps * cos(choice.direction_rad), u_mps * sin(choice.direction_rad))
    return msgspec.structs.replace(state, intent=intent, chosen=chosen), choice


def drive(
    setup: RobotSetup,
    state: State,
    frame: SensorFrame,
    aim: Aim,
    way: right_of_way.Way,
    choice: cells.Choice,
    points: Floats,
) -> tuple[State, Wish]:
    """Forces along and across that direction, and what to ask of the motors."""
    robot = setup.robot
    arrived = state.parked and aim.distance_m < robot.goal_tolerance_m
    mode: Mode = "ARRIVED" if arrived else "GO"
    speed_mps, direction_rad = choice.speed_mps, choice.direction_rad
    pull = geometry.unit(direction_rad)
    push = repulsion(points, robot.body_radius_m, 2.0 * pi / setup.sensor.beams)
    across = clip(push[1] * pull[0] - push[0] * pull[1], 0.5)
    error_rad = geometry.wrap_angle(atan2(across, 1.0) + direction_rad - frame.pose.yaw_rad)
    most_radps = robot.turn_rate_radps_max
    if speed_mps == 0.0:
        w_radps = 0.0
        if not state.parked:
            error_rad = geometry.wrap_angle(way.direction_rad - frame.pose.yaw_rad)
            w_radps = clip(2.0 * error_rad, min(1.5, most_radps))
        v_mps = 0.0
    elif abs(error_rad) > 2.0 and speed_mps <= 0.6 * robot.speed_mps_max:
        error_rad = geometry.wrap_angle(error_rad + pi)
        w_radps = clip(4.0 * error_rad, most_radps)
        v_mps = -speed_mps * max(0.0, cos(error_rad))
    else:
        w_radps = clip(4.0 * error_rad, most_radps)
        v_mps = speed_mps * max(0.0, cos(error_rad))
        if abs(error_rad) > 0.9:
            v_mps = min(v_mps, 0.35 * robot.speed_mps_max)
    forces = Forces(attractive=pull, repulsive=push, resultant=pull)
    return state, Wish(
        mode,
        v_mps,
        w_radps,
        arrived=arrived,
        forces=forces,
        waypoint=aim.subgoal,
    )


def restrain(
    setup: RobotSetup,
    state: State,
    frame: SensorFrame,
    asked: Twist,
    map: msam.Map,
    others: Sequence[Peer],
    statics: Sequence[Peer],
) -> tuple[State, pact.Held]:
    """Set-point that keeps what was promised, and off obstacles.

    Args:
        others: peers that promise.
        statics: those that do not.
    """
    robot = setup.robot
    stop_m = robot.speed_mps_max * robot.speed_mps_max / (2.0 * robot.acceleration_mps2_max)
    points = hits(frame, map, robot.body_radius_m + 0.1 + stop_m + 0.3 * robot.speed_mps_max)
    if len(points):
        points = points + np.array((frame.pose.x_m, frame.pose.y_m))
    kept, held = pact.hold(
        setup, state.pact, frame.tick, frame.pose, frame.twist, asked, others, statics, points
    )
    return msgspec.structs.replace(state, pact=kept), held


def promise(setup: RobotSetup) -> Promise | None:
    """What a robot promises, None when it stops too slowly."""
    return pact.promise(setup) if pact.is_kept(setup) else None


def send(setup: RobotSetup, state: State, beacon: Beacon) -> State:
    """State after a beacon went out."""
    return msgspec.structs.replace(state, pact=pact.send(setup, state.pact, beacon))


def hits(frame: SensorFrame, map: msam.Map, reach_m: float) -> Floats:
    """(n, 2) m: what the map has within reach, from this robot, world axes; by beam."""
    if map.nearest_m >= reach_m:
        return np.empty((0, 2))
    count = len(map.beams_m)
    units = msam.layout(count, len(map.sectors_m)).beam_units_array
    yaw_rad = frame.pose.yaw_rad
    points = np.empty((count, 2))
    found = collect(np.array(map.beams_m), units, cos(yaw_rad), sin(yaw_rad), reach_m, points)
    return points[:found]


@compiled
def collect(
    beams_m: Floats, units: Floats, cosine: float, sine: float, reach_m: float, points: Floats
) -> int:
    """How many hits lie within reach; they are filled in."""
    count = 0
    for beam in range(beams_m.shape[0]):
        range_m = beams_m[beam]
        if range_m < reach_m:
            x_m, y_m = range_m * units[beam, 0], range_m * units[beam, 1]
            points[count, 0] = cosine * x_m - sine * y_m
            points[count, 1] = sine * x_m + cosine * y_m
            count += 1
    return count


REPEL_M, REPEL = 0.5, 0.1


def repulsion(points: Floats, radius_m: float, beam_rad: float) -> tuple[float, float]:
    """F_rep of the hits nearer than REPEL_M, world axes."""
    if not len(points):
        return (0.0, 0.0)
    found = np.zeros(2)
    repel(points, radius_m, found)
    return (float(found[0]) * REPEL * beam_rad, float(found[1]) * REPEL * beam_rad)


@compiled
def repel(points: Floats, radius_m: float, found: Floats) -> None:
    """Sum of (1 / gap - 1 / REPEL_M) away from each hit."""
    for point in range(points.shape[0]):
        x_m, y_m = points[point, 0], points[point, 1]
        range_m = np.sqrt(x_m * x_m + y_m * y_m)
        gap_m = max(0.02, range_m - radius_m)
        if gap_m < REPEL_M and range_m > 0.0:
            strength = (1.0 / gap_m - 1.0 / REPEL_M) / range_m
            found[0] -= strength * x_m
            found[1] -= strength * y_m
