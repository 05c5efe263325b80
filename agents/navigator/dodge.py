"""Out of the way of what moves and gives no way to anybody.

    asked --one tick of it, then ...--> is any course from there free of what moves? --> asked
                                        '-- none: the course nearest to what was asked that is free,
                                            or that is hit latest

Braking is not safe before what comes along: a robot that stands in its way is hit as well. So
courses go on for a while, in time, against where everything that moves will be: driving on, turning
off, backwards, standing. Where obstacles end a course the robot stands from there on; that it can
stop before them is the business of `brake`, which comes after.

What moves may turn back at any moment. A course is better when, some ticks after that, there is
still a way out.
"""

from __future__ import annotations

import numpy as np

from agents.navigator import brake
from agents.navigator.admission import reached
from agents.navigator.announce import turn
from agents.navigator.compiled import compiled
from swarm.geometry import Floats, Twist
from swarm.scenario import RobotSetup

HORIZON_S = 2.4
# Room to what moves, more of it later: it may turn, and its velocity is not exact.
PAD_M, PAD_MPS, PAD_M_MAX = 0.06, 0.05, 0.14
# Where that cannot be had, so little has to do; and who is nearer already comes no nearer than so.
TIGHT_M, CLOSER_M = 0.01, 0.01
# What turns back: noticed after so many ticks; looked at for so long, with less room, when so near.
TURNED_TICKS, TURNED_S, TURNED_PAD_M, TURNED_M = 3, 1.2, 0.04, 1.6
NEAR_M = 4.8  # what is further away and moves does not matter within the horizon
# Of the top speeds; ahead, back, or standing, turning for so long and then straight on.
SPEEDS = np.array((1.0, 0.6, 0.3, 0.0, -0.5, -1.0))
RATES = np.array((0.0, 0.3, -0.3, 0.7, -0.7, 1.0, -1.0))
TURN_S = np.array((0.25, 0.6, 1.2))
OFF_SPEED, OFF_RATE = 1.0, 0.3  # what it costs to be off what was asked, by the share of it
TURNED_COST = 3.0  # and to be without a way out

# Columns of what moves, from the robot's centre when a set-point takes effect, world axes.
X, Y, V_X, V_Y, KEEP = range(5)


def reach_m(setup: RobotSetup) -> float:
    """How far off obstacles matter to a course."""
    return HORIZON_S * setup.robot.speed_mps_max + setup.robot.body_radius_m


def ask(
    setup: RobotSetup,
    heading: tuple[float, float],
    twist: Twist,
    asked: Twist,
    moving: Floats,
    points_m: Floats,
) -> Twist:
    """What to ask instead, so that nothing that moves hits the robot; mostly the same.

    Args:
        heading: cosine and sine.
        moving: (movers, 5) as above; KEEP is the radius of each.
        points_m: (points, 2) of obstacles, from the robot's centre, world axes.
    """
    robot, dt_s = setup.robot, setup.dt_s
    near = moving[moving[:, X] ** 2 + moving[:, Y] ** 2 < NEAR_M * NEAR_M]
    if not len(near):
        return asked
    near = near.copy()
    near[:, KEEP] += robot.body_radius_m
    result = np.zeros(2)
    choose(
        np.array((*heading, twist.speed_mps, twist.turn_rate_radps)),
        np.array((robot.speed_mps_max, robot.speed_mps_reverse_max, robot.turn_rate_radps_max)),
        np.array((robot.acceleration_mps2_max * dt_s, robot.turn_acceleration_radps2_max * dt_s)),
        robot.half_track_m,
        asked.speed_mps,
        asked.turn_rate_radps,
        near,
        points_m,
        brake.room(setup, points_m),
        dt_s,
        max(1, round(HORIZON_S / dt_s)),
        SPEEDS,
        RATES,
        TURN_S,
        result,
    )
    return Twist(float(result[0]), float(result[1]))


# --- inner loops --------------------------------------------------------------------------------


