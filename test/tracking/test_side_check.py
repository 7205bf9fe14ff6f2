"""Whether labelled markers are of the other hand."""

from types import SimpleNamespace

import numpy as np
import pytest
from helpers.capture_files import capture_path
from helpers.hands import from_pose_to_pose, hand_at, markers_of

from hand_tracker.core.model.hand import LEFT_HAND_MIRROR, OTHER_SIDE, Hand
from hand_tracker.core.model.layout_presets import preset_layout
from hand_tracker.core.model.marker_layout import PAPER_PLACES, MarkerLayout
from hand_tracker.core.model.states import PREDICTED, SEEN
from hand_tracker.core.tracker import HandTracker
from hand_tracker.simulation.motions import motion_named
from hand_tracker.tracking.side_check import SideCheck, recorded_side_fault

RATE = 100.
HAND = Hand.scaled()


def found_after(side, frames):
    """Return the time after which the side was found to be wrong, None where it was not."""
    check = SideCheck(side, MarkerLayout().principal)
    states = (SimpleNamespace(
        markers=np.nan_to_num(frame), residuals=np.zeros(len(frame)),
        marker_states=np.where(np.isnan(frame[:, 0]), PREDICTED, SEEN)) for frame in frames)
    return next((n / RATE for n, state in enumerate(states) if check.add(state, n / RATE)), None)


@pytest.mark.parametrize('seed', range(3))
def test_the_other_hand_is_found_within_two_seconds_and_the_own_never(seed):
    frames = from_pose_to_pose(seed)
    for side, mine in (('right', frames), ('left', frames * LEFT_HAND_MIRROR)):
        other = 'left' if side == 'right' else 'right'
        assert found_after(side, mine) is None
        assert found_after(other, mine) <= 2.
        assert found_after(side, mine * (1., 1., -1.)) <= 2.  # a mirrored axis


def verdicts(side, frames, rate):
    """Return the verdict of each frame of markers as a tracker of that side has them."""
    tracker, check = HandTracker(Hand.scaled(side=side)), SideCheck(side, MarkerLayout().principal)
    return [check.add(tracker.update(frame, n / rate), n / rate) for n, frame in enumerate(frames)]


def test_labels_of_a_mirrored_palm_that_are_put_right_do_not_undo_the_verdict():
    rate, left = 120., Hand.scaled(side='left')
    angles, *wrist = motion_named('demo', left, 7).sample(np.arange(0., 14., 1. / rate))
    frames = markers_of(left, angles, None, *wrist)
    found = verdicts('right', frames, rate)
    # The tracker exchanges index_mcp and little after 12.9 s.
    assert True in found[:60] and False not in found


@pytest.mark.parametrize('exchanged', [(0, 1), (0, 2), (1, 2)])
def test_labels_of_a_hand_that_fits_are_put_right_for_the_verdict(exchanged):
    frames = np.concatenate([from_pose_to_pose(seed) for seed in range(5)])
    mirrored = frames[:200] * LEFT_HAND_MIRROR
    swapped = np.arange(8)
    swapped[list(exchanged)] = swapped[list(exchanged)[::-1]]
    found = verdicts('right', np.concatenate((mirrored, frames[:, swapped])), RATE)
    assert True in found[:200]
    assert False in found[200:] and True not in found[-500:]


def test_a_hand_that_hardly_bends_is_found_by_its_thumb():
    # Half of a hand at rest.
    frames = np.array([hand_at(HAND.relaxed() * (.5 + .1 * np.sin(.05 * number)))
                       for number in range(200)])
    assert found_after('right', frames) is None
    assert found_after('left', frames) <= 1.
    frames[:, -1] = np.nan
    assert found_after('left', frames) is None


@pytest.mark.parametrize('name', ['manipnet__cup1_leftHand', 'dfki__pillow'])
def test_the_other_hand_of_a_capture_is_found_within_two_seconds(name):
    capture = np.load(capture_path(name))
    side, layout = str(capture['side']), MarkerLayout()
    if 'markers' in capture:
        layout = preset_layout('dfki13')
        frames = capture['markers'][:, [*map(list(capture['marker_names']).index, layout.names)]]
    else:
        names = list(capture['joints'])
        frames = capture['positions'][:, [names.index(place) for place in PAPER_PLACES]]
    rate = float(capture['rate_hz'])
    for start in range(0, len(frames) - int(2 * rate), int(5 * rate)):
        seconds = frames[start:start + int(2 * rate):int(rate / 20)]
        found = recorded_side_fault(
            ((.05 * n, frame) for n, frame in enumerate(seconds)), OTHER_SIDE[side],
            layout.principal)
        assert found is not None
        assert recorded_side_fault(((.05 * n, frame) for n, frame in enumerate(seconds)), side,
                                   layout.principal) is None


def test_a_flat_hand_or_a_palm_that_is_hidden_tells_nothing():
    flat = markers_of(HAND, np.zeros(25))
    assert found_after('left', [flat] * 500) is None
    hidden = from_pose_to_pose(0)
    hidden[:, 1] = np.nan
    assert found_after('left', hidden) is None
