"""The figures of `swarm bench` for people."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table
from rich.text import Text

from swarm.run.bench.figures import Found, Row

PLAIN_WIDTH = 140  # characters of a line where there is no terminal to ask
COLUMNS_RIGHT = ("ROBOTS", "FIGURE", "FROM - TO")


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
