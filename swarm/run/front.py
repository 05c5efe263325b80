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
from swarm.run import board, census, columns
from swarm.run.columns import Column
from swarm.run.supervisor import Watcher

PLAIN_PERIOD_S = 2.0  # wall, between lines where there is no terminal
PIPE_WIDTH = 1000
QUIET_EVENTS = ("start", "end")

COLUMNS = (  # narrow terminals lose ARRIVED first, then ERROR, LEADER, RESTARTS, MODE
    Column("NAME"),
    Column("STATE"),
    Column("RESTARTS", 2, right=True),
    Column("MODE", 1),
    Column("LEADER", 3),
    Column("ERROR", 4, right=True),
    Column("ARRIVED", 5),
)
BAR_WIDTH_MAX = 60
ROWS_MAX = 30
CHROME_LINES = 6  # title, progress, bar, who, titles, and a line below


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
            width, height = self._console.size
            self._live.update(_table(status, width, max(1, height - CHROME_LINES)))
        elif time.monotonic() >= self._line_due_s:
            self._line_due_s = time.monotonic() + PLAIN_PERIOD_S
            self.note("; ".join(filter(None, (progress(status), census.notable(status)))))

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


def progress(status: Status) -> str:
    """How far a run is, and how long it takes at most from here, in one line."""
    time_s, left_s = status.stamp_ns / 1e9, census.left_s(status)
    running = sum(row.state in ("running", "starting") for row in status.robots)
    arrived = sum(row.arrived for row in status.robots)
    return (
        f"{status.state} {time_s:.1f} s of at most {status.duration_s:g} s, "
        f"{status.real_time_factor_now:.1f} x real time, "
        + ("" if left_s is None else f"at most {board.age(left_s)} left, ")
        + f"{running} running, {arrived} arrived"
    )


def _table(status: Status, width: int | None, rows_max: int) -> Group:
    robots = status.robots
    if len(robots) > rows_max:  # those in trouble are worth the room
        wanted = sorted(range(len(robots)), key=lambda row: (robots[row].state == "running", row))
        robots = tuple(robots[row] for row in sorted(wanted[: max(1, rows_max - 1)]))
    cells = [_cells(row) for row in robots]
    if len(robots) < len(status.robots):
        more = Text(f"... {len(status.robots) - len(robots)} more")
        cells.append((more, *[Text()] * (len(COLUMNS) - 1)))
    bar = Table.grid()  # a bare bar would not end its line
    bar_width = min(BAR_WIDTH_MAX, width or BAR_WIDTH_MAX)
    bar.add_row(
        ProgressBar(
            total=status.duration_s, completed=status.stamp_ns / 1e9, width=bar_width, pulse=False
        )
    )
    return Group(
        board.one_line(status.scenario, "bold"),
        board.one_line(progress(status)),
        bar,
        board.one_line(census.notable(status)),
        columns.table(COLUMNS, cells, width),
    )


def _cells(row: RobotStatus) -> tuple[Text, ...]:
    error = "" if row.error_m is None else f"{row.error_m:.3f} m"
    return (
        Text(row.name),
        Text(row.state, style=board.STYLES.get(row.state, "")),
        Text(str(row.restarts) if row.restarts else ""),
        Text(f"{row.mode}: {row.reason}" if row.reason else row.mode),
        Text(row.leader),
        Text(error),
        Text("yes" if row.arrived else "", style="green"),
    )


def show_status(status: Status) -> None:
    """The table of `swarm status`."""
    console = Console()
    if console.is_terminal:
        console.print(_table(status, console.width, ROWS_MAX))
    else:  # a pipe gets whole lines
        Console(width=PIPE_WIDTH).print(_table(status, None, len(status.robots)))


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
