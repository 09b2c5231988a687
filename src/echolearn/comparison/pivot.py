"""Rows of `results.csv` spread over a table: a cell is a row, so each figure keeps its interval."""

from collections.abc import Iterable, Sequence
from typing import Any

from echolearn.evaluation.rows import Row

Table = dict[tuple[Any, ...], dict[Any, Row]]
"""Lines by what tells them from each other; in each its cells, likewise."""


def pivot(rows: Iterable[Row], *, lines: Sequence[str], cells: str) -> Table:
    """Spread rows over a table, in their order.

    Args:
        rows: the rows.
        lines: columns that tell the table's lines from each other.
        cells: column that tells the cells of a line from each other.
    """
    table: Table = {}
    for row in rows:
        line = tuple(row[name] for name in lines)
        table.setdefault(line, {})[row[cells]] = row
    return table
