"""CPU per robot and tick of the whole system, over a bare Zenoh barrier of the same payloads.

    bare               N + 1 processes that only exchange bytes: the floor
    whole              N robots and a world that do nothing but tick (scenario `empty`)
    whole, recorded    with MCAP and Rerun
    whole less own     without what robots and world compute, whatever carries their messages

The supervisor is left out: it sleeps, and wakes ten times a second. What the cores need for
themselves is measured on one thread with warm caches, so what they need more as N + 1 processes
that push each other off two cores counts as the barrier's.
"""

from __future__ import annotations

import os
import statistics
import tempfile
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path

import msgspec
import tomli_w

import agents.process
import world.process
from agents import robot
from swarm import lifetime, messages, metrics, scenario, zenoh_bus
from swarm.messages import COMMAND, FRAME, Status
from swarm.run import supervisor
from swarm.run.bench import bare, figures, processes, rehearsal
from swarm.run.bench.figures import Row
from swarm.run.bench.processes import Window
from swarm.run.bench.rehearsal import Moment, Rehearsal
from world import simulation

SCENARIO = "empty"
LONG = 'duration_s=1e6'  # the window ends it
RUN = "bench"
OVER_BARE_MAX = 1.6  # whole less own, design budget
OVER_SMALLEST_MAX = 1.4  # whole, most robots over fewest, design budget
SETTLE_TICKS = 5  # until every robot has heard all others
REHEARSED_TICKS = 25
PASSES = 5


class System(msgspec.Struct, frozen=True):
    """What the world of a whole system is told."""

    scenario_toml: bytes
    endpoint: str
    folder: Path
    bench_pid: int
    robot_pids: list[int]
    window_s: float


def measure(*, tiny: bool, progress: Callable[[str], None]) -> tuple[Row, ...]:
    """Rows of every N."""
    sizes = (2,) if tiny else (6, 20, 50)
    rounds = 1 if tiny else 3
    window_s = 0.3 if tiny else 1.5
    rows: list[Row] = []
    whole: dict[int, list[float]] = {}
    for size in sizes:
        seen = rehearsal.rehearse(
            rehearsal.built_in(SCENARIO, robots=size, settings=[LONG]), REHEARSED_TICKS
        )
        floors, whole[size], recorded, less, parts = [], [], [], [], []
        for number in range(rounds):
            progress(f"barrier: {size} robots, round {number + 1} of {rounds}")
            floors.append(bare_barrier(seen, window_s).cpu_us)
            whole[size].append(whole_system(size, window_s, recorded=False).cpu_us)
            recorded.append(whole_system(size, window_s, recorded=True).cpu_us)
            parts.append(own_us(seen))
            less.append(whole[size][-1] - sum(parts[-1][name] for name in OWN))
        over = "bare barrier"
        rows += [
            figures.row("barrier: bare", size, floors, "us"),
            figures.row("barrier: whole", size, whole[size], "us", floors=floors, over=over),
            figures.row(
                "barrier: whole, recorded",
                size,
                recorded,
                "us",
                floors=whole[size],
                over="not recorded",
            ),
            figures.row(
                "barrier: whole less own",
                size,
                less,
                "us",
                floors=floors,
                over=over,
                budget=OVER_BARE_MAX,
                bound="ratio <=",
            ),
            *(
                figures.row(
                    f"barrier: of it {name}",
                    size,
                    [part[name] for part in parts],
                    "us",
                    floors=whole[size],
                    over="whole",
                )
                for name in PARTS
            ),
        ]
    rows.append(
        figures.row(
            "barrier: whole, growth",
            sizes[-1],
            whole[sizes[-1]],
            "us",
            floors=whole[sizes[0]],
            over=f"{sizes[0]} robots",
            budget=OVER_SMALLEST_MAX,
            bound="ratio <=",
        )
    )
    return tuple(rows)


# --- processes ----------------------------------------------------------------------------------


