"""Derivatives of a digit's markers, and agreement with the hand's forward kinematics."""

import numpy as np
import pytest

from hand_tracker.calibration.digit_chain import (
    ANGLES,
    ASIDE,
    BONE_PART,
    FIRST_OFFSET,
    LEAN_PART,
    ROOT_PART,
    Chain,
    leaning,
    place_markers,
    place_with_derivatives,
)
from hand_tracker.core.model.hand import (
    ABDUCTION_JOINTS,
    DIGITS,
    FLEXION_JOINTS,
    JOINTS,
    LINKS,
    Hand,
)
from hand_tracker.core.model.kinematics import ABDUCTION_SIGN, digit_base, forward, joint_table

STEP = 1e-6
FINGER = Chain(digit_base(Hand.scaled(), 1)[0], np.array((0, 1, 2, 1)))


@pytest.fixture(params=(ANGLES, ANGLES + 1), ids=('planar', 'second joint abducts'))
def case(request):
    random = np.random.default_rng(3)
    shape = .03 + .02 * random.standard_normal(FINGER.size)
    return shape, random.standard_normal((6, request.param))


def test_derivatives_by_angles(case):
    shape, angles = case
    by_angle = place_with_derivatives(FINGER, shape, angles).by_angle
    for angle, step in enumerate(STEP * np.eye(angles.shape[1])):
        expected = (place_markers(FINGER, shape, angles + step)
                    - place_markers(FINGER, shape, angles - step)) / (2. * STEP)
        np.testing.assert_allclose(by_angle[..., angle], expected, atol=1e-9)


@pytest.mark.parametrize('parameter', range(FINGER.size))
def test_derivatives_by_shape(case, parameter):
    shape, angles = case
    step = STEP * np.eye(FINGER.size)[parameter]
    expected = (place_markers(FINGER, shape + step, angles)
                - place_markers(FINGER, shape - step, angles)) / (2. * STEP)
    np.testing.assert_allclose(
        place_with_derivatives(FINGER, shape, angles).by_shape[..., parameter], expected,
        atol=1e-9)


def test_derivatives_come_with_the_places(case):
    np.testing.assert_allclose(
        place_with_derivatives(FINGER, *case).points, place_markers(FINGER, *case), atol=1e-15)
    assert place_with_derivatives(FINGER, *case, by_shape_too=False).by_shape.shape[-1] == 0


@pytest.mark.parametrize('digit', range(5))
def test_equals_the_forward_kinematics_of_the_hand(digit):
    lean = np.array((.2, -.1))
    hand = Hand.scaled()
    base = digit_base(hand, digit)[0]
    chain = Chain(base, np.array((0, 1, 2)))
    axis = leaning(chain, lean).base[:, 2]
    name = DIGITS[digit]
    if name == 'thumb':
        # Its rest is the base's x axis, as the chain counts flexions from there.
        hand = hand.replace(thumb_abduction_axis=axis, thumb_rest_direction=base[:, 0])
        bones, root = hand.thumb_bones, hand.thumb_cmc
        ends = ('proximal', 'distal')
    else:
        axes = hand.finger_abduction_axes.copy()
        axes[digit] = axis
        hand = hand.replace(finger_abduction_axes=axes)
        bones, root = hand.finger_bones[digit], hand.finger_mcp[digit]
        ends = ('middle', 'distal')
    shape = np.zeros(chain.size)
    shape[ROOT_PART], shape[LEAN_PART], shape[BONE_PART] = root, lean, bones
    posture = np.array((.2, .5, .7, .3))
    angles = np.zeros(len(JOINTS))
    angles[ABDUCTION_JOINTS[digit]] = ABDUCTION_SIGN[digit] * posture[0]
    angles[FLEXION_JOINTS[digit]] = posture[1:]
    if name == 'thumb':
        posture = np.append(posture, .25)
        angles[JOINTS.index('thumb_mcp_abduction')] = posture[ASIDE]
    pose = forward(joint_table(hand), angles)
    found = place_markers(chain, shape, posture[None])[0]
    np.testing.assert_allclose(
        found[:2], pose.position[[LINKS.index(f'{name}_{end}') for end in ends]], atol=1e-12)


def test_a_share_turns_the_offset_with_the_next_joint():
    chain = Chain(np.eye(3), np.array((0,)))
    shape = np.zeros(chain.size)
    shape[BONE_PART] = .05, .03, .02
    shape[FIRST_OFFSET + 2] = .01
    bent = np.array(((0., 0., np.pi / 2., 0.),))
    np.testing.assert_allclose(place_markers(chain, shape, bent)[0, 0], (.05, 0., .01))
    shape[FIRST_OFFSET + 3] = 1.
    np.testing.assert_allclose(place_markers(chain, shape, bent)[0, 0], (.06, 0., 0.), atol=1e-15)
