"""Families again, with one robot that stops for good on its way, and who can do what after that.

Group --stopping--> Group of the same instances and a fault
TickRecord --observe--> Watch: who came no further since when, and who has said so

dead        its process is killed: silent, its body stands where it came to rest
half-dead   its motors are dead, its mind and its radio live

What is asked for then: whoever can arrive arrives; whoever cannot says that it is blocked, and does
not say it late.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial

import msgspec

from swarm import geometry
from swarm.faults import Dead, Fault, Kill
from swarm.geometry import Vec2
from swarm.messages import Beacon, Reason, TickRecord
from swarm.run.bench.navigation.cases import Case, Group
from swarm.run.chaos import reach
from swarm.scenario import Scenario
from swarm.score import Score

# Share of its straight way, at top speed, after which the first robot stops. At a gate, taking
# turns: before the mouth, and at two times at which it may be inside.
SHARES: dict[str, tuple[float, ...]] = {
    "circle-swap": (0.45,),
    "random": (0.3,),
    "door": (0.13, 0.5, 0.75),
    "corridor": (0.13, 0.5, 0.75),
}
ROW = 0  # who stops
KINDS: dict[str, type[Kill] | type[Dead]] = {"dead": Kill, "half-dead": Dead}
PROGRESS_M = 0.25  # less is none
SAID_S_MAX = 30.0  # from the last progress until it says so
SPARE_S = 40.0  # that a run lasts longer, so that there is time to say it
# How a robot says that it cannot go on: its way is closed, or its motors do not follow.
SAYING: tuple[Reason, ...] = ("blocked", "enclosed", "motors")
# A gap that leaves less on either side of a body may be taken for closed.
MARGIN_M = 0.12


class Watch(msgspec.Struct):
    """One robot: where it came to, and what it says about going no further."""

    place: Vec2 | None = None
    tick: int = 0  # of its last progress
    said_tick: int | None = None  # first time it said so since
    says_tick: int | None = None  # since when it says so without a break, None when it does not


def groups(every: Iterable[Group]) -> tuple[Group, ...]:
    """Those of some groups in which a robot stops, in both ways."""
    some = tuple(every)
    return tuple(
        Group(
            family=f"{group.family}-{ending}",
            size=group.size,
            count=group.count,
            make=partial(stop, group.make, f"{group.family}-{ending}", kind, group.family),
            seeded=group.seeded,
        )
        for ending, kind in KINDS.items()
        for group in some
        if group.family in SHARES
    )


def stop(
    make: Callable[[int], Case],
    family: str,
    kind: type[Kill] | type[Dead],
    plain: str,
    number: int,
) -> Case:
    """An instance in which the first robot stops; times to arrive in stay as they are."""
    case = make(number)
    plan = case.scenario
    share = SHARES[plain][number % len(SHARES[plain])]
    at_s = plan.tick_of(share * case.bounds_s[ROW]) * plan.dt_s
    return msgspec.structs.replace(
        case,
        family=family,
        scenario=msgspec.structs.replace(
            plan,
            title=f"Bench: {family} {case.size}, instance {number}",
            duration_s=plan.duration_s + SPARE_S,
            faults=(kind(target=plan.robots[ROW].name, at_s=at_s),),
        ),
    )


def observe(watches: list[Watch], record: TickRecord) -> None:
    """Add one tick."""
    for watch, robot in zip(watches, record.robots, strict=True):
        place = (robot.pose.x_m, robot.pose.y_m)
        says = robot.alive and says_blocked(robot.beacon)
        if watch.place is None or (
            geometry.length(place[0] - watch.place[0], place[1] - watch.place[1]) >= PROGRESS_M
        ):
            watch.place, watch.tick, watch.said_tick = place, record.tick, None
        if not says:
            watch.says_tick = None
            continue
        if watch.says_tick is None:
            watch.says_tick = record.tick
        if watch.said_tick is None:
            watch.said_tick = record.tick


def says_blocked(beacon: Beacon | None) -> bool:
    """Whether a robot tells that it does not get on; where it is, every beacon tells."""
    return beacon is not None and beacon.mode in ("HOLD", "FAILED") and beacon.reason in SAYING


def has_said(watch: Watch, scenario: Scenario) -> bool:
    """Whether a robot says so, and has begun to in time."""
    return (
        watch.says_tick is not None
        and watch.said_tick is not None
        and watch.said_tick - watch.tick <= scenario.tick_of(SAID_S_MAX)
    )


def is_under_way(watch: Watch, score: Score) -> bool:
    """Whether a robot came on so lately that it need not have said anything yet."""
    return score.tick - watch.tick <= score.scenario.tick_of(SAID_S_MAX)


def settled(watches: list[Watch], score: Score) -> bool:
    """Whether nobody has anything to do any more: all have arrived, or said so for long enough."""
    scenario = score.scenario
    steady = score.tick - scenario.tick_of(SAID_S_MAX)
    return all(
        not tally.alive
        or tally.contact
        or (tally.arrival_tick is not None and tally.arrival_tick <= steady)
        or (watch.says_tick is not None and watch.says_tick <= steady)
        for watch, tally in zip(watches, score.tallies, strict=True)
    )


def can_arrive(scenario: Scenario, record: TickRecord, row: int) -> bool:
    """Whether a robot that has not arrived could have: round everything that stands for good."""
    fault: Fault
    (fault,) = scenario.faults
    stopped = scenario.row(fault.target)
    if row == stopped:
        return False
    robots = list(record.robots)
    robots[stopped] = msgspec.structs.replace(robots[stopped], alive=False)
    goal = scenario.robots[row].goal
    assert goal is not None
    return reach.can_arrive(scenario, robots, row, goal, margin_m=MARGIN_M)
