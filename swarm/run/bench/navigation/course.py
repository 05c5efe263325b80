"""One run in memory, without a bus, and what it came to.

Job --drive--> Score, CPU, who said that it is blocked --judge--> Run
"""

from __future__ import annotations

import functools
import time
from collections.abc import Sequence
from typing import Literal

import msgspec

from agents import robot
from agents.navigator import warm
from swarm import faults, metrics
from swarm.faults import Dead, Kill
from swarm.messages import Command, Event, TickRecord
from swarm.run.bench.navigation import cases, stops
from swarm.run.bench.navigation.cases import Case, Controller
from swarm.run.bench.navigation.stops import Watch
from swarm.scenario import Scenario
from world import simulation
from world.simulation import World, WorldState

BARN_FACTORS = (2.0, 8.0)  # a run is scored by its time, clipped to these multiples of the best

Outcome = Literal["succeeded", "collided", "timeout", "blocked", "crashed"]


class Job(msgspec.Struct, frozen=True):
    """What to run."""

    case: Case
    controller: Controller


class Run(msgspec.Struct, frozen=True, kw_only=True):
    """What became of it; ratios are those of successes, None otherwise."""

    family: str
    size: str
    number: int
    controller: Controller
    # blocked: nobody is merely late, those who failed to arrive said so. Where a robot stops, it is
    # a success when all who can arrive do, and all others say in time that they are blocked.
    outcome: Outcome
    robots: int
    arrived: int = 0  # in time
    told: int = 0  # of those who could not arrive: said so in time
    clearance_m: float | None = None  # least, to obstacles and between robots
    makespan_ratio: float | None = None  # last arrival over the longest bound
    time_ratio: float | None = None  # arrival over its bound, mean over the robots
    path_ratio: float | None = None  # way over its bound at top speed, mean over the robots
    score: float | None = None  # of BARN: 0.5 at best, 0 without success
    sim_time_s: float = 0.0
    step_us: float | None = None  # CPU of one robot's step, mean
    state_hash: str | None = None
    problem: str = ""  # of a crash


@functools.cache
def _warm_up() -> None:
    """Load the navigator's inner loops, once per process: no step is to be charged with that."""
    warm.up()


class Driven(msgspec.Struct, frozen=True, eq=False):
    """A run that has ended."""

    score: metrics.Score
    steps: int
    step_cpu_s: float  # of all robots' steps
    watches: tuple[Watch, ...] = ()  # of the robots, where one stops
    last: TickRecord | None = None
    # when each was at its goal first: who makes room for another afterwards is not late for that
    reached_s: dict[int, float] = {}


def run(job: Job) -> Run:
    """Run and judge."""
    if job.controller == "navigator":
        _warm_up()
    return judge(job, drive(cases.under(job.case, job.controller)))


def drive(plan: Scenario) -> Driven:
    """The run that the shells make, to its end; nothing is kept of the ticks.

    CPU is that of this thread, so that others on the machine disturb it little.
    """
    world = simulation.build(plan)
    setups = {row.name: plan.setup(row.name) for row in plan.robots}
    minds = {name: robot.init(setup) for name, setup in setups.items()}
    state = simulation.init(world)
    score = metrics.begin(plan)
    watches = [stops.Watch() for _ in plan.robots] if plan.faults else []
    reached_s: dict[int, float] = {}
    steps = spent_ns = 0
    while True:
        state, events = _strike(world, state)
        frames = simulation.sense(world, state)
        commands: dict[str, Command] = {}
        begin_ns = time.thread_time_ns()
        for frame in frames:
            name = frame.robot
            minds[name], commands[name] = robot.step(setups[name], minds[name], frame)
        spent_ns += time.thread_time_ns() - begin_ns
        steps += len(frames)
        record = simulation.record(world, state, frames, commands.values(), events)
        metrics.observe(score, record)
        for row, tally in enumerate(score.tallies):
            if tally.arrival_tick is not None:
                reached_s.setdefault(row, tally.arrival_tick * plan.dt_s)
        if watches:
            stops.observe(watches, record)
        if metrics.ended(score) is not None or (watches and stops.settled(watches, score)):
            return Driven(score, steps, spent_ns * 1e-9, tuple(watches), record, reached_s)
        state = simulation.step(world, state, commands)


