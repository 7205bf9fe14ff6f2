"""Exchanged labels of layouts with several markers a digit."""

import numpy as np
import pytest
from helpers.capture_files import capture_path
from helpers.hands import markers_of

from hand_tracker.core.model.hand import LEFT_HAND_MIRROR, Hand
from hand_tracker.core.model.layout_presets import LAYOUT_NAMES, preset_layout
from hand_tracker.core.model.marker_layout import PALM_LANDMARKS
from hand_tracker.core.numerics.jit import JIT_IS_ON
from hand_tracker.core.tracker import HandTracker
from hand_tracker.simulation.motions import motion_named
from hand_tracker.tracking import exchange_search
from hand_tracker.tracking.exchange_check import ExchangeCheck
from hand_tracker.tracking.exchange_search import ExchangeSearch, exchange_check_for, exchanges

pytestmark = pytest.mark.skipif(not JIT_IS_ON, reason='nothing is searched in plain Python')
SEVERAL = ('dfki13', 'optitrack_hand', 'sig18_19', 'kyutech23')
KYUTECH = preset_layout('kyutech23')
RATE = 50.


def verdicts(frames, rate, hand, layout):
    """Return the verdicts on frames that a hand is tracked by, with their times [s]."""
    tracker = HandTracker(hand, layout)
    check = ExchangeSearch(tracker)
    found = [(n / rate, check.add(tracker.update(frame, n / rate), n / rate))
             for n, frame in enumerate(frames)]
    return [(time, verdict) for time, verdict in found if verdict is not None]


def simulated(hand, layout, motion='spelling', seconds=8.):
    """Return markers of a moving hand that are off by 1 mm where they are worn, and by noise."""
    times, random = np.arange(0., seconds, 1. / RATE), np.random.RandomState(1)
    angles = motion_named(motion, hand, duration=times[-1]).sample(times)[0]
    worn = layout.with_offsets(layout.offsets + random.normal(0., .001, layout.offsets.shape))
    frames = markers_of(hand, angles, worn)
    return frames + random.normal(0., 3e-4, frames.shape)


def with_exchanged(frames, exchange):
    return frames[:, [exchange.get(row, row) for row in range(frames.shape[1])]]


def rows_at(layout, *places):
    return [layout.places.index(place) for place in places]


@pytest.mark.parametrize('task', [1, 3, 5, 7])
def test_exchanged_skin_markers_of_an_unmeasured_hand_are_named_and_right_ones_never(task):
    take = np.load(capture_path(f'kyutech_s1__trial4_task{task}'))
    hand, rate = Hand.scaled(side=str(take['side'])), float(take['rate_hz'])
    frames = np.concatenate(3 * [take['markers'].astype(float)])
    assert not any(verdict for _, verdict in verdicts(frames, rate, hand, KYUTECH))
    for places in (('index_pip', 'index_tip'), ('ring_dip', 'little_dip'),
                   ('index_mcp', 'middle_mcp'), ('thumb_ip', 'thumb_tip')):
        one, other = rows_at(KYUTECH, *places)
        (time, verdict), *_ = verdicts(
            with_exchanged(frames, {one: other, other: one}), rate, hand, KYUTECH)
        assert verdict == {one: other, other: one} and time < 3.


@pytest.mark.parametrize('name', SEVERAL)
@pytest.mark.parametrize('side', ['right', 'left'])
def test_exchanges_of_every_kind_are_named_within_seconds(name, side):
    layout, hand = preset_layout(name), Hand.scaled(side=side)
    frames = simulated(hand, layout)
    # With but three markers of the palm the tracker itself puts them in another order.
    possible = [exchange for exchange in exchanges(layout) if name in ('sig18_19', 'kyutech23')
                or not any(layout.places[row] in PALM_LANDMARKS for row in exchange)]
    for which in np.random.RandomState(2).choice(len(possible), 6, replace=False):
        given = with_exchanged(frames, possible[which])
        (time, verdict), *_ = verdicts(given, RATE, hand, layout)
        tracker = HandTracker(hand, layout)
        is_put_right = np.mean([np.nanmean(tracker.update(frame).residuals)
                                for frame in given[:100]]) < .003
        assert is_put_right or verdict == possible[which] and time < 4.


