"""A hand is found again from its own simulated joints."""

from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hand_tracker.calibration import LANDMARKS, fit_hand, landmark_positions
from hand_tracker.calibration.fingers import USUAL_SLOPE_WORTH, fit_fingers
from hand_tracker.calibration.fitted_hand import SHOWN_PERCENTILES
from hand_tracker.calibration.landmarks import FINGER_ROWS, landmark_angles
from hand_tracker.calibration.palm_frame import median_lengths, palm_coordinates
from hand_tracker.calibration.thumb import Saddle, solve_thumb
from hand_tracker.core.errors import InvalidHand
from hand_tracker.core.model.hand import FINGERS, JOINTS, Hand, preset_coupling, preset_limits
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.options import TrackerOptions
from hand_tracker.core.tracker import HandTracker

FRAMES = 200
# Each frame is by itself: no motion leads from one to the next.
APART = TrackerOptions(smoothing=False, rigidity=False, outlier_gate=0., swap_margin=0.,
                       reentry_rate=1000.)
EIGHT_ROWS = [LANDMARKS.index(name) for name in (
    'wrist', 'index_mcp', 'little_mcp', 'index_dip', 'middle_dip', 'ring_dip', 'little_dip',
    'thumb_tip')]
LEADERS = np.array([JOINTS.index(f'{finger}_pip_flexion') for finger in FINGERS]
                   + [JOINTS.index('thumb_mcp_flexion')])


def person(side='right', roll=0., distance=0.):
    """Return a hand that differs from the default in all that is fitted.

    Roll of its thumb in degrees, distance of the CMC's axes in metres.
    """
    mean = Hand.scaled(.18, .08)
    # A fitted palm has wrist, index and little MCP in the plane of x and y.
    z = np.cross(mean.finger_mcp[3], mean.finger_mcp[0])
    y = np.cross(z, mean.finger_mcp[1])
    flat = np.array([axis / np.linalg.norm(axis) for axis in (np.cross(y, z), y, z)])
    turn = Rotation.from_rotvec(np.radians((8., -4., 6.))).as_matrix() @ flat
    return mean.replace(
        finger_mcp=mean.finger_mcp @ flat.T, finger_cmc=mean.finger_cmc @ flat.T,
        thumb_abduction_axis=turn @ mean.thumb_abduction_axis,
        thumb_rest_direction=turn @ mean.thumb_rest_direction,
        thumb_cmc=flat @ mean.thumb_cmc + (.002, -.001, .001), thumb_bones=(.044, .033, .027),
        thumb_mcp_abduction=np.radians(-6.),
        thumb_roll=np.radians(roll), thumb_axis_distance=distance,
        finger_abduction_axes=((.2, .05, 1.), (.1, 0., 1.), (.05, -.1, 1.), (-.1, -.05, 1.)),
        splay=np.radians((6., 0., -5., -12.)),
        coupling=((.4, .2), (.6, 0.), (.2, .3), (.5, -.1), (1.5, -.1)),
        limits=preset_limits('wide'), side=side)


def recorded(hand, seed=0, noise=0.):
    """Return angles and landmarks of random poses in which the hand's couplings hold."""
    random = np.random.default_rng(seed)
    lower, upper = preset_limits('paper').T
    angles = random.uniform(.9 * lower, .9 * upper, (FRAMES, len(JOINTS)))
    angles[:, JOINTS.index('thumb_mcp_abduction')] = hand.thumb_mcp_abduction
    mcp = angles[:, JOINTS.index('thumb_mcp_flexion')]
    mcp[:] = random.uniform(.1, .5, FRAMES)
    angles[:, LEADERS + 1] = np.clip(
        hand.coupling[:, 0] * angles[:, LEADERS] + hand.coupling[:, 1],
        lower[LEADERS + 1], upper[LEADERS + 1])
    rotation = Rotation.random(FRAMES, random).as_matrix()
    position = random.normal(0., .3, (FRAMES, 3))
    pose = forward(joint_table(hand), angles, rotation, position)
    joints = landmark_positions(hand, pose, position)
    return angles, joints + random.normal(0., noise, joints.shape)


@cache
def refitted(side, noise):
    hand = person(side)
    return hand, fit_hand(recorded(hand, noise=noise)[1], side, hand.limits)


def palm_distances(hand):
    """Return what of the palm does not depend on the frame in which it is given."""
    joints = np.vstack((np.zeros(3), hand.finger_mcp))
    return np.linalg.norm(joints[:, None] - joints, axis=2)


def degrees_between(a, b):
    return np.degrees(np.arccos(np.clip(a @ b, -1., 1.)))


