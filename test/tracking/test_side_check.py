"""Whether labelled markers are of the other hand."""

from types import SimpleNamespace

import numpy as np
import pytest
from helpers.hands import from_pose_to_pose

from hand_tracker.core.model.hand import LEFT_HAND_MIRROR, Hand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.marker_layout import MarkerLayout, marker_positions
from hand_tracker.core.model.states import PREDICTED, SEEN
from hand_tracker.tracking.side_check import SideCheck

RATE = 100.
HAND = Hand.scaled()


def found_after(side, frames):
    """Return the time after which the side was found to be wrong, None where it was not."""
    check = SideCheck(side, MarkerLayout().principal)
    states = (SimpleNamespace(markers=np.nan_to_num(frame), marker_states=np.where(
        np.isnan(frame[:, 0]), PREDICTED, SEEN)) for frame in frames)
    return next((n / RATE for n, state in enumerate(states) if check.add(state, n / RATE)), None)


@pytest.mark.parametrize('seed', range(3))
def test_the_other_hand_is_found_within_two_seconds_and_the_own_never(seed):
    frames = from_pose_to_pose(seed)
    for side, mine in (('right', frames), ('left', frames * LEFT_HAND_MIRROR)):
        other = 'left' if side == 'right' else 'right'
        assert found_after(side, mine) is None
        assert found_after(other, mine) <= 2.
        assert found_after(side, mine * (1., 1., -1.)) <= 2.  # a mirrored axis


def test_a_flat_hand_or_a_palm_that_is_hidden_tells_nothing():
    flat = marker_positions(
        MarkerLayout().mounting(HAND), forward(joint_table(HAND), np.zeros(25)))
    assert found_after('left', [flat] * 500) is None
    hidden = from_pose_to_pose(0)
    hidden[:, 1] = np.nan
    assert found_after('left', hidden) is None
