"""One robot, one tick: what it senses and hears goes in, what it does and says comes out.

    frame --hear, elect--> peers --look--> map --decide--> wish --give way, slew, guard--> Command
                                            |-- seek    a goal: leader, or alone
                                            |-- follow  a slot, while its leader is heard
                                            '-- hold    nothing to do, or nobody to follow

Whether a member of a formation leads or follows is decided in every tick: a setup only says how it
begins.

Pure: the same setup, state and frame give the same state and command, on any machine with this
lock file. All that is remembered is in State.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite

import msgspec

from agents import (
    controllers,
    election,
    follow,
    formation,
    guard,
    health,
    lateness,
    mission,
    msam,
    navigator,
    peers,
    pid,
    pilot,
    places,
    priority,
    seek,
    steering,
)
from agents.mission import Mission
from agents.peers import Body, Peer
from agents.priority import Role
from agents.steering import Wish
from swarm import geometry, messages
from swarm.geometry import STILL, Pose, Twist
from swarm.messages import Beacon, Command, Intent, SensorFrame, Slot, Trace
from swarm.scenario import RobotSetup

# Timers never advance by more than this in one step, however many frames were missed.
ELAPSED_S_MAX = 1.0
# A guard that allows less than this holds a robot.
HELD_MPS = 0.05
# A leader goes at less than this share of its speed for one that lags, but not for longer.
WAITING_FACTOR = 0.5
WAITING_S_MAX = 20.0
# A follower that does not hear a leader that lives goes after it when that has lasted for so long.
GO_AFTER_S = 2.0


class State(msgspec.Struct, frozen=True):
    """Everything a robot remembers from tick to tick."""

    incarnation: int = 0
    tick: int = -1  # of the last frame; -1 before the first
    command: Twist = STILL  # last set-point
    twist: Twist = STILL  # measured in the last frame
    limited: bool = False  # the last set-point was not the one the mode asked for
    held_by: str = ""  # peer right in front that did not let it move
    peers: tuple[Beacon, ...] = ()  # newest of each, in order of names
    bodies: tuple[Body, ...] = ()  # of those that are not heard any more
    fit: bool = False  # whether it could lead
    slot: Slot | None = None  # of a follower; a leader keeps it in mind
    election: election.State = election.State()
    mission: Mission | None = None  # None while it is not known
    formation_heading_rad: float | None = None  # theta_F, None while it is not known
    formation_turn_rate_radps: float = 0.0
    places: places.State = places.State()  # of a leader
    waited_s: float = 0.0  # of a leader: slowed down for one that lags
    seeking: seek.State = seek.State()
    navigating: navigator.State = navigator.State()
    following: follow.State = follow.State()
    unheard_s: float = 0.0  # of a follower: its leader lives, but is out of earshot
    waiting: priority.State = priority.State()
    health: health.State = health.State()
    own: object = None  # memory of a controller of one's own
    lateness: lateness.State = lateness.State()


def init(setup: RobotSetup, incarnation: int = 0) -> State:
    """Before the first frame."""
    robot = setup.robot
    knows = robot.goal is not None or setup.leads
    return State(
        incarnation=incarnation,
        fit=knows,
        slot=setup.slot,
        election=election.init(
            robot.name,
            priority.claim("leader", None, setup.row),
            leads=setup.leads,
            incarnation=incarnation,
            patience_ticks=patience_ticks(setup),
        ),
        mission=Mission(robot.goal, robot.via) if knows else None,
        following=follow.init(setup),
        lateness=lateness.State(late_ticks=setup.disturbance.latency_ticks),
    )


def step(setup: RobotSetup, state: State, frame: SensorFrame) -> tuple[State, Command]:
    """Next state and the answer to one frame.

    Set-points are slewed from the measured twist, not from the last command: after a brake or a
    missed tick the body is where it is, whatever it was told.
    """
    elapsed_s = setup.dt_s
    if state.tick >= 0:
        elapsed_s = min(ELAPSED_S_MAX, max(1, frame.tick - state.tick) * setup.dt_s)

    late, before = state.lateness, state.twist
    if setup.robot.motion == "kinematic":  # what motors with torques do lags without being late
        declared = setup.disturbance.latency_ticks
        late = lateness.step(late, frame.twist, frame.tick - state.tick, declared)
    drives = role_of(setup, state) == "alone" and setup.robot.controller == "navigator"
    if drives or (role_of(setup, state) != "alone" and navigates(setup)):
        navigating, frame = navigator.locate(setup, state.navigating, frame)
        state = msgspec.structs.replace(state, navigating=navigating)

    # 1. Hear: newest beacons, moved on to this tick; who leads, where to.
    sane = is_sane(frame)
    state, others = hear(setup, state, frame, sane, elapsed_s)
    role = role_of(setup, state)
    if frame.goal is not None and role != "follower":
        errand = Mission(frame.goal)
        navigating = navigator.redirect(state.navigating)
        state = msgspec.structs.replace(
            state, mission=errand, seeking=seek.State(), navigating=navigating
        )

    # 2. Look: the map, without the bodies that are dealt with as peers.
    masked = [peer for peer in others if is_masked(setup, role, peer)] if others else others
    if drives:
        map, complete = navigator.see(setup, frame.ranges_m(), masked)
    else:
        ranges_m, complete = health.known_ranges(frame.ranges_m())
        map = msam.update(setup, ranges_m, masked)
    well = health.step(
        setup, state.health, frame, map, others, state.command, trusted=sane and complete
    )
    state = msgspec.structs.replace(state, health=well)
    complaint = health.complaint(well)

    # 3. Decide.
    if frame.contact:
        wish = Wish(mode="FAILED", reason="contact")
    elif complaint == "sensors":
        wish = Wish(mode="HOLD", reason="sensors")
    else:
        state, wish = decide(setup, state, role, frame, map, others, masked, elapsed_s, late)
        if complaint == "motors":  # it goes on asking, so it notices when they come back
            wish = msgspec.structs.replace(wish, mode="HOLD", reason="motors")

    # 4. Give way, slew, guard.
    claim = priority.claim(role, state.slot, setup.row)
    waiting = state.waiting
    if not drives:  # it gives way in its own manner
        waiting = priority.step(
            setup,
            waiting,
            role,
            claim,
            frame.pose,
            frame.twist,
            wish.direction_rad(frame.pose.yaw_rad),
            others if wish.mode in ("GO", "FORM", "AVOID") else (),
            elapsed_s,
        )
    asked = Twist(0.0 if waiting.yields_to else wish.speed_mps, wish.turn_rate_radps)
    if drives:
        bodies = [peer for peer in others if peer.beacon.promise or is_masked(setup, role, peer)]
        unsure = wish.reason in ("contact", "sensors") or not is_finite(asked)
        navigating, set_point, allowed = navigator.hold(
            setup, state.navigating, frame, map, bodies, late, STILL if unsure else asked
        )
        state = msgspec.structs.replace(state, navigating=navigating)
    else:
        set_point, allowed = restrain(setup, frame, late, asked, map, others)
    if wish.reason in ("contact", "sensors") or not is_finite(set_point):
        set_point = Twist(0.0, health.PROBE_RADPS) if probes(frame, well) else STILL
    limited = wish.saturated or waiting.yields_to is not None or set_point != asked
    fit = state.mission is not None and can_lead(role, wish, well)
    state = msgspec.structs.replace(
        state,
        waiting=waiting,
        command=set_point,
        limited=limited,
        held_by=allowed.by if allowed.by != "brake" and allowed.speed_mps < HELD_MPS else "",
        fit=fit,
        twist=frame.twist,
        lateness=lateness.send(late, set_point),
    )

    # 5. Say.
    said = beacon(setup, state, role, claim, others, frame, wish, late, before)
    if drives:
        state = msgspec.structs.replace(
            state, navigating=navigator.send(setup, state.navigating, said)
        )
    command = Command(
        robot=setup.robot.name,
        tick=frame.tick,
        stamp_ns=frame.stamp_ns,
        set_point=set_point,
        beacon=said,
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


def patience_ticks(setup: RobotSetup) -> int:
    """How old a beacon may be to count, and how long a leader may be silent."""
    return int(setup.priority.stale_s / setup.dt_s + 1e-9)


def role_of(setup: RobotSetup, state: State) -> Role:
    """What the robot is in this tick; alone: it belongs to no formation."""
    if not setup.leads and setup.slot is None:
        return "alone"
    return "leader" if state.election.leads else "follower"


def hear(
    setup: RobotSetup, state: State, frame: SensorFrame, sane: bool, elapsed_s: float
) -> tuple[State, list[Peer]]:
    """State after what was heard in this tick, and the peers as they are now."""
    patience = patience_ticks(setup)
    robot, tick = setup.robot, frame.tick
    known = peers.remember(state.peers, frame.beacons, robot.name, tick, patience)
    others = peers.now(known, frame.pose, tick, setup.dt_s) if sane else []
    bodies = peers.lose(state.bodies, state.peers, known, setup.dt_s)
    replace = msgspec.structs.replace
    if not setup.leads and setup.slot is None:
        return replace(state, tick=tick, peers=known, bodies=bodies), others
    led = state.election.leads
    elected = election.step(
        state.election,
        robot.name,
        priority.claim("leader" if led else "follower", state.slot, setup.row),
        known,
        tick,
        tick - state.tick,
        fit=state.fit,
        patience_ticks=patience,
    )
    state = replace(state, tick=tick, peers=known, bodies=bodies, election=elected)
    if not elected.leads:
        return learn(state, robot.name, others), others
    if not led:
        state = take_over(setup, state, frame, others)
    heading_rad = state.formation_heading_rad
    heading_rad = (
        frame.pose.yaw_rad
        if heading_rad is None
        else geometry.wrap_angle(heading_rad + state.formation_turn_rate_radps * elapsed_s)
    )
    return replace(state, formation_heading_rad=heading_rad), others


def learn(state: State, name: str, others: list[Peer]) -> State:
    """State of a follower after what its leader says: mission, theta_F, perhaps another slot."""
    leader = leader_of(state, others)
    errand = mission.learn(state.mission, leader, others)
    if leader is None:
        return msgspec.structs.replace(state, mission=errand)
    slot = dict(leader.beacon.assignments).get(name, state.slot)
    goal = formation.goal_of(leader)
    return msgspec.structs.replace(
        state, mission=errand, slot=slot, formation_heading_rad=goal.heading_rad
    )


def take_over(setup: RobotSetup, state: State, frame: SensorFrame, others: list[Peer]) -> State:
    """State of a follower that has just become the leader: the mission of the one before it."""
    assert state.mission is not None
    standing = [
        Body(peer.beacon.name, peer.pose.x_m, peer.pose.y_m, peer.beacon.body_radius_m)
        for peer in others
        if peers.has_come_to_grief(peer.beacon)
    ]
    errand = mission.take_over(
        state.mission, frame.pose, setup.robot.body_radius_m, [*state.bodies, *standing]
    )
    return msgspec.structs.replace(
        state,
        mission=errand,
        formation_turn_rate_radps=0.0,
        places=places.State(elected=True),
        seeking=seek.State(),
        navigating=navigator.redirect(state.navigating),
    )


def is_sane(frame: SensorFrame) -> bool:
    """Whether a frame can come from a world at all; nothing is done about one that cannot."""
    return (
        max(abs(frame.pose.x_m), abs(frame.pose.y_m)) <= peers.COORDINATE_M_MAX
        and max(abs(frame.twist.speed_mps), abs(frame.twist.turn_rate_radps)) <= peers.RATE_MAX
    )


def is_finite(twist: Twist) -> bool:
    """Whether a set-point is one that motors could be given."""
    return isfinite(twist.speed_mps) and isfinite(twist.turn_rate_radps)


def probes(frame: SensorFrame, well: health.State) -> bool:
    """Whether to turn on the spot, so as to see whether a frozen scan changes."""
    return well.frozen and not frame.contact


def is_masked(setup: RobotSetup, role: Role, peer: Peer) -> bool:
    """Whether a peer's body is left out of the map, because rules and forces deal with it.

    In a formation: the other members, but not one that has come to grief, nor one in front of the
    leader: it may be unable to get out of the way, and then the leader goes round it. Else: peers
    that move, which the right of way deals with; one that stands is an obstacle to go round. Where
    robots treat each other as moving obstacles they all stay on the map.
    """
    if role == "alone" and peer.beacon.promise and setup.robot.controller == "navigator":
        return not peers.has_come_to_grief(peer.beacon)
    if role == "leader" and peer.offset_body[0] > abs(peer.offset_body[1]):
        return False
    if role != "alone":
        if peers.is_in_formation(peer.beacon):
            return not peers.has_come_to_grief(peer.beacon)
    elif setup.robot.controller != "navigator" and setup.priority.strategy == "mutual":
        return False
    return not peers.stands(peer.beacon)


def decide(
    setup: RobotSetup,
    state: State,
    role: Role,
    frame: SensorFrame,
    map: msam.Map,
    others: list[Peer],
    masked: list[Peer],
    elapsed_s: float,
    late: lateness.State,
) -> tuple[State, Wish]:
    """State and wish of the mode that is in force. The only place that knows controllers."""
    if role != "alone" and navigates(setup):
        navigating = pilot.watch(setup, state.navigating, frame, map, others, masked, elapsed_s)
        state = msgspec.structs.replace(state, navigating=navigating)
    if role == "leader":
        return lead(setup, state, frame, map, others, elapsed_s)
    replace = msgspec.structs.replace
    if role == "follower":
        leader = leader_of(state, others)
        if leader is None or state.slot is None:
            return lose_touch(setup, state, frame, map, others, elapsed_s)
        if leader.beacon.reason in ("enclosed", "too-long"):
            return state, Wish(mode="FAILED", reason="leader")
        following, found, wish = follow.step(
            setup,
            state.following,
            state.navigating if navigates(setup) else None,
            frame,
            map,
            others,
            formation.goal_of(leader),
            state.slot,
            priority.claim(role, state.slot, setup.row),
            held_by=state.held_by,
            frozen=state.limited,
            waiting=is_held_up(state),
            elapsed_s=elapsed_s,
        )
        state = replace(state, following=following, unheard_s=0.0)
        return state if found is None else replace(state, navigating=found), wish
    errand = state.mission or Mission(setup.robot.goal, setup.robot.via)
    if errand.goal is None:
        return state, Wish(mode="HOLD")
    if (own := controllers.of(setup.robot.controller)) is not None:
        bound = mission.bound_for(setup, errand)
        memory, wish = own(bound, state.own, frame, map, others)
        return replace(state, own=memory), wish
    if setup.robot.controller == "navigator":
        bound = mission.bound_for(setup, errand)
        navigating, wish = navigator.step(
            bound, state.navigating, frame, map, others, masked, elapsed_s, late
        )
        return replace(state, navigating=navigating), wish
    seeking, wish = seek.step(
        mission.bound_for(setup, errand),
        state.seeking,
        frame.pose,
        map,
        others,
        speed_mps=setup.robot.speed_mps_max,
    )
    return replace(state, seeking=seeking), wish


def lose_touch(
    setup: RobotSetup,
    state: State,
    frame: SensorFrame,
    map: msam.Map,
    others: list[Peer],
    elapsed_s: float,
) -> tuple[State, Wish]:
    """A follower that does not hear its leader: it holds, and after a while it goes after it.

    Others pass on that the leader lives, so it is out of earshot, on its way to the goal that the
    follower knows, or there: the formation went on without one that was held up for long.
    """
    replace = msgspec.structs.replace
    tracking = pid.reset(state.following.tracking)
    state = replace(state, following=replace(state.following, tracking=tracking, rest_s=0.0))
    lives = election.is_followed(state.election, patience_ticks(setup))
    if not lives or state.mission is None or state.mission.goal is None:
        return replace(state, unheard_s=0.0), Wish(mode="HOLD")
    unheard_s = state.unheard_s + elapsed_s
    if unheard_s <= GO_AFTER_S:
        navigating = navigator.redirect(state.navigating)
        state = replace(state, unheard_s=unheard_s, seeking=seek.State(), navigating=navigating)
        return state, Wish(mode="HOLD")
    state, wish = go(
        setup, state, frame, map, others, elapsed_s, speed_mps=setup.robot.cruise_speed_mps
    )
    if wish.mode in ("ARRIVED", "FAILED"):
        wish = Wish(mode="HOLD")
    return replace(state, unheard_s=unheard_s), wish


def go(
    setup: RobotSetup,
    state: State,
    frame: SensorFrame,
    map: msam.Map,
    pushed_by: Sequence[Peer],
    elapsed_s: float,
    *,
    speed_mps: float,
) -> tuple[State, Wish]:
    """A member of a formation on its own way to the goal of its mission.

    Args:
        pushed_by: peers whose forces push it off.
        speed_mps: to drive at where nothing is in the way.
    """
    assert state.mission is not None
    replace = msgspec.structs.replace
    if navigates(setup):
        bound = mission.bound_for(setup, state.mission)
        navigating, aim = pilot.to_goal(
            bound, state.navigating, frame, map, held=is_held_up(state), elapsed_s=elapsed_s
        )
        wish = seek.along(bound, aim, frame.pose, map, pushed_by, speed_mps=speed_mps)
        return replace(state, navigating=navigating), wish
    seeking, wish = seek.step(
        mission.bound_for(setup, state.mission),
        state.seeking,
        frame.pose,
        map,
        pushed_by,
        speed_mps=speed_mps,
    )
    return replace(state, seeking=seeking), wish


def lead(
    setup: RobotSetup,
    state: State,
    frame: SensorFrame,
    map: msam.Map,
    others: list[Peer],
    elapsed_s: float,
) -> tuple[State, Wish]:
    """A leader's tick: towards the goal, no faster than the last can follow; who has which slot."""
    assert setup.formation is not None
    assert state.mission is not None
    assert state.formation_heading_rad is not None
    pose, heading_rad = frame.pose, state.formation_heading_rad
    followers = [peer for peer in others if is_led(peer)]
    wish = Wish(mode="HOLD")
    rate_radps, waited_s = 0.0, 0.0
    if state.mission.goal is not None:
        factor = formation.pace(setup.formation, formation.lag(heading_rad, pose, followers))
        waited_s = state.waited_s + elapsed_s if factor < WAITING_FACTOR else 0.0
        if waited_s > WAITING_S_MAX:
            factor = WAITING_FACTOR
        slowest_mps = formation.slowest(setup, followers)
        cruise_mps = formation.cruise(setup, slowest_mps)
        state, wish = go(setup, state, frame, map, (), elapsed_s, speed_mps=cruise_mps * factor)
        if wish.reason == "enclosed":
            state, wish = stop_beside(setup, state, pose, wish)
        if not wish.arrived:
            spare_mps = slowest_mps - cruise_mps
            rate_radps = formation.turn(setup, heading_rad, pose.yaw_rad, spare_mps)
    plan = places.step(
        state.places,
        setup.places,
        pose,
        heading_rad,
        followers,
        [(body.x_m, body.y_m) for body in state.bodies],
        clear_m=2.0 * setup.robot.body_radius_m + mission.BESIDE_M,
        arrived=wish.arrived,
    )
    return msgspec.structs.replace(
        state,
        places=plan,
        formation_turn_rate_radps=rate_radps,
        waited_s=waited_s,
    ), wish


