"""The guard between robots: nobody touches, whatever the stages before it ask for.

    own and peers' braking ways as announced --half-planes, instant by instant--> what is admitted
    asked, slewed --less and less of it--> first whose own braking way is admitted --> set-point

At each future instant two announced places lie some way apart. Each robot may move its own towards
the other by its part of what that is more than both need, so the next two announced ways keep apart
as well; and braking as announced changes nothing, so there is always something admitted.

A beacon that was not heard: its sender has used at most its part of what was free, and this robot
knows a lower bound of that from what it did itself. It then uses a quarter of that bound towards
wherever the sender may be by now, and knows the next bound: however many are lost, on either side.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, sin

import msgspec
import numpy as np

from agents.navigator import admission, announce, brake, pledge
from agents.navigator.admission import PROMISED, STATIC, admit
from agents.navigator.estimate import State as Estimate
from agents.peers import Peer
from swarm.geometry import Floats, Pose, Twist
from swarm.messages import Beacon, Name
from swarm.scenario import RobotSetup

# Own beacons remembered: as many as a peer's may be ticks late.
SENT_MAX = 8
# Parts of what is asked for, the first admitted is taken.
PARTS = tuple([part / 20.0 for part in (20, 19, 18, 17, 16, 14, 12, 10, 8, 6, 4, 2, 1, 0)])


class Link(msgspec.Struct, frozen=True):
    """What is surely free between this robot and one peer."""

    name: Name
    tick: int  # of its newest beacon
    slack: bytes  # (ticks,) float64 m at the coming ticks; as the last one from there on


class State(msgspec.Struct, frozen=True):
    """Own beacons, newest first, and links in order of names."""

    tick: int = -1  # of the newest beacon
    sent: tuple[tuple[float, ...], ...] = ()  # rows of `announce.path`
    links: tuple[Link, ...] = ()


class Held(msgspec.Struct, frozen=True):
    """What the guard admits."""

    set_point: Twist
    part: float  # of what was asked for
    by: str  # "" | "brake" | a peer's name
    corrects: bool = True  # announced from the pose, else from the one carried


def send(setup: RobotSetup, state: State, beacon: Beacon) -> State:
    """State after a beacon went out; what was sent before a missed tick is not to be relied on."""
    if beacon.promise is None:
        return State(tick=beacon.tick)
    row = announce.row(beacon, beacon.promise, setup.dt_s)
    before = state.sent if beacon.tick == state.tick + 1 else ()
    return State(beacon.tick, (tuple(row), *before)[:SENT_MAX], state.links)


def hold(
    setup: RobotSetup,
    state: State,
    tick: int,
    pose: Pose,
    twist: Twist,
    asked: Twist,
    others: Sequence[Peer],
    statics: Sequence[Peer],
    points_m: Floats,
    where: Estimate | None = None,
    carried: Pose | None = None,
    pending: tuple[Twist, ...] = (),
) -> tuple[State, Held | None]:
    """Set-point that keeps what was promised, None where nobody is near.

    Args:
        pose, twist: when the set-point takes effect.
        where: how sure it is of its poses in this tick; None: all are exact.
        carried: when the set-point takes effect, where the pose announced before has got to; None:
            the same. Who only brakes as announced goes on from there.
        pending: twists until the set-point takes effect.
        others: peers that promise, heard lately.
        statics: those that do not, each where it is believed to be; they get half of the gap.
        points_m: (n, 2) from the pose, world axes: obstacles, those near enough to matter.
    """
    if not others and not statics:
        return State(state.tick, state.sent), None
    robot, dt_s = setup.robot, setup.dt_s
    mine = pledge.promise(setup, twist, where.doubt if where else pledge.NO_DOUBT, pending)
    brakes = (mine.deceleration_mps2, mine.turn_deceleration_radps2)
    rates = (twist.speed_mps, twist.turn_rate_radps, brakes[0] * dt_s, brakes[1] * dt_s)
    body, start = (
        [one.x_m, one.y_m, cos(one.yaw_rad), sin(one.yaw_rad), *rates, mine.keep_m]
        for one in (carried or pose, pose)
    )
    count = announce.ticks(robot.speed_mps_max, brakes[0], dt_s)
    reach_m = announce.reach_m(robot.speed_mps_max, brakes[0], dt_s)
    rows: list[list[float]] = []
    names: list[str] = []
    known = {link.name: link for link in state.links}
    slacks: list[tuple[int, Link]] = []
    for peer in others:
        beacon = peer.beacon
        given = beacon.promise
        assert given is not None
        age = tick - beacon.tick
        fastest_mps = beacon.speed_mps_max
        if abs(beacon.twist.speed_mps) > fastest_mps:
            fastest_mps = abs(beacon.twist.speed_mps)
        near_m = mine.keep_m + given.keep_m + admission.FREE_M + reach_m + age * dt_s * fastest_mps
        near_m += fastest_mps * dt_s + fastest_mps * fastest_mps / (2.0 * given.deceleration_mps2)
        if peer.distance_m > near_m:
            continue
        row = announce.row(beacon, given, dt_s)
        link = known.get(beacon.name)
        fresh = link is None or link.tick < beacon.tick
        rows.append([*row, age, PROMISED, float(fresh), beacon.body_radius_m, fastest_mps])
        need = announce.ticks(beacon.twist.speed_mps, given.deceleration_mps2, dt_s)
        count = max(count, need)
        if link is not None:
            slacks.append((len(names), link))
        names.append(beacon.name)
    for peer in statics:
        keep_m = peer.beacon.body_radius_m + pledge.pad_m(setup)
        keep_m += setup.disturbance.position_error_m_max
        if peer.distance_m <= mine.keep_m + keep_m + 2.0 * reach_m + admission.FREE_M:
            there = [peer.pose.x_m, peer.pose.y_m, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, keep_m]
            rows.append([*there, 1.0, STATIC, 1.0, peer.beacon.body_radius_m, 0.0])
            names.append(peer.beacon.name)
    if not rows:
        return State(state.tick, state.sent), None
    count = min(count, announce.TICKS_MAX)
    sent = state.sent if state.tick == tick - 1 else ()
    slack = np.full((len(rows), count), -1.0)
    for number, link in slacks if sent else ():
        before = np.frombuffer(link.slack)[1:][:count]  # a tick has passed
        slack[number, : len(before)] = before
        slack[number, len(before) :] = before[-1] if len(before) else 0.0
    result = np.zeros(5)
    admit(
        np.array(body),
        np.array(start),
        pledge.doubts(setup, where.carried_doubt if where else pledge.NO_DOUBT, pending),
        pledge.doubts(setup, where.doubt if where else pledge.NO_DOUBT, pending),
        np.array(sent or [body]),
        len(sent),
        np.array((robot.speed_mps_max, robot.speed_mps_reverse_max, robot.turn_rate_radps_max)),
        robot.half_track_m,
        robot.body_radius_m,
        np.array((robot.acceleration_mps2_max * dt_s, robot.turn_acceleration_radps2_max * dt_s)),
        asked.speed_mps,
        asked.turn_rate_radps,
        np.array(rows),
        slack,
        points_m + np.array((pose.x_m, pose.y_m)) if len(points_m) else points_m,
        brake.room(setup, points_m),
        dt_s,
        1.0 + setup.disturbance.speed_error,
        pledge.shown_errors(setup),
        _PARTS,
        result,
    )
    links = tuple(
        [
            Link(name, tick - int(rows[number][admission.AGE]), slack[number].tobytes())
            for number, name in enumerate(names)
            if rows[number][admission.KIND] == PROMISED
        ]
    )
    by = int(result[3])
    return State(state.tick, state.sent, links), Held(
        Twist(float(result[0]), float(result[1])),
        float(result[2]),
        "" if by == admission.BY_NONE else "brake" if by == admission.BY_OBSTACLE else names[by],
        corrects=result[4] > 0.0,
    )


_PARTS = np.array(PARTS)
