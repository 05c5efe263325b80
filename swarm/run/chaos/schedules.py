"""What goes wrong in a run, drawn from a seed: some faults at once, all of which can be survived.

    scenario, length, seed, number --draw--> Schedule --plan--> the scenario with faults and time

SURVIVABLE says how bad each kind may get. Within these bounds nobody touches anything, and whoever
lives arrives once the faults are over; `everything` draws beyond them, from EVERYTHING.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal, cast

import msgspec
import numpy as np

from swarm import faults
from swarm.faults import Fault
from swarm.scenario import Scenario

FAULTS_MAX = 6  # in one schedule
FIRST_TICK = 13  # before that not everybody has heard where it goes: an election's time
SPARED = 2  # robots that are neither killed nor started anew: somebody remembers the goal
WORLD_KILLS_MAX = 2  # the policy starts a world again five times in a minute
DISK_SHARE = 0.7  # of the undisturbed run's length, within which disks begin to be full
CONVERGE_S = 120.0  # after the last fault, and the undisturbed run's length besides

Whom = Literal["robots", "any", "world"]  # one to three by name or a share; all too; the world


class Bound(msgspec.Struct, frozen=True):
    """How bad one kind of fault may get."""

    kind: str
    lasts_s: tuple[float, float] | None  # None: it has no end
    key: str = ""  # its strength,
    least: float = 0.0  # within these bounds, which are ticks where the key is a time
    most: float = 0.0
    whom: Whom = "any"


SURVIVABLE = (
    Bound("kill", None, whom="robots"),
    Bound("kill", None, whom="world"),
    Bound("restart", (0.4, 4.0), whom="robots"),
    Bound("hang", (0.16, 4.0)),
    Bound("slow", (1.0, 10.0), "late_s", 1, 2),  # a command is good for command_ttl = 3 ticks
    Bound("loss", (1.0, 20.0), "probability", 0.05, 0.3),
    Bound("delay", (1.0, 20.0), "delay_s", 1, 3),
    Bound("duplicate", (1.0, 20.0), "probability", 0.05, 0.5),
    Bound("partition", (0.5, 4.0)),
    Bound("deaf", (0.5, 3.0)),
    Bound("mute", (0.5, 3.0)),
    Bound("dropout", (1.0, 10.0), "probability", 0.01, 0.1),
    Bound("noise", (1.0, 20.0), "sigma_m", 0.005, 0.02),
    Bound("bias", (1.0, 20.0), "bias_m", -0.05, 0.05),
    Bound("nan", (0.1, 3.0)),
    Bound("weak", (1.0, 10.0), "factor", 0.5, 0.9),
    Bound("dead", (0.5, 3.0)),
    Bound("corrupt", (1.0, 10.0)),
    Bound("disk-full", (0.5, 4.0), whom="world"),
)
EVERYTHING = (
    *SURVIVABLE,
    Bound("hang", (4.0, 20.0)),
    Bound("slow", (1.0, 20.0), "late_s", 3, 12),
    Bound("loss", (1.0, 60.0), "probability", 0.3, 1.0),
    Bound("delay", (1.0, 60.0), "delay_s", 4, 25),
    Bound("partition", (4.0, 30.0)),
    Bound("deaf", (3.0, 30.0)),
    Bound("mute", (3.0, 30.0)),
    Bound("dropout", (1.0, 20.0), "probability", 0.1, 1.0),
    Bound("sensor-stuck", (0.5, 5.0)),
    Bound("noise", (1.0, 20.0), "sigma_m", 0.02, 0.5),
    Bound("bias", (1.0, 20.0), "bias_m", -0.5, 0.5),
    Bound("nan", (3.0, 20.0)),
    Bound("actuator-stuck", (0.5, 5.0)),
    Bound("weak", (1.0, 20.0), "factor", 0.0, 0.5),
    Bound("dead", (3.0, 20.0)),
)


class Schedule(msgspec.Struct, frozen=True):
    """The faults of one run."""

    number: int
    faults: tuple[Fault, ...]  # in order of their beginnings

    @property
    def text(self) -> str:
        """As the command line writes them."""
        return " ".join(f"--fault {faults.text_of(fault)}" for fault in self.faults)


def draw(
    scenario: Scenario, length_s: float, seed: int, number: int, *, everything: bool = False
) -> Schedule:
    """Schedule `number` of a seed; no schedule depends on another.

    Args:
        length_s: of the undisturbed run; every fault begins within it.
    """
    dice = np.random.Generator(np.random.Philox(key=[seed, number]))
    count = int(dice.integers(1, FAULTS_MAX + 1))
    bounds = EVERYTHING if everything else SURVIVABLE
    drawn: list[Fault] = []
    while len(drawn) < count:
        bound = bounds[int(dice.integers(len(bounds)))]
        fault = _fault(scenario, length_s, bound, dice)
        if everything or is_fair(scenario, (*drawn, fault)):
            drawn.append(fault)
    return Schedule(number, tuple(sorted(drawn, key=lambda fault: fault.at_s)))


def is_fair(scenario: Scenario, drawn: Sequence[Fault]) -> bool:
    """Whether enough robots keep their memory, and no world dies too often."""
    robots = len(scenario.robots)
    lost = sum(
        _count(fault.target, robots)
        for fault in drawn
        if isinstance(fault, faults.Kill | faults.Restart) and fault.target != faults.WORLD
    )
    kills = sum(isinstance(fault, faults.Kill) for fault in drawn if fault.target == faults.WORLD)
    return lost <= max(0, robots - SPARED) and kills <= WORLD_KILLS_MAX


def healed_tick(scenario: Scenario, drawn: Sequence[Fault]) -> int:
    """The first tick without any of the faults; a kill is over when it is done."""
    return max(
        (scenario.tick_of(fault.at_s) + scenario.tick_of(fault.for_s or 0.0) for fault in drawn),
        default=0,
    )


def plan(scenario: Scenario, length_s: float, drawn: Sequence[Fault]) -> Scenario:
    """The scenario with these faults, and with time enough to converge behind them."""
    ticks = healed_tick(scenario, drawn) + scenario.tick_of(length_s + CONVERGE_S)
    return msgspec.structs.replace(
        scenario,
        faults=(*scenario.faults, *drawn),
        duration_s=rounded_s(scenario, ticks),
    )


def rounded_s(scenario: Scenario, ticks: int) -> float:
    """Seconds of so many ticks, as short as they can be written."""
    return round(ticks * scenario.dt_s, 9)


def _count(target: str, robots: int) -> int:
    """How many robots a target can strike at most."""
    if target == faults.EVERYONE:
        return robots
    if target.startswith(faults.ANY):
        return max(1, round(float(target.removeprefix(faults.ANY)) * robots))
    return 1 if target == faults.LEADER else len(faults.names_in(target))


def _fault(scenario: Scenario, length_s: float, bound: Bound, dice: np.random.Generator) -> Fault:
    # A disk that is full when the run ends takes nothing of its last ticks: let it be over by then.
    begins_s = DISK_SHARE * length_s if bound.kind == "disk-full" else length_s
    last_tick = max(FIRST_TICK + 1, scenario.tick_of(begins_s))
    table: dict[str, Any] = {
        "kind": bound.kind,
        "target": _target(scenario, bound.whom, dice),
        "at_s": rounded_s(scenario, int(dice.integers(FIRST_TICK, last_tick))),
    }
    if bound.lasts_s is not None:
        ticks = scenario.tick_of(float(dice.uniform(*bound.lasts_s)))
        table["for_s"] = rounded_s(scenario, max(1, ticks))
    if bound.key in ("late_s", "delay_s"):
        ticks = int(dice.integers(int(bound.least), int(bound.most) + 1))
        table[bound.key] = rounded_s(scenario, ticks)
    elif bound.key:
        table[bound.key] = round(float(dice.uniform(bound.least, bound.most)), 3)
    return msgspec.convert(table, cast("type[Fault]", Fault))


def _target(scenario: Scenario, whom: Whom, dice: np.random.Generator) -> str:
    """By role, by share or by name."""
    if whom == "world":
        return faults.WORLD
    names = [robot.name for robot in scenario.robots]
    roll = float(dice.random())
    if scenario.formation is not None and roll < 0.3:
        return faults.LEADER
    if roll < 0.5:
        return f"{faults.ANY}{round(float(dice.uniform(0.1, 0.6)), 2):g}"
    if whom == "any" and roll < 0.6:
        return faults.EVERYONE
    count = min(len(names), int(dice.integers(1, 4)))
    chosen = sorted(dice.choice(len(names), size=count, replace=False).tolist())
    return "/".join(names[row] for row in chosen)
