"""One robot, one tick: what it senses and hears goes in, what it does and says comes out.

    frame --hear--> peers --look--> map --decide--> wish --give way, slew, guard--> Command
                                     |-- seek    a goal of its own: leader, or alone
                                     |-- follow  a slot, while its leader is heard
                                     '-- hold    nothing to do, or nobody to follow

Pure: the same setup, state and frame give the same state and command, on any machine with this
lock file. All that is remembered is in State.
"""

from __future__ import annotations

import msgspec

from agents import follow, formation, guard, msam, peers, pid, priority, seek, steering
from agents.peers import Peer
from agents.steering import Wish
from swarm import geometry, messages
from swarm.geometry import STILL, Twist
from swarm.messages import Beacon, Command, Leadership, SensorFrame, Trace
from swarm.scenario import RobotSetup

# Timers never advance by more than this in one step, however many frames were missed.
ELAPSED_S_MAX = 1.0


class State(msgspec.Struct, frozen=True):
    """Everything a robot remembers from tick to tick."""

    incarnation: int = 0
    tick: int = -1  # of the last frame; -1 before the first
    command: Twist = STILL  # last set-point
    limited: bool = False  # the last set-point was not the one the mode asked for
    peers: tuple[Beacon, ...] = ()  # newest of each, in order of names
    leadership: Leadership | None = None
    formation_heading_rad: float = 0.0  # theta_F, of a leader
    formation_turn_rate_radps: float = 0.0
    seeking: seek.State = seek.State()
    following: follow.State = follow.State()
    waiting: priority.State = priority.State()


def init(setup: RobotSetup, incarnation: int = 0) -> State:
    """Before the first frame. A formation's leader begins with a claim of term 0."""
    own = Leadership(0, priority.claim(setup), setup.robot.name) if setup.leads else None
    return State(incarnation=incarnation, leadership=own, following=follow.init(setup))


def step(setup: RobotSetup, state: State, frame: SensorFrame) -> tuple[State, Command]:
    """Next state and the answer to one frame.

    Set-points are slewed from the measured twist, not from the last command: after a brake or a
    missed tick the body is where it is, whatever it was told.
    """
    elapsed_s = setup.dt_s
    if state.tick >= 0:
        elapsed_s = min(ELAPSED_S_MAX, max(1, frame.tick - state.tick) * setup.dt_s)
    state = start(setup, state, frame, elapsed_s)

    # 1. Hear: newest beacons, moved on to this tick.
    ticks_max = int(setup.priority.stale_s / setup.dt_s + 1e-9)
    known = peers.remember(state.peers, frame.beacons, setup.robot.name, frame.tick, ticks_max)
    sane = is_sane(frame)
    others = peers.now(known, frame.pose, frame.tick, setup.dt_s) if sane else []
    leadership = state.leadership
    if setup.leads or setup.slot is not None:
        leadership = priority.highest(leadership, others)
    state = msgspec.structs.replace(state, tick=frame.tick, peers=known, leadership=leadership)

    # 2. Look: the map, without the bodies that are dealt with as peers.
    map = msam.update(setup, frame.ranges_m(), [peer for peer in others if is_masked(setup, peer)])

    # 3. Decide.
    wish = Wish(mode="FAILED", reason="contact" if sane else "sensors")
    if sane and not frame.contact:
        state, wish = decide(setup, state, frame, map, others, elapsed_s)

    # 4. Give way, slew, guard.
    waiting = priority.step(
        setup,
        state.waiting,
        frame.pose,
        frame.twist,
        wish.direction_rad(frame.pose.yaw_rad),
        others if wish.mode in ("GO", "ROUND", "FORM", "AVOID") else (),
        elapsed_s,
    )
    asked = Twist(0.0 if waiting.yields_to else wish.speed_mps, wish.turn_rate_radps)
    set_point, allowed = restrain(setup, frame, asked, map, others)
    if frame.contact or not sane:
        set_point = STILL
    limited = wish.saturated or waiting.yields_to is not None or set_point != asked
    state = msgspec.structs.replace(state, waiting=waiting, command=set_point, limited=limited)

    # 5. Say.
    command = Command(
        robot=setup.robot.name,
        tick=frame.tick,
        stamp_ns=frame.stamp_ns,
        set_point=set_point,
        beacon=beacon(setup, state, frame, wish),
        trace=Trace(
            sectors=messages.floats(map.sectors_m),
            arcs=map.arcs,
            forces=wish.forces,
            waypoint=wish.waypoint,
            gains=state.following.tracking.gains,
            error=wish.error,
            speed_limit_mps=allowed.speed_mps,
            limited_by=allowed.by,
        ),
    )
    return state, command


def start(setup: RobotSetup, state: State, frame: SensorFrame, elapsed_s: float) -> State:
    """State with theta_F of this tick: turned on as announced, at first the robot's own heading."""
    if not setup.leads:
        return state
    heading_rad = frame.pose.yaw_rad
    if state.tick >= 0:
        heading_rad = geometry.wrap_angle(
            state.formation_heading_rad + state.formation_turn_rate_radps * elapsed_s
        )
    return msgspec.structs.replace(state, formation_heading_rad=heading_rad)


