"""Whether labels of digits are exchanged from the start."""

from itertools import pairwise

import numpy as np
import pytest
from helpers.capture_files import capture_path
from helpers.hands import LAYOUT, markers_of

from hand_tracker.core.model.hand import Hand
from hand_tracker.core.model.layout_presets import preset_layout
from hand_tracker.core.tracker import HandTracker
from hand_tracker.evaluation.captures import load_capture
from hand_tracker.simulation.motions import motion_named
from hand_tracker.tracking.exchange_check import LEAST_STEP, REVIEWED_FRAMES, ExchangeCheck

NEIGHBOURS = [*pairwise(range(3, 7))]     # index, middle, ring, little
LONGEST = REVIEWED_FRAMES * .1     # [s] until a verdict
CAPTURES = ['manipnet__cup1_leftHand', 'manipnet__cyl_med3_rightHand', 'dexret__human_joint_right']


def verdicts(frames, rate, hand, layout=LAYOUT):
    """Return the verdicts on frames that a hand is tracked by."""
    tracker, check = HandTracker(hand, layout), ExchangeCheck(hand, layout)
    found = [check.add(tracker.update(frame, n / rate), n / rate)
             for n, frame in enumerate(frames)]
    return [verdict for verdict in found if verdict is not None]


def exchanged(frames, one, other):
    frames = frames.copy()
    frames[:, [one, other]] = frames[:, [other, one]]
    return frames


@pytest.mark.parametrize('name', CAPTURES)
def test_exchanged_neighbours_of_a_captured_hand_are_named_and_right_ones_never(name):
    capture = load_capture(capture_path(name))
    hand = Hand.scaled(side=capture.side)
    frames = capture.markers[:int(3. * LONGEST * capture.rate)]
    right = verdicts(frames, capture.rate, hand)
    assert right and not any(right)
    for one, other in NEIGHBOURS:
        found = verdicts(exchanged(frames, one, other), capture.rate, hand)
        assert found and all(verdict == {one: other, other: one} for verdict in found)
        # What a camera estimates may not be clear for ten seconds.
        assert len(found) == len(right) or name.startswith('dexret')


def test_labels_of_another_layout_are_checked_by_its_principal_markers():
    take, layout = np.load(capture_path('dfki__pillow')), preset_layout('dfki13')
    rate = float(take['rate_hz'])
    order = [list(take['marker_names']).index(name) for name in layout.names]
    frames = take['markers'][:int(4. * LONGEST * rate), order].astype(float)
    hand = Hand.scaled(side=str(take['side']))
    index, middle = layout.principal[3:5]
    right = verdicts(frames, rate, hand, layout)
    found = verdicts(exchanged(frames, index, middle), rate, hand, layout)
    assert right and not any(right)
    assert found and all(verdict == {index: middle, middle: index} for verdict in found)


@pytest.mark.parametrize('motion', ['spelling', 'power_grasp', 'lateral_grasp', 'range_of_motion'])
@pytest.mark.parametrize('length', [.175, .205])
def test_a_hand_of_any_size_in_any_motion_has_its_labels_right(motion, length):
    hand, rate = Hand.scaled(length), 50.
    times = np.arange(0., 4. * LONGEST, 1. / rate)
    angles = motion_named(motion, hand, duration=times[-1]).sample(times)[0]
    found = verdicts(markers_of(hand, angles), rate, Hand.scaled())
    assert found and not any(found)


def test_what_is_hidden_and_layouts_without_all_digits_are_not_judged():
    capture = load_capture(capture_path(CAPTURES[0]))
    hand, frames = Hand.scaled(side=capture.side), capture.markers[:int(15. * capture.rate)].copy()
    frames[:, 7] = np.nan
    assert verdicts(frames, capture.rate, hand) == []
    check = ExchangeCheck(hand, preset_layout('tips5_palm3'))
    state = HandTracker(hand).update(capture.markers[0], 0.)
    assert check.add(state, 0.) is None
    check = ExchangeCheck(hand, LAYOUT)
    for time in (None, np.nan) * REVIEWED_FRAMES:
        assert check.add(state, time) is None


def test_several_exchanged_labels_are_named_by_where_each_marker_is():
    capture = load_capture(capture_path(CAPTURES[1]))
    frames = capture.markers[:int(3. * LONGEST * capture.rate)].copy()
    # The marker of the index finger has the label of middle, and so on.
    frames[:, [3, 4, 5]] = frames[:, [5, 3, 4]]
    found = verdicts(frames, capture.rate, Hand.scaled(side=capture.side))
    assert found and all(verdict == {4: 3, 5: 4, 3: 5} for verdict in found)


@pytest.mark.parametrize('name', CAPTURES)
def test_a_pose_that_is_held_tells_nothing(name):
    capture, random = load_capture(capture_path(name)), np.random.RandomState(1)
    hand = Hand.scaled(side=capture.side)
    for row in random.randint(len(capture.markers), size=3):
        held = capture.markers[row] + random.normal(0., .0003, (int(15. * 60.), 8, 3))
        assert verdicts(held, 60., hand) == []


def test_frames_are_noted_a_few_times_a_second_and_forgotten():
    hand = Hand.scaled()
    tracker, check = HandTracker(hand), ExchangeCheck(hand, LAYOUT)
    poses = [tracker.update(markers_of(hand, share * hand.relaxed())) for share in (.5, 1.)]
    times = 1.001 * LEAST_STEP * np.arange(2 * REVIEWED_FRAMES)
    for n, time in enumerate(times[:REVIEWED_FRAMES - 1]):
        for _ in range(3):
            assert check.add(poses[n % 2], time) is None
            assert check.add(poses[1 - n % 2], time) is None
    check.begin()
    found = [check.add(poses[n % 2], time) for n, time in enumerate(times[REVIEWED_FRAMES:])]
    assert found == [None] * (REVIEWED_FRAMES - 1) + [{}]
