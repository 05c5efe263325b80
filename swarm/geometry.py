"""Poses, twists and angles in the plane (REP-103: metres, x forward, y left, yaw ccw from +x)."""

from __future__ import annotations

from math import atan2, cos, pi, sin, sqrt
from typing import Annotated

import msgspec
import numpy as np
import numpy.typing as npt

TAU = 2.0 * pi

# A number that came over the bus: bounds are checked by the decoder, and NaN is within none.
Finite = Annotated[float, msgspec.Meta(ge=-1e12, le=1e12)]

Vec2 = tuple[Finite, Finite]  # x_m, y_m or a force, frame named by the variable
Floats = npt.NDArray[np.float64]
Ranges = npt.NDArray[np.float32]  # (beams,) m, inf where nothing was hit


class Pose(msgspec.Struct, frozen=True, array_like=True):
    """Where a body is, world frame: axle centre and heading."""

    x_m: Finite
    y_m: Finite
    yaw_rad: Finite  # [-pi, pi)


class Twist(msgspec.Struct, frozen=True, array_like=True):
    """How a body moves, body frame: (v, omega) of eq. 5."""

    speed_mps: Finite
    turn_rate_radps: Finite


STILL = Twist(0.0, 0.0)


def wrap_angle(angle_rad: float) -> float:
    """Same direction in [-pi, pi), to the bit where it lies there already: mirrors stay exact."""
    if -pi <= angle_rad < pi:
        return angle_rad
    wrapped = (angle_rad + pi) % TAU - pi
    return wrapped if wrapped < pi else -pi  # a tiny negative argument makes % return TAU itself


def unit(angle_rad: float) -> Vec2:
    """Unit vector e(angle) of the paper."""
    return (cos(angle_rad), sin(angle_rad))


def length(x: float, y: float) -> float:
    """Euclidean norm by sqrt, which is correctly rounded everywhere (hypot is not)."""
    return sqrt(x * x + y * y)


def distance(a: Pose, b: Pose) -> float:
    """Distance of two axle centres in metres."""
    return length(a.x_m - b.x_m, a.y_m - b.y_m)


def bearing(source: Pose, target_x_m: float, target_y_m: float) -> float:
    """World angle from a pose to a point."""
    return atan2(target_y_m - source.y_m, target_x_m - source.x_m)


def advance(pose: Pose, twist: Twist, duration_s: float) -> Pose:
    """Pose after moving with a constant twist: the exact arc of eq. 7, a line below 1e-9 rad/s."""
    before_rad, turn_rate_radps = pose.yaw_rad, twist.turn_rate_radps
    after_rad = before_rad + turn_rate_radps * duration_s
    if -1e-9 < turn_rate_radps < 1e-9:
        step_m = twist.speed_mps * duration_s
        x_m = pose.x_m + step_m * cos(before_rad)
        y_m = pose.y_m + step_m * sin(before_rad)
    else:
        radius_m = twist.speed_mps / turn_rate_radps
        x_m = pose.x_m + radius_m * (sin(after_rad) - sin(before_rad))
        y_m = pose.y_m - radius_m * (cos(after_rad) - cos(before_rad))
    return Pose(x_m, y_m, wrap_angle(after_rad))


def sector_centres(count: int) -> list[float]:
    """Body angles of `count` equal sectors (or beams) that cover the circle, centre of each.

    Sector i is -pi + (i + 1/2) 2 pi / count, written so that the list is exactly antisymmetric:
    mirrored robots then see bit-for-bit mirrored sectors.
    """
    width_rad = TAU / count
    return [(i - (count - 1) / 2.0) * width_rad for i in range(count)]
