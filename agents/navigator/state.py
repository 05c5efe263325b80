"""What a navigator remembers from tick to tick, and what several of its stages ask of that."""

from __future__ import annotations

import msgspec
import numpy as np

from agents import msam
from agents.navigator import estimate, memory, movers, pact, right_of_way
from agents.navigator.law import law
from agents.navigator.memory import Memory
from agents.navigator.way import Way
from swarm import geometry
from swarm.geometry import Floats, Vec2
from swarm.messages import Intent, Name, Reason, SensorFrame
from swarm.scenario import RobotSetup


class Near(msgspec.Struct, frozen=True):
    """What was gathered for the stages of a tick, so that the guard need not do it again."""

    tick: int = -1
    reach_m: float = 0.0
    points: bytes = b""  # (points, 2) float64 of `obstacles`

    def points_m(self) -> Floats:
        """Of one's own: inner loops take what is read-only for another type."""
        return np.ndarray((len(self.points) // 16, 2), np.float64, bytearray(self.points))


class State(msgspec.Struct, frozen=True):
    """What the stages remember."""

    via_index: int = 0
    memory: Memory | None = None
    way: Way | None = None
    turn_sense: int = -1  # of the last turn; at first to the right
    still_s: float = 0.0
    place: Vec2 | None = None  # where it has been since place_s
    place_s: float = 0.0
    doubts: int = 0
    closed_s: float = 0.0  # without a way
    forgot: bool = False  # all that it does not see, for want of a way
    best_m: float = 1e9  # nearest to the goal so far
    best_s: float = 0.0  # since then
    failed: Reason = ""  # there is no way; for good
    held: bool = False  # in the tick before: it waited for others
    parked: bool = False
    giving: right_of_way.State = right_of_way.State()
    chosen: Vec2 = (0.0, 0.0)  # m/s, world: velocity of the newest cell
    intent: Intent = Intent()
    yields_to: Name | None = None
    pact: pact.State = pact.State()
    where: estimate.State = estimate.State()
    since: Vec2 | None = None  # it has got no further from here
    since_s: float = 0.0  # for so long
    movers: movers.State = movers.State()  # seen by the lidar only
    near: Near = Near()
    heard: tuple[Name, ...] = ()  # in the tick before, in order


def redirect(state: State) -> State:
    """State of a robot that has got another goal: what it knows of obstacles stays."""
    return State(
        memory=state.memory,
        turn_sense=state.turn_sense,
        pact=state.pact,
        where=state.where,
        movers=state.movers,
        heard=state.heard,
    )


def pass_waypoints(setup: RobotSetup, state: State, frame: SensorFrame) -> State:
    """State after ticking off the way-points that are near enough, in their order."""
    index, via = state.via_index, setup.robot.via
    while index < len(via):
        away_x_m, away_y_m = via[index][0] - frame.pose.x_m, via[index][1] - frame.pose.y_m
        if geometry.length(away_x_m, away_y_m) > setup.robot.via_tolerance_m:
            break
        index += 1
    if index == state.via_index:
        return state
    return msgspec.structs.replace(redirect(state), via_index=index)


def target_of(setup: RobotSetup, state: State) -> tuple[Vec2, bool]:
    """Where to go now, and whether that is the goal itself."""
    assert setup.robot.goal is not None
    if state.via_index < len(setup.robot.via):
        return setup.robot.via[state.via_index], False
    return setup.robot.goal, True


def standing(state: State, seen: SensorFrame, map: msam.Map) -> msam.Map:
    """The map of this tick without what moves."""
    ranges_m = state.movers.without(map.ranges_m, seen.tick)
    return map if ranges_m is map.ranges_m else msgspec.structs.replace(map, ranges_m=ranges_m)


def obstacles(
    setup: RobotSetup,
    state: State,
    seen: SensorFrame,
    frame: SensorFrame,
    map: msam.Map,
    reach_m: float,
) -> Floats:
    """(points, 2) m, world axes, from the robot's centre: what it sees and remembers in reach."""
    rules = law(setup.navigator, setup.robot.body_radius_m)
    known = state.memory or memory.empty(rules, frame.pose)
    return memory.around(rules, known, seen.pose, map.ranges_m, frame.pose, reach_m)