def bare_barrier(seen: Rehearsal, window_s: float) -> Window:
    """Floor with the payloads of a rehearsed run."""
    last = seen.moments[-1]
    barrier = bare.Barrier(
        endpoint=f"tcp/127.0.0.1:{supervisor._free_port()}",
        bench_pid=os.getpid(),
        frame_bytes=tuple(len(messages.encode(frame)) for frame in last.frames),
        command_bytes=tuple(len(messages.encode(one)) for one in last.commands.values()),
    )
    with processes.Children() as children:
        pids = [
            children.start(f"robot{row + 1}", bare.robot, barrier, row)
            for row in range(len(barrier.frame_bytes))
        ]
        children.start("world", bare.world, barrier, pids, window_s, children.sender)
        return children.window()


def whole_system(size: int, window_s: float, *, recorded: bool) -> Window:
    """The product's own processes, as a run has them."""
    plan = rehearsal.built_in(SCENARIO, robots=size, settings=[LONG], recorded=recorded)
    endpoint = f"tcp/127.0.0.1:{supervisor._free_port()}"
    with tempfile.TemporaryDirectory() as folder, processes.Children() as children:
        pids = [
            children.start(
                row.name,
                agents.process.main,
                agents.process.Arguments(
                    run=RUN,
                    endpoint=endpoint,
                    name=row.name,
                    log=Path(folder) / f"{row.name}.log",
                    supervisor_pid=os.getpid(),
                ),
            )
            for row in plan.robots
        ]
        system = System(
            scenario_toml=tomli_w.dumps(scenario.to_builtins(plan)).encode(),
            endpoint=endpoint,
            folder=Path(folder),
            bench_pid=os.getpid(),
            robot_pids=pids,
            window_s=window_s,
        )
        children.start("world", conduct, system, children.sender)
        return children.window()


def conduct(system: System, sender: Connection) -> None:
    """World process: run until the window has passed, send what it cost.

    Only its status calls look at the meter, so the ticks themselves are those of any run.
    """
    stop = lifetime.Stop()
    lifetime.adopt("world", system.folder / "world.log", stop, system.bench_pid)
    meter = processes.Meter([os.getpid(), *system.robot_pids], system.window_s)

    def on_status(status: Status) -> None:
        if status.state == "running" and (window := meter.look(status.tick)) is not None:
            processes.send(sender, window)
            stop.request("measured")

    bus = zenoh_bus.open_router(RUN, system.endpoint)
    try:
        world.process.record_run(
            bus,
            SCENARIO,
            system.scenario_toml,
            system.folder,
            stop,
            bus_name="zenoh",
            on_status=on_status,
        )
    finally:
        bus.close()


# --- what is the cores' own ---------------------------------------------------------------------

PARTS: dict[str, Callable[[Rehearsal, Moment], list[rehearsal.Job]]] = {
    "robot step": lambda seen, moment: [
        lambda frame=frame: robot.step(  # type: ignore[misc]
            seen.setups[frame.robot], moment.minds[frame.robot], frame
        )
        for frame in moment.frames
    ],
    "world sense": lambda seen, moment: [lambda: simulation.sense(seen.world, moment.state)],
    "world step": lambda seen, moment: [
        lambda: simulation.step(seen.world, moment.state, moment.commands)
    ],
    "record": lambda seen, moment: [
        lambda: simulation.record(
            seen.world, moment.state, moment.frames, moment.commands.values()
        )
    ],
    "encode": lambda seen, moment: [
        lambda message=message: messages.encode(message)  # type: ignore[misc]
        for message in (*moment.frames, *moment.commands.values())
    ],
    "decode": lambda seen, moment: [
        lambda topic=topic, payload=messages.encode(message): messages.decode(topic, payload)  # type: ignore[misc]
        for topic, sent in ((FRAME, moment.frames), (COMMAND, moment.commands.values()))
        for message in sent
    ],
}
OWN = ("robot step", "world sense", "world step", "record")