def navigates(setup: RobotSetup) -> bool:
    """Whether a member of a formation finds its way by a map with memory."""
    return setup.robot.controller != "paper"


def stop_beside(setup: RobotSetup, state: State, pose: Pose, wish: Wish) -> tuple[State, Wish]:
    """State of a leader that finds no way: where a body stands on its goal, it goes beside that.

    Another leader has come to grief there since this one was elected.
    """
    assert state.mission is not None
    before = Mission(state.mission.goal)
    errand = mission.take_over(before, pose, setup.robot.body_radius_m, state.bodies)
    if errand == before:
        return state, wish
    passed = state.navigating.via_index
    navigating = msgspec.structs.replace(navigator.redirect(state.navigating), via_index=passed)
    errand = Mission(errand.goal, state.mission.via)
    state = msgspec.structs.replace(state, mission=errand, navigating=navigating)
    return state, Wish(mode="HOLD")


def told(
    setup: RobotSetup, state: State, before: Twist, frame: SensorFrame, late: lateness.State
) -> Twist:
    """Twist that peers may reckon with: the set-point, but not of a body that stops without it."""
    robot = setup.robot
    brakes_mps = robot.acceleration_mps2_max * setup.dt_s
    if robot.motion == "kinematic" and lateness.stops(late, before, frame.twist, brakes_mps):
        return navigator.braked(setup, frame.twist)
    return state.command


