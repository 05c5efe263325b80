"""The table of `swarm top`: one line for every process of a swarm, the world's word above it.

Narrow terminals lose columns from the right of this list: NAME STATE HEALTH MODE PID RESTARTS
LEADER CPU RATE LATE MEM HEARD AGE. The first two stay.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rich.console import Group, RenderableType
from rich.text import Text

from swarm.messages import Status
from swarm.run import columns
from swarm.run.census import SUPERVISOR, WORLD, Row, left_s, notable
from swarm.run.columns import Column

COLUMNS = (
    Column("NAME"),
    Column("PID", 3, right=True),
    Column("STATE"),
    Column("MODE", 2),
    Column("LEADER", 5),
    Column("HEALTH", 1),
    Column("RESTARTS", 4, right=True),
    Column("AGE", 11, right=True),
    Column("CPU", 6, right=True),
    Column("MEM", 9, right=True),
    Column("RATE", 7, right=True),
    Column("LATE", 8, right=True),
    Column("HEARD", 10, right=True),
)
STYLES = {
    "running": "green",
    "starting": "dim",
    "paused": "yellow",
    "collided": "bold red",
    "killed": "red",
    "lost": "red",
    "missing": "red",
    "hung": "yellow",
    "restarting": "yellow",
    "stopped": "yellow",
    "slow": "yellow",
    "silent": "red",
}
WELL = ("running", "starting")
HEAD_LINES = 3  # above the rows: two of text, one of titles


def board(
    status: Status | None,
    rows: Sequence[Row],
    names: Mapping[str, str],
    *,
    width: int | None = None,
    height: int | None = None,
    note: str = "",
) -> RenderableType:
    """Everything that `swarm top` shows.

    Args:
        names: style of each robot's name.
        width: letters, height: lines of the terminal; None: as much as it takes.
        note: instead of the second line, which tells who leads and who is not well.
    """
    shown = fitting(rows, None if height is None else height - HEAD_LINES)
    cells = [_cells(row, names) for row in shown]
    if len(shown) < len(rows):
        cells.append([Text(f"... {len(rows) - len(shown)} more"), *[Text()] * (len(COLUMNS) - 1)])
    table = columns.table(COLUMNS, cells, width)
    second = note or ("" if status is None else notable(status))
    return Group(one_line(headline(status)), one_line(second), table)


def one_line(text: str, style: str = "") -> Text:
    """Cut where the terminal ends."""
    return Text(text, style=style, no_wrap=True, overflow="ellipsis")


def fitting(rows: Sequence[Row], count: int | None) -> Sequence[Row]:
    """As many rows as there is room for: the swarm's own two, then those in trouble, first."""
    if count is None or len(rows) <= count:
        return rows
    wanted = sorted(range(len(rows)), key=lambda number: (_is_well(rows[number]), number))
    return [rows[number] for number in sorted(wanted[: max(1, count - 1)])]


def _is_well(row: Row) -> bool:
    if row.name in (SUPERVISOR, WORLD):
        return False
    return row.state in WELL and row.health in ("", "ok")


def headline(status: Status | None) -> str:
    """One line about the run as a whole."""
    if status is None:
        return "the world has not said anything yet"
    left = left_s(status)
    return (
        f"{status.state} at {status.stamp_ns / 1e9:.1f} s of at most {status.duration_s:g} s, "
        f"{status.real_time_factor_now:.1f} x real time"
        + (f" of {status.rate:g}" if status.rate else "")
        + ("" if left is None else f", at most {age(left)} left")
        + f": {status.scenario}"
    )


def _cells(row: Row, names: Mapping[str, str]) -> list[Text]:
    return [
        Text(row.name, style=names.get(row.name, "")),
        Text("" if row.pid is None else str(row.pid)),
        Text(row.state, style=STYLES.get(row.state, "")),
        Text(row.mode),
        Text(row.leader, style=names.get(row.leader, "")),
        Text(row.health, style=STYLES.get(row.health, "")),
        Text(str(row.restarts) if row.restarts else ""),
        Text("" if row.age_s is None else age(row.age_s)),
        _figure(row.cpu_percent, "{:.0f}%"),
        Text("" if row.memory_bytes is None else f"{row.memory_bytes / 2**20:.0f}M"),
        _figure(row.commands_per_s, "{:.1f}"),
        Text(str(row.late_commands) if row.late_commands else ""),
        Text("" if row.heard is None else str(row.heard)),
    ]


def _figure(value: float | None, form: str) -> Text:
    return Text("" if value is None else form.format(value))


def age(seconds: float) -> str:
    """A time for people: 7s, 3m05s, 2h10m."""
    whole = int(seconds)
    if whole < 60:
        return f"{whole}s"
    if whole < 3600:
        return f"{whole // 60}m{whole % 60:02d}s"
    return f"{whole // 3600}h{whole // 60 % 60:02d}m"
