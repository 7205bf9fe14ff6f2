"""Points without usable labels: whether labels change, and markers of any layout."""

from types import SimpleNamespace

import numpy as np
import pytest
from helpers.hands import hand_at

from hand_tracker.calibration import fit_hand, landmark_positions
from hand_tracker.calibration.size import fit_size
from hand_tracker.core.model.hand import Hand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.layout_presets import preset_layout
from hand_tracker.core.point_labelling.cloud_labeller import CloudLabels
from hand_tracker.core.point_labelling.natural_poses import (
    ANYBODY,
    FITTED,
    SIZED,
    natural_poses,
    tolerances_of,
)
from hand_tracker.files.hand_file import load_hand, save_hand
from hand_tracker.messages.marker_array import MarkerFrame
from hand_tracker.messages.points import PointFrame, PointReader
from hand_tracker.messages.stamps import Stamp
from hand_tracker.tracking.marker_events import LabelChanges
from hand_tracker.tracking.point_labels import (
    PointLabelReader,
    PointLabels,
    usual_shape_warning,
)

PERIOD = .01
SHORTENED_FROM = 20     # message


def frame(positions, unknown=()):
    return MarkerFrame(Stamp(1, 0), 'mocap', positions, tuple(unknown), (), ())


def reasons(frames):
    changes = LabelChanges(8)
    return [changes.add(one, PERIOD * number) for number, one in enumerate(frames)]


def test_labels_that_change_from_frame_to_frame_are_of_no_use():
    random = np.random.default_rng(1)
    still = hand_at()
    found = reasons(frame(still[random.permutation(8)]) for _ in range(20))
    assert found[0] is None
    assert found[-1] == 'labels change from marker to marker'


@pytest.mark.parametrize('moves', [
    lambda t: hand_at() + (.02 * t, 0., 0.),            # 2 m/s
    lambda t: hand_at()[[0, 1, 2, 4, 3, 5, 6, 7]] if t == 60 else hand_at(),
    lambda t: np.where(np.arange(8)[:, None] == t % 8, np.nan, hand_at()),
], ids=['fast', 'one swap', 'hidden by turns'])
def test_labels_that_stay_are_kept(moves):
    assert reasons(frame(moves(t)) for t in range(200)) == [None] * 200


def test_points_without_any_label_are_told_from_a_hand_that_is_hidden():
    nothing = np.full((8, 3), np.nan)
    others = [('', number) for number in range(20, 28)]
    assert reasons([frame(nothing, others[:7])] * 300) == [None] * 300
    found = reasons([frame(nothing, others)] * 120)
    assert found[:90] == [None] * 90
    assert found[-1] == 'no marker has a label of labels.*'


def test_labels_of_the_other_hand_alone_are_of_use():
    nothing = np.full((8, 3), np.nan)
    left = [('left', number) for number in range(8)]
    changes = LabelChanges(8, not_of='left')
    assert [changes.add(frame(nothing, left), PERIOD * n) for n in range(300)] == [None] * 300
    assert reasons([frame(nothing, left)] * 300)[-1] == 'no marker has a label of labels.*'


def test_frames_of_fewer_points_keep_nobody_from_seeing_that_no_label_is_of_use():
    nothing = np.full((8, 3), np.nan)
    others = [('', number) for number in range(20, 28)]
    found = reasons([frame(nothing, others[:8 - number % 3]) for number in range(120)])
    assert found[:90] == [None] * 90
    assert 'no marker has a label of labels.*' in found
    one = hand_at() * np.where(np.arange(8)[:, None] == 2, 1., np.nan)
    assert reasons([frame(one, others[:7])] * 300) == [None] * 300


def test_many_markers_by_the_shape_of_a_usual_hand_are_warned_of():
    usual, measured = Hand.scaled(), Hand.scaled(length=.2, breadth=.095)
    assert usual_shape_warning(usual, preset_layout('sig18_19')).startswith('19 markers without')
    assert usual_shape_warning(measured, preset_layout('sig18_19')) is None
    assert usual_shape_warning(usual, preset_layout('paper8')) is None


@pytest.mark.parametrize('size, sizes', [
    ({}, ANYBODY.sizes), ({'length': .2, 'breadth': .095}, SIZED.sizes)],
    ids=['mean hand', 'measured hand'])
