"""The variable turn model and its unscented filter, against filterpy and against themselves."""

import math
import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from benchmarks.repository import REPOSITORY
from hand_tracker.core.filtering import ukf
from hand_tracker.core.numerics import jit

NOISE = 3e-4  # [m]


def moved(state, step, uncertainty=0.):
    """Return the whole state after a step of the motion model."""
    rate, _, _ = ukf.squared_turn_rate(tuple(state[3:6]), tuple(state[6:]), step, uncertainty)
    turn = ukf.turn_matrices(rate, step)[0]
    return np.array([ukf.turned(turn, tuple(axis)) for axis in state.reshape(3, 3).T]).T.ravel()


def by_sigma_points(mean, covariance, step, alpha):
    """Return the scaled unscented transform (β 2, κ 0) by its 19 points, about the centre."""
    uncertainty = np.trace(covariance[3:6, 3:6])
    spread = 3. * alpha * np.linalg.cholesky(covariance).T
    centre = moved(mean, step, uncertainty)
    away = np.array([moved(mean + side * d, step, uncertainty) - centre
                     for d in spread for side in (-1., 1.)])
    change = away.sum(axis=0) / (18. * alpha ** 2)
    return centre + change, (
        away.T @ away / (18. * alpha ** 2) + (2. - alpha ** 2) * np.outer(change, change))


def jerk_covariance(step, jerk_noise):
    covariance = np.zeros((9, 9))
    ukf.add_jerk(covariance, step, jerk_noise)
    return covariance


def begun(position=(0., 0., 0.)):
    mean, covariance = np.empty(9), np.empty((9, 9))
    ukf.initialise(mean, covariance, np.array(position), NOISE)
    return mean, covariance


def is_covariance(covariance):
    """Return whether it is symmetric and, as correlations, positive definite."""
    deviations = np.sqrt(np.diag(covariance))
    correlations = covariance / np.outer(deviations, deviations)
    return (np.isfinite(covariance).all() and (covariance == covariance.T).all()
            and np.linalg.eigvalsh(correlations)[0] > 0.)


def test_a_marker_on_a_circle_stays_on_it():
    radius, rate = .5, 10.
    state = np.array((radius, 0, 0, 0, radius * rate, 0, -radius * rate ** 2, 0, 0))
    for _ in range(63):
        state = moved(state, .01)
        # The still speed slows the turn a little, which adds up over a revolution.
        assert np.linalg.norm(state[:3]) == pytest.approx(radius, rel=1e-3)
        assert state[2] == state[5] == state[8] == 0.
    assert math.atan2(state[1], state[0]) == pytest.approx(0., abs=.02)


def test_the_turn_is_that_of_speed_and_acceleration():
    speed, rate, step = 4., 8., 1e-3
    velocity = moved(np.array((0., 0., 0., speed, 0., 0., 0., speed * rate, 0.)), step)[3:6]
    assert math.atan2(velocity[1], velocity[0]) == pytest.approx(rate * step, rel=.002)


@pytest.mark.parametrize('velocity', [(0., 0., 0.), (1e-300, 0., 0.), (.1, -.2, .3)])
def test_without_a_turn_acceleration_is_constant(velocity):
    step, velocity = .01, np.array(velocity)
    acceleration = 3. * velocity + (0., 0., 2. * (velocity == 0.).all())
    state = moved(np.concatenate((np.zeros(3), velocity, acceleration)), step)
    np.testing.assert_allclose(state, np.concatenate((
        step * velocity + .5 * step ** 2 * acceleration,
        velocity + step * acceleration, acceleration)), rtol=1e-12, atol=1e-300)


@pytest.mark.parametrize('angle', [1e-9, .01, .3, .999])
def test_the_series_are_the_closed_form_up_to_a_radian(angle):
    step, speed = .02, 2.
    rate = angle / step
    sideways = rate * (speed * speed + ukf.STILL_SPEED ** 2) / speed
    state = moved(np.array((0., 0., 0., speed, 0., 0., 0., sideways, 0.)), step)
    sine, cosine, versed = math.sin(angle), math.cos(angle), 2. * math.sin(.5 * angle) ** 2
    assert tuple(state[[0, 1, 3, 4, 6, 7]]) == pytest.approx((
        speed * sine / rate, sideways * versed / rate ** 2, speed * cosine, sideways * sine / rate,
        -rate * speed * sine, sideways * cosine), rel=1e-13)


