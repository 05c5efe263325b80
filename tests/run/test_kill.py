"""Real processes killed at random moments: nothing is left, and what was recorded can be read."""

from __future__ import annotations

import random
import signal
import subprocess
import time
from pathlib import Path

import msgspec
import psutil
import pytest

import tests.run.processes as processes
from swarm import errors, messages, recording, runs, zenoh_bus

RATE = 8.0  # x real time, so that a run lasts about 5 s
DT_S = 0.08
FLUSH_S = 0.5  # wall


def tick_now(folder: Path) -> int | None:
    """Tick at which the run in `folder` is, None while it has not begun."""
    for card in runs.running():
        if Path(card.folder).parent == folder:
            try:
                bus = zenoh_bus.open_client(
                    card.run, card.endpoint, name="supervisor", connect_timeout_s=1.0
                )
            except errors.BusError:
                return None
            try:
                reply = bus.ask(messages.CONTROL, messages.ControlRequest("status"), 1.0)
                status = msgspec.msgpack.decode(reply.body, type=messages.Status)
                return status.tick if status.state == "running" else None
            except errors.BusError:
                return None
            finally:
                bus.close()
    return None


def strike(folder: Path, run: subprocess.Popen[str], what: str, choice: random.Random) -> None:
    if what == "supervisor":
        run.kill()
    elif what in ("SIGINT", "SIGTERM"):
        run.send_signal(signal.Signals[what])
    else:
        prefixes = ("swarm-world",) if what == "world" else ("swarm-leader", "swarm-robot")
        victims: list[psutil.Process] = []
        processes.until(
            lambda: (
                victims.extend(processes.named(folder, *prefixes))
                or victims
                or run.poll() is not None
            ),
            30.0,
            "a victim",
        )
        if victims:
            choice.choice(sorted(victims, key=lambda one: one.pid)).kill()


def check_recording(out: Path, tick_before: int | None) -> None:
    """All but the last simulated second, or half a second of wall time, can be read."""
    path = out / runs.MCAP
    if not path.exists():
        assert tick_before is None, "a run that ticks has a recording"
        return
    if not recording.verify(path).ok:
        recording.repair(path)
    verdict = recording.verify(path)
    assert verdict.complete, verdict
    assert verdict.ok or verdict.last_tick is None, verdict
    last = max((record.tick for record in recording.read(path).ticks), default=-1)
    if tick_before is not None:
        lost_ticks = max(1.0, FLUSH_S * RATE) / DT_S + 1
        assert last >= tick_before - lost_ticks


@pytest.mark.parametrize("what", ["supervisor", "world", "robot", "SIGINT", "SIGTERM"])
def test_nothing_is_left_and_the_recording_reads_when_killed(
    folder: Path, what: str, kill: int
) -> None:
    choice = random.Random(f"{what}-{kill}")
    run = processes.start(
        folder,
        "run",
        "two-obstacles",
        "--rate",
        str(RATE),
        "--duration",
        "36",
        "--out",
        "out",
        "--set",
        "restart.world=never",
        "-q",
    )  # without a leader it would last until the scenario's time is up
    delay_s = choice.uniform(0.1, 5.0)
    deadline_s = time.monotonic() + delay_s
    processes.until(
        lambda: time.monotonic() >= deadline_s or run.poll() is not None, 10.0, "the moment"
    )
    tick_before = tick_now(folder)
    strike(folder, run, what, choice)
    if what == "robot":  # the others go on; then the run ends by itself
        _, said = run.communicate(timeout=60.0)
        assert run.returncode in (0, 1), said
    else:
        struck_s = time.monotonic()
        run.communicate(timeout=10.0)
        processes.until(lambda: not processes.belonging(folder), 5.0, f"all end after {what}")
        assert time.monotonic() - struck_s < 5.5
        if what in ("SIGINT", "SIGTERM"):
            assert run.returncode in (130, 0, -signal.Signals[what], 1)
    processes.until(lambda: not processes.belonging(folder), 5.0, "all end")
    check_recording(folder / "out", tick_before)


def test_ctrl_c_is_130_and_completes_the_recording(folder: Path) -> None:
    run = processes.start(folder, "run", "two-obstacles", "--rate", str(RATE), "--out", "out")
    processes.until(lambda: (tick_now(folder) or 0) > 20, 30.0, "ticks")
    run.send_signal(signal.SIGINT)
    _, said = run.communicate(timeout=10.0)
    assert run.returncode == 130, said
    verdict = recording.verify(folder / "out" / runs.MCAP)
    assert verdict.ok
    assert verdict.complete
    assert (folder / "out" / runs.SUMMARY).exists()
    assert processes.belonging(folder) == []