@compiled
def choose(
    start: Floats,
    most: Floats,
    change: Floats,
    half_track_m: float,
    asked_v_mps: float,
    asked_w_radps: float,
    moving: Floats,
    points: Floats,
    room_m: float,
    dt_s: float,
    ticks: int,
    speeds: Floats,
    rates: Floats,
    turn_s: Floats,
    result: Floats,
) -> None:
    """Rates to ask for, into `result`."""
    result[0], result[1] = asked_v_mps, asked_w_radps
    # 1. As asked, and on like that; or then any other way.
    first = np.array((asked_v_mps, asked_w_radps, 1.0))
    found = np.zeros(2)
    free = leaves_a_way(
        start, most, change, half_track_m, first, moving, points, room_m, dt_s, ticks,
        PAD_M, speeds, rates, turn_s, found,
    )  # fmt: skip
    turned_ticks = min(ticks, int(TURNED_S / dt_s))
    if free and bears_turns(
        start, most, change, half_track_m, first, moving, points, room_m, dt_s, turned_ticks,
        speeds, rates, turn_s, found,
    ):  # fmt: skip
        return
    # 2. The best of all others; what was asked itself, if nothing better is free.
    best_after = -1.0
    best_gap_m = -np.inf
    best_cost = np.inf
    if free:
        best_after, best_gap_m, best_cost = float(ticks), 0.0, TURNED_COST
    then = np.zeros(3)
    for least_m in (PAD_M, TIGHT_M):
        if least_m == TIGHT_M:
            if best_after >= ticks:
                return
            best_after, best_gap_m, best_cost = -1.0, -np.inf, np.inf
        for s in range(len(speeds)):
            v_mps = speeds[s] * (most[0] if speeds[s] > 0.0 else most[1])
            for r in range(len(rates)):
                w_radps = rates[r] * most[2]
                cost = OFF_SPEED * abs(v_mps - asked_v_mps) / most[0]
                cost += OFF_RATE * abs(w_radps - asked_w_radps) / most[2]
                if best_after >= ticks and cost >= best_cost and least_m > TIGHT_M:
                    continue
                for k in range(len(turn_s)):
                    if rates[r] == 0.0 and k > 0:
                        continue
                    first[0], first[1], first[2] = v_mps, w_radps, 1.0
                    then[0], then[1], then[2] = v_mps, w_radps, turn_s[k] / dt_s
                    fly(
                        start, most, change, half_track_m, first, then, moving, points, room_m,
                        dt_s, ticks, least_m, found,
                    )  # fmt: skip
                    after, gap_m, paid = found[0], found[1], cost
                    if least_m > TIGHT_M and after >= ticks and not bears_turns(
                        start, most, change, half_track_m, first, moving, points, room_m, dt_s,
                        turned_ticks, speeds, rates, turn_s, found,
                    ):  # fmt: skip
                        paid += TURNED_COST
                    if after >= ticks and least_m > TIGHT_M:
                        better = best_after < ticks or paid < best_cost
                    else:
                        better = after > best_after or (after == best_after and gap_m > best_gap_m)
                    if better:
                        best_after, best_gap_m, best_cost = after, gap_m, paid
                        result[0], result[1] = v_mps, w_radps


@compiled
def bears_turns(
    start: Floats,
    most: Floats,
    change: Floats,
    half_track_m: float,
    first: Floats,
    moving: Floats,
    points: Floats,
    room_m: float,
    dt_s: float,
    ticks: int,
    speeds: Floats,
    rates: Floats,
    turn_s: Floats,
    found: Floats,
) -> bool:
    """Whether there is a way out should any one of what moves nearby turn back now."""
    one = np.array((first[0], first[1], float(TURNED_TICKS)))
    turned = moving.copy()
    for row in range(len(moving)):
        x, y = moving[row, X], moving[row, Y]
        near_m = moving[row, KEEP] + TURNED_M
        v_x, v_y = moving[row, V_X], moving[row, V_Y]
        # What comes nearer gets further away if it turns.
        if x * x + y * y > near_m * near_m or x * v_x + y * v_y < 0.0:
            continue
        turned[row, V_X], turned[row, V_Y] = -v_x, -v_y
        free = leaves_a_way(
            start, most, change, half_track_m, one, turned, points, room_m, dt_s, ticks,
            TURNED_PAD_M, speeds, rates, turn_s, found,
        )  # fmt: skip
        turned[row, V_X], turned[row, V_Y] = v_x, v_y
        if not free:
            return False
    return True


