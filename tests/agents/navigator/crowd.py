"""Robots that ask for anything, with the guard between them and nothing else: a world for it.

draw --robots, moods, lost beacons--> pact.hold, world.motion, tick by tick --> least distance
"""

from __future__ import annotations

import random
from collections.abc import Sequence
from math import atan2, cos, dist, inf, pi, sin

import msgspec
import numpy as np

from agents import lateness, peers
from agents.navigator import estimate, pact, pledge, predict
from agents.peers import Peer
from swarm import geometry, messages
from swarm.geometry import STILL, Pose, Twist
from swarm.messages import Beacon, SensorFrame, Wheels
from swarm.scenario import Disturbance, Robot, RobotSetup, Scenario
from world import motion

DT_S = 0.08
PATIENCE_TICKS = 6
LOSSES_MAX = 5  # in a row, on one link
NO_DISTURBANCE = Disturbance()
NOTHING = np.empty((0, 2))


class Make(msgspec.Struct, frozen=True):
    """What a robot is built like."""

    radius_m: float
    speed_mps: float
    acceleration_mps2: float
    turn_acceleration_radps2: float


def robots(draw: random.Random, makes: Sequence[Make]) -> list[Robot]:
    """One of each make, at random places so far apart that none is too near at first."""
    side_m = 1.0 + 0.4 * len(makes)
    found: list[Robot] = []
    while len(found) < len(makes):
        make = makes[len(found)]
        x_m, y_m = draw.uniform(-side_m, side_m), draw.uniform(-side_m, side_m)
        robot = Robot(
            name=f"robot{len(found) + 1}",
            start=(x_m, y_m, draw.uniform(-3.0, 3.0)),
            goal=(0.0, 0.0),
            controller="navigator",
            body_radius_m=make.radius_m,
            half_track_m=min(0.17, make.radius_m),
            speed_mps_max=make.speed_mps,
            acceleration_mps2_max=make.acceleration_mps2,
            turn_acceleration_radps2_max=make.turn_acceleration_radps2,
        )
        pads_m = 2.0 * 0.2
        if all(
            dist(robot.start[:2], other.start[:2]) > make.radius_m + other.body_radius_m + pads_m
            for other in found
        ):
            found.append(robot)
        side_m += 0.02
    return found


def wish(draw: random.Random, mood: int, robot: Robot, pose: Pose, others: list[Peer]) -> Twist:
    """What the stages before the guard might ask for: noise, a rush at the nearest, a circle."""
    fastest_mps, fastest_radps = robot.speed_mps_max, robot.turn_rate_radps_max
    if mood == 0 or not others:
        return Twist(draw.uniform(-0.4, 1.0) * fastest_mps, draw.uniform(-1.0, 1.0) * fastest_radps)
    if mood == 1:
        return Twist(fastest_mps, draw.choice((-1.0, 0.0, 1.0)) * fastest_radps)
    nearest = min(others, key=lambda peer: peer.distance_m)
    error_rad = atan2(nearest.offset[1], nearest.offset[0]) - pose.yaw_rad
    error_rad = (error_rad + pi) % (2.0 * pi) - pi
    return Twist(fastest_mps * max(0.0, cos(error_rad)), 4.0 * error_rad)