@given(arrays(float, 6, elements=st.floats(-1e6, 1e6)),
       st.floats(0., 1., exclude_min=True), st.floats(0., 1e4))
@settings(max_examples=300, deadline=None)
def test_no_motion_explodes(state, step, uncertainty):
    bound = 1e-200 + np.abs(state).sum()
    after = moved(np.concatenate((np.zeros(3), state)), step, uncertainty)
    assert np.isfinite(after).all()
    # A turn of a radian at most in a step, at 60 rad/s at most.
    assert np.abs(after[:3]).max() <= 2. * bound
    assert np.abs(after[3:6]).max() <= 2. * bound
    assert np.abs(after[6:]).max() <= (1. + ukf.MAX_TURN_RATE) * bound


def test_a_marker_near_rest_does_not_spin():
    velocity = moved(np.array((0., 0., 0., 1e-4, 0., 0., 0., 1., 0.)), .01, 3e-4)[3:6]
    free = np.array((1e-4, .01, 0.))
    assert np.linalg.norm(velocity - free) < 1e-5


@pytest.mark.parametrize('seed', range(40))
def test_predictions_are_those_of_sigma_points(seed):
    rng = np.random.default_rng(seed)
    step = rng.choice((1. / 480., 1. / 120., 1. / 30., .1))
    sizes = 10. ** rng.uniform((-4., -3., -2., -2., -1.), (-2., 0., 1.5, .5, 1.5))
    root = rng.normal(size=(9, 9))
    covariance = root @ root.T * np.outer(*2 * [np.repeat(sizes[:3], 3)])
    mean = rng.normal(size=9) * np.repeat((1., *sizes[3:]), 3)
    expected, spread = by_sigma_points(mean, covariance, step, 3e-4)
    spread += jerk_covariance(step, 10.)
    ukf.predict(mean, covariance, step, 10.)
    deviations = np.sqrt(np.diag(spread))
    assert np.abs((mean - expected) / deviations).max() < 1e-4
    assert np.abs((covariance - spread) / np.outer(deviations, deviations)).max() < 1e-4


def test_no_time_changes_nothing():
    mean, covariance = begun((1., 2., 3.))
    ukf.predict(mean, covariance, .01, 10.)
    before = mean.copy(), covariance.copy()
    ukf.predict(mean, covariance, 0., 10.)
    np.testing.assert_array_equal(mean, before[0])
    np.testing.assert_array_equal(covariance, before[1])


def test_jerk_adds_up_over_steps():
    """White jerk over two halves of a step is that over the whole."""
    step, half = .02, .01
    transition = np.kron([[1., half, half ** 2 / 2.], [0., 1., half], [0., 0., 1.]], np.eye(3))
    first = jerk_covariance(half, 7.)
    np.testing.assert_allclose(
        transition @ first @ transition.T + jerk_covariance(half, 7.),
        jerk_covariance(step, 7.), rtol=1e-12)


def test_correction_is_the_textbook_one():
    rng = np.random.default_rng(1)
    root = rng.normal(size=(9, 9))
    mean, covariance, seen = rng.normal(size=9), root @ root.T, rng.normal(size=3)
    total = covariance[:3, :3] + .25 * np.eye(3)
    gain = covariance[:, :3] @ np.linalg.inv(total)
    innovation = seen - mean[:3]
    expected = mean + gain @ innovation, covariance - gain @ total @ gain.T
    consistency = ukf.correct(mean, covariance, seen, .5)
    assert consistency == pytest.approx(innovation @ np.linalg.solve(total, innovation))
    np.testing.assert_allclose(mean, expected[0], rtol=1e-12)
    np.testing.assert_allclose(covariance, expected[1], rtol=1e-10, atol=1e-12)