@compiled
def leaves_a_way(
    start: Floats,
    most: Floats,
    change: Floats,
    half_track_m: float,
    first: Floats,
    moving: Floats,
    points: Floats,
    room_m: float,
    dt_s: float,
    ticks: int,
    pad_m: float,
    speeds: Floats,
    rates: Floats,
    turn_s: Floats,
    found: Floats,
) -> bool:
    """Whether any course that begins with `first` is free."""
    then = np.array((first[0], first[1], 0.25 / dt_s))
    fly(
        start, most, change, half_track_m, first, then, moving, points, room_m, dt_s, ticks,
        pad_m, found,
    )  # fmt: skip
    if found[0] >= ticks:
        return True
    if found[0] < first[2]:
        return False
    for s in range(len(speeds)):
        then[0] = speeds[s] * (most[0] if speeds[s] > 0.0 else most[1])
        for r in range(len(rates)):
            then[1] = rates[r] * most[2]
            for k in range(len(turn_s)):
                if rates[r] == 0.0 and k > 0:
                    continue
                then[2] = turn_s[k] / dt_s
                fly(
                    start, most, change, half_track_m, first, then, moving, points, room_m,
                    dt_s, ticks, pad_m, found,
                )  # fmt: skip
                if found[0] >= ticks:
                    return True
    return False


@compiled
def fly(
    start: Floats,
    most: Floats,
    change: Floats,
    half_track_m: float,
    first: Floats,
    then: Floats,
    moving: Floats,
    points: Floats,
    room_m: float,
    dt_s: float,
    ticks: int,
    least_m: float,
    found: Floats,
) -> None:
    """In which tick a course is hit, or `ticks`; least gap until then, m, into `found`.

    Args:
        first: v, omega, ticks for which these are asked.
        least_m: room to what moves, at first.
        then: the same of what is asked after that; and then the same speed straight on.
    """
    cosine, sine, v, w = start[0], start[1], start[2], start[3]
    x = y = 0.0
    room2_m2 = room_m * room_m
    stands = False
    found[1] = np.inf
    gaps_m = np.empty(len(moving))
    for row in range(len(moving)):
        apart2_m2 = moving[row, X] * moving[row, X] + moving[row, Y] * moving[row, Y]
        gaps_m[row] = np.sqrt(apart2_m2) - moving[row, KEEP]
    for tick in range(ticks):
        before_x, before_y = x, y
        if not stands:
            if tick < first[2]:
                set_v, set_w = first[0], first[1]
            elif tick < first[2] + then[2]:
                set_v, set_w = then[0], then[1]
            else:
                set_v, set_w = then[0], 0.0
            v, w = reached(v, w, set_v, set_w, change, most, half_track_m)
            cos_half, sin_half = turn(0.5 * w * dt_s)
            cosine, sine = cosine * cos_half - sine * sin_half, sine * cos_half + cosine * sin_half
            x += v * dt_s * cosine
            y += v * dt_s * sine
            cosine, sine = cosine * cos_half - sine * sin_half, sine * cos_half + cosine * sin_half
            for point in range(len(points)):
                dx, dy = points[point, 0] - x, points[point, 1] - y
                if dx * dx + dy * dy >= room2_m2:
                    continue
                was_x, was_y = points[point, 0] - before_x, points[point, 1] - before_y
                if dx * dx + dy * dy < was_x * was_x + was_y * was_y:
                    stands = True
                    break
            if stands:
                x, y, v, w = before_x, before_y, 0.0, 0.0
        pad_m = least_m
        if least_m > TIGHT_M:
            pad_m = min(PAD_M_MAX, least_m + PAD_MPS * tick * dt_s)
        for row in range(len(moving)):
            # Nearest within the tick, both going straight.
            from_x = moving[row, X] + tick * dt_s * moving[row, V_X] - before_x
            from_y = moving[row, Y] + tick * dt_s * moving[row, V_Y] - before_y
            by_x = dt_s * moving[row, V_X] - (x - before_x)
            by_y = dt_s * moving[row, V_Y] - (y - before_y)
            by2 = by_x * by_x + by_y * by_y
            part = 0.0
            if by2 > 0.0:
                part = max(0.0, min(1.0, -(from_x * by_x + from_y * by_y) / by2))
            near_x, near_y = from_x + part * by_x, from_y + part * by_y
            gap_m = np.sqrt(near_x * near_x + near_y * near_y) - moving[row, KEEP]
            if gap_m < found[1]:
                found[1] = gap_m
            if gap_m < min(pad_m, max(0.0, gaps_m[row] - CLOSER_M)):
                found[0] = tick
                return
    found[0] = ticks
