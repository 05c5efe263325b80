"""One robot as a process: fetch the scenario, say ready, answer every frame with a command."""

from __future__ import annotations

import gc
import math
import time
from collections import deque
from pathlib import Path

import msgspec
import numpy as np

from agents import robot
from swarm import errors, lifetime, log, messages, zenoh_bus
from swarm.bus import Bus
from swarm.geometry import STILL, Pose
from swarm.messages import COMMAND, FRAME, Command, SensorFrame, Wheels
from swarm.scenario import RobotSetup

POLL_S = 0.5  # how often an idle robot looks whether anyone is still there
ABSENCE_S = 1.5  # world and supervisor away for so long: nobody will come back for us
SETUP_TIMEOUT_S = 15.0
STATES_KEPT = 128  # frames; a killed world begins again so far back at most, had its disk been full

_setup_decoder = msgspec.msgpack.Decoder(RobotSetup)


class Arguments(msgspec.Struct, frozen=True):
    """What a robot needs to be told; everything else it asks the world."""

    run: str
    endpoint: str
    name: str
    incarnation: int = 0
    tls: Path | None = None
    log: Path | None = None
    supervisor_pid: int | None = None


def main(arguments: Arguments) -> int:
    """Run one robot until the world or the supervisor is gone, or somebody asks it to stop."""
    stop = lifetime.Stop()
    lifetime.adopt(arguments.name, arguments.log, stop, arguments.supervisor_pid)
    try:
        bus = zenoh_bus.open_client(
            arguments.run, arguments.endpoint, name=arguments.name, tls=arguments.tls, leaf=True
        )
    except errors.SwarmError as error:
        log.say(arguments.name, str(error), level="error")
        return error.exit_code
    try:
        lifetime.heed_signals(stop)
        stop.wake = bus.wake
        shell = RobotShell(bus, ask_setup(bus, arguments.name), arguments.incarnation)
        shell.loop(stop, supervised=arguments.supervisor_pid is not None)
    except errors.SwarmError as error:
        if stop.reason is None:
            log.say(arguments.name, str(error), level="error")
            return error.exit_code
    finally:
        for reason, count in bus.rejected().items():
            log.say(arguments.name, f"ignored {count} x {reason}", level="warn")
        bus.close()
    log.say(arguments.name, f"ends: {stop.reason}")
    return 0


def ask_setup(bus: Bus, name: str) -> RobotSetup:
    """Part of the scenario that is this robot's; raises BusError or MessageError."""
    reply = bus.ask(messages.SCENARIO, messages.ScenarioRequest(name), SETUP_TIMEOUT_S)
    if not reply.ok:
        raise errors.BusError(f"scenario for {name}: {reply.text}")
    try:
        return _setup_decoder.decode(reply.body)
    except msgspec.DecodeError as error:
        raise errors.MessageError(f"scenario for {name}: {error}") from error


class RobotShell:
    """Keeps the State of one robot between frames."""

    def __init__(self, bus: Bus, setup: RobotSetup, incarnation: int = 0) -> None:
        self._bus = bus
        self._setup = setup
        self._state = robot.init(setup, incarnation)
        self._incarnation = incarnation
        self._tick = -1
        self._world_left = False
        self._answered: Command | None = None  # the newest, should the world ask for it again
        # Frames' ticks with the State before each, for a world that begins again before them.
        self._before: deque[tuple[int, robot.State]] = deque(maxlen=STATES_KEPT)
        robot.step(setup, self._state, _warm_up_frame(setup))  # first calls are slow ones
        bus.subscribe(FRAME, setup.robot.name, newest=setup.clock.mode == "realtime")
        bus.announce(
            "robot", messages.token_name(setup.robot.name, incarnation)
        )  # last: who sees it may send frames

    def loop(self, stop: lifetime.Stop, *, supervised: bool) -> None:
        """Answer frames until told to stop.

        A robot started by hand, perhaps on another host, ends when a supervisor that it has seen
        and the world are both gone; any other is told by the kernel.
        """
        absence = lifetime.Absence(self._bus, ABSENCE_S)
        gc.freeze()  # what start-up made stays; the collector need not look at it again
        while stop.reason is None:
            delivery = self._bus.receive(POLL_S)
            if delivery is not None:
                self._answer(delivery.message)
                continue
            self._world_left |= all(role != "world" for role, _ in self._bus.alive())
            if not supervised and absence.lasts(time.monotonic()):
                stop.request("world and supervisor are gone")

    def work(self) -> None:
        """Answer what has arrived, for a bus without threads."""
        while (delivery := self._bus.receive(0.0)) is not None:
            self._answer(delivery.message)

    def _answer(self, frame: SensorFrame) -> None:
        if frame.tick == 0 and self._world_left:
            self._begin_again()
        if frame.tick == self._tick and self._answered is not None:
            self._bus.publish(COMMAND, self._answered, self._answered.robot)  # it was lost
            return
        if frame.tick <= self._tick:
            self._go_back(frame.tick)
        self._before.append((frame.tick, self._state))
        self._tick = frame.tick
        self._state, command = robot.step(self._setup, self._state, frame)
        self._answered = command
        self._bus.publish(COMMAND, command, command.robot)

    def _go_back(self, tick: int) -> None:
        """Forget what came from `tick` on: the world was killed, and goes on there.

        Should the State of then not be kept any more, it is the oldest that is.
        """
        while self._before:
            before, self._state = self._before.pop()
            if before <= tick:
                break

    def _begin_again(self) -> None:
        """Another world has taken the place of the one that ended, perhaps with other plans."""
        self._setup = ask_setup(self._bus, self._setup.robot.name)
        self._state = robot.init(self._setup, self._incarnation)
        self._before.clear()
        self._tick = -1
        self._answered = None
        self._world_left = False


def _warm_up_frame(setup: RobotSetup) -> SensorFrame:
    name = setup.robot.name
    ranges = np.full(setup.sensor.beams, math.inf, dtype=np.float32)
    ranges[::3] = 0.5 * setup.sensor.range_m
    start = Pose(*setup.robot.start)
    return SensorFrame(name, 0, 0, start, STILL, Wheels(0.0, 0.0), False, messages.array(ranges))
