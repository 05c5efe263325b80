"""Scenarios by name or file: the built-in ones of world.scenarios, and anybody's own."""

from __future__ import annotations

import importlib.resources
from pathlib import Path
from typing import Any

from swarm import errors
from swarm.scenario import CONTROLLERS, Scenario
from world import scene

BUILT_IN = "world.scenarios"
OWN_CONTROLLERS = "agents.controllers"


def built_in() -> dict[str, Any]:
    """Name -> resource of every built-in scenario."""
    folder = importlib.resources.files(BUILT_IN)
    return {
        resource.name.removesuffix(".toml"): resource
        for resource in sorted(folder.iterdir(), key=lambda one: one.name)
        if resource.name.endswith(".toml")
    }


def read_scenario(text: str) -> tuple[str, str, bytes]:
    """(name, where, bytes) of a scenario given by name or file; raises ScenarioError."""
    known = built_in()
    if text in known:
        return text, f"{text}.toml (built in)", known[text].read_bytes()
    path = Path(text)
    try:
        if path.suffix == ".toml" or path.is_file():
            return path.stem, str(path), path.read_bytes()
    except OSError as error:
        raise errors.ScenarioError(
            f"{path}: expected a file that can be read, got: {error.strerror}"
        ) from error
    hint = errors.did_you_mean(text, known)
    raise errors.ScenarioError(
        f"scenario: expected one of {', '.join(known)} or a TOML file, got '{text}'{hint}"
    )


def check_scene(plan: Scenario, where: str) -> None:
    """Raise ScenarioError, with the file, when obstacles cannot stand where they should.

    Likewise when a robot's controller is not there.
    """
    _check_controllers(plan, where)
    try:
        scene.obstacles(plan)
    except errors.ScenarioError as error:
        raise errors.ScenarioError(f"{where}: {error}") from error


def own_controllers() -> list[str]:
    """Names of the files in agents/controllers."""
    folder = importlib.resources.files(OWN_CONTROLLERS)
    names = [one.name.removesuffix(".py") for one in folder.iterdir() if one.name.endswith(".py")]
    return sorted(name for name in names if not name.startswith("_"))


def _check_controllers(plan: Scenario, where: str) -> None:
    members = {plan.formation.leader} if plan.formation is not None else set()
    for row, (robot, slot) in enumerate(zip(plan.robots, plan.slots(), strict=True)):
        name, path = robot.controller, f"{where}: robots[{row}].controller"
        if name in CONTROLLERS:
            continue
        known = [*CONTROLLERS, *own_controllers()]
        if name not in known:
            raise errors.ScenarioError(
                f"{path}: expected one of {', '.join(known)}, or a file of yours, "
                f"agents/controllers/{name}.py; got '{name}'{errors.did_you_mean(name, known)}"
            )
        if slot is not None or robot.name in members:
            raise errors.ScenarioError(
                f"{path}: expected one of {', '.join(CONTROLLERS)} in a formation, got '{name}'"
            )
