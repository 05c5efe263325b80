"""Shared by the tests of whole runs."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.run import processes


@pytest.fixture
def folder(tmp_path: Path) -> Iterator[Path]:
    """A folder to run in; no process that was started there outlives the test."""
    yield tmp_path
    processes.end_all(tmp_path)
