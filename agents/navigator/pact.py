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
from struct import Struct, pack

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
NUMBER = 8  # bytes of a float64
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
    sent: tuple[bytes, ...] = ()  # rows of `announce.path`, float64
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
    row = _PACK(*announce.row(beacon, beacon.promise, setup.dt_s))
    before = state.sent if beacon.tick == state.tick + 1 else ()
    return State(beacon.tick, (row, *before)[:SENT_MAX], state.links)


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
    near_m = mine.keep_m + admission.FREE_M + reach_m
    flat: list[float] = []  # rows, one after the other
    heard: list[tuple[Name, int]] = []  # and the ticks of their beacons
    known = {link.name: link for link in state.links}
    slacks: list[bytes] = []  # of theirs, a tick ago; none where nothing is known
    for peer in others:
        beacon = peer.beacon
        given, speed_mps, fastest_mps = beacon.promise, beacon.twist.speed_mps, beacon.speed_mps_max
        assert given is not None
        if not -fastest_mps <= speed_mps <= fastest_mps:
            fastest_mps = abs(speed_mps)
        age, brakes_mps2 = tick - beacon.tick, given.deceleration_mps2
        stop_s = (age + 1) * dt_s + fastest_mps / (2.0 * brakes_mps2)
        if peer.distance_m > near_m + given.keep_m + fastest_mps * stop_s:
            continue
        name = beacon.name
        link = known.get(name)
        fresh = link is None or link.tick < beacon.tick
        flat += announce.row(beacon, given, dt_s)
        flat += (age, PROMISED, fresh, beacon.body_radius_m, fastest_mps)
        count = max(count, announce.ticks(speed_mps, brakes_mps2, dt_s))
        slacks.append(b"" if link is None else link.slack)
        heard.append((name, beacon.tick))
    names = [name for name, _ in heard]
    for peer in statics:
        keep_m = peer.beacon.body_radius_m + pledge.pad_m(setup)
        keep_m += setup.disturbance.position_error_m_max
        if peer.distance_m <= mine.keep_m + keep_m + 2.0 * reach_m + admission.FREE_M:
            flat += (peer.pose.x_m, peer.pose.y_m, 1.0, 0.0, 0.0, 0.0, 1.0, 1.0, keep_m)
            flat += (1.0, STATIC, 1.0, peer.beacon.body_radius_m, 0.0)
            names.append(peer.beacon.name)
    if not names:
        return State(state.tick, state.sent), None
    count = min(count, announce.TICKS_MAX)
    sent = state.sent if state.tick == tick - 1 else ()
    if not sent:
        slacks = []
    slacks += [b""] * (len(names) - len(slacks))
    later = bytearray(b"".join([after_tick(left, count) for left in slacks]))
    slack: Floats = np.ndarray((len(names), count), np.float64, later)
    told = bytearray(b"".join(sent or (_PACK(*body),)))
    result = np.zeros(5)
    admit(
        np.array(body),
        np.array(start),
        pledge.doubts(setup, where.carried_doubt if where else pledge.NO_DOUBT, pending),
        pledge.doubts(setup, where.doubt if where else pledge.NO_DOUBT, pending),
        np.ndarray((max(1, len(sent)), announce.COLUMNS), np.float64, told),
        len(sent),
        brake.limits(setup),
        asked.speed_mps,
        asked.turn_rate_radps,
        np.array(flat, dtype=np.float64).reshape(len(names), -1),
        slack,
        points_m,
        1.0 + setup.disturbance.speed_error,
        pledge.shown_errors(setup),
        _PARTS,
        result,
    )
    left, size = slack.tobytes(), NUMBER * count
    links = tuple(
        [
            Link(name, said, left[row * size : (row + 1) * size])
            for row, (name, said) in enumerate(heard)
        ]
    )
    by = int(result[3])
    return State(state.tick, state.sent, links), Held(
        Twist(float(result[0]), float(result[1])),
        float(result[2]),
        "" if by == admission.BY_NONE else "brake" if by == admission.BY_OBSTACLE else names[by],
        corrects=result[4] > 0.0,
    )


def after_tick(slack: bytes, count: int) -> bytes:
    """What is left of a `Link.slack` a tick later, for so many ticks; -1 where nothing is known."""
    if not slack:
        return _UNKNOWN * count
    later = slack[NUMBER : NUMBER * (1 + count)]
    return later + (later[-NUMBER:] or _NOTHING) * (count - len(later) // NUMBER)


_PARTS = np.array(PARTS)
_UNKNOWN, _NOTHING = pack("d", -1.0), pack("d", 0.0)
_PACK = Struct(f"{announce.COLUMNS}d").pack
