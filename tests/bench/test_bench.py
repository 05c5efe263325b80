"""The benchmarks run, say all they should, judge budgets rightly and leave nothing behind.

No figure has a limit here: the machine that runs the tests is busy with them.
"""

from __future__ import annotations

import math
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import msgspec
import psutil
import pytest

import tests.run.processes as commands
from swarm import errors, metrics
from swarm.run import bench, lockstep
from swarm.run.bench import figures, processes, rehearsal

END_S = 30.0  # for things to be gone; the product's own limit is well below

BARRIER = (
    *("bare", "whole", "whole, recorded", "whole, growth"),
    *("whole less own", "whole less own alone", "own"),
)
PARTS = ("step", "sense", "move", "record", "metrics", "encode", "decode")
ROLES = ("leader", "follower FORM", "follower AVOID", "alone")
ROWS = {
    *(f"barrier: {what}" for what in BARRIER),
    *(f"barrier: {part} alone" for part in PARTS),
    *(
        f"step: {role}, {controller}{longest}"
        for role in ROLES
        for controller in ("paper", "navigator")
        for longest in ("", ", longest")
    ),
    "step: with 20 neighbours, navigator",
    "step: with 20 neighbours, navigator, longest",
    *("memory: real time", "memory: ticks"),
    *("telemetry: tick in memory", "telemetry: tick as processes"),
    *("telemetry: of it MCAP", "telemetry: of it Rerun"),
    *(
        f"watched: viewer {kind}, {what}"
        for kind in ("stopped", "killed")
        for what in ("cpu", "wall")
    ),
    "watched: memory of the world, more",
    *("world: moving", "world: sensing", "world: both"),
    *("launch: first tick", "launch: memory of a robot"),
}


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    yield tmp_path
    commands.end_all(tmp_path)


# --- all of it, in the smallest size ------------------------------------------------------------


def test_bench_has_every_row_finite_and_positive_when_tiny(folder: Path) -> None:
    result = commands.swarm(folder, "bench", "--tiny", "--json")
    assert result.returncode == 0, result.stderr
    found = msgspec.json.decode(result.stdout, type=figures.Found, strict=True)
    assert {row.name for row in found.rows} == ROWS
    assert len(found.rows) == len(ROWS)
    for row in found.rows:
        numbers = [row.figure, row.smallest, row.largest]
        numbers += [number for number in (row.floor, row.ratio, row.budget) if number is not None]
        grows = row.name == "watched: memory of the world, more"  # it need not, in a moment
        assert all(math.isfinite(number) and number >= 0.0 for number in numbers), row
        assert grows or all(number > 0.0 for number in numbers), row
        assert row.size >= 1
        assert row.ok
        assert (row.floor is None) == (row.ratio is None) == (row.over == "")
        assert (row.budget is None) == (row.bound is None)
    assert found.tiny
    assert found.machine.cores >= 1
    assert 0.0 < found.machine.calibration_s < 60.0
    assert set(found.versions) == set(figures.VERSIONS)
    assert commands.belonging(folder) == []


def test_bench_names_the_known_ones_when_one_is_unknown() -> None:
    with pytest.raises(errors.UsageError, match=r"barrier, step, .* got 'stepp'; .* 'step'\?"):
        bench.run(["stepp"], tiny=True, progress=print)


