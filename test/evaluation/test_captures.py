"""The tracker on captures of real hands, beside a plain baseline on the same frames.

`pytest -s test/test_captures.py` prints the table of errors.
"""

import numpy as np
import pytest
from helpers.captures import capture_path
from scipy.spatial.transform import Rotation

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
CLASSES = {'mcp': slice(5, None, 4), 'pip': slice(6, None, 4), 'dip': slice(7, None, 4),
           'tip': slice(8, None, 4), 'thumb_cmc': 1, 'thumb_mcp': 2, 'thumb_ip': 3,
           'thumb_tip': 4}
PALM = [0, 5, 17]
CALIBRATION = .2  # the first part of a capture, on which its hand is fitted


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


def in_palm(joints, template):
    """Return joints (n, 21, 3) in the frame of a template (3, 3) of wrist and two knuckles."""
    center = joints[:, PALM].mean(axis=1, keepdims=True)
    rotation = np.array([Rotation.align_vectors(
        template - template.mean(axis=0), frame)[0].as_matrix()
        for frame in joints[:, PALM] - center])
    return np.einsum('nij,nkj->nki', rotation, joints - center) + template.mean(axis=0)


def plain_pip_errors(fitted, judged):
    """Return the PIP errors (n, 4) [m] of the method that anyone would try first.

    Medians for palm and bones, a rigid palm, the exact two-bone solution in the plane of
    the palm's normal, no limits.
    """
    fitted, judged = (part.right().joints for part in (fitted, judged))
    first = fitted[0] - fitted[0, 0]
    x = first[9] / np.linalg.norm(first[9])
    z = np.cross(first[17], first[5])
    z -= (z @ x) * x
    z /= np.linalg.norm(z)
    template = np.median(
        in_palm(fitted, (first @ np.column_stack((x, np.cross(z, x), z)))[PALM]), axis=0)
    local = in_palm(judged, template[PALM])
    errors = np.empty((len(local), 4))
    for finger in range(4):
        mcp, pip, dip = (5 + 4 * finger + joint for joint in range(3))
        l1, l2 = (np.median(np.linalg.norm(fitted[:, b] - fitted[:, a], axis=1))
                  for a, b in ((mcp, pip), (pip, dip)))
        target = local[:, dip] - template[mcp]
        ahead = np.hypot(target[:, 0], target[:, 1])
        aim = np.column_stack((target[:, :2] / ahead[:, None], np.zeros(len(target))))
        bend = np.arccos(np.clip((ahead ** 2 + target[:, 2] ** 2 - l1 ** 2 - l2 ** 2)
                                 / (2. * l1 * l2), -1., 1.))
        down = np.arctan2(-target[:, 2], ahead) - np.arctan2(
            l2 * np.sin(bend), l1 + l2 * np.cos(bend))
        place = template[mcp] + l1 * (np.cos(down)[:, None] * aim
                                      - np.outer(np.sin(down), (0., 0., 1.)))
        errors[:, finger] = np.linalg.norm(place - local[:, pip], axis=1)
    return errors


@pytest.fixture(scope='module', params=CAPTURES)
def capture(request):
    return request.param, *whole_frames(request.param)


def report(name, what, errors):
    print(f'{name:32s} {what:24s} ' + '  '.join(
        f'{joint} {1e3 * values.mean():.2f} ({1e3 * np.percentile(values, 95):.1f})'
        for joint, values in errors.items()))


def class_errors(joints, capture):
    misses = np.linalg.norm(joints - capture.joints, axis=2)
    return {name: misses[:, rows] for name, rows in CLASSES.items()}


def test_angles_are_within_the_limits_and_pip_is_no_worse_than_the_plain_baseline(capture):
    name, fitted, judged = capture
    plain = plain_pip_errors(fitted, judged)
    report(name, 'plain baseline', {'pip': plain})
    for preset in ('paper', 'wide'):
        hand = fit_hand(fitted.joints, fitted.side, preset_limits(preset))
        angles, joints = track(hand, judged)
        assert ((hand.limits[:, 0] <= angles) & (angles <= hand.limits[:, 1])).all()
        errors = class_errors(joints, judged)
        report(name, preset, errors)
        if preset == 'wide':
            assert errors['pip'].mean() <= plain.mean()


def test_the_saddle_beats_the_papers_thumb_and_meets_its_target():
    errors = {'saddle': [], 'index_mcp': []}
    for name in MANIPNET:
        fitted, judged = whole_frames(name)
        hand = fit_hand(fitted.joints, fitted.side, preset_limits('wide'))
        for thumb, worn in (('saddle', hand), ('index_mcp', hand.with_paper_thumb())):
            found = class_errors(track(worn, judged)[1], judged)
            report(name, f'thumb {thumb}', {
                joint: found[joint] for joint in ('thumb_cmc', 'thumb_mcp', 'thumb_ip')})
            errors[thumb].append([found['thumb_mcp'].mean(), found['thumb_ip'].mean()])
    saddle, paper = (np.mean(errors[thumb], axis=0) for thumb in errors)
    print(f'mean of the files, MCP and IP: saddle {1e3 * saddle}, index_mcp {1e3 * paper} mm')
    assert (saddle <= .006).all()
    assert (saddle < paper).all()


@pytest.mark.parametrize('name', MANIPNET)
def test_finger_tips_meet_their_targets_with_the_usual_and_with_the_fitted_coupling(name):
    fitted, judged = whole_frames(name)
    hand = fit_hand(fitted.joints, fitted.side, preset_limits('wide'))
    for what, worn, most in (('usual', hand.replace(coupling=preset_coupling()), .009),
                             ('fitted', hand, .0072)):
        found = class_errors(track(worn, judged)[1], judged)
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
