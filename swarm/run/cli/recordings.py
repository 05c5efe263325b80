"""Verbs that read what a run has left behind."""

from __future__ import annotations

from typing import Annotated

import typer
from typer import Option

from swarm import recording, runs
from swarm.run.cli import options


def verify(
    path: options.Run,
    repair: Annotated[
        bool, Option("--repair", help="Write a good file; keep the old one.")
    ] = False,
    as_json: options.Json = False,
) -> None:
    """Check a recording: is it whole, undamaged, without a gap? Exit code 1 when not.

    Example:  swarm verify runs/20260101T120000Z-two-obstacles --repair
    """
    target = runs.recording(path)
    repaired = recording.repair(target) if repair else None
    verdict = recording.verify(target)
    if as_json:
        options.print_json({"verdict": verdict, "repair": repaired})
    else:
        for line in (*(repaired.text if repaired is not None else ()), *verdict.text):
            print(line)
    if not verdict.ok:
        raise typer.Exit(1)


def replay_(
    path: options.Run,
    robot: Annotated[str | None, Option(help="Only this one.")] = None,
    as_json: options.Json = False,
) -> None:
    """Run every robot again on its recorded frames; exit code 1 when one does something else.

    Example:  swarm replay runs/20260101T120000Z-two-obstacles --robot robot3
    """
    from swarm.run import replay

    found = replay.replay(runs.recording(path), robot)
    if as_json:
        options.print_json(found)
    else:
        print(f"{found.ticks} ticks, {found.commands} commands, {found.restarts} restarts replayed")
        if found.unheard:
            print(f"{found.unheard} more answers that the world never got")
        if found.cut:
            print("the recording is cut: replayed up to there")
        if found.missing is not None:
            print(found.missing)
        if found.state_hash is not None:
            print(f"state hash {found.state_hash}")
        if found.difference is not None:
            where = found.difference
            print(f"tick {where.tick}: {where.robot}: {where.field}")
            print(f"  recorded {where.recorded}\n  replayed {where.replayed}")
        print("equal" if found.ok else "DIFFERENT")
    if not found.ok:
        raise typer.Exit(1)
