"""One run over any bus: gather the robots, then tick by tick until it is over.

    faults due -> checkpoint -> sense -> frames out -> commands in -> record -> move

Pure functions of world.simulation do the work; this shell keeps the pace, moves the messages,
notices who is gone and tells everyone what happened.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Literal, Protocol

import msgspec

from swarm import errors, faults, lifetime, messages, metrics
from swarm import scenario as scenarios
from swarm.bus import Bus
from swarm.faults import Fault
from swarm.messages import (
    COMMAND,
    EVENT,
    FRAME,
    STATUS,
    Command,
    ControlRequest,
    Event,
    Reply,
    RobotStatus,
    ScenarioRequest,
    SensorFrame,
    Status,
    TickRecord,
)
from swarm.scenario import Scenario
from world import roster, simulation
from world.checkpoint import Checkpoint
from world.injector import Injector
from world.pulse import Pulse
from world.roster import Member
from world.situation import Situation

STATUS_PERIOD_S = 0.5  # wall
BARRIER_POLL_S = 0.1  # how often a waiting world looks at the clock
STALL_S = 0.45  # between two looks at the clock; links time out after 0.5 s
RETURN_S = 5.0  # a world that was stopped itself gives the others so long to come back
SLEEP_S_MAX = 0.02  # how late a sleeping world notices that it should stop, or who is gone
STOPPING_S = 1.0  # a tick is given up when it does not end so long after a request to stop
INSPECT_S = 1.0  # between two questions about a process that does not become ready
CHECKPOINT_S = 0.9  # simulated, at most, between two checkpoints
REJECTED_REPORTS_MAX = 20  # events about ignored messages; all of them are counted

Observer = Callable[[TickRecord], None]


class Keeper(Protocol):
    """Where a run's memory is kept."""

    def save(self, checkpoint: bytes) -> None:
        """Keep a checkpoint in the place of the one before; everything observed is safe by then."""

    def disk_full(self, full: bool) -> None:
        """From now on the recorder's disk takes nothing, or takes all again."""


class Nowhere:
    """Keeper of a run that leaves nothing behind."""

    def save(self, checkpoint: bytes) -> None:
        """Not kept."""

    def disk_full(self, full: bool) -> None:
        """No disk."""


class Resumed(msgspec.Struct, frozen=True, eq=False):
    """Where a run goes on that another world began."""

    checkpoint: Checkpoint | None  # None: it was killed before it had made one
    score: metrics.Score  # of all ticks before


class Conduct(msgspec.Struct):
    """What a finished run leaves behind; see `conduct`."""

    score: metrics.Score
    ended: str
    wall_time_s: float
    late_commands: int
    commands_total: int
    rejected_messages: int
    restarts: dict[str, int]


