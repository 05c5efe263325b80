"""The verb that looks for what stops the swarm."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import msgspec
import setproctitle
import typer
from typer import Option

from swarm import errors, runs
from swarm import scenario as scenarios
from swarm.run import front, library
from swarm.run.bar import Bar
from swarm.run.cli import options

REPORT = "chaos.json"
SEED_MAX = 2**53


def chaos(
    scenario: options.Scenario,
    count: Annotated[int, Option("--runs", min=1, max=1_000_000, help="How many.")] = 100,
    seed: Annotated[
        int, Option(min=0, max=SEED_MAX, help="Of the faults; the scenario keeps its own.")
    ] = 1,
    bus: Annotated[
        Literal["memory", "zenoh"], Option(help="Zenoh: real processes, one run at a time.")
    ] = "memory",
    everything: Annotated[
        bool, Option("--all", help="Also faults that nobody need survive.")
    ] = False,
    settings: Annotated[
        list[str] | None, Option("--set", metavar="PATH=VALUE", help="Change a tunable.")
    ] = None,
    out: Annotated[Path | None, Option(metavar="DIR", help="Folder for what is found.")] = None,
    as_json: options.Json = False,
) -> None:
    """Let faults strike at random, by the seed, and check what must hold all the same.

    Nobody touches anything; one leader for each group; once the faults are over, all who live
    arrive. What breaks is made as small as it gets and shown as one `swarm run` line.

    Examples:
      swarm chaos two-obstacles --runs 200 --seed 1
      swarm chaos two-obstacles --runs 10 --bus zenoh
    """
    from swarm.run.chaos import campaign, table

    _, where, data = library.read_scenario(scenario)
    plan = scenarios.decode(data, where, settings=settings or [])
    library.check_scene(plan, where)
    if plan.clock.mode != "lockstep":
        raise errors.UsageError(f"{where}: expected clock.mode lockstep, got {plan.clock.mode}")
    setproctitle.setproctitle("swarm-run")
    folder = runs.new_folder(out, f"chaos-{Path(scenario).stem}")
    (folder / runs.LOGS).rmdir()
    order = campaign.Order(
        scenario=plan,
        given=scenario,
        settings=tuple(settings or ()),
        runs=count,
        seed=seed,
        bus=bus,
        everything=everything,
    )
    front.say(f"chaos: the schedules of all runs are in {folder}/schedules.txt")
    with Bar("chaos") as bar:
        found = campaign.conduct(order, folder, bar.advance, front.say)
    (folder / REPORT).write_bytes(msgspec.json.format(msgspec.json.encode(found)))
    if as_json:
        options.print_json(found)
    else:
        table.show(found)
    if not found.ok:
        raise typer.Exit(1)
