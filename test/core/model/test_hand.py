"""The hand: joints, limits of Table 1, anthropometry and the messages of its validation."""

import re
from dataclasses import fields

import numpy as np
import pytest

from hand_tracker.core.errors import HandTrackerError, InvalidHand
from hand_tracker.core.model.hand import (
    DIGITS,
    FINGERS,
    FLEXION_JOINTS,
    JOINTS,
    LINKS,
    RELAXED_FINGERS,
    RELAXED_THUMB,
    Hand,
    average_natural_flexion,
    has_size_of,
    joint_kind,
    preset_coupling,
    preset_limits,
)
from hand_tracker.core.model.kinematics import forward, joint_table

# Table 1 of the paper: extension θ1, flexion θ3, abduction θ2, adduction θ4 [degrees].
TABLE_1 = {
    'thumb_cmc': (20, 20, 30, 40),
    'finger_mcp': (10, 85, 15, 15),
    'thumb_mcp': (5, 30, 10, 10),
    'finger_pip': (10, 95, None, None),
    'thumb_ip': (10, 95, None, None),
    'finger_dip': (10, 90, None, None),
}
NOT_ARRAYS = (
    'side', 'palm_radius', 'thumb_mcp_abduction', 'thumb_roll', 'thumb_axis_distance')

# Pads meet: abduction, MCP, PIP, DIP of the finger; the thumb's five [degrees].
OPPOSITION = {
    'index': ((-15, 85, .6, .5), (30, 10.7, -6.7, -5, -5), .001),
    'middle': ((-15, 84, 11, 8.8), (30, 18.1, 10, -5, -5), .002),
    'ring': ((15, 63.7, 33.1, 26.5), (30, 20, 10, 8.7, 8.7), .005),
    'little': ((-15, 54.2, 36.5, 29.2), (30, 20, 10, 21.7, 21.7), .009),
}


@pytest.fixture
def hand():
    return Hand.scaled()


def pad(hand, pose, digit):
    """Return the middle of the finger pad, on the palmar side of the distal bone."""
    length = hand.thumb_bones[2] if digit == 4 else hand.finger_bones[digit, 2]
    link = 5 * digit + 4
    return pose.position[link] + pose.rotation[link] @ (
        .65 * length, 0., -hand.radii[digit, 2])


def test_there_are_25_joints_and_links():
    assert len(JOINTS) == len(set(JOINTS)) == len(LINKS) == len(set(LINKS)) == 25
    for i, digit in enumerate(DIGITS):
        of_digit = JOINTS[5 * i:5 * i + 5]
        assert all(joint.startswith(f'{digit}_') for joint in of_digit)
        assert sum('abduction' in joint for joint in of_digit) == (2 if digit == 'thumb' else 1)


def test_paper_limits_are_table_1(hand):
    checked = 0
    for joint, limits in zip(JOINTS, np.degrees(hand.limits)):
        digit, place, motion = joint.split('_')
        if digit in FINGERS and place == 'cmc':
            assert tuple(limits) == (0., 0.), 'the paper’s palm is flat'
        else:
            row = TABLE_1[f"{'thumb' if digit == 'thumb' else 'finger'}_{place}"]
            extension, flexion, abduction, adduction = row
            expected = (-extension, flexion) if motion == 'flexion' else (-adduction, abduction)
            assert limits == pytest.approx(expected, abs=1e-12), joint
            checked += 1
    assert checked == 21


def test_wide_contains_paper_in_every_joint():
    paper, wide = preset_limits('paper'), preset_limits('wide')
    assert (wide[:, 0] <= paper[:, 0]).all()
    assert (wide[:, 1] >= paper[:, 1]).all()
    assert np.degrees(wide[JOINTS.index('ring_pip_flexion'), 1]) >= 111.


