"""The tracker on captures of real hands, beside a plain baseline on the same frames.

`pytest -s test/evaluation/test_captures.py` prints the table of errors.
"""

from functools import cache

import numpy as np
import pytest
from helpers.baseline import class_errors, plain_pip_errors
from helpers.capture_files import capture_path

from hand_tracker.calibration import fit_hand, landmark_positions
from hand_tracker.core.labelling.plausibility import correct_exchange, typical_places
from hand_tracker.core.model.hand import Hand, preset_coupling, preset_limits
from hand_tracker.core.model.kinematics import Pose
from hand_tracker.core.model.marker_layout import MarkerLayout
from hand_tracker.core.tracker import HandTracker
from hand_tracker.evaluation.captures import load_capture

MANIPNET = tuple(f'manipnet__{take}_{side}Hand' for take in ('cup1', 'cyl_med3')
                 for side in ('left', 'right'))
CAPTURES = MANIPNET + ('dexret__human_joint_right',)
CALIBRATION = .2  # the first part of a capture, on which its hand is fitted


@cache
def whole_frames(name):
    """Return a capture's frames without gaps: those to fit and those to judge."""
    capture = load_capture(capture_path(name))
    joints = capture.joints[np.isfinite(capture.joints).all(axis=(1, 2))]
    part = int(CALIBRATION * len(joints))
    return capture._replace(joints=joints[:part]), capture._replace(joints=joints[part:])


def track(hand, capture):
    """Return the angles (n, 25) and the 21 joints (n, 21, 3) of a capture, tracked."""
    tracker = HandTracker(hand)
    states = [tracker.update(markers) for markers in capture.markers]
    pose = Pose(*(np.array(part) for part in zip(*(state.pose for state in states))))
    wrist = np.array([state.wrist_position for state in states])
    return np.array([state.angles for state in states]), landmark_positions(hand, pose, wrist)


@cache
def fitted_and_tracked(name, preset):
    """Return the hand of a capture and what `track` finds with it."""
    fitted, judged = whole_frames(name)
    hand = fit_hand(fitted.joints, fitted.side, preset_limits(preset))
    return hand, *track(hand, judged)


def report(name, what, errors):
    print(f'{name:32s} {what:24s} ' + '  '.join(
        f'{joint} {1e3 * values.mean():.2f} ({1e3 * np.percentile(values, 95):.1f})'
        for joint, values in errors.items()))


@pytest.mark.parametrize('name', CAPTURES)
def test_angles_are_within_the_limits_and_pip_is_no_worse_than_the_plain_baseline(name):
    fitted, judged = whole_frames(name)
    plain = plain_pip_errors(fitted, judged)
    report(name, 'plain baseline', {'pip': plain})
    for preset in ('paper', 'wide'):
        hand, angles, joints = fitted_and_tracked(name, preset)
        assert ((hand.limits[:, 0] <= angles) & (angles <= hand.limits[:, 1])).all()
        errors = class_errors(joints, judged)
        report(name, preset, errors)
        if preset == 'wide':
            assert errors['pip'].mean() <= plain.mean()


def test_the_saddle_beats_the_papers_thumb_and_meets_its_target():
    errors = {'saddle': [], 'index_mcp': []}
    for name in MANIPNET:
        _, judged = whole_frames(name)
        hand, _, joints = fitted_and_tracked(name, 'wide')
        for thumb, tracked in (('saddle', joints),
                               ('index_mcp', track(hand.with_paper_thumb(), judged)[1])):
            found = class_errors(tracked, judged)
            report(name, f'thumb {thumb}', {
                joint: found[joint] for joint in ('thumb_cmc', 'thumb_mcp', 'thumb_ip')})
            errors[thumb].append([found['thumb_mcp'].mean(), found['thumb_ip'].mean()])
    saddle, paper = (np.mean(errors[thumb], axis=0) for thumb in errors)
    print(f'mean of the files, MCP and IP: saddle {1e3 * saddle}, index_mcp {1e3 * paper} mm')
    assert (saddle <= .006).all()
    assert (saddle < paper).all()


@pytest.mark.parametrize('name', MANIPNET)
def test_finger_tips_meet_their_targets_with_the_usual_and_with_the_fitted_coupling(name):
    _, judged = whole_frames(name)
    hand, _, joints = fitted_and_tracked(name, 'wide')
    usual = track(hand.replace(coupling=preset_coupling()), judged)[1]
    for what, tracked, most in (('usual', usual, .009), ('fitted', joints, .0072)):
        found = class_errors(tracked, judged)
        report(name, f'coupling {what}', {'tip': found['tip']})
        assert found['tip'].mean() <= most


@pytest.mark.parametrize('name', CAPTURES)
def test_right_labels_are_kept_with_nothing_but_a_mean_hand_to_go_by(name):
    markers = np.ascontiguousarray(whole_frames(name)[1].right().markers[::20])
    hand = Hand.scaled()
    usual = typical_places(hand, MarkerLayout().mounting(hand))
    for frame in markers:
        rows = np.arange(8)
        correct_exchange(frame, np.ones(8, dtype=bool), usual, rows)
        np.testing.assert_array_equal(rows, np.arange(8))


@pytest.mark.parametrize('name', MANIPNET)
def test_exchanged_labels_of_the_palm_are_put_right_with_nothing_but_a_mean_hand(name):
    markers = np.ascontiguousarray(whole_frames(name)[1].right().markers[::20])
    hand = Hand.scaled()
    usual = typical_places(hand, MarkerLayout().mounting(hand))
    for exchanged in ([1, 0, 2], [2, 1, 0], [0, 2, 1]):
        order = np.array(exchanged + [3, 4, 5, 6, 7])
        for frame in markers:
            rows = np.arange(8)
            correct_exchange(frame[order], np.ones(8, dtype=bool), usual, rows)
            np.testing.assert_array_equal(rows, order)
