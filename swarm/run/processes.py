"""The processes of a running swarm as the kernel sees them: who is there, and who holds it up."""

from __future__ import annotations

import time

import msgspec
import psutil

from swarm import runs

PREFIX = "swarm-"  # of what every process of a swarm calls itself
POLL_S = 0.02

# what a person should know of a state of the kernel's, and do about it
MEANINGS = {
    psutil.STATUS_STOPPED: "is stopped (continue it: kill -CONT {pid}; end it: kill -9 {pid})",
    psutil.STATUS_TRACING_STOP: "is stopped by a debugger",
    psutil.STATUS_DISK_SLEEP: "waits for a disk",
    psutil.STATUS_RUNNING: "is busy",
    psutil.STATUS_SLEEPING: "waits",
}
HELD = (psutil.STATUS_STOPPED, psutil.STATUS_TRACING_STOP, psutil.STATUS_DISK_SLEEP)


class Row(msgspec.Struct, frozen=True):
    """One process."""

    name: str  # world, a robot's, or run: the supervisor
    pid: int
    state: str  # the kernel's word

    def text(self) -> str:
        """For people."""
        meaning = MEANINGS.get(self.state, f"is {self.state}").format(pid=self.pid)
        return f"{'the supervisor' if self.name == 'run' else self.name} (pid {self.pid}) {meaning}"


def of(card: runs.Card) -> list[psutil.Process]:
    """All processes of a run on this host, its supervisor first."""
    if not runs.is_alive(card):
        return []
    try:
        supervisor = psutil.Process(card.pid)
        return [supervisor, *supervisor.children(recursive=True)]
    except psutil.Error:
        return []


def rows(processes: list[psutil.Process]) -> list[Row]:
    """Those that live and belong to the swarm by their name."""
    found = []
    for process in processes:
        try:
            name, state = process.name(), process.status()
        except psutil.Error:
            continue
        if name.startswith(PREFIX) and state != psutil.STATUS_ZOMBIE:
            found.append(Row(name.removeprefix(PREFIX), process.pid, state))
    return found


def what_blocks(card: runs.Card) -> str:
    """Why a run does not answer: who is stopped, or away, or else how the world is."""
    there = rows(of(card))
    if not there:
        return "the run has ended"
    held = [row.text() for row in there if row.state in HELD]
    worlds = [row for row in there if row.name == "world"]
    if not worlds:
        held.append("there is no world: it was killed, and is started again or given up")
    return "; ".join(held or [row.text() for row in worlds])


def wait_gone(processes: list[psutil.Process], timeout_s: float) -> list[Row]:
    """Wait until all have ended; those that have not in time."""
    deadline_s = time.monotonic() + timeout_s
    while (left := rows(processes)) and time.monotonic() < deadline_s:
        time.sleep(POLL_S)
    return left
