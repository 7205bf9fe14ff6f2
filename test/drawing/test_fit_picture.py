"""Pictures of fitted hands."""

import numpy as np
from PIL import Image

from hand_tracker.core.model.hand import DIGITS, Hand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.drawing.fit_picture import FittedPose, save_fit_picture
from hand_tracker.drawing.palette import DIGIT_COLOURS, rgb


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


def test_the_thumb_is_where_it_is_on_a_hand_of_its_side(tmp_path):
    hand = Hand.scaled()
    angles = hand.relaxed()
    wrist = np.zeros((1, 3))
    path = tmp_path / 'hand.png'
    for drawn in (hand, hand.mirrored()):
        save_fit_picture(path, drawn, [FittedPose('open', angles, wrist, wrist)])
        image = np.asarray(Image.open(path).convert('RGB'), dtype=int)
        from_the_back = image[:len(image) // 2]
        thumb, little = (np.flatnonzero((np.abs(
            from_the_back - 255. * np.array(rgb(DIGIT_COLOURS[digit]))).max(axis=2) < 2.).any(
                axis=0)).mean() for digit in (DIGITS.index('thumb'), DIGITS.index('little')))
        assert (thumb < little) == (drawn.side == 'right')