def test_a_measured_hand_is_looked_for_in_its_own_size(size, sizes):
    labels = PointLabels()
    labels.set_hand(Hand.scaled(**size), preset_layout('paper8'), PointReader())
    assert tuple(labels._prototypes['right'].statistics.sizes) == sizes


def test_how_well_a_hand_is_known_is_told_by_its_file(tmp_path):
    save_hand(tmp_path / 'ruler.yaml', Hand.scaled(.2, .095, side='left'), preset_layout('paper8'))
    ruler, _ = load_hand(tmp_path / 'ruler.yaml')
    assert tolerances_of(Hand.scaled(side='left')) is ANYBODY
    assert tolerances_of(ruler) is SIZED
    assert tolerances_of(fit_size(np.tile(1.05 * hand_at(), (100, 1, 1)), Hand.scaled())) is SIZED
    hand = Hand.scaled()
    joints = landmark_positions(hand, forward(joint_table(hand), natural_poses(hand, 400)))
    save_hand(tmp_path / 'fitted.yaml', fit_hand(joints, 'right'), preset_layout('paper8'))
    assert tolerances_of(load_hand(tmp_path / 'fitted.yaml')[0]) is FITTED


class HalfHiddenPoints:
    """Points of a hand, in later messages too few to find it."""

    def read(self, message):
        count = 8 if message < SHORTENED_FROM else 4    # not too few to follow it
        return PointFrame(Stamp(1, 10**7 * message), 'mocap', hand_at()[:count],
                          np.full(count, -1), ())


def test_a_hand_that_is_replaced_keeps_its_labels():
    markers, layout = hand_at(), preset_layout('paper8')
    labels = PointLabels()
    PointLabelReader(Hand.scaled(), layout, HalfHiddenPoints(), labels)
    for message in range(40):
        if message == 30:
            PointLabelReader(Hand.scaled(.19, .088), layout, HalfHiddenPoints(), labels)
        places = labels.read(message, 'right')[1]
        assert np.array_equal(places[:4], markers[:4]), message


def test_labels_that_are_reset_search_the_hand_anew():
    labels = PointLabels()
    PointLabelReader(Hand.scaled(), preset_layout('paper8'), HalfHiddenPoints(), labels)
    for message in range(30):
        assert labels.read(message, 'right')[2]
    labels.reset()
    _, places, found, _ = labels.read(30, 'right')
    assert not found
    assert np.isnan(places).all()


@pytest.mark.parametrize('layout, count, said', [
    ('paper8', 28, 'does not fit them (if you wear another, set it: tips5_palm3, '
     'vicon_production5, dfki13, optitrack_hand, sig18_19, kyutech23); or check the side and '
     'unit_scale (1 for metres, 0.001 for millimetres)'),
    ('sig18_19', 21, 'does not fit them (if you wear another, set it: paper8, tips5_palm3, '
     'vicon_production5, dfki13, optitrack_hand); or check the side and unit_scale (1 for metres, '
     '0.001 for millimetres)'),
    ('paper8', 7, 'only 7 points; the hand has 8 markers')])
