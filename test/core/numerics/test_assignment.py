"""Optimal assignment, against SciPy's."""

import numpy as np
from scipy.optimize import linear_sum_assignment

from hand_tracker.core.numerics.assignment import assign_rows

FORBIDDEN = 1e6


def test_the_cost_is_the_least_and_no_column_is_used_twice():
    random = np.random.default_rng(1)
    for _ in range(300):
        rows, count = random.integers(1, 9), random.integers(1, 12)
        cost = random.exponential(size=(rows, count))
        cost[random.random(cost.shape) < .2] = np.inf
        alone = 2. * random.random()
        columns = np.zeros(rows, dtype=np.int64)
        total = assign_rows(cost, alone, columns)
        padded = np.full((rows, count + rows), FORBIDDEN)
        padded[:, :count] = np.where(np.isinf(cost), FORBIDDEN, cost)
        padded[np.arange(rows), count + np.arange(rows)] = alone
        expected = padded[linear_sum_assignment(padded)].sum()
        used = columns[columns >= 0]
        assert np.isclose(total, expected, rtol=0, atol=1e-9)
        assert len(set(used)) == len(used)
        assert np.isclose(total, cost[columns >= 0, used].sum() + alone * (columns < 0).sum())


def test_rows_stay_alone_where_nothing_is_allowed():
    columns = np.zeros(2, dtype=np.int64)
    assert assign_rows(np.full((2, 3), np.inf), 5., columns) == 10.
    assert columns.tolist() == [-1, -1]
    assert assign_rows(np.empty((2, 0)), 5., columns) == 10.
