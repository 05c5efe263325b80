"""What the world answers while it runs: scenarios to robots, status and faults to people.

Answers are given on a thread of the bus: they read what the run has made, and leave what they are
asked for where the run takes it up at its next tick.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from typing import Literal

import msgspec

from swarm import errors, faults, lifetime, messages, metrics
from swarm import scenario as scenarios
from swarm.bus import Bus
from swarm.faults import Fault
from swarm.messages import (
    STATUS,
    ControlRequest,
    Goal,
    Reply,
    RobotStatus,
    ScenarioRequest,
    SensorFrame,
    Status,
)
from world.pace import Pace
from world.pulse import Pulse
from world.situation import Situation

STATUS_PERIOD_S = 0.5  # wall

Phase = Literal["starting", "running", "ended"]


class Desk:
    """Answers for one conducted run."""

    def __init__(
        self,
        bus: Bus,
        situation: Situation,
        stop: lifetime.Stop,
        score: metrics.Score,
        *,
        on_status: Callable[[Status], None],
        now: Callable[[], float],
        pace: Pace,
    ) -> None:
        """`on_status` hears all that is published."""
        self.phase: Phase = "starting"
        self.score = score
        self._bus = bus
        self._run = situation
        self._stop = stop
        self._on_status = on_status
        self._now = now
        self._pace = pace
        self.frames: Sequence[SensorFrame] = ()  # of this tick
        self.pulse = Pulse()
        self._asked: deque[Fault] = deque()
        self._goals: deque[tuple[str, Goal]] = deque()
        self._selected: str | None = None
        self._due_s = 0.0

    def open(self) -> None:
        """Answer from now on."""
        self._bus.serve(messages.SCENARIO, self._answer_scenario)
        self._bus.serve(messages.CONTROL, self._answer_control)

    def take_faults(self) -> None:
        """Add the faults that people have asked for to those of the run."""
        while self._asked:
            self._run.faults.append(self._asked.popleft())

    def take_goals(self) -> bool:
        """Pass on the goals that people have asked for; whether there were any."""
        taken = False
        while self._goals:
            self._run.order(*self._goals.popleft())
            taken = True
        return taken

    def take_selected(self) -> str | None:
        """Whom people have asked to see since, "" for the leader; None when they have not."""
        selected, self._selected = self._selected, None
        return selected

    def publish(self) -> None:
        """Tell the status, if it is time to."""
        if self._now() >= self._due_s:
            self._due_s = self._now() + STATUS_PERIOD_S
            self.pulse.measure(self._now(), self._run.tick)
            status = self._status()
            self._bus.publish(STATUS, status)
            self._on_status(status)

    def close(self) -> None:
        """Tell the last status, whatever the time."""
        self.phase = "ended"
        self._due_s = 0.0
        self.publish()

    def _answer_scenario(self, request: ScenarioRequest) -> Reply:
        try:
            setup = self._run.scenario.setup(request.robot)
        except KeyError:
            known = ", ".join(self._run.members)
            return Reply(False, f"expected one of {known}, got '{request.robot}'")
        return Reply(True, body=msgspec.msgpack.encode(setup))

    def _answer_control(self, request: ControlRequest) -> Reply:
        text = ""
        if request.action == "stop":
            self._stop.request("stopped by request")
        elif request.action in ("pause", "resume", "step", "rate"):
            self._pace.order(request)
        elif request.action == "fault":
            try:
                text = self._accept(request.spec)
            except errors.ScenarioError as error:
                return Reply(False, str(error))
        elif request.action == "select":
            selected = "" if request.robot == "leader" else request.robot
            if selected and (unknown := self._unknown(selected)) is not None:
                return Reply(False, unknown)
            self._selected = selected
            text = f"the picture shows what {request.robot} sees"
        elif request.action == "goal":
            name = self._run.leader() if request.robot == "leader" else request.robot
            if (problem := self._against(name or request.robot)) is not None:
                return Reply(False, problem)
            self._goals.append((name or request.robot, request.goal))
            text = f"{name} goes to ({request.goal[0]:g}, {request.goal[1]:g})"
        return Reply(True, text, messages.encode(self._status()))

    def _against(self, name: str) -> str | None:
        """Why a robot cannot be given a goal, None when it can."""
        if (problem := self._unknown(name)) is not None:
            return problem
        run, member = self._run, self._run.members[name]
        if not member.is_present and not member.is_expected:
            return f"{name}: expected a robot that is there, got one that is {member.state}"
        row, leader = run.world.rows[name], run.leader()
        follows = run.scenario.slots()[row] is not None and name != leader
        if follows and leader is not None:
            return f"{name} follows: give the goal to its leader, {leader}"
        return None

    def _unknown(self, name: str) -> str | None:
        """What to say when there is no robot of that name."""
        names = self._run.members
        if name in names:
            return None
        return f"expected one of {', '.join(names)}, got '{name}'{errors.did_you_mean(name, names)}"

    def _accept(self, spec: str) -> str:
        """Take a fault that is asked for while the run goes on; raises ScenarioError."""
        run = self._run
        now_s = run.tick * run.scenario.dt_s
        next_s = (run.tick + 1) * run.scenario.dt_s
        fault = scenarios.fault(spec, at_s=next_s, names=list(run.members))
        if fault.at_s < now_s:
            raise errors.ScenarioError(
                f"fault {spec}: expected a time that is still to come, got {fault.at_s:g} s at "
                f"{now_s:.2f} s; leave @start_s out for now"
            )
        self._asked.append(fault)
        return faults.text_of(fault)

    def _status(self) -> Status:
        run, scenario = self._run, self._run.scenario
        wall_s, now_s, pulse = self._pace.wall_s(), self._now(), self.pulse
        heard = {frame.robot: len(frame.beacons) for frame in self.frames}
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
                    error_m=metrics.formation_error_now(self.score, name),
                    reason=beacon.reason if beacon else "",
                    restarts=member.restarts,
                    heard=heard.get(name, 0),
                    yields_to=(beacon and beacon.yields_to) or "",
                    commands_per_s=pulse.rate(name),
                    command_age_s=pulse.age_s(name, now_s),
                    unanswered=max(0, member.sent_tick - member.answered_tick),
                )
            )
        paused = self.phase == "running" and self._pace.is_paused
        return Status(
            run=self._bus.run,
            scenario=scenario.title,
            tick=run.tick,
            stamp_ns=scenario.stamp_ns(run.tick),
            clock=scenario.clock.mode,
            state="paused" if paused else self.phase,
            duration_s=scenario.duration_s,
            real_time_factor=run.tick * scenario.dt_s / wall_s if wall_s > 0.0 else 0.0,
            robots=tuple(rows),
            rejected_messages=sum(self._bus.rejected().values()),
            rate=self._pace.rate,
            real_time_factor_now=pulse.ticks_per_s * scenario.dt_s,
        )
