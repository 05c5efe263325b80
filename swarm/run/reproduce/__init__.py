"""The paper again: `swarm reproduce`.

    FIGURE -> runs -> tracks -> claims met or not -> table | JSON
                        '-----> pictures, one page

experiments   what a figure takes: runs, pictures, claims
claims        what is claimed, measured on runs
alone         one robot, Fig. 10 and 11
encounters    robots that meet, Fig. 12
formations    six robots among obstacles, Fig. 13 to 18
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec
from rich.console import Console
from rich.table import Table
from rich.text import Text

from dashboards import page, tracks
from swarm import errors, metrics, recording, runs, scenario
from swarm.run.reproduce import alone, encounters, formations
from swarm.run.reproduce.claims import Run
from swarm.run.reproduce.experiments import Experiment, Figure
from swarm.scenario import RobotParameters
from world import scene

PAGE = "index.html"
RUNS = "runs"
SEEDS = alone.SEEDS
PLAIN_WIDTH = 160  # characters of a line where there is no terminal to ask

__all__ = [
    "SEEDS",
    "Conduct",
    "Conducted",
    "Experiment",
    "Reproduction",
    "check_names",
    "figures",
    "run",
    "show",
]

Progress = Callable[[str], None]


class Conducted(msgspec.Struct, frozen=True):
    """A run that was made: what it came to, and what went wrong with its processes."""

    summary: metrics.Summary
    problem: str | None = None


Conduct = Callable[[Experiment, Path], Conducted]


class RunRow(msgspec.Struct, frozen=True, kw_only=True):
    """One run in the result."""

    name: str
    command: str
    outcome: str
    ticks: int
    sim_time_s: float
    wall_time_s: float | None
    state_hash: str | None


class Reproduction(msgspec.Struct, frozen=True, kw_only=True):
    """All that came of it; the object of `--json`."""

    ok: bool
    bus: str
    folder: str
    index: str  # the page
    pictures: list[str]
    claims: list[page.Claim]
    runs: list[RunRow]
    problems: list[str]
    wall_time_s: float


def figures(
    seeds: int = SEEDS, robot_fields: Sequence[str] = RobotParameters.__struct_fields__
) -> dict[str, Figure]:
    """Every figure by name."""
    return {**alone.table(seeds), **encounters.table(), **formations.table(robot_fields)}


def check_names(names: Sequence[str]) -> None:
    """Raises UsageError for a figure that is not in the table."""
    known = figures()
    for name in names:
        if name not in known:
            hint = errors.did_you_mean(name, known)
            raise errors.UsageError(
                f"reproduce: expected some of {', '.join(known)}, got '{name}'{hint}"
            )


def run(
    names: Sequence[str],
    conduct: Conduct,
    folder: Path,
    *,
    bus: str,
    seeds: int = SEEDS,
    progress: Progress,
) -> Reproduction:
    """Make the runs of the named figures, all of them when none is named, draw and measure.

    Args:
        conduct: makes one run in a folder, with its recording and scenario.
        folder: for pictures, page and runs; there is none of them in it yet.
    Raises:
        UsageError: an unknown figure. SwarmError: a run that cannot be made or read.
    """
    check_names(names)
    begun_s = time.monotonic()
    known = figures(seeds)
    wanted = {name: known[name] for name in dict.fromkeys(names or known)}
    every = {one.name: one for figure in wanted.values() for one in figure.experiments}
    done: dict[str, Run] = {}
    rows: list[RunRow] = []
    problems: list[str] = []
    for number, experiment in enumerate(every.values(), 1):
        made = conduct(experiment, folder / RUNS / experiment.name)
        row = _row(experiment, made.summary)
        progress(f"[{number}/{len(every)}] {experiment.name}: {_told(row)}")
        rows.append(row)
        problems += _problems(experiment, made)
        done[experiment.name] = _read(folder / RUNS / experiment.name, made.summary)
    progress("drawing")
    sections = [_section(name, figure, done) for name, figure in wanted.items()]
    pictures = [picture for section in sections for picture in section.pictures]
    for picture in pictures:
        _write(folder / f"{picture.name}.png", picture.png)
    found = [claim for section in sections for claim in section.claims]
    wall_time_s = time.monotonic() - begun_s
    facts = (
        f"{len(every)} runs, {_bus_text(bus)}",
        f"{sum(claim.met for claim in found)} of {len(found)} claims met",
        f"{sum(row.sim_time_s for row in rows):.0f} s simulated in {wall_time_s:.0f} s",
    )
    text = page.html(
        page.Page("The paper's figures, run again", facts, tuple(problems), tuple(sections))
    )
    _write(folder / PAGE, text.encode())
    return Reproduction(
        ok=not problems and all(claim.met for claim in found),
        bus=bus,
        folder=str(folder),
        index=PAGE,
        pictures=[f"{picture.name}.png" for picture in pictures],
        claims=found,
        runs=rows,
        problems=problems,
        wall_time_s=wall_time_s,
    )


def _read(folder: Path, summary: metrics.Summary) -> Run:
    """A run with its tracks, from its recording."""
    source = recording.read(folder / runs.MCAP)
    plan = scenario.decode(source.scenario_toml, str(folder / runs.SCENARIO))
    return Run(summary, tracks.collect(plan, scene.obstacles(plan), source.ticks))


def _problems(experiment: Experiment, made: Conducted) -> list[str]:
    """What is wrong with a run apart from what the robots did."""
    found = [] if made.problem is None else [f"{experiment.name}: {made.problem}"]
    kept = made.summary.recording
    if kept is None or kept.lost:
        lost = "all" if kept is None else kept.lost
        found.append(f"{experiment.name}: recording: {lost} messages lost")
    return found


def _section(name: str, figure: Figure, done: dict[str, Run]) -> page.Section:
    """Pictures and verdicts of one figure."""
    pictures = []
    for picture in figure.pictures:
        png = picture.draw([done[one] for one in picture.of])
        pictures.append(page.Picture(picture.name, picture.caption, png))
    found = []
    for claim in figure.claims:
        verdict = claim.measure([done[one] for one in claim.of])
        found.append(page.Claim(name, claim.text, verdict.ours, verdict.met))
    commands = tuple(experiment.command for experiment in figure.experiments)
    return page.Section(name, figure.title, tuple(pictures), tuple(found), commands)


def _write(path: Path, data: bytes) -> None:
    try:
        path.write_bytes(data)
    except OSError as error:
        raise errors.SwarmError(
            f"{path}: expected room for {len(data)} bytes, got: {error.strerror}"
        ) from error


def _row(experiment: Experiment, summary: metrics.Summary) -> RunRow:
    return RunRow(
        name=experiment.name,
        command=experiment.command,
        outcome=summary.outcome,
        ticks=summary.ticks,
        sim_time_s=summary.sim_time_s,
        wall_time_s=summary.wall_time_s,
        state_hash=summary.state_hash,
    )


def _told(row: RunRow) -> str:
    wall = "" if row.wall_time_s is None else f" in {row.wall_time_s:.1f} s"
    return f"{row.outcome}, {row.sim_time_s:.1f} s simulated{wall}"


def _bus_text(bus: str) -> str:
    return "all in one process" if bus == "memory" else "one process a robot"


def show(found: Reproduction) -> None:
    """The table of claims, for people, on standard output."""
    console = Console()
    if not console.is_terminal:
        console = Console(width=PLAIN_WIDTH)
    table = Table(box=None, pad_edge=False)
    for name in ("FIGURE", "CLAIM", "OURS", ""):
        table.add_column(name, no_wrap=name == "")
    for claim in found.claims:
        verdict = Text("met", "green") if claim.met else Text("NOT MET", "bold red")
        table.add_row(Text(claim.figure), Text(claim.claim), Text(claim.ours), verdict)
    console.print(table)
    met = sum(claim.met for claim in found.claims)
    for line in (
        f"{met} of {len(found.claims)} claims met, {len(found.runs)} runs in "
        f"{found.wall_time_s:.0f} s",
        f"pictures: {found.folder}, all on one page: {found.folder}/{found.index}",
    ):
        console.print(Text(line), highlight=False, soft_wrap=True)
