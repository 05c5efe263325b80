"""The product's own processes with a meter inside: N robots, and a world that records now and then.

    world: conductor --record--> Gate --every other window--> MCAP, Rerun
                                   '--> Meter

Windows without and with recording take turns in one run, so both see the same machine. The
supervisor is left out: it sleeps, and wakes ten times a second.
"""

from __future__ import annotations

import os
from multiprocessing.connection import Connection
from pathlib import Path

import msgspec
import tomli_w

import agents.process
from swarm import lifetime, runs, scenario, zenoh_bus
from swarm.messages import TickRecord
from swarm.run import supervisor
from swarm.run.bench import processes, rehearsal
from swarm.run.bench.processes import Window
from swarm.scenario import Recording
from world import conductor
from world.watchers import Watchers

SCENARIO = "empty"
LONG = "duration_s=1e6"  # the windows end it
RUN = "bench"


class System(msgspec.Struct, frozen=True):
    """What the world is told."""

    scenario_toml: bytes
    endpoint: str
    folder: Path
    bench_pid: int
    turns: int
    window_s: float
    settle_s: float


class Turns(msgspec.Struct, frozen=True):
    """Windows of one run, in the order they were."""

    plain: tuple[Window, ...]
    recorded: tuple[Window, ...]


def measure(robots: int, *, turns: int, window_s: float, settle_s: float) -> Turns:
    """Launch, let windows without and with recording take turns, end."""
    quiet = rehearsal.built_in(SCENARIO, robots=robots, settings=[LONG])
    plan = msgspec.structs.replace(quiet, recording=Recording())
    endpoint = f"tcp/127.0.0.1:{supervisor._free_port()}"
    with processes.Children() as children:
        system = System(
            scenario_toml=tomli_w.dumps(scenario.to_builtins(plan)).encode(),
            endpoint=endpoint,
            folder=children.folder,
            bench_pid=os.getpid(),
            turns=turns,
            window_s=window_s,
            settle_s=settle_s,
        )
        children.start("world", world, system, children.child_end)
        for row in plan.robots:
            arguments = agents.process.Arguments(
                run=RUN,
                endpoint=endpoint,
                name=row.name,
                log=children.log(row.name),
                supervisor_pid=os.getpid(),
            )
            children.start(row.name, agents.process.main, arguments)
        windows = children.windows()
    return Turns(windows[::2], windows[1::2])


def world(system: System, end: Connection) -> None:
    """World process: conduct until all windows have passed."""
    stop = lifetime.Stop()
    lifetime.adopt("world", system.folder / "world.log", stop, system.bench_pid)
    plan = scenario.decode(system.scenario_toml, runs.SCENARIO)
    meter = processes.Meter(end, 2 * system.turns, system.window_s, system.settle_s)
    bus = zenoh_bus.open_router(RUN, system.endpoint)
    watchers = Watchers(bus, plan)
    watchers.open(system.scenario_toml, system.folder, None, None)

    def gate(record: TickRecord) -> None:
        if meter.number % 2:
            watchers.observe(record)
        if meter.look(record.tick):
            stop.request("measured")

    try:
        conductor.conduct(bus, plan, [gate], stop)
    finally:
        watchers.close()
        bus.close()
