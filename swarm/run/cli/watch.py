"""Verbs that watch: the processes of a running swarm, and what each of them has written."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from rich.console import Console
from rich.live import Live
from typer import Argument, Option

from swarm import errors, palette, runs, zenoh_bus
from swarm import scenario as scenarios
from swarm.messages import STATUS, Status
from swarm.run import board, census, keys, logbook, processes
from swarm.run.cli import complete, live, options

LOOK_S = 0.1  # how soon a key is noticed
DRAW_S = 0.5  # as often as the world tells how it is
SHARE_MAX = 0.1  # of a core: a look at 100 processes takes 0.15 s
QUIET_S = 2.0  # a world that says nothing for so long is worth a word
QUIT = "q\x1b\x04"  # also Escape, Ctrl-D


def top(
    run_id: options.RunId = None,
    once: Annotated[bool, Option("--once", help="Print one table, and stop.")] = False,
    as_json: options.Json = False,
) -> None:
    """Show every process of a running swarm, twice a second (large ones less often); q ends it.

    CPU is of one core, MEM a fair share of what processes have in common, RATE commands per second,
    LATE those that came too late, HEARD how many peers it hears. HEALTH is how a robot answers:
    slow or silent when it owes the world an answer for 0.5 or 2 s. Narrow terminals show fewer
    columns. Without a terminal, and with --json, it prints once.

    Example:  swarm top

    Example:  swarm top --once --json
    """
    card = live.pick(run_id)
    people = census.Census(card)
    console = Console()
    if once or as_json or not console.is_terminal:
        _print_once(card, people, console, as_json)
        return
    names = styles_of(Path(card.folder))
    bus = live.connect(card)
    try:
        bus.subscribe(STATUS)
        with keys.Keys() as pressed, Live(console=console, screen=True, auto_refresh=False) as page:
            _follow(card, people, bus, pressed, page, names)
    finally:
        bus.close()


def _print_once(card: runs.Card, people: census.Census, console: Console, as_json: bool) -> None:
    status = live.status_of(card)
    rows = people.take(status)
    if as_json:
        options.print_json({"card": card, "status": status, "processes": rows})
        return
    width = console.width if console.is_terminal else None
    names = styles_of(Path(card.folder))
    if width is None:  # a file or a pipe takes everything
        console = Console(width=1000)
    console.print(board.board(status, rows, names, width=width))


def _follow(
    card: runs.Card,
    people: census.Census,
    bus: zenoh_bus.ZenohBus,
    pressed: keys.Keys,
    page: Live,
    names: dict[str, str],
) -> None:
    """Draw until a key ends it, or the swarm is gone."""
    status: Status | None = None
    heard_s, due_s = time.monotonic(), 0.0
    while not set(pressed.pressed()) & set(QUIT) and runs.is_alive(card):
        delivery = bus.receive(LOOK_S)
        if delivery is not None:
            status, heard_s = delivery.message, time.monotonic()
        if time.monotonic() < due_s:
            continue
        used_s = time.process_time()
        quiet_s = time.monotonic() - heard_s
        note = ""
        if quiet_s > QUIET_S:
            note = f"no word from the world for {quiet_s:.0f} s: {processes.what_blocks(card)}"
        width, height = page.console.size
        rows = people.take(status)
        page.update(board.board(status, rows, names, width=width, height=height, note=note))
        page.refresh()
        used_s = time.process_time() - used_s
        due_s = time.monotonic() + max(DRAW_S, used_s / SHARE_MAX)


# --- logs ---------------------------------------------------------------------------------------


def logs(
    names: Annotated[
        list[str] | None,
        Argument(
            metavar="[RUN] [NAME]...",
            help="A run's folder; only these processes.",
            autocompletion=complete.logs,
        ),
    ] = None,
    follow: Annotated[
        bool, Option("--follow", "-f", help="Go on as they grow, until the run ends.")
    ] = False,
    run_id: options.RunId = None,
    as_json: Annotated[
        bool, Option("--json", help="The records as they are on disk, one JSON object a line.")
    ] = False,
) -> None:
    """Show what the processes of a run have written, merged by time.

    Without RUN or --run it is the swarm that runs now, else the newest one in runs/. Names are
    `run` (the supervisor), `world`, `viewer`, and those of the robots.

    Example:  swarm logs -f

    Example:  swarm logs runs/20260101T120000Z-two-obstacles world robot3 --json
    """
    folder, wanted = _which(names or [], run_id)
    logbook.show(
        folder,
        wanted,
        follow=follow,
        as_json=as_json,
        styles=styles_of(folder),
    )


def _which(words: list[str], run_id: str | None) -> tuple[Path, list[str]]:
    """Folder of the run, and names of the processes, that are meant."""
    folders = [word for word in words if (Path(word) / runs.LOGS).is_dir()]
    names = [word for word in words if word not in folders]
    if len(folders) > 1 or (folders and run_id is not None):
        raise errors.UsageError(f"expected one run, got {', '.join([*folders, run_id or ''])}")
    if stray := next((name for name in names if "/" in name or "." in name), None):
        raise errors.UsageError(f"{stray}: expected a run's folder with {runs.LOGS}/ in it")
    if folders:
        return Path(folders[0]), names
    if run_id is not None or runs.running():
        return Path(live.pick(run_id).folder), names
    newest = max(Path("runs").glob(f"*/{runs.LOGS}"), default=None)
    if newest is None:
        raise errors.SwarmError("expected a swarm that runs, or a run in runs/, got none")
    return newest.parent, names


def styles_of(folder: Path) -> dict[str, str]:
    """Colour of every robot of a run, as in its pictures; none when its scenario cannot be read."""
    path = folder / runs.SCENARIO
    try:
        plan = scenarios.decode(path.read_bytes(), str(path))
    except (OSError, errors.ScenarioError):
        return {}
    leader = None if plan.formation is None else plan.row(plan.formation.leader)
    colours: Sequence[palette.Rgb] = palette.colours(len(plan.robots), leader)
    return {
        robot.name: f"rgb({red},{green},{blue})"
        for robot, (red, green, blue) in zip(plan.robots, colours, strict=True)
    }