def least_gap_m(
    draw: random.Random,
    makes: Sequence[Make],
    loss: float,
    ticks: int = 100,
    declared: Disturbance = NO_DISTURBANCE,
) -> tuple[float, float]:
    """Least distance of two bodies beyond both their pads in one run, and the way all went.

    Args:
        loss: probability that a beacon is lost; no more than LOSSES_MAX in a row are.
        declared: errors of poses, late motors, speed errors; worst ones are drawn often.
    """
    bodies = robots(draw, makes)
    plan = Scenario(
        title="crowd", seed=0, dt_s=DT_S, duration_s=60.0, robots=tuple(bodies),
        disturbance=declared,
    )  # fmt: skip
    setups = [plan.setup(body.name) for body in bodies]
    keeps_m = [body.body_radius_m + pledge.pad_m(setup) for body, setup in _pairs(bodies, setups)]
    factors = [1.0 + declared.speed_error * draw.choice((-1.0, 1.0)) for _ in bodies]
    lates = [lateness.State(late_ticks=declared.latency_ticks) for _ in bodies]
    wheres = [estimate.State() for _ in bodies]
    lean_rad = draw.uniform(-pi, pi)
    poses, twists = [Pose(*body.start) for body in bodies], [STILL for _ in bodies]
    states = [pact.State() for _ in bodies]
    known: list[tuple[Beacon, ...]] = [() for _ in bodies]
    said: list[Beacon] = []
    lost: dict[tuple[int, int], int] = {}
    moods = [draw.randrange(3) for _ in bodies]
    gap_m, way_m = inf, 0.0
    for tick in range(ticks):
        new: list[Beacon] = []
        for row, (body, setup) in enumerate(_pairs(bodies, setups)):
            heard = []
            for speaker, beacon in enumerate(said):
                link = (row, speaker)
                if speaker == row:
                    continue
                # All hear where the others stand at first: who was never heard is an obstacle, or
                # moves, and is none of the guard between robots.
                is_first = beacon.tick == 0
                if not is_first and lost.get(link, 0) < LOSSES_MAX and draw.random() < loss:
                    lost[link] = lost.get(link, 0) + 1
                else:
                    lost[link] = 0
                    heard.append(beacon)
            known[row] = peers.remember(known[row], heard, body.name, tick, PATIENCE_TICKS)
            seen = shown(draw, declared, poses[row], twists[row], factors[row], lean_rad, tick)
            where = estimate.step(setup, wheres[row], seen)
            assert where.pose is not None
            assert where.carried is not None
            pending = predict.pending(setup, lates[row], seen)
            carried, now = (
                predict.ahead(setup, lates[row], msgspec.structs.replace(seen, pose=pose))
                for pose in (where.carried, where.pose)
            )
            others = peers.now(known[row], now.pose, tick, DT_S, declared.latency_ticks)
            if draw.random() < 0.05:
                moods[row] = draw.randrange(3)
                lean_rad = draw.uniform(-pi, pi)
            asked = wish(draw, moods[row], body, now.pose, others) if tick else STILL
            states[row], held = pact.hold(
                setup, states[row], tick, now.pose, now.twist, asked, others, [], NOTHING,
                where, carried.pose, pending,
            )  # fmt: skip
            set_point = motion.limited(body, now.twist, asked, dt_s=DT_S)
            if held is not None:
                set_point = held.set_point
                where = where if held.corrects else estimate.carry(where)
            assert where.pose is not None
            lates[row] = lateness.send(lates[row], set_point)
            wheres[row] = where
            beacon = Beacon(
                body.name, tick, 0, where.pose, set_point, body.body_radius_m,
                body.speed_mps_max, "GO", False, (0, 0, 0, row),
                promise=pledge.promise(setup, set_point, where.doubt, pending),
            )  # fmt: skip
            states[row] = pact.send(setup, states[row], beacon)
            new.append(beacon)
        said = new
        for row, body in enumerate(bodies):
            before = poses[row]
            sent = lates[row].sent
            taken = sent[declared.latency_ticks] if len(sent) > declared.latency_ticks else STILL
            poses[row], twists[row] = motion.step(
                body, before, twists[row], taken, dt_s=DT_S, speed_factor=factors[row]
            )
            way_m += dist((before.x_m, before.y_m), (poses[row].x_m, poses[row].y_m))
        for row, pose in enumerate(poses):
            for other in range(row):
                apart_m = dist((pose.x_m, pose.y_m), (poses[other].x_m, poses[other].y_m))
                gap_m = min(gap_m, apart_m - keeps_m[row] - keeps_m[other])
    return gap_m, way_m


def shown(
    draw: random.Random,
    declared: Disturbance,
    pose: Pose,
    twist: Twist,
    factor: float,
    lean_rad: float,
    tick: int,
) -> SensorFrame:
    """What a robot is told about itself: off by as much as may be, and often the same way."""
    away_m, yaw_rad = declared.position_error_m_max, declared.yaw_error_rad_max
    towards_rad = lean_rad if draw.random() < 0.7 else draw.uniform(-pi, pi)
    pose = Pose(
        pose.x_m + away_m * cos(towards_rad),
        pose.y_m + away_m * sin(towards_rad),
        geometry.wrap_angle(pose.yaw_rad + draw.choice((-1.0, 1.0)) * yaw_rad),
    )
    return SensorFrame(
        "robot1", tick, 0, pose, motion.scaled(twist, 1.0 / factor), Wheels(0.0, 0.0), False,
        messages.floats([]),
    )  # fmt: skip


def _pairs(bodies: list[Robot], setups: list[RobotSetup]) -> list[tuple[Robot, RobotSetup]]:
    return list(zip(bodies, setups, strict=True))
