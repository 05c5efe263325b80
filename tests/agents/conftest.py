"""The navigator's inner loops are compiled before tests that have little time for an example."""

from __future__ import annotations

from agents.navigator import warm

warm.up()