def test_wearer_is_table_1_widened_to_the_range_of_motion_and_never_narrowed():
    shown = np.zeros((25, 2))
    index, ring = JOINTS.index('index_mcp_flexion'), JOINTS.index('ring_pip_flexion')
    shown[index], shown[ring] = (-.5, .3), (.2, 2.)
    expected = preset_limits('paper')
    expected[index, 0], expected[ring, 1] = -.5, 2.
    assert np.array_equal(preset_limits('wearer', shown), expected)
    assert np.array_equal(preset_limits('wearer'), preset_limits('paper'))
    assert np.array_equal(preset_limits('wide', shown), preset_limits('wide'))


def test_unknown_preset_names_those_there_are():
    with pytest.raises(InvalidHand, match="no preset 'strict'; there are paper, wide, wearer"):
        preset_limits('strict')
    with pytest.raises(InvalidHand, match="no preset 'strict'; there are natural, paper"):
        preset_coupling('strict')


def test_couplings_of_the_presets(hand):
    assert preset_coupling('paper') == pytest.approx(np.array(((.8, 0.),) * 4 + ((1., 0.),)))
    assert np.array_equal(hand.coupling, preset_coupling('natural'))
    assert (hand.coupling[:4] == (.4, 0.)).all()
    assert np.array_equal(hand.coupling[4], preset_coupling('paper')[4])


def test_an_average_person_s_flexion_leads_from_the_straight_to_the_relaxed_hand(hand):
    angles = hand.relaxed()[FLEXION_JOINTS[:4]]
    slope, offset, spread = average_natural_flexion().T
    np.testing.assert_allclose(slope[:4] * angles[:, 0], angles[:, 1])
    assert not offset.any() and (spread == np.radians(20.)).all()
    np.testing.assert_array_equal(hand.natural_flexion, average_natural_flexion())


def test_joint_kind():
    assert joint_kind('ring_pip_flexion') == 'pip_flexion'
    assert joint_kind('thumb_cmc_flexion') == 'thumb_cmc_flexion'


def test_scaled_hand_has_the_published_proportions():
    hand = Hand.scaled(.2, .1)
    assert hand.finger_bones[0] == pytest.approx((.049, .0286, .0194))
    assert hand.thumb_bones == pytest.approx((.0502, .0392, .0316))
    assert hand.finger_mcp[3, :2] == pytest.approx((.0736, -.0402))
    middle = hand.finger_mcp[1, 0] + hand.finger_bones[1].sum()
    assert middle == pytest.approx(.2, rel=.02), 'crease to tip of the middle finger'
    twice = Hand.scaled(.1, .05)
    for name in ('finger_cmc', 'finger_mcp', 'finger_bones', 'thumb_cmc', 'radii', 'palm_radius'):
        assert getattr(hand, name) == pytest.approx(2. * np.array(getattr(twice, name))), name


def test_scaled_takes_any_field():
    hand = Hand.scaled(side='left', splay=(.1, 0., -.1, -.2))
    assert hand.side == 'left'
    assert hand.splay == pytest.approx((.1, 0., -.1, -.2))


def test_mirrored_changes_the_side_alone(hand):
    left = hand.mirrored()
    assert (hand.side, left.side, left.mirrored().side) == ('right', 'left', 'right')
    for field in fields(Hand):
        if field.name != 'side':
            assert np.array_equal(
                getattr(left, field.name), getattr(hand, field.name)), field.name


def test_arrays_are_frozen_and_the_callers_are_not_kept(hand):
    for field in fields(Hand):
        if field.name not in NOT_ARRAYS:
            with pytest.raises(ValueError, match='read-only'):
                getattr(hand, field.name)[...] = 0.
    with pytest.raises(AttributeError):
        hand.side = 'left'
    limits = preset_limits()
    kept = hand.replace(limits=limits)
    limits[:] = 0.
    assert np.array_equal(kept.limits, preset_limits())
    assert limits.flags.writeable


