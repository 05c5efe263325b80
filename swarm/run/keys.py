"""Single keys of a terminal, read as they are pressed; nothing where there is no terminal."""

from __future__ import annotations

import os
import select
import sys
import termios
import tty
from types import TracebackType


class Keys:
    """Takes keys from standard input without waiting for Enter, while the `with` lasts."""

    def __init__(self) -> None:
        """Nothing is changed yet."""
        self._descriptor: int | None = None
        self._before: list[int | list[bytes | int]] = []

    def __enter__(self) -> Keys:
        try:
            descriptor = sys.stdin.fileno()
            self._before = termios.tcgetattr(descriptor)
            tty.setcbreak(descriptor)  # Ctrl-C still interrupts
        except (OSError, ValueError, AttributeError, termios.error):
            return self
        self._descriptor = descriptor
        return self

    def pressed(self) -> str:
        """Keys since the last time, perhaps none; never waits."""
        if self._descriptor is None or not select.select([self._descriptor], [], [], 0.0)[0]:
            return ""
        return os.read(self._descriptor, 64).decode(errors="replace")

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._descriptor is not None:
            termios.tcsetattr(self._descriptor, termios.TCSADRAIN, self._before)
            self._descriptor = None
