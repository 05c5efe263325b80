"""Campaigns: nothing found where all is well, planted bugs found and made small, nobody left."""

from __future__ import annotations

import json
import os
import shlex
import signal
from pathlib import Path

import msgspec
import pytest

from agents import election, guard, steering
from swarm import errors, faults, scenario
from swarm.geometry import Twist
from swarm.run.chaos import campaign, memory, schedules, shrink
from swarm.run.chaos.campaign import Campaign, Order
from swarm.run.chaos.watch import Findings, Violation
from swarm.scenario import RobotSetup, Scenario
from tests.run import processes

# three robots one behind the other, near enough to need their guards when one stops at once
ROW = b"""
title = "Three in a row"
seed = 1
dt_s = 0.08
duration_s = 30.0
robot.cruise_speed_mps = 0.9
[formation]
leader = "robot1"
[[robots]]
name = "robot1"
start = [0.0, 0.0, 0.0]
goal = [5.0, 0.0]
[[robots]]
name = "robot2"
start = [-0.7, 0.0, 0.0]
[[robots]]
name = "robot3"
start = [-1.4, 0.0, 0.0]
"""
END_S = 60.0


def _row() -> Scenario:
    return scenario.decode(ROW, "row.toml")


def _order(**fields: object) -> Order:
    given: dict[str, object] = {"runs": 8, "seed": 1, "workers": 0, "tries_max": 60, **fields}
    return Order(scenario=_row(), given="row.toml", **given)  # type: ignore[arg-type]


def _conduct(order: Order, folder: Path) -> Campaign:
    return campaign.conduct(order, folder, lambda *_: None, lambda _: None)


# --- making small -------------------------------------------------------------------------------


def _has(drawn: shrink.Drawn, kind: type[faults.Fault], name: str) -> bool:
    return any(isinstance(one, kind) and name in one.target.split("/") for one in drawn)


def test_shrink_finds_the_two_faults_that_it_takes() -> None:
    drawn = (
        faults.Noise(target="all", at_s=1.2, for_s=4.0),
        faults.Hang(target="robot1/robot2/robot3", at_s=2.0, for_s=3.44),
        faults.Loss(target="any:0.4", at_s=2.8, for_s=9.04),
        faults.Kill(target="robot2/robot3", at_s=5.36),
        faults.Deaf(target="leader", at_s=6.0, for_s=1.0),
    )
    small = shrink.shrink(
        _row(),
        drawn,
        lambda some: _has(some, faults.Hang, "robot1") and _has(some, faults.Kill, "robot3"),
    )
    least_s = schedules.FIRST_TICK * 0.08  # 13 ticks; half of the time again and again, then
    hang, kill = sorted(small.faults, key=faults.kind_of)
    assert (faults.kind_of(hang), hang.target, hang.for_s) == ("hang", "robot1", 0.08)
    assert (faults.kind_of(kill), kill.target) == ("kill", "robot3")
    assert all(least_s <= one.at_s < 2.0 * least_s for one in small.faults)


def test_shrink_tries_no_more_than_it_may_and_nothing_that_is_not_fair() -> None:
    drawn = tuple(faults.Kill(target=f"robot{row}", at_s=5.0) for row in (1, 2, 3))
    tried: list[shrink.Drawn] = []

    def fails(some: shrink.Drawn) -> bool:
        tried.append(some)
        return True

    small = shrink.shrink(_row(), drawn, fails, fair=lambda some: len(some) > 1, tries_max=4)
    assert small.tries == len(tried) == 4
    assert all(len(some) > 1 for some in tried)
    assert len(small.faults) == 2


def test_shrink_keeps_what_nothing_simpler_shows() -> None:
    drawn = (faults.Kill(target="robot1", at_s=1.04),)
    assert shrink.shrink(_row(), drawn, lambda _: False) == shrink.Shrunk(drawn, 0)


# --- campaigns ----------------------------------------------------------------------------------


def test_nothing_is_found_where_all_is_well(tmp_path: Path) -> None:
    found = _conduct(_order(), tmp_path)
    assert found.ok, found.failures
    assert found.runs == 8
    assert found.violations == {}
    lines = (tmp_path / "schedules.txt").read_text().splitlines()
    assert len(lines) == 8
    assert sum(line.count("--fault ") for line in lines) == sum(found.faults.values())
    assert found.converged_s is not None
    assert found.converged_s.count == 8
    assert found.min_clearance_robot_m is not None


