"""What recording and showing cost: CPU of a tick with MCAP, Foxglove channels and Rerun, over
without.

    in memory       one process; the dearest ratio, for no message costs anything there
    of it           what each sink adds, on the thread of the world
    as processes    N + 1 processes over Zenoh: the one with a budget
"""

from __future__ import annotations

import gc
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import msgspec
import tomli_w

from swarm.bus import Hub, MemoryBus
from swarm.messages import TickRecord
from swarm.run import lockstep
from swarm.run.bench import figures, rehearsal, system
from swarm.run.bench.figures import Row
from swarm.scenario import Recording, Scenario, to_builtins
from world.watchers import Watchers

SINKS = {
    "MCAP": Recording(mcap=True, rerun=False),
    "Rerun": Recording(mcap=False, rerun=True),
}
SIZES = ((6, 200), (100, 40))  # robots, ticks in memory
TINY_SIZES = ((2, 30),)
ROUNDS = 3
PROCESSES = 100
TINY_PROCESSES = 2
TURNS = 3  # windows without and with, in one launch
WINDOW_S = 1.0
SETTLE_S = 0.5  # as long as a flush of either sink may wait
TINY_WINDOW_S = 0.1
ON_OVER_OFF_MAX = 1.15  # design budget, at 100 robots as processes


class Tick(msgspec.Struct, frozen=True):
    """CPU of one tick, mean."""

    all_us: float  # of all threads
    sinks_us: dict[str, float]  # of each sink, on the world's own thread


def measure(*, tiny: bool, progress: Callable[[str], None]) -> tuple[Row, ...]:
    """Rows of every N in memory, then of processes."""
    rows: list[Row] = []
    for robots, ticks in TINY_SIZES if tiny else SIZES:
        on, off = [], []
        for number in range(1 if tiny else ROUNDS):
            progress(f"telemetry: {robots} robots in memory, round {number + 1}")
            off.append(tick_in_memory(robots, ticks, recorded=False))
            on.append(tick_in_memory(robots, ticks, recorded=True))
        without = [one.all_us for one in off]
        rows.append(
            figures.row(
                "telemetry: tick in memory",
                robots,
                [one.all_us for one in on],
                "us",
                floors=without,
                over="without",
            )
        )
        rows += [
            figures.row(
                f"telemetry: of it {name}",
                robots,
                [one.sinks_us[name] for one in on],
                "us",
                floors=without,
                over="tick without",
            )
            for name in on[0].sinks_us
        ]
    return (*rows, _as_processes(tiny=tiny, progress=progress))


def tick_in_memory(robots: int, ticks: int, *, recorded: bool) -> Tick:
    """Mean over a short run, opening and closing of the sinks left out."""
    settings = [f"duration_s={rehearsal.DT_S * ticks}"]
    plan = rehearsal.built_in(system.SCENARIO, robots=robots, settings=settings)
    with tempfile.TemporaryDirectory() as folder:
        sinks = [Sink(name, plan, Path(folder)) for name in SINKS] if recorded else []
        gc.collect()
        try:
            begin_s = time.process_time()
            run = lockstep.run(plan, [sink.observe for sink in sinks])
            spent_s = time.process_time() - begin_s
        finally:
            for sink in sinks:
                sink.close()
    rate = 1e6 / (run.score.tick + 1)  # s in all -> us per tick
    return Tick(rate * spent_s, {sink.name: rate * sink.spent_s for sink in sinks})


class Sink:
    """One way of recording, as a world opens it, with the CPU that it takes on this thread."""

    def __init__(self, name: str, plan: Scenario, folder: Path) -> None:
        self.name = name
        self.spent_s = 0.0
        only = msgspec.structs.replace(plan, recording=SINKS[name])
        self._watchers = Watchers(MemoryBus(Hub(), system.RUN), only, folder)
        self._watchers.open(tomli_w.dumps(to_builtins(only)).encode(), None, None)
        self.close = self._watchers.close

    def observe(self, record: TickRecord) -> None:
        """Pass one tick on."""
        begin_s = time.thread_time()
        self._watchers.observe(record)
        self.spent_s += time.thread_time() - begin_s


def _as_processes(*, tiny: bool, progress: Callable[[str], None]) -> Row:
    robots = TINY_PROCESSES if tiny else PROCESSES
    progress(f"telemetry: {robots} robots as processes")
    if tiny:
        turns = system.measure(robots, turns=1, window_s=TINY_WINDOW_S, settle_s=0.0)
    else:
        turns = system.measure(robots, turns=TURNS, window_s=WINDOW_S, settle_s=SETTLE_S)
    return figures.row(
        "telemetry: tick as processes",
        robots,
        [robots * one.cpu_us for one in turns.recorded],
        "us",
        floors=[robots * one.cpu_us for one in turns.plain],
        over="without",
        budget=ON_OVER_OFF_MAX,
        bound="ratio <=",
    )
