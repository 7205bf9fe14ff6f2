"""Numbers of poses, whichever message holds them."""

from types import SimpleNamespace

import pytest

from hand_tracker.messages.pose_fields import pose_numbers


@pytest.mark.parametrize('names', [('position', 'orientation'), ('translation', 'rotation')])
def test_a_pose_and_a_transform_have_the_same_numbers(names):
    message = SimpleNamespace(**dict(zip(names, (
        SimpleNamespace(x=1., y=2., z=3.), SimpleNamespace(w=.7, x=.1, y=.2, z=.3)))))
    assert pose_numbers(message) == ((1., 2., 3.), (.1, .2, .3, .7))
