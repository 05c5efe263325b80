"""How far many runs are, for people who wait."""

from __future__ import annotations

import time
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from swarm.run import front


class Bar:
    """How far it is: a bar on a terminal, a line now and then elsewhere; on standard error."""

    def __init__(self, what: str) -> None:
        self._what = what
        console = Console(stderr=True)
        self._begun_s = time.monotonic()
        self._line_due_s = self._begun_s + front.PLAIN_PERIOD_S
        self._bar: Progress | None = None
        if console.is_terminal:
            self._bar = Progress(
                TextColumn("{task.description}"),
                BarColumn(),
                MofNCompleteColumn(),
                TimeRemainingColumn(),
                console=console,
                transient=True,
            )
            self._task = self._bar.add_task(what, total=None)

    def __enter__(self) -> Bar:
        if self._bar is not None:
            self._bar.start()
        return self

    def advance(self, done: int, total: int, newest: str) -> None:
        """After each run."""
        if self._bar is not None:
            self._bar.update(self._task, completed=done, total=total, description=newest)
        elif time.monotonic() >= self._line_due_s:
            now_s = time.monotonic()
            self._line_due_s = now_s + front.PLAIN_PERIOD_S
            left_s = (now_s - self._begun_s) / max(done, 1) * (total - done)
            front.say(f"{self._what}: {done} of {total} runs, about {left_s:.0f} s left, {newest}")

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._bar is not None:
            self._bar.stop()
