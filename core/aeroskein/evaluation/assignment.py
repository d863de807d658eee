"""Cheapest one-to-one assignment: shortest augmenting paths with potentials.

Method: Jonker and Volgenant 1987, in the rectangular form of Crouse 2016 (IEEE AES 52(4), algorithm of section II).
The evaluation has its own, so that what associates plots and what judges the result share no code.
"""

from __future__ import annotations

import numpy as np

from aeroskein.plots import Array, Ints

__all__ = ["cheapest_assignment"]


def cheapest_assignment(cost: Array) -> Ints:
    """Column of every row such that the total cost is least.

    Parameters
    ----------
    cost : (rows, columns) array
        Finite costs, at least as many columns as rows. [x]

    Returns
    -------
    (rows,) int array
        Each column at most once. Raises ``ValueError`` where there are more rows than columns.
    """
    rows, columns = cost.shape
    if rows > columns:
        raise ValueError(f"{rows} rows do not fit into {columns} columns")
    price_row, price_column = np.zeros(rows), np.zeros(columns)
    row_of = np.full(columns, -1, dtype=np.int64)
    for row in range(rows):
        end, came_from = _augmenting_path(cost, row, row_of, price_row, price_column)
        while end >= 0:
            previous = came_from[end]
            row_of[end] = row if previous < 0 else row_of[previous]
            end = previous
    column_of = np.full(rows, -1, dtype=np.int64)
    taken = np.flatnonzero(row_of >= 0)
    column_of[row_of[taken]] = taken
    return column_of


def _augmenting_path(cost: Array, row: int, row_of: Ints, price_row: Array, price_column: Array) -> tuple[int, Ints]:
    """Shortest way from a row to a free column (Dijkstra on reduced costs); updates the prices in place.

    Returns the free column and, for every column, the column before it on its path (-1: the row itself).
    """
    columns = cost.shape[1]
    distance = np.full(columns, np.inf)
    came_from = np.full(columns, -1, dtype=np.int64)
    done = np.zeros(columns, dtype=np.bool_)
    reached, last, current = 0.0, -1, row
    while True:
        candidate = reached + cost[current] - price_row[current] - price_column
        better = ~done & (candidate < distance)
        distance[better], came_from[better] = candidate[better], last
        last = int(np.argmin(np.where(done, np.inf, distance)))
        reached = float(distance[last])
        done[last] = True
        if row_of[last] < 0:
            break
        current = int(row_of[last])
    others = np.flatnonzero(done & (row_of >= 0))
    price_row[row] += reached
    price_row[row_of[others]] += reached - distance[others]
    price_column[done] += distance[done] - reached
    return last, came_from