@pytest.mark.parametrize('side, noise, bone, lean, axis', [
    ('right', 0., 2e-5, 2e-5, .2), ('right', .0005, .0003, .002, 4.),
    ('left', .0005, .0003, .002, 4.)])
def test_recovers_a_hand(side, noise, bone, lean, axis):
    hand, fitted = refitted(side, noise)
    assert fitted.side == side
    np.testing.assert_allclose(palm_distances(fitted), palm_distances(hand), atol=bone)
    np.testing.assert_allclose(fitted.finger_mcp, hand.finger_mcp, atol=lean)
    np.testing.assert_allclose(fitted.finger_bones, hand.finger_bones, atol=bone)
    np.testing.assert_allclose(fitted.thumb_bones, hand.thumb_bones, atol=bone)
    np.testing.assert_allclose(fitted.thumb_cmc, hand.thumb_cmc, atol=lean)
    np.testing.assert_allclose(fitted.splay, hand.splay, atol=np.radians(2.))
    np.testing.assert_allclose(fitted.phalanx_deviation, hand.phalanx_deviation,
                               atol=np.radians(1.))
    assert degrees_between(fitted.thumb_abduction_axis, hand.thumb_abduction_axis) < axis
    # Noise scatters single axes: 200 frames tell them no better.
    assert np.mean([degrees_between(found, true) for found, true in zip(
        fitted.finger_abduction_axes, hand.finger_abduction_axes)]) < axis
    if not noise:
        np.testing.assert_allclose(fitted.coupling[4], hand.coupling[4], atol=.02)
        assert np.degrees(fitted.thumb_mcp_abduction) == pytest.approx(-6., abs=.5)
    np.testing.assert_array_equal(fitted.limits, hand.limits)


@pytest.mark.parametrize('noise, close', [(0., .25), (.0005, .6)])
def test_recovers_phalanges_that_deviate_from_their_planes(noise, close):
    deviation = (-2., 0., 1., 5.)
    hand = person().replace(phalanx_deviation=np.radians(deviation))
    fingers = palm_coordinates(recorded(hand, noise=noise)[1])[:, FINGER_ROWS]
    fitted = fit_fingers(hand.replace(
        phalanx_deviation=np.zeros(4), finger_abduction_axes=((0., 0., 1.),) * 4), fingers)
    np.testing.assert_allclose(np.degrees(fitted.phalanx_deviation), deviation, atol=close)


@pytest.mark.parametrize('side, noise, close', [
    ('right', 0., 1e-4), ('right', .0005, .02), ('left', .0005, .02)])
def test_coupling_of_fingers_is_the_recorded_one_drawn_towards_the_usual_slope(
        side, noise, close):
    hand, fitted = refitted(side, noise)
    angles, _ = recorded(hand)
    pip, dip = angles[:, LEADERS[:4]], angles[:, LEADERS[:4] + 1]
    own = pip.var(axis=0) / (pip.var(axis=0) + USUAL_SLOPE_WORTH)
    slope, offset = fitted.coupling[:4].T
    np.testing.assert_allclose(
        slope, own * hand.coupling[:4, 0] + (1. - own) * preset_coupling()[:4, 0],
        atol=close + 1e-3)
    np.testing.assert_allclose(
        slope * pip.mean(axis=0) + offset, dip.mean(axis=0), atol=close)


def test_coupling_stays_where_a_digit_can_be():
    hand = person()
    angles, _ = recorded(hand)
    # A thumb whose MCP never moves tells nothing of the slope: it must not run off.
    angles[:, JOINTS.index('thumb_mcp_flexion')] = .2
    angles[:, JOINTS.index('thumb_ip_flexion')] = np.linspace(-.1, 1., FRAMES)
    angles[:, JOINTS.index('index_pip_flexion')] = .5
    angles[:, JOINTS.index('ring_dip_flexion')] = 1.2 - .6 * angles[
        :, JOINTS.index('ring_pip_flexion')]
    joints = landmark_positions(hand, forward(joint_table(hand), angles))
    fitted = fit_hand(joints, 'right', hand.limits)
    index_dip, ring_dip = (
        angles[:, JOINTS.index(f'{finger}_dip_flexion')].mean() for finger in ('index', 'ring'))
    np.testing.assert_allclose(fitted.coupling[0], (.4, index_dip - .4 * .5), atol=1e-4)
    np.testing.assert_allclose(fitted.coupling[2], (0., ring_dip), atol=1e-4)
    slope, offset = fitted.coupling[4]
    assert .3 <= slope <= 3.
    assert abs(offset) <= np.pi / 4


