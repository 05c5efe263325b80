"""A fuzzing campaign is so many parts, each a test of its own with a seed of its own."""

from __future__ import annotations

import random

import pytest

from tests.fuzz.campaign import Campaign


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """One test a part, so that each can be repeated by its name."""
    if "part" in metafunc.fixturenames:
        metafunc.parametrize("part", range(metafunc.config.getoption("--fuzz")))


@pytest.fixture
def campaign(request: pytest.FixtureRequest, part: int) -> Campaign:
    """What a part draws from and how it says what went wrong."""
    name = request.node.originalname
    count = request.config.getoption("--fuzz")
    line = f"python -m pytest '{request.node.nodeid}' --fuzz {count}"
    return Campaign(random.Random(f"{name} {part}"), line)
