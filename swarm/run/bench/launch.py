"""From typing `swarm run` until the first tick, and what memory each robot then has of its own.

    swarm run empty --robots N --rate 1 -> its card -> its status on the bus -> memory -> end

PSS shares a page that several processes have between them, so it adds up to what is really used.
"""

from __future__ import annotations

import contextlib
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import psutil

from swarm import errors, runs, zenoh_bus
from swarm.messages import STATUS, Status
from swarm.run.bench import figures
from swarm.run.bench.figures import Row

SCENARIO = "empty"
SIZES = ((6, 3), (50, 2))  # robots, rounds
TINY_SIZES = ((2, 1),)
FIRST_TICK_S_MAX = 5.0  # budgets, from this many robots on:
PSS_MB_MAX = 12.0
BUDGET_SIZE_MIN = 50  # a few robots have fewer to share their pages with
TIMEOUT_S = 60.0  # wall; a swarm that has not ticked by then is a failure
END_S = 10.0  # from the request to stop to SIGKILL; the supervisor needs at most half of it
POLL_S = 0.005
STDERR = "stderr"  # file name


class Launch(msgspec.Struct, frozen=True):
    """One launch."""

    first_tick_s: float
    pss_mb: float  # of one robot, mean


def measure(*, tiny: bool, progress: Callable[[str], None]) -> tuple[Row, ...]:
    """Rows of every N."""
    rows: list[Row] = []
    for size, rounds in TINY_SIZES if tiny else SIZES:
        seen = []
        for number in range(rounds):
            progress(f"launch: {size} robots, round {number + 1} of {rounds}")
            seen.append(launch(size))
        budgeted = size >= BUDGET_SIZE_MIN
        rows += [
            figures.at_most(
                "launch: first tick",
                size,
                [one.first_tick_s for one in seen],
                "s",
                FIRST_TICK_S_MAX if budgeted else None,
            ),
            figures.at_most(
                "launch: memory of a robot",
                size,
                [one.pss_mb for one in seen],
                "MB",
                PSS_MB_MAX if budgeted else None,
            ),
        ]
    return tuple(rows)


def launch(size: int) -> Launch:
    """Launch, look, end. Raises SwarmError when no tick comes in time."""
    with tempfile.TemporaryDirectory() as folder:
        begin_s = time.monotonic()
        with _swarm_run(size, Path(folder)) as process:
            started_s = _first_tick_s(process, Path(folder), begin_s + TIMEOUT_S)
            return Launch(started_s - begin_s, _pss_mb(process.pid, size))


@contextlib.contextmanager
def _swarm_run(size: int, folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    """The command, in a session of its own so that Ctrl-C reaches only us, ended afterwards.

    Should we be killed, `--stop-after` ends it.
    """
    options = ["--robots", size, "--rate", 1, "--duration", 1000, "--stop-after", TIMEOUT_S]
    command = [sys.executable, "-m", "swarm.run.start", "run", SCENARIO, "--quiet"]
    command += ["--out", str(folder), *(str(option) for option in options)]
    with (folder / STDERR).open("wb") as stderr:
        process = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=stderr,
            start_new_session=True,
        )
    try:
        yield process
    finally:
        process.terminate()
        try:
            process.wait(END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


def _first_tick_s(process: subprocess.Popen[bytes], folder: Path, deadline_s: float) -> float:
    """Monotonic time of the first tick, computed back from the first status that has one."""
    card = _card(process, folder, deadline_s)
    bus = zenoh_bus.open_client(card.run, card.endpoint, name="supervisor")
    try:
        bus.subscribe(STATUS)
        while (left_s := deadline_s - time.monotonic()) > 0.0:
            delivery = bus.receive(left_s)
            if delivery is None:
                continue
            status: Status = delivery.message
            if status.state == "running" and status.real_time_factor > 0.0:
                return time.monotonic() - 1e-9 * status.stamp_ns / status.real_time_factor
    finally:
        bus.close()
    raise errors.SwarmError(f"bench: expected a first tick within {TIMEOUT_S:g} s, got none")


def _card(process: subprocess.Popen[bytes], folder: Path, deadline_s: float) -> runs.Card:
    """What the command posts in the run's folder once its world is up."""
    while process.poll() is None and time.monotonic() < deadline_s:
        with contextlib.suppress(FileNotFoundError, msgspec.DecodeError):  # not there, or not whole
            return msgspec.json.decode((folder / runs.CARD).read_bytes(), type=runs.Card)
        time.sleep(POLL_S)
    said = (folder / STDERR).read_text(errors="replace").strip().splitlines()
    raise errors.SwarmError(
        f"bench: expected `swarm run` to come up, got exit code {process.poll()}"
        f"{': ' + said[-1] if said else ''}"
    )


def _pss_mb(pid: int, size: int) -> float:
    """Mean over the robots below a process, by the names that they have given themselves."""
    robots = [
        child
        for child in psutil.Process(pid).children(recursive=True)
        if " ".join(child.cmdline()).startswith("swarm-robot")
    ]
    if len(robots) != size:
        raise errors.SwarmError(f"bench: expected {size} robots below {pid}, got {len(robots)}")
    return statistics.mean(child.memory_full_info().pss for child in robots) / 1e6
