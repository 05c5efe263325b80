"""One run over any bus: gather the robots, then tick by tick until it is over.

    faults due -> checkpoint -> sense -> frames out -> commands in -> record -> move

Pure functions of world.simulation do the work; this shell keeps the pace, moves the messages,
notices who is gone and tells everyone what happened.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Protocol

import msgspec

from swarm import faults, lifetime, metrics
from swarm.bus import Bus
from swarm.messages import COMMAND, EVENT, FRAME, Command, SensorFrame, Status, TickRecord
from swarm.scenario import Scenario
from world import simulation
from world.attendance import Attendance
from world.checkpoint import Checkpoint, Handling
from world.desk import Desk
from world.injector import Injector
from world.pace import SLEEP_S_MAX, Pace
from world.situation import Situation

BARRIER_POLL_S = 0.1  # how often a waiting world looks at the clock
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

    def note_kill(self, fault: str) -> None:
        """Keep that a fault is about to kill this world, even when no checkpoint can be kept."""

    def note_handling(self, handling: Handling) -> None:
        """Keep what people have set, and show the picture that they want."""


class Nowhere:
    """Keeper of a run that leaves nothing behind."""

    def save(self, checkpoint: bytes) -> None:
        """Not kept."""

    def disk_full(self, full: bool) -> None:
        """No disk."""

    def note_kill(self, fault: str) -> None:
        """Not kept."""

    def note_handling(self, handling: Handling) -> None:
        """Not kept."""


class Resumed(msgspec.Struct, frozen=True, eq=False):
    """Where a run goes on that another world began."""

    checkpoint: Checkpoint | None  # None: it was killed before it had made one
    score: metrics.Score  # of all ticks before
    kills: frozenset[str] = frozenset()  # faults, as texts, that have killed a world of this run
    handling: Handling | None = None  # None: as the scenario has it


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
        self._now = now
        self._sleep = sleep
        self._lockstep = scenario.clock.mode == "lockstep"
        self._run = Situation(scenario, lambda event: bus.publish(EVENT, event))
        self._attendance = Attendance(bus, self._run, supervised=supervised, now=now)
        self._injector = Injector(
            bus,
            self._run,
            self._attendance,
            ready=self._ready,
            save=self._save,
            disk_full=self._set_disk_full,
            note_kill=self._note_kill,
        )
        self._score = metrics.begin(scenario)
        self._pace = Pace(
            scenario,
            stop,
            now=now,
            sleep=sleep,
            attend=self._attend,
            say=self._heeded,
        )
        self._selected = ""
        self._desk = Desk(
            bus,
            self._run,
            stop,
            self._score,
            on_status=on_status,
            now=now,
            pace=self._pace,
        )
        self._reported: dict[str, int] = {}
        self._arrived: list[Command] = []  # in this tick, in order of arrival
        self._ready_until_s: dict[str, float] = {}
        self._saved_tick = -1
        self._checkpoint_ticks = max(1, int(CHECKPOINT_S / scenario.dt_s))

    def run(self, resumed: Resumed | None) -> Conduct:
        """See `conduct`."""
        stop, bus, run, desk = self._stop, self._bus, self._run, self._desk
        stop.wake = bus.wake
        if resumed is not None:
            self._score = desk.score = resumed.score
            self._injector.kills = resumed.kills
            if resumed.checkpoint is not None:
                run.resume(resumed.checkpoint)
                self._pace.wall_before_s = resumed.checkpoint.wall_time_s
            if (handling := resumed.handling) is not None:
                self._pace.restore(handling.rate, paused=handling.paused)
                self._selected = handling.selected
                self._note_handling()
        bus.subscribe(COMMAND)
        desk.open()
        bus.announce("world", "world")
        self._gather(resumed)
        desk.phase = "running"
        self._pace.begin(run.tick)
        struck = resumed is not None and resumed.checkpoint is not None  # made behind the faults
        ended = None
        while ended is None:
            self._pace.hold(run.tick)
            self._report_rejected()
            desk.take_faults()
            changed = desk.take_goals()
            if (selected := desk.take_selected()) is not None:
                self._selected = selected
                self._heeded(f"the picture shows what {selected or 'the leader'} sees")
            if not struck:
                changed |= self._injector.strike()
            struck = False
            if changed or run.tick >= self._saved_tick + self._checkpoint_ticks:
                self._save()
            frames = desk.frames = simulation.sense(run.world, run.state, run.orders())
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
            desk.publish()
            if ended is None:
                newest = {command.robot: command for command in record.commands}
                run.state = simulation.step(run.world, run.state, newest)
                self._notice_contacts()
        desk.close()
        return Conduct(
            score=self._score,
            ended=ended,
            wall_time_s=self._pace.wall_s(),
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

    def _gather(self, resumed: Resumed | None) -> None:
        """Wait until every robot has said ready; begin without those that do not come."""
        attendance, run = self._attendance, self._run
        deadline_s = self._now() + self._scenario.clock.start_timeout_s
        inspect_s = self._now()
        if resumed is None:
            inspect_s += INSPECT_S  # later some may have died while there was no world
        while self._stop.reason is None and (missing := attendance.absent()):
            if self._now() >= inspect_s:
                inspect_s = self._now() + INSPECT_S
                missing = [name for name in missing if not attendance.is_dead(name)]
            if self._now() >= deadline_s or not missing:
                break
            self._bus.receive(BARRIER_POLL_S)
            self._desk.publish()
        attendance.open(stopping=self._stop.reason is not None)
        attendance.beat()
        if resumed is None:
            run.event("start", None, self._scenario.title)
        else:
            attendance.be_patient()
            run.event("world-resumed", None, f"goes on at tick {run.tick}")
            full = any(isinstance(one.fault, faults.DiskFull) for one in run.state.active)
            self._set_disk_full(full)

    # --- what the injector needs ---

    def _ready(self, name: str) -> bool | None:
        """Whether a robot that was continued or started is ready. Lock-step waits for it."""
        now_s = self._now()
        until_s = self._ready_until_s.setdefault(name, now_s + self._scenario.clock.start_timeout_s)
        inspect_s = now_s + INSPECT_S
        while not self._attendance.has_token(name):
            if self._now() >= until_s or self._stop.reason is not None:
                del self._ready_until_s[name]
                return False
            if not self._lockstep:
                return None
            self._receive(BARRIER_POLL_S)
            self._desk.publish()
            self._pause_while_alone()
            if self._now() >= inspect_s:
                inspect_s = self._now() + INSPECT_S
                if self._attendance.is_dead(name):
                    until_s = 0.0
        del self._ready_until_s[name]
        self._attendance.be_patient(name)
        return True

    def _save(self) -> None:
        """Make a checkpoint of this moment, between faults and frames."""
        if self._keeper is not None:
            self._saved_tick = self._run.tick
            self._keeper.save(self._run.checkpoint(self._bus.run, self._pace.wall_s()))

    def _note_kill(self, fault: str) -> None:
        if self._keeper is not None:
            self._keeper.note_kill(fault)

    def _set_disk_full(self, full: bool) -> None:
        if self._keeper is not None:
            self._keeper.disk_full(full)

    # --- one tick ---

    def _collect(self, frames: Sequence[SensorFrame]) -> tuple[Command, ...]:
        """Commands that take effect in this tick, by the clock of the scenario."""
        self._arrived = []
        if self._lockstep:
            self._barrier(frames)
            self._pace.wait(self._run.tick + 1)
        else:
            self._pace.wait(self._run.tick + 1)
            self._pause_while_alone()
            while self._receive(0.0):
                pass
        self._attendance.notice_returns()
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
        attendance = self._attendance
        deadline_s = self._now() + self._scenario.clock.command_deadline_s
        waiting = self._waiting()
        while waiting:
            delivery = self._bus.receive(BARRIER_POLL_S)
            attendance.beat()
            if delivery is not None:
                self._take(delivery.message)
                if self._has_answered(delivery.message.robot):
                    waiting.discard(delivery.message.robot)
                continue
            self._pause_while_alone()
            if self._stop.reason is not None:
                deadline_s = min(deadline_s, self._now() + STOPPING_S)
            for frame in frames:
                if frame.robot in waiting and attendance.is_patient_with(frame.robot):
                    # it, or its answer, may have gone down with the link
                    self._bus.publish(FRAME, frame, frame.robot)
            attendance.notice_losses()
            self._desk.publish()
            waiting = self._waiting()
            if self._now() >= deadline_s:
                if self._stop.reason is not None:
                    return
                for name in sorted(waiting):
                    attendance.hang(name, "no command before the deadline")
                    self._run.change(name, owes=True)
                waiting = self._waiting()

    def _waiting(self) -> set[str]:
        """Who has not answered the frame of this tick."""
        return {
            name
            for name, member in self._run.members.items()
            if member.is_present and member.answered_tick < member.sent_tick
        }

    def _has_answered(self, name: str) -> bool:
        member = self._run.members.get(name)
        return member is not None and member.answered_tick >= member.sent_tick

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
            if not self._attendance.is_patient_with(name):  # else it was asked twice
                self._refuse("command for a frame that has been answered")
        else:
            self._run.commands_total += 1
            self._desk.pulse.beat(name, self._now())
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

    def _notice_contacts(self) -> None:
        run = self._run
        for body, (name, member) in zip(run.state.bodies, run.members.items(), strict=True):
            if body.contact and member.state == "running":
                run.change(name, state="collided")
                run.event("collision", name, "touched something and is stopped where it is")

    # --- pace ---

    def _heeded(self, text: str) -> None:
        """Something that people have asked for is done."""
        self._run.event("control", None, text)
        self._note_handling()

    def _note_handling(self) -> None:
        if self._keeper is not None:
            handling = Handling(self._pace.rate, self._pace.will_pause, self._selected)
            self._keeper.note_handling(handling)

    def _attend(self) -> None:
        """What must not wait while this process sleeps."""
        self._attendance.beat()
        self._attendance.notice_losses()
        self._desk.publish()

    def _pause_while_alone(self) -> None:
        """Wait while the supervisor is stopped; when it is dead the kernel asks us to stop."""
        if not self._supervised:
            return
        paused_s = self._now()
        while self._stop.reason is None and not any(
            role == "supervisor" for role, _ in self._bus.alive()
        ):
            self._sleep(SLEEP_S_MAX)
            self._attendance.beat()
            self._attendance.be_patient()  # perhaps our own link was down
        self._pace.forget(self._now() - paused_s)
