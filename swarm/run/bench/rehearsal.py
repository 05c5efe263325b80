"""A run of the pure cores, with everything kept that they were given, to time them on it again.

scenario --rehearse--> Moment(state, minds, frames, commands, record) per tick --best_s--> s
"""

from __future__ import annotations

import gc
import importlib.resources
import time
from collections.abc import Callable, Collection, Iterable, Sequence
from math import inf

import msgspec

from agents import robot
from swarm import metrics, scenario
from swarm.messages import Command, SensorFrame, TickRecord
from swarm.scenario import RandomObstacles, Recording, Robot, RobotSetup, Scenario
from world import simulation

BUILT_IN = "world.scenarios"
DT_S = 0.08  # of the paper and of every built-in scenario
SEED = 1
CLOCK_READINGS = 1000  # to know what one takes

Job = Callable[[], object]


class Moment(msgspec.Struct, frozen=True, eq=False):
    """One tick: what each core was given, and what it made of it."""

    state: simulation.WorldState
    minds: dict[str, robot.State]  # before the step, by name, of those who are looked at
    frames: tuple[SensorFrame, ...]
    commands: dict[str, Command]
    record: TickRecord


class Rehearsal(msgspec.Struct, frozen=True, eq=False):
    """A whole run in memory."""

    scenario: Scenario
    world: simulation.World
    setups: dict[str, RobotSetup]
    moments: tuple[Moment, ...]


def built_in(name: str, *, robots: int | None = None, settings: Sequence[str] = ()) -> Scenario:
    """Built-in scenario that records nothing by itself."""
    data = importlib.resources.files(BUILT_IN).joinpath(f"{name}.toml").read_bytes()
    plan = scenario.decode(data, f"{name}.toml", robots=robots, settings=settings)
    return msgspec.structs.replace(plan, recording=Recording(mcap=False, rerun=False))


def crowd(robots: int, obstacles: int) -> Scenario:
    """Robots 2 m apart on a square grid that all go 30 m the same way, among random circles."""
    side = 1
    while side * side < robots:
        side += 1
    extent_m = 2.0 * side
    return Scenario(
        title="Crowd among circles",
        seed=SEED,
        dt_s=DT_S,
        duration_s=60.0,
        robots=tuple(
            Robot(
                name=f"robot{row + 1}",
                start=(2.0 * (row % side), 2.0 * (row // side), 0.0),
                goal=(2.0 * (row % side) + 30.0, 2.0 * (row // side)),
            )
            for row in range(robots)
        ),
        # around and among the robots, with room for all circles however few the robots are
        random_obstacles=RandomObstacles(
            count=obstacles,
            radius_m=(0.2, 0.4),
            area=(-4.0, -12.0, extent_m + 20.0, extent_m + 12.0),
            gap_m_min=0.3,
            keep_clear_m=0.3,
        ),
        recording=Recording(mcap=False, rerun=False),
    )


def rehearse(plan: Scenario, ticks_max: int, names: Collection[str] | None = None) -> Rehearsal:
    """The first ticks of a scenario, lock-step, in this process and without a bus.

    Args:
        names: robots whose minds are kept, None: all; a navigator's is some 100 kB in each tick.
    """
    world = simulation.build(plan)
    setups = {row.name: plan.setup(row.name) for row in plan.robots}
    minds = {name: robot.init(setup) for name, setup in setups.items()}
    state = simulation.init(world)
    score = metrics.begin(plan)
    moments: list[Moment] = []
    while len(moments) < ticks_max and metrics.ended(score) is None:
        frames = simulation.sense(world, state)
        before = {name: mind for name, mind in minds.items() if names is None or name in names}
        commands = {}
        for frame in frames:
            name = frame.robot
            minds[name], commands[name] = robot.step(setups[name], minds[name], frame)
        record = simulation.record(world, state, frames, commands.values())
        metrics.observe(score, record)
        moments.append(Moment(state, before, frames, commands, record))
        state = simulation.step(world, state, commands)
    return Rehearsal(plan, world, setups, tuple(moments))


def best_s(jobs: Iterable[Job], passes: int) -> list[float]:
    """CPU seconds of each job on this thread, the best of some passes over all of them.

    What it takes to read the clock is not theirs: about half a microsecond.

    Passes go over all jobs in turn, so each sees caches as warm as in a run. What existed before
    is hidden from the collector, as the robots' and the world's shells do.
    """
    todo = list(jobs)
    best = [inf] * len(todo)
    idle_ns = clock_ns = time.thread_time_ns()
    for _ in range(CLOCK_READINGS):
        before_ns, clock_ns = clock_ns, time.thread_time_ns()
        idle_ns = min(idle_ns, clock_ns - before_ns)
    gc.collect()
    gc.freeze()
    try:
        for _ in range(passes):
            for number, job in enumerate(todo):
                begin_ns = time.thread_time_ns()
                job()
                spent_ns = time.thread_time_ns() - begin_ns - idle_ns
                best[number] = min(best[number], spent_ns * 1e-9)
    finally:
        gc.unfreeze()
    return best
