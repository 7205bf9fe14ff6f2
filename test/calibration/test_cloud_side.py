"""The side of points without names: found by shape, of one hand or two, and not where none is."""

import json

import numpy as np
import pytest

from hand_tracker.calibration.cloud_side import side_likelihoods
from hand_tracker.cli import convert, inspect
from hand_tracker.core.model.hand import LEFT_HAND_MIRROR, SIDES
from hand_tracker.files.point_recording import Axes, PointRecording
from hand_tracker.files.recordings import write_recording
from hand_tracker.package_data import packaged_recording
from hand_tracker.simulation.packaged_recordings import demo_recording
from hand_tracker.tracking.point_bag import MarkerChoice, PointBag

MOVING = demo_recording().markers[::90]
AWAY = np.array((0., .35, .05))  # [m]


def clouds(sides):
    """Return points of the moving hands of some sides, apart, and four others, shuffled."""
    hands = [MOVING * (LEFT_HAND_MIRROR if side == 'left' else 1.)
             + (AWAY if side == 'left' else 0.) for side in sides]
    others = np.random.default_rng(1).uniform(-.4, .4, (4, 3)) + MOVING[0].mean(axis=0)
    points = np.concatenate([*hands, np.tile(others, (len(MOVING), 1, 1))], axis=1)
    return np.array([np.random.default_rng(i).permutation(frame)
                     for i, frame in enumerate(points)])


@pytest.mark.parametrize('sides', [('right',), ('left',), SIDES])
def test_the_side_is_found_by_shape(sides):
    likelihoods = side_likelihoods(clouds(sides))
    assert likelihoods['both' if len(sides) > 1 else sides[0]] > .9


def test_points_of_no_hand_have_no_side():
    points = np.random.default_rng(2).uniform(-1., 1., (9, 12, 3))
    assert sum(side_likelihoods(points).values()) == 0.
    assert sum(side_likelihoods(points[:0]).values()) == 0.


def write_cloud(path, sides):
    """Write the points of the hands of some sides without labels."""
    points = clouds(sides).astype(np.float32)
    write_recording(path, PointRecording(
        'cloud', 'c3d', ('',) * points.shape[1], points, 120., None, Axes('m', 'z')))


@pytest.mark.parametrize('sides, found, note', [
    (('left',), 'left', 'a left hand, by the shape of the points (--side)'),
    (SIDES, '', 'a right and a left hand, by the shape of the points')])
def test_a_file_without_labels_is_of_the_side_that_its_points_show(sides, found, note, tmp_path):
    write_cloud(tmp_path / 'cloud.c3d', sides)
    bag = PointBag(tmp_path / 'cloud.c3d', MarkerChoice(has_labels=None, finds_side=True))
    assert [one.side for one in bag.hands] == [found]
    assert any(one.startswith(note) for one in bag.notes)
    asked = PointBag(tmp_path / 'cloud.c3d',
                     MarkerChoice(has_labels=None, side='right', finds_side=True))
    assert [one.side for one in asked.hands] == ['right']


@pytest.mark.parametrize('sides', [('right',), ('left',), SIDES])
def test_inspect_proposes_the_command_for_the_side(sides, tmp_path, capsys):
    write_cloud(tmp_path / 'cloud.c3d', sides)
    assert inspect.main([str(tmp_path / 'cloud.c3d'), '--json']) == 0
    found = json.loads(capsys.readouterr().out)
    assert {(one['name'], one['side']) for one in found['layouts']} == {
        ('paper8', side) for side in sides}
    asked = 'both' if len(sides) > 1 else sides[0]
    assert found['next'].endswith(f'--side {asked} --labels none')


def test_convert_takes_the_labels_off(tmp_path):
    source, output = packaged_recording('left'), tmp_path / 'cloud.c3d'
    assert convert.main([str(source), str(output), '--labels', 'none']) == 0
    bag = PointBag(output, MarkerChoice(has_labels=None, finds_side=True))
    assert not bag.has_labels and [one.side for one in bag.hands] == ['left']
