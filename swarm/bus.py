"""The seam between processes: typed messages, queries, and who is alive.

Two implementations pass one contract test: MemoryBus below (all in one process, one thread) and
swarm.zenoh_bus.ZenohBus. Shells take a bus as an argument and never know which one they have.

A shell that needs answers blocks in `receive`. On a MemoryBus there is nobody else to produce
them, so `receive` on an empty queue lets the other shells of the hub work first (`Hub.workers`):
that is all the scheduling that a swarm in one process needs, and it is deterministic.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import msgspec

from swarm import errors, messages
from swarm.messages import Query, Reply, Topic


class Delivery(NamedTuple):
    """One received message and the topic that it came on."""

    topic: Topic
    message: Any


Handler = Callable[[Any], Reply]  # request -> reply; may run on another thread


class Bus(Protocol):
    """What every shell may ask of the bus of one run."""

    run: str

    def publish(self, topic: Topic, message: msgspec.Struct, robot: str = "") -> None:
        """Send; `robot` fills the key of a topic that has one."""

    def publish_raw(self, topic: Topic, payload: bytes, robot: str = "") -> None:
        """Send bytes as they are, whatever they mean to those who receive them."""

    def subscribe(self, topic: Topic, robot: str = "*", *, newest: bool = False) -> None:
        """Receive a topic from now on; `newest` keeps only the last undelivered message."""

    def receive(self, timeout_s: float) -> Delivery | None:
        """Next message, or None: nothing within the time, somebody came or went, or `wake`.

        Messages that do not decode are counted and skipped. Raises BusError once closed.
        """

    def wake(self) -> None:
        """Let a blocked `receive` return None; callable from signal handlers and threads."""

    def announce(self, role: str, name: str) -> None:
        """Declare a liveliness token: from now on `alive` of everyone has (role, name)."""

    def alive(self) -> frozenset[tuple[str, str]]:
        """Tokens (role, name) seen at this moment."""

    def serve(self, query: Query, handler: Handler) -> None:
        """Answer a query until the bus is closed."""

    def ask(self, query: Query, request: msgspec.Struct, timeout_s: float) -> Reply:
        """Ask a query; raises BusError when nobody answers in time."""

    def rejected(self) -> dict[str, int]:
        """Messages counted and ignored so far, by reason."""

    def close(self) -> None:
        """Leave; tokens vanish. Safe to call twice."""


class Hub:
    """What the MemoryBuses of one process share."""

    def __init__(self) -> None:
        self.routes: dict[tuple[str, str], list[MemoryBus]] = {}  # (topic, robot or *) -> readers
        self.tokens: dict[tuple[str, str], MemoryBus] = {}
        self.handlers: dict[str, Handler] = {}
        self.workers: dict[str, Callable[[], None]] = {}  # name -> does what has arrived for it


class MemoryBus:
    """A Bus inside one process; messages are frozen, so they are handed over as they are."""

    def __init__(self, hub: Hub, run: str) -> None:
        self.run = run
        self._hub = hub
        self._newest: set[str] = set()  # topics of which only the last message is kept
        self._queue: deque[Delivery] = deque()
        self._rejected: dict[str, int] = {}
        self._woken = False
        self._closed = False

    def publish(self, topic: Topic, message: msgspec.Struct, robot: str = "") -> None:
        """Hand over to every subscriber at once."""
        routes = self._hub.routes
        for bus in (*routes.get((topic.name, robot), ()), *routes.get((topic.name, "*"), ())):
            if topic.name in bus._newest:
                bus._queue = deque(one for one in bus._queue if one.topic is not topic)
            bus._queue.append(Delivery(topic, message))

    def publish_raw(self, topic: Topic, payload: bytes, robot: str = "") -> None:
        """Decode for every subscriber, as a bus between processes would."""
        routes = self._hub.routes
        for bus in (*routes.get((topic.name, robot), ()), *routes.get((topic.name, "*"), ())):
            try:
                bus._queue.append(Delivery(topic, messages.decode(topic, payload)))
            except errors.MessageError as error:
                bus._rejected[str(error)] = bus._rejected.get(str(error), 0) + 1

    def subscribe(self, topic: Topic, robot: str = "*", *, newest: bool = False) -> None:
        """Receive a topic from now on."""
        self._hub.routes.setdefault((topic.name, robot), []).append(self)
        if newest:
            self._newest.add(topic.name)

    def receive(self, timeout_s: float) -> Delivery | None:
        """Next message; lets the workers of the hub run once when there is none.

        Waiting longer would bring nothing in one thread, so `timeout_s` only tells whether the
        others may work (> 0) or not (0).
        """
        if self._closed:
            raise errors.BusError("the bus is closed")
        if not self._queue and timeout_s > 0.0 and not self._woken:
            for work in list(self._hub.workers.values()):
                work()
        self._woken = False
        return self._queue.popleft() if self._queue else None

    def wake(self) -> None:
        """Let the next `receive` on an empty queue return at once."""
        self._woken = True

    def announce(self, role: str, name: str) -> None:
        """Show (role, name) to everyone."""
        self._hub.tokens[(role, name)] = self

    def alive(self) -> frozenset[tuple[str, str]]:
        """Tokens of the hub."""
        return frozenset(self._hub.tokens)

    def serve(self, query: Query, handler: Handler) -> None:
        """Answer a query."""
        self._hub.handlers[query.name] = handler

    def ask(self, query: Query, request: msgspec.Struct, timeout_s: float) -> Reply:
        """Ask; raises BusError when nobody serves it."""
        handler = self._hub.handlers.get(query.name)
        if handler is None:
            raise errors.BusError(f"query {query.name}: expected an answer, got none")
        return handler(request)

    def rejected(self) -> dict[str, int]:
        """Of raw bytes; what is never encoded cannot be malformed."""
        return dict(self._rejected)

    def close(self) -> None:
        """Take back tokens and subscriptions."""
        self._closed = True
        for token in [token for token, owner in self._hub.tokens.items() if owner is self]:
            del self._hub.tokens[token]
        for readers in self._hub.routes.values():
            if self in readers:
                readers.remove(self)
