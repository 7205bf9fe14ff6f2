"""Markers that come back: places and motions of points as those of hidden markers."""

import numpy as np
import pytest

from hand_tracker.core.point_labelling.clutter import STRETCH
from hand_tracker.core.point_labelling.returns import (
    MOTION_GAIN,
    STRAY_SPEED,
    motion_cost,
    place_cost,
)

ERROR = .0015   # [m]


def test_a_point_that_goes_with_the_hand_is_a_marker_one_that_goes_on_evenly_is_none():
    far = STRAY_SPEED * STRETCH
    # Of its first stretch only how far it went is known.
    with_hand = motion_cost(STRETCH, ERROR, far ** 2, 0., False)
    against = motion_cost(STRETCH, ERROR, far ** 2, far ** 2, False)
    assert with_hand < -1. < 1. < against
    # Of the next ones, how far from where its pace would have brought it.
    assert motion_cost(STRETCH, ERROR, 0., far ** 2, True) > against
    assert motion_cost(STRETCH, ERROR, far ** 2, 0., True) <= with_hand


def test_no_stretch_decides_alone():
    assert motion_cost(STRETCH, ERROR, 0., 1., True) == MOTION_GAIN
    assert motion_cost(STRETCH, ERROR, 1., 0., True) == -MOTION_GAIN


def test_a_hidden_marker_is_near_its_last_place_or_where_the_others_leave_it():
    near, wide = .004 ** 2, .015 ** 2
    at_last = place_cost(0., near, .05 ** 2, wide)
    at_others = place_cost(.05 ** 2, near, 0., wide)
    at_neither = place_cost(.05 ** 2, near, .06 ** 2, wide)
    assert at_last < at_others < at_neither - 8.
    alone = place_cost(.05 ** 2, near, np.nan, wide)
    assert alone == pytest.approx(3. * np.log(near) + 6. * np.log1p(.05 ** 2 / (3. * near)))
    assert at_others < alone
