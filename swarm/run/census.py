"""A running swarm as the world tells of it, joined with what the kernel knows of its processes.

Status --.
>-- Row by Row: the supervisor, the world, every robot --> top, status
psutil --'
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Literal

import msgspec
import psutil

from swarm import runs
from swarm.messages import RobotStatus, Status
from swarm.run import processes

SUPERVISOR, WORLD = "run", "world"
STOPPED = (psutil.STATUS_STOPPED, psutil.STATUS_TRACING_STOP)
SLOW_S = 0.5  # a robot that owes an answer for longer is slow,
SILENT_S = 2.0  # and after this it is silent

Health = Literal["", "ok", "slow", "silent", "stopped"]


class Row(msgspec.Struct, frozen=True, kw_only=True):
    """One process of a swarm. What does not apply, or is not known, is None or empty.

    `cpu_percent` is of one core since the row before, at first since the process began; memory is
    its proportional share, so that shared pages count once.
    """

    name: str  # `run` is the supervisor
    pid: int | None = None
    state: str = ""  # of a robot what the world makes of it, else the kernel's word
    mode: str = ""
    leader: str = ""
    health: Health = ""
    restarts: int | None = None
    age_s: float | None = None
    cpu_percent: float | None = None
    memory_bytes: int | None = None
    commands_per_s: float | None = None
    late_commands: int | None = None
    heard: int | None = None


class _Seen(msgspec.Struct, frozen=True):
    cpu_s: float
    at_s: float


class Census:
    """Remembers how much every process had used the last time."""

    def __init__(self, card: runs.Card) -> None:
        """Of the swarm of this card."""
        self._card = card
        self._seen: dict[int, _Seen] = {}

    def take(self, status: Status | None) -> list[Row]:
        """Everyone there is now; without a status only processes."""
        there = {
            name.removeprefix(processes.PREFIX): process
            for process in processes.of(self._card)
            if (name := _name(process)).startswith(processes.PREFIX)
        }
        rows = [self._of_process(name, there.get(name)) for name in (SUPERVISOR, WORLD)]
        if status is not None and rows[1].pid is not None:
            rows[1] = msgspec.structs.replace(rows[1], state=_state_of_world(rows[1], status))
        known: Mapping[str, RobotStatus] = (
            {} if status is None else {row.name: row for row in status.robots}
        )
        names = [*known, *(name for name in there if name not in (SUPERVISOR, WORLD, *known))]
        for name in names:
            rows.append(_with_status(self._of_process(name, there.get(name)), known.get(name)))
        return rows

    def _of_process(self, name: str, process: psutil.Process | None) -> Row:
        if process is None:
            return Row(name=name)
        try:
            with process.oneshot():
                now_s, began_s = time.time(), process.create_time()
                times = process.cpu_times()
                cpu_s = times.user + times.system
                before = self._seen.get(process.pid, _Seen(0.0, began_s))
                self._seen[process.pid] = _Seen(cpu_s, now_s)
                span_s = now_s - before.at_s
                return Row(
                    name=name,
                    pid=process.pid,
                    state=str(process.status()),
                    age_s=now_s - began_s,
                    cpu_percent=100.0 * (cpu_s - before.cpu_s) / span_s if span_s > 0.0 else None,
                    memory_bytes=_memory_bytes(process),
                )
        except psutil.Error:  # gone meanwhile
            return Row(name=name)


def _name(process: psutil.Process) -> str:
    try:
        return process.name()
    except psutil.Error:
        return ""


def _memory_bytes(process: psutil.Process) -> int:
    try:
        return int(process.memory_full_info().pss)
    except psutil.AccessDenied:
        return int(process.memory_info().rss)


def _state_of_world(row: Row, status: Status) -> str:
    return row.state if row.state in STOPPED else status.state


def _with_status(row: Row, status: RobotStatus | None) -> Row:
    if status is None:
        return row
    stopped = row.state in STOPPED
    return msgspec.structs.replace(
        row,
        state=status.state,
        mode=status.mode,
        leader=status.leader,
        health="stopped" if stopped else health(status),
        restarts=status.restarts,
        commands_per_s=status.commands_per_s,
        late_commands=status.late_commands,
        heard=status.heard,
    )


def left_s(status: Status) -> float | None:
    """Wall time that is left at most, at the pace of the last moment; None: nobody can say.

    Nobody knows when the last robot arrives: what is known is when the run times out.
    """
    pace = status.real_time_factor_now or status.real_time_factor
    if status.state != "running" or pace <= 0.0:
        return None
    return max(0.0, status.duration_s - status.stamp_ns / 1e9) / pace


def notable(status: Status) -> str:
    """Who leads, who is not well, who lets whom pass: one line, empty when there is nothing."""
    robots = status.robots
    # every group has its own leader; one that is not there cannot lead
    leading = [one.name for one in robots if one.leader == one.name and one.state == "running"]
    parts = [f"leads: {', '.join(leading)}"] if leading else []
    for state in dict.fromkeys(one.state for one in robots):
        if state not in ("running", "starting"):
            names = [one.name for one in robots if one.state == state]
            parts.append(f"{state}: {', '.join(names)}")
    for word in ("slow", "silent"):
        if names := [one.name for one in robots if health(one) == word]:
            parts.append(f"{word}: {', '.join(names)}")
    failed = [f"{one.name} ({one.reason})" for one in robots if one.mode == "FAILED"]
    parts += [f"failed: {', '.join(failed)}"] if failed else []
    yielding = [f"{one.name} to {one.yields_to}" for one in robots if one.yields_to]
    parts += [f"yields: {', '.join(yielding)}"] if yielding else []
    return "; ".join(parts)


def health(status: RobotStatus) -> Health:
    """How a robot answers, from the age of its newest command while it owes one."""
    if status.state not in ("running", "collided"):
        return ""
    if status.unanswered == 0 or status.command_age_s is None:
        return "ok"
    if status.command_age_s <= SLOW_S:
        return "ok"
    return "slow" if status.command_age_s <= SILENT_S else "silent"
