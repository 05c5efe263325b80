"""How fast answers come in."""

from __future__ import annotations

from world.pulse import Pulse


def test_rates_are_counted_between_two_measurements() -> None:
    pulse = Pulse()
    pulse.measure(10.0, 100)
    assert pulse.rate("robot1") == 0.0
    for now_s in (10.1, 10.2, 10.3):
        pulse.beat("robot1", now_s)
    pulse.measure(10.5, 104)
    assert pulse.rate("robot1") == 6.0  # 3 in half a second
    assert pulse.ticks_per_s == 8.0
    pulse.measure(11.5, 104)
    assert pulse.rate("robot1") == pulse.ticks_per_s == 0.0


def test_age_is_that_of_the_newest_and_nothing_before_the_first() -> None:
    pulse = Pulse()
    assert pulse.age_s("robot1", 3.0) is None
    pulse.beat("robot1", 1.0)
    pulse.beat("robot1", 2.0)
    assert pulse.age_s("robot1", 3.5) == 1.5