@pytest.mark.parametrize('noise, most', [(0., .0002), (.0005, .001)])
def test_fitted_thumb_beats_the_default_axes_on_frames_it_has_not_seen(noise, most):
    hand, fitted = refitted('right', noise)
    default = fitted.replace(
        thumb_abduction_axis=Hand.scaled().thumb_abduction_axis, coupling=Hand.scaled().coupling)
    fresh = recorded(hand, seed=5)[1]
    errors = []
    for tried in (fitted, default):
        tracker = HandTracker(tried, options=APART)
        states = [tracker.update(frame[EIGHT_ROWS]) for frame in fresh]
        found = np.array([landmark_positions(tried, state.pose, state.wrist_position)
                          for state in states])
        errors.append(np.linalg.norm(found - fresh, axis=2)[:, 2:4].mean())
    assert errors[0] < most
    assert errors[1] > 1.5 * errors[0]


def test_rest_direction_centres_the_range_of_motion():
    hand, fitted = refitted('right', 0.)
    joints = recorded(hand)[1]
    tracker = HandTracker(fitted, options=APART)
    seen = np.array([tracker.update(frame[EIGHT_ROWS]).angles for frame in joints])
    for name in ('thumb_cmc_abduction', 'thumb_cmc_flexion'):
        joint = JOINTS.index(name)
        middle = np.percentile(seen[:, joint], (1., 99.)).mean()
        assert middle == pytest.approx(hand.limits[joint].mean(), abs=np.radians(2.))


def test_limits_are_widened_to_the_recorded_range_of_motion():
    hand, fitted = refitted('right', 0.)
    angles, _ = recorded(hand)
    shown = np.degrees(fitted.range_of_motion)
    moved = [JOINTS.index(f'{finger}_{joint}') for finger in FINGERS
             for joint in ('mcp_flexion', 'pip_flexion', 'dip_flexion')]
    true = np.degrees(np.percentile(angles[:, moved], SHOWN_PERCENTILES, axis=0)).T
    np.testing.assert_allclose(shown[moved], true + (-3., 3.), atol=.2)
    # Splay and rest direction are in the middle of what was recorded, not where the hand's are.
    for joint in ('index_mcp_abduction', 'thumb_cmc_abduction', 'thumb_cmc_flexion'):
        row = JOINTS.index(joint)
        width = np.degrees(np.ptp(np.percentile(angles[:, row], SHOWN_PERCENTILES)))
        assert np.ptp(shown[row]) == pytest.approx(width + 6., abs=3.), joint
    assert not shown[JOINTS.index('thumb_mcp_abduction')].any()
    np.testing.assert_array_equal(fitted.limits, hand.limits)
    usual = fit_hand(recorded(hand, noise=.0005)[1], 'right')
    np.testing.assert_array_equal(usual.limits, preset_limits('wearer', usual.range_of_motion))


def test_angles_of_landmarks_are_those_of_the_hand():
    hand = person()
    angles, _ = recorded(hand)
    found = landmark_angles(hand, landmark_positions(hand, forward(joint_table(hand), angles)))
    seen = np.isfinite(found)
    assert seen[:, LEADERS].all() and .5 < seen.mean(axis=0).min() < .9
    fingers = np.array([not joint.startswith('thumb') and not joint.endswith('cmc_flexion')
                        for joint in JOINTS])
    np.testing.assert_allclose(found[seen & fingers], angles[seen & fingers], atol=1e-6)
    thumb = [JOINTS.index(f'thumb_{joint}') for joint in (
        'cmc_abduction', 'cmc_flexion', 'mcp_flexion', 'ip_flexion')]
    np.testing.assert_allclose(found[:, thumb], angles[:, thumb], atol=1e-9)


@pytest.mark.parametrize('roll, distance', [(0., 0.), (50., .012)])
def test_solved_thumb_is_the_trackers(roll, distance):
    hand = person(roll=roll, distance=distance)
    angles, joints = recorded(hand)
    saddle = Saddle(hand.thumb_cmc, hand.thumb_abduction_axis, hand.thumb_rest_direction,
                    hand.coupling[4], hand.thumb_mcp_abduction, hand.thumb_roll,
                    hand.thumb_axis_distance)
    local = landmark_positions(hand, forward(joint_table(hand), angles))
    solved = solve_thumb(hand, saddle, local[:, 4] - hand.thumb_cmc)
    tracker = HandTracker(hand, options=APART)
    for frame, cmc, mcp, ip in zip(joints, solved.cmc, solved.mcp, solved.ip):
        state = tracker.update(frame[EIGHT_ROWS])
        mine = state.wrist_rotation.T @ (landmark_positions(
            hand, state.pose, state.wrist_position) - state.wrist_position).T
        np.testing.assert_allclose(mine.T[1] - hand.thumb_cmc, cmc, atol=1e-4)
        np.testing.assert_allclose(mine.T[2] - hand.thumb_cmc, mcp, atol=1e-4)
        np.testing.assert_allclose(mine.T[3] - hand.thumb_cmc, ip, atol=1e-4)


