"""Faults drawn from a seed: the same every time, within bounds that are written down."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from swarm import faults, scenario
from swarm.run import chaos, library
from swarm.run.chaos import schedules
from swarm.run.chaos.schedules import EVERYTHING, SURVIVABLE, Bound

LENGTH_S = 40.0


def _plan(name: str) -> scenario.Scenario:
    _, where, data = library.read_scenario(name)
    return scenario.decode(data, where)


PLAN = _plan("two-obstacles")
ALONE = _plan("single-robot")


def _allows(bound: Bound, fault: faults.Fault) -> bool:
    """Whether a fault is within a bound, read by hand."""
    if bound.kind != faults.kind_of(fault) or (bound.whom == "world") != (fault.target == "world"):
        return False
    if (bound.lasts_s is None) != (fault.for_s is None):
        return False
    slack_s = PLAN.dt_s / 2.0 + 1e-9
    if bound.lasts_s is not None and fault.for_s is not None:
        least_s, most_s = bound.lasts_s
        if not least_s - slack_s <= fault.for_s <= most_s + slack_s:
            return False
    if not bound.key:
        return True
    value = getattr(fault, bound.key)
    if bound.key in ("late_s", "delay_s"):
        value = value / PLAN.dt_s
        assert abs(value - round(value)) < 1e-6
    return bound.least - 1e-6 <= value <= bound.most + 1e-6


@given(st.integers(0, 2**53), st.integers(0, 10_000), st.sampled_from([PLAN, ALONE]))
def test_draw_stays_within_the_bounds_and_can_be_written_as_a_line(
    seed: int, number: int, plan: scenario.Scenario
) -> None:
    schedule = schedules.draw(plan, LENGTH_S, seed, number)
    assert 1 <= len(schedule.faults) <= schedules.FAULTS_MAX
    assert list(schedule.faults) == sorted(schedule.faults, key=lambda fault: fault.at_s)
    for fault in schedule.faults:
        assert any(_allows(bound, fault) for bound in SURVIVABLE), faults.text_of(fault)
        assert schedules.FIRST_TICK <= plan.tick_of(fault.at_s) < plan.tick_of(LENGTH_S)
        if isinstance(fault, faults.DiskFull):  # over before the run can be
            assert fault.at_s <= 0.7 * LENGTH_S
    texts = schedule.text.split("--fault ")[1:]
    tables = [faults.table(text.strip()) for text in texts]
    again = scenario.decode(
        library.read_scenario("two-obstacles" if plan is PLAN else "single-robot")[2],
        "again",
        faults=[text.strip() for text in texts],
    )
    assert again.faults == schedule.faults
    assert len(tables) == len(schedule.faults)


@given(st.integers(0, 2**53), st.integers(0, 10_000))
def test_two_robots_keep_their_memory_and_no_world_dies_three_times(seed: int, number: int) -> None:
    drawn = schedules.draw(PLAN, LENGTH_S, seed, number).faults
    killed = [fault for fault in drawn if isinstance(fault, faults.Kill | faults.Restart)]
    worlds = [fault for fault in killed if fault.target == "world"]
    struck = 0
    for fault in killed:
        if fault.target.startswith("any:"):
            struck += max(1, round(6 * float(fault.target[4:])))
        elif fault.target != "world":
            struck += len(fault.target.split("/"))
    assert struck <= 4
    assert len(worlds) <= 2


def test_the_same_seed_draws_the_same_and_every_number_its_own() -> None:
    first = [schedules.draw(PLAN, LENGTH_S, 7, number) for number in range(50)]
    again = [schedules.draw(PLAN, LENGTH_S, 7, number) for number in reversed(range(50))]
    assert first == again[::-1]
    assert len({one.text for one in first}) == 50
    assert schedules.draw(PLAN, LENGTH_S, 8, 0).text != first[0].text


def test_every_kind_is_drawn_and_those_nobody_need_survive_only_when_asked_for() -> None:
    def kinds(everything: bool) -> set[str]:
        return {
            faults.kind_of(fault)
            for number in range(400)
            for fault in schedules.draw(PLAN, LENGTH_S, 1, number, everything=everything).faults
        }

    assert kinds(False) == set(faults.KINDS) - {"sensor-stuck", "actuator-stuck"}
    assert kinds(True) == set(faults.KINDS)
    assert {bound.kind for bound in EVERYTHING} == set(faults.KINDS)


def test_the_second_phase_begins_behind_the_last_fault_and_is_long_enough() -> None:
    drawn = (
        faults.Hang(target="robot1", at_s=8.0, for_s=4.0),
        faults.Kill(target="leader", at_s=11.2),
        faults.Partition(target="any:0.5", at_s=9.6, for_s=1.6),
    )
    assert schedules.healed_tick(PLAN, drawn) == 150  # (8 + 4) / 0.08
    planned = schedules.plan(PLAN, 32.0, drawn)
    assert planned.duration_s == pytest.approx(12.0 + 32.0 + 120.0)
    assert planned.faults == drawn
    assert schedules.healed_tick(PLAN, ()) == 0


def test_what_can_be_survived_is_written_down_as_it_is_drawn() -> None:
    text = (Path(chaos.__file__).parent / "README.md").read_text()
    rows = re.findall(r"^\| `([a-z-]+)` \| ([^|]*) \| ([^|]*) \| ([^|]*) \|$", text, re.MULTILINE)
    written = [tuple(cell.strip() for cell in row) for row in rows]
    assert written == [_row(bound) for bound in SURVIVABLE]


def _row(bound: Bound) -> tuple[str, str, str, str]:
    lasts = "-" if bound.lasts_s is None else f"{bound.lasts_s[0]:g} to {bound.lasts_s[1]:g} s"
    unit = " ticks" if bound.key in ("late_s", "delay_s") else ""
    strength = f"`{bound.key}` {bound.least:g} to {bound.most:g}{unit}" if bound.key else "-"
    whom = {"robots": "some robots", "any": "some or all robots", "world": "the world"}[bound.whom]
    return bound.kind, whom, lasts, strength
