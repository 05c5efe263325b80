"""`swarm bench navigation`: its runs are the real ones, its figures add up, its cases are fair.

Whether robots arrive is what it measures, so no test here asks for it.
"""

from __future__ import annotations

import functools
import math
import os
import re
import signal
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import get_args

import msgspec
import numpy as np
import psutil
import pytest
from hypothesis import given
from hypothesis import strategies as st

import tests.run.processes as commands
from swarm import errors, metrics, movers, scenario
from swarm.run import lockstep, sharing
from swarm.run.bench import navigation
from swarm.run.bench.navigation import (
    cases,
    course,
    disturbed,
    encounters,
    moving,
    obstacles,
    peers,
    rows,
    stops,
    table,
)
from swarm.run.bench.navigation import data as public
from swarm.run.bench.navigation.cases import Case, Group
from swarm.run.bench.navigation.course import Job, Run
from swarm.scenario import Scenario, Stage
from world import scene, simulation

END_S = 30.0
FAMILIES = (*navigation.FAMILIES, *(name for some in navigation.VARIANTS.values() for name in some))
RUNS_TINY = len(FAMILIES)
PLAIN = (*encounters.groups(), *obstacles.groups(), *moving.groups())
EVERY = (*PLAIN, *disturbed.groups(PLAIN), *stops.groups(PLAIN))