def test_a_layout_that_does_not_fit_is_named_with_the_cure_after_two_seconds(layout, count, said):
    class Labeller:
        def update(self, points, time, ids):
            return CloudLabels((np.full(len(names), -1),), (np.full((len(names), 3), np.nan),),
                               (False,), (False,))

    class Points:
        def read(self, message):
            return PointFrame(Stamp(message // 10, 10**8 * (message % 10)), 'mocap',
                              np.zeros((count, 3)), np.arange(count), ())

    names = preset_layout(layout).names
    labels = PointLabels()
    reader = PointLabelReader(Hand.scaled(), preset_layout(layout), Points(), labels)
    labels._labeller = Labeller()
    lines = []
    for tenth in range(10, 50):
        reader.read(tenth)
        lines += [(tenth, *line) for line in reader.pop_log_lines()]
    (tenth, is_warning, line), = lines
    assert (tenth, is_warning) == (30, True)
    assert line.endswith(said)


def test_why_no_hand_is_found_is_known_until_one_is_and_the_other_side_told_later_too():
    layout, cloud = preset_layout('paper8'), np.random.default_rng(2).uniform(size=(8, 3))
    now = SimpleNamespace(found=False, other_side=False)
    points = SimpleNamespace(read=lambda tenth: PointFrame(
        Stamp(tenth // 10, 10**8 * (tenth % 10)), 'mocap', cloud, np.arange(8), ()))
    labels = PointLabels()
    reader = PointLabelReader(Hand.scaled(), layout, points, labels)
    labels._labeller = SimpleNamespace(update=lambda *_: CloudLabels(
        (np.arange(8),), (cloud,), (now.found,), (now.other_side,)))

    def told(first):
        for tenth in range(first, first + 30):
            reader.read(tenth)
        return [line for _, line in reader.pop_log_lines()]

    line, = told(10)
    assert reader.why_not_found == line and 'is not found among 8 points' in line
    now.other_side = True
    line, = told(40)
    assert reader.why_not_found == line and 'look like a left hand' in line
    now.found, now.other_side = True, False
    assert told(70) == ['the right hand is found among 8 points without labels']
    assert reader.why_not_found == ''


@pytest.mark.parametrize('name, is_named', [
    ('sig18_19', True), ('sig18_19_skin', False), ('kyutech23', False)])
def test_a_hand_that_is_not_found_may_wear_its_markers_elsewhere(name, is_named):
    layout = preset_layout(name)
    places = np.random.default_rng(1).uniform(size=(len(layout.names), 3))
    points = SimpleNamespace(read=lambda tenth: PointFrame(
        Stamp(tenth // 10, 10**8 * (tenth % 10)), 'mocap', places, np.arange(len(places)), ()))
    reader = PointLabelReader(Hand.scaled(), layout, points, PointLabels())
    reader._labels._labeller = SimpleNamespace(update=lambda *_: CloudLabels(
        (np.full(len(places), -1),), (np.full(places.shape, np.nan),), (False,), (False,)))
    for tenth in range(10, 40):
        reader.read(tenth)
    (_, line), = reader.pop_log_lines()
    assert ('the layout sig18_19_skin has its markers where people wear them' in line) == is_named


def test_the_markers_of_any_layout_are_read():
    layout = preset_layout('sig18_19')
    cloud = np.random.default_rng(2).uniform(size=(30, 3))
    places = cloud[:19][::-1].copy()
    places[3] = np.nan

    class Labeller:
        def update(self, points, time, ids):
            return CloudLabels((np.arange(19),), (places,), (True,), (False,))

    class Points:
        def read(self, message):
            return PointFrame(Stamp(1, 0), 'mocap', cloud, np.arange(30), ())

    labels = PointLabels()
    reader = PointLabelReader(Hand.scaled(), layout, Points(), labels)
    labels._labeller = Labeller()
    positions = reader.read(b'').positions
    assert np.array_equal(positions, places, equal_nan=True)
    assert reader.pop_log_lines() == [
        (False, 'the right hand is found among 30 points without labels')]


def test_the_cloud_of_a_hand_lacks_what_is_labelled_as_the_other_hand():
    layout, cloud = preset_layout('paper8'), np.random.default_rng(2).uniform(size=(20, 3))
    rows = np.array([0, 1, 2, 3, 4, 5, -1, 7]), np.array([8, 9, 10, -1, 12, 13, 14, 15])
    labels = CloudLabels(rows, tuple(cloud[one] for one in rows), (True, True), (False, False))
    points = SimpleNamespace(read=lambda message: PointFrame(
        Stamp(1, 0), 'mocap', cloud, np.arange(20), ()))
    both = PointLabels()
    readers = [PointLabelReader(Hand.scaled(side=side), layout, points, both)
               for side in ('right', 'left')]
    both._labeller = SimpleNamespace(update=lambda *_: labels)
    assert readers[0].cloud is None
    for reader in readers:
        reader.read(b'')
    assert np.array_equal(readers[0].cloud, np.delete(cloud, [8, 9, 10, 12, 13, 14, 15], axis=0))
    assert np.array_equal(readers[1].cloud, np.delete(cloud, [0, 1, 2, 3, 4, 5, 7], axis=0))
    alone = PointLabelReader(Hand.scaled(), layout, points)
    alone.read(b'')
    assert alone.cloud is cloud
