"""The picture and the animation of a person and a robot: both hands are in it, to one scale."""

import numpy as np
import pytest
from PIL import Image

from hand_tracker.drawing import robot_picture
from hand_tracker.drawing.robot_picture import (
    RobotPose,
    save_robot_animation,
    save_robot_picture,
)


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


@pytest.fixture
def figures(monkeypatch):
    """Keep the figures that are drawn."""
    kept, make = [], robot_picture.Figure

    def keep(*args, **options):
        kept.append(make(*args, **options))
        return kept[-1]

    monkeypatch.setattr(robot_picture, 'Figure', keep)
    return kept


def test_the_picture_has_a_legend_units_and_one_scale(tmp_path, figures):
    finger = np.array(((.08, 0., 0.), (.12, .01, 0.), (.16, .01, -.02)))
    save_robot_picture(tmp_path / 'robot.png', 'hal', [RobotPose(
        'open', {'index': finger, 'little': finger - (0., .05, 0.)}, {'index': 1.5 * finger})])
    (figure,) = figures
    axes = figure.get_axes()
    labels = [ax.get_ylabel() for ax in axes]
    assert [label.split('\n')[0] for label in labels] == ['person', 'hal'] * 2
    assert all('[mm]' in label for label in labels)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [
        'index', 'little', 'palm, to the roots']
    for person, robot in (axes[:2], axes[2:]):
        assert person.get_xlim() == robot.get_xlim() and person.get_ylim() == robot.get_ylim()
    assert axes[0].get_ylim()[1] >= 240.
    with Image.open(tmp_path / 'robot.png') as image:
        assert image.size[0] > 200


def test_the_picture_shows_the_spheres_of_the_robot_in_their_size(tmp_path, figures):
    finger = np.array(((.08, 0., 0.), (.12, .01, 0.), (.16, .01, -.02)))
    save_robot_picture(tmp_path / 'robot.png', 'hal', [RobotPose(
        'open', {'index': finger}, {'index': finger}, [(np.array((.16, .01, -.02)), .015)])])
    (figure,) = figures
    back, side = figure.get_axes()[1::2]
    assert not any(ax.patches for ax in figure.get_axes()[::2])
    for ax, centre in ((back, (10., 160.)), (side, (160., -20.))):
        (sphere,) = ax.patches
        assert sphere.center == pytest.approx(centre) and sphere.radius == pytest.approx(15.)
        for (low, high), middle in zip((sorted(ax.get_xlim()), ax.get_ylim()), centre):
            assert low < middle - 15. and middle + 15. < high
    assert figure.legends[0].get_texts()[-1].get_text() == 'sphere with which a tip touches'
