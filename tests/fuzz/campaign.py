"""One part of a fuzzing campaign: its draws, and the line that repeats it."""

from __future__ import annotations

import contextlib
import random
from collections.abc import Iterator

import pytest


class Campaign:
    """Draws of one part."""

    def __init__(self, draw: random.Random, line: str) -> None:
        self.draw = draw
        self._line = line

    @contextlib.contextmanager
    def case(self, number: int, what: str, data: bytes) -> Iterator[None]:
        """Whatever is raised inside fails the test with how to see it again."""
        try:
            yield
        except Exception as error:
            pytest.fail(
                f"case {number}, {what}: {type(error).__name__}: {error}\n"
                f"repeat with: {self._line}\n"
                f"its {len(data)} bytes begin with {data[:400]!r}"
            )
