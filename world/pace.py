"""When every tick is due, by the clock on the wall: rate, pauses, single steps.

    orders (any thread) --hold, wait--> heeded between ticks

Time that passes while the run is held up is no lost time: the ticks after it are due later.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from swarm import lifetime
from swarm.messages import ControlRequest
from swarm.scenario import Scenario

SLEEP_S_MAX = 0.02  # how late a sleeping world notices that it should stop, or who is gone


class Pace:
    """Of one conducted run; all but `order` belongs to its thread."""

    def __init__(
        self,
        scenario: Scenario,
        stop: lifetime.Stop,
        *,
        now: Callable[[], float],
        sleep: Callable[[float], None],
        attend: Callable[[], None],
        say: Callable[[str], None],
    ) -> None:
        """Args:
        attend: called all the time while it sleeps.
        say: told which orders are heeded.
        """
        self.rate = scenario.clock.rate
        self.wall_before_s = 0.0  # of the worlds before this one
        self._dt_s = scenario.dt_s
        self._lockstep = scenario.clock.mode == "lockstep"
        self._stop = stop
        self._now = now
        self._sleep = sleep
        self._attend = attend
        self._say = say
        self._orders: deque[ControlRequest] = deque()
        self._steps: int | None = None  # ticks until it pauses; None: it does not
        self._started_s = 0.0  # when tick 0 was due
        self._began_s: float | None = None  # when this world's first tick was

    @property
    def is_paused(self) -> bool:
        """Whether it waits for an order to go on."""
        return self._steps == 0

    @property
    def will_pause(self) -> bool:
        """Whether it waits, or will after some ticks."""
        return self._steps is not None

    def restore(self, rate: float, *, paused: bool) -> None:
        """Go on as an earlier world was told to, before this one begins."""
        self.rate = rate
        self._steps = 0 if paused else None

    def order(self, request: ControlRequest) -> None:
        """Pause, resume, step or rate; from any thread."""
        self._orders.append(request)

    def begin(self, tick: int) -> None:
        """A tick, the first one of this world, is due now."""
        self._began_s = self._now()
        self._anchor(tick)

    def wall_s(self) -> float:
        """Wall time of the ticks so far, of this world and of those before it, without pauses."""
        if self._began_s is None:
            return self.wall_before_s
        return self.wall_before_s + self._now() - self._began_s

    def forget(self, pause_s: float) -> None:
        """Time that has passed without the run."""
        self._started_s += pause_s
        if self._began_s is not None:
            self._began_s += pause_s

    def hold(self, tick: int) -> None:
        """Before a tick: wait while the run is paused."""
        self._heed(tick)
        while self.is_paused and self._stop.reason is None:
            before_s = self._now()
            self._sleep(SLEEP_S_MAX)
            self.forget(self._now() - before_s)
            self._attend()
            self._heed(tick)
        if self._steps:
            self._steps -= 1

    def wait(self, tick: int) -> None:
        """Sleep until the tick that is next is due."""
        while self._stop.reason is None and (left_s := self._left_s(tick)) > 0.0:
            self._sleep(min(left_s, SLEEP_S_MAX))
            self._attend()
            self._heed(tick - 1)

    def _left_s(self, tick: int) -> float:
        tick_s = self._tick_s()
        return self._started_s + tick * tick_s - self._now() if tick_s > 0.0 else 0.0

    def _tick_s(self) -> float:
        """Wall time of a tick, 0: as fast as it goes."""
        if self.rate == 0.0:
            return 0.0 if self._lockstep else self._dt_s
        return self._dt_s / self.rate

    def _anchor(self, tick: int) -> None:
        self._started_s = self._now() - tick * self._tick_s()

    def _heed(self, tick: int) -> None:
        while self._orders:
            request = self._orders.popleft()
            match request.action:
                case "pause":
                    self._steps = 0
                    self._say("paused")
                case "resume":
                    self._steps = None
                    self._say("goes on")
                case "step":
                    self._steps = request.count
                    self._say(f"goes on for {request.count} ticks")
                case "rate":
                    self.rate = request.rate
                    self._anchor(tick)
                    self._say(f"rate {request.rate:g}" if request.rate else "as fast as it goes")
