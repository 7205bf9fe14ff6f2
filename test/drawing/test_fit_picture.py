"""Pictures of fitted hands."""

import numpy as np
from PIL import Image

from hand_tracker.core.model.hand import Hand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.drawing.fit_picture import FittedPose, save_fit_picture


def test_each_pose_is_drawn_with_its_markers(tmp_path):
    hand = Hand.scaled()
    angles = hand.relaxed()
    places = forward(joint_table(hand), angles).position[[2, 3, 7]]
    measured = places + (.002, 0., 0.)
    measured[1] = np.nan
    poses = [FittedPose(title, angles, measured, places) for title in ('open', 'closed')]
    save_fit_picture(tmp_path / 'fit.png', hand.mirrored(), poses)
    width, height = Image.open(tmp_path / 'fit.png').size
    assert width > 600 and height > 600
    save_fit_picture(tmp_path / 'one.png', hand, poses[:1])
    assert Image.open(tmp_path / 'one.png').size[0] < width
