"""What recording and showing cost: CPU of a tick with MCAP, Foxglove channels and Rerun, over
without.

    one process     all sinks on over off in memory; the dearest ratio, for nothing else is there
    each sink       what it adds to a tick, in the same run
    processes       the same for N + 1 processes, where messages cost too: the one with a budget
"""

from __future__ import annotations

import gc
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec
import tomli_w

from dashboards import foxglove, live
from swarm import recording, scenario
from swarm.messages import TickRecord
from swarm.run import lockstep
from swarm.run.bench import barrier, figures, rehearsal
from swarm.run.bench.figures import Row
from swarm.scenario import Scenario
from world import conductor, scene

SIZES = (6, 100)
TICKS = (200, 40)  # of each size
ROUNDS = 3
PROCESS_SIZE = 100
PROCESS_ROUNDS = 2
WINDOW_S = 2.0
ON_OVER_OFF_MAX = 1.15  # at 100 robots, as processes


class Sink:
    """An observer with the CPU of this thread that it took."""

    def __init__(self, name: str, observe: conductor.Observer, close: Callable[[], object]) -> None:
        self.name = name
        self.close = close
        self.spent_s = 0.0
        self._observe = observe

    def look(self, record: TickRecord) -> None:
        """Pass one tick on."""
        begin_s = time.thread_time()
        self._observe(record)
        self.spent_s += time.thread_time() - begin_s


class Tick(msgspec.Struct, frozen=True):
    """CPU of one tick."""

    all_us: float  # of all threads
    sinks_us: dict[str, float]  # of each sink, on the world's own thread


def measure(*, tiny: bool, progress: Callable[[str], None]) -> tuple[Row, ...]:
    """Rows of every N in memory, then of processes."""
    rows: list[Row] = []
    for size, ticks in ((2, 30),) if tiny else zip(SIZES, TICKS, strict=True):
        on, off = [], []
        for number in range(1 if tiny else ROUNDS):
            progress(f"telemetry: {size} robots in memory, round {number + 1}")
            off.append(tick_cpu(size, ticks, recorded=False))
            on.append(tick_cpu(size, ticks, recorded=True))
        off_us = [one.all_us for one in off]
        rows.append(
            figures.row(
                "telemetry: tick in memory",
                size,
                [one.all_us for one in on],
                "us",
                floors=off_us,
                over="without",
            )
        )
        rows += [
            figures.row(
                f"telemetry: of it {name}",
                size,
                [one.sinks_us[name] for one in on],
                "us",
                floors=off_us,
                over="tick without",
            )
            for name in on[0].sinks_us
        ]
    return (*rows, _of_processes(tiny=tiny, progress=progress))


def _of_processes(*, tiny: bool, progress: Callable[[str], None]) -> Row:
    size, rounds, window_s = (2, 1, 0.3) if tiny else (PROCESS_SIZE, PROCESS_ROUNDS, WINDOW_S)
    on, off = [], []
    for number in range(rounds):
        progress(f"telemetry: {size} robots as processes, round {number + 1} of {rounds}")
        off.append(size * barrier.whole_system(size, window_s, recorded=False).cpu_us)
        on.append(size * barrier.whole_system(size, window_s, recorded=True).cpu_us)
    return figures.row(
        "telemetry: tick of processes",
        size,
        on,
        "us",
        floors=off,
        over="without",
        budget=ON_OVER_OFF_MAX,
        bound="ratio <=",
    )


def tick_cpu(size: int, ticks: int, *, recorded: bool) -> Tick:
    """Mean over a short run in memory, opening and closing of the sinks left out."""
    plan = rehearsal.built_in(
        barrier.SCENARIO, robots=size, settings=[f"duration_s={0.08 * ticks}"]
    )
    with tempfile.TemporaryDirectory() as folder:
        sinks = open_sinks(plan, Path(folder)) if recorded else []
        gc.collect()
        try:
            begin_s = time.process_time()
            run = lockstep.run(plan, [sink.look for sink in sinks])
            spent_s = time.process_time() - begin_s
        finally:
            for sink in sinks:
                sink.close()
    rate = 1e6 / (run.score.tick + 1)
    return Tick(rate * spent_s, {sink.name: rate * sink.spent_s for sink in sinks})


def open_sinks(plan: Scenario, folder: Path) -> Sequence[Sink]:
    """All that a run writes, as the world's process opens it."""
    obstacles = scene.obstacles(plan)
    writer = recording.Writer(
        folder,
        tomli_w.dumps(scenario.to_builtins(plan)).encode(),
        {},
        foxglove.channels(plan, obstacles),
        flush_ticks=plan.recording.flush_ticks,
        flush_s=plan.recording.flush_s,
    )
    viewer = live.Live(plan, obstacles, "bench", folder / "run.rrd", None)
    return [Sink("MCAP", writer.write, writer.close), Sink("Rerun", viewer.observe, viewer.close)]