def is_held_up(state: State) -> bool:
    """Whether something else than the way keeps the robot, so that clocks of the way stand."""
    return (
        state.waiting.yields_to is not None
        or health.complaint(state.health) == "motors"
        or (state.election.leads and state.held_by != "")
    )


def is_led(peer: Peer) -> bool:
    """Whether a leader counts with a peer: waits for it, and gives it a slot."""
    return peers.is_in_formation(peer.beacon) and not peers.has_come_to_grief(peer.beacon)


def can_lead(role: Role, wish: Wish, well: health.State) -> bool:
    """Whether a robot in this role with such a wish is good for a leader.

    A leader that finds no way to the goal stays leader: nobody else would find one. One that sees
    nothing stays it for a moment.
    """
    if role == "leader":
        briefly = wish.reason == "sensors" and well.blind_s <= health.BLIND_S
        return briefly or wish.reason in ("", "enclosed", "too-long")
    return role == "follower" and wish.reason == ""


def leader_of(state: State, others: list[Peer]) -> Peer | None:
    """Peer that holds the highest leadership known, None while it is silent or does not lead."""
    leadership = state.election.leadership
    if leadership is None:
        return None
    for peer in others:
        if peer.beacon.name == leadership.name:
            return peer if election.leads(peer.beacon) else None
    return None


