"""A take collected from live markers, by their stamps."""

import numpy as np
import pytest
from helpers.hands import hand_at
from helpers.skin_markers import worn_markers

from hand_tracker.calibration.live_take import (
    CALIBRATION_KEY,
    NO_CALIBRATION,
    TAKE_RATE,
    LiveTake,
    progress_from_diagnostics,
)
from hand_tracker.calibration.prompts import PROMPTS
from hand_tracker.calibration.take_checks import check_takes
from hand_tracker.calibration.take_files import load_take
from hand_tracker.calibration.takes import InvalidTake
from hand_tracker.core.model.hand import Hand
from hand_tracker.core.model.marker_layout import PAPER_PLACES, MarkerLayout
from hand_tracker.simulation.motions import motion_named
from hand_tracker.simulation.visibility import skin_layout

HAND = Hand.scaled()


def collected(rate, seconds, **options):
    take = LiveTake(MarkerLayout(), 'right', **options)
    for time in np.arange(0., seconds, 1. / rate):
        take.add(hand_at(), time)
    return take


@pytest.mark.parametrize('rate', (25., 30., 100., 120., 480.))
def test_frames_are_kept_evenly(rate):
    take = collected(rate, 10.).take()
    assert take.rate == pytest.approx(len(take.points) / 10., rel=.02)
    assert .8 * TAKE_RATE <= take.rate <= 1.12 * TAKE_RATE


def test_stamps_that_jump_or_miss_count_no_time():
    take = collected(100., 4., max_duration=5.)
    take.add(hand_at(), None)
    take.add(hand_at(), 1e6)
    assert take.seconds == pytest.approx(4.99) and not take.is_over
    take.add(hand_at(), 0.)
    assert not take.is_over
    take.add(hand_at(), .1)
    assert take.is_over


def test_it_is_over_when_all_was_shown_and_can_be_fitted(tmp_path):
    moving = motion_named('range_of_motion', HAND, 2)
    times = np.arange(0., moving.duration, 1. / TAKE_RATE)
    markers = worn_markers(HAND, skin_layout(HAND), moving.sample(times)[0])
    take = LiveTake(MarkerLayout(), 'right')
    said = []
    for frame, time in zip(markers, times):
        take.add(frame, time)
        coverage = take.coverage()
        if coverage.is_complete:
            break
        said += [coverage.text] if coverage.text not in said[-1:] else []
    assert coverage.is_complete and coverage.missing() == [] and 'everything' in coverage.text
    # In the order in which they are asked for, the last at the end.
    assert said[-1] == PROMPTS[-1].text and said == list(dict.fromkeys(said))
    assert check_takes([take.take()]) == []
    take.take().save(tmp_path / 'take.npz')
    loaded = load_take(tmp_path / 'take.npz')
    assert loaded.names == PAPER_PLACES and loaded.side == 'right'
    np.testing.assert_array_equal(loaded.points, take.take().points)


def test_what_is_not_seen_is_named_and_left_out():
    take = LiveTake(MarkerLayout(), 'left')
    frame = hand_at(hand=HAND.mirrored())
    frame[7] = np.nan
    assert take.coverage().shares.max() == 0.
    for time in np.arange(0., 5., .05):
        take.add(frame, time)
    assert 'hardly seen: thumb' in take.coverage().text
    assert take.take().names == PAPER_PLACES[:-1]
    with pytest.raises(InvalidTake, match='index_cmc.*wrist, index_mcp, little_mcp'):
        LiveTake(MarkerLayout(('wrist', 'index_cmc', *PAPER_PLACES[2:])), 'right')


def test_what_diagnostics_tell_is_read_again():
    assert progress_from_diagnostics({}) is None
    assert progress_from_diagnostics({CALIBRATION_KEY: NO_CALIBRATION}) is None
    coverage = collected(30., 2.).coverage()
    text, shares = progress_from_diagnostics({CALIBRATION_KEY: coverage.text, **coverage.values()})
    assert text == coverage.text and list(shares) == [prompt.name for prompt in PROMPTS]
    np.testing.assert_allclose(list(shares.values()), coverage.shares, atol=.01)


def test_a_take_is_over_where_no_marker_comes_any_more():
    take = LiveTake(MarkerLayout(), 'right', 5.)
    for number in range(31):
        take.add(np.zeros((8, 3)), number / 30., 100. + number / 30.)
    coverage = take.coverage()
    for now, is_over in ((101., False), (104.9, False), (105., True)):
        assert take.has_ended(coverage, now) is take.has_stopped(now) is is_over
    assert not take.has_ended(coverage)
    assert take.end_lines(coverage)[0][1].startswith('no marker comes any more; not shown: ')
    # Not while they come, however slowly their stamps go on.
    take.add(np.zeros((8, 3)), 1.1, 109.)
    assert not take.has_ended(coverage, 110.) and take.has_ended(coverage, 112.1)
    assert not LiveTake(MarkerLayout(), 'right', 5.).has_stopped(1e9)