BARN = {
    "cylinder_radius_m": 0.075,
    "start": [-2.25, 3.0, 1.5708],
    "goal": [-2.25, 13.0],
    "goal_tolerance_m": 1.0,
    "timeout_s": 100.0,
    "speed_mps_max": 2.0,
    "worlds": [{"index": 3, "optimal_path_m": 12.0, "cylinders_xy_m": [[-2.0, 8.0]]}],
}
AVOIDANCE = {
    "goal_tolerance_m": 0.2,
    "cases": {"2": [[[0.0, 0.0, 4.0, 0.0, 1.0, 0.5], [4.0, 2.0, 0.0, 2.0, 0.5, 0.3]]]},
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Folder with public data of one world and one case."""
    (tmp_path / public.BARN).write_bytes(msgspec.json.encode(BARN))
    (tmp_path / public.AVOIDANCE).write_bytes(msgspec.json.encode(AVOIDANCE))
    return tmp_path


# --- all of it, in the smallest size ------------------------------------------------------------


def test_bench_navigation_shows_every_family_and_its_worst_runs_when_tiny(folder: Path) -> None:
    out = folder / "worst"
    line = f"bench navigation --tiny --controllers navigator --json --data {folder} --out {out}"
    result = commands.swarm(folder, *line.split())
    assert result.returncode == 0, result.stderr
    found = msgspec.json.decode(result.stdout, type=rows.Navigation, strict=True)
    assert [row.family for row in found.rows] == list(FAMILIES)
    assert len(found.runs) == len(found.rows) == RUNS_TINY
    assert found.skipped == ()
    assert all(row.runs == 1 and row.met is None for row in found.rows)
    assert all(row.step_us is not None and row.step_us > 0.0 for row in found.rows)
    assert len(found.worst) == RUNS_TINY
    # what the command shows is that very run
    shown = found.worst[0]
    verb, path = shown.command.split()[:3:2]
    assert verb == "swarm"
    plan = scenario.decode((folder / path).read_bytes(), path)
    assert lockstep.run(plan).score.hash.hexdigest() == shown.run.state_hash
    assert commands.belonging(folder) == []


def test_bench_navigation_says_what_it_skips_when_data_is_absent(tmp_path: Path) -> None:
    plan = navigation.plan(folder=tmp_path, tiny=True)
    assert [line.split(":")[0] for line in plan.skipped] == ["barn", "collision-avoidance"]
    from_data = ("barn", "collision-avoidance")
    assert {group.family for group in plan.groups} == {
        family for family in FAMILIES if not family.startswith(from_data)
    }
    assert navigation.plan(folder=tmp_path, families="pairs").skipped == ()


def test_bench_navigation_refuses_damaged_data(tmp_path: Path) -> None:
    (tmp_path / public.BARN).write_text('{"worlds": []}')
    with pytest.raises(errors.UsageError, match=r"barn\.json: expected the benchmark's data"):
        navigation.plan(folder=tmp_path)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("bench navigation --families pear", r"--families: expected .* 'pear'; .* 'pairs'\?"),
        ("bench navigation --controllers fast", "--controllers: expected some of paper, navigator"),
        ("bench navigation --seeds 9-2", "--seeds: expected A-B with A <= B"),
        ("bench navigation --seeds 1-", "--seeds: expected A-B"),
        ("bench navigation --families traps --seeds 9", "--seeds: expected some of the instances"),
        ("bench step --seeds 1-2", "--seeds: expected `swarm bench navigation` alone, got step"),
        ("bench step navigation", "or navigation alone, got 'navigation'"),
    ],
)
def test_bench_navigation_exits_2_when_a_flag_is_wrong(
    line: str,
    said: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    result = commands.here(monkeypatch, capsys, tmp_path, line)
    assert result.returncode == 2
    assert re.search(said, result.stderr)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_bench_navigation_leaves_no_process_when_it_is_ended(
    tmp_path: Path, number: signal.Signals
) -> None:
    line = "bench navigation --families circle-swap --seeds 0 --controllers paper"
    process = commands.start(tmp_path, *line.split())
    commands.until(lambda: commands.named(tmp_path, "swarm-bench"), END_S, "the crew is at work")
    process.send_signal(number)
    _, said = process.communicate(timeout=END_S)
    commands.until(lambda: not commands.belonging(tmp_path), END_S, "all processes are gone")
    if number == signal.SIGINT:
        assert process.returncode == 130
        assert "Traceback" not in said


@pytest.mark.parametrize("as_json", [False, True])
def test_bench_navigation_shows_what_is_done_when_it_is_interrupted(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    as_json: bool,
) -> None:
    def interrupted(
        work: object, jobs: Iterator[Job], workers: int, name: str
    ) -> Iterator[sharing.Done[Job, Run]]:
        yield sharing.Done(next(jobs), _run(0, "timeout", family="door", size="1.0m"))
        raise KeyboardInterrupt

    monkeypatch.setattr(sharing, "share", interrupted)
    line = (
        f"bench navigation --families door --seeds 0-2 --controllers paper --out {tmp_path / 'x'}"
    )
    result = commands.here(monkeypatch, capsys, tmp_path, line + " --json" * as_json)
    assert result.returncode == 130
    if as_json:
        found = msgspec.json.decode(result.stdout, type=rows.Navigation, strict=True)
        assert (found.partial, found.planned, len(found.runs), len(found.rows)) == (True, 3, 1, 1)
    else:
        assert "PARTIAL: interrupted after 1 of 3 runs" in result.stdout


# --- what is asked for --------------------------------------------------------------------------


def test_plan_has_the_full_sizes_when_nothing_is_asked(folder: Path) -> None:
    plan = navigation.plan(folder=folder)
    counts = Counter[str]()
    for group in plan.groups:
        counts[group.family] += len(plan.numbers[group.family, group.size])
    assert counts == {
        "circle-swap": 6 * 21,
        "pairs": 2,
        "random": 450,
        "door": 10,
        "corridor": 10,
        "traps": 10,
        "paper-fields": 300,
        "paper-u": 30,
        "paper-walls": 30,
        "moving": 300,
        "moving-several": 50,
        "barn": 2,
        "collision-avoidance": 1,
    }
    assert plan.count == len(navigation.CONTROLLERS) * counts.total()


def test_plan_takes_only_the_sizes_asked_for(folder: Path) -> None:
    plan = navigation.plan(folder=folder, families="random,circle-swap", sizes="50x16m2,4")
    assert [(group.family, group.size) for group in plan.groups] == [
        ("circle-swap", "4"),
        ("random", "50x16m2"),
    ]
    with pytest.raises(errors.UsageError, match=r"--sizes: expected some of 2, 4, .*'5'"):
        navigation.plan(folder=folder, families="circle-swap", sizes="5")


def test_plan_takes_all_families_of_a_kind_by_its_word_and_never_unasked(folder: Path) -> None:
    plan = navigation.plan(folder=folder, families="bursts,door", sizes="16,1.0m", seeds="3")
    assert [(group.family, group.size) for group in plan.groups] == [
        ("door", "1.0m"),
        ("circle-swap-bursts", "16"),
        ("door-bursts", "1.0m"),
    ]
    families = {group.family for group in navigation.plan(folder=folder).groups}
    assert families == set(navigation.FAMILIES)


def test_plan_takes_seeds_beyond_a_list_only_where_instances_are_drawn(folder: Path) -> None:
    plan = navigation.plan(folder=folder, seeds="2-30", controllers="paper", families="traps,door")
    sizes = {key: list(numbers) for key, numbers in plan.numbers.items()}
    assert sizes["traps", "u"] == [2, 3]
    assert sizes["traps", "canyon"] == []
    assert sizes["door", "1.0m"] == list(range(2, 31))
    assert plan.count == 2 + 2 + 29
    assert {job.controller for job in plan.jobs()} == {"paper"}


# --- cases --------------------------------------------------------------------------------------


@pytest.mark.parametrize("group", EVERY, ids=lambda group: f"{group.family}-{group.size}")
def test_every_group_makes_the_same_case_twice_and_another_one_next(group: Group) -> None:
    case = group.make(0)
    assert case == group.make(0)
    assert (case.family, case.size, case.number) == (group.family, group.size, 0)
    simulation.build(case.scenario)  # obstacles fit, nobody starts on one
    if group.count > 1:
        assert (
            group.make(1).scenario.robots != case.scenario.robots
            or group.make(1).scenario.obstacles != case.scenario.obstacles
            or group.make(1).scenario.seed != case.scenario.seed
        )


@given(
    group=st.sampled_from([group for group in EVERY if group.seeded]),
    number=st.integers(0, navigation.SEED_MAX),
)
def test_goals_are_free_and_apart_for_any_seed(group: Group, number: int) -> None:
    plan = group.make(number).scenario
    standing = scene.build(scene.obstacles(plan))
    for row, robot in enumerate(plan.robots):
        assert robot.goal is not None
        gap_m = scene.clearance(standing, np.array([robot.goal]))[0]
        assert gap_m > robot.body_radius_m
        for other in plan.robots[:row]:
            assert other.goal is not None
            apart_m = math.dist(robot.goal, other.goal)
            assert apart_m > robot.body_radius_m + other.body_radius_m


@pytest.mark.parametrize("count", encounters.SWAP_SIZES)
def test_circle_swap_is_exactly_symmetric_in_number_0_and_noisy_in_others(count: int) -> None:
    robots = encounters.circle_swap(count, 0).scenario.robots
    radius_m = max(4.0, count * 0.8 / math.tau)
    for row, robot in enumerate(robots):
        assert math.hypot(*robot.start[:2]) == pytest.approx(radius_m)
        opposite = robots[(row + count // 2) % count].start[:2]
        assert robot.goal == pytest.approx(opposite)
    noisy = encounters.circle_swap(count, 1).scenario.robots
    offs_m = [math.dist(a.start[:2], b.start[:2]) for a, b in zip(noisy, robots, strict=True)]
    assert min(offs_m) > 0.0
    assert max(offs_m) <= 0.1 * math.sqrt(2.0)
    assert [robot.goal for robot in noisy] == [robot.goal for robot in robots]


def test_u_shape_is_hollow_towards_the_robot() -> None:
    standing = scene.build((obstacles.u_shape(6.0, 3.0, 1.0),))
    # inside 1.0 from the bottom; just before the mouth between both arms; in the bottom itself
    points = np.array([[5.0, 0.0], [2.9, 0.0], [6.1, 0.0]])
    assert scene.clearance(standing, points).tolist() == pytest.approx(
        [1.0, math.hypot(0.1, 1.0), -0.1]
    )


def test_gate_lets_one_body_through_and_nobody_round() -> None:
    for make, width_m in ((encounters.door, 1.0), (encounters.corridor, 0.8)):
        plan = make(0).scenario
        standing = scene.build(plan.obstacles)
        centre = np.array([[0.0, 0.0]])
        assert scene.clearance(standing, centre)[0] == pytest.approx(width_m / 2.0)
        around_m = 2.0 * (encounters.WALL_REACH_M - encounters.PLATOON_ASIDE_M)
        assert around_m > plan.duration_s * plan.robots[0].speed_mps_max


@pytest.mark.parametrize("count", moving.SIZES)
def test_what_moves_keeps_clear_of_what_stands_and_of_start_and_goal(count: int) -> None:
    plan = moving.field(count, 3).scenario
    every = scene.obstacles(plan)
    standing = scene.build(every)
    assert len(standing.circles) == count
    assert standing.circles.tolist() == (
        scene.build(scene.obstacles(obstacles.paper_field(count, 3).scenario)).circles.tolist()
    )
    some = movers.moving(every)
    assert len(some) == 12
    (robot,) = plan.robots
    ends_m = np.array([robot.start[:2], robot.goal])
    for time_s in np.arange(0.0, 30.0, 0.2).tolist():
        places_m = movers.places_m(some, time_s)
        assert scene.clearance(standing, places_m).min() >= 0.25 + 0.6 - 1e-9
        assert scene.clearance(scene.at(some, time_s), ends_m).min() >= 1.5 - 1e-9
    assert all(0.3 <= mover.speed_mps <= 1.0 for mover in some)


def test_public_cases_keep_the_benchmarks_own_rules(folder: Path) -> None:
    groups, _ = public.groups(folder)
    small, stout, discs = (group.make(0) for group in groups)
    robot = small.scenario.robots[0]
    assert (robot.body_radius_m, stout.scenario.robots[0].body_radius_m) == (0.215, 0.33)
    assert (robot.speed_mps_max, robot.goal_tolerance_m) == (2.0, 1.0)
    assert small.scenario.obstacles[0].circle == (-2.0, 8.0, 0.075)
    assert (small.scenario.duration_s, small.bounds_s, small.scored) == (100.0, (6.0,), True)
    assert [one.body_radius_m for one in discs.scenario.robots] == [0.5, 0.3]
    assert discs.bounds_s == (4.0, 8.0)  # 4 m at 1 and at 0.5 m/s
    assert discs.dues_s == (32.0, 64.0)
    assert discs.scenario.duration_s == 64.0


# --- one run ------------------------------------------------------------------------------------


def test_drive_makes_the_run_that_the_shells_make() -> None:
    for case in (encounters.lanes(0), obstacles.trap("u", lambda _: obstacles.wall(3.0, 2.0), 0)):
        plan = cases.under(cases.shortened(case, 4.0), "navigator")
        driven = course.drive(plan)
        conduct = lockstep.run(plan)
        assert driven.score.hash.hexdigest() == conduct.score.hash.hexdigest()
        assert driven.steps == conduct.commands_total == 51 * len(plan.robots)
        assert driven.step_cpu_s > 0.0


def _told(case: Case, **tallies: tuple[object, ...]) -> course.Driven:
    """A run in which the robots' tallies say so."""
    score = metrics.begin(cases.under(case, "paper"))
    score.tick = case.scenario.tick_of(case.scenario.duration_s)
    for field, values in tallies.items():
        for tally, value in zip(score.tallies, values, strict=True):
            setattr(tally, field, value)
    return course.Driven(score, steps=4, step_cpu_s=0.001)


def _two() -> Case:
    """4 m at 1 m/s and 2 m at 0.5 m/s: bounds 4 s, due 32 s."""
    slow = msgspec.structs.replace(cases.NEUTRAL, speed_mps_max=0.5)
    robots = [
        cases.robot(0, (0.0, 0.0, 0.0), (4.0, 0.0)),
        cases.robot(1, (0.0, 2.0, 0.0), (2.0, 2.0), slow),
    ]
    return cases.case("pairs", "lanes", 0, robots, patience=8.0)


def test_judge_takes_ratios_over_the_bounds() -> None:
    # ticks of 0.08 s: 6 s and 10 s over 4 s; ways of 4.4 m over 4 m and 3 m over 2 m
    driven = _told(_two(), arrival_tick=(75, 125), path_m=(4.4, 3.0))
    driven.score.clearance_robot_m = 0.25
    run = course.judge(Job(_two(), "paper"), driven)
    assert (run.outcome, run.arrived, run.clearance_m) == ("succeeded", 2, 0.25)
    assert run.makespan_ratio == pytest.approx(2.5)
    assert run.time_ratio == pytest.approx(2.0)
    assert run.path_ratio == pytest.approx(1.3)
    assert run.step_us == pytest.approx(250.0)
    assert run.score is None


def test_who_made_room_for_another_was_in_time_when_it_was_at_its_goal_first() -> None:
    """Due after 32 s: there after 10 s, and again, at last, after 40 s."""
    driven = _told(_two(), arrival_tick=(75, 500))
    driven = msgspec.structs.replace(driven, reached_s={0: 6.0, 1: 10.0})
    run = course.judge(Job(_two(), "paper"), driven)
    assert (run.outcome, run.arrived) == ("succeeded", 2)
    assert run.makespan_ratio == pytest.approx(10.0)  # over the bound of 4 s: to the last stay
    away = _told(_two(), arrival_tick=(75, None))
    away = msgspec.structs.replace(away, reached_s={0: 6.0, 1: 10.0})
    assert course.judge(Job(_two(), "paper"), away).outcome == "timeout"


def test_drive_tells_when_each_was_at_its_goal_first() -> None:
    driven = course.drive(cases.under(encounters.random_places(10, 4.0, 1), "navigator"))
    stays_s = [0.08 * (tally.arrival_tick or 0) for tally in driven.score.tallies]
    assert sorted(driven.reached_s) == list(range(len(stays_s)))
    sooner_s = [stay_s - driven.reached_s[row] for row, stay_s in enumerate(stays_s)]
    assert min(sooner_s) == pytest.approx(0.0)  # most stay where they arrive
    assert max(sooner_s) > 1.0  # one makes room and comes back


@pytest.mark.parametrize(
    ("tallies", "outcome", "arrived"),
    [
        ({"arrival_tick": (75, None)}, "timeout", 1),
        ({"arrival_tick": (75, 401)}, "timeout", 1),  # 32.08 s, later than its own time
        ({"arrival_tick": (75, None), "mode": ("ARRIVED", "FAILED")}, "blocked", 1),
        ({"arrival_tick": (None, None), "mode": ("GO", "FAILED")}, "timeout", 0),
        ({"arrival_tick": (75, None), "contact": (False, True)}, "collided", 1),
    ],
)
def test_judge_says_why_a_run_failed(
    tallies: dict[str, tuple[object, ...]], outcome: str, arrived: int
) -> None:
    run = course.judge(Job(_two(), "paper"), _told(_two(), **tallies))
    assert (run.outcome, run.arrived) == (outcome, arrived)
    assert (run.makespan_ratio, run.time_ratio, run.path_ratio) == (None, None, None)


@pytest.mark.parametrize(
    ("success", "time_s", "score"),
    [(True, 9.0, 0.5), (True, 12.0, 0.5), (True, 24.0, 0.25), (True, 90.0, 0.125), (False, 9.0, 0)],
)
def test_barn_score_is_clipped_to_two_and_eight_times_the_best(
    success: bool, time_s: float, score: float
) -> None:
    assert course.barn_score(success, time_s, best_s=6.0) == score


# --- the crew -----------------------------------------------------------------------------------


def _work(job: int) -> int:
    if job == 3:
        raise ValueError("three")
    if job == 5:
        os._exit(7)
    return job * job


def _deaf_or_waiting(job: tuple[str, Path]) -> None:
    """`deaf`: heed no SIGTERM, say so, stay. `waiting`: until the other one has said so."""
    kind, fifo = job
    if kind == "waiting":
        fifo.read_bytes()
        return
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    fifo.write_bytes(b"deaf")
    signal.pause()


def test_crew_hands_back_every_job_whatever_happens_to_its_worker() -> None:
    done = {one.job: (one.value, one.problem) for one in sharing.share(_work, range(9), 2, "bench")}
    assert sorted(done) == list(range(9))
    assert done[3][0] is None
    assert done[3][1].startswith("ValueError: three (_work, line ")
    assert done[5] == (None, "its process ended with exit code 7")
    assert all(done[job] == (job * job, "") for job in (0, 1, 2, 4, 6, 7, 8))


def test_crew_takes_no_more_jobs_than_there_are_workers_for() -> None:
    taken: list[int] = []

    def jobs() -> object:
        for job in range(100):
            taken.append(job)
            yield job

    shared = sharing.share(_work, jobs(), 1, "bench")  # type: ignore[arg-type]
    assert next(shared).job == 0
    shared.close()
    assert taken == [0]


def test_crew_is_gone_when_its_results_are_no_longer_wanted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sharing, "END_S", 0.2)
    fifo = tmp_path / "fifo"
    os.mkfifo(fifo)
    shared = sharing.share(_deaf_or_waiting, [("deaf", fifo), ("waiting", fifo)], 2, "bench")
    # A worker has its name only some time after its process exists: both have begun by now.
    assert next(shared).job == ("waiting", fifo)
    children = psutil.Process().children(recursive=True)
    workers = {child.name(): child for child in children if "swarm-bench" in child.name()}
    assert sorted(workers) == ["swarm-bench-1", "swarm-bench-2"]
    shared.close()
    assert not any(child.is_running() for child in workers.values())


