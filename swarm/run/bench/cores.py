"""What thinking and simulating cost without any processes: control step, world, whole swarm.

All on one thread; CPU time of that thread, so that others on the machine disturb little.
"""

from __future__ import annotations

import gc
import statistics
import time
from collections.abc import Callable, Iterator
from functools import partial

from agents import robot
from swarm.run import lockstep
from swarm.run.bench import figures, rehearsal
from swarm.run.bench.figures import Row
from swarm.run.bench.navigation import cases, encounters
from swarm.run.bench.navigation.cases import Controller
from swarm.run.bench.rehearsal import Rehearsal
from world import simulation

FORMATION = "two-obstacles"
ALONE = "single-robot"
PASSES = 5

# role -> robots in the run, budget of the navigator's median
ROLES = {
    "leader": (6, 160.0),
    "follower FORM": (6, 150.0),
    "follower AVOID": (6, 210.0),
    "alone": (1, 100.0),
    "with 20 neighbours": (21, 250.0),
}
AMONG = "with 20 neighbours"
# Robots at random places that all hear each other, of which some are timed for a while.
AMONG_AREA_M2, AMONG_TIMED, AMONG_TICKS = 8.0, 3, 150
LOOP = "calibrating loop"
LOOP_ADDITIONS = 1000  # about 50 us
# other budgets
STEP_US_MAX = 2000.0  # no tick of any controller above it
WORLD_US_MAX = 100.0  # from this many robots on:
WORLD_SIZE_MIN = 100
REAL_TIME_FACTOR_MIN = 60.0

CROWD_OBSTACLES = 50
CROWD_TICKS = 25  # some are under way by then, and have begun to give way
TICKS_MAX = 1000  # of any run here; all of them end before, unless a controller never arrives
TINY_TICKS = 130  # of the formation: the first followers are in AVOID


# --- one control step ---------------------------------------------------------------------------


def step(*, tiny: bool, progress: Callable[[str], None]) -> tuple[Row, ...]:
    """Median and longest robot.step by role, for each controller, on frames of real runs.

    Each step's time is the best of the passes; median and longest are over the steps. A loop of
    plain Python takes turns with them and tells how fast the machine was meanwhile.
    """
    rows: list[Row] = []
    ticks_max, passes = (TINY_TICKS, 1) if tiny else (TICKS_MAX, PASSES)
    for controller in ("paper", "navigator"):
        progress(f"step: {controller}")
        spent_us: dict[str, list[float]] = {LOOP: []}
        for role, step_us in (
            timed
            for seen in _rehearsals(controller, ticks_max)
            for timed in _steps_us(seen, passes)
        ):
            spent_us.setdefault(role, []).append(step_us)
        roles = [role for role in ROLES if role in spent_us]
        loop_us = statistics.median(spent_us[LOOP])
        for role in roles:
            size, budget_us = ROLES[role]
            for name, value_us, most_us in (
                ("", statistics.median(spent_us[role]), budget_us),
                (", longest", max(spent_us[role]), STEP_US_MAX),
            ):
                rows.append(
                    figures.row(
                        f"step: {role}, {controller}{name}",
                        size,
                        [value_us],
                        "us",
                        floors=[loop_us],
                        over=LOOP,
                        budget=None if controller == "paper" and not name else most_us,
                        bound="figure <=",
                    )
                )
    return tuple(rows)


def _rehearsals(controller: Controller, ticks_max: int) -> Iterator[Rehearsal]:
    """Runs in which its roles occur, one after the other: each is large."""
    for name in (FORMATION, ALONE):
        plan = rehearsal.built_in(name, settings=[f"robot.controller={controller}"])
        yield rehearsal.rehearse(plan, ticks_max)
    if controller == "navigator":
        size, _ = ROLES[AMONG]
        plan = cases.under(encounters.random_places(size, AMONG_AREA_M2, 0), controller)
        timed = [one.name for one in plan.robots[:AMONG_TIMED]]
        yield rehearsal.rehearse(plan, min(AMONG_TICKS, ticks_max), timed)


def _steps_us(seen: Rehearsal, passes: int) -> list[tuple[str, float]]:
    """(role, us) of every step of a run, and of a loop in every tick."""
    roles: list[str] = []
    jobs: list[rehearsal.Job] = []
    for moment in seen.moments:
        roles.append(LOOP)
        jobs.append(partial(figures.loop, LOOP_ADDITIONS))
        for frame in moment.frames:
            setup, name = seen.setups[frame.robot], frame.robot
            if name not in moment.minds:
                continue
            mode = moment.commands[name].beacon.mode
            if setup.slot is not None:
                roles.append(f"follower {mode}")
            elif setup.leads:
                roles.append("leader")
            else:
                roles.append("alone" if len(seen.setups) == 1 else AMONG)
            jobs.append(partial(robot.step, setup, moment.minds[name], frame))
    return [(role, 1e6 * s) for role, s in zip(roles, rehearsal.best_s(jobs, passes), strict=True)]


# --- the world ----------------------------------------------------------------------------------


def world(*, tiny: bool, progress: Callable[[str], None]) -> tuple[Row, ...]:
    """World per robot and tick among many obstacles.

    Moving is motion and contact, sensing is rays, radio and the frames.
    """
    rows: list[Row] = []
    for size in (2,) if tiny else (6, 20, 100):
        progress(f"world: {size} robots")
        plan = rehearsal.crowd(size, CROWD_OBSTACLES)
        seen = rehearsal.rehearse(plan, 3 if tiny else CROWD_TICKS)
        rate = 1e6 / (size * len(seen.moments))  # s in all -> us per robot and tick
        moves = [
            partial(simulation.step, seen.world, one.state, one.commands) for one in seen.moments
        ]
        senses = [partial(simulation.sense, seen.world, one.state) for one in seen.moments]
        moving_us, sensing_us = [], []
        for _ in range(1 if tiny else PASSES):
            moving_us.append(rate * sum(rehearsal.best_s(moves, 1)))
            sensing_us.append(rate * sum(rehearsal.best_s(senses, 1)))
        both_us = [move + sense for move, sense in zip(moving_us, sensing_us, strict=True)]
        rows += [
            figures.at_most("world: moving", size, moving_us, "us", None),
            figures.at_most("world: sensing", size, sensing_us, "us", None),
            figures.at_most(
                "world: both", size, both_us, "us", WORLD_US_MAX if size >= WORLD_SIZE_MIN else None
            ),
        ]
    return tuple(rows)


# --- the swarm in memory ------------------------------------------------------------------------


def memory(*, tiny: bool, progress: Callable[[str], None]) -> tuple[Row, ...]:
    """The formation in one process, wall time, as a multiple of real time."""
    plan = rehearsal.built_in(FORMATION, settings=["duration_s=2.0"] if tiny else [])
    factors, rates = [], []
    for number in range(1 if tiny else PASSES):
        progress(f"memory: round {number + 1}")
        gc.collect()
        begin_s = time.perf_counter()
        ticks = lockstep.run(plan).score.tick
        spent_s = time.perf_counter() - begin_s
        factors.append(ticks * plan.dt_s / spent_s)
        rates.append(ticks / spent_s)
    size = len(plan.robots)
    return (
        figures.row(
            "memory: real time",
            size,
            factors,
            "x",
            budget=REAL_TIME_FACTOR_MIN,
            bound="figure >=",
        ),
        figures.row("memory: ticks", size, rates, "1/s"),
    )
