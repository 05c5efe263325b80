"""The table of agents/README.md: every equation once, nothing in it that does not exist."""

from __future__ import annotations

import ast
import importlib
import re
from functools import cache, reduce
from math import sqrt
from pathlib import Path

import msgspec
import pytest

import agents
import world.scenarios
from swarm import geometry
from swarm.scenario import decode

TABLE = Path(agents.__file__).with_name("README.md")
TESTS = Path(__file__).parent
# Errata that mathematics forces; the others are readings, or slips that change nothing.
FORCED = {2, 6, 8, 11, 16, 18, 28, 32, 33, 35, 37, 42, 44, 55}
KINDS = ("definition", "proof", "skipped")


class Row(msgspec.Struct, frozen=True):
    """One row of the table."""

    name: str
    where: str
    reading: str
    tests: list[str]


@cache
def rows() -> list[Row]:
    found = []
    for line in TABLE.read_text().splitlines():
        cells = [cell.strip() for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
        if len(cells) == 4 and cells[0] not in ("eq", "---"):
            found.append(Row(cells[0], cells[1], cells[2], re.findall(r"`([^`]+)`", cells[3])))
    return found


@cache
def names_in(file: str) -> set[str]:
    path = TESTS.parent / file if "/" in file else TESTS / file
    tree = ast.parse(path.read_text())
    return {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


def test_table_has_every_equation_once_in_order() -> None:
    assert [row.name for row in rows()] == [str(number) for number in range(1, 67)] + ["Table III"]


@pytest.mark.parametrize("row", rows(), ids=lambda row: row.name)
def test_table_names_functions_and_tests_that_exist(row: Row) -> None:
    names = re.findall(r"`([^`]+)`", row.where)
    assert names or row.where.startswith(KINDS)
    for name in names:
        package, module, *path = name.split(".")
        reduce(getattr, path, importlib.import_module(f"{package}.{module}"))
    for test in row.tests:
        file, name = test.split("::")
        assert name in names_in(file), test
    if names and not row.where.startswith(KINDS):
        assert row.tests, "a function that no test holds to its equation"


def test_table_marks_the_forced_errata_and_each_has_a_test_of_the_printed_form() -> None:
    forced = [row for row in rows() if row.reading.startswith("[F] ")]
    assert {int(row.name) for row in forced} == FORCED
    for row in forced:
        assert any(test.startswith("test_errata_") for test in row.tests), row.name


def test_errata_tests_all_stand_in_the_table() -> None:
    named = {test for row in rows() for test in row.tests}
    for path in sorted(TESTS.glob("test_errata_*.py")):
        for name in names_in(path.name):
            if name.startswith("test_"):
                assert f"{path.name}::{name}" in named


def test_table_iii_has_its_second_robot_at_13_not_at_minus_13() -> None:
    path = Path(world.scenarios.__file__).with_name("random-field.toml")
    plan = decode(path.read_bytes(), path.name)
    adopted = plan.slot(2)
    assert adopted is not None
    assert adopted.distance_m == pytest.approx(sqrt(8.0))  # 2.8, as the paper's table has it
    leader = plan.robots[0].start
    assert geometry.length(-2.0 - leader[0], -13.0 - leader[1]) == pytest.approx(28.07, abs=0.01)
