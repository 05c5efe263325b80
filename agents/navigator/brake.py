"""The last word of the navigator: no set-point from which the robot could not stop in time.

    asked, twist --course--> one tick as asked, then the brakes, curve kept --keeps_off--> allowed
                   '-- slower, and slower still     '-- none: the brakes, on the course of before

Any course that is allowed ends in a standstill without contact, and braking is what is left of it,
so that there is always one more: this holds whatever the stages before have asked for.
"""

from __future__ import annotations

from functools import lru_cache
from math import ceil

import msgspec
import numpy as np

from agents import steering
from agents.guard import Limit
from agents.navigator.compiled import compiled
from swarm import geometry
from swarm.geometry import Floats, Twist
from swarm.scenario import Robot, RobotSetup

# Of what the body can do. One whose wheels lag behind needs more of it.
BRAKES_SHARE = 0.9
BRAKES_SHARE_DYNAMIC = 0.6
SHARES = (1.0, 0.85, 0.7, 0.5, 0.3, 0.12, 0.0)  # of the speed asked for
# Where there is less room than the margin: so much nearer per tick, but never nearer than this.
CLOSER_M = 0.004
LEAST_M = 0.002
SAME_M = 1e-9
_SHARES = np.array(SHARES)
TICKS_MAX = 400  # of a course; whoever needs longer to stop is only looked at for so long

# Columns of `limits`: greatest rates forwards, backwards, turning; changes of both in a tick, and
# what the brakes take from the speed in one.
V_MAX, V_BACK, W_MAX, V_CHANGE, W_CHANGE, BRAKES, HALF_TRACK, DT, BODY, MARGIN = range(10)


class Course(msgspec.Struct, frozen=True, eq=False):
    """What one candidate comes to."""

    reached: Twist  # in the coming tick
    places_m: Floats  # (places, 2) from the robot's centre, world axes: every half tick to the stop

    def at_ticks(self) -> Floats:
        """(ticks, 2) where it is one tick from now, two ticks, ... until it stands."""
        return self.places_m[1::2]


def hold(
    setup: RobotSetup, yaw_rad: float, twist: Twist, asked: Twist, points_m: Floats
) -> tuple[Twist, Limit]:
    """The first candidate that keeps off obstacles.

    Args:
        yaw_rad, twist: when the set-point takes effect.
        points_m: (points, 2) of obstacles, from the robot's centre, world axes.
    """
    ahead, aside = geometry.unit(yaw_rad)
    number = first_free(
        points_m,
        _SHARES,
        limits(setup),
        twist.speed_mps,
        twist.turn_rate_radps,
        asked.speed_mps,
        asked.turn_rate_radps,
        ahead,
        aside,
    )
    if number == 0:
        return reached(setup.robot, twist, asked, setup.dt_s), Limit(setup.robot.speed_mps_max, "")
    if number < len(SHARES):
        less = Twist(SHARES[number] * asked.speed_mps, asked.turn_rate_radps)
        first = reached(setup.robot, twist, less, setup.dt_s)
    else:
        first = braked(setup, twist)
    return first, Limit(abs(first.speed_mps), "brake")


def room(setup: RobotSetup, points_m: Floats) -> float:
    """How near to the robot's centre points may come: body and margin, less in a slit."""
    return room_of(points_m, setup.robot.body_radius_m, setup.navigator.guard_margin_m)


def reach_m(setup: RobotSetup, speed_mps: float) -> float:
    """How far off points can matter to a robot at this speed."""
    robot = setup.robot
    fastest_mps = abs(speed_mps) + robot.acceleration_mps2_max * setup.dt_s
    stop_m = fastest_mps * fastest_mps / (2.0 * brakes_mps2(setup)) + fastest_mps * setup.dt_s
    return stop_m + robot.body_radius_m + setup.navigator.guard_margin_m


def brakes_mps2(setup: RobotSetup) -> float:
    """Deceleration that courses end with."""
    dynamic = setup.robot.motion == "dynamic"
    share = BRAKES_SHARE_DYNAMIC if dynamic else BRAKES_SHARE
    return share * setup.robot.acceleration_mps2_max


