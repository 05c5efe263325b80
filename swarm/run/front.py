"""What a person sees of a run: progress while it goes, a table of the outcome at its end."""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence

from rich.console import Console, Group
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from swarm import metrics, runs
from swarm.messages import Event, RobotStatus, Status
from swarm.run.supervisor import Watcher

PLAIN_PERIOD_S = 2.0  # wall, between lines where there is no terminal
QUIET_EVENTS = ("start", "end")

STYLES = {
    "running": "green",
    "starting": "dim",
    "collided": "bold red",
    "killed": "red",
    "lost": "red",
    "missing": "red",
    "hung": "yellow",
    "restarting": "yellow",
}


class Progress(Watcher):
    """Live table on a terminal, plain lines elsewhere; always on standard error."""

    def __init__(self) -> None:
        self._console = Console(stderr=True)
        self._live: Live | None = None
        self._line_due_s = 0.0

    def started(self, card: runs.Card, addresses: Sequence[str]) -> None:
        """Say where everything is."""
        self.note(f"{card.scenario}: run {card.run} on {card.endpoint}")
        for address in addresses:
            self.note(f"watch in {address}")
        if self._console.is_terminal:
            self._live = Live(console=self._console, refresh_per_second=4, transient=True)
            self._live.start()

    def status(self, status: Status) -> None:
        """Redraw, or a line now and then."""
        if self._live is not None:
            self._live.update(_table(status))
        elif time.monotonic() >= self._line_due_s:
            self._line_due_s = time.monotonic() + PLAIN_PERIOD_S
            running = sum(row.state in ("running", "starting") for row in status.robots)
            arrived = sum(row.arrived for row in status.robots)
            self.note(
                f"{status.state} {_sim_time_s(status):6.1f} s of at most {status.duration_s:g} s, "
                f"{status.real_time_factor:.1f} x real time, {running} running, {arrived} arrived"
            )

    def event(self, event: Event) -> None:
        """Say what happened, except what is plain to see."""
        if event.kind not in QUIET_EVENTS:
            who = f" {event.robot}" if event.robot else ""
            self.note(f"{event.stamp_ns / 1e9:.2f} s: {event.kind}{who}: {event.text}")

    def note(self, text: str) -> None:
        """One line."""
        self._console.print(Text(text), highlight=False, soft_wrap=True)

    def close(self) -> None:
        """Leave the terminal as it was."""
        if self._live is not None:
            self._live.stop()
            self._live = None


def _sim_time_s(status: Status) -> float:
    return status.stamp_ns / 1e9


def _table(status: Status) -> Group:
    table = Table(box=None, pad_edge=False)
    for name in ("NAME", "STATE", "RESTARTS", "MODE", "LEADER", "ERROR", "ARRIVED"):
        table.add_column(name, justify="right" if name in ("RESTARTS", "ERROR") else "left")
    shown = status.robots[:30]
    for row in shown:
        table.add_row(*_cells(row))
    if len(status.robots) > len(shown):
        table.add_row(f"... {len(status.robots) - len(shown)} more")
    time_s = _sim_time_s(status)
    head = Text(
        f"{status.scenario}: {time_s:.1f} s of at most {status.duration_s:g} s, "
        f"{status.real_time_factor:.1f} x real time"
    )
    bar = Table.grid()  # a bare bar would not end its line
    bar.add_row(ProgressBar(total=status.duration_s, completed=time_s, width=60))
    return Group(head, bar, table)


def _cells(row: RobotStatus) -> tuple[Text, ...]:
    error = "" if row.error_m is None else f"{row.error_m:.3f} m"
    return (
        Text(row.name),
        Text(row.state, style=STYLES.get(row.state, "")),
        Text(str(row.restarts) if row.restarts else ""),
        Text(f"{row.mode}: {row.reason}" if row.reason else row.mode),
        Text(row.leader),
        Text(error),
        Text("yes" if row.arrived else "", style="green"),
    )


def show_status(status: Status) -> None:
    """The table of `swarm status`."""
    Console().print(_table(status))


def show_summary(summary: metrics.Summary, folder: str) -> None:
    """The outcome, in a table for people, on standard output."""
    console = Console()
    table = Table(title=f"{summary.scenario}: {summary.outcome}", title_justify="left", box=None)
    for name in ("ROBOT", "OUTCOME", "ARRIVAL", "PATH", "FINAL ERROR", "YIELDS", "WAITED"):
        table.add_column(name, justify="left" if name in ("ROBOT", "OUTCOME") else "right")
    for row in summary.per_robot:
        style = "green" if row.outcome == "arrived" else "red"
        table.add_row(
            row.name,
            Text(f"{row.outcome}: {row.reason}" if row.reason else row.outcome, style=style),
            _figure(row.arrival_s, "s", 2),
            _figure(row.path_m, "m", 2),
            _figure(row.final_error_m, "m", 3),
            str(row.yields),
            _figure(row.waiting_s, "s", 1),
        )
    console.print(table)
    for line in _lines(summary):
        console.print(Text(line), highlight=False, soft_wrap=True)
    console.print(Text(f"recording: {folder}"), highlight=False, soft_wrap=True)


def _lines(summary: metrics.Summary) -> list[str]:
    lines = [
        f"{summary.arrived} of {summary.robots} arrived, {summary.collisions} collisions"
        + (f" ({summary.collisions_excused} excused)" if summary.collisions_excused else "")
        + f", {summary.sim_time_s:g} s simulated"
        + (
            f" in {summary.wall_time_s:.1f} s ({summary.real_time_factor:.1f} x real time)"
            if summary.wall_time_s and summary.real_time_factor
            else ""
        ),
        f"clearance: {_figure(summary.min_clearance_obstacle_m, 'm', 3)} to obstacles, "
        f"{_figure(summary.min_clearance_robot_m, 'm', 3)} between robots",
    ]
    formation = summary.formation
    if formation is not None:
        lines.append(
            f"formation: error at most {_figure(formation.error_m_max, 'm', 2)}, "
            f"{_figure(formation.error_m_final, 'm', 3)} at the end, "
            f"settled after {_figure(formation.settling_s, 's', 2)}"
        )
    lines += [f"met:    {text}" for text in summary.expect.met]
    lines += [f"MISSED: {text}" for text in summary.expect.missed]
    return lines


def _figure(value: float | None, unit: str, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f} {unit}"


def say(text: str) -> None:
    """One line on standard error."""
    print(text, file=sys.stderr, flush=True)
