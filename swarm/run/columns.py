"""Tables that fit the terminal: where it is narrow, whole columns go, the least important first."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
from rich.table import Table
from rich.text import Text

GAP = 2  # letters between two columns


class Column(msgspec.Struct, frozen=True):
    """A column by its title; those of higher rank go first, rank 0 stays."""

    title: str
    rank: int = 0
    right: bool = False


def fitting(
    columns: Sequence[Column], rows: Sequence[Sequence[Text]], width: int | None
) -> list[int]:
    """Numbers of the columns that are kept within a width; None: all."""
    widths = [
        max([len(column.title), *(row[number].cell_len for row in rows)])
        for number, column in enumerate(columns)
    ]
    kept = list(range(len(columns)))
    while width is not None and sum(widths[one] + GAP for one in kept) - GAP > width:
        least = max(kept, key=lambda number: columns[number].rank)
        if columns[least].rank == 0:
            break
        kept.remove(least)
    return kept


def table(columns: Sequence[Column], rows: Sequence[Sequence[Text]], width: int | None) -> Table:
    """Table of the columns that fit; what is still too long is cut."""
    result = Table(box=None, pad_edge=False)
    kept = fitting(columns, rows, width)
    for number in kept:
        column = columns[number]
        result.add_column(
            column.title,
            justify="right" if column.right else "left",
            no_wrap=True,
            overflow="ellipsis",
        )
    for row in rows:
        result.add_row(*(row[number] for number in kept))
    return result
