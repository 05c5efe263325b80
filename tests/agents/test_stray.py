"""Who backs off in a jam, and for how long."""

from __future__ import annotations

from math import pi

import pytest

from agents import stray
from swarm.geometry import Pose
from tests.agents import scenes

OWN = (1, 0, 0, 5)
BETTER = scenes.peer(scenes.beacon("robot1", Pose(0.6, 0.0, 0.0), priority=(0, 0, 0, 1)))
WORSE = scenes.peer(scenes.beacon("robot9", Pose(0.6, 0.0, 0.0), priority=(2, 0, 0, 9)))
ELAPSED_S = 0.1


def held(name: str, ticks: int, *, state: stray.State | None = None) -> list[float | None]:
    """Directions that it backs off in, tick by tick."""
    state = state or stray.State()
    found = []
    for _ in range(ticks):
        state, away_rad = stray.step(state, [BETTER, WORSE], OWN, name, ELAPSED_S)
        found.append(away_rad)
    return found


def test_who_is_held_by_a_better_claim_for_long_backs_off_for_a_while() -> None:
    found = held("robot1", 56)
    first = next(tick for tick, away_rad in enumerate(found) if away_rad is not None)
    assert first == pytest.approx(stray.JAM_S / ELAPSED_S, abs=1)
    assert abs(found[first] or 0.0) == pytest.approx(pi)
    backs = [away_rad for away_rad in found if away_rad is not None]
    assert len(backs) == pytest.approx(stray.BACK_S / ELAPSED_S, abs=1)


def test_who_has_the_better_claim_or_is_not_held_stays() -> None:
    assert set(held("robot9", 60)) == {None}
    assert set(held("", 60)) == {None}


def test_a_jam_is_forgotten_slowly() -> None:
    state = stray.State(jam_s=2.0)
    for _ in range(10):
        state, _ = stray.step(state, [BETTER], OWN, "", ELAPSED_S)
    assert state.jam_s == pytest.approx(2.0 - 10 * stray.JAM_FORGET * ELAPSED_S)
