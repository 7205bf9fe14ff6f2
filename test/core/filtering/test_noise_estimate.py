"""The noise of each marker is learned, whatever the hand does."""

import numpy as np
import pytest

from hand_tracker.core.filtering.noise_estimate import (
    MIN_NOISE,
    initial_noise,
    noise_in_palm_frame,
    noise_levers,
    update_noise,
)

RATE = 120.
MOST = 2e-3
MARKER_NOISE = 3e-4  # [m]


def learned(deviation, seconds=20., move=0., seen=1., most=MOST, seed=1, rate=RATE):
    """Return what is learned of eight markers, the mean over the last half, shape (8,)."""
    rng = np.random.default_rng(seed)
    noise = initial_noise(8, most)
    past = []
    for frame in range(round(seconds * rate)):
        markers = rng.normal(scale=deviation, size=(8, 3)) + move * np.sin(
            2. * np.pi * frame / rate * np.array((.5, .8, 1.1)))
        update_noise(noise, markers, rng.random(8) < seen, 1. / rate, most)
        past.append(noise.deviation.copy())
    assert (np.array(past) <= most).all()
    return np.array(past)[len(past) // 2:].mean(axis=0)


@pytest.mark.parametrize('deviation', [1e-4, 3e-4, 1e-3])
def test_noise_at_rest_is_learned_within_a_tenth(deviation):
    found = learned(deviation)
    assert found.mean() == pytest.approx(deviation, rel=.1)
    np.testing.assert_allclose(found, deviation, rtol=.2)


@pytest.mark.parametrize('rate', [30., 60., 480.])
def test_the_rate_does_not_matter(rate):
    assert learned(3e-4, rate=rate).mean() == pytest.approx(3e-4, rel=.15)


@pytest.mark.parametrize('deviation', [3e-4, 1e-3])
def test_a_hand_that_moves_is_not_noise(deviation):
    assert learned(deviation, move=.1).mean() == pytest.approx(deviation, rel=.15)


def test_it_is_never_more_than_said():
    assert learned(1e-2, most=3e-4) == pytest.approx(3e-4)
    assert (learned(1e-4, move=10., most=3e-4) <= 3e-4).all()


def test_no_noise_is_the_least():
    assert learned(0.) == pytest.approx(MIN_NOISE)


def test_drop_outs_leave_it_as_it_is():
    assert learned(3e-4, seconds=120., seen=.8).mean() == pytest.approx(3e-4, rel=.15)
    # Of four that follow on each other hardly any are left: it stays as it was.
    noise = initial_noise(8, MOST)
    rng = np.random.default_rng(2)
    for frame in range(1000):
        markers = rng.normal(scale=1e-4, size=(8, 3))
        markers[frame % 3 == 0] = np.nan
        update_noise(noise, markers, np.full(8, frame % 3 > 0), 1. / RATE, MOST)
    assert (noise.deviation == MOST).all()


def test_repeated_stamps_tell_nothing():
    noise = initial_noise(8, MOST)
    for _ in range(100):
        update_noise(noise, np.zeros((8, 3)), np.ones(8, dtype=bool), 0., MOST)
    assert (noise.deviation == MOST).all()


def test_worse_noise_is_noticed_within_seconds():
    noise = initial_noise(1, MOST)
    rng = np.random.default_rng(3)
    for deviation in (1e-4, 1e-3):
        for _ in range(round(10. * RATE)):
            update_noise(noise, rng.normal(scale=deviation, size=(1, 3)), np.array((True,)),
                         1. / RATE, MOST)
        assert noise.deviation[0] == pytest.approx(deviation, rel=.4)


def test_levers_are_those_of_a_rigid_fit():
    """Against the spread of places carried by fits to a palm with noise."""
    rng = np.random.default_rng(7)
    template = np.array(((0., 0., 0.), (.083, .021, -.003), (.068, -.034, -.006)))
    places = np.array(((.15, .03, .01), (.05, .06, -.04)))
    noisy = template + rng.normal(scale=1e-5, size=(4000, 3, 3))
    middle = template.mean(axis=0)
    shift = noisy - noisy.mean(axis=1, keepdims=True)
    u, _, vt = np.linalg.svd(np.einsum('nij,ik->njk', shift, template - middle))
    flip = np.stack((np.ones(4000), np.ones(4000), np.linalg.det(u @ vt)), axis=1)
    turns = u * flip[:, None, :] @ vt
    carried = np.einsum('njk,pk->npj', turns, places - middle) + noisy.mean(axis=1)[:, None]
    np.testing.assert_allclose(
        carried.var(axis=0).mean(axis=1) / 1e-10, noise_levers(template, places), rtol=.1)


def test_a_still_palm_adds_little_noise_and_no_palm_more_than_its_markers():
    still, moving = np.zeros((3, 9, 9)), np.tile(np.eye(9), (3, 1, 1))
    assert noise_in_palm_frame(MARKER_NOISE, still, 2.) == pytest.approx(MARKER_NOISE)
    assert noise_in_palm_frame(MARKER_NOISE, moving, 2.) == pytest.approx(
        np.sqrt(3.) * MARKER_NOISE)
