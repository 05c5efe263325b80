"""Verbs that make something of a run for others: a report, and tables."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer
from typer import Argument, Option

from swarm import errors, runs
from swarm.run.cli import options

REPORT = "report.html"
COMPARISON = "comparison.html"


def report(
    path: options.Run,
    other: Annotated[
        Path | None, Argument(metavar="[RUN]", help="Another run, to stand beside the first.")
    ] = None,
    out: Annotated[
        Path | None,
        Option(
            metavar="FILE",
            help="The page, if not report.html (of two comparison.html) in the run's folder.",
        ),
    ] = None,
    png: Annotated[
        Path | None, Option(metavar="DIR", help="Folder for the figures as files, too.")
    ] = None,
    as_json: options.Json = False,
) -> None:
    """Tell a run to somebody who was not there: one HTML page that needs nothing else.

    Of two runs: both side by side, with what is better and what is worse in the second.
    Exit code 1 when a run did not succeed or missed what its scenario expects.

    Examples:
      swarm report runs/20260101T120000Z-two-obstacles
      swarm report runs/BEFORE runs/AFTER --out change.html
      swarm report runs/20260101T120000Z-two-obstacles --png figures --json
    """
    from dashboards import report as reports  # with matplotlib: only who draws pays
    from swarm.run import report as reading

    targets = [path] if other is None else [path, other]
    found = [reading.read(target) for target in targets]
    if other is None:
        text, name = reports.html(found[0]), REPORT
    else:
        text, name = reports.comparison(*found), COMPARISON
    file = runs.recording(path).parent / name if out is None else out
    _write(file, text.encode(), "--out FILE")
    if png is not None:
        for target, run in zip(targets, found, strict=True):
            folder = png if other is None else png / _folder_of(target, targets)
            for figure, data in reports.pngs(run):
                _write(folder / f"{figure}.png", data, "--png DIR")
    told = [reports.numbers(run) for run in found]
    if as_json:
        options.print_json(told[0] if other is None else {"runs": told})
    else:
        for one in told:
            print(one.lead)
            for problem in one.problems:
                print(problem)
        print(f"report: {file}")
    if not all(run.ok for run in found):
        raise typer.Exit(1)


def _folder_of(target: Path, targets: list[Path]) -> str:
    """The run's name, with its place before it when both have the same."""
    names = [runs.recording(one).parent.resolve().name for one in targets]
    number = targets.index(target)
    return names[number] if len(set(names)) == len(names) else f"{number + 1}-{names[number]}"


def _write(file: Path, data: bytes, flag: str) -> None:
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        problem = runs.write_whole(file, data)
    except OSError as error:
        problem = f"{file}: {error.strerror}"
    if problem is not None:
        raise errors.UsageError(
            f"{problem}; expected a place that can be written, choose another with {flag}"
        )


def export_(
    path: options.Run,
    form: Annotated[
        Literal["parquet", "csv"], Option("--format", help="Of the files.")
    ] = "parquet",
    out: Annotated[
        Path | None, Option(metavar="DIR", help="Folder of the files, if not export/ in the run's.")
    ] = None,
    as_json: options.Json = False,
) -> None:
    """Write a run as tables: robots, frames, heard, commands, beacons, events.

    columns.md beside them tells every column with its unit; so do the schemas of Parquet files.
    Exit code 1 when the recording is cut: then what can be read of it is written.

    Example:  swarm export runs/20260101T120000Z-two-obstacles --format csv --out tables
    """
    from swarm.run import export as exports

    recording = runs.recording(path)
    folder = recording.parent / exports.FOLDER if out is None else out
    found = exports.export(recording, folder, form)
    if as_json:
        options.print_json(found)
    else:
        for name, count in found.rows.items():
            print(f"{name:<9} {count:>9} rows")
        print(f"ticks {found.first_tick}..{found.last_tick} in {found.folder}")
    if found.cut:
        raise errors.RecordingError(
            f"{path}: expected a whole recording, got one that is cut or damaged; exported what "
            "can be read of it, see swarm verify"
        )