# --- rows ---------------------------------------------------------------------------------------


def _run(number: int, outcome: course.Outcome, **fields: object) -> Run:
    given = {"family": "traps", "size": "u", "controller": "navigator", "robots": 1, **fields}
    return msgspec.convert({**given, "number": number, "outcome": outcome}, Run)


def test_row_adds_up_outcomes_and_takes_medians_of_successes() -> None:
    runs = [
        _run(0, "succeeded", arrived=1, clearance_m=0.3, makespan_ratio=1.2, score=0.5),
        _run(1, "succeeded", arrived=1, clearance_m=0.1, makespan_ratio=1.8, score=0.25),
        _run(2, "timeout", clearance_m=0.2, score=0.0),
        _run(3, "blocked", clearance_m=0.4, score=0.0),
    ]
    row = rows.row(runs, judged=True)
    assert (row.success, row.timeout, row.blocked, row.collided) == (0.5, 0.25, 0.25, 0.0)
    assert (row.clearance_m_worst, row.clearance_m_median) == (0.1, pytest.approx(0.25))
    assert (row.makespan_ratio, row.score, row.arrived) == (1.5, 0.1875, 0.5)
    assert (row.expected, row.met) == (1.0, False)


@pytest.mark.parametrize(
    ("outcomes", "met"),
    [
        (["succeeded"] * 19 + ["timeout"], True),  # 95 of 100
        (["succeeded"] * 18 + ["timeout"] * 2, False),
        (["succeeded"] * 24 + ["collided"], False),  # nobody may touch anything
    ],
)
def test_expectation_is_met_by_enough_successes_without_contact(
    outcomes: list[course.Outcome], met: bool
) -> None:
    runs = [
        _run(number, outcome, family="barn", size="0.33m")
        for number, outcome in enumerate(outcomes)
    ]
    assert rows.row(runs, judged=True).met is met
    assert rows.row(runs, judged=False).met is None
    paper = [msgspec.structs.replace(run, controller="paper") for run in runs]
    assert rows.row(paper, judged=True).met is None


