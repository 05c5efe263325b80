"""Flags and arguments that many verbs share, and how an answer for machines is printed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import msgspec
from typer import Argument, Option

from swarm.run.cli import complete

Json = Annotated[bool, Option("--json", help="Print one JSON object on standard output.")]
Scenario = Annotated[
    str,
    Argument(help="A built-in scenario's name, or a TOML file.", autocompletion=complete.scenarios),
]
Run = Annotated[
    Path,
    Argument(
        metavar="RUN", help="A run's folder, or its run.mcap.", autocompletion=complete.finished
    ),
]
RunId = Annotated[
    str | None,
    Option(
        "--run",
        metavar="ID",
        help="Which one, if several run; its first letters do.",
        autocompletion=complete.run_ids,
    ),
]


def print_json(value: Any) -> None:
    """One object, one line, on standard output."""
    print(msgspec.json.encode(value).decode(), flush=True)
