"""What a run needs of this machine, looked at piece by piece, with what to do where it is wanting.

CHECKS --each--> Finding: ok, warn (a run works all the same), bad (it would not)
"""

from __future__ import annotations

import contextlib
import importlib.metadata
import os
import platform
import re
import resource
import shutil
import socket
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Literal

import msgspec
import psutil

from swarm import errors, runs, zenoh_bus
from swarm.run import processes
from swarm.run.child import free_port

PYTHON_MIN = (3, 11)
PACKAGE = "msam-swarm"
PINS = Path(__file__).parents[2] / "deploy" / "constraints.txt"  # in a checkout
VIEWER_S = 20.0
FREE_BYTES_MIN, FREE_BYTES_FEW = 100 << 20, 1 << 30
SPEED_BYTES = 16 << 20  # written to see how fast the disk is
SPEED_MBPS_FEW = 20.0  # 100 robots record some 3 MB/s, but a stall holds the world up
FILES_MIN, FILES_FEW = 256, 1024  # 100 robots need some 400
SHM_BYTES_FEW = 16 << 20
ORPHAN_S = 5.0  # children end by themselves 2 s after their supervisor
SLOW_CLOCKS = ("hpet", "acpi_pm", "jiffies", "refined-jiffies")

State = Literal["ok", "warn", "bad"]


class Finding(msgspec.Struct, frozen=True):
    """What one check has found."""

    name: str
    state: State
    text: str
    advice: str = ""  # what to do about it


class Report(msgspec.Struct, frozen=True):
    """All of them; `ok` when a run would work."""

    ok: bool
    checks: tuple[Finding, ...]


def examine() -> Report:
    """Do all checks, one after the other: some 3 s."""
    found = tuple(check() for check in CHECKS)
    return Report(all(one.state != "bad" for one in found), found)


# --- what is installed ----------------------------------------------------------------------------


def check_python() -> Finding:
    """Whether the interpreter is new enough."""
    text = f"{platform.python_version()} ({platform.python_implementation()})"
    least = ".".join(map(str, PYTHON_MIN))
    if tuple(map(int, platform.python_version_tuple()[:2])) < PYTHON_MIN:
        return Finding("python", "bad", f"expected {least} or newer, got {text}", "make setup")
    return Finding("python", "ok", text)


def check_packages() -> Finding:
    """Whether everything is there in a version that is known to work."""
    wanted = [line for line in importlib.metadata.requires(PACKAGE) or () if "extra ==" not in line]
    wrong, other = [], []
    pins = read_pins()
    for line in wanted:
        name, bounds = split_requirement(line)
        try:
            version = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            wrong.append(f"{name} is missing")
            continue
        if not is_within(version, bounds):
            wrong.append(f"{name} {version}, expected {bounds}")
        elif pins.get(name, version) != version:
            other.append(f"{name} {version}, tested with {pins[name]}")
    if wrong:
        return Finding("packages", "bad", "; ".join(wrong), "make clean setup")
    if other:
        return Finding("packages", "warn", "; ".join(other), "make clean setup, should it matter")
    tested = ", as tested" if pins else ""
    return Finding("packages", "ok", f"{len(wanted)} as needed{tested}")


def read_pins() -> dict[str, str]:
    """Versions that were tested together; none outside a checkout."""
    try:
        lines = PINS.read_text().splitlines()
    except OSError:
        return {}
    return dict(line.split("==") for line in lines if "==" in line and not line.startswith("#"))


def split_requirement(line: str) -> tuple[str, str]:
    """(name, bounds) of a requirement such as `zenoh<2,>=1.10`."""
    match = re.match(r"^([A-Za-z0-9._-]+?)\s*([<>=!~].*)?$", line.split(";")[0].strip())
    assert match is not None, line
    return match[1], (match[2] or "").strip()


def is_within(version: str, bounds: str) -> bool:
    """Whether a version keeps bounds of >= and <; other kinds are not used."""
    have = _numbers(version)
    for bound in filter(None, bounds.split(",")):
        if bound.startswith(">="):
            if have < _numbers(bound[2:]):
                return False
        elif bound.startswith("<") and have >= _numbers(bound[1:]):
            return False
    return True


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in re.findall(r"\d+", version.split("+")[0])[:4])


