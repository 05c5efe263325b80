"""Scenarios that fit the made-up ticks."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path

import pytest
import tomli_w

from swarm import lifetime, scenario
from swarm.run import lockstep


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


FORMATION = """
title = "Three in a row, and a circle beside them"
seed = 3
dt_s = 0.08
duration_s = 24.0
[recording]
rerun = false
[formation]
leader = "robot1"
[[robots]]
name = "robot1"
start = [0.0, 0.0, 0.0]
goal = [5.0, 0.0]
[[robots]]
name = "robot2"
start = [-1.0, 0.8, 0.0]
[[robots]]
name = "robot3"
start = [-1.0, -0.8, 0.0]
[[obstacles]]
circle = [2.0, 2.6, 0.5]
[expect]
collisions = 0
"""


@pytest.fixture(scope="session")
def made_run(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """Factory: folder of a run of three robots in memory, with such `[[faults]]`; do not write."""

    @functools.cache
    def make(*faults: str) -> Path:
        plan = scenario.decode(FORMATION.encode(), "formation.toml", faults=faults)
        toml = tomli_w.dumps(scenario.to_builtins(plan)).encode()
        folder = tmp_path_factory.mktemp("run")
        (folder / "scenario.toml").write_bytes(toml)
        lockstep.record(
            plan, "formation", "run-1", toml, folder, lifetime.Stop(), lambda status: None
        )
        return folder

    return make
