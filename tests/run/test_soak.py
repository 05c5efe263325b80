"""Kill and restart, over and over, in one run of real processes: nothing may grow, nothing leak."""

from __future__ import annotations

import random
import signal
import statistics
import time
from collections.abc import Sequence
from pathlib import Path

import msgspec
import psutil
import pytest

from swarm import messages, recording, runs, zenoh_bus
from swarm.messages import COMMAND, CONTROL, Command, ControlRequest
from swarm.zenoh_bus import ZenohBus
from tests.run import processes

FULL = 100  # cycles; from here on as many robots as it takes, and memory is looked at
GROWTH_MAX = 0.10
WARM_UP = 5  # a fifth of the cycles: in its first 20 s a world grows by 7 MB, killed robots or not
SLACK = 10  # descriptors and threads that come and go; one a cycle would be a thousand
CYCLE_S = 60.0
SETTINGS = (
    "restart.robot=on-failure",
    "restart.restart_delay_s=0.2",
    "restart.restart_window_s=0.4",  # none of them dies twice in it, so nothing backs off
    "restart.restart_max=10000",
)


class Use(msgspec.Struct, frozen=True):
    """What a process holds."""

    memory_bytes: int  # resident and not of a file
    descriptors: int
    threads: int


def use_of(process: psutil.Process) -> Use:
    """What it holds now.

    Pages of libraries are left out, they come and go as the kernel likes (it let go of 60 MB of
    them in the middle of a run). Pages shared with the forkserver count, so that the first write
    to one, which makes a copy, does not look like growth, as it does in the unique set.
    """
    memory = process.memory_info()
    return Use(memory.rss - memory.shared, process.num_fds(), process.num_threads())


class Cycle(msgspec.Struct, frozen=True):
    """Figures of one kill and restart, seconds on the wall."""

    gone_s: float  # from the kill until its token is gone; nan when the world struck
    command_s: float  # from the kill until its first command, the restart's delay included


class Soak:
    """A client on the bus of a run, that kills and watches."""

    def __init__(self, bus: ZenohBus, supervisor: psutil.Process, names: Sequence[str]) -> None:
        self.bus = bus
        self.supervisor = supervisor
        self.incarnations = dict.fromkeys(names, 0)
        bus.subscribe(COMMAND)

    def process(self, name: str) -> psutil.Process:
        for process in self.supervisor.children(recursive=True):
            if process.name() == f"swarm-{name}" and process.status() != psutil.STATUS_ZOMBIE:
                return process
        raise AssertionError(f"expected a process of {name}")

    def cycle(self, name: str, *, by_hand: bool) -> Cycle:
        token = ("robot", messages.token_name(name, self.incarnations[name]))
        self.incarnations[name] += 1
        gone_s = float("nan")
        process = self.process(name) if by_hand else None
        while self.bus.receive(0.0) is not None:
            pass
        struck_s = time.monotonic()
        if process is not None:
            process.kill()
        else:
            assert self.bus.ask(CONTROL, ControlRequest("fault", f"restart:{name}+0.2"), 5.0).ok
        while time.monotonic() < struck_s + CYCLE_S:
            delivery = self.bus.receive(0.2)
            if by_hand and gone_s != gone_s and token not in self.bus.alive():
                gone_s = time.monotonic() - struck_s
            if delivery is None or delivery.message.robot != name:
                continue
            command: Command = delivery.message
            if command.beacon.incarnation == self.incarnations[name]:
                return Cycle(gone_s, time.monotonic() - struck_s)
        raise AssertionError(f"{name} was killed and did not come back within {CYCLE_S:g} s")


def figures(values_s: Sequence[float]) -> str:
    cut = statistics.quantiles(values_s, n=100) if len(values_s) > 1 else [values_s[0]] * 99
    return f"{1e3 * cut[49]:.1f} ms (99 %: {1e3 * cut[98]:.1f}, worst {1e3 * max(values_s):.1f})"


def test_killing_and_restarting_leaves_nothing_behind(
    folder: Path, pytestconfig: pytest.Config
) -> None:
    cycles = pytestconfig.getoption("--soak")
    count = 20 if cycles >= FULL else 3
    choice = random.Random("soak")
    settings = [part for setting in SETTINGS for part in ("--set", setting)]
    run = processes.start(
        folder,
        *("run", "empty", "--robots", str(count), "--duration", "100000", "--rate", "4"),
        *("--out", "out", "-q", "--json", *settings),
    )
    cards: list[runs.Card] = []

    def found() -> bool:
        cards[:] = [card for card in runs.running() if Path(card.folder).parent == folder]
        return bool(cards)

    processes.until(found, 60.0, "a card")
    bus = zenoh_bus.open_client(cards[0].run, cards[0].endpoint, name="supervisor")
    try:
        names = [f"robot{number}" for number in range(1, count + 1)]
        soak = Soak(bus, psutil.Process(run.pid), names)
        processes.until(lambda: bus.receive(0.1) is not None, 60.0, "a first command")
        watched = {"world": soak.process("world"), "supervisor": soak.supervisor}
        warm_up = max(1, cycles // WARM_UP)
        before: dict[str, Use] = {}
        done: list[Cycle] = []
        for number in range(cycles):
            if number == warm_up:
                before = {name: use_of(process) for name, process in watched.items()}
            done.append(soak.cycle(choice.choice(names), by_hand=number % 2 == 0))
            if number % max(1, cycles // 10) == 0:
                uses = {name: use_of(process) for name, process in watched.items()}
                print(f"cycle {number}: {uses}", flush=True)
        after = {name: use_of(process) for name, process in watched.items()}
        tree = soak.supervisor.children(recursive=True)
        assert [one for one in tree if one.status() == psutil.STATUS_ZOMBIE] == []
    finally:
        bus.close()
    run.send_signal(signal.SIGINT)
    printed, said = run.communicate(timeout=60.0)
    assert run.returncode == 130, said
    assert processes.belonging(folder) == []
    summary = msgspec.json.decode(printed)
    assert sum(row["restarts"] for row in summary["per_robot"]) == cycles
    assert recording.verify(folder / "out" / runs.MCAP).ok

    gone_s = [one.gone_s for one in done if one.gone_s == one.gone_s]
    command_s = [one.command_s for one in done]
    tenth = max(1, cycles // 10)
    print(
        f"\n{cycles} cycles, {count} robots, {summary['ticks']} ticks\n"
        f"token gone after kill -9: {figures(gone_s)}\n"
        f"first command after the kill: {figures(command_s)}\n"
        f"  of the first tenth {figures(command_s[:tenth])}\n"
        f"  of the last tenth {figures(command_s[-tenth:])}"
    )
    for name in watched:
        grown = after[name].memory_bytes / before[name].memory_bytes - 1.0
        print(f"{name}: memory {grown:+.1%}, {before[name]} -> {after[name]}")
        assert after[name].descriptors <= before[name].descriptors + SLACK
        assert after[name].threads <= before[name].threads + SLACK
        if cycles >= FULL:
            assert grown < GROWTH_MAX
