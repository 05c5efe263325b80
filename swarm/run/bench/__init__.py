"""What a swarm costs: `swarm bench`.

    NAME -> measure -> rows: figure, floor, ratio, budget -> table | JSON

Fixed seeds, rounds that take turns, ratios within one run; a budget that is broken says so. `tiny`
runs all of it in the smallest size, to see that it runs: then no budget counts.

figures     a row, its budget, the machine
rehearsal   a run of the pure cores kept for timing them again
cores       step, world, memory: in one process
processes   children of a measurement, and the CPU of many processes
bare        N + 1 processes over Zenoh that only exchange bytes
system      the product's own processes, with a meter inside
barrier     the whole system over the bare one
telemetry   recording on over off
watched     a viewer that stalls or dies over none
launch      seconds to the first tick, memory of a robot
table       the figures for people
navigation  how well robots find their way: a bench of its own, asked for by its name alone

Children are forked from a process that has this package loaded, so it imports the benchmarks, and
with them Rerun and Rich, only when they are asked for.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import msgspec

from swarm import errors
from swarm.run.bench import figures
from swarm.run.bench.figures import Found, Row

NAVIGATION = "navigation"

Progress = Callable[[str], None]


class Benchmark(Protocol):
    """Measures and gives its rows; says now and then how far it is."""

    def __call__(self, *, tiny: bool, progress: Progress) -> tuple[Row, ...]: ...


def benchmarks() -> dict[str, Benchmark]:
    """All there are, in the order they run."""
    from swarm.run.bench import barrier, cores, launch, telemetry, watched

    return {
        "barrier": barrier.measure,
        "step": cores.step,
        "memory": cores.memory,
        "telemetry": telemetry.measure,
        "watched": watched.measure,
        "world": cores.world,
        "launch": launch.measure,
    }


def run(names: list[str], *, tiny: bool, progress: Progress) -> Found:
    """Run the named benchmarks, all of them when none is named.

    Raises UsageError for an unknown name, SwarmError when one cannot measure.
    """
    known = benchmarks()
    for name in names:
        if name not in known:
            hint = errors.did_you_mean(name, [*known, NAVIGATION])
            raise errors.UsageError(
                f"bench: expected some of {', '.join(known)}, or {NAVIGATION} alone, "
                f"got '{name}'{hint}"
            )
    machine = figures.machine()
    rows: list[Row] = []
    for name in dict.fromkeys(names or known):
        rows += known[name](tiny=tiny, progress=progress)
    if tiny:
        rows = [msgspec.structs.replace(row, ok=True) for row in rows]
    return Found(machine, figures.versions(), tiny, tuple(rows))


def show(found: Found) -> None:
    """All rows in a table, for people, on standard output."""
    from swarm.run.bench import table

    table.show(found)
