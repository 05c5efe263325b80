"""CPU per robot and tick of the whole system, over a bare Zenoh barrier of the same payloads.

    bare               N + 1 processes that only exchange bytes: the floor
    whole              N robots and a world that do nothing but tick (scenario `empty`)
    whole, recorded    with MCAP and Rerun
    whole less own     without what robots and world compute, whatever carries their messages
    own                that, as it is between processes; over the same calls alone in one process

Processes push each other out of the caches of a few cores: the same step takes twice as long there
as alone. `whole less own` takes off what it really took, `less own alone` what it takes alone, so
that the caches count as the barrier's.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial

import msgspec

from agents import robot
from swarm import messages, metrics
from swarm.messages import COMMAND, FRAME
from swarm.run.bench import bare, figures, rehearsal, system
from swarm.run.bench.figures import Row
from swarm.run.bench.rehearsal import Rehearsal
from world import simulation

SIZES = (6, 20, 50)
ROUNDS = 3
WINDOW_S = 1.0  # wall, of each measurement
SETTLE_S = 0.5  # before each, without and with recording
TINY_SIZES = (2,)
TINY_WINDOW_S = 0.1
OVER_BARE_MAX = 1.6  # whole less own, design budget
OVER_SMALLEST_MAX = 1.4  # whole, most robots over fewest, design budget
SETTLE_TICKS = 5  # until every robot has heard all others
REHEARSED_TICKS = 25
PASSES = 5


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
    rounds = 1 if tiny else ROUNDS
    window_s, settle_s = (TINY_WINDOW_S, 0.0) if tiny else (WINDOW_S, SETTLE_S)
    plan = rehearsal.built_in(system.SCENARIO, robots=size)
    seen = rehearsal.rehearse(plan, REHEARSED_TICKS)
    last = seen.moments[-1]
    frame_bytes = tuple(len(messages.encode(frame)) for frame in last.frames)
    command_bytes = tuple(len(messages.encode(one)) for one in last.commands.values())
    floors, whole, own, recorded, parts = [], [], [], [], []
    for number in range(rounds):
        progress(f"barrier: {size} robots, round {number + 1} of {rounds}")
        floors.append(bare.measure(frame_bytes, command_bytes, window_s).cpu_us)
        turn = system.measure(size, turns=1, window_s=window_s, settle_s=settle_s)
        whole.append(turn.plain[0].cpu_us)
        own.append(turn.plain[0].own_us)
        recorded.append(turn.recorded[0].cpu_us)
        parts.append(parts_of(seen))
    alone = [part.own_us for part in parts]
    row, over = figures.row, "bare barrier"
    return [
        row("barrier: bare", size, floors, "us"),
        row("barrier: whole", size, whole, "us", floors=floors, over=over),
        row("barrier: whole, recorded", size, recorded, "us", floors=whole, over="not recorded"),
        row(
            "barrier: whole less own",
            size,
            _difference(whole, own),
            "us",
            floors=floors,
            over=over,
            budget=OVER_BARE_MAX,
            bound="ratio <=",
        ),
        row(
            "barrier: whole less own alone",
            size,
            _difference(whole, alone),
            "us",
            floors=floors,
            over=over,
        ),
        row("barrier: own", size, own, "us", floors=alone, over="alone"),
        *(
            row(
                f"barrier: {name.removesuffix('_us')} alone",
                size,
                [getattr(part, name) for part in parts],
                "us",
                floors=whole,
                over="whole",
            )
            for name in Parts.__struct_fields__
        ),
    ], whole


def _difference(all_us: list[float], part_us: list[float]) -> list[float]:
    return [one - other for one, other in zip(all_us, part_us, strict=True)]


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
