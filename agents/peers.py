"""What a robot knows of its peers: their newest beacons, moved on to now.

    beacons heard --remember--> State.peers --now--> [Peer]
                                     '--lose--> bodies of those that fell silent

Beacons are a tick old or older, and some are lost: each is extrapolated with its own twist before
any use, and forgotten once it is older than a bound; its body is then an obstacle like any other.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import atan2, cos, sin, sqrt

import msgspec

from swarm import geometry
from swarm.geometry import Pose, Vec2
from swarm.messages import Beacon, Name
from swarm.scenario import RobotSetup

# Nothing in a scenario lies further out or moves faster; beyond, squares would overflow.
COORDINATE_M_MAX = 1e6
RATE_MAX = 1e3  # m/s and rad/s
# Who falls silent was heard a tick before, and comes to rest within about another.
STOPPING_TICKS = 2


class Peer(msgspec.Struct, frozen=True):
    """One peer as it is believed to be now."""

    beacon: Beacon
    pose: Pose  # world, at the tick of the frame
    offset: Vec2  # m, world axes, from this robot's centre
    offset_body: Vec2  # m, body frame
    distance_m: float
    bearing_rad: float  # body frame
    age_s: float  # of its beacon
    missed_ticks: int  # beacons that should have come since; none when it is of the tick before

    def velocity(self) -> Vec2:
        """m/s, world."""
        speed_mps = self.beacon.twist.speed_mps
        return (speed_mps * cos(self.pose.yaw_rad), speed_mps * sin(self.pose.yaw_rad))


class Body(msgspec.Struct, frozen=True):
    """Where a robot stands that is not heard any more, or says that it cannot move."""

    name: Name
    x_m: float
    y_m: float
    radius_m: float


def remember(
    known: tuple[Beacon, ...], heard: Iterable[Beacon], name: str, tick: int, ticks_max: int
) -> tuple[Beacon, ...]:
    """Newest beacon of every peer that is no older than `ticks_max`, in order of their names.

    A later incarnation wins whatever its tick. Beacons of this robot itself, from the future and
    with numbers that nothing in the world can have are left out.
    """
    newest = {beacon.name: beacon for beacon in known}
    for beacon in heard:
        key = beacon.name
        old = newest.get(key)
        if old is not None and (
            beacon.incarnation < old.incarnation
            or (beacon.incarnation == old.incarnation and beacon.tick < old.tick)
        ):
            continue
        if beacon.tick <= tick and key != name and _is_plausible(beacon):
            newest[key] = beacon
    return tuple(
        [newest[key] for key in sorted(newest) if 0 <= tick - newest[key].tick <= ticks_max]
    )


def lose(
    bodies: tuple[Body, ...],
    before: tuple[Beacon, ...],
    known: tuple[Beacon, ...],
    dt_s: float,
) -> tuple[Body, ...]:
    """Bodies of all that were heard once and are silent now, in order of their names."""
    if not bodies and [one.name for one in before] == [one.name for one in known]:
        return bodies  # as in nearly every tick
    heard = {beacon.name for beacon in known}
    gone = [beacon for beacon in before if beacon.name not in heard]
    if not gone and not any(body.name in heard for body in bodies):
        return bodies
    standing = {body.name: body for body in bodies if body.name not in heard}
    for beacon in gone:
        there = geometry.advance(beacon.pose, beacon.twist, STOPPING_TICKS * dt_s)
        standing[beacon.name] = Body(beacon.name, there.x_m, there.y_m, beacon.body_radius_m)
    return tuple([standing[name] for name in sorted(standing)])


def now(
    beacons: Iterable[Beacon], pose: Pose, tick: int, dt_s: float, ahead_ticks: int = 0
) -> list[Peer]:
    """Peers at the tick of this robot's frame, as seen from its pose.

    Args:
        ahead_ticks: so many ticks later, if they go on like that; the pose is one of then.
    """
    ahead = cos(pose.yaw_rad)
    aside = sin(pose.yaw_rad)
    found = []
    for beacon in beacons:
        age_ticks = tick - beacon.tick
        if beacon.promise is None or not beacon.promise.pending:
            there = geometry.advance(beacon.pose, beacon.twist, (age_ticks + ahead_ticks) * dt_s)
        else:
            there = moved(beacon, age_ticks + ahead_ticks, dt_s)
        found.append(_seen(beacon, there, pose, ahead, aside, age_ticks, dt_s))
    return found


def moved(beacon: Beacon, ticks: int, dt_s: float) -> Pose:
    """Where a peer is so many ticks after its beacon: twists under way first, then its newest."""
    pose = beacon.pose
    pending = beacon.promise.pending[:ticks] if beacon.promise is not None else ()
    for twist in pending:
        pose = geometry.advance(pose, twist, dt_s)
    return geometry.advance(pose, beacon.twist, (ticks - len(pending)) * dt_s)


def halted(others: Iterable[Peer], pose: Pose, dt_s: float) -> list[Peer]:
    """Those that should have been heard since, where they are if they stopped at once instead."""
    ahead = cos(pose.yaw_rad)
    aside = sin(pose.yaw_rad)
    return [
        _seen(
            peer.beacon,
            geometry.advance(peer.beacon.pose, peer.beacon.twist, dt_s),
            pose,
            ahead,
            aside,
            peer.missed_ticks + 1,
            dt_s,
        )
        for peer in others
        if peer.missed_ticks > 0
    ]


def _seen(
    beacon: Beacon,
    there: Pose,
    pose: Pose,
    ahead: float,
    aside: float,
    age_ticks: int,
    dt_s: float,
) -> Peer:
    """A peer at a pose, from a robot at another with that cosine and sine of its heading."""
    dx_m = there.x_m - pose.x_m
    dy_m = there.y_m - pose.y_m
    x_m = ahead * dx_m + aside * dy_m
    y_m = ahead * dy_m - aside * dx_m
    return Peer(  # by position: it is made for every peer in every tick
        beacon,
        there,
        (dx_m, dy_m),
        (x_m, y_m),
        sqrt(dx_m * dx_m + dy_m * dy_m),
        atan2(y_m, x_m),
        age_ticks * dt_s,
        age_ticks - 1 if age_ticks > 1 else 0,
    )


def safe_distance(setup: RobotSetup, peer: Peer) -> float:
    """r of eq. 36 for these two robots: the scenario's, or more when their bodies need it."""
    touch_m = setup.robot.body_radius_m + peer.beacon.body_radius_m
    return max(setup.field.safe_distance_m, touch_m + setup.guard.peer_margin_m)


