"""The wire form of numbers."""

from __future__ import annotations

from math import inf

import numpy as np
import pytest

from swarm import messages


def test_floats_are_the_array_that_numpy_makes() -> None:
    values = [0.0, 1.05, 1.0 / 3.0, inf, 4.95]
    assert messages.floats(values) == messages.array(np.array(values, dtype=np.float32))


@pytest.mark.parametrize("shape", [(2**40, 2**40, 0), (0,) * 65, (1,) * 65, (0, -1), (2**62, 0)])
def test_array_refuses_a_shape_that_numpy_does_not_take(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="expected at most 3 sides"):
        messages.Array("<f4", shape, b"" if 0 in shape else b"\x00" * 4)


def test_array_is_what_it_holds() -> None:
    values = np.arange(12, dtype=np.int32).reshape(2, 3, 2)
    assert (messages.array(values).numpy() == values).all()
    assert messages.Array("<f4", (0, 2), b"").numpy().shape == (0, 2)
