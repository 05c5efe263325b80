"""What a robot promises: the room it keeps around its announced way, by declared bounds only.

body, doubts, what is under way --declared errors--> room --beacon--> all peers
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from agents.navigator import announce, brake
from agents.navigator.compiled import compiled
from agents.navigator.estimate import Doubt
from swarm.geometry import STILL, Floats, Twist
from swarm.messages import Promise
from swarm.scenario import RobotSetup

# Kept between bodies over what errors ask for, by each of two.
GAP_M = 0.02

# The body may be off the announced way by this: what noise makes of it is in the pad. Beyond, it
# missed a tick or its motors do not follow, and only what it can do from here counts.
OFF_M = 0.02
NO_DOUBT = Doubt()


@lru_cache(maxsize=1024)
def pad_m(setup: RobotSetup, clock_error_s: float = 0.0) -> float:
    """Room around a body for what is not as announced even where all poses are exact.

    Between two ticks a straight relative way of (v_i + v_j) dt comes nearer than its ends by its
    square over 8 times the distance, of which each robot's part is at most v^2 dt^2 / (8 r), and
    an arc leaves its chord by v dt omega dt / 8.
    """
    robot, dt_s = setup.robot, setup.dt_s
    step_m = robot.speed_mps_max * dt_s
    chord_m = step_m * step_m / (8.0 * robot.body_radius_m)
    arc_m = step_m * robot.turn_rate_radps_max * dt_s / 8.0
    lag_m = robot.speed_mps_max / robot.velocity_gain_1ps if robot.motion == "dynamic" else 0.0
    return GAP_M + chord_m + arc_m + lag_m + robot.speed_mps_max * clock_error_s


def promise(
    setup: RobotSetup,
    set_point: Twist = STILL,
    doubt: Doubt = NO_DOUBT,
    pending: tuple[Twist, ...] = (),
) -> Promise:
    """What this robot promises in a beacon.

    Args:
        doubt: about the pose in it.
        pending: twists under way.
    """
    if not pending and doubt == NO_DOUBT and setup.disturbance.speed_error == 0.0:
        return _exact(setup)
    return _promise(setup, set_point, doubt, pending)


@lru_cache(maxsize=1024)
def _exact(setup: RobotSetup) -> Promise:
    """Promise at any set-point where nothing is off: then the room is the same all the way."""
    return _promise(setup, STILL, NO_DOUBT, ())


def _promise(
    setup: RobotSetup, set_point: Twist, doubt: Doubt, pending: tuple[Twist, ...]
) -> Promise:
    robot = setup.robot
    brakes_mps2 = brake.brakes_mps2(setup)
    brakes_radps2 = robot.turn_acceleration_radps2_max
    rates = (set_point.speed_mps, set_point.turn_rate_radps)
    body = np.array((*(0.0,) * 4, *rates, brakes_mps2 * setup.dt_s, brakes_radps2 * setup.dt_s))
    return Promise(
        deceleration_mps2=brakes_mps2,
        turn_deceleration_radps2=brakes_radps2,
        keep_m=float(keep(body, doubts(setup, doubt, pending), setup.dt_s)),
        pending=pending,
    )


def doubts(setup: RobotSetup, doubt: Doubt, pending: tuple[Twist, ...]) -> Floats:
    """(6,) of `keep`."""
    if not pending and doubt == NO_DOUBT:
        return _no_doubts(setup)
    return _some_doubts(setup, doubt, pending)


@lru_cache(maxsize=1024)
def _no_doubts(setup: RobotSetup) -> Floats:
    return _some_doubts(setup, NO_DOUBT, ())


def _some_doubts(setup: RobotSetup, doubt: Doubt, pending: tuple[Twist, ...]) -> Floats:
    way_m = sum([abs(twist.speed_mps) * setup.dt_s for twist in pending])
    turn_rad = sum([abs(twist.turn_rate_radps) * setup.dt_s for twist in pending])
    room_m = setup.robot.body_radius_m + pad_m(setup) + doubt.position_m
    share = setup.disturbance.speed_error
    return np.array((room_m, doubt.yaw_rad, way_m, turn_rad, share, 0.0))


@lru_cache(maxsize=1024)
def shown_errors(setup: RobotSetup) -> Floats:
    """(3,) declared bounds of what a peer shows: m and rad of its pose, share of its speeds."""
    declared = setup.disturbance
    return np.array(
        (declared.position_error_m_max, declared.yaw_error_rad_max, declared.speed_error)
    )


@compiled
def keep(body: Floats, doubts: Floats, dt_s: float) -> float:
    """Room to keep around a body all the way until it stands, by declared bounds.

    Its pose is off by so much already; until it stands it gets too far by the speed error, and
    aside by what its yaw is off. Whoever just brakes keeps no more room from tick to tick: what it
    has slipped is then in its doubts, and less of the way is left.

    Args:
        body: of `announce.path`, but for the room.
        doubts: m around its place now, rad of its yaw; m and rad of the way under way; share by
            which ways are longer or shorter.
    """
    way_m, turn_rad = announce.length(body, dt_s)
    share = doubts[4]
    aside = doubts[1] + share * (doubts[3] + turn_rad)
    slip = np.sqrt(share * share + aside * aside)
    return float(doubts[0] + slip * (doubts[2] + way_m))


@lru_cache(maxsize=1024)
def is_kept(setup: RobotSetup) -> bool:
    """Whether this robot stops fast enough for its promise to be of use."""
    ticks = announce.ticks(setup.robot.speed_mps_max, brake.brakes_mps2(setup), setup.dt_s)
    return ticks <= announce.TICKS_MAX
