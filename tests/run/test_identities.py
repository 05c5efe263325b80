"""The three identities, on real processes.

    same scenario and seed twice  =  the same bytes
    N processes over Zenoh        =  the same swarm in memory
    replay of a recording         =  what was recorded

Repeat by hand:  swarm run SCENARIO --json;  the same with --bus memory;  swarm replay RUN
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from swarm import recording, scenario
from swarm.run import library, lockstep, replay
from swarm.score import Score
from tests.run import processes


@pytest.fixture
def burning() -> Iterator[None]:
    """Two processes that take all the time of both cores they can get."""
    burners = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(2)]
    yield
    for burner in burners:
        burner.kill()
        burner.wait()


def run(folder: Path, name: str, out: str, *arguments: str, succeeds: bool = True) -> str:
    done = processes.swarm(folder, "run", name, "--out", out, "--json", "-q", *arguments)
    assert done.returncode == 0 or not succeeds, done.stderr
    return str(json.loads(done.stdout)["state_hash"])


@pytest.mark.usefixtures("burning")
def test_identities_hold_while_others_burn_the_cores(folder: Path) -> None:
    check_identities(folder, "two-obstacles")


def test_identities_hold_among_random_obstacles(folder: Path) -> None:
    check_identities(folder, "random-field")


DISTURBANCE = (
    *("range_sigma_m=0.01", "position_sigma_m=0.005", "yaw_sigma_rad=0.005"),
    *("latency_ticks=1", "speed_error=0.02", "loss_probability=0.2", "loss_ticks_max=5"),
)


def test_identities_hold_under_declared_disturbances(folder: Path) -> None:
    settings = [part for text in DISTURBANCE for part in ("--set", f"disturbance.{text}")]
    check_identities(folder, "two-obstacles", "--duration", "8", *settings, succeeds=False)


def test_identities_hold_among_obstacles_that_move(folder: Path) -> None:
    moving = ("obstacles.0.path=[[7.0, 9.0]]", "obstacles.0.speed_mps=0.3")
    settings = [part for text in moving for part in ("--set", text)]
    check_identities(folder, "two-obstacles", "--duration", "8", *settings, succeeds=False)


def check_identities(folder: Path, name: str, *arguments: str, succeeds: bool = True) -> None:
    first = run(folder, name, "first", *arguments, succeeds=succeeds)
    assert run(folder, name, "second", *arguments, succeeds=succeeds) == first
    memory = run(folder, name, "memory", "--bus", "memory", *arguments, succeeds=succeeds)
    assert memory == first
    for out in ("first", "memory"):
        found = replay.replay(folder / out / "run.mcap")
        assert found.ok
        assert found.difference is None
        assert found.state_hash == found.recorded_hash == first


def short(seed: int = 1, *settings: str) -> Score:
    _, where, data = library.read_scenario("two-obstacles")
    plan = scenario.decode(data, where, seed=seed, duration_s=4.0, settings=settings)
    return lockstep.run(plan).score


def test_state_hash_tells_runs_apart_but_not_their_names() -> None:
    first = short().hash.hexdigest()
    assert short().hash.hexdigest() == first
    assert short(1, "field.k_r=29.0").hash.hexdigest() != first
    assert short(1, "title='another'", "recording.flush_ticks=1").hash.hexdigest() == first


def test_replay_of_one_robot_and_of_a_changed_recording(folder: Path) -> None:
    done = processes.swarm(
        folder, "run", "two-obstacles", "--duration", "4", "--bus", "memory", "--out", "run", "-q"
    )
    assert done.returncode == 1  # a timeout
    path = folder / "run" / "run.mcap"
    assert replay.replay(path, "robot2").ok
    source = recording.read(path)
    ticks = list(source.ticks)
    wrong = ticks[30].commands[2]
    faster = msgspec.structs.replace(wrong.set_point, speed_mps=wrong.set_point.speed_mps + 1e-12)
    commands = list(ticks[30].commands)
    commands[2] = msgspec.structs.replace(wrong, set_point=faster)
    ticks[30] = msgspec.structs.replace(ticks[30], commands=tuple(commands))
    with recording.Writer(folder / "changed.mcap", source.scenario_toml, source.metadata) as writer:
        for record in ticks:
            writer.write(record)
    found = replay.replay(folder / "changed.mcap")
    assert not found.ok
    assert found.difference is not None
    assert found.difference.tick == 30
    assert found.difference.robot == wrong.robot
    assert found.difference.field == "command.set_point.speed_mps"


def test_replay_holds_when_commands_come_too_late_to_count(folder: Path) -> None:
    done = processes.swarm(
        *(folder, "run", "two-obstacles", "--duration", "6", "--bus", "memory", "--out", "run"),
        *("-q", "--json", "--fault", "slow:robot2@1.6+3.2,late_s=0.4"),  # 5 ticks: braked after 3
        *("--fault", "slow:robot3@1.6,late_s=0.4", "--fault", "kill:robot3@3.2"),
        *("--fault", "duplicate:all@0,probability=0.5", "--fault", "delay:robot4@1.6+1.6"),
    )
    summary = json.loads(done.stdout)
    assert summary["per_robot"][2]["path_m"] < 0.8 * summary["per_robot"][1]["path_m"]
    found = replay.replay(folder / "run" / "run.mcap")
    assert found.ok
    assert found.state_hash == found.recorded_hash == summary["state_hash"]


def test_replay_stops_at_a_hole_and_says_where(folder: Path) -> None:
    processes.swarm(
        folder, "run", "two-obstacles", "--duration", "4", "--bus", "memory", "--out", "run", "-q"
    )
    source = recording.read(folder / "run" / "run.mcap")
    ticks = list(source.ticks)
    with recording.Writer(folder / "hole.mcap", source.scenario_toml, source.metadata) as writer:
        for record in (*ticks[:20], *ticks[24:]):
            writer.write(record)
    found = replay.replay(folder / "hole.mcap")
    assert not found.ok
    assert found.ticks == 20
    assert found.missing is not None
    assert "expected tick 20, got 24" in found.missing
