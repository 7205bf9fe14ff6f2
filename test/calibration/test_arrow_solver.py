"""The fit through the Schur complement against dense least squares."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from hand_tracker.calibration.arrow_solver import covariance, fit_angles, solve_shape
from hand_tracker.calibration.digit_chain import ANGLES, place_markers
from hand_tracker.calibration.digit_fit import FINGER_STARTS
from hand_tracker.calibration.digit_priors import Marked, digit_chain, digit_posture, digit_prior
from hand_tracker.calibration.marker_residuals import (
    DigitProblem,
    frame_costs,
    linearised,
    shape_cost,
)
from hand_tracker.core.model.hand import Hand

MARKED = Marked(('index_pip', 'index_dip', 'index_tip'), np.array((0, 1, 2)),
                np.zeros(3, dtype=bool), np.array((False, True, False)))


def index_finger(frames):
    """Return a problem of the index finger with its true shape and postures."""
    random = np.random.default_rng(5)
    hand = Hand.scaled()
    prior = digit_prior(hand, 0, MARKED, .185, None)
    truth = prior.mean + .7 * prior.spread * random.standard_normal(len(prior.mean))
    bend = random.uniform(0., 1.2, frames)
    postures = np.column_stack((random.uniform(-.2, .2, frames), random.uniform(0., 1., frames),
                                bend, truth[8] * bend + truth[9]))
    chain = digit_chain(hand, 0, MARKED.links)
    points = place_markers(chain, truth, postures)
    points += .0002 * random.standard_normal(points.shape)
    posture = digit_posture(hand, 0, MARKED.links)
    return DigitProblem(chain, points, np.full(3, .0005), posture, prior, np.ones(3), 1.), \
        truth, postures


def test_gradient_is_that_of_the_cost():
    problem, truth, postures = index_finger(4)
    shape, angles = truth + .001, postures + .05
    system = linearised(problem, shape, angles)

    def cost(shape, angles):
        return frame_costs(problem, shape, angles).sum() + shape_cost(problem.prior, shape)

    for row in (0, 3, 5, 8, 9, 12, 19):
        step = 1e-7 * np.eye(len(shape))[row]
        expected = (cost(shape + step, angles) - cost(shape - step, angles)) / 4e-7
        assert system.shape_gradient[row] == pytest.approx(expected, rel=2e-4, abs=1e-2)
    for row in range(ANGLES):
        step = np.zeros_like(angles)
        step[2, row] = 1e-7
        expected = (cost(shape, angles + step) - cost(shape, angles - step)) / 4e-7
        assert system.angle_gradient[2, row] == pytest.approx(expected, rel=2e-4, abs=1e-2)


def test_equals_dense_least_squares():
    problem, truth, postures = index_finger(12)
    problem = problem._replace(noise=np.full(3, .003))  # robust weights near 1
    solved = solve_shape(problem, problem.prior.mean, postures, 200)

    def residuals(x):
        shape, angles = x[:len(truth)], x[len(truth):].reshape(-1, ANGLES)
        misses = (place_markers(problem.chain, shape, angles) - problem.points) / .003
        posture = problem.posture
        usual = np.column_stack((
            0. * angles[:, 0] + posture.mean[0], 0. * angles[:, 0] + posture.mean[1],
            posture.mean[2] + posture.ratio * angles[:, 1],
            posture.mean[3] + shape[8] * angles[:, 2] + shape[9]))
        beyond = (np.minimum(angles - posture.lower, 0.)
                  + np.maximum(angles - posture.upper, 0.)) / np.radians(2.)
        return np.concatenate((misses.ravel(), ((angles - usual) / posture.spread).ravel(),
                               beyond.ravel(),
                               (shape - problem.prior.mean) / problem.prior.spread))

    scale = np.append(problem.prior.spread, np.ones(postures.size))
    dense = least_squares(residuals, np.append(problem.prior.mean, postures.ravel()),
                          x_scale=scale, xtol=1e-12, ftol=1e-12).x
    np.testing.assert_allclose(
        (solved.shape - dense[:len(truth)]) / problem.prior.spread, 0., atol=.02)


def test_shape_is_found_within_its_deviations():
    problem, truth, _ = index_finger(60)
    angles, _ = fit_angles(problem, problem.prior.mean, np.radians(FINGER_STARTS))
    solved = solve_shape(problem, problem.prior.mean, angles, 100)
    deviations = np.sqrt(np.diag(covariance(problem, solved.shape, solved.angles)))
    assert (deviations <= problem.prior.spread * (1. + 1e-6)).all()
    assert np.abs((solved.shape - truth) / deviations).max() < 4.


def test_missing_markers_are_left_out():
    problem, truth, postures = index_finger(30)
    problem.points[::3, 0] = np.nan
    problem.points[1::3, 2] = np.nan
    solved = solve_shape(problem, problem.prior.mean, postures, 50)
    assert np.isfinite(solved.shape).all() and np.isfinite(solved.cost)


def test_angles_are_found_from_any_of_the_starts():
    problem, truth, postures = index_finger(40)
    angles, cost = fit_angles(problem, truth, np.radians(FINGER_STARTS))
    assert np.degrees(np.abs(angles - postures)).mean() < 1.
    assert (cost <= frame_costs(problem, truth, postures) + 1e-6).all()