def _strike(world: World, state: WorldState) -> tuple[WorldState, list[Event]]:
    """World after the faults that are due, as the world's injector has it."""
    plan = world.scenario
    events: list[Event] = []
    for number, fault in enumerate(plan.faults):
        if plan.tick_of(fault.at_s) != state.tick:
            continue
        assert isinstance(fault, Kill | Dead), "other faults are the supervisor's business"
        name, kind = fault.target, faults.kind_of(fault)
        events.append(
            Event(
                tick=state.tick,
                stamp_ns=plan.stamp_ns(state.tick),
                kind="fault",
                robot=name,
                text=faults.text_of(fault),
                fault=kind,
                number=number,
            )
        )
        if isinstance(fault, Kill):
            state = simulation.lose(world, state, name)
        else:
            state = simulation.inflict(world, state, number, fault, (plan.row(name),))
    return state, events


def judge(job: Job, driven: Driven) -> Run:
    """What a run came to, against the times of its case."""
    case = job.case
    facts = metrics.Facts(scenario=case.name, run="memory", bus="memory")
    summary = metrics.summary(driven.score, facts)
    rows = summary.per_robot
    arrivals_s = {
        number: row.arrival_s
        for number, (row, due_s) in enumerate(zip(rows, case.dues_s, strict=True))
        if row.arrival_s is not None and _is_in_time(driven, number, row, due_s)
    }
    in_time = list(arrivals_s.values())
    late = [row for row in rows if row.outcome in ("arrived", "timeout")]
    outcome: Outcome = "succeeded"
    told = 0
    if summary.collisions or (case.stops and summary.collisions_excused):
        outcome = "collided"
    elif case.stops:
        outcome, told = _judge_stop(job, driven, summary.per_robot)
    elif len(in_time) < len(rows):
        outcome = "timeout" if len(late) > len(in_time) else "blocked"
    success = outcome == "succeeded"
    clearances_m = [
        gap_m
        for gap_m in (summary.min_clearance_obstacle_m, summary.min_clearance_robot_m)
        if gap_m is not None
    ]
    makespan_s = max(in_time, default=0.0)
    return Run(
        family=case.family,
        size=case.size,
        number=case.number,
        controller=job.controller,
        outcome=outcome,
        robots=len(rows),
        arrived=len(in_time),
        told=told,
        clearance_m=min(clearances_m, default=None),
        makespan_ratio=makespan_s / max(case.bounds_s) if success and in_time else None,
        time_ratio=_mean_ratio(in_time, [case.bounds_s[number] for number in arrivals_s])
        if success
        else None,
        path_ratio=_mean_ratio(
            [rows[number].path_m for number in arrivals_s],
            [_ways_m(case)[number] for number in arrivals_s],
        )
        if success
        else None,
        score=barn_score(success, makespan_s, case.bounds_s[0]) if case.scored else None,
        sim_time_s=summary.sim_time_s,
        step_us=1e6 * driven.step_cpu_s / driven.steps,
        state_hash=summary.state_hash,
    )


def _is_in_time(driven: Driven, number: int, row: metrics.RobotRow, due_s: float) -> bool:
    """Whether a robot is at its goal, and was there in time first."""
    if row.outcome != "arrived" or row.arrival_s is None:
        return False
    return driven.reached_s.get(number, row.arrival_s) <= due_s


def _judge_stop(job: Job, driven: Driven, rows: Sequence[metrics.RobotRow]) -> tuple[Outcome, int]:
    """What became of a run in which a robot stopped, and how many said rightly that they cannot.

    Blocked: all who did not arrive say that they are, but one of them could have arrived.
    """
    assert driven.last is not None
    plan, stopped = job.case.scenario, stops.ROW
    told, late, wrong = 0, 0, 0
    for number, (row, watch, due_s) in enumerate(
        zip(rows, driven.watches, job.case.dues_s, strict=True)
    ):
        if _is_in_time(driven, number, row, due_s):
            continue
        if row.outcome == "killed" and number == stopped:
            continue
        says = stops.has_said(watch, plan)
        if row.outcome == "arrived" or not (says or stops.is_under_way(watch, driven.score)):
            late += 1
        elif stops.can_arrive(plan, driven.last, number):
            wrong += 1
        else:
            told += says
    return ("timeout" if late else "blocked" if wrong else "succeeded"), told


def barn_score(success: bool, time_s: float, best_s: float) -> float:
    """BARN's own rule: best time over the time taken, clipped to [2, 8] times the best one."""
    if not success:
        return 0.0
    least, most = BARN_FACTORS
    return best_s / min(max(time_s, least * best_s), most * best_s)


def _ways_m(case: Case) -> list[float]:
    return [
        bound_s * robot.speed_mps_max
        for bound_s, robot in zip(case.bounds_s, case.scenario.robots, strict=True)
    ]


def _mean_ratio(values: list[float], bounds: list[float]) -> float | None:
    """None when nobody arrived, which may be all that could be done."""
    if not values:
        return None
    return sum(value / bound for value, bound in zip(values, bounds, strict=True)) / len(values)