def test_world_killed_is_exit_1_and_says_how_to_mend_the_recording(folder: Path) -> None:
    never = ("--set", "restart.world=never")
    line = ("run", "two-obstacles", "--rate", str(RATE), "--out", "out", *never)
    run = processes.start(folder, *line)
    processes.until(lambda: (tick_now(folder) or 0) > 20, 30.0, "ticks")
    processes.named(folder, "swarm-world")[0].kill()
    _, said = run.communicate(timeout=10.0)
    assert run.returncode == 1
    assert "world killed by SIGKILL" in said
    assert "swarm verify" in said
    assert "--repair" in said


def kill_world_at(folder: Path, tick: int) -> None:
    """Once the run is there; the world that is there then."""
    processes.until(lambda: (tick_now(folder) or 0) >= tick, 30.0, f"tick {tick}")
    processes.until(lambda: processes.named(folder, "swarm-world"), 10.0, "a world")
    processes.named(folder, "swarm-world")[0].kill()


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> str:
    """State hash of two-obstacles when nothing is killed."""
    line = ("run", "two-obstacles", "--bus", "memory", "--json", "-q", "--out", "alone")
    alone = processes.swarm(tmp_path_factory.mktemp("undisturbed"), *line)
    return str(msgspec.json.decode(alone.stdout)["state_hash"])


def check_world_is_replaced(folder: Path, tick: int, undisturbed: str, *options: str) -> None:
    line = ("run", "two-obstacles", "--rate", str(RATE), "--out", "out", "--json", *options)
    run = processes.start(folder, *line)
    kill_world_at(folder, tick)
    printed, said = run.communicate(timeout=60.0)
    assert run.returncode == 0, said
    assert "world killed by SIGKILL" in said
    assert "world is started again" in said
    summary = msgspec.json.decode(printed)
    assert summary["world_restarts"] == 1
    assert summary["state_hash"] == undisturbed
    verdict = recording.verify(folder / "out" / runs.MCAP)
    assert verdict.ok, verdict
    assert processes.belonging(folder) == []


def test_world_killed_by_hand_is_started_again_and_the_run_is_as_if_nothing_had_been(
    folder: Path, undisturbed: str, kill: int
) -> None:
    tick = random.Random(f"world-again-{kill}").randrange(1, 400)
    check_world_is_replaced(folder, tick, undisturbed)


def test_world_killed_beside_an_external_router_is_started_again(
    folder: Path, endpoint: str, undisturbed: str
) -> None:
    router = zenoh_bus.open_router("router", endpoint)
    try:
        check_world_is_replaced(folder, 100, undisturbed, "--router", endpoint)
    finally:
        router.close()


def test_world_that_is_killed_again_and_again_is_given_up(folder: Path) -> None:
    once = ("--set", "restart.restart_max=1", "--set", "restart.restart_delay_s=0")
    line = ("run", "two-obstacles", "--rate", str(RATE), "--out", "out", *once)
    run = processes.start(folder, *line)
    kill_world_at(folder, 20)
    kill_world_at(folder, 60)
    _, said = run.communicate(timeout=30.0)
    assert run.returncode == 1
    assert "was started again 1 times within 60 s: no more" in said
    assert "swarm verify" in said
    check_recording(folder / "out", 20)
    assert processes.belonging(folder) == []


def test_world_that_stays_stopped_is_taken_for_hung_and_replaced(folder: Path) -> None:
    soon = ("--set", "restart.hang_timeout_s=0.1")  # five times this
    line = ("run", "two-obstacles", "--rate", "2", "--out", "out", *soon)
    run = processes.start(folder, *line)
    processes.until(lambda: (tick_now(folder) or 0) > 5, 30.0, "ticks")
    (world,) = processes.named(folder, "swarm-world")
    world.suspend()
    processes.until(lambda: (tick_now(folder) or 0) > 20, 30.0, "ticks of another world")
    assert processes.named(folder, "swarm-world")[0].pid != world.pid
    run.send_signal(signal.SIGINT)
    _, said = run.communicate(timeout=10.0)
    assert run.returncode == 130, said
    assert "world has been stopped for 0.5 s: killed" in said


