"""Controllers of one's own: a file here is one, by its name.

    robot.controller = "mine" --> agents/controllers/mine.py: step(setup, memory, frame, map, peers)

    setup    swarm.scenario.RobotSetup: limits, tolerances, `setup.robot.goal`, way-points
    memory   whatever the step before returned, None before the first; never changed in place
    frame    swarm.messages.SensorFrame: pose, twist, ranges
    map      agents.msam.Map: what stands around, by sectors and arcs, without peers that move
    peers    agents.peers.Peer of everyone heard, moved on to this tick
    returns  (memory, agents.steering.Wish): speed and turn rate, and the mode for all to see

It must be pure, as all of agents: the same arguments, the same result; else replay says where not.
Right of way, limits of acceleration and the braking guards stand behind it, whatever it wishes.
It serves robots with a goal of their own; formations keep to the built-in ones.
"""

from __future__ import annotations

import functools
import importlib
from collections.abc import Callable
from typing import Any

from agents.msam import Map
from agents.peers import Peer
from agents.steering import Wish
from swarm.messages import SensorFrame
from swarm.scenario import CONTROLLERS, RobotSetup

Own = Callable[[RobotSetup, Any, SensorFrame, Map, list[Peer]], tuple[Any, Wish]]


@functools.cache
def of(name: str) -> Own | None:
    """Step of a controller of one's own; None for the built-in ones."""
    if name in CONTROLLERS:
        return None
    own: Own = importlib.import_module(f"{__name__}.{name}").step
    return own
