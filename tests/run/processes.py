"""Runs of the real command line, and the processes that belong to them."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest
import setproctitle

from swarm.run import cli

SWARM = (sys.executable, "-m", "swarm.run.start")


def start(folder: Path, *arguments: str) -> subprocess.Popen[str]:
    """`swarm ARGUMENTS` with `folder` as working directory, which marks all its processes."""
    return subprocess.Popen(
        [*SWARM, *arguments],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        stdin=subprocess.DEVNULL,
        text=True,
    )


def swarm(
    folder: Path, *arguments: str, timeout_s: float = 120.0
) -> subprocess.CompletedProcess[str]:
    """Run `swarm ARGUMENTS` to its end."""
    return subprocess.run(
        [*SWARM, *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        timeout=120.0,
        check=False,
    )


def here(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], folder: Path, line: str
) -> subprocess.CompletedProcess[str]:
    """The same command line within this process: for what ends before anything is started."""
    monkeypatch.chdir(folder)
    monkeypatch.setattr(setproctitle, "setproctitle", lambda title: None)  # we are no swarm
    monkeypatch.setattr(sys, "argv", ["swarm", *line.split()])
    with pytest.raises(SystemExit) as ended:
        cli.main()
    printed = capsys.readouterr()
    code = ended.value.code
    assert isinstance(code, int)
    return subprocess.CompletedProcess(line, code, printed.out, printed.err)


def belonging(folder: Path) -> list[psutil.Process]:
    """Live processes of the runs started in `folder`, the supervisor included."""
    found = []
    for process in psutil.process_iter():
        try:
            if process.status() != psutil.STATUS_ZOMBIE and process.cwd() == str(folder):
                found.append(process)
        except psutil.Error:
            continue
    return found


def named(folder: Path, *prefixes: str) -> list[psutil.Process]:
    """Those of them whose name begins with one of the prefixes."""
    found = []
    for process in belonging(folder):
        try:
            if process.name().startswith(prefixes):
                found.append(process)
        except psutil.Error:
            continue
    return found


def until(condition: Callable[[], object], timeout_s: float, what: str) -> None:
    """Poll a condition with a deadline."""
    deadline_s = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline_s, f"not within {timeout_s:g} s: {what}"
        time.sleep(0.01)


def end_all(folder: Path) -> None:
    """Leave nothing behind, whatever a test did."""
    for process in belonging(folder):
        try:
            process.kill()
        except psutil.Error:
            continue
