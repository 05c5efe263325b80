"""Launch one world and N robots as processes, watch them, end them all.

    start world, robots -> world ready -> watch -> world over | Ctrl-C | --stop-after
                                           | ^                        \\-> everyone ends within 5 s
                             world killed -' '- started again, resumes

Nothing outlives the supervisor: children are told by the kernel when it dies. When a robot is
started again is for the world to say, in simulated time; the world itself is started again from
here, by the clock on the wall.
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Sequence
from multiprocessing import connection
from pathlib import Path

import msgspec

import agents.process
import world.process
from swarm import errors, messages, runs, zenoh_bus
from swarm.messages import EVENT, PROCESS, STATUS, Event, Status
from swarm.run import supervision
from swarm.run.child import Child, free_port
from swarm.run.crew import WORLD, Crew
from swarm.run.inbox import Inbox
from swarm.run.sampler import Sampler
from swarm.run.viewers import Viewer, free_ports
from swarm.scenario import Scenario

SUPERVISOR = "supervisor"
POLL_S = 0.1
WORLD_READY_S = 30.0  # wall; the world imports the recorder and the viewer first
STOP_S = 2.0  # from SIGTERM until SIGKILL
GRACEFUL_S = 3.0  # the same for the world, to finish its recording
SILENT_S = 20.0  # a world that says nothing for so long is worth a word
PORT_TRIES = 5


class Plan(msgspec.Struct, frozen=True, kw_only=True):
    """What to launch."""

    scenario: Scenario
    scenario_toml: bytes
    name: str  # of the scenario, for people
    folder: Path
    run: str  # id
    router: str | None = None  # endpoint of an external router
    tls: Path | None = None
    view: str = "none"
    foxglove: bool = False
    stop_after_s: float | None = None


class Watcher:
    """What a front end hears of a run; this one is silent."""

    def started(self, card: runs.Card, addresses: Sequence[str]) -> None:
        """World is up; `addresses` are those of the live pictures."""

    def status(self, status: Status) -> None:
        """Twice a second."""

    def event(self, event: Event) -> None:
        """Something happened."""

    def note(self, text: str) -> None:
        """The supervisor itself has something to say."""

    def close(self) -> None:
        """It is over."""


class Ending(msgspec.Struct, frozen=True):
    """How a supervised run came to its end."""

    interrupted: bool
    overtime: bool  # ended by stop_after_s
    problem: str | None  # what went wrong with the processes, None when nothing did
    exit_codes: dict[str, int | None]
    world_restarts: int = 0


def supervise(plan: Plan, watcher: Watcher) -> Ending:
    """Run a plan to its end; no process of it is left when this returns.

    Raises BusError or SwarmError when the world cannot come up.
    """
    return _Supervisor(plan, watcher).run()


class _Supervisor:
    def __init__(self, plan: Plan, watcher: Watcher) -> None:
        self._plan = plan
        self._watcher = watcher
        self._inbox = Inbox()
        self._ports = free_ports(plan.view, plan.foxglove)
        self._endpoint = ""
        self._crew = self._muster()
        self._sampler = Sampler(plan.folder)
        self._signals: list[int] = []
        self._problem: str | None = None
        self._overtime = False
        self._viewer: Viewer | None = None

    def run(self) -> Ending:
        """See `supervise`."""
        previous = {
            number: signal.signal(number, self._heed) for number in (signal.SIGINT, signal.SIGTERM)
        }
        bus = None
        plan = self._plan
        try:
            bus = self._launch()
            if bus is not None:
                card = runs.card_of(plan.run, plan.name, self._endpoint, plan.folder, plan.tls)
                with runs.posted(card, plan.folder):
                    log = plan.folder / runs.LOGS / "viewer.log"
                    self._viewer = Viewer(plan.view, self._ports, log, self._watcher.note)
                    self._watcher.started(card, self._viewer.addresses)
                    self._watch(bus)
        finally:
            self._end_all()
            for number, handler in previous.items():
                signal.signal(number, handler)
            self._inbox.close()
            if self._viewer is not None:
                self._viewer.close()
            if bus is not None:
                bus.close()
        return Ending(
            interrupted=bool(self._signals),
            overtime=self._overtime,
            problem=self._problem,
            exit_codes={name: self._crew.exit_code(name) for name in self._crew.lives},
            world_restarts=self._crew.lives[WORLD].restarts,
        )

    def _heed(self, number: int, _: object) -> None:
        self._signals.append(number)
        self._inbox.wake()

    # --- start ---

    def _muster(self) -> Crew:
        """Everyone there is to be, not started yet."""
        scenario = self._plan.scenario
        robot = supervision.of_robot(
            start_timeout_s=scenario.clock.start_timeout_s + WORLD_READY_S, stop_timeout_s=STOP_S
        )
        world_ = supervision.of_world(
            scenario.restart, start_timeout_s=WORLD_READY_S, stop_timeout_s=GRACEFUL_S
        )
        policies = {WORLD: world_, **{one.name: robot for one in scenario.robots}}
        return Crew(policies, self._start, self._watcher.note)

    def _launch(self) -> zenoh_bus.ZenohBus | None:
        """Start everyone and join the bus; None when interrupted meanwhile."""
        plan = self._plan
        for _ in range(PORT_TRIES):
            scheme = "tls" if plan.tls else "tcp"
            self._endpoint = plan.router or f"{scheme}/127.0.0.1:{free_port()}"
            for name in self._crew.lives:
                self._crew.tell(name, supervision.Start())
            bus = self._join()
            if bus is not None or self._signals:
                return bus
            code, words = self._crew.exit_code(WORLD), self._crew.last_words(WORLD)
            self._end_all()
            if code != world.process.PORT_TAKEN or plan.router is not None:
                raise errors.SwarmError(f"{words}, before it was ready")
            self._crew = self._muster()
        raise errors.SwarmError(
            f"expected a free port on 127.0.0.1 for the router, got {PORT_TRIES} that were taken"
        )

    def _start(self, name: str, incarnation: int) -> Child:
        plan = self._plan
        log = plan.folder / runs.LOGS / f"{name}.log"
        if name == WORLD:
            of_world = world.process.Arguments(
                run=plan.run,
                name=plan.name,
                scenario_toml=plan.scenario_toml,
                endpoint=self._endpoint,
                folder=plan.folder,
                external_router=plan.router is not None,
                tls=plan.tls,
                log=log,
                serve_port=self._ports.rerun,
                foxglove_port=self._ports.foxglove,
                supervisor_pid=os.getpid(),
                segment=incarnation,
            )
            return Child(name, world.process.main, of_world, log)
        of_robot = agents.process.Arguments(
            run=plan.run,
            endpoint=self._endpoint,
            name=name,
            incarnation=incarnation,
            tls=plan.tls,
            log=log,
            supervisor_pid=os.getpid(),
        )
        return Child(name, agents.process.main, of_robot, log)

    def _join(self) -> zenoh_bus.ZenohBus | None:
        """Bus with the world on it, or None: the world has ended, or we are interrupted."""
        deadline_s = time.monotonic() + WORLD_READY_S
        while not self._signals and self._crew.exit_code(WORLD) is None:
            try:
                bus = zenoh_bus.open_client(
                    self._plan.run,
                    self._endpoint,
                    name=SUPERVISOR,
                    tls=self._plan.tls,
                    connect_timeout_s=0.5,
                )
            except errors.BusError:
                if time.monotonic() >= deadline_s:
                    raise
                continue
            bus.subscribe(STATUS)
            bus.subscribe(EVENT)
            bus.serve(PROCESS, self._inbox.ask)
            bus.announce(SUPERVISOR, SUPERVISOR)
            return bus
        return None

    # --- while it runs ---

    def _watch(self, bus: zenoh_bus.ZenohBus) -> None:
        """Until the world has ended for good."""
        crew, started_s = self._crew, time.monotonic()
        stopping = False
        heard_s: float | None = crew.now_s()  # of the world, None once we have said that we do not
        while crew.lives[WORLD].phase not in ("dead", "over"):
            if self._read(bus):
                heard_s = crew.now_s()
            self._attend()
            if heard_s is not None and crew.now_s() - heard_s > SILENT_S:
                self._watcher.note(f"world has said nothing for {SILENT_S:g} s: {_how(crew)}")
                heard_s = None
            overtime = time.monotonic() - started_s >= (self._plan.stop_after_s or float("inf"))
            if not stopping and (self._signals or overtime):
                self._overtime = overtime
                stopping = True
                self._watcher.note("stopping")
                crew.tell(WORLD, supervision.Stop())
            if len(self._signals) > 1:
                crew.tell(WORLD, supervision.End())
            self._sampler.look(self._pids)
            self._wait()
        self._sampler.look(self._pids, at_once=True)
        code = crew.exit_code(WORLD)
        if code is None or (code != 0 and stopping):
            self._problem = "the world did not stop when asked and was ended"
        elif code != 0:
            self._problem = (
                f"{crew.last_words(WORLD)}, in mid-run; "
                f"mend its recording with: swarm verify {self._plan.folder} --repair"
            )

    def _read(self, bus: zenoh_bus.ZenohBus) -> bool:
        """Pass on what the world says and notice who is ready; whether it said anything."""
        heard = False
        while (delivery := bus.receive(0.0)) is not None:
            heard = True
            if delivery.topic is STATUS:
                self._watcher.status(delivery.message)
            else:
                self._watcher.event(delivery.message)
        alive = bus.alive()
        for name, life in self._crew.lives.items():
            token = ("robot", messages.token_name(name, life.incarnation))
            if not life.ready and (heard if name == WORLD else token in alive):
                self._crew.tell(name, supervision.Ready())
                if name == WORLD and life.incarnation and self._viewer is not None:
                    self._viewer.world_is_back()
        return heard

    def _pids(self) -> dict[str, int]:
        return {SUPERVISOR: os.getpid(), **self._crew.pids()}

    def _attend(self) -> None:
        """See to everyone once."""
        for ask in self._inbox.take():
            self._crew.take(ask)
        self._crew.notice()

    def _wait(self) -> None:
        waitables = [self._inbox.fileno(), *self._crew.waitables()]
        connection.wait(waitables, timeout=self._crew.patience_s(POLL_S))

    # --- the end ---

    def _end_all(self) -> None:
        """End everyone, in good order unless somebody is in a hurry."""
        self._crew.stop_all()
        while not self._crew.is_over():
            if len(self._signals) > 1:
                self._crew.end_all()
            self._attend()
            if not self._crew.is_over():
                self._wait()


def _how(crew: Crew) -> str:
    return f"its process is {crew.state_of(WORLD)}"
