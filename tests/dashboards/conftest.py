"""Scenarios that fit the made-up ticks."""

from __future__ import annotations

import functools
from collections.abc import Callable

import pytest

from swarm import scenario


@pytest.fixture(scope="session")
def made_scenario() -> Callable[[int], scenario.Scenario]:
    """Factory: so many robots in a row behind robot1, a circle and a triangle beside their way."""
    return functools.cache(_made_scenario)


def _made_scenario(robots: int) -> scenario.Scenario:
    rows = [
        f'[[robots]]\nname = "robot{row + 1}"\nstart = [{-row}.0, 0.0, 0.0]'
        for row in range(robots)
    ]
    text = f"""
        title = "made up"
        seed = 7
        dt_s = 0.08
        duration_s = 60.0
        [formation]
        leader = "robot1"
        [[obstacles]]
        circle = [7.0, 2.5, 1.5]
        [[obstacles]]
        polygon = [[5.0, -3.0], [8.0, -3.0], [8.0, -2.0]]
        {rows[0]}
        goal = [18.0, 0.0]
        {chr(10).join(rows[1:])}
    """
    return scenario.decode(text.encode(), "made up")
