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
launch      seconds to the first tick, memory of a robot
"""

from __future__ import annotations

import difflib
from collections.abc import Callable
from typing import Protocol

import msgspec
from rich.console import Console
from rich.table import Table
from rich.text import Text

from swarm import errors
from swarm.run.bench import barrier, cores, figures, launch, telemetry
from swarm.run.bench.figures import Found, Row

PLAIN_WIDTH = 140  # characters of a line where there is no terminal to ask
COLUMNS_RIGHT = ("ROBOTS", "FIGURE", "FROM - TO")

Progress = Callable[[str], None]


class Benchmark(Protocol):
    """Measures and gives its rows; says now and then how far it is."""

    def __call__(self, *, tiny: bool, progress: Progress) -> tuple[Row, ...]: ...


BENCHMARKS: dict[str, Benchmark] = {
    "barrier": barrier.measure,
    "step": cores.step,
    "memory": cores.memory,
    "telemetry": telemetry.measure,
    "world": cores.world,
    "launch": launch.measure,
}


def run(names: list[str], *, tiny: bool, progress: Progress) -> Found:
    """Run the named benchmarks, all of them when none is named.

    Raises UsageError for an unknown name, SwarmError when one cannot measure.
    """
    for name in names:
        if name not in BENCHMARKS:
            near = difflib.get_close_matches(name, BENCHMARKS, n=1)
            hint = f"; did you mean '{near[0]}'?" if near else ""
            raise errors.UsageError(
                f"bench: expected some of {', '.join(BENCHMARKS)}, got '{name}'{hint}"
            )
    machine = figures.machine()
    rows: list[Row] = []
    for name in dict.fromkeys(names or BENCHMARKS):
        rows += BENCHMARKS[name](tiny=tiny, progress=progress)
    if tiny:
        rows = [msgspec.structs.replace(row, ok=True) for row in rows]
    return Found(machine, figures.versions(), tiny, tuple(rows))


def show(found: Found) -> None:
    """All rows in a table, for people, on standard output."""
    console = Console()
    if not console.is_terminal:
        console = Console(width=PLAIN_WIDTH)
    for line in _head(found):
        console.print(Text(line), highlight=False, soft_wrap=True)
    table = Table(box=None, pad_edge=False)
    for name in ("WHAT", "ROBOTS", "FIGURE", "FROM - TO", "RATIO", "BUDGET"):
        table.add_column(name, justify="right" if name in COLUMNS_RIGHT else "left")
    for row in found.rows:
        table.add_row(*_cells(row, found.tiny))
    console.print(table)
    if found.tiny:
        console.print("tiny: smallest sizes, one round, no budget counts", highlight=False)


def _head(found: Found) -> tuple[str, str]:
    machine = found.machine
    load = " ".join(f"{value:.1f}" for value in machine.load_average)
    loop_ms = 1e3 * machine.calibration_s
    versions = ", ".join(f"{name} {number}" for name, number in found.versions.items())
    return (
        f"{machine.cores} cores, load average {load}, calibrating loop {loop_ms:.1f} ms",
        f"{machine.system}, Python {machine.python}, {versions}",
    )


def _cells(row: Row, tiny: bool) -> tuple[Text, ...]:
    spread = f"{_number(row.smallest)} - {_number(row.largest)}" if row.rounds > 1 else ""
    ratio = "" if row.ratio is None else f"{row.ratio:.2f} x {row.over} ({_number(row.floor)})"
    verdict = Text("")
    if row.budget is not None:
        verdict = Text(f"{row.bound} {row.budget:g}")
        if not tiny:
            verdict.append(" ok" if row.ok else " BROKEN", "green" if row.ok else "bold red")
    return (
        Text(row.name),
        Text(str(row.size)),
        Text(f"{_number(row.figure)} {row.unit}"),
        Text(spread),
        Text(ratio),
        verdict,
    )


def _number(value: float | None) -> str:
    if value is None:
        return ""
    return f"{value:.0f}" if value >= 100.0 else f"{value:.3g}"
