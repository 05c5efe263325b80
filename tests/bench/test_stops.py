"""Runs in which a robot stops for good: the fault is the real one, and who says what counts."""

from __future__ import annotations

from collections.abc import Sequence
from math import pi

import msgspec
import pytest

from swarm import metrics
from swarm.geometry import STILL, Pose
from swarm.messages import Beacon, Mode, Reason, RobotRecord, TickRecord
from swarm.run import lockstep
from swarm.run.bench.navigation import cases, course, encounters, stops
from swarm.run.bench.navigation.cases import Case, Group
from swarm.run.bench.navigation.course import Driven, Job
from swarm.run.bench.navigation.stops import Watch

GROUPS = stops.groups(encounters.groups())


def group(family: str, size: str) -> Group:
    (found,) = (one for one in GROUPS if (one.family, one.size) == (family, size))
    return found


@pytest.mark.parametrize("family", ["circle-swap-dead", "circle-swap-half-dead"])
def test_drive_makes_the_run_that_the_shells_make_when_a_robot_stops(family: str) -> None:
    case = cases.shortened(group(family, "4").make(1), 6.0)
    plan = cases.under(case, "navigator")
    driven = course.drive(plan)
    conduct = lockstep.run(plan)
    assert driven.score.hash.hexdigest() == conduct.score.hash.hexdigest()
    stopped_tick = plan.tick_of(plan.faults[0].at_s)
    assert 0 < stopped_tick < 50
    assert [fault.tick for fault in driven.score.faults] == [stopped_tick]
    assert driven.score.tallies[0].killed == (family == "circle-swap-dead")
    assert driven.last is not None
    assert driven.last.robots[0].twist == STILL
    assert len(driven.watches) == 4


@pytest.mark.parametrize("one", GROUPS, ids=lambda one: f"{one.family}-{one.size}")
def test_instances_are_the_plain_ones_with_a_fault(one: Group) -> None:
    plain_family = one.family.removesuffix("-dead").removesuffix("-half")
    (plain,) = (
        some for some in encounters.groups() if (some.family, some.size) == (plain_family, one.size)
    )
    case, before = one.make(2), plain.make(2)
    assert case.scenario.robots == before.scenario.robots
    assert (case.bounds_s, case.dues_s) == (before.bounds_s, before.dues_s)
    assert case.stops
    assert not before.stops
    (fault,) = case.scenario.faults
    assert 0.0 < fault.at_s < 0.8 * case.bounds_s[0]


def robot(x_m: float, mode: Mode = "GO", reason: Reason = "", *, alive: bool = True) -> RobotRecord:
    pose = Pose(x_m, 0.0, 0.0)
    beacon = Beacon("a", 0, 0, pose, STILL, 0.2, 1.0, mode, False, (1, 2, 3, 4), reason=reason)
    return RobotRecord(alive, False, pose, STILL, STILL, beacon, 1.0)


def watched(*robots: tuple[int, RobotRecord]) -> Watch:
    watch = Watch()
    for tick, one in robots:
        stops.observe([watch], TickRecord(tick, 0, (one,), (), ()))
    return watch


def test_watch_takes_a_quarter_of_a_metre_for_progress_and_less_for_none() -> None:
    watch = watched((0, robot(0.0)), (10, robot(0.2)), (20, robot(0.26)), (30, robot(0.0)))
    assert (watch.tick, watch.said_tick, watch.says_tick) == (30, None, None)
    assert watched((0, robot(0.0)), (10, robot(0.26)), (20, robot(0.1))).tick == 10


def test_watch_remembers_when_it_was_said_first_since_the_last_progress() -> None:
    said = [
        (0, robot(0.0)),
        (100, robot(0.1, "HOLD", "blocked")),
        (200, robot(0.1)),
        (400, robot(0.1, "FAILED", "blocked")),
    ]
    watch = watched(*said)
    assert (watch.tick, watch.said_tick, watch.says_tick) == (0, 100, 400)
    plan = group("door-dead", "1.0m").make(0).scenario
    assert stops.has_said(watch, plan)  # 8 s after its last progress, and now
    assert not stops.has_said(watched(*said[:3]), plan)  # not any more
    assert not stops.has_said(watched(said[0], said[3]), plan)  # after 32 s
    moved = watched(*said, (500, robot(1.0, "HOLD", "blocked")))
    assert (moved.tick, moved.said_tick, moved.says_tick) == (500, 500, 400)


@pytest.mark.parametrize(
    ("mode", "reason", "says"),
    [
        ("HOLD", "blocked", True),
        ("FAILED", "enclosed", True),
        ("HOLD", "motors", True),
        ("HOLD", "sensors", False),
        ("FAILED", "too-long", False),
        ("GO", "", False),
    ],
)
def test_only_some_words_mean_blocked(mode: Mode, reason: Reason, says: bool) -> None:
    assert stops.says_blocked(robot(0.0, mode, reason).beacon) is says


