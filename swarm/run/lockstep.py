"""The swarm in one process: the same shells as between processes, joined over a memory bus.

    world conductor --frame--> hub --> robot shells --command--> hub --> world conductor

Same cores, same shells, same bytes: `state_hash` equals that of N processes over Zenoh. Faults of
processes are what they are between processes: a killed shell is gone with all that it remembers,
a stopped one does no work, a killed world ends where it is and another one goes on from its
checkpoint.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import world.process
from agents.process import RobotShell
from swarm import faults, lifetime, messages, metrics
from swarm.bus import Hub, MemoryBus
from swarm.messages import ProcessRequest, Reply, Status, TickRecord
from swarm.scenario import Scenario
from world import checkpoint, conductor


class WorldKilled(BaseException):
    """The world is gone, in the middle of whatever it did."""


class Seats:
    """A hub where every robot of a scenario is ready; answers for the supervisor."""

    def __init__(self, scenario: Scenario, run: str) -> None:
        self.run = run
        self._scenario = scenario
        self._hub = Hub()
        self._shells: dict[str, tuple[MemoryBus, RobotShell]] = {}
        for row in scenario.robots:
            self._start(row.name, 0)
        self._hub.handlers[messages.PROCESS.name] = self._answer

    def world_bus(self) -> MemoryBus:
        """Bus for a world, or for the next one when that was killed."""
        return MemoryBus(self._hub, self.run)

    def _start(self, name: str, incarnation: int) -> None:
        bus = MemoryBus(self._hub, self.run)
        shell = RobotShell(bus, self._scenario.setup(name), incarnation)
        self._shells[name] = (bus, shell)
        self._hub.workers[name] = shell.work

    def _kill(self, name: str) -> None:
        self._hub.workers.pop(name, None)
        bus, _ = self._shells.pop(name, (None, None))
        if bus is not None:
            bus.close()

    def _answer(self, request: ProcessRequest) -> Reply:
        name = request.robot
        if name == faults.WORLD:
            raise WorldKilled
        match request.action:
            case "kill":
                self._kill(name)
            case "start":
                self._kill(name)
                self._start(name, request.incarnation)
            case "stop":
                self._hub.workers.pop(name, None)
            case "continue":
                self._hub.workers[name] = self._shells[name][1].work
            case "inspect":
                if name not in self._shells:
                    return Reply(True, "dead")
                return Reply(True, "running" if name in self._hub.workers else "stopped")
        return Reply(True)


class _Memory(conductor.Nowhere):
    """Keeper of the newest checkpoint."""

    def __init__(self) -> None:
        self.kept: bytes | None = None

    def save(self, data: bytes) -> None:
        """Keep it."""
        self.kept = data


def run(
    scenario: Scenario,
    observers: Sequence[conductor.Observer] = (),
    stop: lifetime.Stop | None = None,
) -> conductor.Conduct:
    """Run a scenario in memory, nothing written: for tests and benchmarks.

    Observers are called again for the ticks that a killed world had not kept.
    """
    seats = Seats(scenario, "memory")
    stop = stop or lifetime.Stop()
    if not any(fault.target == faults.WORLD for fault in scenario.faults):
        return conductor.conduct(seats.world_bus(), scenario, observers, stop)
    memory = _Memory()
    records: dict[int, TickRecord] = {}

    def keep(record: TickRecord) -> None:
        records[record.tick] = record

    resumed = None
    while True:
        bus = seats.world_bus()
        try:
            return conductor.conduct(
                bus, scenario, [keep, *observers], stop, keeper=memory, resumed=resumed
            )
        except WorldKilled:
            bus.close()
            kept = None if memory.kept is None else checkpoint.decode(memory.kept, "memory")
            first_tick = 0 if kept is None else kept.state.tick
            before = [records[tick] for tick in range(first_tick)]
            resumed = conductor.Resumed(kept, metrics.of_records(scenario, before))


def record(
    scenario: Scenario,
    name: str,
    run_id: str,
    scenario_toml: bytes,
    folder: Path,
    stop: lifetime.Stop,
    on_status: Callable[[Status], None],
) -> metrics.Summary:
    """Run a scenario in memory with the recording and the summary of any other run."""
    seats = Seats(scenario, run_id)
    segment = 0
    while True:
        bus = seats.world_bus()
        try:
            return world.process.record_run(
                bus,
                name,
                scenario_toml,
                folder,
                stop,
                bus_name="memory",
                segment=segment,
                on_status=on_status,
            )
        except WorldKilled:
            bus.close()
            segment += 1
