"""The animation of a person and a robot: it moves, and both hands are in it."""

import numpy as np
from PIL import Image

from hand_tracker.drawing.robot_picture import RobotPose, save_robot_animation


def test_the_animation_shows_both_hands_move(tmp_path):
    finger = np.array(((.08, 0., 0.), (.12, 0., 0.), (.16, 0., 0.)))
    bent = finger - ((0., 0., 0.), (0., 0., .02), (.02, 0., .06))
    poses = [RobotPose(f'{i} s', {'index': person}, {'index': robot}) for i, (person, robot) in
             enumerate(((finger, finger), (bent, finger), (bent, bent)))]
    save_robot_animation(tmp_path / 'robot.gif', 'hal', poses, 10.)
    with Image.open(tmp_path / 'robot.gif') as image:
        assert image.n_frames == 3 and image.info['duration'] == 100
        frames = []
        for i in range(3):
            image.seek(i)
            frames.append(np.asarray(image.convert('RGB')).astype(int))
    # Below the titles, above the clock's line: first the person moves, then the robot.
    half, top = frames[0].shape[1] // 2, 60
    for before, after, still in ((0, 1, slice(half, None)), (1, 2, slice(None, half))):
        moved = np.abs(frames[after] - frames[before]).max(axis=2)[top:] > 60
        assert moved.sum() > 100 and not moved[:, still].any()
