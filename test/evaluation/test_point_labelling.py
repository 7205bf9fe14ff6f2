"""Evaluation of the labelling of points without names, on simulated hands."""

import numpy as np
import pytest
from helpers.hands import markers_of

from hand_tracker.core.model.hand import Hand
from hand_tracker.core.model.marker_layout import MARKERS
from hand_tracker.core.point_labelling.natural_poses import natural_poses
from hand_tracker.evaluation.point_labelling import (
    LabellingTrial,
    NamedMarkers,
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


def test_a_hand_of_another_size_is_labelled_by_the_statistics_of_others():
    recordings = [recording('small', .16), recording('large', .2)]
    for trial in trials(recordings):
        if trial.learned == 'others':
            assert isinstance(trial, LabellingTrial)
            rows = judge(trial._replace(clouds=((0, 0.),)), seed=1)
            assert [row['right_pct'] for row in rows] == pytest.approx([100., 100.], abs=2.)