def test_a_guard_that_is_switched_off_is_found_and_shown_by_two_faults_at_most(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def toothless(
        setup: RobotSetup, twist: Twist, asked: Twist, *_: object, **__: object
    ) -> tuple[Twist, guard.Limit]:
        reached = steering.slew(
            setup.robot, twist, asked.speed_mps, asked.turn_rate_radps, setup.dt_s
        )
        return reached, guard.Limit(setup.robot.speed_mps_max, "")

    monkeypatch.setattr(guard, "hold", toothless)
    found = _conduct(_order(runs=12, shrunk_max=1), tmp_path)
    assert not found.ok
    contacts = [one for one in found.failures if one.worst.invariant == "contact"]
    assert contacts
    assert min(one.faults for one in contacts) <= 2
    small = min(contacts, key=lambda one: one.faults)
    assert small.faults <= len(small.schedule)
    assert _breaks(small.command, "contact")


def test_a_leader_that_claims_a_term_again_is_found_and_shown_by_two_faults_at_most(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sound = election.step

    def again(state: election.State, *given: object, **named: object) -> election.State:
        after = sound(state, *given, **named)  # type: ignore[arg-type]
        claim, before = after.leadership, state.leadership
        if after.leads and not state.leads and claim is not None and before is not None:
            claim = msgspec.structs.replace(claim, term=before.term)
            return msgspec.structs.replace(after, leadership=claim)
        return after

    monkeypatch.setattr(election, "step", again)
    found = _conduct(_order(runs=6, shrunk_max=1), tmp_path)
    wrong = [one for one in found.failures if one.worst.invariant in ("falls", "two-leaders")]
    assert wrong
    assert min(one.faults for one in wrong) <= 2
    assert _breaks(wrong[0].command, wrong[0].worst.invariant)


def _breaks(command: str, invariant: str) -> bool:
    """Whether the run that a line asks for breaks an invariant."""
    words = shlex.split(command)
    texts = [words[at + 1] for at, word in enumerate(words) if word == "--fault"]
    drawn = scenario.decode(ROW, "row.toml", faults=texts).faults
    length_s = campaign.undisturbed_s(_row())
    planned = schedules.plan(_row(), length_s, drawn)
    assert words[:3] == ["swarm", "run", "row.toml"]
    assert float(words[words.index("--duration") + 1]) == pytest.approx(planned.duration_s)
    job = memory.Job(_row(), length_s, schedules.Schedule(0, drawn))
    return memory.breaks(job, invariant) is not None


def test_a_run_that_is_not_the_same_twice_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    schedule = schedules.Schedule(0, ())
    rans = [memory.Ran(schedule, Findings(), "a"), memory.Ran(schedule, Findings(), "b")]
    monkeypatch.setattr(memory, "_run", lambda _: rans.pop())
    ran = memory.run(memory.Job(_row(), 10.0, schedule, twice=True))
    assert [one.invariant for one in ran.findings.violations] == ["replay"]


def test_a_scenario_that_fails_by_itself_is_refused() -> None:
    short = msgspec.structs.replace(_row(), duration_s=1.0)
    with pytest.raises(errors.UsageError, match="when nothing disturbs it, got: timeout"):
        campaign.undisturbed_s(short)


def test_spread_takes_percentiles_by_rank() -> None:
    values = [float(value) for value in range(1, 201)]
    assert campaign.spread(values) == campaign.Spread(200, 100.0, 180.0, 198.0, 200.0)
    assert campaign.spread([3.0]) == campaign.Spread(1, 3.0, 3.0, 3.0, 3.0)
    assert campaign.spread([]) is None


def test_the_gravest_violation_is_shown() -> None:
    waits = Violation("waits", 3, (), "")
    contact = Violation("contact", 9, (), "")
    assert campaign.worst((waits, contact)) == contact


# --- the command line ---------------------------------------------------------------------------


@pytest.fixture
def row(folder: Path) -> Path:
    """A folder with the scenario in it."""
    (folder / "row.toml").write_bytes(ROW)
    return folder


def test_chaos_in_memory_prints_one_object_and_keeps_the_schedules(row: Path) -> None:
    line = "chaos row.toml --runs 4 --seed 2 --out found --json"
    result = processes.swarm(row, *line.split())
    found = json.loads(result.stdout)
    assert result.returncode == (0 if found["ok"] else 1), result.stderr
    assert (found["runs"], found["seed"], found["bus"]) == (4, 2, "memory")
    assert json.loads((row / "found" / "chaos.json").read_text()) == found
    assert len((row / "found" / "schedules.txt").read_text().splitlines()) == 4
    assert processes.belonging(row) == []


def test_chaos_with_real_processes_checks_recording_replay_and_identity(row: Path) -> None:
    line = "chaos row.toml --runs 1 --seed 5 --bus zenoh --out found"
    result = processes.swarm(row, *line.split())
    assert result.returncode == 0, result.stdout + result.stderr
    assert "all held" in result.stdout
    assert "run 0: --fault" in result.stderr
    assert sorted(path.name for path in (row / "found").iterdir()) == [
        "chaos.json",
        "schedules.txt",
    ]
    assert processes.belonging(row) == []


def test_chaos_that_is_interrupted_leaves_nobody(row: Path) -> None:
    started = processes.start(row, "chaos", "row.toml", "--runs", "500", "--out", "found")
    processes.until(lambda: processes.named(row, "swarm-chaos"), END_S, "workers are there")
    os.kill(started.pid, signal.SIGINT)
    started.communicate(timeout=END_S)
    assert started.returncode == 130
    processes.until(lambda: not processes.belonging(row), END_S, "nobody is left")


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("chaos no-such", "expected one of"),
        ("chaos row.toml --runs 0", "--runs"),
        ("chaos row.toml --set clock.mode=realtime", "expected clock.mode lockstep, got realtime"),
        ("chaos row.toml --set field.k=1", "field"),
    ],
)
def test_chaos_refuses_what_it_cannot_do(
    row: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    line: str,
    says: str,
) -> None:
    result = processes.here(monkeypatch, capsys, row, line)
    assert result.returncode == 2
    assert says in result.stderr