def test_a_saddle_whose_axes_do_not_meet_is_found_with_the_roll_of_the_phalanges():
    hand = person('left', roll=50., distance=.012)
    fitted = fit_hand(recorded(hand)[1], 'left', hand.limits)
    assert np.degrees(fitted.thumb_roll) == pytest.approx(50., abs=2.)
    assert fitted.thumb_axis_distance == pytest.approx(.012, abs=5e-4)
    _, joints = recorded(hand, seed=1)
    tracker = HandTracker(fitted, options=APART)
    states = [tracker.update(frame[EIGHT_ROWS]) for frame in joints]
    found = np.array([landmark_positions(fitted, state.pose, state.wrist_position)
                      for state in states])
    assert np.linalg.norm(found - joints, axis=2)[:, 1:4].mean() < 5e-4


def test_angles_of_landmarks_are_those_of_a_rolled_thumb():
    hand = person(roll=50., distance=.012)
    angles, _ = recorded(hand)
    found = landmark_angles(hand, landmark_positions(hand, forward(joint_table(hand), angles)))
    thumb = [JOINTS.index(f'thumb_{joint}') for joint in (
        'cmc_abduction', 'cmc_flexion', 'mcp_flexion', 'ip_flexion')]
    np.testing.assert_allclose(found[:, thumb], angles[:, thumb], atol=1e-9)


def test_incomplete_frames_do_not_count():
    hand, kept = refitted('right', .0005)
    joints = recorded(hand, noise=.0005)[1]
    holed = np.insert(joints, (10, 100, 150), 1e3, axis=0)
    holed[10, 3] = np.nan
    holed[101, 20] = np.inf
    holed[152] = 0.
    found = fit_hand(holed, 'right', hand.limits)
    for name in ('finger_mcp', 'finger_bones', 'splay', 'thumb_abduction_axis', 'coupling'):
        np.testing.assert_array_equal(getattr(found, name), getattr(kept, name))


@pytest.mark.parametrize('joints, side, message', [
    (np.zeros((30, 20, 3)), 'right',
     r'joints: their shape is \(30, 20, 3\); expected \(T, 21, 3\)'),
    (np.full((30, 21, 3), np.nan), 'right', r'joints: 0 of 30 frames are complete, .*at least 10'),
    (np.zeros((30, 21, 3)), 'right', r'joints: 0 of 30 frames .* triangle'),
    (np.zeros((30, 21, 3)), 'both', r"side: 'both' is not one of right, left"),
])
def test_refuses_what_is_no_recording(joints, side, message):
    with pytest.raises(InvalidHand, match=message):
        fit_hand(joints, side)


def test_refuses_another_unit_and_the_other_side():
    joints = recorded(person())[1]
    with pytest.raises(InvalidHand, match='apart: millimetres, it seems; expected metres'):
        fit_hand(1e3 * joints, 'right')
    with pytest.raises(InvalidHand, match='expected 0.03 to 0.12 m, and the joints in the order'):
        fit_hand(.4 * joints, 'right')
    with pytest.raises(InvalidHand, match='back of a left hand; this is a right one'):
        fit_hand(joints, 'left')


def test_median_lengths():
    chains = np.array([[[0., 0., 0.], [x, 0., 0.], [x, 2., 0.]] for x in (1., 3., 9.)])
    np.testing.assert_allclose(median_lengths(chains), (3., 2.))


def test_landmarks_are_the_joints_of_the_pose():
    hand = Hand.scaled()
    points = landmark_positions(hand, forward(joint_table(hand), np.zeros(25)))
    np.testing.assert_allclose(points[LANDMARKS.index('thumb_cmc')], hand.thumb_cmc)
    np.testing.assert_allclose(points[LANDMARKS.index('middle_mcp')], hand.finger_mcp[1])
    middle = [LANDMARKS.index(f'middle_{joint}') for joint in ('mcp', 'pip', 'dip', 'tip')]
    np.testing.assert_allclose(np.diff(points[middle], axis=0)[:, 0], hand.finger_bones[1])
    thumb = points[1:5]
    np.testing.assert_allclose(
        np.linalg.norm(np.diff(thumb, axis=0), axis=1), hand.thumb_bones)
