"""Families again, under what robots outside a simulator have to bear.

Group --disturbed--> Group of the same instances, with noise, latency, speed errors, lost messages,
or drift
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial
from math import pi

import msgspec

from swarm.run.bench.navigation.cases import Case, Group
from swarm.scenario import Disturbance

DISTURBED = Disturbance(
    range_sigma_m=0.01,
    position_sigma_m=0.01,
    yaw_sigma_rad=pi / 360.0,  # half a degree
    latency_ticks=1,
    speed_error=0.05,
    loss_probability=0.2,
)
# Of odometry alone, on ways of some 12 m to goals that are 1 m wide.
DRIFT = Disturbance(drift_m_per_m=0.02, drift_m_max=0.5)
BURSTS = msgspec.structs.replace(DISTURBED, loss_ticks_max=5)

SEVERAL = ("circle-swap", "pairs", "random", "door", "corridor", "collision-avoidance")
# ending of the name -> what is declared, and the families it is for; who is alone loses no message
VARIANTS: dict[str, tuple[Disturbance, tuple[str, ...]]] = {
    "disturbed": (DISTURBED, (*SEVERAL, "barn")),
    "bursts": (BURSTS, SEVERAL),
    "drift": (DRIFT, ("barn",)),
}


def groups(every: Iterable[Group]) -> tuple[Group, ...]:
    """Those of some groups that there are disturbed variants of, in all of them."""
    some = tuple(every)
    return tuple(
        Group(
            family=f"{group.family}-{ending}",
            size=group.size,
            count=group.count,
            make=partial(disturb, group.make, f"{group.family}-{ending}", declared),
            seeded=group.seeded,
        )
        for ending, (declared, families) in VARIANTS.items()
        for group in some
        if group.family in families
    )


def disturb(make: Callable[[int], Case], family: str, declared: Disturbance, number: int) -> Case:
    """An instance under a disturbance; everything else stays, what it is measured against too."""
    case = make(number)
    plan = case.scenario
    return msgspec.structs.replace(
        case,
        family=family,
        scenario=msgspec.structs.replace(
            plan,
            title=f"Bench: {family} {case.size}, instance {number}",
            disturbance=declared,
        ),
    )