IN_TIME = Watch((0.0, 0.0), 100, 200, 200)
NEVER = Watch((0.0, 0.0), 100, None, None)


def corridor(places: Sequence[tuple[float, float]], *, half: bool) -> tuple[Case, TickRecord]:
    """A corridor of 4 m by 0.8 m with robots in these places, the first of which has stopped."""
    case = group("corridor-half-dead" if half else "corridor-dead", "0.8m").make(0)
    robots = tuple(
        msgspec.structs.replace(
            robot(0.0, alive=row > 0 or half), pose=Pose(x_m, y_m, pi if x_m > 0.0 else 0.0)
        )
        for row, (x_m, y_m) in enumerate(places)
    )
    return case, TickRecord(1000, 0, robots, (), ())


BEFORE = [(-3.0, -1.5), (-3.0, 1.5), (-4.0, 1.0), (-4.0, -1.0)]
BEHIND = [(3.0, -1.5), (3.0, 1.5), (4.0, 1.0), (4.0, -1.0)]


def judged(
    places: Sequence[tuple[float, float]],
    arrived: Sequence[int],
    said: Sequence[int],
    *,
    half: bool = False,
    stay_s: float = 64.0,
    reached_s: dict[int, float] | None = None,
) -> course.Run:
    case, last = corridor(places, half=half)
    score = metrics.begin(cases.under(case, "navigator"))
    score.tick = 1000
    for row, tally in enumerate(score.tallies):
        tally.arrival_tick = round(stay_s / case.scenario.dt_s) if row in arrived else None
        tally.alive, tally.killed = half or row > 0, row == 0 and not half
    watches = tuple(IN_TIME if row in said else NEVER for row in range(8))
    return course.judge(
        Job(case, "navigator"), Driven(score, 4, 0.001, watches, last, reached_s or {})
    )


def test_who_was_at_its_goal_in_time_first_is_not_late_when_one_stops_either() -> None:
    places, rest = [*BEFORE, *BEHIND], range(1, 8)
    late_s = max(corridor(places, half=False)[0].dues_s) + 8.0
    assert judged(places, rest, said=[], stay_s=late_s).outcome == "timeout"
    first_s = dict.fromkeys(rest, 10.0)
    run = judged(places, rest, said=[], stay_s=late_s, reached_s=first_s)
    assert (run.outcome, run.arrived) == ("succeeded", 7)


def test_run_succeeds_when_a_closed_corridor_is_said_to_be_closed_by_all() -> None:
    places = [(0.0, 0.0), *BEFORE[1:], *BEHIND]
    run = judged(places, arrived=(), said=range(1, 8))
    assert (run.outcome, run.arrived, run.told, run.robots) == ("succeeded", 0, 7, 8)
    assert (run.makespan_ratio, run.time_ratio) == (None, None)
    assert judged(places, arrived=(), said=range(2, 8)).outcome == "timeout"


def test_run_has_blocked_robots_when_one_says_so_whose_way_is_open() -> None:
    run = judged([*BEFORE, *BEHIND], arrived=range(2, 8), said=[1])
    assert (run.outcome, run.arrived, run.told) == ("blocked", 6, 0)
    run = judged([*BEFORE, *BEHIND], arrived=range(1, 8), said=[])
    assert (run.outcome, run.arrived, run.told) == ("succeeded", 7, 0)
    assert run.makespan_ratio is not None


def test_robot_with_dead_motors_has_to_say_so_itself() -> None:
    run = judged([*BEFORE, *BEHIND], arrived=range(1, 8), said=[0], half=True)
    assert (run.outcome, run.arrived, run.told) == ("succeeded", 7, 1)
    run = judged([*BEFORE, *BEHIND], arrived=range(1, 8), said=[], half=True)
    assert run.outcome == "timeout"


def test_who_came_on_lately_need_not_have_said_that_it_is_blocked() -> None:
    case, _ = corridor([*BEFORE, *BEHIND], half=False)
    score = metrics.begin(cases.under(case, "navigator"))
    score.tick = 1000
    assert stops.is_under_way(Watch((0.0, 0.0), 700, None, None), score)  # 24 s ago
    assert not stops.is_under_way(Watch((0.0, 0.0), 600, None, None), score)


def test_run_is_settled_when_nobody_has_anything_to_do_any_more() -> None:
    case, _ = corridor([*BEFORE, *BEHIND], half=False)
    score = metrics.begin(cases.under(case, "navigator"))
    score.tick = 1000
    watches = [Watch((0.0, 0.0), 0, 500, 500) for _ in score.tallies]
    assert stops.settled(watches, score)
    watches[3].says_tick = 700  # not yet for 30 s
    assert not stops.settled(watches, score)
    score.tallies[3].arrival_tick = 600
    assert stops.settled(watches, score)
    score.tallies[3].arrival_tick = None
    score.tallies[3].alive = False
    assert stops.settled(watches, score)
