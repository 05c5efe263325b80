"""Where the world's requests about processes wait for the thread that may carry them out.

    bus's thread --ask--> | inbox | --take--> supervising thread --Ask.answer--> bus's thread

Only the main thread starts processes, and only one thread decides about them.
"""

from __future__ import annotations

import os
import queue
import threading

from swarm.messages import ProcessRequest, Reply

ANSWER_S = 8.0  # wall; the asking world gives up after 10


class Ask:
    """One request on its way to an answer."""

    def __init__(self, request: ProcessRequest) -> None:
        self.request = request
        self._reply = Reply(False, f"the supervisor did not answer within {ANSWER_S:g} s")
        self._answered = threading.Event()

    def answer(self, ok: bool, text: str = "") -> None:
        """Let the one who asked go on."""
        self._reply = Reply(ok, text)
        self._answered.set()

    def wait(self) -> Reply:
        """The answer, as soon as it is there."""
        self._answered.wait(ANSWER_S)
        return self._reply


class Inbox:
    """A queue, and a descriptor that is readable when something lies in it or `wake` was called."""

    def __init__(self) -> None:
        self._queue: queue.SimpleQueue[Ask] = queue.SimpleQueue()
        self._event = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._lock = threading.Lock()
        self._open = True

    def fileno(self) -> int:
        """Readable when there is something to do."""
        return self._event

    def wake(self) -> None:
        """Make it readable; from a signal handler too."""
        os.eventfd_write(self._event, 1)

    def ask(self, request: ProcessRequest) -> Reply:
        """Lay a request down and wait for its answer; from any thread but the supervising one."""
        ask = Ask(request)
        with self._lock:
            if not self._open:
                return Reply(False, "the run is over")
            self._queue.put(ask)
            self.wake()
        return ask.wait()

    def take(self) -> list[Ask]:
        """All that lies here."""
        try:
            os.eventfd_read(self._event)
        except BlockingIOError:
            return []
        asks = []
        while not self._queue.empty():
            asks.append(self._queue.get_nowait())
        return asks

    def close(self) -> None:
        """Answer whoever still waits."""
        with self._lock:
            self._open = False
            for ask in self.take():
                ask.answer(False, "the run is over")
            os.close(self._event)
