"""The wire form of numbers."""

from __future__ import annotations

from math import inf

import numpy as np

from swarm import messages


def test_floats_are_the_array_that_numpy_makes() -> None:
    values = [0.0, 1.05, 1.0 / 3.0, inf, 4.95]
    assert messages.floats(values) == messages.array(np.array(values, dtype=np.float32))
