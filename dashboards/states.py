"""What a robot's time line shows: its mode, or why it has none, and what is wrong with it.

events of a tick --follow--> Troubles (how each was lost, which faults are at work)
Troubles, truth of the tick --words--> "FORM", "FORM, link fault", "killed", ...
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import get_args

import msgspec

from swarm import faults
from swarm.faults import ActuatorFault, Corrupt, LinkFault, SensorFault, Slow
from swarm.messages import EventKind, Mode, TickRecord
from swarm.scenario import Scenario

# What faults of a living robot are called; the first of those at work is shown.
TROUBLES: Mapping[str, tuple[type, ...]] = {
    "motor fault": get_args(ActuatorFault),
    "sensor fault": get_args(SensorFault),
    "slow": (Slow,),
    "link fault": get_args(LinkFault),
    "garbage": (Corrupt,),
}
LOST_BY_FAULT = {"kill": "killed", "restart": "restarting", "hang": "hung"}
LOST_BY_ITSELF: Mapping[EventKind, str] = {
    "robot-missing": "missing",
    "robot-lost": "lost",
    "robot-hung": "hung",
}
COLLIDED = "collided"
DEAD = "dead"  # nobody said why
SILENT = "silent"
YIELDS = "yields"  # as long as it waits for another, and nothing is wrong with it
MODES: tuple[str, ...] = get_args(Mode)

_TROUBLE_OF = {
    kind: trouble
    for trouble, types in TROUBLES.items()
    for kind, type_ in faults.KINDS.items()
    if type_ in types
}
_RANK = {trouble: rank for rank, trouble in enumerate(TROUBLES)}


class Troubles(msgspec.Struct, frozen=True):
    """What events have told so far, by robot's name."""

    lost: Mapping[str, str] = {}  # how it was lost last
    faults: Mapping[str, Mapping[int, str]] = {}  # those at work: number -> trouble


def follow(troubles: Troubles, record: TickRecord) -> Troubles:
    """Troubles after the events of one more tick."""
    if not record.events:
        return troubles
    lost = dict(troubles.lost)
    at_work = {name: dict(found) for name, found in troubles.faults.items()}
    for event in record.events:
        name = event.robot
        if name is None:
            continue
        if event.kind in LOST_BY_ITSELF:
            lost[name] = LOST_BY_ITSELF[event.kind]
        elif event.kind == "fault" and event.fault in LOST_BY_FAULT:
            lost[name] = LOST_BY_FAULT[event.fault]
        elif event.kind == "fault" and event.fault in _TROUBLE_OF:
            at_work.setdefault(name, {})[event.number] = _TROUBLE_OF[event.fault]
        elif event.kind == "fault-over":
            at_work.get(name, {}).pop(event.number, None)
    return Troubles(lost, at_work)


def words(scenario: Scenario, troubles: Troubles, record: TickRecord) -> tuple[str, ...]:
    """What each robot's time line shows at one tick."""
    found = []
    for setup, robot in zip(scenario.robots, record.robots, strict=True):
        if robot.contact:
            found.append(COLLIDED)
        elif not robot.alive:
            found.append(troubles.lost.get(setup.name, DEAD))
        else:
            mode: str = SILENT if robot.beacon is None else robot.beacon.mode
            wrong = troubles.faults.get(setup.name)
            if wrong:
                mode = joined(mode, min(wrong.values(), key=_RANK.__getitem__))
            elif robot.beacon is not None and robot.beacon.yields_to is not None:
                mode = joined(mode, YIELDS)
            found.append(mode)
    return tuple(found)


def joined(mode: str, more: str) -> str:
    """Word for a robot that goes on with something wrong, or waits."""
    return f"{mode}, {more}"
