"""The swarm in one process: the same shells as between processes, joined over a memory bus.

    world conductor --frame--> hub --> robot shells --command--> hub --> world conductor

Same cores, same shells, same bytes: `state_hash` equals that of N processes over Zenoh.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import world.process
from agents.process import RobotShell
from swarm import lifetime, messages, metrics
from swarm.bus import Hub, MemoryBus
from swarm.messages import ProcessRequest, Reply, Status
from swarm.scenario import Scenario
from world import conductor


def seat(scenario: Scenario, run: str) -> MemoryBus:
    """Bus for the world on a hub where every robot of the scenario is ready."""
    hub = Hub()
    robots: dict[str, MemoryBus] = {}
    for row in scenario.robots:
        bus = robots[row.name] = MemoryBus(hub, run)
        hub.workers[row.name] = RobotShell(bus, scenario.setup(row.name)).work

    def kill(request: ProcessRequest) -> Reply:
        hub.workers.pop(request.robot, None)
        robots[request.robot].close()
        return Reply(True)

    hub.handlers[messages.PROCESS.name] = kill
    return MemoryBus(hub, run)


def run(
    scenario: Scenario,
    observers: Sequence[conductor.Observer] = (),
    stop: lifetime.Stop | None = None,
) -> conductor.Conduct:
    """Run a scenario in memory, nothing written: for tests and benchmarks."""
    return conductor.conduct(seat(scenario, "memory"), scenario, observers, stop or lifetime.Stop())


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
    return world.process.record_run(
        seat(scenario, run_id),
        name,
        scenario_toml,
        folder,
        stop,
        bus_name="memory",
        on_status=on_status,
    )