@pytest.mark.parametrize('name', SEVERAL)
def test_a_hand_that_fits_is_never_solved_again(name, monkeypatch):
    hand, layout = Hand.scaled(), preset_layout(name)
    tracker = HandTracker(hand, layout)
    check = ExchangeSearch(tracker)
    monkeypatch.setattr(exchange_search, 'HandTracker', None)
    found = [check.add(tracker.update(frame, n / RATE), n / RATE)
             for n, frame in enumerate(simulated(hand, layout))]
    assert {} in found and not any(found)


@pytest.mark.parametrize('name', SEVERAL)
@pytest.mark.parametrize('motion', ['spelling', 'range_of_motion'])
def test_markers_of_the_other_hand_are_not_called_exchanged(name, motion):
    hand, layout = Hand.scaled(), preset_layout(name)
    mirrored = simulated(hand, layout, motion) * LEFT_HAND_MIRROR
    assert not any(verdict for _, verdict in verdicts(mirrored, RATE, hand, layout))


def test_labels_that_are_right_again_are_said_to_be():
    hand = Hand.scaled()
    one, other = rows_at(KYUTECH, 'index_pip', 'middle_pip')
    frames = simulated(hand, KYUTECH, seconds=16.)
    half = len(frames) // 3
    frames[:half] = with_exchanged(frames[:half], {one: other, other: one})
    found = [verdict for _, verdict in verdicts(frames, RATE, hand, KYUTECH)]
    assert found[0] == {one: other, other: one} and found[-1] == {}


def test_labels_exchanged_in_the_middle_are_named_though_the_hand_is_not_measured():
    one, other = rows_at(KYUTECH, 'ring_tip', 'little_tip')
    frames = simulated(Hand.scaled(.21, .1), KYUTECH, seconds=10.)
    half = len(frames) // 2
    frames[half:] = with_exchanged(frames[half:], {one: other, other: one})
    named = [(time, verdict) for time, verdict in verdicts(frames, RATE, Hand.scaled(), KYUTECH)
             if verdict]
    assert named[0][1] == {one: other, other: one} and named[0][0] < 5. + 3.


def test_whole_fingers_are_exchanged_with_their_knuckles_or_without():
    hand = Hand.scaled()
    for joints in (('pip', 'dip', 'tip'), ('mcp', 'pip', 'dip', 'tip')):
        rows = [rows_at(KYUTECH, *(f'{finger}_{joint}' for joint in joints))
                for finger in ('index', 'middle')]
        exchange = {**dict(zip(*rows)), **dict(zip(*rows[::-1]))}
        (time, verdict), *_ = verdicts(
            with_exchanged(simulated(hand, KYUTECH), exchange), RATE, hand, KYUTECH)
        assert verdict == exchange and time < 3.


def test_digits_are_exchanged_joint_by_joint_in_whatever_order_they_are_listed():
    order = [*range(23)]
    order[7:10] = order[9:6:-1]     # the middle finger, from its tip
    layout = KYUTECH.in_order([KYUTECH.names[row] for row in order])
    for exchange in exchanges(layout):
        if len(exchange) == 6:
            joints = {layout.places[row].split('_')[1] == layout.places[other].split('_')[1]
                      for row, other in exchange.items() if 'thumb' not in (
                          layout.places[row].split('_')[0], layout.places[other].split('_')[0])}
            assert joints <= {True}


def test_what_cannot_be_judged_is_not():
    hand = Hand.scaled()
    tracker = HandTracker(hand, KYUTECH)
    check = ExchangeSearch(tracker)
    one, other = rows_at(KYUTECH, 'index_pip', 'index_tip')
    frames = with_exchanged(simulated(hand, KYUTECH), {one: other, other: one})
    held = np.repeat(frames[:1], len(frames), axis=0)
    lost = frames.copy()
    lost[:, [place.endswith(('wrist', 'mcp')) for place in KYUTECH.places]] = np.nan
    for given in (held, lost):
        assert not any(verdict for _, verdict in verdicts(given, RATE, hand, KYUTECH))
    state = tracker.update(frames[0], 0.)
    for time in (None, np.nan) * 100:
        assert check.add(state, time) is None


def test_layouts_are_searched_where_several_markers_show_each_digit():
    kinds = {name: type(exchange_check_for(HandTracker(layout=preset_layout(name))))
             for name in LAYOUT_NAMES}
    assert {name for name in SEVERAL if kinds[name] is ExchangeSearch} == set(SEVERAL)
    assert kinds['paper8'] is kinds['tips5_palm3'] is ExchangeCheck
