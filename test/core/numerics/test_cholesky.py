"""Damped symmetric systems against numpy."""

import numpy as np
import pytest

from hand_tracker.core.numerics.cholesky import solve_damped


@pytest.mark.parametrize('count', [1, 5, 10])
@pytest.mark.parametrize('damping', [0., .3])
def test_it_solves_the_damped_system(count, damping):
    random = np.random.default_rng(count)
    root = random.normal(size=(count, count + 2))
    matrix, vector = root @ root.T, random.normal(size=count)
    solution = np.empty(count)
    assert solve_damped(np.tril(matrix), vector, count, damping, np.empty((count, count)),
                        solution)
    expected = np.linalg.solve(matrix + damping * np.diag(np.diag(matrix)), vector)
    assert solution == pytest.approx(expected)


def test_it_refuses_what_is_not_positive_definite():
    assert not solve_damped(np.diag((1., -1.)), np.ones(2), 2, 0., np.empty((2, 2)), np.empty(2))
