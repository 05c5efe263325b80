"""The command line: every verb of `swarm`, its flags, and what its exit code means.

0  it worked      1  the run failed, or a threshold was broken
2  a flag, a name or a file is wrong      130  interrupted
"""

from __future__ import annotations

import importlib.metadata
import importlib.resources
import io
import os
import platform
import sys
import time
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import setproctitle
import tomli_w
import typer
from typer import Argument, Option

from swarm import errors, messages, recording, runs, zenoh_bus
from swarm import scenario as scenarios
from swarm.run import front, launch, library, supervisor

STOP_TIMEOUT_S = 10.0
ASK_TIMEOUT_S = 2.0

app = typer.Typer(
    name="swarm",
    help=(
        "Robot swarms as real processes: run them, watch them, break them, replay them.\n\n"
        "Start with:  swarm run two-obstacles"
    ),
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="Exit codes: 0 ok, 1 run failed or threshold broken, 2 usage, 130 interrupted.",
)

Json = Annotated[bool, Option("--json", help="Print one JSON object on standard output.")]
Run = Annotated[Path, Argument(metavar="RUN", help="A run's folder, or its run.mcap.")]
RunId = Annotated[
    str | None,
    Option("--run", metavar="ID", help="Which one, if several run; its first letters do."),
]


def main() -> None:
    """Run the verb of the command line and exit with its code."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # None when it was closed
            stream.reconfigure(errors="backslashreplace")
    code = 0
    try:
        app()
    except errors.SwarmError as error:
        front.say(f"swarm: {error}")
        code = error.exit_code
    except KeyboardInterrupt:
        code = 130
    except BrokenPipeError:  # `swarm ... | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    except OSError as error:  # /dev/full as standard output, a name that is too long
        front.say(f"swarm: {error.filename or 'standard output'}: {error.strerror}")
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        code = 1
    raise SystemExit(code)


@app.command("scenarios")
def list_scenarios(as_json: Json = False) -> None:
    """List the built-in scenarios."""
    rows = []
    for name, resource in library.built_in().items():
        plan = scenarios.decode(resource.read_bytes(), f"{name}.toml")
        rows.append({"name": name, "robots": len(plan.robots), "title": plan.title})
    if as_json:
        _print_json({"scenarios": rows})
        return
    for row in rows:
        print(f"{row['name']:<18} {row['robots']:>3} robots  {row['title']}")


@app.command()
def validate(
    files: Annotated[list[str], Argument(metavar="FILE...", help="TOML files or built-in names.")],
    as_json: Json = False,
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
        _print_json({"files": rows})
    else:
        for row in rows:
            print(f"{row['file']}: ok, {row['robots']} robots" if row["ok"] else row["error"])
    if not all(row["ok"] for row in rows):
        raise typer.Exit(2)


# --- run ----------------------------------------------------------------------------------------


@app.command()
def run(
    scenario: Annotated[str, Argument(help="A built-in scenario's name, or a TOML file.")],
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
    as_json: Json = False,
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
            _print_json(scenarios.to_builtins(plan))
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
    _report(ended, folder, as_json)


def _report(ended: launch.Conducted, folder: Path, as_json: bool) -> None:
    """Print the outcome and exit with its code, naming all that failed."""
    summary = ended.summary
    if as_json:
        _print_json(summary)
    else:
        front.show_summary(summary, str(folder))
    failed = [ended.problem] if ended.problem else []
    if summary.outcome != "succeeded":
        failed.append(f"outcome: expected succeeded, got {summary.outcome}")
    failed += [f"missed: {text}" for text in summary.expect.missed]
    if summary.recording is not None and summary.recording.lost:
        last = recording.verify(folder / runs.MCAP).last_tick
        failed.append(
            f"recording: {summary.recording.lost} messages lost, whole up to tick {last} of "
            f"{summary.ticks}; see swarm verify {folder}"
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


# --- what runs now ------------------------------------------------------------------------------


def _pick(run_id: str | None) -> runs.Card:
    cards = runs.running()
    exact = [card for card in cards if card.run == run_id]
    matching = exact or [card for card in cards if card.run.startswith(run_id or "")]
    if len(matching) == 1:
        return matching[0]
    known = ", ".join(card.run for card in cards) or "none"
    if not matching:
        wanted = f"the run '{run_id}'" if run_id else "a running swarm"
        raise errors.SwarmError(f"expected {wanted}, got: {known}")
    raise errors.UsageError(f"expected --run with one of the swarms that run: {known}")


def _ask(card: runs.Card, action: Literal["status", "stop"]) -> messages.Status:
    with_bus = zenoh_bus.open_client(
        card.run,
        card.endpoint,
        name="supervisor",
        tls=Path(card.tls) if card.tls else None,
        connect_timeout_s=ASK_TIMEOUT_S,
    )
    try:
        reply = with_bus.ask(messages.CONTROL, messages.ControlRequest(action), ASK_TIMEOUT_S)
        return msgspec.msgpack.decode(reply.body, type=messages.Status)
    except msgspec.DecodeError as error:
        raise errors.BusError(f"{card.run}: expected a status, got: {error}") from error
    finally:
        with_bus.close()


@app.command()
def status(run_id: RunId = None, as_json: Json = False) -> None:
    """Show the swarms that run now. Exit code 1 when there is none.

    Example:  swarm status --json
    """
    cards = runs.running() if run_id is None else [_pick(run_id)]
    if not cards and not as_json:
        raise errors.SwarmError("expected a running swarm, got none")
    rows = []
    for card in cards:
        try:
            rows.append((card, _ask(card, "status")))
        except errors.SwarmError as error:
            front.say(f"swarm: {card.run}: {error}")
    if as_json:
        _print_json({"runs": [{"card": card, "status": answer} for card, answer in rows]})
    else:
        for card, answer in rows:
            print(f"{card.run}  pid {card.pid}  {card.endpoint}  {card.folder}")
            front.show_status(answer)
    if not rows:
        raise typer.Exit(1)


@app.command()
def stop(run_id: RunId = None, as_json: Json = False) -> None:
    """Stop a running swarm; its recording is completed.

    Example:  swarm stop --run 20260101T120000Z-two-obstacles
    """
    card = _pick(run_id)
    _ask(card, "stop")
    deadline_s = time.monotonic() + STOP_TIMEOUT_S
    while runs.is_alive(card):
        if time.monotonic() >= deadline_s:
            raise errors.SwarmError(
                f"{card.run}: expected it to end within {STOP_TIMEOUT_S:g} s, "
                f"got pid {card.pid} that still runs; end it with kill {card.pid}"
            )
        time.sleep(0.05)
    if as_json:
        _print_json({"run": card.run, "stopped": True})
    else:
        print(f"{card.run}: stopped")


# --- recordings ---------------------------------------------------------------------------------


@app.command()
def verify(
    path: Run,
    repair: Annotated[
        bool, Option("--repair", help="Write a good file; keep the old one.")
    ] = False,
    as_json: Json = False,
) -> None:
    """Check a recording: is it whole, undamaged, without a gap? Exit code 1 when not.

    Example:  swarm verify runs/20260101T120000Z-two-obstacles --repair
    """
    target = runs.recording(path)
    repaired = recording.repair(target) if repair else None
    verdict = recording.verify(target)
    if as_json:
        _print_json({"verdict": verdict, "repair": repaired})
    else:
        for line in (*(repaired.text if repaired is not None else ()), *verdict.text):
            print(line)
    if not verdict.ok:
        raise typer.Exit(1)


@app.command("replay")
def replay_(
    path: Run,
    robot: Annotated[str | None, Option(help="Only this one.")] = None,
    as_json: Json = False,
) -> None:
    """Run every robot again on its recorded frames; exit code 1 when one does something else.

    Example:  swarm replay runs/20260101T120000Z-two-obstacles --robot robot3
    """
    from swarm.run import replay

    found = replay.replay(runs.recording(path), robot)
    if as_json:
        _print_json(found)
    else:
        print(f"{found.ticks} ticks, {found.commands} commands replayed")
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


# --- by hand, and about -------------------------------------------------------------------------


@app.command("world")
def world_(
    scenario: Annotated[str, Argument(help="A built-in scenario's name, or a TOML file.")],
    listen: Annotated[str, Option(help="Endpoint of the router inside.")] = "tcp/127.0.0.1:7447",
    router: Annotated[
        str | None, Option(metavar="ENDPOINT", help="Use this router instead.")
    ] = None,
    run_name: Annotated[str | None, Option("--run", metavar="ID", help="Id of the run.")] = None,
    out: Annotated[Path | None, Option(metavar="DIR", help="Folder of the run.")] = None,
    settings: Annotated[
        list[str] | None, Option("--set", metavar="PATH=VALUE", help="Change a tunable.")
    ] = None,
    robots: Annotated[int | None, Option(help="How many robots.")] = None,
    tls: Annotated[Path | None, Option(metavar="DIR", help="Certificates.")] = None,
) -> None:
    """Run one world by hand; robots join with `swarm robot`.

    Example:  swarm world two-obstacles --run test --listen tcp/127.0.0.1:7447
    """
    import world.process

    name, where, data = library.read_scenario(scenario)
    plan = scenarios.decode(data, where, settings=settings or [], robots=robots)
    library.check_scene(plan, where)
    toml = tomli_w.dumps(scenarios.to_builtins(plan)).encode()
    folder = runs.new_folder(out, name)
    (folder / runs.SCENARIO).write_bytes(toml)
    endpoint = router or listen
    run_id = run_name or runs.new_run_id(folder)
    front.say(f"swarm-world: run {run_id} on {endpoint}, waiting for {len(plan.robots)} robots")
    arguments = world.process.Arguments(
        run=run_id,
        name=name,
        scenario_toml=toml,
        endpoint=endpoint,
        folder=folder,
        external_router=router is not None,
        tls=tls,
    )
    with runs.posted(runs.card_of(run_id, name, endpoint, folder, tls), folder):
        code = world.process.main(arguments)
    if code != 0:
        raise typer.Exit(1)
    _report(launch.Conducted(launch.summary_of(folder, name, run_id)), folder, False)


@app.command("robot")
def robot_(
    name: Annotated[str, Argument(help="Its name in the scenario.")],
    connect: Annotated[str, Option(help="The router's endpoint.")] = "tcp/127.0.0.1:7447",
    run_id: Annotated[str | None, Option("--run", metavar="ID", help="Id of the run.")] = None,
    incarnation: Annotated[int, Option(min=0, help="How often it was started before.")] = 0,
    tls: Annotated[Path | None, Option(metavar="DIR", help="Certificates.")] = None,
) -> None:
    """Run one robot by hand, here or on another host; it asks the world for its scenario.

    Example:  swarm robot robot3 --run test --connect tcp/127.0.0.1:7447
    """
    import agents.process

    if run_id is None:
        card = _pick(None)
        run_id, connect = card.run, card.endpoint
        if tls is None and card.tls:
            tls = Path(card.tls)
    arguments = agents.process.Arguments(
        run=run_id, endpoint=connect, name=name, incarnation=incarnation, tls=tls
    )
    code = agents.process.main(arguments)
    if code != 0:
        raise typer.Exit(code)


@app.command()
def bench(
    names: Annotated[list[str] | None, Argument(metavar="[NAME]...", help="Which ones.")] = None,
    tiny: Annotated[
        bool, Option("--tiny", help="Smallest sizes, to see that all of it runs.")
    ] = False,
    families: Annotated[
        str | None, Option(metavar="A,B", help="navigation: which families of runs.")
    ] = None,
    controllers: Annotated[
        str | None, Option(metavar="A,B", help="navigation: paper, extended or both.")
    ] = None,
    seeds: Annotated[
        str | None, Option(metavar="A-B", help="navigation: which instances of each family.")
    ] = None,
    data: Annotated[
        Path | None, Option(metavar="DIR", help="navigation: where public benchmark data is.")
    ] = None,
    out: Annotated[
        Path | None, Option(metavar="DIR", help="navigation: folder for the worst runs' scenarios.")
    ] = None,
    as_json: Json = False,
) -> None:
    """Measure what a swarm costs, as ratios within one run; or how well it finds its way.

    `navigation` is asked for by name: its full size takes hours. It fails only when a run crashes.

    Example:  swarm bench barrier step

    Example:  swarm bench navigation --families pairs,traps
    """
    from swarm.run import bench as benchmarks

    if names == [benchmarks.NAVIGATION]:
        _bench_navigation(families, controllers, seeds, data, out, tiny, as_json)
        return
    for flag, value in (
        ("--families", families),
        ("--controllers", controllers),
        ("--seeds", seeds),
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
        _print_json(found)
    else:
        benchmarks.show(found)
    if not all(row.ok for row in found.rows):
        raise typer.Exit(1)


def _bench_navigation(
    families: str | None,
    controllers: str | None,
    seeds: str | None,
    data: Path | None,
    out: Path | None,
    tiny: bool,
    as_json: bool,
) -> None:
    from swarm.run.bench import navigation
    from swarm.run.bench.navigation import table

    folder = navigation.DATA if data is None else data
    plan = navigation.plan(
        families=families, controllers=controllers, seeds=seeds, folder=folder, tiny=tiny
    )
    with table.Bar() as bar:
        found = navigation.measure(plan, out, bar.advance)
    if as_json:
        _print_json(found)
    else:
        table.show(found)
    if found.crashed:
        raise typer.Exit(1)


@app.command()
def reproduce(
    names: Annotated[
        list[str] | None, Argument(metavar="[FIGURE]...", help="fig10 to fig18; all when none.")
    ] = None,
    bus: Annotated[
        Literal["zenoh", "memory"], Option(help="Memory: every run in this process, quicker.")
    ] = "zenoh",
    out: Annotated[Path | None, Option(metavar="DIR", help="Folder of pictures and page.")] = None,
    as_json: Json = False,
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
        _print_json(found)
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


@app.command()
def version(as_json: Json = False) -> None:
    """Print the versions of everything that matters."""
    names = ("msam-swarm", "eclipse-zenoh", "rerun-sdk", "mcap", "numpy", "msgspec")
    rows = {name: importlib.metadata.version(name) for name in names}
    rows["python"] = platform.python_version()
    if as_json:
        _print_json(rows)
    else:
        for name, number in rows.items():
            print(f"{name:<14} {number}")


def _print_json(value: Any) -> None:
    print(msgspec.json.encode(value).decode(), flush=True)
