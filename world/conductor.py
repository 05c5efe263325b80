"""One run over any bus: gather the robots, then tick by tick until it is over.

    faults due -> sense -> frames out -> commands in -> record -> move

Pure functions of world.simulation do the work; this shell keeps the pace, moves the messages,
notices who is gone and tells everyone what happened.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Literal

import msgspec

from swarm import errors, faults, lifetime, messages, metrics
from swarm.bus import Bus
from swarm.messages import (
    COMMAND,
    EVENT,
    FRAME,
    STATUS,
    Command,
    ControlRequest,
    Event,
    EventKind,
    Reply,
    RobotState,
    RobotStatus,
    ScenarioRequest,
    SensorFrame,
    Status,
    TickRecord,
)
from swarm.scenario import Scenario
from world import simulation

STATUS_PERIOD_S = 0.5  # wall
BARRIER_POLL_S = 0.1  # how often a waiting world looks at the clock
PROCESS_TIMEOUT_S = 10.0  # the supervisor's answer to a process fault
STALL_S = 0.45  # between two looks at the clock; links time out after 0.5 s
RETURN_S = 5.0  # a world that was stopped itself gives the others so long to come back
SLEEP_S_MAX = 0.2  # how late a slow run notices that it should stop
REJECTED_REPORTS_MAX = 20  # events about ignored messages; all of them are counted

Observer = Callable[[TickRecord], None]


class Conduct(msgspec.Struct):
    """What a finished run leaves behind; see `conduct`."""

    score: metrics.Score
    ended: str
    wall_time_s: float
    late_commands: int
    commands_total: int
    rejected_messages: int


def conduct(
    bus: Bus,
    scenario: Scenario,
    observers: Sequence[Observer],
    stop: lifetime.Stop,
    *,
    supervised: bool = False,
    on_status: Callable[[Status], None] = lambda status: None,
    now: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> Conduct:
    """Run the scenario to its end over a bus whose robots are there or on their way.

    Args:
        observers: called with every TickRecord, inline, in order.
        stop: may be requested from anywhere; the tick at hand is finished first.
        supervised: pause while the supervisor's token is away (Ctrl-Z there).
        on_status: called with what is also published twice a second.
    """
    return _Conductor(bus, scenario, observers, stop, supervised, on_status, now, sleep).run()


class _Conductor:
    def __init__(
        self,
        bus: Bus,
        scenario: Scenario,
        observers: Sequence[Observer],
        stop: lifetime.Stop,
        supervised: bool,
        on_status: Callable[[Status], None],
        now: Callable[[], float],
        sleep: Callable[[float], None],
    ) -> None:
        self._bus = bus
        self._scenario = scenario
        self._observers = observers
        self._stop = stop
        self._supervised = supervised
        self._on_status = on_status
        self._now = now
        self._sleep = sleep
        self._world = simulation.build(scenario)
        self._state = simulation.init(self._world)
        self._score = metrics.begin(scenario)
        self._robots: dict[str, RobotState] = {one.name: "starting" for one in scenario.robots}
        self._late = dict.fromkeys(self._robots, 0)
        self._commands_total = 0
        self._events: list[Event] = []
        self._reported: dict[str, int] = {}
        self._newest: dict[str, Command] = {}
        self._started_s = 0.0
        self._beat_s = now()
        self._patient_until_s = 0.0
        self._status_due_s = 0.0
        self._phase: Literal["starting", "running", "ended"] = "starting"

    def run(self) -> Conduct:
        """See `conduct`."""
        stop, bus = self._stop, self._bus
        stop.wake = bus.wake
        bus.subscribe(COMMAND)
        bus.serve(messages.SCENARIO, self._answer_scenario)
        bus.serve(messages.CONTROL, self._answer_control)
        bus.announce("world", "world")
        self._gather()
        self._phase = "running"
        self._beat_s = self._now()
        self._started_s = self._now()
        ended = None
        while ended is None:
            self._report_rejected()
            self._inject_faults()
            frames = simulation.sense(self._world, self._state)
            for frame in frames:
                bus.publish(FRAME, frame, frame.robot)
            commands = self._collect(frames)
            record = simulation.record(
                self._world, self._state, frames, commands, tuple(self._events)
            )
            self._events.clear()
            metrics.observe(self._score, record)
            for observer in self._observers:
                observer(record)
            ended = metrics.ended(self._score) or stop.reason
            self._publish_status()
            if ended is None:
                newest = {command.robot: command for command in commands}
                self._state = simulation.step(self._world, self._state, newest)
                self._notice_contacts()
        self._phase = "ended"
        self._status_due_s = 0.0
        self._publish_status()
        return Conduct(
            score=self._score,
            ended=ended,
            wall_time_s=self._now() - self._started_s,
            late_commands=sum(self._late.values()),
            commands_total=self._commands_total,
            rejected_messages=sum(bus.rejected().values()),
        )

    # --- start ---

    def _gather(self) -> None:
        """Wait until every robot has said ready; begin without those that do not come."""
        deadline_s = self._now() + self._scenario.clock.start_timeout_s
        while self._stop.reason is None and (missing := self._absent()):
            if self._now() >= deadline_s:
                for name in missing:
                    self._lose(name, "missing", "robot-missing", "did not come up in time")
                break
            self._bus.receive(BARRIER_POLL_S)
            self._publish_status()
        for name, state in self._robots.items():
            if state == "starting":
                self._robots[name] = "running"
        self._event("start", None, self._scenario.title)

    def _absent(self) -> list[str]:
        alive = self._bus.alive()
        return [
            name
            for name, state in self._robots.items()
            if state in ("starting", "running") and ("robot", name) not in alive
        ]

    # --- one tick ---

    def _inject_faults(self) -> None:
        for number, fault in enumerate(self._scenario.faults):
            name, kind = fault.target, faults.kind_of(fault)
            if self._scenario.tick_of(fault.at_s) != self._state.tick:
                continue
            if self._robots[name] not in ("running", "collided"):
                self._event(
                    "fault", name, f"{kind}: {name} is {self._robots[name]} already", kind, number
                )
                continue
            request = messages.ProcessRequest(name, "kill")
            try:
                reply = self._bus.ask(messages.PROCESS, request, PROCESS_TIMEOUT_S)
                problem = "" if reply.ok else reply.text
            except errors.BusError as error:
                problem = str(error)
            if problem:
                self._event("fault-failed", name, f"{kind}: {problem}", kind, number)
            else:
                self._lose(name, "killed", "fault", kind, kind, number)

    def _collect(self, frames: Sequence[SensorFrame]) -> tuple[Command, ...]:
        """Commands of this tick in scenario order, by the clock of the scenario."""
        self._newest = {}
        if self._scenario.clock.mode == "realtime":
            self._sleep_until_tick(self._state.tick + 1)
            self._pause_while_alone()
            while (delivery := self._bus.receive(0.0)) is not None:
                self._take(delivery.message)
            self._lose_absent()
        else:
            self._barrier(frames)
            self._sleep_until_tick(self._state.tick + 1)
        return tuple(self._newest[name] for name in self._robots if name in self._newest)

    def _barrier(self, frames: Sequence[SensorFrame]) -> None:
        deadline_s = self._now() + self._scenario.clock.command_deadline_s
        waiting = self._waiting()
        while waiting:
            delivery = self._bus.receive(BARRIER_POLL_S)
            self._beat()
            if delivery is not None:
                self._take(delivery.message)
                if delivery.message.robot in self._newest:
                    waiting.discard(delivery.message.robot)
                continue
            self._pause_while_alone()
            if self._now() < self._patient_until_s:
                for frame in frames:  # it, or its answer, may have gone down with the link
                    if frame.robot in waiting:
                        self._bus.publish(FRAME, frame, frame.robot)
                continue
            self._lose_absent()
            if self._now() >= deadline_s:
                for name in sorted(waiting & self._waiting()):
                    self._lose(name, "hung", "robot-hung", "no command before the deadline")
            waiting = self._waiting()

    def _beat(self) -> None:
        """Notice that this process was stopped for a while: its links have timed out meanwhile."""
        now_s = self._now()
        if now_s - self._beat_s > STALL_S:
            self._patient_until_s = now_s + RETURN_S
        self._beat_s = now_s

    def _lose_absent(self) -> None:
        """Lose those whose token is gone, unless it was we who were away."""
        if self._now() >= self._patient_until_s:
            for name in self._absent():
                self._lose(name, "lost", "robot-lost", "its token is gone")

    def _waiting(self) -> set[str]:
        return {
            name
            for name, state in self._robots.items()
            if state in ("running", "collided") and name not in self._newest
        }

    def _take(self, command: Command) -> None:
        """Keep the newest command of a robot that is expected to send one; count the rest."""
        name, tick = command.robot, self._state.tick
        wrong = (
            "from a stranger"
            if name not in self._robots or command.beacon.name != name
            else "for a tick that has not come"
            if command.tick > tick or command.beacon.tick != command.tick
            else "from a robot that is not expected to send any"
            if self._robots[name] not in ("running", "collided")
            else "older than one that came before"
            if name in self._newest and self._newest[name].tick >= command.tick
            else "for a tick that is over"
            if command.tick < tick and self._scenario.clock.mode == "lockstep"
            else ""
        )
        if wrong:
            self._refuse(f"command {wrong}")
            return
        self._commands_total += 1
        self._late[name] += command.tick < tick
        self._newest[name] = command

    def _refuse(self, reason: str) -> None:
        self._reported[reason] = self._reported.get(reason, 0) + 1
        if self._reported[reason] == 1:
            self._event("message-rejected", None, reason)

    def _report_rejected(self) -> None:
        """One event for each new kind of message that the bus has ignored."""
        for reason in self._bus.rejected():
            if reason not in self._reported and len(self._reported) < REJECTED_REPORTS_MAX:
                self._reported[reason] = 0
                self._event("message-rejected", None, reason)

    def _sleep_until_tick(self, tick: int) -> None:
        rate = self._scenario.clock.rate
        if self._scenario.clock.mode == "realtime" and rate == 0.0:
            rate = 1.0
        if rate > 0.0:
            due_s = self._started_s + tick * self._scenario.dt_s / rate
            while self._stop.reason is None and (left_s := due_s - self._now()) > 0.0:
                self._sleep(min(left_s, SLEEP_S_MAX))
                self._beat()

    def _pause_while_alone(self) -> None:
        """Wait while the supervisor is stopped; when it is dead the kernel asks us to stop."""
        if not self._supervised:
            return
        paused_s = self._now()
        while self._stop.reason is None and not any(
            role == "supervisor" for role, _ in self._bus.alive()
        ):
            self._sleep(0.02)
            self._beat()
            self._patient_until_s = self._now() + RETURN_S  # perhaps our own link was down
        self._started_s += self._now() - paused_s  # a pause is no lost time

    def _notice_contacts(self) -> None:
        for body, name in zip(self._state.bodies, self._robots, strict=True):
            if body.contact and self._robots[name] == "running":
                self._robots[name] = "collided"
                self._event("collision", name, "touched something and is stopped where it is")

    def _lose(
        self,
        name: str,
        state: RobotState,
        kind: EventKind,
        text: str,
        fault: str = "",
        number: int = -1,
    ) -> None:
        self._robots[name] = state
        self._state = simulation.lose(self._world, self._state, name)
        self._event(kind, name, text, fault, number)

    def _event(
        self, kind: EventKind, robot: str | None, text: str, fault: str = "", number: int = -1
    ) -> None:
        tick = self._state.tick
        stamp_ns = self._scenario.stamp_ns(tick)
        event = Event(tick, stamp_ns, kind, robot, text, fault=fault, number=number)
        self._events.append(event)
        self._bus.publish(EVENT, event)

    # --- questions ---

    def _answer_scenario(self, request: ScenarioRequest) -> Reply:
        try:
            setup = self._scenario.setup(request.robot)
        except KeyError:
            known = ", ".join(self._robots)
            return Reply(False, f"expected one of {known}, got '{request.robot}'")
        return Reply(True, body=msgspec.msgpack.encode(setup))

    def _answer_control(self, request: ControlRequest) -> Reply:
        if request.action == "stop":
            self._stop.request("stopped by request")
        return Reply(True, body=messages.encode(self._make_status()))

    def _publish_status(self) -> None:
        if self._now() >= self._status_due_s:
            self._status_due_s = self._now() + STATUS_PERIOD_S
            status = self._make_status()
            self._bus.publish(STATUS, status)
            self._on_status(status)

    def _make_status(self) -> Status:
        tick, scenario = self._state.tick, self._scenario
        wall_s = self._now() - self._started_s if self._phase != "starting" else 0.0
        rows = []
        for body, (name, state) in zip(self._state.bodies, self._robots.items(), strict=True):
            beacon = body.beacon
            leader = beacon.leadership.name if beacon and beacon.leadership else ""
            rows.append(
                RobotStatus(
                    name=name,
                    state=state,
                    mode=beacon.mode if beacon else "",
                    leader=leader,
                    arrived=bool(beacon and beacon.arrived),
                    late_commands=self._late[name],
                    error_m=metrics.formation_error_now(self._score, name),
                    reason=beacon.reason if beacon else "",
                )
            )
        return Status(
            run=self._bus.run,
            scenario=scenario.title,
            tick=tick,
            stamp_ns=scenario.stamp_ns(tick),
            clock=scenario.clock.mode,
            state=self._phase,
            duration_s=scenario.duration_s,
            real_time_factor=tick * scenario.dt_s / wall_s if wall_s > 0.0 else 0.0,
            robots=tuple(rows),
            rejected_messages=sum(self._bus.rejected().values()),
        )