def reached(robot: Robot, twist: Twist, asked: Twist, dt_s: float) -> Twist:
    """Twist of the coming tick: what is asked for within the limits of speed, motors and rims."""
    speed_mps = max(-robot.speed_mps_reverse_max, min(robot.speed_mps_max, asked.speed_mps))
    rate_radps = steering.clip(asked.turn_rate_radps, robot.turn_rate_radps_max)
    return steering.scale_to_rims(robot, steering.slew(robot, twist, speed_mps, rate_radps, dt_s))


def braked(setup: RobotSetup, twist: Twist) -> Twist:
    """Twist after a tick of braking on the same curve."""
    change_mps = brakes_mps2(setup) * setup.dt_s
    change_radps = setup.robot.turn_acceleration_radps2_max * setup.dt_s
    return Twist(*slower(twist.speed_mps, twist.turn_rate_radps, change_mps, change_radps))


@lru_cache(maxsize=1024)
def limits(setup: RobotSetup) -> Floats:
    """(10,) what the loops that brake need to know of a robot."""
    robot, dt_s = setup.robot, setup.dt_s
    found = np.zeros(10)
    found[V_MAX], found[V_BACK], found[W_MAX] = (
        robot.speed_mps_max, robot.speed_mps_reverse_max, robot.turn_rate_radps_max
    )  # fmt: skip
    found[HALF_TRACK], found[DT], found[BODY] = robot.half_track_m, dt_s, robot.body_radius_m
    found[MARGIN] = setup.navigator.guard_margin_m
    found[V_CHANGE] = robot.acceleration_mps2_max * dt_s
    found[W_CHANGE] = robot.turn_acceleration_radps2_max * dt_s
    found[BRAKES] = brakes_mps2(setup) * dt_s
    return found


def course(setup: RobotSetup, yaw_rad: float, twist: Twist, asked: Twist) -> Course:
    """A tick as asked, then braking on that curve until the robot stands."""
    first = reached(setup.robot, twist, asked, setup.dt_s)
    change_mps = brakes_mps2(setup) * setup.dt_s
    change_radps = setup.robot.turn_acceleration_radps2_max * setup.dt_s
    ticks = min(TICKS_MAX, 2 + ceil(abs(first.speed_mps) / change_mps))
    ahead, aside = geometry.unit(yaw_rad)
    places_m = places(
        first.speed_mps,
        first.turn_rate_radps,
        change_mps,
        change_radps,
        setup.dt_s,
        ahead,
        aside,
        ticks,
    )
    return Course(first, places_m)


# --- inner loops --------------------------------------------------------------------------------


@compiled
def first_free(
    points_m: Floats,
    shares: Floats,
    limits: Floats,
    v_mps: float,
    w_radps: float,
    asked_v_mps: float,
    asked_w_radps: float,
    ahead: float,
    aside: float,
) -> int:
    """Which share of the speed asked for is the first whose course keeps off all points.

    Args:
        points_m: (points, 2) from the robot's centre, world axes.
        limits: of `limits`.
        v_mps, w_radps: when the set-point takes effect, as its heading (ahead, aside).
    Returns:
        index of `shares`, their number if there is none.
    """
    keep_m = room_of(points_m, limits[BODY], limits[MARGIN])
    dt_s, change_mps, change_radps = limits[DT], limits[V_CHANGE], limits[W_CHANGE]
    for number in range(len(shares)):
        # as `reached` has it
        v = max(-limits[V_BACK], min(limits[V_MAX], shares[number] * asked_v_mps))
        w = max(-limits[W_MAX], min(limits[W_MAX], asked_w_radps))
        v = max(v_mps - change_mps, min(v_mps + change_mps, v))
        w = max(w_radps - change_radps, min(w_radps + change_radps, w))
        rim_mps = abs(v) + limits[HALF_TRACK] * abs(w)
        if rim_mps > limits[V_MAX]:
            scale = limits[V_MAX] / rim_mps
            v *= scale
            w *= scale
        ticks = min(TICKS_MAX, 2 + ceil(abs(v) / limits[BRAKES]))
        way_m = places(v, w, limits[BRAKES], change_radps, dt_s, ahead, aside, ticks)
        if keeps_off(points_m, way_m, keep_m):
            return number
    return len(shares)


@compiled
def room_of(points_m: Floats, radius_m: float, margin_m: float) -> float:
    """How near to the robot's centre points may come."""
    near_m = nearest_of(points_m) - CLOSER_M
    return min(radius_m + margin_m, max(radius_m + LEAST_M, near_m))


