"""A full disk stops no run: it is said once, and ends with exit 1 and the range that is missing."""

from __future__ import annotations

import contextlib
import json
import resource
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from swarm import recording, runs, scenario
from swarm.run import library, lockstep
from tests.run import processes

LINE = ("run", "empty", "--robots", "6", "--duration", "8", "--json", "-q")


def state_hash() -> str:
    _, where, data = library.read_scenario("empty")
    plan = scenario.decode(data, where, robots=6, duration_s=8.0)
    return lockstep.run(plan).score.hash.hexdigest()


@pytest.fixture
def small_disk(folder: Path) -> Iterator[Callable[[int], Path]]:
    """A file system of so many kB, for who may mount one."""
    place = folder / "disk"
    place.mkdir()

    def mount(size_kb: int) -> Path:
        line = ["mount", "-t", "tmpfs", "-o", f"size={size_kb}k", "tmpfs", str(place)]
        try:
            done = subprocess.run(line, capture_output=True, check=False)
        except FileNotFoundError:
            pytest.skip("there is no mount here")
        if done.returncode != 0:
            pytest.skip(f"cannot mount a small disk: {done.stderr.decode().strip()[:200]}")
        return place

    yield mount
    processes.end_all(folder)
    subprocess.run(["umount", str(place)], capture_output=True, check=False)


def test_run_goes_on_and_names_the_ticks_that_a_full_disk_cost(
    folder: Path,
    small_disk: Callable[[int], Path],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    disk = small_disk(152)
    done = processes.swarm(folder, *LINE, "--set", "recording.rerun=false", "--out", "disk/run")
    assert done.returncode == 1
    assert "Traceback" not in done.stderr
    summary = json.loads(done.stdout)
    assert summary["ticks"] == 100
    assert summary["state_hash"] == state_hash()
    verdict = recording.verify(disk / "run")
    last = verdict.last_tick
    assert last is not None
    assert 0 < last < 99
    assert not verdict.complete
    assert summary["recording"]["lost"] > 0
    assert f"messages lost, of ticks {last + 1}..100; see swarm verify" in done.stderr
    log = (disk / "run" / runs.LOGS / "world.log").read_text()
    assert log.count("No space left on device; still trying") == 1
    assert f"lost ticks {last + 1}..100" in log
    with contextlib.suppress(OSError):
        (disk / "filler").write_bytes(bytes(1 << 20))
    done = processes.here(monkeypatch, capsys, folder, "verify disk/run --repair")
    assert done.returncode == 1
    assert "expected to write the repaired file, got: No space left on device" in done.stderr
    shutil.copytree(disk / "run", folder / "copy")
    for repair in ("", " --repair", ""):  # good afterwards, but the end is still not there
        done = processes.here(monkeypatch, capsys, folder, f"verify copy{repair}")
        assert done.returncode == 1
        assert f"  lost ticks: {last + 1}..100" in done.stdout.splitlines()


def test_run_goes_on_when_not_even_its_logs_find_room(
    folder: Path, small_disk: Callable[[int], Path]
) -> None:
    small_disk(88)
    done = processes.swarm(folder, *LINE, "--out", "disk/run")
    assert done.returncode == 1
    summary = json.loads(done.stdout)
    assert (summary["ticks"], summary["state_hash"]) == (100, state_hash())
    assert summary["recording"]["written"] == 0
    assert "messages lost, of ticks 0..100" in done.stderr


def test_run_says_that_there_was_no_room_for_its_summary(
    folder: Path, small_disk: Callable[[int], Path]
) -> None:
    small_disk(24)
    done = processes.swarm(folder, *LINE, "--out", "disk/run")
    assert done.returncode == 1
    assert "expected the world's summary, got none: is the disk full?" in done.stderr
    assert json.loads(done.stdout)["outcome"] == "failed"


def test_files_that_may_not_grow_end_in_exit_1_and_one_object(folder: Path) -> None:
    run = subprocess.run(
        [*processes.SWARM, *LINE, "--out", "out"],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (70_000, 70_000)),
    )
    assert run.returncode == 1
    summary = json.loads(run.stdout)
    assert summary["outcome"] == "succeeded"
    assert summary["recording"]["lost"] > 0
    assert f"..{summary['ticks']}; see swarm verify" in run.stderr
    assert "Traceback" not in run.stderr


def test_log_on_a_full_disk_does_not_end_its_process() -> None:
    code = (
        "import sys; from pathlib import Path; from swarm import lifetime\n"
        "lifetime.adopt('x', Path('/dev/full'), lifetime.Stop(), None)\n"
        "print('lost', flush=True); print('lost', file=sys.stderr, flush=True); sys.exit(3)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 3
