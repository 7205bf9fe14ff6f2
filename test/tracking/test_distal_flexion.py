"""Measured flexion of last joints: by name, while fresh, without ROS."""

import math

import numpy as np

from hand_tracker.core.model.hand import DIGITS
from hand_tracker.tracking.distal_flexion import DISTAL_JOINTS, DistalFlexion

TIMEOUT = .5


def test_the_last_joint_of_every_digit():
    assert DISTAL_JOINTS == (
        *(f'{digit}_dip_flexion' for digit in DIGITS[:4]), 'thumb_ip_flexion')


def test_nothing_is_measured_before_anything_came():
    assert DistalFlexion('right_').fresh(1., TIMEOUT) is None


def test_names_with_and_without_prefix_and_the_last_value_of_each_counts():
    flexion = DistalFlexion('right_')
    assert flexion.received(1., ('right_ring_dip_flexion', 'thumb_ip_flexion'), (.1, .2)) == []
    assert flexion.received(1.1, ('ring_dip_flexion',), (.3,)) == []
    assert np.array_equal(flexion.fresh(1.2, TIMEOUT), (np.nan, np.nan, .3, np.nan, .2),
                          equal_nan=True)


def test_other_joints_are_returned_and_numbers_that_are_none_left_out():
    flexion = DistalFlexion('right_')
    names = ('index_pip_flexion', 'left_index_dip_flexion', 'index_dip_flexion',
             'middle_dip_flexion', 'ring_dip_flexion')
    assert flexion.received(1., names, (.1, .2, math.nan, math.inf)) == list(names[:2])
    assert flexion.fresh(1., TIMEOUT) is None
    flexion.received(1., ('index_dip_flexion',), (.4,))
    flexion.received(1.1, ('index_dip_flexion',), (math.nan,))
    assert flexion.fresh(1.2, TIMEOUT)[0] == .4


def test_a_value_counts_while_it_is_fresh_and_not_when_the_clock_jumped_back():
    flexion = DistalFlexion('')
    flexion.received(10., ('index_dip_flexion',), (.4,))
    flexion.received(10.4, ('thumb_ip_flexion',), (.6,))
    assert flexion.fresh(10.5, TIMEOUT)[0] == .4
    assert np.array_equal(flexion.fresh(10.6, TIMEOUT), (*4 * (np.nan,), .6), equal_nan=True)
    assert flexion.fresh(11., TIMEOUT) is None
    assert flexion.fresh(2., TIMEOUT) is None
