"""Carries out faults, and brings processes back, exactly at the tick when they are due.

    faults due and over, starts due --> supervisor asked | world's state changed --> events

What is done to a process is asked of the supervisor, and the run goes on when it says that it is
done: so a kill at a tick gives the same bytes every time. Everything else the world does itself.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from swarm import faults
from swarm.bus import Bus
from swarm.faults import Fault
from swarm.messages import COMMAND, FRAME
from world import roster, simulation
from world.attendance import Attendance
from world.situation import Situation

GARBAGE_BYTES_MAX = 400
GARBAGE_STREAM = 11  # of the seed's draws


class Injector:
    """The hand of the fault language in one conducted run."""

    def __init__(
        self,
        bus: Bus,
        situation: Situation,
        attendance: Attendance,
        *,
        ready: Callable[[str], bool | None],
        save: Callable[[], None],
        disk_full: Callable[[bool], None],
        note_kill: Callable[[str], None],
    ) -> None:
        """Args:
        ready: whether a robot that was continued or started is ready; None: not yet, ask again.
        save: makes a checkpoint at once: the world is about to be killed.
        disk_full: from now on the recorder's disk takes nothing, or takes all again.
        note_kill: keeps that a fault is about to kill the world, whatever the disk is like.
        """
        self._bus = bus
        self._now = situation
        self._attendance = attendance
        self._ready = ready
        self._save = save
        self._disk_full = disk_full
        self._note_kill = note_kill
        self.kills: frozenset[str] = frozenset()  # faults that have killed a world of this run

    def strike(self) -> bool:
        """All that is due at this tick; whether the state of any process has changed."""
        now = self._now
        before = dict(now.members)
        self._end()
        last: list[int] = []
        for number, fault in enumerate(now.faults):
            if number not in now.struck and now.scenario.tick_of(fault.at_s) <= now.tick:
                now.struck.add(number)
                if isinstance(fault, faults.Kill) and fault.target == faults.WORLD:
                    last.append(number)
                else:
                    self._begin(number, fault)
        for name, member in list(now.members.items()):
            if member.start_tick is not None and member.start_tick <= now.tick:
                self._start(name)
        for name, member in list(now.members.items()):
            if member.awaited:
                self._await(name)
        self._spill_garbage()
        for number in last:
            self._kill_world(number)
        return now.members != before

    # --- beginnings ---

    def _begin(self, number: int, fault: Fault) -> None:
        now = self._now
        if isinstance(fault, faults.DiskFull):
            now.event("fault", None, faults.text_of(fault), number=number)
            now.state = simulation.inflict(now.world, now.state, number, fault, ())
            self._disk_full(True)
            return
        names = list(now.members)
        rows = faults.choose(
            fault.target,
            names,
            [member.is_present for member in now.members.values()],
            now.leader(),
            seed=now.scenario.seed,
            number=number,
        )
        if not rows:
            now.event("fault", None, f"{faults.text_of(fault)}: nobody is there", number=number)
        if not isinstance(fault, faults.ProcessFault):
            now.state = simulation.inflict(now.world, now.state, number, fault, rows)
            for row in rows:
                now.event("fault", names[row], faults.text_of(fault), number=number)
            return
        for row in rows:
            self._begin_process(number, fault, names[row])

    def _kill_world(self, number: int) -> None:
        """The end of this world; the next one goes on behind this fault."""
        now = self._now
        text = faults.text_of(now.faults[number])
        now.event("fault", None, text, number=number)
        if text in self.kills:  # it has, before a checkpoint could be kept behind it
            return
        self._note_kill(text)
        self._save()
        done, said = self._attendance.ask(faults.WORLD, "kill")
        if not done:
            now.event("fault-failed", None, f"kill: {said}", number=number)

    def _begin_process(self, number: int, fault: Fault, name: str) -> None:
        now = self._now
        member = now.members[name]
        text = faults.text_of(fault)
        if not member.is_present and not isinstance(fault, faults.Restart):
            now.event("fault", name, f"{text}: {name} is {member.state} already", number=number)
            return
        done, said = self._attendance.ask(
            name, "stop" if isinstance(fault, faults.Hang) else "kill"
        )
        if not done:
            now.event("fault-failed", name, f"{text}: {said}", number=number)
            return
        now.event("fault", name, text, number=number)
        tick, scenario = now.tick, now.scenario
        lasts = None if fault.for_s is None else max(1, scenario.tick_of(fault.for_s))
        match fault:
            case faults.Hang():
                now.lose(name, "hung")
                member = now.members[name]
                due = (
                    roster.start_due(
                        scenario, member, tick, after_s=scenario.restart.hang_timeout_s
                    )
                    if lasts is None
                    else None
                )
                end = None if lasts is None else tick + lasts
                now.change(name, hang=number, continue_tick=end, start_tick=due)
            case faults.Restart():
                now.lose(name, "restarting")
                now.change(name, start_tick=tick + (lasts or 1))
            case _:
                now.lose(name, "killed")
                now.change(name, start_tick=roster.start_due(scenario, member, tick))

    # --- ends ---

    def _end(self) -> None:
        now = self._now
        now.state, over = simulation.relieve(now.world, now.state)
        names = list(now.members)
        for active in over:
            if isinstance(active.fault, faults.DiskFull):
                self._disk_full(False)
                now.event("fault-over", None, "", number=active.number)
            for row in active.rows:
                now.event("fault-over", names[row], "", number=active.number)
        for name, member in list(now.members.items()):
            if member.continue_tick is not None and member.continue_tick <= now.tick:
                self._continue(name)

    def _continue(self, name: str) -> None:
        now = self._now
        done, said = self._attendance.ask(name, "continue")
        now.change(name, continue_tick=None, awaited="back" if done else "")
        if not done:
            self._give_up(name, f"continue: {said}")

    # --- coming back ---

    def _start(self, name: str) -> None:
        """Start a robot again; a process of it that is left is killed by the supervisor."""
        now = self._now
        incarnation = now.members[name].incarnation + 1
        now.start(name, incarnation)
        done, said = self._attendance.ask(name, "start", incarnation)
        if not done:
            self._give_up(name, f"start: {said}")

    def _await(self, name: str) -> None:
        ready = self._ready(name)
        if ready:
            self._now.welcome(name)
        elif ready is False:
            self._give_up(name, "it did not become ready in time")

    def _give_up(self, name: str, text: str) -> None:
        """A robot does not come back; the policy may try again."""
        now = self._now
        now.lose(name, "missing")
        now.event("robot-missing", name, text)
        now.change(name, start_tick=self._attendance.start_due(name))

    # --- garbage ---

    def _spill_garbage(self) -> None:
        """What `corrupt` puts on the topics of a robot: bytes of any length, drawn by the seed."""
        now = self._now
        names = list(now.members)
        for active in now.state.active:
            if not isinstance(active.fault, faults.Corrupt):
                continue
            for row in active.rows:
                key = [now.scenario.seed, GARBAGE_STREAM + (active.number << 8)]
                generator = np.random.Generator(
                    np.random.Philox(key=key, counter=[0, now.tick, row, 0])
                )
                size = int(generator.integers(0, GARBAGE_BYTES_MAX))
                payload = generator.bytes(size)
                self._bus.publish_raw(FRAME, payload, names[row])
                self._bus.publish_raw(COMMAND, payload, names[row])