def check_viewer() -> Finding:
    """Whether the Rerun viewer is there and starts."""
    from dashboards import live  # half a second

    binary = live.viewer_binary()
    try:
        done = subprocess.run(
            [str(binary), "--version"], capture_output=True, text=True, timeout=VIEWER_S, check=True
        )
    except (OSError, subprocess.SubprocessError) as error:
        return Finding("viewer", "warn", f"{binary}: {error}", "pip install --force rerun-sdk")
    version = done.stdout.split(" (")[0].strip()
    if os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        return Finding("viewer", "ok", f"{version}, a display is there")
    return Finding("viewer", "ok", f"{version}; no display: use --view web")


# --- network --------------------------------------------------------------------------------------


def check_ports() -> Finding:
    """Whether loopback has free ports that can be connected to."""
    try:
        with socket.socket() as server:
            server.bind(("127.0.0.1", 0))
            server.listen()
            port = server.getsockname()[1]
            with socket.create_connection(("127.0.0.1", port), 1.0):
                return Finding("ports", "ok", f"loopback gives ports, {port} this time")
    except OSError as error:
        return Finding("ports", "bad", f"127.0.0.1: {error}", "ip link set lo up; look at firewall")


def check_router() -> Finding:
    """Whether a Zenoh router can be opened and joined, as world and robots do."""
    began_s = time.monotonic()
    try:
        endpoint = f"tcp/127.0.0.1:{free_port()}"
        router = zenoh_bus.open_router("doctor", endpoint)
        try:
            zenoh_bus.open_client("doctor", endpoint, name="doctor", leaf=True).close()
        finally:
            router.close()
    except (OSError, errors.SwarmError) as error:
        return Finding("router", "bad", str(error), "look at firewall and at the ports check")
    return Finding("router", "ok", f"Zenoh joins in {time.monotonic() - began_s:.1f} s")


# --- room and limits ------------------------------------------------------------------------


def check_disk() -> Finding:
    """Room and speed where runs are written: the folder at hand."""
    folder = Path()
    try:
        folder = Path.cwd()
        free = shutil.disk_usage(folder).free
        if free < FREE_BYTES_MIN:
            return disk(folder, free, 0.0)
        with tempfile.TemporaryFile(dir=folder) as file:
            began_s = time.monotonic()
            file.write(os.urandom(SPEED_BYTES))
            file.flush()
            os.fsync(file.fileno())
            speed_mbps = SPEED_BYTES / 2**20 / max(1e-6, time.monotonic() - began_s)
    except OSError as error:
        advice = "run elsewhere, or choose a folder with --out"
        return Finding("disk", "bad", f"{folder}: {error.strerror}", advice)
    return disk(folder, free, speed_mbps)


def disk(folder: Path, free: int, speed_mbps: float) -> Finding:
    """What room and speed mean."""
    text = f"{folder}: {free / 2**30:.1f} GB free"
    if free < FREE_BYTES_MIN:
        return Finding("disk", "bad", text, "make room, or choose a folder with --out")
    text += f", {speed_mbps:.0f} MB/s written through"
    if free < FREE_BYTES_FEW:
        return Finding("disk", "warn", text, "enough for short runs only: make room")
    if speed_mbps < SPEED_MBPS_FEW:
        return Finding("disk", "warn", text, "large swarms may wait for it: choose another --out")
    return Finding("disk", "ok", text)