def test_worst_runs_are_crashes_then_contacts_then_late_ones_then_slow_ones() -> None:
    runs = [
        _run(0, "succeeded", arrived=1, makespan_ratio=3.0),
        _run(1, "timeout"),
        _run(2, "collided"),
        _run(3, "crashed"),
        _run(4, "blocked"),
    ]
    assert [run.number for run in rows.worst(runs)] == [3, 2]
    assert [run.number for run in rows.worst([runs[0], runs[4], runs[1]])] == [1, 4]
    fast = _run(5, "succeeded", arrived=1, makespan_ratio=1.0)
    assert [run.number for run in rows.worst([fast, runs[0]])] == [0, 5]


def test_a_crash_is_reported_and_fails_the_bench(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    def broken(work: object, jobs: object, workers: int, name: str) -> object:
        yield sharing.Done(Job(encounters.lanes(0), "paper"), None, "ValueError: no way")

    monkeypatch.setattr(sharing, "share", broken)
    line = f"bench navigation --families pairs --controllers paper --out {tmp_path / 'out'}"
    result = commands.here(monkeypatch, capsys, tmp_path, line)
    assert result.returncode == 1
    assert "CRASHED: 1 runs" in result.stdout
    assert "pairs lanes 0 paper: crashed, 0 of 6 arrived, ValueError: no way" in result.stdout


@functools.cache
def hashes_without(*stages: Stage) -> tuple[str, ...]:
    """Of platoons at a door, and of one robot alone among what stands and what drives about."""
    found = []
    for case in (encounters.door(0), moving.field(12, 0), moving.field(40, 0)):
        short = cases.without(cases.shortened(case, 8.0), stages)
        found.append(course.drive(cases.under(short, "navigator")).score.hash.hexdigest())
    return tuple(found)


@pytest.mark.parametrize("stage", get_args(Stage))
def test_each_stage_can_be_left_out_and_is_missed(stage: Stage) -> None:
    assert hashes_without(stage) != hashes_without()


def test_stages_to_leave_out_are_named(folder: Path) -> None:
    found = navigation.plan(folder=folder, families="traps", without="way,memory")
    (group, *_) = found.groups
    assert found.case(group, 0).scenario.navigator.without == ("memory", "way")
    with pytest.raises(errors.UsageError, match="--without: expected some of memory, way"):
        navigation.plan(folder=folder, without="memroy")


def test_peers_and_expectations_name_groups_that_exist(folder: Path) -> None:
    known = {(group.family, group.size) for group in navigation.plan(folder=folder).groups}
    assert {(peer.family, peer.size) for peer in peers.PEERS} <= known
    assert set(peers.EXPECTED) <= known


def test_table_shows_ours_and_the_peers_and_what_falls_short(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    plan = navigation.plan(folder=tmp_path, families="traps", seeds="0", controllers="paper")
    found = navigation.measure(plan, tmp_path / "out", lambda done, total, newest: None)
    short = rows.row([_run(0, "collided", clearance_m=-0.01)], judged=True)
    found = msgspec.structs.replace(found, rows=(*found.rows, short))
    table.show(found)
    said = capsys.readouterr().out
    assert "traps canyon" in said
    assert "[full map]" in said
    assert "100 % NOT MET" in said
    assert "short of what is expected: traps u" in said
    assert "not one to one" in said


@pytest.mark.parametrize("group", disturbed.groups(PLAIN[:1]), ids=lambda group: group.family)
def test_disturbed_instances_are_the_plain_ones_with_a_disturbance(group: Group) -> None:
    plain, case = PLAIN[0].make(3), group.make(3)
    assert (case.bounds_s, case.dues_s) == (plain.bounds_s, plain.dues_s)
    assert case.scenario.robots == plain.scenario.robots
    declared = case.scenario.disturbance
    assert (declared.latency_ticks, declared.loss_probability) == (1, 0.2)
    assert declared.range_error_m_max == pytest.approx(0.03)
    assert declared.loss_ticks_max == (5 if group.family.endswith("bursts") else 0)
    plan = cases.under(cases.shortened(case, 2.0), "navigator")
    assert course.drive(plan).score.hash.digest() == lockstep.run(plan).score.hash.digest()


def test_drifting_instances_are_those_of_barn(folder: Path) -> None:
    plain = public.groups(folder)[0]
    found = {group.family for group in disturbed.groups(plain) if group.family.endswith("drift")}
    assert found == {"barn-drift"}
    group = next(one for one in disturbed.groups(plain) if one.family == "barn-drift")
    declared = group.make(0).scenario.disturbance
    assert (declared.drift_m_per_m, declared.position_error_m_max) == (0.02, 0.5)


def test_scenario_of_a_case_survives_its_file() -> None:
    plan: Scenario = cases.under(encounters.circle_swap(4, 1), "paper")
    encoded = msgspec.toml.encode(scenario.to_builtins(plan))
    assert scenario.decode(encoded, "x.toml") == plan
