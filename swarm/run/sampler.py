"""What the processes of a run cost: a sample of each, once a second, beside their logs.

    pids --look--> logs/processes.jsonl --read--> Sample ...

One JSON object a line, so that a killed supervisor leaves all but the last.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Mapping
from pathlib import Path

import msgspec
import psutil

from swarm import runs

FILE_NAME = "processes.jsonl"
PERIOD_S = 1.0  # wall; a sample takes some 60 us a process


class Sample(msgspec.Struct, frozen=True):
    """One process at one moment."""

    wall_s: float  # since the first sample of the run
    name: str
    pid: int
    cpu_s: float  # user and system, since it was started
    memory_bytes: int  # resident; pages that it shares with others are counted in each


class Sampler:
    """Takes a sample of every process when one is due; a disk that fails is not its business."""

    def __init__(self, folder: Path, now: Callable[[], float] = time.monotonic) -> None:
        """Args: the run's folder, and a wall clock in seconds."""
        self._path = folder / runs.LOGS / FILE_NAME
        self._now = now
        self._start_s = now()
        self._due_s = self._start_s
        self._processes: dict[int, psutil.Process] = {}

    def look(self, living: Callable[[], Mapping[str, int]], *, at_once: bool = False) -> None:
        """Sample who lives, unless it was done less than PERIOD_S ago.

        Args:
            living: asked for names and pids only when a sample is due.
        """
        now_s = self._now()
        if now_s < self._due_s and not at_once:
            return
        self._due_s = now_s + PERIOD_S
        pids = living()
        self._processes = {
            pid: process for pid, process in self._processes.items() if pid in pids.values()
        }
        lines = []
        for name, pid in pids.items():
            with contextlib.suppress(psutil.Error):
                sample = self._sample(now_s - self._start_s, name, pid)
                lines.append(msgspec.json.encode(sample) + b"\n")
        with contextlib.suppress(OSError), self._path.open("ab") as file:
            file.write(b"".join(lines))

    def _sample(self, wall_s: float, name: str, pid: int) -> Sample:
        if pid not in self._processes:
            self._processes[pid] = psutil.Process(pid)
        process = self._processes[pid]
        with process.oneshot():
            times = process.cpu_times()
            return Sample(
                round(wall_s, 3),
                name,
                pid,
                round(times.user + times.system, 3),
                process.memory_info().rss,
            )


def read(folder: Path) -> tuple[Sample, ...]:
    """Samples of a run, none when there are none; lines that are not whole are passed over."""
    try:
        lines = (folder / runs.LOGS / FILE_NAME).read_bytes().splitlines()
    except OSError:
        return ()
    samples = []
    for line in lines:
        with contextlib.suppress(msgspec.DecodeError):
            samples.append(msgspec.json.decode(line, type=Sample))
    return tuple(samples)
