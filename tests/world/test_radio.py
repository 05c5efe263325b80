"""Who hears whom."""

from __future__ import annotations

import numpy as np

from world import radio

LINE = np.array([[0.0, 0.0], [6.0, 0.0], [12.0, 0.0]])
EVERYONE = np.ones(3, dtype=np.bool_)


def test_audible_ends_at_the_range_and_leaves_oneself_out() -> None:
    heard = radio.audible(6.0, LINE, EVERYONE)
    assert heard.tolist() == [
        [False, True, False],
        [True, False, True],
        [False, True, False],
    ]
    assert not radio.audible(5.999, LINE, EVERYONE).any()


def test_audible_is_nobody_for_and_from_the_dead() -> None:
    heard = radio.audible(100.0, LINE, np.array([True, False, True]))
    assert heard.tolist() == [
        [False, False, True],
        [False, False, False],
        [True, False, False],
    ]


def test_audible_is_mutual_when_places_are_random() -> None:
    places_m = np.random.default_rng(3).uniform(-10.0, 10.0, (40, 2))
    heard = radio.audible(7.0, places_m, np.ones(40, dtype=np.bool_))
    assert (heard == heard.T).all()
    for one in range(40):
        for other in range(40):
            apart_m = float(np.linalg.norm(places_m[one] - places_m[other]))
            assert heard[one, other] == (one != other and apart_m <= 7.0)
