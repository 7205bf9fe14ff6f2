"""Calibration makes digits so thin that they pass through the recorded postures."""

import numpy as np

from hand_tracker.calibration import landmark_positions
from hand_tracker.calibration.radii import MIN_RADIUS_SHARE, fit_radii
from hand_tracker.core.model.capsules import hand_capsules, pair_gaps
from hand_tracker.core.model.hand import JOINTS, Hand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.pose.contact import PENETRATION

HAND = Hand.scaled()


def recorded(abduction):
    """Return angles and joints of a hand whose index and middle finger are pressed together."""
    angles = np.zeros((50, 25))
    angles[:, JOINTS.index('index_mcp_abduction')] = -np.radians(abduction)
    angles[:, JOINTS.index('middle_mcp_abduction')] = np.radians(abduction)
    angles[:, [JOINTS.index(f'{finger}_pip_flexion') for finger in ('index', 'middle')]] = .4
    angles[:, [JOINTS.index(f'{finger}_dip_flexion') for finger in ('index', 'middle')]] = .32
    return angles, landmark_positions(HAND, forward(joint_table(HAND), angles))


def test_free_postures_leave_the_radii():
    _, joints = recorded(0.)
    fitted = fit_radii(HAND, joints)
    np.testing.assert_array_equal(fitted.radii, HAND.radii)
    assert fitted.palm_radius == HAND.palm_radius


def test_recorded_postures_are_free_of_overlap():
    angles, joints = recorded(4.)
    assert pair_gaps(hand_capsules(HAND), angles[0]).min() < -.003
    for side in ('right', 'left'):
        fitted = fit_radii(HAND.replace(side=side), joints)
        assert fitted.side == side
        assert pair_gaps(hand_capsules(fitted), angles[0]).min() >= -PENETRATION - 1e-6
        np.testing.assert_array_equal(fitted.radii[2:], HAND.radii[2:])


def test_digits_keep_some_thickness():
    _, joints = recorded(12.)
    fitted = fit_radii(HAND, joints)
    assert (fitted.radii >= MIN_RADIUS_SHARE * HAND.radii - 1e-12).all()
    assert (fitted.radii < HAND.radii).any()
