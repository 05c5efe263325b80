"""The tables of faults for people: every kind with what it does and an example that works."""

from __future__ import annotations

import re
from pathlib import Path

import msgspec
import pytest

from swarm import faults
from swarm.faults import Fault

ROOT = Path(__file__).parents[2]
ROWS = dict(
    re.findall(
        r"^\| `([a-z-]+)` \| [^|]+ \| `([^`]+)` \|$", (ROOT / "world/README.md").read_text(), re.M
    )
)


@pytest.mark.parametrize("kind", faults.KINDS)
def test_table_has_an_example_of_every_kind(kind: str) -> None:
    fault = msgspec.convert(faults.table(ROWS[kind]), Fault)
    assert faults.kind_of(fault) == kind
    names = [f"robot{number}" for number in range(1, 6)]
    assert faults.problem_of(fault, ["leader", *names]) is None


def test_tables_name_no_kind_that_is_not_there() -> None:
    assert set(ROWS) == set(faults.KINDS)
    section = (ROOT / "README.md").read_text().split("## Break it")[1].split("##")[0]
    table = [line for line in section.splitlines() if line.startswith("| ")]
    assert set(re.findall(r"`([a-z-]+)`", "".join(table))) == set(faults.KINDS)
