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
import tempfile
from collections.abc import Callable, Iterable
from functools import partial
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
from swarm.run.bench.rehearsal import Rehearsal
from world import simulation

SCENARIO = "empty"
LONG = "duration_s=1e6"  # the window ends it
RUN = "bench"
SIZES = (6, 20, 50)
ROUNDS = 3
WINDOW_S = 1.5  # wall, of each measurement; status calls, which end it, come twice a second
TINY_SIZES = (2,)
TINY_WINDOW_S = 0.3
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
    """Rows of every N, then how the cost grows with it."""
    sizes = TINY_SIZES if tiny else SIZES
    rows: list[Row] = []
    whole: list[list[float]] = []
    for size in sizes:
        found, spent = _measure_size(size, tiny=tiny, progress=progress)
        rows += found
        whole.append(spent)
    rows.append(
        figures.row(
            "barrier: whole, growth",
            sizes[-1],
            whole[-1],
            "us",
            floors=whole[0],
            over=f"{sizes[0]} robots",
            budget=OVER_SMALLEST_MAX,
            bound="ratio <=",
        )
    )
    return tuple(rows)


def _measure_size(
    size: int, *, tiny: bool, progress: Callable[[str], None]
) -> tuple[list[Row], list[float]]:
    """Rows of one N, and the whole system's figure in each round."""
    rounds, window_s = (1, TINY_WINDOW_S) if tiny else (ROUNDS, WINDOW_S)
    seen = rehearsal.rehearse(
        rehearsal.built_in(SCENARIO, robots=size, settings=[LONG]), REHEARSED_TICKS
    )
    floors, whole, recorded, parts = [], [], [], []
    for number in range(rounds):
        progress(f"barrier: {size} robots, round {number + 1} of {rounds}")
        floors.append(bare_barrier(seen, window_s).cpu_us)
        whole.append(whole_system(size, window_s, recorded=False).cpu_us)
        recorded.append(whole_system(size, window_s, recorded=True).cpu_us)
        parts.append(parts_of(seen))
    row, over = figures.row, "bare barrier"
    return [
        row("barrier: bare", size, floors, "us"),
        row("barrier: whole", size, whole, "us", floors=floors, over=over),
        row("barrier: whole, recorded", size, recorded, "us", floors=whole, over="not recorded"),
        row(
            "barrier: whole less own",
            size,
            [all_us - part.own_us for all_us, part in zip(whole, parts, strict=True)],
            "us",
            floors=floors,
            over=over,
            budget=OVER_BARE_MAX,
            bound="ratio <=",
        ),
        *(
            row(
                f"barrier: of it {name.removesuffix('_us')}",
                size,
                [getattr(part, name) for part in parts],
                "us",
                floors=whole,
                over="whole",
            )
            for name in Parts.__struct_fields__
        ),
    ], whole


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


class Parts(msgspec.Struct, frozen=True):
    """CPU per robot and tick of what the processes do themselves."""

    step_us: float  # robot.step
    sense_us: float  # simulation.sense
    move_us: float  # simulation.step
    record_us: float  # simulation.record
    metrics_us: float  # metrics.observe
    encode_us: float  # one frame and one command
    decode_us: float

    @property
    def own_us(self) -> float:
        """What would be there with any other transport: all but the codec."""
        return self.step_us + self.sense_us + self.move_us + self.record_us + self.metrics_us


def parts_of(seen: Rehearsal) -> Parts:
    """Time the pure functions again on what a rehearsed run gave them."""
    moments = seen.moments[SETTLE_TICKS:]
    rate = 1e6 / (len(moments) * len(seen.setups))  # s in all -> us per robot and tick

    def best_us(jobs: Iterable[rehearsal.Job]) -> float:
        return rate * sum(rehearsal.best_s(jobs, PASSES))

    frames = [frame for moment in moments for frame in moment.frames]
    commands = [command for moment in moments for command in moment.commands.values()]
    payloads = [(FRAME, messages.encode(frame)) for frame in frames]
    payloads += [(COMMAND, messages.encode(command)) for command in commands]
    return Parts(
        step_us=best_us(
            partial(robot.step, seen.setups[frame.robot], moment.minds[frame.robot], frame)
            for moment in moments
            for frame in moment.frames
        ),
        sense_us=best_us(partial(simulation.sense, seen.world, one.state) for one in moments),
        move_us=best_us(
            partial(simulation.step, seen.world, one.state, one.commands) for one in moments
        ),
        record_us=best_us(
            partial(simulation.record, seen.world, one.state, one.frames, one.commands.values())
            for one in moments
        ),
        metrics_us=rate * min(_observe_s(seen) for _ in range(PASSES)),
        encode_us=best_us(partial(messages.encode, one) for one in [*frames, *commands]),
        decode_us=best_us(partial(messages.decode, *payload) for payload in payloads),
    )


def _observe_s(seen: Rehearsal) -> float:
    """A score takes each tick once, so every pass needs a new one."""
    score = metrics.begin(seen.scenario)
    for moment in seen.moments[:SETTLE_TICKS]:
        metrics.observe(score, moment.record)
    rest = seen.moments[SETTLE_TICKS:]
    return sum(rehearsal.best_s((partial(metrics.observe, score, one.record) for one in rest), 1))
