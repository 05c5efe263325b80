"""Where a robot believes that it is, when what it is told about that is not exact.

    pose believed in, measured twist --a tick on--> carried
    carried, measured pose --a share of the difference--> corrected

What its wheels say is smooth but off by the declared speed error; what it is shown is right in the
mean but jumps. The error of what it corrects is a mean of errors of which none is beyond the
declared bounds, so that it has a bound too, which is kept along with it. All of it is exact where
nothing is declared: then the pose is the measured one.
"""

from __future__ import annotations

from math import sqrt

import msgspec

from agents.peers import RATE_MAX
from swarm import geometry
from swarm.geometry import Pose, Twist
from swarm.messages import SensorFrame
from swarm.scenario import RobotSetup

# Share of what it is shown: less smooths more, and lets the speed error add up for longer.
GAIN = 0.4
# By so much more than both are in doubt they may differ: arcs are off their chords, by less.
ROUNDING_M, ROUNDING_RAD = 1e-3, 1e-6


class Doubt(msgspec.Struct, frozen=True):
    """Bounds of the errors of a pose believed in."""

    position_m: float = 0.0
    yaw_rad: float = 0.0


class State(msgspec.Struct, frozen=True):
    """Poses of one tick."""

    tick: int = -1
    pose: Pose | None = None  # announced in this tick
    doubt: Doubt = Doubt()  # about it
    carried: Pose | None = None  # where wheels say that the announced pose of before has got to
    carried_doubt: Doubt = Doubt()


def is_needed(setup: RobotSetup) -> bool:
    """Whether poses shown, or ways driven, are not exact."""
    declared = setup.disturbance
    return max(declared.position_sigma_m, declared.yaw_sigma_rad, declared.speed_error) > 0.0


def step(setup: RobotSetup, state: State, frame: SensorFrame) -> State:
    """Poses at this tick; a robot that missed one believes what it is shown.

    So does one whose wheels have said what cannot be: else that would spoil all poses to come.
    """
    shown = Doubt(setup.disturbance.position_error_m_max, setup.disturbance.yaw_error_rad_max)
    rate = max(abs(frame.twist.speed_mps), abs(frame.twist.turn_rate_radps))
    follows = frame.tick == state.tick + 1 and rate <= RATE_MAX
    if not is_needed(setup) or state.pose is None or not follows:
        return State(frame.tick, frame.pose, shown, frame.pose, shown)
    carried = geometry.advance(state.pose, frame.twist, setup.dt_s)
    doubt = driven(setup, state.doubt, frame.twist)
    turn_rad = geometry.wrap_angle(frame.pose.yaw_rad - carried.yaw_rad)
    off_m = geometry.length(frame.pose.x_m - carried.x_m, frame.pose.y_m - carried.y_m)
    agree = (
        off_m <= doubt.position_m + shown.position_m + ROUNDING_M
        and abs(turn_rad) <= doubt.yaw_rad + shown.yaw_rad + ROUNDING_RAD
    )
    if not agree:  # neither do numbers that are none
        return State(frame.tick, frame.pose, shown, frame.pose, shown)
    corrected = Pose(
        carried.x_m + GAIN * (frame.pose.x_m - carried.x_m),
        carried.y_m + GAIN * (frame.pose.y_m - carried.y_m),
        geometry.wrap_angle(carried.yaw_rad + GAIN * turn_rad),
    )
    less = Doubt(
        doubt.position_m + GAIN * (shown.position_m - doubt.position_m),
        doubt.yaw_rad + GAIN * (shown.yaw_rad - doubt.yaw_rad),
    )
    return State(frame.tick, corrected, less, carried, doubt)


def carry(state: State) -> State:
    """State of a robot that may not correct itself in this tick."""
    return msgspec.structs.replace(state, pose=state.carried, doubt=state.carried_doubt)


def driven(setup: RobotSetup, doubt: Doubt, twist: Twist) -> Doubt:
    """Bounds after a tick on the wheels' word: so much too far, and so much aside."""
    share, dt_s = setup.disturbance.speed_error, setup.dt_s
    yaw_rad = doubt.yaw_rad + share * abs(twist.turn_rate_radps) * dt_s
    slip = sqrt(share * share + yaw_rad * yaw_rad)
    return Doubt(doubt.position_m + slip * abs(twist.speed_mps) * dt_s, yaw_rad)


def error_m(setup: RobotSetup) -> float:
    """Bound of the position's error at top speed straight on: z = (1 - g) (z + drift) + g shown."""
    declared = setup.disturbance
    share, yaw_rad = declared.speed_error, declared.yaw_error_rad_max
    drift_m = sqrt(share * share + yaw_rad * yaw_rad) * setup.robot.speed_mps_max * setup.dt_s
    return declared.position_error_m_max + drift_m * (1.0 - GAIN) / GAIN
