"""Every inner loop called once: for processes that start robots, before they do.

A robot then pays for neither compiling nor loading within a tick.
"""

from __future__ import annotations

from math import inf, sqrt

import numpy as np

from agents import lateness, msam, navigator
from agents.navigator import memory
from swarm import messages, scenario
from swarm.geometry import Pose, Twist
from swarm.messages import SensorFrame, Wheels

SCENE = b"""
title = "A wall that is seen, and then is not there"
seed = 0
dt_s = 0.08
duration_s = 1.0
[[robots]]
name = "robot1"
start = [0.0, 0.0, 0.0]
goal = [3.0, 0.0]
controller = "navigator"
[[robots]]
name = "robot2"
start = [0.0, 9.0, 0.0]
goal = [99.0, 9.0]
controller = "navigator"
"""
TICKS = 14
DISC_M = (0.4, 1.5, 0.25)  # from the robot, at first; it falls behind


def up() -> None:
    """Drive towards a wall that disappears, beside a disc that moves, then stand elsewhere."""
    plan = scenario.decode(SCENE, "warm")
    for robot in plan.robots:
        setup = plan.setup(robot.name)
        state, late = navigator.State(), lateness.State()
        for tick in range(TICKS):
            beams = np.full(setup.sensor.beams, inf, dtype=np.float32)
            if tick < TICKS // 2:
                beams[len(beams) * 3 // 8 : len(beams) * 5 // 8] = 1.0 + 0.01 * tick
            x_m = 0.1 * tick if tick < TICKS - 1 else 8.0
            for beam, (ahead, aside) in enumerate(memory.beams(len(beams)).units.tolist()):
                along_m = ahead * (DISC_M[0] - 0.05 * tick) + aside * DISC_M[1]
                off_m = aside * (DISC_M[0] - 0.05 * tick) - ahead * DISC_M[1]
                if along_m > 0.0 and abs(off_m) < DISC_M[2]:
                    beams[beam] = along_m - sqrt(DISC_M[2] * DISC_M[2] - off_m * off_m)
            frame = SensorFrame(
                robot=robot.name,
                tick=tick,
                stamp_ns=0,
                pose=Pose(x_m, robot.start[1], 0.0),
                twist=Twist(0.5, 0.1),
                wheels=Wheels(0.5, 0.5),
                contact=False,
                ranges=messages.array(beams),
            )
            map = msam.update(setup, frame.ranges_m(), ())
            state, wish = navigator.step(setup, state, frame, map, (), setup.dt_s, late)
            asked = Twist(wish.speed_mps, wish.turn_rate_radps)
            state, _, _ = navigator.hold(setup, state, frame, map, (), late, asked)