def is_sane(frame: SensorFrame) -> bool:
    """Whether a frame can come from a world at all; nothing is done about one that cannot."""
    return (
        max(abs(frame.pose.x_m), abs(frame.pose.y_m)) <= peers.COORDINATE_M_MAX
        and max(abs(frame.twist.speed_mps), abs(frame.twist.turn_rate_radps)) <= peers.RATE_MAX
    )


def is_masked(setup: RobotSetup, peer: Peer) -> bool:
    """Whether a peer's body is left out of the map, because rules and forces deal with it.

    In a formation: the other members, but not one that has come to grief. Else: peers that move,
    which the right of way deals with; one that stands is an obstacle to go round. Where robots
    treat each other as moving obstacles they all stay on the map.
    """
    if setup.leads or setup.slot is not None:
        if peers.is_in_formation(peer.beacon):
            return peer.beacon.mode != "FAILED"
    elif setup.priority.strategy == "mutual":
        return False
    return not peers.stands(peer.beacon)


def decide(
    setup: RobotSetup,
    state: State,
    frame: SensorFrame,
    map: msam.Map,
    others: list[Peer],
    elapsed_s: float,
) -> tuple[State, Wish]:
    """State and wish of the mode that is in force. The only place that knows controllers."""
    extended = setup.robot.controller == "extended"
    pose = frame.pose
    replace = msgspec.structs.replace
    if setup.slot is not None:
        leader = leader_of(state, others)
        if leader is None:
            tracking = pid.reset(state.following.tracking)
            following = replace(state.following, tracking=tracking, rest_s=0.0)
            return replace(state, following=following), Wish(mode="HOLD")
        if leader.beacon.reason in ("enclosed", "too-long"):
            return state, Wish(mode="FAILED", reason="leader")
        following, wish = follow.step(
            setup,
            state.following,
            pose,
            frame.twist,
            map,
            others,
            follow.goal_of(leader),
            extended=extended,
            frozen=state.limited,
            elapsed_s=elapsed_s,
        )
        return replace(state, following=following), wish
    if setup.robot.goal is None:
        return state, Wish(mode="HOLD")
    speed_mps = slowest_mps = cruise_mps = setup.robot.speed_mps_max
    if setup.leads and setup.formation is not None:
        followers = [peer for peer in others if peer.beacon.slot is not None]
        lag_m = formation.lag(state.formation_heading_rad, pose, followers)
        slowest_mps = formation.slowest(setup, followers)
        cruise_mps = formation.cruise(setup, slowest_mps)
        speed_mps = cruise_mps * formation.pace(setup.formation, lag_m)
    seeking, wish = seek.step(
        setup,
        state.seeking,
        pose,
        map,
        () if setup.leads else others,
        speed_mps=speed_mps,
        extended=extended,
        waiting=state.waiting.yields_to is not None,
        elapsed_s=elapsed_s,
    )
    state = replace(state, seeking=seeking)
    if setup.leads:
        rate_radps = (
            0.0
            if wish.arrived
            else formation.turn(
                setup, state.formation_heading_rad, pose.yaw_rad, slowest_mps - cruise_mps
            )
        )
        state = replace(state, formation_turn_rate_radps=rate_radps)
    return state, wish


def leader_of(state: State, others: list[Peer]) -> Peer | None:
    """Peer that holds the highest leadership known, None while it is silent."""
    if state.leadership is None:
        return None
    for peer in others:
        if peer.beacon.name == state.leadership.name:
            return peer
    return None


def restrain(
    setup: RobotSetup,
    frame: SensorFrame,
    asked: Twist,
    map: msam.Map,
    others: list[Peer],
) -> tuple[Twist, guard.Limit]:
    """Set-point within acceleration, guards and wheel speeds, in this order: guards overrule."""
    held, allowed = guard.hold(setup, frame.twist, asked, map, others)
    return steering.scale_to_rims(setup.robot, held), allowed


def beacon(setup: RobotSetup, state: State, frame: SensorFrame, wish: Wish) -> Beacon:
    """What this robot tells its peers about itself.

    Its twist is the set-point, which the body can reach in this tick and has when the beacon is
    heard; with the measured one, a tick older, followers stop up to 0.03 m from their slots.
    """
    robot = setup.robot
    return Beacon(
        name=robot.name,
        tick=frame.tick,
        incarnation=state.incarnation,
        pose=frame.pose,
        twist=state.command,
        body_radius_m=robot.body_radius_m,
        speed_mps_max=robot.speed_mps_max,
        mode=wish.mode,
        arrived=wish.arrived,
        priority=priority.claim(setup),
        slot=setup.slot,
        bearing_now_rad=state.following.bearing_now_rad,
        leadership=state.leadership,
        goal=robot.goal,
        via=robot.via[state.seeking.via_index :],
        formation_heading_rad=state.formation_heading_rad,
        formation_turn_rate_radps=state.formation_turn_rate_radps,
        yields_to=state.waiting.yields_to,
        reason=wish.reason,
    )
