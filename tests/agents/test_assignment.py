"""The cheapest assignment against all that there are."""

from __future__ import annotations

from itertools import permutations

from hypothesis import given
from hypothesis import strategies as st

from agents import assignment

costs = st.floats(0.0, 100.0) | st.integers(0, 3).map(float)


@st.composite
def tables(draw: st.DrawFn) -> list[list[float]]:
    rows = draw(st.integers(0, 6))
    columns = draw(st.integers(rows, 6))
    return [[draw(costs) for _ in range(columns)] for _ in range(rows)]


@given(tables())
def test_solve_costs_no_more_than_any_other_assignment(table: list[list[float]]) -> None:
    chosen = assignment.solve(table)
    assert len(set(chosen)) == len(table)
    columns = len(table[0]) if table else 0
    cheapest = min(
        sum(line[column] for line, column in zip(table, order, strict=True))
        for order in permutations(range(columns), len(table))
    )
    cost = sum(line[column] for line, column in zip(table, chosen, strict=True))
    assert cost <= cheapest + 1e-9


def test_solve_of_fifty_swaps_what_crosses() -> None:
    # Robots in a row backwards: each goes to the place in front of it, whatever its number.
    table = [[float((49 - row - column) ** 2) for column in range(50)] for row in range(50)]
    assert assignment.solve(table) == list(range(49, -1, -1))