def test_bench_exits_1_only_when_a_budget_is_broken_and_not_tiny(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    def broken(*, tiny: bool, progress: bench.Progress) -> tuple[figures.Row, ...]:
        return (figures.at_most("step: slow", 6, [200.0], "us", 100.0),)

    monkeypatch.setattr(bench, "benchmarks", lambda: {"step": broken})
    full = commands.here(monkeypatch, capsys, tmp_path, "bench step")
    assert full.returncode == 1
    assert "figure <= 100 BROKEN" in full.stdout
    tiny = commands.here(monkeypatch, capsys, tmp_path, "bench step --tiny")
    assert tiny.returncode == 0
    assert "BROKEN" not in tiny.stdout


def test_what_children_load_is_free_of_viewers() -> None:
    names = ", ".join(processes.PRELOAD)
    code = f"import sys, {names}; print({{'rerun', 'rich'}} & set(sys.modules))"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (result.stdout.strip(), result.returncode) == ("set()", 0), result.stderr


# --- figures ------------------------------------------------------------------------------------


def test_row_takes_medians_and_the_median_of_the_rounds_own_ratios() -> None:
    row = figures.row("x", 2, [30.0, 10.0, 26.0], "us", floors=[10.0, 10.0, 2.0], over="floor")
    assert (row.figure, row.smallest, row.largest, row.rounds) == (26.0, 10.0, 30.0, 3)
    assert (row.floor, row.ratio) == (10.0, 3.0)  # of 3, 1 and 13, not 26 / 10
    assert row.ok


@pytest.mark.parametrize(
    ("values", "floors", "budget", "bound", "ok"),
    [
        ([90.0, 150.0], [], 100.0, "figure <=", True),  # the best round counts
        ([101.0, 150.0], [], 100.0, "figure <=", False),
        ([61.0, 20.0], [], 60.0, "figure >=", True),
        ([59.0, 20.0], [], 60.0, "figure >=", False),
        ([32.0, 30.0, 90.0], [20.0, 20.0, 20.0], 1.6, "ratio <=", True),  # the median counts
        ([33.0, 30.0, 90.0], [20.0, 20.0, 20.0], 1.6, "ratio <=", False),
    ],
)
def test_row_is_ok_when_it_keeps_its_budget(
    values: list[float], floors: list[float], budget: float, bound: figures.Bound, ok: bool
) -> None:
    assert figures.row("x", 6, values, "us", floors=floors, budget=budget, bound=bound).ok is ok


# --- rehearsal ----------------------------------------------------------------------------------


def test_rehearsal_is_the_run_that_the_shells_make() -> None:
    plan = rehearsal.built_in("two-obstacles", settings=["duration_s=2.0"])
    seen = rehearsal.rehearse(plan, ticks_max=1000)
    score = metrics.begin(plan)
    for moment in seen.moments:
        metrics.observe(score, moment.record)
    assert score.hash.hexdigest() == lockstep.run(plan).score.hash.hexdigest()


def test_best_s_is_each_jobs_own_best_of_all_passes() -> None:
    rounds = {"short": iter([0.03, 0.01]), "long": iter([0.02, 0.04])}

    def burn(name: str) -> None:
        end_s = time.thread_time() + next(rounds[name])
        while time.thread_time() < end_s:
            pass

    best = rehearsal.best_s([lambda: burn("short"), lambda: burn("long")], passes=2)
    assert best == pytest.approx([0.01, 0.02], abs=0.005)


# --- processes ----------------------------------------------------------------------------------


def test_cpu_is_that_of_the_process_clock() -> None:
    begin_s, begin_clock_s = processes.cpu_s([os.getpid()]), time.process_time()
    while time.process_time() < begin_clock_s + 0.1:
        pass
    spent_s = processes.cpu_s([os.getpid()]) - begin_s
    assert spent_s == pytest.approx(time.process_time() - begin_clock_s, abs=0.03)


def test_meter_sends_windows_that_begin_after_settling(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = 0.0
    monkeypatch.setattr(processes, "cpu_s", lambda pids: 3.0 * now_s)
    near, far = multiprocessing.Pipe()
    near.send_bytes(msgspec.msgpack.encode([11, 12, 13]))
    meter = processes.Meter(
        far, windows=2, window_s=1.0, settle_s=0.5, own=lambda: 2.0 * now_s, now=lambda: now_s
    )
    numbers = []
    for tick in range(40):  # 0.25 s a tick; the 20th is the first that counts
        numbers.append(meter.number)
        done = meter.look(tick)
        now_s += 0.25
        if done:
            break
    # settle 20 to 22, window 22 to 26, settle to 28, window to 32
    assert tick == 32
    assert [numbers.index(number) for number in (0, 1)] == [0, 27]
    window = processes.Window(robots=2, ticks=4, cpu_s=3.0, own_s=2.0, wall_s=1.0)
    windows = msgspec.msgpack.decode(near.recv_bytes(), type=tuple[processes.Window, ...])
    assert windows == (window,) * 2
    assert (window.cpu_us, window.own_us) == (375_000.0, 250_000.0)  # of 2 robots, 4 ticks


def ignore_and_wait(log: Path, words: str) -> None:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    log.write_text(words)
    signal.pause()


def say_and_end(log: Path, words: str) -> None:
    log.write_text(words)
    raise SystemExit(7)


def test_children_are_gone_when_the_body_is_interrupted() -> None:
    pids: list[int | None] = []
    folders: list[Path] = []

    def measure() -> None:
        with processes.Children() as children:
            log = children.log("deaf")
            children.start("deaf", ignore_and_wait, log, "listening")
            commands.until(lambda: log.exists() and log.read_text(), END_S, "the child is up")
            pids.extend(child.pid for child in multiprocessing.active_children())
            folders.append(children.folder)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        measure()
    assert pids
    assert not any(psutil.pid_exists(pid) for pid in pids if pid is not None)
    assert not folders[0].exists()


def test_windows_says_who_ended_and_its_last_words() -> None:
    with processes.Children() as children:
        children.start("robot3", say_and_end, children.log("robot3"), "one\nno router\n")
        with pytest.raises(errors.SwarmError, match=r"robot3 .* exit code 7: no router"):
            children.windows()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_bench_leaves_no_process_when_it_is_ended(
    folder: Path, number: signal.Signals, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TMPDIR", str(folder))  # a killed one cannot remove its folder
    process = commands.start(folder, "bench", "barrier")
    commands.until(lambda: len(commands.named(folder, "swarm-robot")) == 6, END_S, "six robots")
    process.send_signal(number)
    _, said = process.communicate(timeout=END_S)
    commands.until(lambda: not commands.belonging(folder), END_S, "all processes are gone")
    if number == signal.SIGINT:
        assert process.returncode == 130
        assert "Traceback" not in said
