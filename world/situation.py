"""Where a conducted run stands: the world's state, who is there, what has happened in this tick.

Situation --checkpoint--> Checkpoint --resume--> the same Situation, in another process
"""

from __future__ import annotations

from collections.abc import Callable

import msgspec

from swarm import faults, messages
from swarm.faults import Fault
from swarm.messages import Event, EventKind, Goal, RobotState
from swarm.scenario import Scenario
from world import checkpoint, roster, simulation
from world.checkpoint import Checkpoint, Order
from world.roster import Member


class Situation:
    """What conductor and injector share, and what a checkpoint keeps."""

    def __init__(self, scenario: Scenario, tell: Callable[[Event], None]) -> None:
        """Before the first tick; `tell` hears of every event at once."""
        self.scenario = scenario
        self.world = simulation.build(scenario)
        self.state = simulation.init(self.world)
        self.members: dict[str, Member] = {robot.name: Member() for robot in scenario.robots}
        self.faults: list[Fault] = list(scenario.faults)
        self.struck: set[int] = set()  # numbers of the faults that are done, or at work
        self.events: list[Event] = []  # of this tick
        self.commands_total = 0
        self.goals: dict[str, Order] = {}  # on their way, by name
        self._tell = tell

    @property
    def tick(self) -> int:
        """The tick at hand."""
        return self.state.tick

    def resume(self, kept: Checkpoint) -> None:
        """Stand where the checkpoint was made."""
        self.state = kept.state
        self.members = dict(kept.members)
        self.faults = list(kept.faults)
        self.struck = set(kept.struck)
        self.events = list(kept.events)
        self.commands_total = kept.commands_total
        self.goals = dict(kept.goals)

    def checkpoint(self, run: str, wall_time_s: float) -> bytes:
        """All of it, as bytes."""
        return checkpoint.encode(
            Checkpoint(
                run=run,
                state=self.state,
                members=self.members,
                faults=tuple(self.faults),
                struck=tuple(sorted(self.struck)),
                events=tuple(self.events),
                commands_total=self.commands_total,
                wall_time_s=wall_time_s,
                goals=self.goals,
            )
        )

    # --- what happens ---

    def event(
        self,
        kind: EventKind,
        robot: str | None,
        text: str,
        *,
        number: int = -1,
        incarnation: int = 0,
    ) -> None:
        """Note that something happened in this tick; `number` is that of a fault."""
        fault = faults.kind_of(self.faults[number]) if number >= 0 else ""
        stamp_ns = self.scenario.stamp_ns(self.tick)
        event = Event(self.tick, stamp_ns, kind, robot, text, incarnation, fault, number)
        self.events.append(event)
        self._tell(event)

    def lose(self, name: str, state: RobotState) -> None:
        """A robot's process is gone, or does not answer: its body brakes."""
        self.members[name] = roster.without(self.members[name], state)
        self.state = simulation.lose(self.world, self.state, name)

    def welcome(self, name: str) -> None:
        """A robot is there: one that was away and remembers all, or a new process of it."""
        member = self.members[name]
        body = self.state.bodies[self.world.rows[name]]
        self.members[name] = roster.back(member, touched=body.contact)
        self.state = simulation.revive(self.world, self.state, name)
        if member.awaited == "new":
            text = f"begins again as number {member.incarnation}"
            self.event("robot-started", name, text, incarnation=member.incarnation)
        elif member.hang is not None:
            self.event("fault-over", name, "goes on", number=member.hang)
        else:
            self.event("robot-returned", name, "is there again")

    def start(self, name: str, incarnation: int) -> None:
        """A new process of a robot is on its way."""
        self.lose(name, "restarting")
        self.members[name] = roster.starting(self.members[name], incarnation, self.tick)

    def change(self, name: str, **changes: int | str | None) -> None:
        """Replace fields of a member."""
        self.members[name] = msgspec.structs.replace(self.members[name], **changes)

    def order(self, name: str, goal: Goal) -> None:
        """From its next frame on a robot is to go somewhere else."""
        self.goals[name] = Order(goal)
        self.event("control", name, f"goal ({goal[0]:g}, {goal[1]:g})")

    def orders(self) -> dict[str, Goal]:
        """Goals to send in this tick: in real time a frame may be missed, so until one is answered.

        Those for robots that are away wait for them.
        """
        for name, order in list(self.goals.items()):
            member = self.members[name]
            if 0 <= order.sent_tick <= member.answered_tick:
                del self.goals[name]
            elif order.sent_tick < 0 and member.is_present:
                self.goals[name] = Order(order.goal, self.tick)
        return {name: order.goal for name, order in self.goals.items()}

    def leader(self) -> str | None:
        """Who holds the highest leadership among the newest beacons; at first the scenario's."""
        claims = [
            body.beacon.leadership
            for body in self.state.bodies
            if body.alive and body.beacon is not None and body.beacon.leadership is not None
        ]
        if claims:
            return min(claims, key=messages.leadership_order).name
        return None if self.scenario.formation is None else self.scenario.formation.leader
