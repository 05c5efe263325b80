"""A campaign's figures for people."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table
from rich.text import Text

from swarm.run.chaos.campaign import Campaign, Spread

PLAIN_WIDTH = 160  # characters of a line where there is no terminal to ask
FAILURES_SHOWN = 10


def show(found: Campaign) -> None:
    """What was done, what held, what did not, on standard output."""
    console = Console()
    if not console.is_terminal:
        console = Console(width=PLAIN_WIDTH)
    table = Table(box=None, pad_edge=False)
    for name in ("WHAT", "COUNT", "MEDIAN", "90 %", "99 %", "MOST"):
        table.add_column(name, justify="left" if name == "WHAT" else "right")
    for what, spread in (
        ("noticed after", found.detected_s),
        ("live leaders again after", found.recovered_s),
        ("one leader agreed after", found.agreed_s),
        ("all arrived, after healing", found.converged_s),
    ):
        table.add_row(what, *_cells(spread))
    console.print(table)
    for line in _lines(found):
        console.print(Text(line), highlight=False, soft_wrap=True)
    verdict = Text("all held", "green")
    if not found.ok:
        verdict = Text(f"BROKEN in {len(found.failures)} of {found.runs} runs", "bold red")
    console.print(verdict)


def _cells(spread: Spread | None) -> tuple[str, ...]:
    if spread is None:
        return ("0", "-", "-", "-", "-")
    values = (spread.p50, spread.p90, spread.p99, spread.max)
    return (str(spread.count), *(f"{value:.2f} s" for value in values))


def _lines(found: Campaign) -> list[str]:
    kinds = ", ".join(f"{count} {kind}" for kind, count in found.faults.items())
    lines = [
        f"{found.runs} runs of {found.scenario}, seed {found.seed}, {found.bus}: "
        f"{found.sim_time_s:.0f} s simulated in {found.wall_time_s:.0f} s",
        f"{sum(found.faults.values())} faults: {kinds}",
        f"clearance: {_metres(found.min_clearance_obstacle_m)} to obstacles, "
        f"{_metres(found.min_clearance_robot_m)} between robots",
    ]
    lines += [f"BROKEN {name}: {count} times" for name, count in found.violations.items()]
    for failure in found.failures[:FAILURES_SHOWN]:
        first = failure.worst
        who = "/".join(first.robots)
        lines.append(
            f"run {failure.run}: {first.invariant} at tick {first.tick} {who}: {first.text}"
        )
        lines.append(f"  {failure.command}")
    if len(found.failures) > FAILURES_SHOWN:
        lines.append(f"... and {len(found.failures) - FAILURES_SHOWN} more: see {found.folder}")
    return lines


def _metres(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f} m"
