"""How well robots find their way: `swarm bench navigation`.

Group --make--> Case --course, by processes that share--> Run --rows--> table | JSON
                                                          '--worst--> TOML for `swarm run`

cases       a scenario and the times it is measured against
encounters  families of several robots
obstacles   families of one robot
moving      a family of robots among what moves
data        families from public benchmark data, when it is there
disturbed   families again, with noise, latency, speed errors, lost messages, drift
stops       families again, with a robot that stops for good
course      one run in memory, and what it came to
rows        figures of all runs of a group, the worst runs
peers       what others reached
table       the figures for people

A measurement, not a threshold: whatever the figures are, it has failed only when a run crashed.
Ctrl-C ends it early, and what is done by then is shown.
"""

from __future__ import annotations

import os
import re
import shlex
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import get_args

import msgspec
import tomli_w

from swarm import errors, runs
from swarm import scenario as scenarios
from swarm.run import sharing
from swarm.run.bench import NAVIGATION, figures
from swarm.run.bench.navigation import (
    cases,
    course,
    data,
    disturbed,
    encounters,
    moving,
    obstacles,
    stops,
)
from swarm.run.bench.navigation import rows as results
from swarm.run.bench.navigation.cases import Case, Controller, Group
from swarm.run.bench.navigation.course import Job, Run
from swarm.run.bench.navigation.rows import Navigation, Worst
from swarm.scenario import Stage

CONTROLLERS: tuple[Controller, ...] = get_args(Controller)
STAGES: tuple[Stage, ...] = get_args(Stage)
FAMILIES = (
    *("circle-swap", "pairs", "random", "door", "corridor"),
    *("traps", "paper-fields", "paper-u", "paper-walls", "moving", "moving-several"),
    *("barn", "collision-avoidance"),
)
# Families again, under something; named by the word at their end all at once. By name only: all of
# them would take days.
VARIANTS: dict[str, tuple[str, ...]] = {
    ending: tuple(f"{family}-{ending}" for family in FAMILIES if family in families)
    for ending, families in (
        *((ending, families) for ending, (_, families) in disturbed.VARIANTS.items()),
        *((ending, tuple(stops.SHARES)) for ending in stops.KINDS),
    )
}
DATA = Path("../shared/data")  # where the benchmark data is looked for
SEED_MAX = 1_000_000
TINY_DURATION_S = 12.0  # a pair changes places in 11 s

__all__ = ["CONTROLLERS", "DATA", "FAMILIES", "VARIANTS", "Navigation", "Plan", "measure", "plan"]

Advance = Callable[[int, int, str], None]  # runs done, runs in all, the newest


class Plan(msgspec.Struct, frozen=True):
    """What to run."""

    groups: tuple[Group, ...]
    numbers: dict[tuple[str, str], range]  # of each group
    controllers: tuple[Controller, ...]
    tiny: bool
    skipped: tuple[str, ...]
    without: tuple[Stage, ...] = ()  # of the navigator

    def jobs(self) -> Iterator[Job]:
        """Every run; a case is made when its turn comes."""
        for group in self.groups:
            for number in self.numbers[group.family, group.size]:
                case = self.case(group, number)
                for controller in self.controllers:
                    yield Job(case, controller)

    def case(self, group: Group, number: int) -> Case:
        """One instance, as it is run here."""
        case = cases.without(group.make(number), self.without)
        return cases.shortened(case, TINY_DURATION_S) if self.tiny else case

    @property
    def count(self) -> int:
        """Of runs."""
        return len(self.controllers) * sum(len(some) for some in self.numbers.values())


def plan(
    *,
    families: str | None = None,
    sizes: str | None = None,
    controllers: str | None = None,
    seeds: str | None = None,
    without: str | None = None,
    folder: Path = DATA,
    tiny: bool = False,
) -> Plan:
    """What the command line asks for; lists are joined by commas, seeds are `A-B` or one number.

    `without` names stages that the navigator is to do without.

    Raises UsageError for an unknown name, a range that is none, a damaged data file.
    """
    wanted = _families(families, tiny=tiny)
    minds = _chosen("--controllers", controllers, CONTROLLERS)
    left_out = () if without is None else _chosen("--without", without, STAGES)
    from_data, skipped = data.groups(folder)
    every = (*encounters.groups(), *obstacles.groups(), *moving.groups(), *from_data)
    every = (*every, *disturbed.groups(every), *stops.groups(every))
    groups = [group for group in every if group.family in wanted]
    if sizes is not None:
        kept = _chosen("--sizes", sizes, tuple(dict.fromkeys(group.size for group in groups)))
        groups = [group for group in groups if group.size in kept]
    if tiny:
        firsts: dict[str, Group] = {}
        for group in groups:
            firsts.setdefault(group.family, group)
        groups = list(firsts.values())
    asked = None if seeds is None else _range(seeds)
    numbers = {
        (group.family, group.size): range(1) if tiny else _numbers(group, asked) for group in groups
    }
    if not any(numbers.values()) and groups:
        raise errors.UsageError(
            f"--seeds: expected some of the instances of {', '.join(wanted)}, got '{seeds}', where "
            "there are none; they are numbered from 0"
        )
    return Plan(
        groups=tuple(groups),
        numbers=numbers,
        controllers=tuple(mind for mind in CONTROLLERS if mind in minds),
        tiny=tiny,
        without=tuple(stage for stage in STAGES if stage in left_out),
        skipped=tuple(
            line for line in skipped if any(name.startswith(line.split(":")[0]) for name in wanted)
        ),
    )


