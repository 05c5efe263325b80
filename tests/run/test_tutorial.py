"""The README's tutorial: every command of it, in a clone of its own, as it stands there."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.run import processes

ROOT = Path(__file__).parents[2]
README = ROOT / "README.md"
FENCE = re.compile(r"^```(?P<info>[^\n`]+)\n(?P<body>.*?)^```$", re.MULTILINE | re.DOTALL)
EXITS = re.compile(r"# exits with (\d)")
PACKAGES = ("swarm", "agents", "world", "dashboards")


def blocks(kind: str) -> list[str]:
    """Bodies of the README's fences of a kind."""
    return [match["body"] for match in FENCE.finditer(README.read_text()) if match["info"] == kind]


def lines(kind: str) -> list[str]:
    found = [line for body in blocks(kind) for line in body.splitlines() if line]
    assert found, kind
    return found


@pytest.fixture
def clone(folder: Path) -> Path:
    """The source in a folder of its own, with a `.venv/bin/swarm` that runs it."""
    for package in PACKAGES:
        shutil.copytree(ROOT / package, folder / package)
    (folder / "pyproject.toml").write_text("")
    swarm = folder / ".venv" / "bin" / "swarm"
    swarm.parent.mkdir(parents=True)
    swarm.write_text(
        f'#!/bin/sh\nPYTHONPATH={folder} exec {sys.executable} -m swarm.run.start "$@"\n'
    )
    swarm.chmod(0o755)
    subprocess.run(  # as `make setup` does last
        [sys.executable, "-c", "from agents.navigator import warm; warm.up()"],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(folder)},
        check=True,
        timeout=240.0,
    )
    for match in FENCE.finditer(README.read_text()):
        if match["info"].startswith("python "):
            (folder / match["info"].split()[1]).write_text(match["body"])
    return folder


def carried_out(clone: Path, line: str) -> str:
    """Run one line of the tutorial; what it printed."""
    done = subprocess.run(
        ["bash", "-c", line], cwd=clone, capture_output=True, text=True, check=False, timeout=120.0
    )
    expected = int(match[1]) if (match := EXITS.search(line)) else 0
    assert done.returncode == expected, (line, done.stdout, done.stderr)
    assert "Traceback" not in done.stderr
    return done.stdout + done.stderr


@pytest.mark.timeout(480)  # of a busy machine; 45 s of an idle one
def test_tutorial_works_line_by_line_on_a_fresh_clone(clone: Path) -> None:
    printed = {
        line.split("  #")[0].strip(): carried_out(clone, line) for line in lines("sh tutorial")
    }
    assert (clone / "agents" / "controllers" / "gap.py").exists()
    where = {path.name for path in (clone / "runs").iterdir()}
    assert where == {"first", "crossing", "gap", "built-in", "broken"}
    assert "equal" in printed[".venv/bin/swarm replay runs/gap"]
    assert (clone / "runs" / "gap" / "report.html").stat().st_size > 10_000
    swarm_of_clone = subprocess.run(
        [sys.executable, "-c", "import swarm; print(swarm.__file__)"],
        cwd=clone,
        env={**os.environ, "PYTHONPATH": str(clone)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert swarm_of_clone.stdout.startswith(str(clone))


@pytest.mark.timeout(480)
def test_commands_for_a_running_swarm_work_in_their_order(clone: Path) -> None:
    command = [str(clone / ".venv" / "bin" / "swarm"), "run", "two-obstacles", "--rate", "1", "-q"]
    run = subprocess.Popen(command, cwd=clone, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    status = [command[0], "status"]
    processes.until(
        lambda: subprocess.run(status, cwd=clone, capture_output=True, check=False).returncode == 0,
        60.0,
        "a swarm that answers",
    )
    for line in lines("sh tutorial while-running"):
        carried_out(clone, line)
    assert run.wait(10.0) == 1  # it was stopped
