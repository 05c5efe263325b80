"""Scenarios by name or file: the built-in ones of world.scenarios, and anybody's own."""

from __future__ import annotations

import importlib.resources
from pathlib import Path
from typing import Any

from swarm import errors
from swarm.scenario import Scenario
from world import scene

BUILT_IN = "world.scenarios"


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
    """Raise ScenarioError, with the file, when obstacles cannot stand where they should."""
    try:
        scene.obstacles(plan)
    except errors.ScenarioError as error:
        raise errors.ScenarioError(f"{where}: {error}") from error