def measure(plan: Plan, out: Path | None, advance: Advance) -> Navigation:
    """Make all runs on all cores; the scenarios of the worst are written to a folder.

    After Ctrl-C what comes back is partial: of the runs that had ended.

    Raises UsageError when the folder cannot be written.
    """
    machine = figures.machine()
    begun_s = time.monotonic()
    order = {(group.family, group.size): place for place, group in enumerate(plan.groups)}
    found: list[Run] = []
    partial = False
    workers = min(os.cpu_count() or 1, max(1, plan.count))
    shared = sharing.share(course.run, plan.jobs(), workers, "bench")
    try:
        for done in shared:
            run = done.value or _crashed(done.job, done.problem)
            found.append(run)
            said = f"{run.family} {run.size} {run.number} {run.controller}: {run.outcome}"
            advance(len(found), plan.count, said)
    except KeyboardInterrupt:  # a second one, while the workers end, is let through
        partial = True
    finally:
        shared.close()
    found.sort(key=lambda run: (order[run.family, run.size], run.controller, run.number))
    table = results.rows(found, judged=not plan.tiny)
    return Navigation(
        machine=machine,
        versions=figures.versions(),
        tiny=plan.tiny,
        partial=partial,
        planned=plan.count,
        rows=table,
        peers=results.beside(table),
        worst=_written(plan, results.worst(found), out),
        runs=tuple(found),
        skipped=plan.skipped,
        wall_time_s=time.monotonic() - begun_s,
    )


def _written(plan: Plan, worst: Iterable[Run], out: Path | None) -> tuple[Worst, ...]:
    """Scenarios of the worst runs as files: `swarm run` makes the same run of each."""
    folder = _folder(out)
    groups = {(group.family, group.size): group for group in plan.groups}
    shown: list[Worst] = []
    for run in worst:
        case = plan.case(groups[run.family, run.size], run.number)
        path = folder / f"{case.name}-{run.controller}.toml"
        table = scenarios.to_builtins(cases.under(case, run.controller))
        path.write_bytes(tomli_w.dumps(table).encode())
        near = shlex.quote(os.path.relpath(path))
        shown.append(Worst(run=run, command=f"swarm run {near} --view web"))
    return tuple(shown)


def _folder(out: Path | None) -> Path:
    folder = runs.new_folder(out, f"bench-{NAVIGATION}")
    (folder / runs.LOGS).rmdir()
    return folder


def _crashed(job: Job, problem: str) -> Run:
    case = job.case
    return Run(
        family=case.family,
        size=case.size,
        number=case.number,
        controller=job.controller,
        outcome="crashed",
        robots=len(case.scenario.robots),
        problem=problem,
    )


def _numbers(group: Group, asked: range | None) -> range:
    """Instances to run: those asked for; of a group that is a fixed list, as far as it goes."""
    if asked is None:
        return range(group.count)
    return (
        asked
        if group.seeded
        else range(asked.start, max(asked.start, min(asked.stop, group.count)))
    )


def _range(text: str) -> range:
    match = re.fullmatch(r"(\d{1,7})(?:-(\d{1,7}))?", text.strip())
    first, last = (int(match[1]), int(match[2] or match[1])) if match else (1, 0)
    if last < first or last > SEED_MAX:
        raise errors.UsageError(
            f"--seeds: expected A-B with A <= B <= {SEED_MAX} such as 0-9, or one number, "
            f"got '{text}'"
        )
    return range(first, last + 1)


def _families(text: str | None, *, tiny: bool) -> tuple[str, ...]:
    """Families by name, or by the word at the end of their names; tiny, all there are."""
    every = (*FAMILIES, *(name for names in VARIANTS.values() for name in names))
    if text is None:
        return every if tiny else FAMILIES
    asked = _chosen("--families", text, (*every, *VARIANTS))
    return tuple(name for part in asked for name in VARIANTS.get(part, (part,)))


def _chosen(flag: str, text: str | None, known: tuple[str, ...]) -> tuple[str, ...]:
    if text is None:
        return known
    names = tuple(part.strip() for part in text.split(","))
    for name in names:
        if name not in known:
            hint = errors.did_you_mean(name, known)
            raise errors.UsageError(
                f"{flag}: expected some of {', '.join(known)} joined by commas, got '{name}'{hint}"
            )
    return names
