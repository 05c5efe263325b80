"""Any scenario file: a scenario, or a ScenarioError that names the file and says why not."""

from __future__ import annotations

import random
import tomllib

import pytest
import tomli_w

from swarm import errors, scenario
from swarm.run import library
from tests.fuzz import mutations
from tests.fuzz.campaign import Campaign

CASES = 200  # of a part
WHERE = "mutant.toml"


@pytest.fixture(scope="module")
def good() -> list[bytes]:
    """Every built-in scenario, as people wrote it and with every key spelled out."""
    found = []
    for name, resource in library.built_in().items():
        data = resource.read_bytes()
        plan = scenario.decode(data, name)
        found += [data, tomli_w.dumps(scenario.to_builtins(plan)).encode()]
    return found


def file_of(draw: random.Random, good: list[bytes]) -> bytes:
    data = draw.choice(good)
    choice = draw.randrange(10)
    if choice < 5:
        return _altered(draw, data)
    if choice < 7:
        return _lines(draw, data)
    return mutations.damaged(draw, data, draw.choice(good))


def _altered(draw: random.Random, data: bytes) -> bytes:
    tree = mutations.altered(draw, tomllib.loads(data.decode()), draw.randrange(1, 4))
    try:
        return tomli_w.dumps(tree).encode()
    except (TypeError, ValueError, AttributeError):  # what TOML does not have
        return mutations.damaged(draw, data)


def _lines(draw: random.Random, data: bytes) -> bytes:
    """Lines removed, repeated and out of place."""
    lines = data.split(b"\n")
    for _ in range(draw.randrange(1, 5)):
        at = draw.randrange(len(lines))
        line = lines[at]
        match draw.randrange(4):
            case 0:
                del lines[at]
            case 1:
                lines.insert(draw.randrange(len(lines) + 1), line)
            case 2:
                lines[at] = line.replace(b"=", draw.choice((b"", b"==", b".x =", b"= -", b"= [")))
            case _:
                lines[at] = line.upper()
        lines = lines or [b""]
    return b"\n".join(lines)


def test_scenario_files_are_refused_with_a_reason_or_can_be_run(
    campaign: Campaign, good: list[bytes]
) -> None:
    draw = campaign.draw
    accepted = 0
    for number in range(CASES):
        data = file_of(draw, good)
        with campaign.case(number, "scenario", data):
            plan, refusal = attempt(data)
            if plan is None:
                assert refusal.startswith(f"{WHERE}: ")
                assert "expected" in refusal
                continue
            accepted += 1
            again = tomli_w.dumps(scenario.to_builtins(plan)).encode()
            assert scenario.decode(again, WHERE) == plan
            for robot in plan.robots:
                plan.setup(robot.name)
    assert accepted > CASES // 50


def attempt(data: bytes) -> tuple[scenario.Scenario | None, str]:
    """(scenario, "") or (None, why not)."""
    try:
        plan = scenario.decode(data, WHERE)
        library.check_scene(plan, WHERE)
    except errors.ScenarioError as error:
        return None, str(error)
    return plan, ""
