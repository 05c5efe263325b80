"""Rows to columns at least total cost: shortest augmenting paths, exact, O(n^3).

    costs --row by row, potentials kept--> column of each row

Written out here because it is short, and every robot must come to the same answer to the bit.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf


def solve(costs: Sequence[Sequence[float]]) -> list[int]:
    """Column of each row such that the sum of the costs is least and no column is used twice.

    Kuhn 1955 in the form of Jonker and Volgenant: each row is added by the cheapest chain of
    changes, measured in costs less the potentials of row and column, which stay >= 0.

    Args:
        costs: (rows, columns), finite, no more rows than columns.
    """
    rows = len(costs)
    columns = len(costs[0]) if rows else 0
    assert rows <= columns
    row_of = [-1] * columns
    row_potential = [0.0] * rows
    column_potential = [0.0] * columns
    for added in range(rows):
        # Cheapest way to reach each column, from which column, and the columns settled so far.
        reach = [inf] * columns
        before = [-1] * columns
        settled: list[int] = []
        open_columns = list(range(columns))
        row, at, done = added, -1, 0.0
        while True:
            line = costs[row]
            base = done - row_potential[row]
            best, found = inf, -1
            for column in open_columns:
                length = base + line[column] - column_potential[column]
                if length < reach[column]:
                    reach[column] = length
                    before[column] = at
                if reach[column] < best:
                    best, found = reach[column], column
            done, at = best, found
            open_columns.remove(found)
            if row_of[found] < 0:
                break
            settled.append(found)
            row = row_of[found]
        row_potential[added] += done
        for column in settled:
            spare = done - reach[column]
            row_potential[row_of[column]] += spare
            column_potential[column] -= spare
        while at >= 0:
            source = before[at]
            row_of[at] = added if source < 0 else row_of[source]
            at = source
    result = [-1] * rows
    for column, row in enumerate(row_of):
        if row >= 0:
            result[row] = column
    return result
