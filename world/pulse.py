"""How fast the answers of every robot come in, by the clock on the wall; for people who watch.

beat(name), ... --measure, twice a second--> rate, age_s
"""

from __future__ import annotations


class Pulse:
    """Counts commands by robot; times are handed in."""

    def __init__(self) -> None:
        """Nothing has been heard."""
        self.ticks_per_s = 0.0  # between the last two measurements
        self._heard_s: dict[str, float] = {}  # newest command of each
        self._counts: dict[str, int] = {}  # since the last measurement
        self._rates: dict[str, float] = {}
        self._before: tuple[float, int] | None = None  # time and tick of the last measurement

    def beat(self, name: str, now_s: float) -> None:
        """A command has come."""
        self._heard_s[name] = now_s
        self._counts[name] = self._counts.get(name, 0) + 1

    def measure(self, now_s: float, tick: int) -> None:
        """Take the rates since the last time."""
        if self._before is not None and now_s > self._before[0]:
            span_s = now_s - self._before[0]
            self._rates = {name: count / span_s for name, count in self._counts.items()}
            self.ticks_per_s = (tick - self._before[1]) / span_s
        self._counts = {}
        self._before = (now_s, tick)

    def rate(self, name: str) -> float:
        """Commands per second of a robot, between the last two measurements."""
        return self._rates.get(name, 0.0)

    def age_s(self, name: str, now_s: float) -> float | None:
        """Time since its newest command, None before the first."""
        heard_s = self._heard_s.get(name)
        return None if heard_s is None else max(0.0, now_s - heard_s)