@compiled
def slower(
    speed_mps: float, rate_radps: float, change_mps: float, change_radps: float
) -> tuple[float, float]:
    """Speed and turn rate after a tick of braking with the curve kept as far as motors can."""
    if abs(speed_mps) <= change_mps:
        next_mps = 0.0
        wanted_radps = 0.0
    else:
        next_mps = speed_mps - change_mps if speed_mps > 0.0 else speed_mps + change_mps
        wanted_radps = rate_radps * (next_mps / speed_mps)
    low, high = rate_radps - change_radps, rate_radps + change_radps
    return next_mps, max(low, min(high, wanted_radps))


@compiled
def places(
    speed_mps: float,
    rate_radps: float,
    change_mps: float,
    change_radps: float,
    dt_s: float,
    ahead: float,
    aside: float,
    ticks: int,
) -> Floats:
    """(2 ticks, 2) m, every half tick of a course; it ends when the robot stands.

    Directions are turned on by half of each half tick, as arcs have their chords, with the tangent
    of a quarter of the turn: sines of a compiler's own differ between machines.
    """
    found = np.empty((2 * ticks, 2))
    x = y = 0.0
    count = 0
    for _ in range(ticks):
        turn = 0.25 * rate_radps * dt_s  # half of what half a tick turns
        tangent = 0.5 * turn * (1.0 + turn * turn / 12.0)  # of half that angle
        scale = 1.0 / (1.0 + tangent * tangent)
        cosine = (1.0 - tangent * tangent) * scale
        sine = 2.0 * tangent * scale
        step_m = 0.5 * speed_mps * dt_s * (1.0 - turn * turn / 6.0)  # chord of the arc
        for _ in range(2):
            ahead, aside = ahead * cosine - aside * sine, aside * cosine + ahead * sine
            x += step_m * ahead
            y += step_m * aside
            ahead, aside = ahead * cosine - aside * sine, aside * cosine + ahead * sine
            found[count, 0] = x
            found[count, 1] = y
            count += 1
        if speed_mps == 0.0:
            break
        speed_mps, rate_radps = slower(speed_mps, rate_radps, change_mps, change_radps)
        if speed_mps == 0.0:
            break
    return found[:count]


@compiled
def nearest_of(points_m: Floats) -> float:
    """Distance to the nearest point."""
    least2 = 1e12
    for index in range(len(points_m)):
        x, y = points_m[index, 0], points_m[index, 1]
        least2 = min(least2, x * x + y * y)
    return float(np.sqrt(least2))


@compiled
def keeps_off(points_m: Floats, places_m: Floats, keep_m: float) -> bool:
    """Whether no point comes nearer than `keep_m`; one that is nearer already, no nearer at all.

    Between two places the robot goes straight, which is off its arc by a millimetre at most.
    """
    count = len(places_m)
    x_min = x_max = y_min = y_max = 0.0
    for place in range(count):
        x_min = min(x_min, places_m[place, 0])
        x_max = max(x_max, places_m[place, 0])
        y_min = min(y_min, places_m[place, 1])
        y_max = max(y_max, places_m[place, 1])
    for index in range(len(points_m)):
        px, py = points_m[index, 0], points_m[index, 1]
        if px < x_min - keep_m or px > x_max + keep_m or py < y_min - keep_m or py > y_max + keep_m:
            continue
        now2 = px * px + py * py
        limit2 = keep_m * keep_m
        if now2 < limit2:
            limit2 = max(0.0, now2 - SAME_M)
        from_x = from_y = 0.0
        for place in range(count):
            to_x, to_y = places_m[place, 0], places_m[place, 1]
            dx, dy = to_x - from_x, to_y - from_y
            along = dx * (px - from_x) + dy * (py - from_y)
            length2 = dx * dx + dy * dy
            if along <= 0.0 or length2 == 0.0:
                near_x, near_y = from_x, from_y
            elif along >= length2:
                near_x, near_y = to_x, to_y
            else:
                part = along / length2
                near_x, near_y = from_x + part * dx, from_y + part * dy
            away_x, away_y = px - near_x, py - near_y
            if away_x * away_x + away_y * away_y < limit2:
                return False
            from_x, from_y = to_x, to_y
    return True
