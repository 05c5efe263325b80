"""Verbs that read what a run has left behind."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import msgspec
import typer
from typer import Argument, Option

from swarm import recording, runs
from swarm.run.cli import complete, options


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
    verdict = recording.verify(target, _last_tick(target))
    if as_json:
        options.print_json({"verdict": verdict, "repair": repaired})
    else:
        for line in (*(repaired.text if repaired is not None else ()), *verdict.text):
            print(line)
    if not verdict.ok:
        raise typer.Exit(1)


def _last_tick(target: Path) -> int | None:
    """Last tick of the run by its summary, None when that is not there."""
    if target.name != runs.MCAP:
        return None
    try:
        return msgspec.json.decode((target.parent / runs.SUMMARY).read_bytes(), type=_Ticks).ticks
    except (OSError, msgspec.DecodeError):
        return None


class _Ticks(msgspec.Struct):
    """What of a summary tells how long the run was."""

    ticks: int


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


def diff(
    a: Annotated[
        Path,
        Argument(
            metavar="A", help="A run's folder, or its run.mcap.", autocompletion=complete.finished
        ),
    ],
    b: Annotated[
        Path, Argument(metavar="B", help="Another one.", autocompletion=complete.finished)
    ],
    as_json: options.Json = False,
) -> None:
    """Compare two runs tick by tick, to the last bit; exit code 1 when they differ.

    Names the first difference by tick, robot and field, and all fields that ever differ.

    Example:  swarm diff runs/20260101T120000Z-two-obstacles runs/20260101T120500Z-two-obstacles
    """
    from swarm.run import difference

    found = difference.difference(runs.recording(a), runs.recording(b))
    if as_json:
        options.print_json(found)
    else:
        difference.show(found)
    if not found.equal:
        raise typer.Exit(1)


def why_(
    path: options.Run,
    name: Annotated[str, Argument(metavar="NAME", help="A robot's name.")],
    time_s: Annotated[float, Argument(metavar="T", help="When, in simulated seconds.")],
    as_json: options.Json = False,
) -> None:
    """Tell what one robot saw, weighed, heard and did at one moment.

    Example:  swarm why runs/20260101T120000Z-two-obstacles robot3 12.4
    """
    from swarm.run import explain, why

    found = why.why(runs.recording(path), name, time_s)
    if as_json:
        options.print_json(found)
    else:
        explain.show(found)
