"""Evaluation of the labelling of points without names, on simulated hands."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.hands import markers_of

from hand_tracker.calibration.layout_names import names_in_layout
from hand_tracker.calibration.marker_names import canonical_name
from hand_tracker.calibration.takes import MarkerTake
from hand_tracker.core.model.hand import Hand
from hand_tracker.core.model.layout_presets import preset_layout
from hand_tracker.core.model.marker_layout import MARKERS
from hand_tracker.core.point_labelling.natural_poses import natural_poses
from hand_tracker.evaluation.point_labelling import (
    LabellingTrial,
    NamedMarkers,
    _of_take,
    judge,
    prototype_of_others,
    trials,
)


def recording(name, length, side='right'):
    """Return a recording of a hand of a length [m] that goes from pose to pose."""
    hand = Hand.scaled(length, side=side)
    keys = .4 * natural_poses(hand, 10)
    places = np.linspace(0., len(keys) - 1., 200)
    angles = np.array([np.interp(places, np.arange(len(keys)), column) for column in keys.T]).T
    points = markers_of(hand, angles)
    return NamedMarkers(name, MARKERS, (-1, -1, -1, 0, 1, 2, 3, 4), points, side, 120.,
                        np.zeros(len(points), dtype=int))


def test_statistics_of_others_are_of_all_recordings_but_that_of_the_other_hand():
    recordings = [recording('small', .16), recording('both_right', .18),
                  recording('both_left', .18, 'left'), recording('large', .2)]
    found = {trial.name: trial.prototypes[0] for trial in trials(recordings)
             if trial.learned == 'others'}
    gaps = [np.linalg.norm(np.diff(one.points[:, 1:3], axis=1), axis=2).mean()
            for one in recordings]
    teachers = dict(zip(('small', 'both_right', 'both_left', 'large'),
                        ((1, 2, 3), (0, 3), (0, 3), (0, 1, 2))))
    for one in recordings:
        assert found[one.name].side == one.side
        learned = np.linalg.norm(np.diff(found[one.name].statistics.template[1:3], axis=0))
        assert learned == pytest.approx(
            np.mean([gaps[i] for i in teachers[one.name]]), rel=1e-2)


def test_recordings_of_both_sides_teach_either():
    right, left = recording('one', .18), recording('other', .18, 'left')
    shapes = []
    for others in ([right], [left], [right, left]):
        learned = prototype_of_others(others, 'right').statistics.template
        wrist, index, little = learned[:3]
        # A mirrored hand has its thumb on the other side of the palm.
        thumb = np.dot(np.cross(index - wrist, little - wrist), learned[7] - wrist)
        size = np.linalg.norm(index - little)
        shapes.append((thumb / size ** 3, np.linalg.norm(learned[7] - wrist) / size))
    np.testing.assert_allclose(shapes[1:], shapes[:2], rtol=.01)


@pytest.mark.parametrize('preset, markers, mcp', [
    ('dfki13', 13, 'index_pip'),        # their own names say of eight where they are
    ('sig18_19', 19, 'index_mcp')])
def test_takes_are_fitted_by_the_layout_in_which_their_markers_are_worn(preset, markers, mcp):
    layout, hand = preset_layout(f'{preset}_skin'), Hand.scaled()
    points = markers_of(hand, .4 * natural_poses(hand, 200), layout)
    labels = tuple(canonical_name(name) for name in layout.names)
    take = MarkerTake('one', labels, points, 'right', 100., np.zeros(len(points), dtype=int))
    placed = take._replace(names=names_in_layout(layout)[0])
    fit = hand, replace(layout, names=placed.names)
    found = _of_take(take, placed, fit)
    assert len(found.markers) == len(set(found.markers)) == markers and mcp in found.markers
    by_preset, by_fit = found.layout, found.fitted[1]
    assert by_preset.names == by_fit.names == found.markers
    assert by_preset.places == by_fit.places == layout.places
    np.testing.assert_array_equal(by_preset.offsets, layout.offsets)
    assert {trial.learned for trial in trials([found])} == {'own', 'model', 'fitted'}
    assert _of_take(take, placed, None).fitted is None


def test_a_file_of_joints_and_markers_is_judged_by_the_more_of_them():
    layout, hand = preset_layout('kyutech23'), Hand.scaled()
    points = markers_of(hand, .4 * natural_poses(hand, 20), layout)
    placed = MarkerTake('one', names_in_layout(layout)[0], points, 'right', 100.,
                        np.zeros(len(points), dtype=int))
    joints = placed._replace(names=placed.names[:19], points=points[:, :19] + 1.)
    found = _of_take(joints, placed, (hand, replace(layout, names=placed.names)))
    np.testing.assert_array_equal(found.points, points)
    assert found.markers == found.layout.names == found.fitted[1].names == placed.names
    # As many joints as markers are known by the layout's names: which are which is not.
    more = joints._replace(names=(*placed.names, 'wrist_2'),
                           points=np.concatenate((points, points[:, :1]), axis=1))
    found = _of_take(more, placed, (hand, replace(layout, names=placed.names)))
    assert found.layout is None and found.fitted is None


def test_palms_of_two_markers_are_of_no_layout():
    take = MarkerTake('one', ('BackHand1', 'BackHand2', 'IndexTip', 'ThumbTip'),
                      np.zeros((10, 4, 3)), 'right', 100., np.zeros(10, dtype=int))
    assert _of_take(take, take, None).layout is None


def test_a_hand_of_another_size_is_labelled_by_the_statistics_of_others():
    recordings = [recording('small', .16), recording('large', .2)]
    for trial in trials(recordings):
        if trial.learned == 'others':
            assert isinstance(trial, LabellingTrial)
            rows = judge(trial._replace(clouds=((0, 0.),)), seed=1)
            assert [row['right_pct'] for row in rows] == pytest.approx([100., 100.], abs=2.)
