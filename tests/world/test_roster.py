"""When a robot that failed is started again."""

from __future__ import annotations

import msgspec
import pytest

from swarm import scenario
from swarm.run import library
from swarm.scenario import Scenario
from world import roster
from world.roster import Member


def plan(*settings: str) -> Scenario:
    _, where, data = library.read_scenario("two-obstacles")
    return scenario.decode(data, where, settings=settings)


DELAYED = ("restart.robot=on-failure", "restart.restart_delay_s=0.8")


def test_start_due_is_never_when_the_policy_is_never() -> None:
    assert roster.start_due(plan(), Member(), 100) is None


@pytest.mark.parametrize(("recent", "after_ticks"), [(0, 10), (1, 20), (2, 40), (3, 80)])
def test_start_due_doubles_its_delay_with_every_restart(recent: int, after_ticks: int) -> None:
    member = Member(starts=tuple(range(100, 100 + recent)))
    assert roster.start_due(plan(*DELAYED), member, 200) == 200 + after_ticks


def test_start_due_gives_up_at_the_limit_and_forgives_after_the_window() -> None:
    scenario = plan(*DELAYED, "restart.restart_max=2", "restart.restart_window_s=8.0")
    member = Member(starts=(100, 150))
    assert roster.start_due(scenario, member, 190) is None
    assert roster.start_due(scenario, member, 201) == 201 + 20  # that at 100 is forgotten
    assert roster.start_due(scenario, member, 251) == 251 + 10


def test_start_due_waits_for_one_that_may_come_back_by_itself() -> None:
    assert roster.start_due(plan(*DELAYED), Member(), 100, after_s=4.0) == 150


def test_starting_forgets_what_was_asked_of_the_process_before() -> None:
    member = Member(state="hung", sent_tick=40, answered_tick=39, hang=3, continue_tick=60)
    started = roster.starting(member, 1, 50)
    assert started.incarnation == 1
    assert (started.sent_tick, started.answered_tick) == (-1, -1)
    assert (started.hang, started.continue_tick, started.start_tick) == (None, None, None)
    assert (started.starts, started.restarts) == ((50,), 1)
    assert started.is_expected
    assert not roster.back(started, touched=False).is_expected


def test_back_stays_collided_when_it_has_touched_something() -> None:
    away = msgspec.structs.replace(Member(), state="lost")
    assert roster.back(away, touched=True).state == "collided"
    assert roster.back(away, touched=False).is_present
