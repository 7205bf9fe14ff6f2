"""Optimal assignment of rows to columns, where a row may also stay without one."""

import math

import numpy as np

from .jit import jit


@jit
def assign_rows(cost: np.ndarray, unassigned_cost: float, columns: np.ndarray) -> float:
    """Assign rows to different columns at the least total cost; rows may stay unassigned.

    Hungarian method by shortest augmenting paths (Jonker and Volgenant, A shortest augmenting
    path algorithm for dense and sparse linear assignment problems, 1987). Rows whose cheapest
    columns differ need no search.

    Parameters
    ----------
    cost : ndarray, shape (n, m)
        Infinite where a row must not have a column [any unit].
    unassigned_cost : float
        Of a row without a column [the same].
    columns : ndarray of int, shape (n,)
        Column of each row, -1 for none; replaced.

    Returns
    -------
    float
        Total cost [the same].
    """
    rows, count = cost.shape
    total = 0.
    owner = np.full(count + rows, -1, dtype=np.int64)
    conflict = False
    for i in range(rows):
        least = unassigned_cost
        columns[i] = -1
        for j in range(count):
            if cost[i, j] < least:
                least = cost[i, j]
                columns[i] = j
        total += least
        if columns[i] >= 0:
            conflict = conflict or owner[columns[i]] >= 0
            owner[columns[i]] = i
    if not conflict:
        return total
    # Column `count + i` is the place of row i without a column.
    size = count + rows
    owner[:] = -1
    columns[:] = -1
    row_price = np.zeros(rows)
    column_price = np.zeros(size)
    distance = np.empty(size)
    previous = np.empty(size, dtype=np.int64)
    visited = np.empty(size, dtype=np.bool_)
    for start in range(rows):
        distance[:] = math.inf
        visited[:] = False
        row, reached, last = start, 0., -1
        while True:
            nearest = -1
            for j in range(size):
                if visited[j]:
                    continue
                if j < count:
                    step = cost[row, j]
                else:
                    step = unassigned_cost if j == count + row else math.inf
                path = reached + step - row_price[row] - column_price[j]
                if path < distance[j]:
                    distance[j] = path
                    previous[j] = row
                if nearest < 0 or distance[j] < distance[nearest]:
                    nearest = j
            visited[nearest] = True
            reached = distance[nearest]
            if owner[nearest] < 0:
                last = nearest
                break
            row = owner[nearest]
        for j in range(size):
            if visited[j] and j != last:
                column_price[j] += distance[j] - reached
                row_price[owner[j]] += reached - distance[j]
        row_price[start] += reached
        while True:
            row = previous[last]
            owner[last] = row
            columns[row], last = last, columns[row]
            if row == start:
                break
    total = 0.
    for i in range(rows):
        if columns[i] >= count:
            columns[i] = -1
        total += cost[i, columns[i]] if columns[i] >= 0 else unassigned_cost
    return total


@jit
def number_rows(rows: np.ndarray) -> None:
    """Write the assignment of each to its own row, shape (n,): 0, 1, 2, ..."""
    for i in range(len(rows)):
        rows[i] = i
