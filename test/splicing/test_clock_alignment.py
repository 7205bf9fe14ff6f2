"""Clocks of two recordings of one wrist, aligned by its speed."""

import numpy as np
import pytest
from helpers.bodies import SimulatedBody

from hand_tracker.files.skeleton_motion import skeleton_motion
from hand_tracker.splicing.clock_alignment import AlignmentError, Trajectory, align_clocks
from hand_tracker.splicing.spliced_body import wrist_motion


def recordings(seconds, seed, rates=(60., 120.), offset=1.2345, drift=0.):
    """Return the wrist's path as a body's system and as a hand's recorded it, with noise."""
    body = SimulatedBody(seconds=seconds, seed=seed)
    path, _ = wrist_motion(body.motion(rates[0], noise=.1), body.wrists['right'])
    times = np.arange(round((seconds - 3.) * rates[1])) / rates[1]
    hand = skeleton_motion(body.hand('right', times, lambda t: offset + (1. + drift) * t, 1e-3))
    return path, Trajectory(hand.times, hand.root_position)


@pytest.mark.parametrize('rates', [(60., 120.), (120., 100.), (30., 240.), (90., 90.)])
@pytest.mark.parametrize('offset', [1.2345, -2.7182])
def test_the_offset_is_found_within_two_milliseconds(rates, offset):
    found = align_clocks(*recordings(15., 3, rates, offset))
    assert found.offset == pytest.approx(offset, abs=.002)
    assert found.drift == 0.
    assert found.deviation < .002
    assert found.correlation > .98 and found.confidence > .5
    # The body is in centimetres.
    assert found.gain == pytest.approx(100., rel=.1)


def test_the_drift_of_a_long_recording_is_found():
    found = align_clocks(*recordings(150., 4, offset=-.4, drift=90e-6))
    for time in (0., 70., 140.):
        assert found.offset + (1. + found.drift) * time == pytest.approx(
            -.4 + (1. + 90e-6) * time, abs=.002)
    assert found.drift == pytest.approx(90e-6, abs=1e-5)
    np.testing.assert_allclose(found.hand_times(np.array([found.offset])), 0., atol=1e-12)


def test_a_body_that_begins_later_gaps_and_repeated_stamps_of_the_hand_do_no_harm():
    body, hand = recordings(20., 5, offset=4.)
    positions = hand.positions.copy()
    positions[600:660] = np.nan
    times = hand.times.copy()
    times[301] = times[300]
    found = align_clocks(Trajectory(body.times[120:], body.positions[120:]),
                         Trajectory(times, positions))
    assert found.offset == pytest.approx(4., abs=.002)


def test_other_motions_and_periodic_ones_are_refused():
    body, _ = recordings(15., 6)
    _, other = recordings(15., 7)
    with pytest.raises(AlignmentError, match='--offset SECONDS'):
        align_clocks(body, other)
    times = np.arange(1200) / 60.
    circle = np.stack([np.sin(5. * times), .3 * np.sin(5. * times), 0. * times], axis=1)
    with pytest.raises(AlignmentError, match='does not repeat'):
        align_clocks(Trajectory(times, circle), Trajectory(times[:900], circle[:900]))


def test_wrists_at_rest_and_short_recordings_are_refused():
    body, hand = recordings(15., 8)
    with pytest.raises(AlignmentError, match='3 s of the hand'):
        align_clocks(body, Trajectory(hand.times[:200], hand.positions[:200]))
    still = np.zeros_like(body.positions)
    with pytest.raises(AlignmentError, match="body's wrist moves at one speed"):
        align_clocks(Trajectory(body.times, still), hand)


@pytest.mark.parametrize('share', [.01, .003])
def test_of_a_wrist_that_hardly_moves_no_sure_offset_is_told(share):
    random = np.random.default_rng(9)
    for seed in (3, 5, 9):
        slowed = []
        for times, positions in recordings(6., seed, offset=.35):
            unit = 100. if not slowed else 1.    # the body is in centimetres
            middle = positions.mean(axis=0)
            slowed.append(Trajectory(times, middle + share * (positions - middle) + random.normal(
                0., 1e-3 * unit, positions.shape)))
        try:
            found = align_clocks(*slowed)
        except AlignmentError as error:
            assert '--offset SECONDS' in str(error)
        else:
            assert not found.is_sure and found.confidence < .5 and found.deviation > .004
            assert abs(found.offset - .35) < 4. * found.deviation
