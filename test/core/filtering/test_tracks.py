"""What the filters know of markers: seen ones followed, hidden ones carried on."""

import numpy as np
import pytest

from hand_tracker.core.filtering.tracks import (
    PACE_TIME,
    clear_motion,
    initial_tracks,
    position_deviation,
    predict_track,
    update_track,
)

STEP, NOISE, FADING = 1. / 120., 1e-4, .1
NOWHERE = (0., 0., 0.)
VELOCITY = np.array((.4, -.2, .1))


def followed(frames=240, velocity=VELOCITY, smooth=True, noise=0., seed=1):
    """Return tracks of which the first marker was seen in even motion, and its last place."""
    rng = np.random.default_rng(seed)
    tracks = initial_tracks(np.zeros((2, 3)))
    for frame in range(frames):
        place = velocity * STEP * frame
        observed = tuple(place + rng.normal(scale=noise, size=3))
        update_track(tracks, 0, observed, STEP, NOISE, smooth)
        tracks.seen[0] = True
    return tracks, place


def carried(tracks, frames, move=NOWHERE, drift=NOWHERE, fading=FADING):
    """Return the places of the first marker while it is hidden, shape (frames, 3)."""
    path = []
    for _ in range(frames):
        predict_track(tracks, 0, move, drift, STEP, fading)
        tracks.seen[0] = False
        path.append(tracks.mean[0, :3].copy())
    return np.array(path)


def test_a_marker_never_seen_stays_where_it_is():
    tracks = initial_tracks(np.array(((.1, .2, .3), (0., 0., 0.))))
    path = carried(tracks, 100)
    np.testing.assert_array_equal(path, np.tile((.1, .2, .3), (100, 1)))
    assert not tracks.known[0] and tracks.hidden_for[0] == pytest.approx(100. * STEP)


def test_a_hidden_marker_goes_on_and_then_fades():
    tracks, last = followed()
    path = carried(tracks, 240)
    speeds = np.diff(np.vstack((last, path)), axis=0) / STEP
    np.testing.assert_allclose(speeds[0], VELOCITY, rtol=.1)
    along = speeds @ VELOCITY / (VELOCITY @ VELOCITY)
    assert (np.diff(along) <= 1e-9).all() and along[-1] < 1e-3
    assert along[round(FADING / STEP) - 1] == pytest.approx(np.exp(-1.), rel=.1)
    np.testing.assert_allclose(path[-1] - last, FADING * VELOCITY, rtol=.1)


def test_without_fading_it_goes_on_turning_as_the_filter_has_it():
    """The paper's prediction (VTM-UKF): velocity, acceleration and turn."""
    radius, rate = .05, 6.

    def place(frame):
        angle = rate * STEP * frame
        return radius * np.array((np.cos(angle), np.sin(angle), 0.))

    errors = []
    for fading in (np.inf, 1e6):
        tracks = initial_tracks(np.zeros((1, 3)))
        for frame in range(240):
            update_track(tracks, 0, tuple(place(frame)), STEP, NOISE, True)
            tracks.seen[0] = True
        path = carried(tracks, 24, fading=fading)
        errors.append(np.linalg.norm(path[-1] - place(263)))
    turning, straight = errors
    assert turning < .3 * straight


def test_without_inertia_it_stays():
    tracks, last = followed(smooth=False)
    np.testing.assert_allclose(carried(tracks, 50, fading=0.), np.tile(last, (50, 1)), atol=1e-4)


def test_what_others_say_is_added_and_only_its_own_motion_fades():
    """All of its velocity is that of others: it goes on with them alone, in full."""
    tracks, last = followed()
    path = carried(tracks, 60, tuple(VELOCITY * STEP), tuple(VELOCITY))
    expected = last + VELOCITY * STEP * np.arange(1, 61)[:, None]
    np.testing.assert_allclose(path, expected, atol=1e-3)


def test_pace_is_less_noisy_than_the_measurements_and_not_late():
    tracks, _ = followed(noise=NOISE)
    np.testing.assert_allclose(tracks.pace[0], VELOCITY, atol=.1)
    still, _ = followed(velocity=0. * VELOCITY, noise=NOISE)
    assert abs(still.pace[0]).max() < .3 * NOISE / STEP
    assert PACE_TIME < .05


def test_a_marker_back_after_long_is_where_it_is_seen():
    tracks, last = followed()
    carried(tracks, 120)
    place = last + (.2, .1, 0.)
    update_track(tracks, 0, tuple(place), STEP, NOISE, True)
    np.testing.assert_allclose(tracks.mean[0, :3], place, atol=1e-9)
    assert tracks.hidden_for[0] == 0.
    assert position_deviation(tracks.covariance[0]) == pytest.approx(NOISE)


@pytest.mark.parametrize('smooth', [True, False])
def test_smoothing_is_a_choice(smooth):
    tracks, last = followed(noise=10. * NOISE, smooth=smooth, velocity=0. * VELOCITY)
    place = last + 1e-4
    update_track(tracks, 0, tuple(place), STEP, NOISE, smooth)
    assert np.array_equal(tracks.mean[0, :3], place) is not smooth


def test_less_is_known_the_longer_it_is_hidden():
    tracks, _ = followed()
    before = [position_deviation(tracks.covariance[0])]
    for _ in range(60):
        carried(tracks, 1)
        before.append(position_deviation(tracks.covariance[0]))
    assert (np.diff(before) > 0.).all() and before[0] < NOISE < .005 < before[-1]


def test_no_time_moves_nothing():
    tracks, last = followed()
    pace = tracks.pace[0].copy()
    at = tracks.mean[0, :3].copy()
    predict_track(tracks, 0, NOWHERE, NOWHERE, 0., FADING)
    np.testing.assert_array_equal(tracks.mean[0, :3], at)
    np.testing.assert_array_equal(tracks.pace[0], pace)
    assert tracks.hidden_for[0] == 0.


def test_after_a_pause_places_are_kept_and_motion_is_not():
    tracks, _ = followed()
    at = tracks.mean[0, :3].copy()
    clear_motion(tracks)
    np.testing.assert_array_equal(carried(tracks, 20), np.tile(at, (20, 1)))