def is_in_formation(beacon: Beacon) -> bool:
    """Whether a peer leads or follows; there is one formation in a swarm."""
    return beacon.slot is not None or beacon.leadership is not None


def has_come_to_grief(beacon: Beacon) -> bool:
    """Whether a peer says that it cannot go on, so that it is an obstacle and not waited for."""
    return beacon.mode == "FAILED" or beacon.reason in ("motors", "sensors")


def stands(beacon: Beacon) -> bool:
    """Whether a peer waits or has nowhere to go, so that others must go round it."""
    return beacon.arrived or beacon.yields_to is not None or beacon.mode in ("HOLD", "FAILED")


def _is_plausible(beacon: Beacon) -> bool:
    pose, twist, promise = beacon.pose, beacon.twist, beacon.promise
    rates = abs(twist.speed_mps) + abs(twist.turn_rate_radps)
    if promise is not None and promise.pending:
        for under_way in promise.pending:
            rates = max(rates, abs(under_way.speed_mps) + abs(under_way.turn_rate_radps))
    return (
        abs(pose.x_m) + abs(pose.y_m) <= COORDINATE_M_MAX
        and rates + abs(beacon.formation_turn_rate_radps) <= RATE_MAX
        and abs(beacon.formation_heading_rad) + abs(beacon.bearing_now_rad) <= RATE_MAX
    )