def test_second_ctrl_c_ends_everyone_at_once(folder: Path) -> None:
    run = processes.start(folder, "run", "two-obstacles", "--rate", "2", "--out", "out", "-q")
    processes.until(lambda: (tick_now(folder) or 0) > 5, 30.0, "ticks")
    processes.named(folder, "swarm-robot3")[0].suspend()  # holds up the tick, and so a good end
    run.send_signal(signal.SIGINT)
    run.send_signal(signal.SIGTERM)
    _, said = run.communicate(timeout=10.0)
    assert run.returncode == 130
    assert "did not stop when asked" in said
    assert processes.belonging(folder) == []


def test_robot_killed_by_hand_does_not_stop_the_others(folder: Path) -> None:
    run = processes.start(
        folder, "run", "head-on-pairs", "--rate", str(RATE), "--out", "out", "--json"
    )
    processes.until(lambda: (tick_now(folder) or 0) > 20, 30.0, "ticks")
    processes.named(folder, "swarm-robot6")[0].kill()
    printed, said = run.communicate(timeout=60.0)
    assert run.returncode == 1, said
    summary = msgspec.json.decode(printed)
    outcomes = {row["name"]: row["outcome"] for row in summary["per_robot"]}
    assert outcomes.pop("robot6") == "failed"
    assert set(outcomes.values()) == {"arrived"}
    assert "robot-lost robot6" in said


def test_process_names_are_where_pgrep_looks(folder: Path) -> None:
    run = processes.start(folder, "run", "two-obstacles", "--rate", "4", "--out", "out", "-q")
    wanted = ("swarm-world", "swarm-leader", "swarm-robot")
    processes.until(lambda: len(processes.named(folder, *wanted)) == 7, 30.0, "7 processes")
    assert processes.named(folder, "swarm-run")
    run.send_signal(signal.SIGTERM)
    run.communicate(timeout=10.0)
    assert processes.belonging(folder) == []


def test_paused_supervisor_pauses_the_run(folder: Path) -> None:
    run = processes.start(folder, "run", "two-obstacles", "--rate", "2", "--out", "out", "-q")
    processes.until(lambda: (tick_now(folder) or 0) > 5, 30.0, "ticks")
    psutil.Process(run.pid).suspend()
    ticks: list[int | None] = []

    def still() -> bool:
        ticks.append(tick_now(folder))
        return len(ticks) > 5 and ticks[-5] == ticks[-1] is not None

    processes.until(still, 10.0, "the same tick five times")
    psutil.Process(run.pid).resume()
    stood = ticks[-1] or 0
    processes.until(lambda: (tick_now(folder) or 0) > stood, 10.0, "ticks go on")
    run.send_signal(signal.SIGINT)
    run.communicate(timeout=10.0)
    assert run.returncode == 130


@pytest.mark.parametrize("stall_s", [0.7, 2.0])
def test_world_that_was_stopped_for_a_while_loses_nobody(folder: Path, stall_s: float) -> None:
    line = ("run", "head-on-pairs", "--json", "-q")
    alone = processes.swarm(folder, *line, "--bus", "memory", "--out", "alone")
    run = processes.start(folder, *line, "--rate", str(RATE), "--out", "out")
    processes.until(lambda: (tick_now(folder) or 0) > 20, 30.0, "ticks")
    (world,) = processes.named(folder, "swarm-world")
    world.suspend()
    deadline_s = time.monotonic() + stall_s
    processes.until(lambda: time.monotonic() >= deadline_s, 10.0, "the stall")
    world.resume()
    printed, said = run.communicate(timeout=60.0)
    assert run.returncode == 0, said
    expected = msgspec.json.decode(alone.stdout)["state_hash"]
    assert msgspec.json.decode(printed)["state_hash"] == expected


@pytest.mark.parametrize("name", ["swarm-world", "swarm-robot3"])
def test_stopped_child_ends_with_its_supervisor(folder: Path, name: str) -> None:
    run = processes.start(folder, "run", "two-obstacles", "--rate", "2", "--out", "out", "-q")
    processes.until(lambda: (tick_now(folder) or 0) > 5, 30.0, "ticks")
    processes.named(folder, name)[0].suspend()
    run.kill()
    run.communicate()
    processes.until(lambda: not processes.belonging(folder), 5.0, "all end")