def conduct(
    bus: Bus,
    scenario: Scenario,
    observers: Sequence[Observer],
    stop: lifetime.Stop,
    *,
    supervised: bool = False,
    keeper: Keeper | None = None,
    resumed: Resumed | None = None,
    on_status: Callable[[Status], None] = lambda status: None,
    now: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> Conduct:
    """Run the scenario to its end over a bus whose robots are there or on their way.

    Args:
        observers: called with every TickRecord, inline, in order.
        stop: may be requested from anywhere; the tick at hand is finished first.
        supervised: pause while the supervisor's token is away (Ctrl-Z there).
        keeper: where checkpoints go; without one none are made.
        resumed: go on where another world was killed.
        on_status: called with what is also published twice a second.
    """
    conductor = _Conductor(
        bus, scenario, observers, stop, supervised, keeper, on_status, now, sleep
    )
    return conductor.run(resumed)


class _Conductor:
    def __init__(
        self,
        bus: Bus,
        scenario: Scenario,
        observers: Sequence[Observer],
        stop: lifetime.Stop,
        supervised: bool,
        keeper: Keeper | None,
        on_status: Callable[[Status], None],
        now: Callable[[], float],
        sleep: Callable[[float], None],
    ) -> None:
        self._bus = bus
        self._scenario = scenario
        self._observers = observers
        self._stop = stop
        self._supervised = supervised
        self._keeper = keeper
        self._on_status = on_status
        self._now = now
        self._sleep = sleep
        self._lockstep = scenario.clock.mode == "lockstep"
        self._run = Situation(scenario, self._tell)
        self._injector = Injector(
            bus,
            self._run,
            ready=self._ready,
            save=self._save,
            disk_full=self._keep_away,
        )
        self._score = metrics.begin(scenario)
        self._asked: deque[Fault] = deque()  # live faults, from the query's thread
        self._reported: dict[str, int] = {}
        self._arrived: list[Command] = []  # in this tick, in order of arrival
        self._frames: Sequence[SensorFrame] = ()  # of this tick
        self._pulse = Pulse()
        self._started_s = 0.0  # when tick 0 was due
        self._began_s = 0.0
        self._wall_before_s = 0.0  # of the worlds before this one
        self._beat_s = now()
        self._patient_until_s = 0.0  # with everyone
        self._patient_with_s: dict[str, float] = {}  # with those that have just come back
        self._ready_until_s: dict[str, float] = {}
        self._status_due_s = 0.0
        self._saved_tick = -1
        self._checkpoint_ticks = max(1, int(CHECKPOINT_S / scenario.dt_s))
        self._phase: Literal["starting", "running", "ended"] = "starting"

    def run(self, resumed: Resumed | None) -> Conduct:
        """See `conduct`."""
        stop, bus, run = self._stop, self._bus, self._run
        stop.wake = bus.wake
        if resumed is not None:
            self._score = resumed.score
            if resumed.checkpoint is not None:
                run.resume(resumed.checkpoint)
                self._wall_before_s = resumed.checkpoint.wall_time_s
        bus.subscribe(COMMAND)
        bus.serve(messages.SCENARIO, self._answer_scenario)
        bus.serve(messages.CONTROL, self._answer_control)
        bus.announce("world", "world")
        self._gather()
        self._phase = "running"
        self._beat_s = self._now()
        self._began_s = self._now()
        self._started_s = self._began_s - run.tick * self._tick_s()
        struck = False  # a checkpoint is made behind the faults of its tick
        if resumed is not None:
            struck = resumed.checkpoint is not None
            self._patient_until_s = self._began_s + RETURN_S
            run.event("world-resumed", None, f"goes on at tick {run.tick}")
            self._keep_away(any(isinstance(one.fault, faults.DiskFull) for one in run.state.active))
        ended = None
        while ended is None:
            self._report_rejected()
            self._take_live_faults()
            changed = False if struck else self._injector.strike()
            struck = False
            if changed or run.tick >= self._saved_tick + self._checkpoint_ticks:
                self._save()
            frames = self._frames = simulation.sense(run.world, run.state)
            for frame in frames:
                bus.publish(FRAME, frame, frame.robot)
                run.change(frame.robot, sent_tick=frame.tick)
            commands = self._collect(frames)
            record = simulation.record(run.world, run.state, frames, commands, tuple(run.events))
            run.events.clear()
            metrics.observe(self._score, record)
            for observer in self._observers:
                observer(record)
            ended = self._ended() or stop.reason
            self._publish_status()
            if ended is None:
                newest = {command.robot: command for command in record.commands}
                run.state = simulation.step(run.world, run.state, newest)
                self._notice_contacts()
        self._phase = "ended"
        self._status_due_s = 0.0
        self._publish_status()
        return Conduct(
            score=self._score,
            ended=ended,
            wall_time_s=self._wall_s(),
            late_commands=sum(member.late_commands for member in run.members.values()),
            commands_total=run.commands_total,
            rejected_messages=sum(bus.rejected().values()),
            restarts={name: member.restarts for name, member in run.members.items()},
        )

    def _ended(self) -> str | None:
        """Why it is over; as long as somebody is due to come back only time can end it."""
        ended = metrics.ended(self._score)
        expected = any(member.is_expected for member in self._run.members.values())
        if expected and ended in ("arrived", "blocked", "stranded"):
            timeout_tick = self._scenario.tick_of(self._scenario.duration_s)
            return "timeout" if self._run.tick >= timeout_tick else None
        return ended

    # --- start ---

    def _gather(self) -> None:
        """Wait until every robot has said ready; begin without those that do not come."""
        deadline_s = self._now() + self._scenario.clock.start_timeout_s
        resumed = any(member.state != "starting" for member in self._run.members.values())
        while self._stop.reason is None and (missing := self._absent()):
            if resumed and self._supervised:  # some may have died while there was no world
                missing = [name for name in missing if not self._is_dead(name)]
            if self._now() >= deadline_s or not missing:
                break
            self._bus.receive(BARRIER_POLL_S)
            self._publish_status()
        for name in self._absent() if self._stop.reason is None else ():
            self._miss(name)
        for name, member in self._run.members.items():
            if member.state == "starting":
                self._run.change(name, state="running")
        if not resumed:
            self._run.event("start", None, self._scenario.title)

    def _miss(self, name: str) -> None:
        if self._run.members[name].state == "starting":
            self._run.lose(name, "missing")
            self._run.event("robot-missing", name, "did not come up in time")
        else:
            self._lose_token(name)

    def _absent(self) -> list[str]:
        alive = self._bus.alive()
        return [
            name
            for name, member in self._run.members.items()
            if (member.is_present or member.state == "starting")
            and self._token(name, member) not in alive
        ]

    @staticmethod
    def _token(name: str, member: Member) -> tuple[str, str]:
        return "robot", messages.token_name(name, member.incarnation)

    # --- faults ---

    def _take_live_faults(self) -> None:
        while self._asked:
            self._run.faults.append(self._asked.popleft())

    def _ready(self, name: str) -> bool | None:
        """Whether a robot that was continued or started is ready. Lock-step waits for it."""
        now_s = self._now()
        until_s = self._ready_until_s.setdefault(name, now_s + self._scenario.clock.start_timeout_s)
        inspect_s = now_s + INSPECT_S
        while self._token(name, self._run.members[name]) not in self._bus.alive():
            if self._now() >= until_s or self._stop.reason is not None:
                del self._ready_until_s[name]
                return False
            if not self._lockstep:
                return None
            self._receive(BARRIER_POLL_S)
            self._publish_status()
            self._pause_while_alone()
            if self._now() >= inspect_s:
                inspect_s = self._now() + INSPECT_S
                if self._is_dead(name):
                    until_s = 0.0
        del self._ready_until_s[name]
        self._patient_with_s[name] = self._now() + RETURN_S
        return True

    def _is_dead(self, name: str) -> bool:
        done, said = self._injector.ask(name, "inspect")
        return done and said.startswith("dead")

    def _save(self) -> None:
        """Make a checkpoint of this moment, between faults and frames."""
        if self._keeper is not None:
            self._saved_tick = self._run.tick
            self._keeper.save(self._run.checkpoint(self._bus.run, self._wall_s()))

    def _keep_away(self, full: bool) -> None:
        if self._keeper is not None:
            self._keeper.disk_full(full)

    # --- one tick ---

    def _collect(self, frames: Sequence[SensorFrame]) -> tuple[Command, ...]:
        """Commands that take effect in this tick, by the clock of the scenario."""
        self._arrived = []
        if self._lockstep:
            self._barrier(frames)
            self._sleep_until_tick(self._run.tick + 1)
        else:
            self._sleep_until_tick(self._run.tick + 1)
            self._pause_while_alone()
            while self._receive(0.0):
                pass
        self._notice_returns()
        run = self._run
        run.state, commands = simulation.hold_back(run.world, run.state, self._arrived)
        return commands

    def _receive(self, timeout_s: float) -> bool:
        """Take one command, if one is there within the time."""
        delivery = self._bus.receive(timeout_s)
        if delivery is not None:
            self._take(delivery.message)
        return delivery is not None

    def _barrier(self, frames: Sequence[SensorFrame]) -> None:
        deadline_s = self._now() + self._scenario.clock.command_deadline_s
        waiting = self._waiting()
        while waiting:
            delivery = self._bus.receive(BARRIER_POLL_S)
            self._beat()
            if delivery is not None:
                self._take(delivery.message)
                if self._has_answered(delivery.message.robot):
                    waiting.discard(delivery.message.robot)
                continue
            self._pause_while_alone()
            if self._stop.reason is not None:
                deadline_s = min(deadline_s, self._now() + STOPPING_S)
            for frame in frames:
                if frame.robot in waiting and self._is_patient_with(frame.robot):
                    # it, or its answer, may have gone down with the link
                    self._bus.publish(FRAME, frame, frame.robot)
            self._lose_absent()
            self._publish_status()
            waiting = self._waiting()
            if self._now() >= deadline_s:
                if self._stop.reason is not None:
                    return
                for name in sorted(waiting):
                    self._run.lose(name, "hung")
                    self._run.event("robot-hung", name, "no command before the deadline")
                    self._run.change(name, start_tick=self._due_when_hung(name))
                waiting = self._waiting()

    def _is_patient_with(self, name: str) -> bool:
        return self._now() < max(self._patient_until_s, self._patient_with_s.get(name, 0.0))

    def _has_answered(self, name: str) -> bool:
        member = self._run.members.get(name)
        return member is not None and member.answered_tick >= member.sent_tick

    def _beat(self) -> None:
        """Notice that this process was stopped for a while: its links have timed out meanwhile."""
        now_s = self._now()
        if now_s - self._beat_s > STALL_S:
            self._patient_until_s = now_s + RETURN_S
        self._beat_s = now_s

    def _lose_absent(self) -> None:
        """Lose those whose token is gone, unless it was we who were away, or they are back."""
        for name in self._absent():
            if not self._is_patient_with(name) or (self._supervised and self._is_dead(name)):
                self._lose_token(name)

    def _lose_token(self, name: str) -> None:
        """A token that is gone means silence; what it comes from the supervisor can see."""
        run = self._run
        done, said = self._injector.ask(name, "inspect") if self._supervised else (False, "")
        run.lose(name, "lost")
        if done and not said.startswith("dead"):
            run.lose(name, "hung")
            run.event("robot-hung", name, f"its token is gone, its process is {said}")
            run.change(name, start_tick=self._due_when_hung(name))
            return
        run.event("robot-lost", name, f"its token is gone{', ' if said else ''}{said}")
        run.change(name, start_tick=self._injector.start_due(name))

    def _due_when_hung(self, name: str) -> int | None:
        return self._injector.start_due(name, after_s=self._scenario.restart.hang_timeout_s)

    def _notice_returns(self) -> None:
        """Those that were away and are there again by themselves go on in the next tick."""
        run = self._run
        for name, member in run.members.items():
            if member.state not in roster.AWAY or member.hang is not None or member.awaited:
                continue
            if self._token(name, member) not in self._bus.alive():
                continue
            if member.state == "hung" and member.answered_tick < member.sent_tick:
                continue  # its link lives, its loop does not answer yet
            run.welcome(name)
            self._patient_with_s[name] = self._now() + RETURN_S

    def _waiting(self) -> set[str]:
        """Who has not answered the frame of this tick."""
        return {
            name
            for name, member in self._run.members.items()
            if member.is_present and member.answered_tick < member.sent_tick
        }

    def _take(self, command: Command) -> None:
        """Keep a robot's answer to a frame of its own; count and report the rest.

        Late answers are kept too, for replay: they tell what the robot has seen.
        """
        name, tick = command.robot, self._run.tick
        member = self._run.members.get(name)
        if member is None or command.beacon.name != name:
            self._refuse("command from a stranger")
        elif command.beacon.incarnation != member.incarnation:
            self._refuse("command from a process that is not the robot's newest")
        elif command.tick > member.sent_tick or command.beacon.tick != command.tick:
            self._refuse("command for a frame that was not sent")
        elif command.tick <= member.answered_tick:
            if not self._is_patient_with(name):  # else it was asked twice
                self._refuse("command for a frame that has been answered")
        else:
            self._run.commands_total += 1
            self._pulse.beat(name, self._now())
            late = member.late_commands + (command.tick < tick and member.is_present)
            self._run.change(name, answered_tick=command.tick, late_commands=late)
            self._arrived.append(command)

    def _refuse(self, reason: str) -> None:
        self._reported[reason] = self._reported.get(reason, 0) + 1
        if self._reported[reason] == 1:
            self._run.event("message-rejected", None, reason)

    def _report_rejected(self) -> None:
        """One event for each new kind of message that the bus has ignored."""
        for reason in self._bus.rejected():
            if reason not in self._reported and len(self._reported) < REJECTED_REPORTS_MAX:
                self._reported[reason] = 0
                self._run.event("message-rejected", None, reason)

    def _tick_s(self) -> float:
        """Wall time of a tick, 0: as fast as it goes."""
        rate = self._scenario.clock.rate
        if rate == 0.0:
            return 0.0 if self._lockstep else self._scenario.dt_s
        return self._scenario.dt_s / rate

    def _sleep_until_tick(self, tick: int) -> None:
        tick_s = self._tick_s()
        if tick_s > 0.0:
            due_s = self._started_s + tick * tick_s
            while self._stop.reason is None and (left_s := due_s - self._now()) > 0.0:
                self._sleep(min(left_s, SLEEP_S_MAX))
                self._beat()
                self._lose_absent()

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
        self._began_s += self._now() - paused_s

    def _notice_contacts(self) -> None:
        run = self._run
        for body, (name, member) in zip(run.state.bodies, run.members.items(), strict=True):
            if body.contact and member.state == "running":
                run.change(name, state="collided")
                run.event("collision", name, "touched something and is stopped where it is")

    def _tell(self, event: Event) -> None:
        self._bus.publish(EVENT, event)

    # --- questions ---

    def _answer_scenario(self, request: ScenarioRequest) -> Reply:
        try:
            setup = self._scenario.setup(request.robot)
        except KeyError:
            known = ", ".join(self._run.members)
            return Reply(False, f"expected one of {known}, got '{request.robot}'")
        return Reply(True, body=msgspec.msgpack.encode(setup))

    def _answer_control(self, request: ControlRequest) -> Reply:
        if request.action == "stop":
            self._stop.request("stopped by request")
        text = ""
        if request.action == "fault":
            try:
                text = self._accept(request.spec)
            except errors.ScenarioError as error:
                return Reply(False, str(error))
        return Reply(True, text, messages.encode(self._make_status()))

    def _accept(self, spec: str) -> str:
        """Take a fault that is asked for while the run goes on; raises ScenarioError."""
        next_s = (self._run.tick + 1) * self._scenario.dt_s
        fault = scenarios.fault(spec, at_s=next_s, names=list(self._run.members))
        if fault.at_s < next_s - self._scenario.dt_s:
            raise errors.ScenarioError(
                f"{spec}: expected a time that is still to come, got {fault.at_s:g} s at "
                f"{next_s:.2f} s; leave @start_s out for now"
            )
        self._asked.append(fault)
        return faults.text_of(fault)

    def _publish_status(self) -> None:
        if self._now() >= self._status_due_s:
            self._status_due_s = self._now() + STATUS_PERIOD_S
            self._pulse.measure(self._now(), self._run.tick)
            status = self._make_status()
            self._bus.publish(STATUS, status)
            self._on_status(status)

    def _wall_s(self) -> float:
        """Wall time of the ticks so far, of this world and of those before it."""
        if self._phase == "starting":
            return self._wall_before_s
        return self._wall_before_s + self._now() - self._began_s

    def _make_status(self) -> Status:
        run, scenario = self._run, self._scenario
        wall_s, now_s, pulse = self._wall_s(), self._now(), self._pulse
        heard = {frame.robot: len(frame.beacons) for frame in self._frames}
        rows = []
        for body, (name, member) in zip(run.state.bodies, run.members.items(), strict=True):
            beacon = body.beacon
            leader = beacon.leadership.name if beacon and beacon.leadership else ""
            rows.append(
                RobotStatus(
                    name=name,
                    state=member.state,
                    mode=beacon.mode if beacon else "",
                    leader=leader,
                    arrived=bool(beacon and beacon.arrived),
                    late_commands=member.late_commands,
                    error_m=metrics.formation_error_now(self._score, name),
                    reason=beacon.reason if beacon else "",
                    restarts=member.restarts,
                    heard=heard.get(name, 0),
                    yields_to=(beacon and beacon.yields_to) or "",
                    commands_per_s=pulse.rate(name),
                    command_age_s=pulse.age_s(name, now_s),
                    unanswered=max(0, member.sent_tick - member.answered_tick),
                )
            )
        return Status(
            run=self._bus.run,
            scenario=scenario.title,
            tick=run.tick,
            stamp_ns=scenario.stamp_ns(run.tick),
            clock=scenario.clock.mode,
            state=self._phase,
            duration_s=scenario.duration_s,
            real_time_factor=run.tick * scenario.dt_s / wall_s if wall_s > 0.0 else 0.0,
            robots=tuple(rows),
            rejected_messages=sum(self._bus.rejected().values()),
            rate=scenario.clock.rate,
            real_time_factor_now=pulse.ticks_per_s * scenario.dt_s,
        )
