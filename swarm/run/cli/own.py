"""Verbs for what is one's own: the machine, a finished run in the viewer, a scenario."""

from __future__ import annotations

import typer
from rich.console import Console
from rich.text import Text

from swarm.run import doctor as doctor_
from swarm.run.cli import options

STYLES = {"ok": "green", "warn": "yellow", "bad": "bold red"}


def doctor(as_json: options.Json = False) -> None:
    """Look at everything a run needs of this machine, and say what to do where it is wanting.

    Exit code 1 when a run would not work; what is only worth knowing says warn.

    Example:  swarm doctor
    """
    found = doctor_.examine()
    if as_json:
        options.print_json(found)
    else:
        console = Console()
        for one in found.checks:
            mark = Text(f"{one.state.upper() if one.state == 'bad' else one.state:<5}")
            mark.stylize(STYLES[one.state])
            console.print(
                Text.assemble(mark, f"{one.name:<15} {one.text}"), highlight=False, soft_wrap=True
            )
            if one.advice:
                console.print(f"{'':20} -> {one.advice}", highlight=False, soft_wrap=True)
    if not found.ok:
        raise typer.Exit(1)
