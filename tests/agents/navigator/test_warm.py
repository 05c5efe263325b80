"""No robot pays for compiling within a tick."""

from __future__ import annotations

import importlib
import pkgutil

import agents.navigator
from agents.navigator import warm
from agents.navigator.compiled import Loop


def test_all_inner_loops_are_ready_once_it_is_warm() -> None:
    warm.up()
    cold = [
        f"{module.__name__}.{name}"
        for part in pkgutil.iter_modules(agents.navigator.__path__)
        for module in [importlib.import_module(f"agents.navigator.{part.name}")]
        for name, loop in vars(module).items()
        if isinstance(loop, Loop) and loop._code is None
    ]
    assert cold == []
