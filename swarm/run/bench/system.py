"""The product's own processes with a meter inside: N robots, and a world that records now and then.

    world: conductor --record--> Gate --every other window--> MCAP, Rerun
                                   '--> Meter

Windows without and with recording take turns in one run, so both see the same machine. In these
children the functions of the cores are timed where they are called, into a file that all of them
map (2 us per robot and tick). The supervisor is left out: it sleeps, and wakes ten times a second.
"""

from __future__ import annotations

import os
import time
import types
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import numpy.typing as npt
import tomli_w

import agents.process
import agents.robot
from swarm import lifetime, metrics, runs, scenario, zenoh_bus
from swarm.messages import TickRecord
from swarm.run import child
from swarm.run.bench import processes, rehearsal
from swarm.run.bench.processes import Window
from swarm.scenario import Recording
from world import conductor, simulation

SCENARIO = "empty"
LONG = "duration_s=1e6"  # the windows end it
RUN = "bench"
OWN = "own"  # file name
# what the world computes in a tick, whatever carries its messages
CORES = (
    (simulation, "sense"),
    (simulation, "step"),
    (simulation, "record"),
    (metrics, "observe"),
)


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
    endpoint = f"tcp/127.0.0.1:{child.free_port()}"
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
        np.zeros(robots + 1, dtype=np.float64).tofile(children.folder / OWN)
        children.start("world", world, system, children.child_end)
        for number, row in enumerate(plan.robots):
            arguments = agents.process.Arguments(
                run=RUN,
                endpoint=endpoint,
                name=row.name,
                log=children.log(row.name),
                supervisor_pid=os.getpid(),
            )
            children.start(row.name, robot, arguments, children.folder / OWN, number)
        windows = children.windows()
    return Turns(windows[::2], windows[1::2])


def world(system: System, end: Connection) -> None:
    """World process: conduct until all windows have passed."""
    stop = lifetime.Stop()
    lifetime.adopt("world", system.folder / "world.log", stop, system.bench_pid)
    plan = scenario.decode(system.scenario_toml, runs.SCENARIO)
    own_s = _own(system.folder / OWN)
    for module, name in CORES:
        _time(module, name, own_s, len(plan.robots))
    meter = processes.Meter(
        end, 2 * system.turns, system.window_s, system.settle_s, lambda: float(own_s.sum())
    )
    bus = zenoh_bus.open_router(RUN, system.endpoint)
    from world.watchers import Watchers  # with Rerun, which a robot has not loaded either

    watchers = Watchers(bus, plan, system.folder)
    watchers.open(system.scenario_toml, None, None)

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


def robot(arguments: agents.process.Arguments, own: Path, row: int) -> None:
    """Robot process."""
    _time(agents.robot, "step", _own(own), row)
    agents.process.main(arguments)


def _own(path: Path) -> npt.NDArray[np.float64]:
    """(robots + 1,) CPU seconds of the cores so far, the world's last; shared by all children."""
    return np.memmap(path, dtype=np.float64, mode="r+")


def _time(module: types.ModuleType, name: str, own_s: npt.NDArray[np.float64], row: int) -> None:
    """Let a function of a module note the CPU of its calls, in this process."""
    function = getattr(module, name)

    def timed(*arguments: Any) -> Any:
        begin_s = time.thread_time()
        try:
            return function(*arguments)
        finally:
            own_s[row] += time.thread_time() - begin_s

    setattr(module, name, timed)
