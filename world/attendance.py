"""Who is there: tokens come and go, the supervisor says why, and links deserve patience.

    token gone --inspect?--> lost | hung --token or answer--> returned

A token that is gone only means silence. Nobody is lost because this world itself was away, or
right after it came back: links need a moment.
"""

from __future__ import annotations

from collections.abc import Callable

from swarm import errors, messages
from swarm.bus import Bus
from swarm.messages import ProcessAction, ProcessRequest
from world import roster
from world.roster import Member
from world.situation import Situation

PROCESS_TIMEOUT_S = 10.0  # the supervisor's answer when it has something to do,
INSPECT_TIMEOUT_S = 0.5  # and when it only has to look
STALL_S = 0.45  # between two looks at the clock; links time out after 0.5 s
RETURN_S = 5.0  # whoever was away, or all when we were, may take so long to come back


class Attendance:
    """Keeps the roster of a situation in step with the bus."""

    def __init__(
        self, bus: Bus, situation: Situation, *, supervised: bool, now: Callable[[], float]
    ) -> None:
        self._bus = bus
        self._run = situation
        self._supervised = supervised
        self._now = now
        self._beat_s = now()
        self._patient_until_s = 0.0  # with everyone
        self._patient_with_s: dict[str, float] = {}  # with those that have just come back

    # --- what the supervisor says ---

    def ask(self, robot: str, action: ProcessAction, incarnation: int = 0) -> tuple[bool, str]:
        """Whether the supervisor did it, and its words."""
        request = ProcessRequest(robot, action, incarnation)
        timeout_s = INSPECT_TIMEOUT_S if action == "inspect" else PROCESS_TIMEOUT_S
        try:
            reply = self._bus.ask(messages.PROCESS, request, timeout_s)
        except errors.BusError as error:
            return False, str(error)
        return reply.ok, reply.text

    def is_dead(self, name: str) -> bool:
        """Whether the supervisor knows that a robot's process has ended."""
        done, said = self.ask(name, "inspect") if self._supervised else (False, "")
        return done and said.startswith("dead")

    def start_due(self, name: str, *, after_s: float = 0.0) -> int | None:
        """Tick at which the policy starts a robot that failed just now, None when it does not."""
        run = self._run
        return roster.start_due(run.scenario, run.members[name], run.tick, after_s=after_s)

    # --- patience ---

    def beat(self) -> None:
        """Called often: notices that this process was stopped, and its links have timed out."""
        now_s = self._now()
        if now_s - self._beat_s > STALL_S:
            self._patient_until_s = now_s + RETURN_S
        self._beat_s = now_s

    def be_patient(self, name: str | None = None) -> None:
        """From now on, with one robot or with all: a link that was down comes back in a moment."""
        until_s = self._now() + RETURN_S
        if name is None:
            self._patient_until_s = until_s
        else:
            self._patient_with_s[name] = until_s

    def is_patient_with(self, name: str) -> bool:
        """Whether a robot's silence means nothing yet."""
        return self._now() < max(self._patient_until_s, self._patient_with_s.get(name, 0.0))

    # --- coming and going ---

    def has_token(self, name: str) -> bool:
        """Whether the newest process of a robot has said that it is there."""
        return _token(name, self._run.members[name]) in self._bus.alive()

    def absent(self) -> list[str]:
        """Robots that should be there and have no token."""
        alive = self._bus.alive()
        return [
            name
            for name, member in self._run.members.items()
            if (member.is_present or member.state == "starting")
            and _token(name, member) not in alive
        ]

    def open(self, *, stopping: bool) -> None:
        """Begin with those that are there; the others are missing or gone, unless it is to stop."""
        run = self._run
        absent = self.absent()
        for name in absent if not stopping else ():
            if run.members[name].state == "starting":
                run.lose(name, "missing")
                run.event("robot-missing", name, "did not come up in time")
                run.change(name, start_tick=self.start_due(name))
            else:
                self._lose(name)
        for name, member in run.members.items():
            if member.state == "starting" and name not in absent:
                run.change(name, state="running")

    def notice_losses(self) -> None:
        """Lose those whose token is gone; where we are patient, only those that are dead."""
        for name in self.absent():
            if not self.is_patient_with(name) or self.is_dead(name):
                self._lose(name)

    def _lose(self, name: str) -> None:
        run = self._run
        done, said = self.ask(name, "inspect") if self._supervised else (False, "")
        if done and not said.startswith("dead"):
            self.hang(name, f"its token is gone, its process is {said}")
            return
        run.lose(name, "lost")
        run.event("robot-lost", name, f"its token is gone{', ' if said else ''}{said}")
        run.change(name, start_tick=self.start_due(name))

    def hang(self, name: str, text: str) -> None:
        """A robot does not answer: it may return by itself, or is started again by the policy."""
        run = self._run
        run.lose(name, "hung")
        run.event("robot-hung", name, text)
        due = self.start_due(name, after_s=run.scenario.restart.hang_timeout_s)
        run.change(name, start_tick=due)

    def notice_returns(self) -> None:
        """Those that were away and are there again by themselves go on in the next tick."""
        run = self._run
        for name, member in run.members.items():
            if member.state not in roster.AWAY or member.hang is not None or member.awaited:
                continue
            if not self.has_token(name):
                continue
            if member.owes and member.answered_tick < member.sent_tick:
                continue  # its link lives, its loop does not answer yet
            run.welcome(name)
            self.be_patient(name)


def _token(name: str, member: Member) -> tuple[str, str]:
    return "robot", messages.token_name(name, member.incarnation)
