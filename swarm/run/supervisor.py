"""Launch one world and N robots as processes, watch them, end them all.

    start world, robots (forkserver) -> world ready -> watch -> world ends | Ctrl-C | --stop-after
                                                                 \\-> everyone ends within 5 s

Every child is started from a forkserver that has the modules loaded and has never opened a
session. Nothing outlives the supervisor: children are told by the kernel when it dies.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import select
import signal
import socket
import subprocess
import sys
import time
import types
from collections.abc import Callable, Iterator, Sequence
from multiprocessing import connection
from multiprocessing.context import ForkServerProcess
from pathlib import Path

import msgspec

import agents.process
import world.process
from swarm import errors, messages, runs, zenoh_bus
from swarm.messages import CONTROL, EVENT, PROCESS, STATUS, ControlRequest, Event, Reply, Status
from swarm.scenario import Scenario

# the first brings numpy, zenoh, msgspec, agents and world, the last freezes what is there
PRELOAD = ["swarm.run.supervisor", "swarm.run.preload"]
WORLD = "world"
SUPERVISOR = "supervisor"
POLL_S = 0.1
WORLD_READY_S = 30.0  # wall; the world imports the recorder and the viewer first
STOP_S = 5.0  # everyone has ended by then, or is killed
GRACEFUL_S = 3.0  # of these for the world to finish its recording
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


class Ports(msgspec.Struct, frozen=True):
    """Ports of the live pictures, None where there is none."""

    rerun: int | None
    foxglove: int | None


class Ending(msgspec.Struct, frozen=True):
    """How a supervised run came to its end."""

    interrupted: bool
    overtime: bool  # ended by stop_after_s
    problem: str | None  # what went wrong with the processes, None when nothing did
    exit_codes: dict[str, int | None]


def supervise(plan: Plan, watcher: Watcher) -> Ending:
    """Run a plan to its end; no process of it is left when this returns.

    Raises BusError or SwarmError when the world cannot come up.
    """
    return _Supervisor(plan, watcher).run()


class _Supervisor:
    def __init__(self, plan: Plan, watcher: Watcher) -> None:
        self._plan = plan
        self._watcher = watcher
        self._context = multiprocessing.get_context("forkserver")
        self._context.set_forkserver_preload(PRELOAD)
        self._run = plan.run
        self._children: dict[str, ForkServerProcess] = {}
        self._ended: set[str] = set()
        self._viewer: subprocess.Popen[bytes] | None = None
        self._signals: list[int] = []
        self._problem: str | None = None
        self._overtime = False

    def run(self) -> Ending:
        """See `supervise`."""
        previous = {
            number: signal.signal(number, lambda number, _: self._signals.append(number))
            for number in (signal.SIGINT, signal.SIGTERM)
        }
        bus = None
        try:
            ports = Ports(
                rerun=None if self._plan.view == "none" else free_port(),
                foxglove=free_port() if self._plan.foxglove else None,
            )
            bus, endpoint = self._launch(ports)
            if bus is not None:
                card = runs.card_of(
                    self._run, self._plan.name, endpoint, self._plan.folder, self._plan.tls
                )
                with runs.posted(card, self._plan.folder):
                    self._watcher.started(card, self._open_viewers(ports))
                    self._watch(bus)
        finally:
            self._end_all()
            if bus is not None:
                bus.close()
            for number, handler in previous.items():
                signal.signal(number, handler)
        return Ending(
            interrupted=bool(self._signals),
            overtime=self._overtime,
            problem=self._problem,
            exit_codes={name: child.exitcode for name, child in self._children.items()},
        )

    # --- start ---

    def _launch(self, ports: Ports) -> tuple[zenoh_bus.ZenohBus | None, str]:
        """Start everyone and join the bus; (None, ...) when interrupted meanwhile."""
        plan = self._plan
        for _ in range(PORT_TRIES):
            scheme = "tls" if plan.tls else "tcp"
            endpoint = plan.router or f"{scheme}/127.0.0.1:{free_port()}"
            self._start_children(endpoint, ports)
            bus = self._join(endpoint)
            if bus is not None or self._signals:
                return bus, endpoint
            code = self._children[WORLD].exitcode
            self._end_all()
            if code != world.process.PORT_TAKEN or plan.router is not None:
                raise errors.SwarmError(self._last_words(WORLD, "before it was ready"))
        raise errors.SwarmError(
            f"expected a free port on 127.0.0.1 for the router, got {PORT_TRIES} that were taken"
        )

    def _start_children(self, endpoint: str, ports: Ports) -> None:
        plan, logs = self._plan, self._plan.folder / runs.LOGS
        self._children.clear()
        self._ended.clear()
        with without_main():
            self._start(
                WORLD,
                world.process.main,
                world.process.Arguments(
                    run=self._run,
                    name=plan.name,
                    scenario_toml=plan.scenario_toml,
                    endpoint=endpoint,
                    folder=plan.folder,
                    external_router=plan.router is not None,
                    tls=plan.tls,
                    log=logs / "world.log",
                    serve_port=ports.rerun,
                    foxglove_port=ports.foxglove,
                    supervisor_pid=os.getpid(),
                ),
            )
            for robot in plan.scenario.robots:
                self._start(
                    robot.name,
                    agents.process.main,
                    agents.process.Arguments(
                        run=self._run,
                        endpoint=endpoint,
                        name=robot.name,
                        tls=plan.tls,
                        log=logs / f"{robot.name}.log",
                        supervisor_pid=os.getpid(),
                    ),
                )

    def _start(self, name: str, main: Callable[..., int], arguments: msgspec.Struct) -> None:
        child = self._context.Process(target=_exit_with, args=(main, arguments), name=name)
        child.start()
        self._children[name] = child

    def _join(self, endpoint: str) -> zenoh_bus.ZenohBus | None:
        """Bus with the world on it, or None: the world has ended, or we are interrupted."""
        deadline_s = time.monotonic() + WORLD_READY_S
        while not self._signals and self._children[WORLD].is_alive():
            try:
                bus = zenoh_bus.open_client(
                    self._run, endpoint, name=SUPERVISOR, tls=self._plan.tls, connect_timeout_s=0.5
                )
            except errors.BusError:
                if time.monotonic() >= deadline_s:
                    raise
                continue
            bus.subscribe(STATUS)
            bus.subscribe(EVENT)
            bus.serve(PROCESS, self._answer_process)
            bus.announce(SUPERVISOR, SUPERVISOR)
            return bus
        return None

    def _open_viewers(self, ports: Ports) -> list[str]:
        """Start the viewer that was asked for; addresses of all live pictures."""
        addresses = []
        if ports.foxglove is not None:
            addresses.append(f"Foxglove: ws://127.0.0.1:{ports.foxglove}")
        if ports.rerun is None:
            return addresses
        from dashboards import live  # rerun takes half a second to import: only who views pays

        uri = live.uri(ports.rerun)
        if self._plan.view == "native":
            command, shown = live.native_command(uri), uri
        else:
            web_port = free_port()
            command, shown = live.web_command(web_port, uri), live.web_address(web_port, uri)
        try:
            with (self._plan.folder / runs.LOGS / "viewer.log").open("wb") as log:
                self._viewer = subprocess.Popen(
                    command,
                    stdout=log,
                    stderr=log,
                    stdin=subprocess.DEVNULL,
                    start_new_session=True,
                )
        except OSError as error:
            self._watcher.note(f"viewer: expected to start {command[0]}, got: {error.strerror}")
            return addresses
        return [*addresses, f"Rerun: {shown}"]

    # --- while it runs ---

    def _watch(self, bus: zenoh_bus.ZenohBus) -> None:
        """Until the world has ended."""
        started_s = time.monotonic()
        asked_s: float | None = None
        stop_after_s = self._plan.stop_after_s
        while True:
            self._notice_ended()
            while (delivery := bus.receive(0.0)) is not None:
                if delivery.topic is STATUS:
                    self._watcher.status(delivery.message)
                else:
                    self._watcher.event(delivery.message)
            if WORLD in self._ended:
                code = self._children[WORLD].exitcode
                if code != 0:
                    self._problem = self._last_words(WORLD, "in mid-run") + (
                        f"; mend its recording with: swarm verify {self._plan.folder} --repair"
                    )
                return
            now_s = time.monotonic()
            overtime = stop_after_s is not None and now_s - started_s >= stop_after_s
            if asked_s is None and (self._signals or overtime):
                self._overtime = overtime
                asked_s = now_s
                self._watcher.note("stopping")
                self._ask_to_stop(bus)
            if len(self._signals) > 1 or (asked_s is not None and now_s - asked_s > GRACEFUL_S):
                self._problem = "the world did not stop when asked and was ended"
                return
            alive = [c.sentinel for n, c in self._children.items() if n not in self._ended]
            connection.wait(alive, timeout=POLL_S)

    def _ask_to_stop(self, bus: zenoh_bus.ZenohBus) -> None:
        try:
            bus.ask(CONTROL, ControlRequest("stop"), 1.0)
        except errors.SwarmError:
            self._send(WORLD, signal.SIGTERM)

    def _notice_ended(self) -> None:
        for name, child in self._children.items():
            if name not in self._ended and child.exitcode is not None:
                self._ended.add(name)
                if child.exitcode != 0 and name != WORLD:
                    self._watcher.note(self._last_words(name, ""))

    def _last_words(self, name: str, when: str) -> str:
        code = self._children[name].exitcode
        how = (
            f"killed by {signal.Signals(-code).name}"
            if code is not None and code < 0
            else f"ended with exit code {code}"
        )
        log = self._plan.folder / runs.LOGS / f"{name}.log"
        try:
            lines = [line for line in log.read_text(errors="replace").splitlines() if line]
        except OSError:
            lines = []
        said = f": {lines[-1]}" if lines else ""
        return f"{name} {how}{' ' + when if when else ''}{said} (log: {log})"

    def _answer_process(self, request: messages.ProcessRequest) -> Reply:
        """Deliver a signal, and answer when it has done its work."""
        child = self._children.get(request.robot)
        if child is None or request.robot == WORLD or child.pid is None:
            return Reply(False, f"expected a robot of this run, got '{request.robot}'")
        try:
            handle = os.pidfd_open(child.pid)
        except ProcessLookupError:
            return Reply(True, "was dead already")
        try:
            os.kill(child.pid, signal.SIGKILL)
            select.select([handle], [], [], STOP_S)  # readable once the process is gone
        finally:
            os.close(handle)
        return Reply(True)

    # --- the end ---

    def _send(self, name: str, number: signal.Signals) -> None:
        child = self._children[name]
        if name not in self._ended and child.pid is not None and child.exitcode is None:
            with contextlib.suppress(ProcessLookupError):
                os.kill(child.pid, number)

    def _end_all(self) -> None:
        """SIGTERM to all that live, SIGKILL to those that do not end in time."""
        viewer = self._viewer
        if viewer is not None and self._plan.view == "web":
            viewer.terminate()  # a native viewer belongs to the person who looks at it
        for name in self._children:
            self._send(name, signal.SIGTERM)
        deadline_s = time.monotonic() + STOP_S - GRACEFUL_S
        for name, child in self._children.items():
            while child.exitcode is None and time.monotonic() < deadline_s:
                if len(self._signals) > 1:
                    break
                child.join(0.05)
            if child.exitcode is None:
                self._send(name, signal.SIGKILL)
                child.join()
        if viewer is not None and self._plan.view == "web":
            try:
                viewer.wait(1.0)
            except subprocess.TimeoutExpired:
                viewer.kill()
                viewer.wait()


def _exit_with(main: Callable[[msgspec.Struct], int], arguments: msgspec.Struct) -> None:
    sys.exit(main(arguments))


@contextlib.contextmanager
def without_main() -> Iterator[None]:
    """Hide `__main__`: multiprocessing would import the command line again in every child."""
    main = sys.modules["__main__"]
    sys.modules["__main__"] = types.ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port
