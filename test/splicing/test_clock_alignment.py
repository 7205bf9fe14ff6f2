"""Clocks of two recordings of one wrist, aligned by its speed."""

import numpy as np
import pytest
from helpers.bodies import SimulatedBody
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from hand_tracker.cli.splice_recordings import alignment_words
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


def slow_recordings(rate, offset, seed):
    """Return a path of centimetres a second, as a body's system and as a hand's recorded it.

    The hand's jumps by 1 cm where its markers were hidden, early in what both show.
    """
    random = np.random.default_rng(seed)
    path = CubicSpline(np.arange(-8., 40., 3.), random.normal(0., .05, (16, 3)))
    times = np.arange(2640) / 120.
    hand = path(times) + random.normal(0., 3e-4, (len(times), 3))
    begin = max(-offset, 0.) + .15
    hand[(times > begin) & (times < begin + .1)] += .01
    body_times = np.arange(round(20. * rate)) / rate
    body = Rotation.from_rotvec((.2, .7, -.1)).apply(path(body_times - offset))
    body += random.normal(0., 3e-4, body.shape)
    return Trajectory(body_times, 100. * body), Trajectory(times, hand)


@pytest.mark.parametrize('rate', [30., 60., 90., 120., 240.])
@pytest.mark.parametrize('offset', [-.35, .35, 1.3, -3.217, 4.1, -4.1])
def test_a_slow_wrist_is_aligned_as_exactly_as_is_stated(rate, offset):
    found = align_clocks(*slow_recordings(rate, offset, 12))
    assert abs(found.offset - offset) < 2.5 * found.deviation < .01
    assert found.is_one_peak and found.is_sure


def test_a_world_that_drifts_does_no_harm():
    body, hand = recordings(20., 5, offset=.7)
    drift = np.random.default_rng(1).normal(0., 5. / np.sqrt(60.), body.positions.shape)
    found = align_clocks(body._replace(positions=body.positions + np.cumsum(drift, axis=0)), hand)
    assert found.offset == pytest.approx(.7, abs=.002) and found.is_sure


def test_a_left_handed_world_does_no_harm():
    body, hand = recordings(15., 3, offset=.7)
    found = align_clocks(body._replace(positions=body.positions * (1., 1., -1.)), hand)
    assert found.offset == pytest.approx(.7, abs=.002) and found.gain == pytest.approx(100., rel=.1)


def test_where_another_offset_fits_nearly_as_well_that_is_known():
    random = np.random.default_rng(2)
    once = CubicSpline(np.arange(0., 5., .4), np.append(knots := random.normal(
        0., .1, (12, 3)), knots[:1], axis=0), bc_type='periodic')
    other = CubicSpline(np.arange(-2., 20., .4), random.normal(0., .003, (55, 3)))

    def path(times):
        return once(times % 4.8) + other(times)

    times = np.arange(1440) / 120.
    found = align_clocks(Trajectory(times, path(times)), Trajectory(times[:1080], path(
        times[:1080] + 1.) + random.normal(0., .01, (1080, 3))))
    assert not found.is_one_peak and not found.is_sure
    assert abs(found.next_best - found.offset) == pytest.approx(4.8, abs=.2)
    said = alignment_words(found, 'right')
    assert 'deviation' not in said and 'unsure' in said and '--offset SECONDS' in said
    assert f'if it began at {found.next_best:.2f} s' in said
    assert 'deviation of 1.5 ms' in alignment_words(found._replace(
        confidence=.8, deviation=.0015), 'right')
