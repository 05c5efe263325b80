"""Right of way: who goes first, and round what.

Aim, peers --gap claims--> target --stuck? roundabout?--> Way
"""

from __future__ import annotations

from collections.abc import Sequence
from math import atan2, sqrt

import msgspec

from agents.navigator import gaps, roundabout, stuck, table
from agents.navigator.aim import Aim
from agents.peers import Peer
from swarm.geometry import Floats, Vec2, length, wrap_angle
from swarm.messages import Name, Passage, SensorFrame
from swarm.scenario import RobotSetup

PATH_STEP = 2  # every other cell of the way is looked at
SIGHT_M = 4.2  # as far as hits are looked at for gaps
WAITING_M = 0.15  # this near to where it waits it stands
APPROACH = 0.7  # it brakes for that with this part of what the body can do


class State(msgspec.Struct, frozen=True):
    """What the rules remember."""

    roundabout: roundabout.State = roundabout.State()
    stuck: stuck.State = stuck.State()
    gap: gaps.State = gaps.State()

    @property
    def passage(self) -> Passage | None:
        """Own claim, as announced."""
        return self.gap.passage


class Course(msgspec.Struct, frozen=True):
    """Where right of way sends the robot."""

    direction_rad: float  # world
    speed_mps: float
    target: Vec2  # m, world: announced
    active: bool  # on its way there
    round: bool = False  # it goes round a roundabout
    yields_to: Name | None = None
    waits: bool = False  # beside the mouth of a gap
    own: bool = True  # the direction is that of its own way
    share: float = 1.0  # of the speed: the rest leaves room to who is ahead on a roundabout


def step(
    setup: RobotSetup,
    state: State,
    frame: SensorFrame,
    aim: Aim,
    target: Vec2,
    others: Sequence[Peer],
    peers: Floats,
    seen: Sequence[Peer],
    points: Floats,
    path: Floats,
    elapsed_s: float,
    *,
    parked: bool,
) -> tuple[State, Course]:
    """State and way at this tick.

    Args:
        others: all that were heard lately.
        peers, seen: of `table.of`; shares of those at the same gap are filled in.
        target: m, world: next way-point or the goal.
        points: (n, 2) m from here, world axes: obstacles.
        path: (cells, 2) m from here, world axes: the way.
    """
    robot = setup.robot
    position = (frame.pose.x_m, frame.pose.y_m)
    direction_rad = aim.direction_rad
    speed_mps = aim.open_mps if len(peers) else aim.speed_mps
    if parked:
        return State(), Course(direction_rad, 0.0, target, False)
    gap, rule = state.gap, None
    if "gaps" not in setup.navigator.without:
        gap, rule = gaps.step(
            gap,
            robot.name,
            frame.tick,
            position,
            target,
            robot.body_radius_m,
            robot.speed_mps_max,
            others,
            peers,
            points,
            path,
        )
    yields_to = None
    waits = holds = False
    own = True
    away_m = 0.0
    if rule is not None:
        assign(rule, peers, seen)
        waits, yields_to = rule.waits, rule.yields_to
        holds = gap.passage is not None and gap.passage.holds
        if rule.place is not None:
            to_x, to_y = rule.place[0] - position[0], rule.place[1] - position[1]
            away_m = length(to_x, to_y)
            direction_rad, own = atan2(to_y, to_x), False
        if waits:
            brake_mps2 = APPROACH * robot.acceleration_mps2_max
            speed_mps = min(speed_mps, sqrt(2.0 * brake_mps2 * away_m))
            if away_m < WAITING_M and rule.face is not None:
                speed_mps = 0.0
                direction_rad = atan2(rule.face[1] - position[1], rule.face[0] - position[0])
    free = not (waits or holds)
    # Alone, it is what the robot remembers that holds it: that is the memory's to doubt.
    stuck_ = stuck.step(
        state.stuck, position, aim.distance_m, elapsed_s, free=not waits and len(peers) > 0
    )
    circle, round_, share = state.roundabout, False, 1.0
    if stuck_.escape_s > 0.0:
        direction_rad, own = wrap_angle(direction_rad + stuck_.turn_rad()), False
    elif (
        free
        and speed_mps > roundabout.SPEED_MIN * robot.speed_mps_max
        and "roundabout" not in setup.navigator.without
    ):
        circle, turn = roundabout.step(
            circle,
            position,
            target,
            direction_rad,
            robot.speed_mps_max,
            robot.body_radius_m,
            peers,
            elapsed_s,
        )
        if turn is not None:
            direction_rad, share, round_, own = turn.direction_rad, turn.share, True, False
    active = stuck_.escape_s <= 0.0 and not waits
    state = State(circle, stuck_, gap)
    return state, Course(
        direction_rad, speed_mps, target, active, round_, yields_to, waits, own, share
    )


def assign(rule: gaps.Rule, peers: Floats, seen: Sequence[Peer]) -> None:
    """Fill in how much to make way for whom at a gap."""
    rows = {peer.beacon.name: row for row, peer in enumerate(seen)}
    for name, share, risk in rule.shares:
        row = rows.get(name)
        if row is not None:
            peers[row, table.SHARE] = share
            peers[row, table.RISK] = risk
