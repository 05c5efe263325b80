"""When ticks are due: rates, pauses and steps on a virtual clock, and within a run."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from swarm import lifetime, messages, scenario
from swarm.messages import ControlRequest, TickRecord
from swarm.run import library
from tests.world.test_conductor import Stage
from world.pace import SLEEP_S_MAX, Pace


class Clock:
    """Exact time that passes only in sleep; things can be made to happen at a time."""

    def __init__(self) -> None:
        self.time_s = 0.0
        self.due: list[tuple[float, Callable[[], None]]] = []

    def now(self) -> float:
        return self.time_s

    def sleep(self, duration_s: float) -> None:
        self.time_s += duration_s
        while self.due and self.due[0][0] <= self.time_s:
            self.due.pop(0)[1]()


class Run:
    """A pace, and the times at which its ticks begin."""

    def __init__(self, *settings: str) -> None:
        _, where, data = library.read_scenario("empty")
        plan = scenario.decode(data, where, settings=["dt_s=0.1", *settings])
        self.clock = Clock()
        self.stop = lifetime.Stop()
        self.said: list[str] = []
        self.attended = 0
        self.pace = Pace(
            plan,
            self.stop,
            now=self.clock.now,
            sleep=self.clock.sleep,
            attend=self._attend,
            say=self.said.append,
        )

    def _attend(self) -> None:
        self.attended += 1

    def at(self, time_s: float, request: ControlRequest) -> None:
        self.clock.due.append((time_s, lambda: self.pace.order(request)))

    def ticks(self, count: int) -> list[float]:
        times_s = []
        self.pace.begin(0)
        for tick in range(count):
            self.pace.hold(tick)
            times_s.append(round(self.clock.time_s, 6))
            self.pace.wait(tick + 1)
        return times_s


def test_ticks_are_due_at_the_rate() -> None:
    assert Run("clock.rate=2.0").ticks(4) == [0.0, 0.05, 0.1, 0.15]
    assert Run().ticks(4) == [0.0] * 4  # lock-step without a rate: at once
    assert Run("clock.mode=realtime").ticks(3) == [0.0, 0.1, 0.2]


def test_pause_is_no_lost_time() -> None:
    run = Run("clock.rate=1.0")
    run.at(0.15, ControlRequest("pause"))
    run.at(5.0, ControlRequest("resume"))
    times_s = run.ticks(5)
    assert times_s[:2] == [0.0, 0.1]
    assert times_s[2] == pytest.approx(5.0, abs=SLEEP_S_MAX)
    assert times_s[3:] == pytest.approx([times_s[2] + 0.1, times_s[2] + 0.2])
    assert run.pace.wall_s() == pytest.approx(0.5)  # five ticks
    assert run.said == ["paused", "goes on"]
    assert run.attended > 200  # robots are looked after all the while


def test_steps_run_and_pause_again() -> None:
    run = Run("clock.rate=1.0")
    run.pace.order(ControlRequest("pause"))
    run.at(1.0, ControlRequest("step", count=2))
    run.at(2.0, ControlRequest("step"))
    run.at(3.0, ControlRequest("resume"))
    times_s = run.ticks(5)
    assert times_s == pytest.approx([1.0, 1.1, 2.0, 3.0, 3.1], abs=SLEEP_S_MAX)


def test_step_of_a_run_that_goes_on_pauses_it_after_so_many_ticks() -> None:
    run = Run()
    run.pace.order(ControlRequest("step", count=3))
    run.at(1.0, ControlRequest("resume"))
    assert run.ticks(5) == pytest.approx([0.0, 0.0, 0.0, 1.0, 1.0], abs=SLEEP_S_MAX)


def test_rate_changes_between_ticks_without_a_leap() -> None:
    run = Run("clock.rate=1.0")
    run.at(0.25, ControlRequest("rate", rate=0.1))
    run.at(2.5, ControlRequest("rate", rate=0.0))
    times_s = run.ticks(6)
    assert times_s[:3] == [0.0, 0.1, 0.2]
    assert times_s[3] == pytest.approx(1.25, abs=2 * SLEEP_S_MAX)
    assert times_s[4] == pytest.approx(2.25, abs=2 * SLEEP_S_MAX)
    assert times_s[5] == pytest.approx(2.5, abs=2 * SLEEP_S_MAX)  # in the middle of a slow tick


def test_stop_ends_a_pause() -> None:
    run = Run("clock.rate=1.0")
    run.pace.order(ControlRequest("pause"))
    run.clock.due.append((1.0, lambda: run.stop.request("enough")))
    run.pace.begin(0)
    run.pace.hold(0)
    assert run.clock.time_s == pytest.approx(1.0, abs=SLEEP_S_MAX)


def stopped_and_stepped(*settings: str) -> tuple[Stage, str]:
    """A run that is paused at tick 20, steps thrice, and goes on."""
    stage = Stage("two-obstacles", "duration_s=8.0", *settings)
    stage.enter()
    plain, asked = stage.clock.sleep, stage.hub.handlers
    seen: list[messages.Status] = []

    def control(request: ControlRequest) -> messages.Status:
        reply = asked[messages.CONTROL.name](request)
        status = messages.msgspec.msgpack.decode(reply.body, type=messages.Status)
        seen.append(status)
        return status

    def observe(record: TickRecord) -> None:
        if record.tick == 20:
            control(ControlRequest("pause"))

    def sleep(duration_s: float) -> None:
        plain(duration_s)
        if seen and control(ControlRequest("status")).state == "paused":
            action = "step" if len(stage.records) < 25 else "resume"
            control(ControlRequest(action))  # type: ignore[arg-type]

    stage.clock.sleep = sleep  # type: ignore[method-assign]
    result = stage.play(observe)
    assert "paused" in [status.state for status in seen]
    return stage, result.score.hash.hexdigest()


def test_run_that_is_paused_and_stepped_is_the_same_run() -> None:
    plain = Stage("two-obstacles", "duration_s=8.0")
    plain.enter()
    expected = plain.play().score.hash.hexdigest()
    stage, found = stopped_and_stepped()
    assert found == expected
    texts = [event.text for event in stage.events() if event.kind == "control"]
    assert texts[:2] == ["paused", "goes on for 1 ticks"]
    assert texts[-1] == "goes on"


def test_bad_orders_are_refused_at_the_edge() -> None:
    for bad in ({"action": "step", "count": 0}, {"action": "rate", "rate": -1.0}, {"action": "x"}):
        payload = messages.msgspec.msgpack.encode(bad)
        with pytest.raises(messages.errors.MessageError):
            messages.decode(messages.CONTROL, payload)