def restrain(
    setup: RobotSetup,
    frame: SensorFrame,
    late: lateness.State,
    asked: Twist,
    map: msam.Map,
    others: list[Peer],
) -> tuple[Twist, guard.Limit]:
    """Set-point within acceleration, guards and wheel speeds, in this order: guards overrule."""
    # A peer that is not heard may go on, or may have died and stopped: neither may be touched.
    bodies = [*others, *peers.halted(others, frame.pose, setup.dt_s)]
    base, late_s = lateness.base(late, frame.twist), late.late_ticks * setup.dt_s
    held, allowed = guard.hold(setup, base, asked, map, bodies, late_s=late_s)
    return steering.scale_to_rims(setup.robot, held), allowed


def beacon(
    setup: RobotSetup,
    state: State,
    role: Role,
    claim: priority.Claim,
    others: list[Peer],
    frame: SensorFrame,
    wish: Wish,
    late: lateness.State,
    before: Twist,
) -> Beacon:
    """What this robot tells its peers about itself.

    Its twist is the set-point, which the body can reach in this tick and has when the beacon is
    heard; with the measured one, a tick older, followers stop up to 0.03 m from their slots.
    """
    robot = setup.robot
    leads = role == "leader"
    errand = state.mission
    passed = max(state.seeking.via_index, state.navigating.via_index)
    elected = state.election
    followed = election.is_followed(elected, patience_ticks(setup))
    drives = role == "alone" and robot.controller == "navigator"
    keeps = wish.reason not in ("motors", "contact", "sensors")
    twist = told(setup, state, before, frame, late) if drives else state.command
    promise = None
    if drives and keeps:
        promise = navigator.promise(setup, state.navigating, frame, late, twist)
    return Beacon(
        name=robot.name,
        tick=frame.tick,
        incarnation=state.incarnation,
        pose=navigator.place(state.navigating, frame) if drives else frame.pose,
        twist=STILL if wish.reason == "motors" else twist,
        body_radius_m=robot.body_radius_m,
        speed_mps_max=robot.speed_mps_max,
        mode=wish.mode,
        arrived=wish.arrived,
        priority=claim,
        slot=None if leads else state.slot,
        bearing_now_rad=0.0 if leads else state.following.bearing_now_rad,
        leadership=elected.leadership,
        leader_tick=elected.leader_tick if followed else None,
        fit=state.fit and elected.listen_ticks == 0,
        assignments=places.changes(state.places, others) if leads else (),
        goal=None if errand is None else errand.goal,
        via=() if errand is None else errand.via[0 if role == "follower" else passed :],
        formation_heading_rad=(state.formation_heading_rad or 0.0) if leads else 0.0,
        formation_turn_rate_radps=state.formation_turn_rate_radps if leads else 0.0,
        yields_to=state.navigating.yields_to if drives else state.waiting.yields_to,
        reason=wish.reason,
        promise=promise,
        intent=(state.navigating.intent if keeps else Intent()) if drives else None,
        passage=state.navigating.giving.passage if drives and keeps else None,
    )
