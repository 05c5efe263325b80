"""Everyone whom the supervisor looks after: what happens to them, and what is done about it.

    exits, timers, requests --Event--> supervision.step --Action--> Child, people, the world

One thread does all of it. What the world asks for is answered when it is so, not when it is sent.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping

import msgspec

from swarm.run import supervision
from swarm.run.child import Child
from swarm.run.inbox import Ask
from swarm.run.supervision import Life, Policy

WORLD = "world"
START_FAILED = 71  # EX_OSERR: what a process "ends" with that could not be started
ASK_S = 6.0  # a request that is not carried out by then is answered with what holds it up
INSPECT_S = 0.25  # a token that is gone is often seen before the death that made it go
LOOK_S = 0.5  # how often to look whether somebody has stopped the world
GLANCE_S = 0.002  # the same while somebody waits for it
STALL_S = 1.0  # time beyond this between two looks is sleep of our own (Ctrl-Z), nobody's fault


class _Pending(msgspec.Struct, frozen=True):
    ask: Ask
    child: Child | None  # which lived when it was asked
    since_s: float


class Crew:
    """Processes by name, each with its policy, its life, and its newest Child."""

    def __init__(
        self,
        policies: Mapping[str, Policy],
        start: Callable[[str, int], Child],
        report: Callable[[str], None],
    ) -> None:
        """Nobody runs yet.

        Args:
            start: (name, incarnation) -> a process that runs; raises OSError.
            report: told what people should know.
        """
        self.lives = {name: Life() for name in policies}
        self._policies = policies
        self._start = start
        self._report = report
        self._children: dict[str, Child] = {}
        self._pending: list[_Pending] = []
        self._awake_s = 0.0
        self._looked_s = time.monotonic()
        self._look_due_s = 0.0

    def now_s(self) -> float:
        """Seconds that this process was awake: what it slept through counts against nobody."""
        now_s = time.monotonic()
        self._awake_s += min(now_s - self._looked_s, STALL_S)
        self._looked_s = now_s
        return self._awake_s

    def tell(self, name: str, event: supervision.Event) -> None:
        """Let something happen to one of them, and do what follows."""
        life, actions = supervision.step(
            self._policies[name], self.lives[name], event, self.now_s()
        )
        self.lives[name] = life
        for action in actions:
            match action:
                case supervision.Spawn(incarnation):
                    self._spawn(name, incarnation)
                case supervision.Signal(number):
                    if (child := self._children.get(name)) is not None:
                        child.send(number)
                case supervision.Report(text):
                    self._report(f"{name} {text}")

    def _spawn(self, name: str, incarnation: int) -> None:
        try:
            self._children[name] = self._start(name, incarnation)
        except (OSError, EOFError) as error:
            self._report(f"{name} cannot be started: {error}")
            self.tell(name, supervision.Exited(START_FAILED))

    def notice(self) -> None:
        """See who has ended, whose time is up, and whose request has been carried out."""
        for name, child in list(self._children.items()):
            life = self.lives[name]
            if life.phase in supervision.LIVE and (code := child.exit_code()) is not None:
                child.close()
                if code != 0 and life.phase not in ("ending", "killed"):  # else it was on purpose
                    self._report(self.last_words(name, child))
                self.tell(name, supervision.Exited(code))
        self._look_at_world()
        for name, life in self.lives.items():
            if self.now_s() >= life.due_s:
                self.tell(name, supervision.Passed())
        self._settle()

    def _look_at_world(self) -> None:
        if self.now_s() < self._look_due_s or (child := self._children.get(WORLD)) is None:
            return
        self._look_due_s = self.now_s() + LOOK_S
        if child.is_stopped():
            if self.lives[WORLD].phase != "stopped":
                self.tell(WORLD, supervision.Halted())
        elif self.lives[WORLD].phase == "stopped":
            self.tell(WORLD, supervision.Continued())

    # --- what the world asks for ---

    def take(self, ask: Ask) -> None:
        """Begin with a request."""
        name, action = ask.request.robot, ask.request.action
        if name not in self.lives or (name == WORLD and action not in ("kill", "inspect")):
            ask.answer(False, f"expected a robot of this run, got '{name}'")
            return
        child = self._children.get(name)
        if action == "kill" and (child is None or child.exit_code() is not None):
            ask.answer(True, "was dead already")
            return
        self._pending.append(_Pending(ask, child, self.now_s()))
        match action:
            case "kill":
                self.tell(name, supervision.Kill())
            case "stop":
                self.tell(name, supervision.Pause())
            case "continue":
                self.tell(name, supervision.Resume())
            case "start":
                self.tell(name, supervision.Start(ask.request.incarnation))
        self._settle()

    def _settle(self) -> None:
        """Answer those requests that have been carried out, or cannot be."""
        left = []
        for pending in self._pending:
            answer = self._answer_to(pending)
            if answer is None and self.now_s() - pending.since_s >= ASK_S:
                name, action = pending.ask.request.robot, pending.ask.request.action
                state = self.state_of(name)
                answer = False, f"expected {action} of {name} within {ASK_S:g} s, got one {state}"
            if answer is None:
                left.append(pending)
            else:
                pending.ask.answer(*answer)
        self._pending = left

    def _answer_to(self, pending: _Pending) -> tuple[bool, str] | None:
        """Whether a request has been carried out, and what there is to say; None: not yet."""
        request, before = pending.ask.request, pending.child
        child = self._children.get(request.robot)
        code = START_FAILED if child is None else child.exit_code()
        match request.action:
            case "kill":
                return (True, "") if before is None or before.exit_code() is not None else None
            case "start" if self.lives[request.robot].phase in ("ending", "over"):
                return False, "the run is over"
            case "start" if child is before:
                dead = self.lives[request.robot].phase == "dead"
                return (False, "could not be started") if dead else None
            case "start":
                return code is None, self.state_of(request.robot)
            case "inspect":
                waited = self.now_s() - pending.since_s >= INSPECT_S
                state = self.state_of(request.robot)
                return (True, state) if waited or not state.startswith("running") else None
            case "stop" | "continue" if code is not None or child is None:
                return False, self.state_of(request.robot)
            case "stop":
                return (True, "") if child.is_stopped() else None
            case "continue":
                return (True, "") if not child.is_stopped() else None

    # --- how they are ---

    def state_of(self, name: str) -> str:
        """Begins with dead, stopped or running; of a dead one how it died."""
        child = self._children.get(name)
        if child is None:
            return "dead: never started"
        if child.exit_code() is not None:
            return f"dead: {child.last_words()}"
        return f"stopped: pid {child.pid}" if child.is_stopped() else f"running: pid {child.pid}"

    def last_words(self, name: str, child: Child | None = None) -> str:
        """For people: how one of them ended, and where to read more."""
        child = child or self._children.get(name)
        if child is None:
            return f"{name} was never started"
        return f"{name} {child.last_words()} (log: {child.log})"

    def exit_code(self, name: str) -> int | None:
        """Of its newest process, None while that lives."""
        child = self._children.get(name)
        return START_FAILED if child is None else child.exit_code()

    def pids(self) -> dict[str, int]:
        """Of those that live, by name."""
        return {
            name: child.pid for name, child in self._children.items() if child.exit_code() is None
        }

    def is_over(self) -> bool:
        """Whether nobody lives, and nobody will."""
        return all(life.phase == "over" for life in self.lives.values())

    def waitables(self) -> Iterator[int]:
        """Descriptors, each of which becomes readable when one of them ends."""
        for name, child in self._children.items():
            if self.lives[name].phase in supervision.LIVE and child.handle is not None:
                yield child.handle

    def patience_s(self, most_s: float) -> float:
        """For how long nothing has to be done unless something happens."""
        if any(one.ask.request.action in ("stop", "continue", "inspect") for one in self._pending):
            return GLANCE_S
        now_s = self.now_s()
        return max(0.0, min([most_s, *(life.due_s - now_s for life in self.lives.values())]))

    # --- the end ---

    def stop_all(self) -> None:
        """Ask everyone to end for good."""
        for name in self.lives:
            self.tell(name, supervision.Stop())

    def end_all(self) -> None:
        """End everyone for good, at once."""
        for name in self.lives:
            self.tell(name, supervision.End())
