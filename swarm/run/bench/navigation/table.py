"""Figures of `swarm bench navigation` for people."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table
from rich.text import Text

from swarm.run.bench.navigation import peers
from swarm.run.bench.navigation.peers import Published
from swarm.run.bench.navigation.rows import Navigation, Row, Worst

PLAIN_WIDTH = 160  # characters of a line where there is no terminal to ask
COLUMNS = (
    *("WHAT", "CONTROLLER", "RUNS", "OK", "HIT", "LATE", "BLOCKED", "CLEARANCE m"),
    *("MAKESPAN", "TIME", "PATH", "SCORE", "us/STEP", "EXPECTED"),
)
COLUMNS_LEFT = ("WHAT", "CONTROLLER", "EXPECTED")


def show(found: Navigation) -> None:
    """All rows with the peers' below, then the worst runs, on standard output."""
    console = Console()
    if not console.is_terminal:
        console = Console(width=PLAIN_WIDTH)
    table = Table(box=None, pad_edge=False)
    for name in COLUMNS:
        table.add_column(name, justify="left" if name in COLUMNS_LEFT else "right", no_wrap=True)
    last: tuple[str, str] | None = None
    for number, row in enumerate(found.rows):
        group = (row.family, row.size)
        table.add_row(*_cells(row, named=group != last))
        last = group
        following = found.rows[number + 1 : number + 2]
        if not following or (following[0].family, following[0].size) != group:
            for peer in found.peers:
                if (peer.family, peer.size) == group:
                    table.add_row(*_peer_cells(peer))
    console.print(table)
    for line in _notes(found):
        console.print(Text(line), highlight=False, soft_wrap=True)
    if found.worst:
        console.print(Text("worst runs of each family and controller:"), highlight=False)
    for worst in found.worst:
        console.print(Text(_worst_line(worst)), highlight=False, soft_wrap=True)


def _notes(found: Navigation) -> list[str]:
    machine = found.machine
    lines = [
        f"{len(found.runs)} runs in {found.wall_time_s:.0f} s on {machine.cores} cores, "
        f"calibrating loop {1e3 * machine.calibration_s:.1f} ms; ratios over the straight way "
        "(BARN: the reference path) at top speed, medians of the successes",
        *found.skipped,
        peers.NEUTRAL,
    ]
    if any(row.family == "barn" for row in found.rows):
        lines.append(peers.BARN_NOTE)
    if found.partial:
        lines.append(
            f"PARTIAL: interrupted after {len(found.runs)} of {found.planned} runs; rows may lack "
            "the slower ones"
        )
    if found.tiny:
        lines.append("tiny: one short run per family, nothing is expected of them")
    crashes = sum(run.outcome == "crashed" for run in found.runs)
    if crashes:
        lines.append(f"CRASHED: {crashes} runs, which are in no other column")
    missed = [row for row in found.rows if row.met is False]
    if missed:
        names = ", ".join(f"{row.family} {row.size}" for row in missed)
        lines.append(f"short of what is expected: {names}")
    return lines


def _worst_line(worst: Worst) -> str:
    run = worst.run
    what = run.outcome if run.outcome != "succeeded" else f"{_ratio(run.makespan_ratio)} x"
    where = f"{run.family} {run.size} {run.number} {run.controller}"
    told = f", {run.told} said rightly that they cannot" if run.told else ""
    said = f"{told}, {run.problem}" if run.problem else told
    return f"  {where}: {what}, {run.arrived} of {run.robots} arrived{said}: {worst.command}"


def _cells(row: Row, *, named: bool) -> tuple[Text, ...]:
    verdict = Text("")
    if row.met is not None:
        verdict = Text(f"{_percent(row.expected)} ")
        verdict.append("met" if row.met else "NOT MET", "green" if row.met else "bold red")
    return (
        Text(f"{row.family} {row.size}" if named else ""),
        Text(row.controller),
        Text(str(row.runs)),
        Text(_percent(row.success), "green" if row.success == 1.0 else ""),
        Text(_percent(row.collided), "bold red" if row.collided else ""),
        Text(_percent(row.timeout)),
        Text(_percent(row.blocked)),
        Text(f"{_metres(row.clearance_m_worst)} / {_metres(row.clearance_m_median)}"),
        Text(_ratio(row.makespan_ratio)),
        Text(_ratio(row.time_ratio)),
        Text(_ratio(row.path_ratio)),
        Text("" if row.score is None else f"{row.score:.3f}"),
        Text("" if row.step_us is None else f"{row.step_us:.0f}"),
        verdict,
    )


def _peer_cells(peer: Published) -> tuple[Text, ...]:
    texts = (
        *("", f"[{peer.who}]", "", "" if peer.success is None else _percent(peer.success)),
        *("", "", "", "", _ratio(peer.makespan_ratio), _ratio(peer.time_ratio)),
        *(_ratio(peer.path_ratio), "" if peer.score is None else f"{peer.score:.3f}", "", ""),
    )
    return tuple(Text(text, "dim") for text in texts)


def _percent(share: float | None) -> str:
    return "" if share is None else f"{100.0 * share:.0f} %"


def _metres(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def _ratio(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}"