def test_directions_of_the_thumb_become_unit_vectors(hand):
    hand = hand.replace(thumb_abduction_axis=(0., 5., 0.), thumb_rest_direction=(3., 0., -4.))
    assert hand.thumb_abduction_axis == pytest.approx((0., 1., 0.))
    assert hand.thumb_rest_direction == pytest.approx((.6, 0., -.8))


def test_paper_thumb_has_its_plane_through_the_index_mcp():
    hand = Hand.scaled().with_paper_thumb()
    table = joint_table(hand)
    rng = np.random.default_rng(5)
    for _ in range(20):
        angles = rng.uniform(*hand.limits.T)
        angles[JOINTS.index('thumb_mcp_abduction')] = 0.
        pose = forward(table, angles)
        tip = pose.position[24] + pose.rotation[24] @ (hand.thumb_bones[2], 0., 0.)
        to_tip, to_index = tip - hand.thumb_cmc, hand.finger_mcp[0] - hand.thumb_cmc
        normal = np.cross(to_tip, to_index)
        inside = pose.position[22:25] - hand.thumb_cmc
        assert np.abs(inside @ normal / np.linalg.norm(normal)).max() < 1e-12


@pytest.mark.parametrize('finger', FINGERS)
def test_thumb_opposes_every_finger_within_table_1(hand, finger):
    of_finger, of_thumb, reach = OPPOSITION[finger]
    digit = FINGERS.index(finger)
    angles = np.zeros(25)
    angles[5 * digit + 1:5 * digit + 5] = np.radians(of_finger)
    angles[20:] = np.radians(of_thumb)
    assert (angles >= hand.limits[:, 0] - 1e-9).all()
    assert (angles <= hand.limits[:, 1] + 1e-9).all()
    pose = forward(joint_table(hand), angles)
    assert np.linalg.norm(pad(hand, pose, digit) - pad(hand, pose, 4)) < reach


def changed(name, index, value):
    array = np.array(getattr(Hand.scaled(), name))
    array[index] = value
    return {name: array}


@pytest.mark.parametrize('change, message', [
    (changed('finger_bones', (2, 1), .5), 'finger_bones[2, 1]: 0.5; allowed is 0.005 to 0.2 m'),
    (changed('thumb_bones', 0, -.04), 'thumb_bones[0]: -0.04; allowed is 0.005 to 0.2 m'),
    (changed('finger_cmc', (0, 0), 1.), 'finger_cmc[0, 0]: 1; allowed is -0.3 to 0.3 m'),
    (changed('finger_mcp', (3, 2), .4), 'finger_mcp[3, 2]: 0.4; allowed is -0.3 to 0.3 m'),
    (changed('thumb_cmc', 1, -.4), 'thumb_cmc[1]: -0.4; allowed is -0.3 to 0.3 m'),
    (changed('radii', (4, 0), 0.), 'radii[4, 0]: 0; allowed is 0.001 to 0.05 m'),
    ({'palm_radius': .06}, 'palm_radius: 0.06; allowed is 0.001 to 0.05 m'),
    (changed('splay', 0, 1.), 'splay[0]: 1; allowed is -0.785398 to 0.785398 rad'),
    (changed('phalanx_deviation', 1, .4),
     'phalanx_deviation[1]: 0.4; allowed is -0.349066 to 0.349066 rad'),
    (changed('limits', (3, 1), 4.), 'limits[3, 1]: 4; allowed is -3.14159 to 3.14159 rad'),
    (changed('limits', (3, 0), 2.), 'limits of index_pip_flexion: 114.592 to 95 degrees; '
     'the lower limit must not exceed the upper'),
    (changed('coupling', (0, 0), 6.), 'coupling slope[0]: 6; allowed is 0 to 5'),
    (changed('coupling', (4, 1), 2.), 'coupling offset[4]: 2; allowed is -1.5708 to 1.5708 rad'),
    (changed('natural_flexion', (0, 0), 6.), 'natural_flexion slope[0]: 6; allowed is -2 to 5'),
    (changed('natural_flexion', (1, 1), 2.),
     'natural_flexion offset[1]: 2; allowed is -1.5708 to 1.5708 rad'),
    (changed('natural_flexion', (4, 2), 0.),
     'natural_flexion spread[4]: 0; allowed is 0.0349066 to 1.5708 rad'),
    (changed('palm_synergy', 3, .7), 'palm_synergy[3]: 0.7; allowed is 0 to 0.6'),
    ({'side': 'both'}, "side: 'both' is not one of right, left"),
    ({'thumb_bones': 'long'}, "thumb_bones: 'long' is not made of numbers"),
    ({'thumb_bones': (.04, .03)}, 'thumb_bones: its shape is (2,); expected (3,)'),
    ({'thumb_bones': (.04, .03, np.nan)}, 'has numbers that are not finite'),
    ({'palm_radius': np.inf}, 'palm_radius: inf has numbers that are not finite'),
    ({'thumb_abduction_axis': (0., 0., 0.)}, 'thumb_abduction_axis: [0. 0. 0.] has no direction'),
    ({'thumb_rest_direction': (-.6, .79, .1)}, 'within 18 degrees of thumb_abduction_axis'),
    (changed('finger_abduction_axes', 2, (1., 0., .5)),
     'finger_abduction_axes of ring: [0.89442719 0.         0.4472136 ] is more than 60 degrees'),
    ({'finger_mcp': Hand.scaled().finger_mcp * (1., -1., 1.)},
     'finger_mcp: the index MCP must lie on the thumb side'),
])
def test_refusals_name_field_value_and_what_is_allowed(hand, change, message):
    with pytest.raises(InvalidHand, match=re.escape(message)) as refused:
        hand.replace(**change)
    assert isinstance(refused.value, (HandTrackerError, ValueError))


