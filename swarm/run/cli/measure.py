"""Verbs that measure, and that run the paper's experiments again."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import setproctitle
import tomli_w
import typer
from typer import Argument, Option

from swarm import errors, runs
from swarm import scenario as scenarios
from swarm.run import front, launch, library, supervisor
from swarm.run.bar import Bar
from swarm.run.cli import options


def bench(
    names: Annotated[list[str] | None, Argument(metavar="[NAME]...", help="Which ones.")] = None,
    tiny: Annotated[
        bool, Option("--tiny", help="Smallest sizes, to see that all of it runs.")
    ] = False,
    families: Annotated[
        str | None,
        Option(
            metavar="A,B",
            help="navigation: which families; all of a kind: disturbed, bursts, drift, dead, ...",
        ),
    ] = None,
    sizes: Annotated[
        str | None, Option(metavar="A,B", help="navigation: which sizes of them: 50x16m2,16.")
    ] = None,
    controllers: Annotated[
        str | None, Option(metavar="A,B", help="navigation: some of paper, navigator.")
    ] = None,
    seeds: Annotated[
        str | None, Option(metavar="A-B", help="navigation: which instances of each family.")
    ] = None,
    without: Annotated[
        str | None,
        Option(
            metavar="A,B",
            help="navigation: stages of the navigator left out: memory, way, "
            "speed, movers, roundabout, gaps, cells, forces, dodge, guard.",
        ),
    ] = None,
    data: Annotated[
        Path | None, Option(metavar="DIR", help="navigation: where public benchmark data is.")
    ] = None,
    out: Annotated[
        Path | None, Option(metavar="DIR", help="navigation: folder for the worst runs' scenarios.")
    ] = None,
    as_json: options.Json = False,
) -> None:
    """Measure what a swarm costs, as ratios within one run; or how well it finds its way.

    `navigation` is asked for by name: its full size takes hours. It fails only when a run crashes;
    Ctrl-C ends it early with the figures of what is done by then (exit code 130).

    Example:  swarm bench barrier step

    Example:  swarm bench navigation --families pairs,traps

    Example:  swarm bench navigation --families pairs,traps --without memory

    Example:  swarm bench navigation --families disturbed --sizes 16,0.215m --seeds 0-9
    """
    from swarm.run import bench as benchmarks

    if names == [benchmarks.NAVIGATION]:
        _bench_navigation(families, sizes, controllers, seeds, without, data, out, tiny, as_json)
        return
    for flag, value in (
        ("--families", families),
        ("--sizes", sizes),
        ("--controllers", controllers),
        ("--seeds", seeds),
        ("--without", without),
        ("--data", data),
        ("--out", out),
    ):
        if value is not None:
            raise errors.UsageError(
                f"{flag}: expected `swarm bench {benchmarks.NAVIGATION}` alone, "
                f"got {' '.join(names or []) or 'no name'}"
            )
    found = benchmarks.run(names or [], tiny=tiny, progress=front.say)
    if as_json:
        options.print_json(found)
    else:
        benchmarks.show(found)
    if not all(row.ok for row in found.rows):
        raise typer.Exit(1)


def _bench_navigation(
    families: str | None,
    sizes: str | None,
    controllers: str | None,
    seeds: str | None,
    without: str | None,
    data: Path | None,
    out: Path | None,
    tiny: bool,
    as_json: bool,
) -> None:
    from swarm.run import bench as benchmarks
    from swarm.run.bench import navigation
    from swarm.run.bench.navigation import table

    folder = navigation.DATA if data is None else data
    plan = navigation.plan(
        families=families,
        sizes=sizes,
        controllers=controllers,
        seeds=seeds,
        without=without,
        folder=folder,
        tiny=tiny,
    )
    with Bar(benchmarks.NAVIGATION) as bar:
        found = navigation.measure(plan, out, bar.advance)
    if as_json:
        options.print_json(found)
    else:
        table.show(found)
    if found.partial:
        raise typer.Exit(130)
    if found.crashed:
        raise typer.Exit(1)


def reproduce(
    names: Annotated[
        list[str] | None, Argument(metavar="[FIGURE]...", help="fig10 to fig18; all when none.")
    ] = None,
    bus: Annotated[
        Literal["zenoh", "memory"], Option(help="Memory: every run in this process, quicker.")
    ] = "zenoh",
    out: Annotated[Path | None, Option(metavar="DIR", help="Folder of pictures and page.")] = None,
    as_json: options.Json = False,
    seeds: Annotated[
        int | None, Option(min=1, max=100, help="Random fields of Fig. 10 and 11, if not 8.")
    ] = None,
) -> None:
    """Run the paper's experiments again, draw its figures, check its claims.

    Exit code 1 when a claim is not met.

    Example:  swarm reproduce fig13 fig14 --bus memory --out figures
    """
    from swarm.run import reproduce as reproduction  # with matplotlib: only who draws pays

    reproduction.check_names(names or [])
    folder = _reproduction_folder(out)
    setproctitle.setproctitle("swarm-run")

    def conduct(experiment: reproduction.Experiment, into: Path) -> reproduction.Conducted:
        name, where, data = library.read_scenario(experiment.scenario)
        settings = [*experiment.settings, "recording.mcap=true", "recording.rerun=false"]
        plan = scenarios.decode(data, where, settings=settings, seed=experiment.seed)
        toml = tomli_w.dumps(scenarios.to_builtins(plan)).encode()
        runs.new_folder(into, name)
        (into / runs.SCENARIO).write_bytes(toml)
        order = supervisor.Plan(
            scenario=plan, scenario_toml=toml, name=name, folder=into, run=runs.new_run_id(into)
        )
        ended = launch.conduct(order, bus, supervisor.Watcher())
        if ended.interrupted:
            raise KeyboardInterrupt
        return reproduction.Conducted(ended.summary, ended.problem)

    found = reproduction.run(
        names or [],
        conduct,
        folder,
        bus=bus,
        seeds=reproduction.SEEDS if seeds is None else seeds,
        progress=front.say,
    )
    if as_json:
        options.print_json(found)
    else:
        reproduction.show(found)
    for problem in found.problems:
        front.say(f"swarm: {problem}")
    if not found.ok:
        raise typer.Exit(1)


def _reproduction_folder(out: Path | None) -> Path:
    """Folder for figures; raises UsageError when some are there already."""
    if out is not None and out.is_dir() and any(out.iterdir()):
        raise errors.UsageError(
            f"--out {out}: expected an empty folder or none, got one with files in it; "
            "choose another or remove it"
        )
    folder = runs.new_folder(out, "reproduce")
    (folder / runs.LOGS).rmdir()  # every run inside has its own
    return folder
