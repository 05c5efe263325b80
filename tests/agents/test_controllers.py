"""Controllers of one's own: found by name, asked every tick, held back by the guards."""

from __future__ import annotations

import sys
import types
from typing import Any

import pytest

from agents import controllers, robot
from agents.steering import Wish
from swarm import errors, scenario
from swarm.run import library
from tests.agents import scenes


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, Any]]:
    """What the controller `ahead` was asked: goal and memory; it counts and drives ahead."""
    calls: list[tuple[Any, Any]] = []

    def step(setup: Any, memory: Any, frame: Any, map: Any, peers: Any) -> tuple[int, Wish]:
        calls.append((setup.robot.goal, memory))
        return len(calls), Wish("GO", setup.robot.speed_mps_max, 0.0)

    module = types.ModuleType("agents.controllers.ahead")
    module.step = step  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, module.__name__, module)
    controllers.of.cache_clear()
    return calls


def test_own_controller_is_asked_every_tick_with_its_memory(asked: list[tuple[Any, Any]]) -> None:
    setup = scenes.alone(controller="ahead")
    state, command = robot.step(setup, robot.init(setup), scenes.frame())
    robot.step(setup, state, scenes.frame(tick=1))
    assert asked == [(setup.robot.goal, None), (setup.robot.goal, 1)]
    assert command.beacon.mode == "GO"
    assert command.set_point.speed_mps == pytest.approx(0.32)  # 4 m/s2 for a tick: slewed


def test_guards_stand_behind_an_own_controller(asked: list[tuple[Any, Any]]) -> None:
    setup = scenes.alone(controller="ahead")
    wall = scenes.scan([(0.55, 0.0, 0.3)], scenes.ORIGIN)
    _, command = robot.step(setup, robot.init(setup), scenes.frame(ranges_m=wall))
    assert command.set_point.speed_mps < 0.05
    assert command.trace.limited_by == "brake"


def test_built_in_controllers_are_none_of_ones_own() -> None:
    assert {controllers.of(name) for name in scenario.CONTROLLERS} == {None}


@pytest.mark.parametrize(
    ("name", "controller", "expected"),
    [
        ("single-robot", "navigatr", "did you mean 'navigator'?"),
        ("single-robot", "mine", "agents/controllers/mine.py"),
        ("two-obstacles", "ahead", "in a formation"),
    ],
)
def test_controller_that_cannot_serve_is_refused_before_anything_starts(
    monkeypatch: pytest.MonkeyPatch, name: str, controller: str, expected: str
) -> None:
    monkeypatch.setattr(library, "own_controllers", lambda: ["ahead"])
    _, where, data = library.read_scenario(name)
    plan = scenario.decode(data, where, settings=[f"robot.controller={controller}"])
    with pytest.raises(errors.ScenarioError, match=expected.replace("?", r"\?")):
        library.check_scene(plan, where)


@pytest.mark.parametrize("name", ["", "Mine", "../mine", "a.b", "1st"])
def test_name_of_a_controller_leads_nowhere_else(name: str) -> None:
    _, where, data = library.read_scenario("single-robot")
    with pytest.raises(errors.ScenarioError, match="controller"):
        scenario.decode(data, where, settings=[f"robot.controller='{name}'"])