@pytest.mark.parametrize('size, message', [
    ({'length': 185.}, 'length: 185; allowed is 0.1 to 0.26 m'),
    ({'breadth': .01}, 'breadth: 0.01; allowed is 0.04 to 0.14 m'),
    ({'length': np.nan}, 'length: nan; allowed is'),
])
def test_scaled_refuses_sizes_no_hand_has(size, message):
    with pytest.raises(InvalidHand, match=re.escape(message)):
        Hand.scaled(**size)


@pytest.mark.parametrize('preset', ['paper', 'wide'])
def test_a_relaxed_hand_is_bent_more_from_index_to_little_within_its_limits(preset):
    hand = Hand.scaled(limits=preset_limits(preset))
    angles = hand.relaxed().reshape(5, 5)
    # The preset forbids none of it.
    lower, upper = hand.limits.T
    assert (lower <= hand.relaxed()).all() and (hand.relaxed() <= upper).all()
    np.testing.assert_allclose(np.degrees(angles[4, :4]), RELAXED_THUMB)
    np.testing.assert_allclose(np.degrees(angles[:4, 2:4]), RELAXED_FINGERS)
    assert (np.diff(angles[:4, 2:4].sum(axis=1)) > 0.).all()
    assert (angles[:4, 3] > angles[:4, 2]).all()
    np.testing.assert_allclose(angles[:, 4], hand.coupling[:, 0] * angles[:, 3])


def test_a_relaxed_hand_keeps_limits_of_ones_own():
    limits = np.zeros((25, 2))
    np.testing.assert_array_equal(Hand.scaled(limits=limits).relaxed(), 0.)


@pytest.mark.parametrize('change, is_same', [
    ({}, True), ({'limits': preset_limits('wide')}, True), ({'thumb_axis_distance': .02}, False),
    ({'thumb_roll': .1}, False), (changed('thumb_bones', 0, .05), False)])
def test_hands_of_one_size_have_the_same_joints_and_bones(hand, change, is_same):
    assert has_size_of(hand, hand.replace(**change)) == is_same
