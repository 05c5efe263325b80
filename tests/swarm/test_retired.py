"""Files of before: what is gone is left out where nobody changed it, else it is named."""

from __future__ import annotations

import pytest

from swarm import errors, scenario

PLAN = b"""
title = "Of before"
seed = 0
dt_s = 0.08
duration_s = 1.0
[[robots]]
name = "robot1"
start = [0.0, 0.0, 0.0]
"""


def test_controller_that_is_gone_is_named_with_what_took_its_place() -> None:
    for text in (PLAN + b'controller = "extended"\n', PLAN + b'[robot]\ncontroller = "extended"\n'):
        with pytest.raises(
            errors.ScenarioError, match=r"'navigator', .* or 'paper', got 'extended'"
        ):
            scenario.decode(text, "old.toml")
    with pytest.raises(errors.ScenarioError, match="'navigator'"):
        scenario.decode(PLAN, "new.toml", settings=["robot.controller=extended"])


@pytest.mark.parametrize("table", scenario.RETIRED)
def test_tunables_that_are_gone_count_for_nothing_at_the_value_that_they_had(table: str) -> None:
    for key, value in scenario.RETIRED[table].items():
        text = PLAN + f"[{table}]\n{key} = {value}\n".encode()
        assert scenario.decode(text, "old.toml") == scenario.decode(PLAN, "new.toml")
        with pytest.raises(errors.ScenarioError, match=f"got '{key}'"):
            scenario.decode(PLAN + f"[{table}]\n{key} = 0.9\n".encode(), "old.toml")
