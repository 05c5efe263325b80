"""Progress of a run: what is left, who leads, who is not well, on any terminal."""

from __future__ import annotations

import io
from typing import Any

import msgspec
import pytest
from rich.console import Console

from swarm.messages import Event, RobotStatus, Status
from swarm.run import census, front
from swarm.run.front import Progress

ROBOTS = tuple(
    RobotStatus(name, "running", "FORM", "robot2", False, 0, 0.01)
    for name in ("robot1", "robot2", "robot3", "robot4")
)
STATUS = Status(
    "run", "Gap of 2 m", 100, 8_000_000_000, "lockstep", "running", 60.0, 3.0, ROBOTS,
    real_time_factor_now=2.0,
)  # fmt: skip


def status(rows: dict[str, dict[str, Any]] | None = None, **changes: Any) -> Status:
    robots = tuple(msgspec.structs.replace(row, **(rows or {}).get(row.name, {})) for row in ROBOTS)
    return msgspec.structs.replace(STATUS, robots=robots, **changes)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, 26.0),  # 52 s at the pace of now, not at that of the whole run
        ({"real_time_factor_now": 0.0}, 52.0 / 3.0),
        ({"real_time_factor_now": 0.0, "real_time_factor": 0.0}, None),
        ({"state": "paused"}, None),
        ({"state": "starting"}, None),
        ({"stamp_ns": 61_000_000_000}, 0.0),
    ],
)
def test_time_left_is_what_the_timeout_allows(
    changes: dict[str, Any], expected: float | None
) -> None:
    assert census.left_s(status(**changes)) == expected


def test_who_leads_and_who_is_not_well_is_one_line() -> None:
    assert census.notable(status()) == "leads: robot2"
    told = status(
        {
            "robot1": {"state": "killed", "leader": "robot1"},  # the dead do not lead
            "robot3": {"leader": "robot3", "yields_to": "robot2"},
            "robot4": {"mode": "FAILED", "reason": "enclosed", "unanswered": 3},
        }
    )
    told = msgspec.structs.replace(
        told, robots=(*told.robots[:3], msgspec.structs.replace(told.robots[3], command_age_s=1.0))
    )
    assert census.notable(told) == (
        "leads: robot2, robot3; killed: robot1; slow: robot4; failed: robot4 (enclosed); "
        "yields: robot3 to robot2"
    )
    assert census.notable(msgspec.structs.replace(STATUS, robots=())) == ""


def test_progress_is_one_line() -> None:
    assert front.progress(status({"robot1": {"arrived": True}})) == (
        "running 8.0 s of at most 60 s, 2.0 x real time, at most 26s left, 4 running, 1 arrived"
    )
    assert "left" not in front.progress(status(state="paused"))


@pytest.mark.parametrize("width", [15, 20, 40, 60, 100])
def test_live_table_keeps_within_any_terminal(width: int) -> None:
    console = Console(width=width, file=io.StringIO(), color_system=None)
    console.print(front._table(STATUS, width, rows_max=3))
    assert isinstance(console.file, io.StringIO)
    lines = [line.rstrip() for line in console.file.getvalue().splitlines()]
    assert len(lines) == 5 + 3  # title, progress, bar, who, columns; two robots, and how many more
    assert max(map(len, lines)) <= width
    assert lines[4].split()[0] == "NAME"


def test_without_a_terminal_progress_is_plain_lines(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(front, "PLAIN_PERIOD_S", 1000.0)
    progress = Progress()
    progress.status(STATUS)
    progress.status(STATUS)  # too soon
    progress.event(Event(60, 4_800_000_000, "fault", "robot3", "kill:robot3@4.8"))
    progress.event(Event(0, 0, "start", None, "Gap"))  # is plain to see
    progress.close()
    lines = capsys.readouterr().err.splitlines()
    assert lines == [
        f"{front.progress(STATUS)}; leads: robot2",
        "4.80 s: fault robot3: kill:robot3@4.8",
    ]
