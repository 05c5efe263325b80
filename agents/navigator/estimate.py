"""Where a robot believes that it is, when what it is told about that is not exact.

    pose believed in, measured twist --a tick on--> carried
    carried, measured pose --a share of the difference--> corrected

What its wheels say is smooth but off by the declared speed error; what it is shown is right in the
mean but jumps. The error of what it corrects is a mean of errors of which none is beyond the
declared bounds, so that it has a bound too: `error_m`. All of it is exact where nothing is
declared: then the pose is the measured one.
"""

from __future__ import annotations

import msgspec

from swarm import geometry
from swarm.geometry import Pose
from swarm.messages import SensorFrame
from swarm.scenario import RobotSetup

# Share of what it is shown: less smooths more, and lets the speed error add up for longer.
GAIN = 0.3


class State(msgspec.Struct, frozen=True):
    """Poses of one tick."""

    tick: int = -1
    pose: Pose | None = None  # announced in this tick
    carried: Pose | None = None  # where wheels say that the announced pose of before has got to


def is_needed(setup: RobotSetup) -> bool:
    """Whether poses shown, or ways driven, are not exact."""
    declared = setup.disturbance
    return max(declared.position_sigma_m, declared.yaw_sigma_rad, declared.speed_error) > 0.0


def step(setup: RobotSetup, state: State, frame: SensorFrame) -> State:
    """Poses at this tick; a robot that missed one believes what it is shown."""
    if not is_needed(setup) or state.pose is None or frame.tick != state.tick + 1:
        return State(frame.tick, frame.pose, frame.pose)
    carried = geometry.advance(state.pose, frame.twist, setup.dt_s)
    turn_rad = geometry.wrap_angle(frame.pose.yaw_rad - carried.yaw_rad)
    corrected = Pose(
        carried.x_m + GAIN * (frame.pose.x_m - carried.x_m),
        carried.y_m + GAIN * (frame.pose.y_m - carried.y_m),
        geometry.wrap_angle(carried.yaw_rad + GAIN * turn_rad),
    )
    return State(frame.tick, corrected, carried)


def carry(state: State) -> State:
    """State of a robot that may not correct itself in this tick."""
    return msgspec.structs.replace(state, pose=state.carried)


def yaw_error_rad(setup: RobotSetup) -> float:
    """Bound of the error of the yaw believed in: z = (1 - g) (z + drift) + g shown, solved."""
    declared = setup.disturbance
    drift_rad = declared.speed_error * setup.robot.turn_rate_radps_max * setup.dt_s
    return declared.yaw_error_rad_max + drift_rad * (1.0 - GAIN) / GAIN


def slip(setup: RobotSetup) -> float:
    """Share of its way by which a robot gets elsewhere than it believes: too far, or aside."""
    return setup.disturbance.speed_error + yaw_error_rad(setup)


def error_m(setup: RobotSetup) -> float:
    """Bound of the error of the position believed in, likewise."""
    drift_m = slip(setup) * setup.robot.speed_mps_max * setup.dt_s
    return setup.disturbance.position_error_m_max + drift_m * (1.0 - GAIN) / GAIN
