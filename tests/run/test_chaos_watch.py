"""What must hold, on made-up ticks: each invariant sees what breaks it, and nothing else."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from swarm import faults, messages, metrics, scenario
from swarm.geometry import STILL, Pose
from swarm.messages import Array, Beacon, Event, FrameRecord, Leadership, RobotRecord, TickRecord
from swarm.run.chaos import groups, reach
from swarm.run.chaos.watch import Violation, Watch
from swarm.scenario import Scenario

TOML = b"""
title = "A row"
seed = 1
dt_s = 0.08
duration_s = 30.0
[formation]
leader = "robot1"
[[robots]]
name = "robot1"
start = [0.0, 0.0, 0.0]
goal = [9.0, 0.0]
[[robots]]
name = "robot2"
start = [-8.0, 0.0, 0.0]
[[robots]]
name = "robot3"
start = [-16.0, 0.0, 0.0]
[[robots]]
name = "robot4"
start = [-24.0, 0.0, 0.0]
"""
NAMES = ("robot1", "robot2", "robot3", "robot4")
NEAR_M = ((0.0, 0.0), (-1.0, 0.0), (-2.0, 0.0), (-3.0, 0.0))
CHAIN_M = ((0.0, 0.0), (-8.0, 0.0), (-16.0, 0.0), (-24.0, 0.0))  # radio reaches 10 m
APART_M = ((0.0, 0.0), (-1.0, 0.0), (50.0, 0.0), (51.0, 0.0))


def _plan(*drawn: faults.Fault) -> Scenario:
    import msgspec

    return msgspec.structs.replace(scenario.decode(TOML, "row"), faults=drawn)


def _claim(name: str, term: int = 0) -> Leadership:
    return Leadership(term, (0, 0, 0, NAMES.index(name)), name)


def _beacon(row: int, tick: int, follows: Leadership | None, **fields: object) -> Beacon:
    given: dict[str, object] = {"incarnation": 0, "yields_to": None, **fields}
    return Beacon(
        name=NAMES[row],
        tick=tick,
        incarnation=given["incarnation"],  # type: ignore[arg-type]
        pose=Pose(0.0, 0.0, 0.0),
        twist=STILL,
        body_radius_m=0.22,
        speed_mps_max=1.0,
        mode="FORM",
        arrived=False,
        priority=(1, row, 0, 0),
        leadership=follows,
        yields_to=given["yields_to"],  # type: ignore[arg-type]
    )


def _record(
    tick: int,
    follow: Sequence[Leadership | None],
    places_m: Sequence[tuple[float, float]] = NEAR_M,
    *,
    dead: Sequence[int] = (),
    touching: Sequence[int] = (),
    excused: Sequence[int] = (),
    heard: Sequence[tuple[int, int]] = (),
    events: Sequence[Event] = (),
    **fields: object,
) -> TickRecord:
    rows = tuple(
        RobotRecord(
            alive=row not in dead,
            contact=row in touching,
            pose=Pose(*place_m, 0.0),
            twist=STILL,
            applied=STILL,
            beacon=_beacon(row, tick, leadership, **fields),
            obstacle_clearance_m=1.0,
            excused=row in excused,
        )
        for row, (leadership, place_m) in enumerate(zip(follow, places_m, strict=True))
    )
    frames = []
    for listener in range(len(rows)):
        pairs = np.array(
            [(speaker, tick - 1) for one, speaker in heard if one == listener], np.int32
        ).reshape(-1, 2)
        frames.append(
            FrameRecord(
                listener,
                Pose(0.0, 0.0, 0.0),
                STILL,
                messages.Wheels(0.0, 0.0),
                False,
                Array("<f4", (0,), b""),
                messages.array(pairs),
            )
        )
    return TickRecord(tick, tick * 80_000_000, rows, tuple(frames), (), tuple(events))


def _event(kind: str, robot: str, fault: str, number: int = 0) -> Event:
    return Event(0, 0, kind, robot, "", fault=fault, number=number)  # type: ignore[arg-type]


def _watched(plan: Scenario, *records: TickRecord, healed_tick: int = 10**6) -> list[Violation]:
    watch = Watch(plan, healed_tick)
    for record in records:
        watch.observe(record)
    return list(watch.violations)


ALL_1 = (_claim("robot1"),) * 4


# --- groups -------------------------------------------------------------------------------------


def _groups(
    record: TickRecord, working: dict[int, set[int]], *drawn: faults.Fault
) -> list[set[int]]:
    found, _ = groups.Links(_plan(*drawn)).groups(record, working, drawn)
    return [set(group) for group in found]


def test_groups_are_those_who_hear_each_other_by_way_of_others_too() -> None:
    assert _groups(_record(1, ALL_1, CHAIN_M), {}) == [{0, 1, 2, 3}]
    assert _groups(_record(1, ALL_1, APART_M), {}) == [{0, 1}, {2, 3}]
    assert _groups(_record(1, ALL_1, CHAIN_M, dead=[1]), {}) == [{0}, {2, 3}]
    assert _groups(_record(1, ALL_1, dead=range(4)), {}) == []


def test_groups_are_parted_by_the_faults_of_links_at_work() -> None:
    partition = faults.Partition(target="robot1/robot2", at_s=0.0)
    deaf = faults.Deaf(target="robot3", at_s=0.0)
    hang = faults.Hang(target="robot4", at_s=0.0)
    near = _record(1, ALL_1)
    assert _groups(near, {0: {0, 1}}, partition) == [{0, 1}, {2, 3}]
    assert _groups(near, {1: {2}}, partition, deaf) == [{0, 1, 3}, {2}]
    assert _groups(near, {0: {3}}, hang) == [{0, 1, 2, 3}]


def test_a_lossy_link_counts_while_both_have_heard_each_other_within_half_a_second() -> None:
    loss = faults.Loss(target="robot1", at_s=0.0)
    links = groups.Links(_plan(loss))
    both = [(0, 1), (1, 0)]
    for tick, heard, expected in (
        (1, both, [{0, 1, 2, 3}]),
        (7, [(0, 1)], [{0, 1, 2, 3}]),  # row 1 heard row 0 six ticks ago
        (8, [], [{0}, {1, 2, 3}]),
    ):
        found, _ = links.groups(_record(tick, ALL_1, heard=heard), {0: {0}}, (loss,))
        assert [set(group) for group in found] == expected


def test_diameter_is_the_longest_of_the_shortest_ways() -> None:
    links = groups.Links(_plan())
    found, flags = links.groups(_record(1, ALL_1, CHAIN_M), {}, ())
    assert groups.diameter(flags, found[0]) == 3
    found, flags = links.groups(_record(1, ALL_1), {}, ())
    assert groups.diameter(flags, found[0]) == 1


# --- safety -------------------------------------------------------------------------------------


def test_a_contact_is_told_once_unless_a_fault_excuses_it() -> None:
    records = [
        _record(0, ALL_1),
        _record(1, ALL_1, touching=[2], excused=[2]),
        _record(2, ALL_1, touching=[1, 2], excused=[2]),
        _record(3, ALL_1, touching=[1, 2], excused=[2]),
    ]
    broken = _watched(_plan(), *records)
    assert [(one.invariant, one.tick, one.robots) for one in broken] == [
        ("contact", 2, ("robot2",))
    ]


def test_a_process_that_is_gone_without_a_fault_is_told() -> None:
    events = [_event("robot-lost", "robot2", "", -1), _event("fault-failed", "robot3", "kill")]
    broken = _watched(_plan(), _record(0, ALL_1), _record(1, ALL_1, events=events))
    assert [(one.invariant, one.robots) for one in broken] == [
        ("lost", ("robot2",)),
        ("lost", ("robot3",)),
    ]


# --- leaders ------------------------------------------------------------------------------------

SPLIT = (*(_claim("robot1"),) * 2, *(_claim("robot2"),) * 2)


@pytest.mark.parametrize(
    ("places_m", "ticks", "broken"),
    [(NEAR_M, 13, False), (NEAR_M, 14, True), (CHAIN_M, 39, False), (CHAIN_M, 40, True)],
)
def test_two_leaders_may_be_followed_for_13_ticks_a_link(
    places_m: Sequence[tuple[float, float]], ticks: int, broken: bool
) -> None:
    records = [_record(tick, SPLIT, places_m) for tick in range(ticks + 1)]
    found = _watched(_plan(), *records)
    assert [one.invariant for one in found] == (["two-leaders"] if broken else [])
    if broken:
        assert (found[0].tick, found[0].robots) == (ticks, NAMES)


def test_two_groups_may_have_two_leaders_for_as_long_as_they_like() -> None:
    split = (*(_claim("robot1"),) * 2, *(_claim("robot3"),) * 2)
    records = [_record(tick, split, APART_M) for tick in range(100)]
    assert _watched(_plan(), *records, healed_tick=0) == []


def test_the_bound_counts_from_the_last_change_of_the_group() -> None:
    records = [_record(tick, SPLIT) for tick in range(10)]
    records += [_record(tick, SPLIT, dead=[3]) for tick in range(10, 24)]
    assert _watched(_plan(), *records) == []
    records += [_record(tick, SPLIT, dead=[3]) for tick in range(24, 26)]
    assert [one.tick for one in _watched(_plan(), *records)] == [24]


def test_delayed_and_slow_robots_have_so_much_longer() -> None:
    delay = faults.Delay(target="all", at_s=0.0, delay_s=0.24)
    begin = [_event("fault", name, "delay") for name in NAMES]
    records = [_record(0, SPLIT, events=begin)]
    records += [_record(tick, SPLIT) for tick in range(1, 18)]
    found = _watched(_plan(delay), *records)
    assert [one.tick for one in found] == [17]  # 13 + 3


def test_a_group_that_follows_the_dead_is_told_once_the_faults_are_over() -> None:
    records = [_record(tick, ALL_1, dead=[0]) for tick in range(40)]
    assert _watched(_plan(), *records) == []
    found = _watched(_plan(), *records, healed_tick=20)
    assert [(one.invariant, one.tick) for one in found] == [("no-leader", 34)]


def test_a_leader_that_is_followed_again_is_counted_from_the_change() -> None:
    watch = Watch(_plan(), 10**6)
    for tick in range(5):
        watch.observe(_record(tick, ALL_1))
    for tick in range(5, 15):
        watch.observe(_record(tick, ALL_1, dead=[0]))
    watch.observe(_record(15, (_claim("robot2", 1),) * 4, dead=[0]))
    assert watch.agreed_s == pytest.approx([10 * 0.08])


@pytest.mark.parametrize(
    ("then", "incarnation", "broken"),
    [
        (_claim("robot3", 2), 0, False),
        (_claim("robot1", 1), 0, True),  # lower term
        (_claim("robot3", 1), 0, True),  # same term, worse key
        (None, 0, True),
        (_claim("robot1", 0), 1, False),  # another life
    ],
)
def test_a_leadership_that_is_followed_only_rises(
    then: Leadership | None, incarnation: int, broken: bool
) -> None:
    records = [_record(0, (_claim("robot2", 1),) * 4)]
    records.append(_record(1, (then,) * 4, incarnation=incarnation))
    kinds = {one.invariant for one in _watched(_plan(), *records)}
    assert kinds == ({"falls"} if broken else set())


def test_a_robot_that_claims_a_term_that_it_has_heard_of_is_told() -> None:
    follow = [_claim("robot2", 1)] * 4
    mine = [_claim("robot1", 1), *[_claim("robot2", 1)] * 3]  # a better key: it rises, and yet
    broken = _watched(_plan(), _record(0, follow), _record(1, mine))
    assert [(one.invariant, one.robots) for one in broken] == [("falls", ("robot1",))]


# --- progress -----------------------------------------------------------------------------------


def test_nobody_gives_way_for_longer_than_the_bound_of_a_formation() -> None:
    records = [_record(tick, ALL_1, yields_to="robot1") for tick in range(77)]
    assert _watched(_plan(), *records) == []  # 6 s and two ticks
    records += [_record(tick, ALL_1, yields_to="robot1") for tick in range(77, 90)]
    broken = _watched(_plan(), *records)
    assert [(one.invariant, one.tick) for one in broken] == [("waits", 77)] * 4


def _standing(
    places_m: Sequence[tuple[float, float]], dead: Sequence[int]
) -> tuple[RobotRecord, ...]:
    return _record(0, ALL_1, places_m, dead=dead).robots


def test_who_can_arrive_is_judged_by_free_ways() -> None:
    plan = _plan()
    free = _standing(NEAR_M, [])
    assert reach.can_arrive(plan, free, 0, (5.0, 0.0))
    beside = _standing(((0.0, 0.0), (5.0, 0.3), (-2.0, 0.0), (-3.0, 0.0)), [1])
    assert not reach.can_arrive(plan, beside, 0, (5.0, 0.0))  # its place is taken
    assert reach.can_arrive(plan, beside, 0, (5.0, 1.5))
    assert reach.can_arrive(plan, free, 0, None)  # somebody could tell it
    assert not reach.can_arrive(plan, _standing(NEAR_M, [1, 2, 3]), 0, None)


def test_who_is_walled_in_cannot_arrive() -> None:
    wall = b"""
[[obstacles]]
polygon = [[2.0, -30.0], [2.5, -30.0], [2.5, 30.0], [2.0, 30.0]]
"""
    walled = scenario.decode(TOML + wall, "walled")
    assert not reach.can_arrive(walled, _standing(NEAR_M, []), 0, (5.0, 0.0))
    assert reach.can_arrive(walled, _standing(NEAR_M, []), 0, (-1.0, 3.0))


def test_who_has_not_arrived_is_stuck_unless_nobody_knows_how_it_ended() -> None:
    plan = _plan()
    watch, score = Watch(plan, 0), metrics.begin(plan)
    for tick in range(3):
        record = _record(tick, ALL_1, dead=[3])
        watch.observe(record)
        metrics.observe(score, record)
    stuck = watch.conclude(score, "timeout").violations
    assert [(one.invariant, one.robots) for one in stuck] == [
        ("stuck", ("robot1",)),
        ("stuck", ("robot2",)),
        ("stuck", ("robot3",)),
    ]
    watch = Watch(plan, 0)
    watch.observe(_record(0, ALL_1))
    assert watch.conclude(score, None).violations == ()
