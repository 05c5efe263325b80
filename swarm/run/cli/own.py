"""Verbs for what is one's own: the machine, a finished run in the viewer, a scenario."""

from __future__ import annotations

import re
import signal
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.text import Text
from typer import Argument, Option

from swarm import errors, scenario, shapes
from swarm.run import doctor as doctor_
from swarm.run import draft, front, launch, viewers
from swarm.run.cli import complete, options

NAME = r"^[A-Za-z0-9][A-Za-z0-9_-]{0,63}\Z"
STYLES = {"ok": "green", "warn": "yellow", "bad": "bold red"}


def new(
    name: Annotated[str, Argument(metavar="NAME", help="Of the scenario; its file is NAME.toml.")],
    robots: Annotated[int, Option(min=1, max=100, help="How many.")] = 4,
    shape: Annotated[shapes.Shape, Option(help="Of their formation.")] = "wedge",
    as_json: options.Json = False,
) -> None:
    """Write a scenario of one's own: small, commented, and it runs as it is.

    Example:  swarm new crossing --robots 6 --shape line
    """
    path = Path(name if name.endswith(".toml") else f"{name}.toml")
    if re.match(NAME, path.stem) is None:
        raise errors.UsageError(
            f"expected a name of letters, digits, - and _, got '{path.stem}'; try: swarm new mine"
        )
    text = draft.scenario(path.stem, robots, shape)
    scenario.decode(text.encode(), str(path))
    try:
        with path.open("x") as file:  # never over another one
            file.write(text)
    except FileExistsError:
        raise errors.UsageError(
            f"{path}: expected a name that is free, got one that is taken; choose another"
        ) from None
    except OSError as error:
        raise errors.UsageError(
            f"{path}: expected a file that can be written, got: {error.strerror}"
        ) from error
    if as_json:
        options.print_json({"file": str(path), "robots": robots, "shape": shape})
    else:
        print(f"{path}: written; run it with: swarm run {path}")


def view(
    path: Annotated[
        Path,
        Argument(
            metavar="RUN",
            help="A run's folder, or its run.rrd.",
            autocompletion=complete.finished,
        ),
    ],
    web: Annotated[bool, Option("--web", help="Serve the viewer to a browser.")] = False,
    native: Annotated[bool, Option("--native", help="Open a window.")] = False,
) -> None:
    """Open a finished run in Rerun: in a window where there is a display, else for a browser.

    The web viewer is served on loopback until Ctrl-C (exit code 130). A run that was not recorded
    for Rerun is shown from its MCAP.

    Example:  swarm view runs/20260101T120000Z-two-obstacles --web
    """
    if web and native:
        raise errors.UsageError("expected --web or --native, got both")
    paths = viewers.pictures(path)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    if native or not (web or launch.has_display()):
        launch.check_display("native")
        viewers.open_native(paths)
    else:
        viewers.serve_web(paths, front.say)


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
