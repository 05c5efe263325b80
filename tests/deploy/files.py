"""Where the files of deploy/ are, and what their command lines mean to `swarm`."""

from __future__ import annotations

import importlib.resources
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import typer.main

from swarm import scenario as scenarios
from swarm.run import cli

ROOT = Path(__file__).parents[2]
DEPLOY = ROOT / "deploy"
CERTIFICATES = DEPLOY / "certificates.sh"
PLAIN = DEPLOY / "router" / "plain.json5"
SECURE = DEPLOY / "router" / "secure.json5"
SYSTEMD = DEPLOY / "systemd"

# what no test of deployment looks at takes half a second to load
UNRECORDED = ("--set", "recording.mcap=false", "--set", "recording.rerun=false")


def robots_of(scenario: str) -> tuple[str, ...]:
    """Names of the robots of a built-in scenario."""
    text = (importlib.resources.files("world.scenarios") / f"{scenario}.toml").read_bytes()
    return tuple(robot.name for robot in scenarios.decode(text, scenario).robots)


ROBOTS = robots_of("two-obstacles")  # of compose.yaml and secure.json5


def parse(arguments: Sequence[str]) -> dict[str, Any]:
    """Parameters of `swarm ARGUMENTS` by name, as the command line itself reads them.

    Raises its usage error when the verb or a flag does not exist.
    """
    group = typer.main.get_command(cli.app)
    verb, rest = arguments[0], list(arguments[1:])
    command = group.commands[verb]  # type: ignore[attr-defined]
    return dict(command.make_context(verb, rest).params)
