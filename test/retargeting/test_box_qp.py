"""The quadratic programme in a box: optimality against its own conditions."""

import numpy as np
import pytest

from hand_tracker.retargeting.box_qp import new_box_qp, solve_box_qp

SIZE = 24


def solved(hessian, gradient, lower, upper):
    n, qp = len(gradient), new_box_qp(SIZE)
    qp.hessian[:n, :n], qp.gradient[:n] = hessian, gradient
    qp.lower[:n], qp.upper[:n] = lower, upper
    qp.solution[:n] = np.clip(0., lower, upper)
    steps = solve_box_qp(n, qp)
    return qp.solution[:n], steps


@pytest.mark.parametrize('seed', range(40))
def test_the_solution_is_optimal_within_the_box(seed):
    random = np.random.default_rng(seed)
    n = int(random.integers(1, SIZE))
    rows = random.normal(size=(n + 3, n)) * 10**random.uniform(-1., 1., size=n)
    target = random.normal(size=n + 3)
    lower = -random.uniform(0., .2, n) * (random.random(n) < .8)
    upper = random.uniform(0., .2, n) * (random.random(n) < .8)
    x, steps = solved(rows.T @ rows, -rows.T @ target, lower, upper)
    slope = rows.T @ (rows @ x - target)
    assert (x >= lower).all() and (x <= upper).all()
    free = (x > lower) & (x < upper)
    assert np.abs(slope[free]).max(initial=0.) < 1e-9
    assert (slope[(x <= lower) & (upper > lower)] > -1e-9).all()
    assert (slope[(x >= upper) & (upper > lower)] < 1e-9).all()
    assert steps < 4 * n + 4


def test_what_is_not_convex_stays_in_the_box_and_finite():
    hessian = np.diag((1., -1., 0.))
    x, _ = solved(hessian, np.array((-1., .1, 0.)), np.full(3, -.5), np.full(3, .5))
    assert np.isfinite(x).all() and (np.abs(x) <= .5).all()
    assert x[0] == .5
