"""Every inner loop called once: for processes that start robots, before they do.

A robot then pays for neither compiling nor loading within a tick.
"""

from __future__ import annotations

from math import inf, pi, sqrt

import numpy as np

from agents import robot
from agents.navigator import corridor, memory, sight, walls
from swarm import messages, scenario
from swarm.geometry import Pose, Twist
from swarm.messages import Beacon, SensorFrame, Wheels

SCENE = b"""
title = "Two that meet before a wall that is seen, and then is not there"
seed = 0
dt_s = 0.08
duration_s = 1.0
[[robots]]
name = "robot1"
start = [0.0, 0.0, 0.0]
goal = [9.0, 0.0]
[[robots]]
name = "robot2"
start = [3.0, 0.1, 3.14159]
goal = [-99.0, 0.0]
[robot]
controller = "navigator"
"""
TICKS = 14
DISC_M = (0.4, 1.5, 0.25)  # from the robot, at first; it falls behind


def up() -> None:
    """Drive towards each other beside a disc that moves, lose sight of the wall, stand alone."""
    plan = scenario.decode(SCENE, "warm")
    setups = [plan.setup(one.name) for one in plan.robots]
    states = [robot.init(setup) for setup in setups]
    heard: list[Beacon] = []
    for tick in range(TICKS):
        said: list[Beacon] = []
        for number, setup in enumerate(setups):
            beams = np.full(setup.sensor.beams, inf, dtype=np.float32)
            if tick < TICKS // 2:
                beams[len(beams) * 3 // 8 : len(beams) * 5 // 8] = 1.0 + 0.01 * tick
            x_m, y_m, _ = setup.robot.start
            side = 1.0 - 2.0 * number
            x_m = x_m + 0.1 * side * tick if tick < TICKS - 1 else 12.0 * side
            for beam, (ahead, aside) in enumerate(memory.beams(len(beams)).units.tolist()):
                along_m = ahead * (DISC_M[0] - 0.05 * tick) + aside * DISC_M[1]
                off_m = aside * (DISC_M[0] - 0.05 * tick) - ahead * DISC_M[1]
                if along_m > 0.0 and abs(off_m) < DISC_M[2]:
                    beams[beam] = along_m - sqrt(DISC_M[2] * DISC_M[2] - off_m * off_m)
            frame = SensorFrame(
                robot=setup.robot.name,
                tick=tick,
                stamp_ns=0,
                pose=Pose(x_m, y_m, 0.0 if number == 0 else -pi),
                twist=Twist(0.5, 0.1),
                wheels=Wheels(0.5, 0.5),
                contact=False,
                ranges=messages.array(beams),
                beacons=tuple(heard[1 - number : 2 - number]),
            )
            states[number], command = robot.step(setup, states[number], frame)
            said.append(command.beacon)
        heard = said
    # there is no gap in the scene
    walls.end(np.zeros((1, 2)), 0.0, 0.0, 1.0, 0.0, 1.0)
    walls.inside(np.ones((1, 2)), np.ones((1, 2)), 0.5, 1.0, np.zeros(5))
    # nor is anything late
    rays = memory.beams(4)
    hits = np.frombuffer(bytes(16), dtype=np.float32)
    sight.hide(hits, np.ones((1, 4)), rays.units, rays.bounds, hits.copy())
    # nor a formation
    corridor.cheapest(np.zeros((1, 4)), np.zeros((1, 2)), 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 1.0)