def test_innovations_of_a_true_model_are_consistent():
    rng = np.random.default_rng(2)
    jerk_noise, step, rows = 50., 1. / 120., []
    noise = np.linalg.cholesky(jerk_covariance(step, jerk_noise))
    for _ in range(20):
        state = np.zeros(9)
        state[3:6] = rng.normal(scale=ukf.INITIAL_SPEED_SD, size=3)
        mean, covariance = begun(rng.normal(scale=NOISE, size=3))
        for _ in range(60):
            uncertainty = np.trace(covariance[3:6, 3:6])
            state = moved(state, step, uncertainty) + noise @ rng.normal(size=9)
            ukf.predict(mean, covariance, step, jerk_noise)
            rows.append(ukf.correct(
                mean, covariance, state[:3] + rng.normal(scale=NOISE, size=3), NOISE))
    assert np.mean(rows) == pytest.approx(3., rel=.1)


def test_fading_is_a_change_of_units():
    mean, covariance = begun()
    mean[3:] = 1.
    ukf.predict(mean, covariance, .01, 10.)
    shares = np.array([1.] * 3 + [.5] * 6)
    expected = mean * shares, covariance * np.outer(shares, shares)
    ukf.damp(mean, covariance, .5)
    np.testing.assert_allclose(mean, expected[0])
    np.testing.assert_allclose(covariance, expected[1])


def test_filterpy_agrees_over_a_track_with_drop_outs():
    kalman = pytest.importorskip('filterpy.kalman', reason='filterpy, the oracle, is missing')
    rng = np.random.default_rng(0)

    def motion(state, step):
        return moved(state, step, np.trace(oracle.P[3:6, 3:6]))

    oracle = kalman.UnscentedKalmanFilter(
        9, 3, 1., lambda state: state[:3], motion,
        kalman.MerweScaledSigmaPoints(9, 1e-3, ukf.UKF_BETA, 0.))
    mean, covariance = begun()
    oracle.x, oracle.P, oracle.R = mean.copy(), covariance.copy(), NOISE ** 2 * np.eye(3)
    for frame in range(300):
        step, jerk_noise = rng.choice((1. / 480., 1. / 120., 1. / 30.)), 10. ** rng.uniform(-1, 4)
        oracle.Q = jerk_covariance(step, jerk_noise)
        oracle.predict(dt=step)
        ukf.predict(mean, covariance, step, jerk_noise)
        if rng.random() < .7:
            phase = np.array((9., 7., 11.)) * frame / 120. + (0., 0., 1.)
            seen = .05 * np.sin(phase) + rng.normal(scale=NOISE, size=3)
            oracle.update(seen)
            ukf.correct(mean, covariance, seen, NOISE)
        # Its sigma points at α 1e-3 differ from their limit by 1e-5 of a deviation, and it grows.
        deviations = np.sqrt(np.diag(oracle.P))
        assert np.abs((mean - oracle.x) / deviations).max() < 1e-3
        assert np.abs((covariance - oracle.P) / np.outer(deviations, deviations)).max() < 1e-3


def test_filterpy_agrees_in_plain_python():
    pytest.importorskip('numba', reason='numba is not installed: there is only plain Python')
    pytest.importorskip('filterpy', reason='filterpy, the oracle, is missing')
    if not jit.COMPILED:
        pytest.skip('already plain')
    subprocess.run(
        [sys.executable, '-m', 'pytest', '-q', '-p', 'no:cacheprovider', __file__,
         '-k', 'over_a_track'], check=True, cwd=REPOSITORY,
        env={**os.environ, 'HAND_TRACKER_JIT': '0', 'PYTHONPATH': os.pathsep.join(
            [str(REPOSITORY), os.environ.get('PYTHONPATH', '')])})


@given(st.integers(0, 2 ** 32 - 1))
@settings(max_examples=10, deadline=None)
def test_covariance_stays_one_whatever_comes(seed):
    rng = np.random.default_rng(seed)
    mean, covariance = begun()
    place = np.zeros(3)
    for frame in range(2000 if jit.COMPILED else 100):
        step = rng.choice((0., 1e-4, 1. / 480., 1. / 120., 1.))
        ukf.predict(mean, covariance, step, 10. ** rng.uniform(-9., 7.))
        if rng.random() < .02:
            place = rng.uniform(-1e3, 1e3, 3)
        if rng.random() < rng.choice((.02, .9)):
            assert math.isfinite(ukf.correct(
                mean, covariance, place + rng.normal(scale=NOISE, size=3),
                10. ** rng.uniform(-5., -2.)))
        assert np.isfinite(mean).all()
        assert is_covariance(covariance), frame
