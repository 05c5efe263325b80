"""Verbs for one process by hand, and what is installed."""

from __future__ import annotations

import importlib.metadata
import platform
from pathlib import Path
from typing import Annotated

import tomli_w
import typer
from typer import Argument, Option

from swarm import runs
from swarm import scenario as scenarios
from swarm.run import front, launch, library
from swarm.run.cli import live, options, running


def world_(
    scenario: options.Scenario,
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
    running.report(launch.Conducted(launch.summary_of(folder, name, run_id)), folder, False)


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
        card = live.pick(None)
        run_id, connect = card.run, card.endpoint
        if tls is None and card.tls:
            tls = Path(card.tls)
    arguments = agents.process.Arguments(
        run=run_id, endpoint=connect, name=name, incarnation=incarnation, tls=tls
    )
    code = agents.process.main(arguments)
    if code != 0:
        raise typer.Exit(code)


def version(as_json: options.Json = False) -> None:
    """Print the versions of everything that matters.

    Example:  swarm version --json
    """
    names = ("msam-swarm", "eclipse-zenoh", "rerun-sdk", "mcap", "numpy", "msgspec")
    rows = {name: importlib.metadata.version(name) for name in names}
    rows["python"] = platform.python_version()
    if as_json:
        options.print_json(rows)
    else:
        for name, number in rows.items():
            print(f"{name:<14} {number}")