def check_files() -> Finding:
    """How many files a process may hold open."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    text = f"{soft} open files for each process"
    advice = f"ulimit -n {FILES_FEW if hard == resource.RLIM_INFINITY else min(hard, 4096)}"
    if soft != resource.RLIM_INFINITY and soft < FILES_FEW:
        return Finding("descriptors", "bad" if soft < FILES_MIN else "warn", text, advice)
    return Finding("descriptors", "ok", text)


def check_processes() -> Finding:
    """How many processes and threads there may be."""
    soft, _ = resource.getrlimit(resource.RLIMIT_NPROC)
    if soft == resource.RLIM_INFINITY:
        return Finding("processes", "ok", "as many as there are")
    text = f"{soft} processes and threads of this user"
    if soft < 2048:  # 100 robots have some 1000 threads
        return Finding("processes", "warn", text, "ulimit -u 4096, for swarms of 100")
    return Finding("processes", "ok", text)


def check_shm() -> Finding:
    """Whether shared memory can be had."""
    folder = Path("/dev/shm")
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(b"0")
        free = shutil.disk_usage(folder).free
    except OSError as error:
        advice = "mount -t tmpfs tmpfs /dev/shm; of a container: --shm-size 64m"
        return Finding("/dev/shm", "warn", str(error.strerror), advice)
    state: State = "warn" if free < SHM_BYTES_FEW else "ok"
    return Finding("/dev/shm", state, f"{free / 2**20:.0f} MB free", "make room" * (state != "ok"))


# --- time ------------------------------------------------------------------------


def check_cores() -> Finding:
    """How many cores we may use, and how busy they are."""
    count, (load, _, _) = len(os.sched_getaffinity(0)), os.getloadavg()
    text = f"{count} cores, load {load:.1f}"
    if count < 2:
        return Finding("cores", "warn", text, "works, but slowly: world and robots take turns")
    if load > count:
        return Finding("cores", "warn", text, "others use them: real time may not be kept")
    return Finding("cores", "ok", text)


def check_clock() -> Finding:
    """Where the kernel takes the time from."""
    path = Path("/sys/devices/system/clocksource/clocksource0/current_clocksource")
    try:
        source = path.read_text().strip()
    except OSError:
        source = "not told"
    resolution_ns = time.get_clock_info("monotonic").resolution * 1e9
    text = f"{source}, {resolution_ns:.0f} ns"
    if source in SLOW_CLOCKS:
        return Finding("clock", "warn", text, "slow to read: boot with clocksource=tsc if it can")
    return Finding("clock", "ok", text)


# --- what others have left ------------------------------------------------------------------------


def check_runtime_folder() -> Finding:
    """Whether a running swarm can be found by status, top, stop ..."""
    folder = runs.runtime_folder()
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        text = f"{folder}: {error.strerror}: status, top, stop will not find what runs"
        return Finding("runtime folder", "warn", text, f"make it yours: rm -r {folder}")
    return Finding("runtime folder", "ok", str(folder))


def check_cards() -> Finding:
    """Cards of runs that are gone; looking for what runs removes them."""
    before = len(list(runs.runtime_folder().glob("*.json")))
    there = runs.running()
    left = len(list(runs.runtime_folder().glob("*.json")))
    names = f": {', '.join(card.run for card in there)}" if there else ""
    text = f"{len(there)} running{names}"
    if before > left:
        text += f"; {before - left} stale cards were removed"
    if left > len(there):
        advice = f"rm them: {runs.runtime_folder()}"
        return Finding("runs", "warn", f"{text}; {left - len(there)} cards not readable", advice)
    return Finding("runs", "ok", text)


def check_orphans() -> Finding:
    """Processes of a swarm whose supervisor is gone."""
    orphans = [
        row
        for process in psutil.process_iter()
        for row in processes.rows([process])
        if row.name != "run" and is_orphan(process)
    ]
    if not orphans:
        return Finding("orphans", "ok", "none")
    text = "; ".join(row.text() for row in orphans)
    pids = " ".join(str(row.pid) for row in orphans)
    return Finding("orphans", "warn", text, f"if they are not meant to be there: kill -9 {pids}")


def is_orphan(process: psutil.Process) -> bool:
    """Whether nobody looks after it: adopted by init, in no unit of a service manager."""
    with contextlib.suppress(psutil.Error, OSError):
        unit = ".service" in Path(f"/proc/{process.pid}/cgroup").read_text()
        old = time.time() - process.create_time() > ORPHAN_S
        return old and process.ppid() == 1 and not unit and process.uids().real == os.getuid()
    return False


CHECKS: tuple[Callable[[], Finding], ...] = (
    check_python,
    check_packages,
    check_viewer,
    check_ports,
    check_router,
    check_disk,
    check_files,
    check_processes,
    check_shm,
    check_cores,
    check_clock,
    check_runtime_folder,
    check_cards,
    check_orphans,
)
