"""Verbs that carry out a scenario, and look at scenarios."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import setproctitle
import tomli_w
import typer
from typer import Argument, Option

from swarm import errors, recording, runs
from swarm import scenario as scenarios
from swarm.run import front, launch, library, supervisor
from swarm.run.cli import complete, options


def list_scenarios(as_json: options.Json = False) -> None:
    """List the built-in scenarios.

    Example:  swarm scenarios --json
    """
    rows = []
    for name, resource in library.built_in().items():
        plan = scenarios.decode(resource.read_bytes(), f"{name}.toml")
        rows.append({"name": name, "robots": len(plan.robots), "title": plan.title})
    if as_json:
        options.print_json({"scenarios": rows})
        return
    for row in rows:
        print(f"{row['name']:<18} {row['robots']:>3} robots  {row['title']}")


def validate(
    files: Annotated[
        list[str],
        Argument(
            metavar="FILE...",
            help="TOML files or built-in names.",
            autocompletion=complete.scenarios,
        ),
    ],
    as_json: options.Json = False,
) -> None:
    """Check scenarios without starting anything.

    Example:  swarm validate my.toml two-obstacles
    """
    rows = []
    for text in files:
        try:
            name, where, data = library.read_scenario(text)
            plan = scenarios.decode(data, where)
            library.check_scene(plan, where)
            rows.append({"file": text, "ok": True, "name": name, "robots": len(plan.robots)})
        except errors.ScenarioError as error:
            rows.append({"file": text, "ok": False, "error": str(error)})
    if as_json:
        options.print_json({"files": rows})
    else:
        for row in rows:
            print(f"{row['file']}: ok, {row['robots']} robots" if row["ok"] else row["error"])
    if not all(row["ok"] for row in rows):
        raise typer.Exit(2)


def run(
    scenario: options.Scenario,
    robots: Annotated[
        int | None, Option(help="How many robots (of a line, or the first N).")
    ] = None,
    seed: Annotated[int | None, Option(help="Another seed than the scenario's.")] = None,
    duration: Annotated[float | None, Option(help="Simulated seconds, then it is over.")] = None,
    settings: Annotated[
        list[str] | None, Option("--set", metavar="PATH=VALUE", help="Change a tunable.")
    ] = None,
    clock: Annotated[
        Literal["lockstep", "realtime"] | None,
        Option(help="Lock-step waits for every robot and repeats exactly."),
    ] = None,
    rate: Annotated[
        float | None, Option(help="x real time; 0: as fast as it goes. With a viewer: 1.")
    ] = None,
    bus: Annotated[
        Literal["zenoh", "memory"], Option(help="Memory: the same swarm in one process.")
    ] = "zenoh",
    fault: Annotated[
        list[str] | None,
        Option(metavar="SPEC", help="kind:target@start_s, such as kill:robot3@9.6"),
    ] = None,
    view: Annotated[
        Literal["none", "web", "native"], Option(help="Watch it live in Rerun.")
    ] = "none",
    foxglove: Annotated[
        bool, Option("--foxglove", help="Serve it live to Foxglove on loopback.")
    ] = False,
    out: Annotated[Path | None, Option(metavar="DIR", help="Folder of the run.")] = None,
    as_json: options.Json = False,
    quiet: Annotated[bool, Option("--quiet", "-q", help="No progress.")] = False,
    stop_after: Annotated[
        float | None, Option(metavar="S", help="Wall seconds, then stop with exit code 1.")
    ] = None,
    dry_run: Annotated[bool, Option("--dry-run", help="Print what would run, and stop.")] = False,
    router: Annotated[
        str | None, Option(metavar="ENDPOINT", help="Use this Zenoh router, not the world's own.")
    ] = None,
    tls: Annotated[
        Path | None, Option(metavar="DIR", help="ca.pem and NAME.pem, NAME.key of every process.")
    ] = None,
) -> None:
    """Launch the world and its robots, watch them, and report.

    Examples:
      swarm run two-obstacles
      swarm run two-obstacles --view web --rate 1
      swarm run two-obstacles --fault kill:robot3@9.6
      swarm run my.toml --set field.k_e=1.0 --seed 3 --json
    """
    name, where, data = library.read_scenario(scenario)
    changes = list(settings or [])
    if clock is not None:
        changes.append(f'clock.mode="{clock}"')
    if rate is None and (view != "none" or foxglove):
        changes.insert(0, "clock.rate=1.0")
    elif rate is not None:
        changes.append(f"clock.rate={rate}")
    plan = scenarios.decode(
        data,
        where,
        settings=changes,
        faults=fault or [],
        robots=robots,
        seed=seed,
        duration_s=duration,
    )
    library.check_scene(plan, where)
    launch.check_flags(
        plan,
        bus=bus,
        watched=view != "none" or foxglove,
        router=router,
        tls=tls,
        stop_after_s=stop_after,
    )
    launch.check_display(view)
    toml = tomli_w.dumps(scenarios.to_builtins(plan)).encode()
    if dry_run:
        if as_json:
            options.print_json(scenarios.to_builtins(plan))
        else:
            print(toml.decode(), end="")
        return
    setproctitle.setproctitle("swarm-run")
    folder = runs.new_folder(out, name)
    try:
        (folder / runs.SCENARIO).write_bytes(toml)
    except OSError as error:
        raise errors.UsageError(
            f"{folder}: expected room for a file, got: {error.strerror}"
        ) from error
    watcher = supervisor.Watcher() if quiet else front.Progress()
    order = supervisor.Plan(
        scenario=plan,
        scenario_toml=toml,
        name=name,
        folder=folder,
        run=runs.new_run_id(folder),
        router=router,
        tls=tls,
        view=view,
        foxglove=foxglove,
        stop_after_s=stop_after,
    )
    try:
        ended = launch.conduct(order, bus, watcher)
    finally:
        watcher.close()
    report(ended, folder, as_json)


def report(ended: launch.Conducted, folder: Path, as_json: bool) -> None:
    """Print the outcome and exit with its code, naming all that failed."""
    summary = ended.summary
    if as_json:
        options.print_json(summary)
    else:
        front.show_summary(summary, str(folder))
    failed = [ended.problem] if ended.problem else []
    if summary.outcome != "succeeded":
        failed.append(f"outcome: expected succeeded, got {summary.outcome}")
    failed += [f"missed: {text}" for text in summary.expect.missed]
    if summary.recording is not None and summary.recording.lost:
        gaps = recording.verify(folder / runs.MCAP, summary.ticks).gaps
        failed.append(
            f"recording: {summary.recording.lost} messages lost, of ticks "
            f"{', '.join(map(str, gaps)) or 'none'}; see swarm verify {folder}"
        )
    if ended.overtime:
        failed.append("stopped by --stop-after")
    for text in failed:
        front.say(f"swarm: {text}")
    if ended.interrupted:
        mended = f"mend the recording with: swarm verify {folder} --repair"
        front.say(
            "swarm: interrupted; "
            + (mended if ended.problem else "the recording is complete up to here")
        )
        raise typer.Exit(130)
    if failed:
        raise typer.Exit(1)
