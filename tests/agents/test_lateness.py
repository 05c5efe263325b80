"""How late commands take effect: learnt from the body, kept while it explains what is seen."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents import lateness
from swarm.geometry import STILL, Twist

SPEEDS = st.lists(st.integers(-4, 10), min_size=8, max_size=30)


def _drive(speeds: list[int], late_ticks: int) -> list[int]:
    """Lateness after each tick of a body that heeds every set-point so many ticks late."""
    sent = [Twist(0.1 * speed, 0.0) for speed in speeds]
    state, found = lateness.State(), []
    for tick, set_point in enumerate(sent):
        heeded = tick - 1 - late_ticks
        state = lateness.step(state, sent[heeded] if heeded >= 0 else STILL, 1)
        state = lateness.send(state, set_point)
        found.append(state.late_ticks)
    return found


@given(SPEEDS)
def test_commands_in_time_are_never_taken_for_late(speeds: list[int]) -> None:
    # the first measured twist is that of a robot that stands, whatever it was told
    assert set(_drive([0, *speeds], 0)) == {0}


@pytest.mark.parametrize("late_ticks", [1, 2, 3])
def test_lateness_is_found_once_set_points_change(late_ticks: int) -> None:
    rising = list(range(1, 20))
    assert _drive([5, 5, 5, 5], late_ticks)[-1] in (0, late_ticks)
    assert _drive(rising, late_ticks)[late_ticks + 1 :] == [late_ticks] * (18 - late_ticks)
    # standing says nothing new
    assert _drive([*rising, *[19] * 10], late_ticks)[-1] == late_ticks


def test_lateness_is_unlearnt_when_commands_come_in_time_again() -> None:
    state = lateness.State((Twist(0.3, 0.0), Twist(0.2, 0.0), Twist(0.1, 0.0)), 2)
    assert lateness.step(state, Twist(0.1, 0.0), 1).late_ticks == 2
    assert lateness.step(state, Twist(0.3, 0.0), 1).late_ticks == 0


def test_nothing_is_learnt_from_weak_motors_or_after_missed_frames() -> None:
    state = lateness.State((Twist(0.3, 0.0), Twist(0.2, 0.0)), 1)
    assert lateness.step(state, Twist(0.15, 0.0), 1) == state
    assert lateness.step(state, Twist(0.3, 0.0), 4) == lateness.State(late_ticks=1)


def test_the_next_set_point_builds_on_the_last_one_when_that_is_late() -> None:
    measured = Twist(0.1, 0.0)
    sent = (Twist(0.4, 0.0), Twist(0.2, 0.0))
    assert lateness.base(lateness.State(sent, 0), measured) == measured
    assert lateness.base(lateness.State(sent, 2), measured) == sent[0]
    assert lateness.base(lateness.State((), 2), measured) == measured
