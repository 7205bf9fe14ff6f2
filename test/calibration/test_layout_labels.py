"""Markers of any layout by the labels of a recording, and which layout a recording has."""

import numpy as np
import pytest
from helpers.point_files import hand_recording

from hand_tracker.calibration.hand_labels import are_nameless
from hand_tracker.calibration.hand_markers import UnknownMarkers, choose_markers, marker_points
from hand_tracker.calibration.known_layouts import complete_layout, has_both, likely_layouts
from hand_tracker.calibration.layout_labels import labelled_layout, point_names
from hand_tracker.calibration.layout_names import names_in_layout
from hand_tracker.core.errors import InvalidLayout
from hand_tracker.core.model.hand import Hand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.layout_presets import LAYOUT_PRESETS, preset_layout
from hand_tracker.core.model.marker_layout import MarkerLayout, marker_positions
from hand_tracker.files.point_recording import Axes, PointRecording
from hand_tracker.simulation.motion import demo_motion


def recording_of(name, side='right', spelling='{}', frames=240):
    """Return a recording of a preset's markers."""
    hand, layout = Hand.scaled(side=side), preset_layout(name)
    motion = demo_motion(hand)
    angles, rotation, position = motion.sample(np.arange(frames) / 40.)
    pose = forward(joint_table(hand), angles, rotation, position)
    points = marker_positions(layout.mounting(hand), pose, rotation, position)
    return PointRecording('take', 'test', tuple(map(spelling.format, layout.names)),
                          points.astype(np.float32), 40., None, Axes('m', 'z'))


@pytest.mark.parametrize('name', LAYOUT_PRESETS)
def test_a_preset_is_found_by_its_own_names(name):
    recording = recording_of(name)
    found = complete_layout(recording)
    assert found.name == name and found.likelihood > .5
    chosen = choose_markers(recording, layout=preset_layout(name))
    np.testing.assert_array_equal(marker_points(recording, chosen), recording.points)


@pytest.mark.parametrize('name, spelling', [
    ('vicon_production5', '{}{}'), ('optitrack_hand', '{}{}'), ('sig18_19', '{}{}'),
    ('mediapipe21', '{}_{}')])
def test_labels_of_both_hands_are_found(name, spelling):
    hands = [recording_of(name, side, spelling.format(side[0].upper(), '{}'))
             for side in ('right', 'left')]
    both = hands[0]._replace(labels=sum((one.labels for one in hands), ()),
                             points=np.concatenate([one.points for one in hands], axis=1))
    assert has_both(both, likely_layouts(both), name)
    for one in (*hands, recording_of(name)):
        assert not has_both(one, likely_layouts(one), name)


@pytest.mark.parametrize('labels, expected', [
    (('M000', 'M001', ''), True), (('leds/3', 'Ann:M4'), True), (('C7', 'T10', 'Index'), False)])
def test_numbers_are_no_names(labels, expected):
    assert are_nameless(labels) is expected


@pytest.mark.parametrize('name', LAYOUT_PRESETS)
@pytest.mark.parametrize('side', ['right', 'left'])
def test_names_of_a_layout_say_no_side(name, side):
    """Of Vicon's RNG6, say, the first letter is no right hand's."""
    sides = {one.side for one in likely_layouts(recording_of(name, side)) if one.name == name}
    assert sides and sides <= {side, 'unknown'}


@pytest.mark.parametrize('name, spelling', [
    ('sig18_19', 'Anna:L{}'), ('optitrack_hand', 'L{}'), ('vicon_production5', 'L{}'),
    ('dfki13', 'left_{}'), ('mediapipe21', 'LEFT_{}')])
def test_sides_in_front_of_names_are_read(name, spelling):
    recording = recording_of(name, 'left', spelling)
    found = complete_layout(recording)
    assert (found.name, found.side) == (name, 'left')
    chosen = choose_markers(recording, 'left', layout=preset_layout(name))
    assert chosen.side == 'left' and not chosen.missing


@pytest.mark.parametrize('side, spelling', [
    ('right', '{}'), ('left', '{}'), ('right', 'right_{}'), ('left', 'L_{}'), ('left', 'left:{}'),
    ('right', 'RHand:{}'), ('left', 'Anna:LHand:{}')])
def test_a_letter_in_front_of_some_names_of_a_layout_is_no_side(side, spelling):
    layout = MarkerLayout(
        ('wrist', 'index_mcp', 'little_mcp', 'index_dip', 'ring_dip', 'ring_pip', 'little_dip',
         'little_pip'), np.zeros((8, 3)), names=('w', 'i0', 'l0', 'i1', 'r1', 'r2', 'l1', 'l2'))
    labels = [spelling.format(name) for name in layout.names]
    other = {'right': 'left_{}', 'left': 'RHand:{}'}[side]
    both = [*map(other.format, layout.names), *labels]
    for given in (labels, labels[::-1], both):
        found = labelled_layout(point_names(given), layout, side)
        assert [given[column] for column in found.columns] == labels


def test_landmarks_and_numbers_of_several_at_one_name_markers():
    layout = preset_layout('kyutech23')
    labels = [place for place in layout.places if place != 'wrist']
    labels += [f'Wrist_{number}' for number in (2, 1, 3, 4)]
    found = labelled_layout(point_names(labels), layout)
    assert found.columns == (*range(19), 20, 19, 21, 22) and found.side == ''
    # A marker on the back of the hand is no knuckle.
    sig18 = preset_layout('sig18_19')
    columns = labelled_layout(point_names(('index_mcp', 'little_mcp', 'wrist')), sig18).columns
    assert [sig18.names[row] for row in np.flatnonzero(np.array(columns) >= 0)] == [
        'IndexMCP', 'PinkyMCP']


def test_numbers_name_a_layout_only_where_there_are_no_others():
    recording = recording_of('kyutech23')
    more = recording._replace(
        labels=(*recording.labels, '24'),
        points=np.concatenate((recording.points, recording.points[:, :1]), axis=1))
    assert not likely_layouts(more)
    assert not choose_markers(more, layout=preset_layout('kyutech23')).missing


@pytest.mark.parametrize('name', ['dfki13', 'sig18_19', 'kyutech23'])
@pytest.mark.parametrize('label', ['', '{}', 'leds/{}'])
def test_a_layout_fits_as_many_points_without_names_as_it_has_markers(name, label):
    recording = recording_of(name)
    count = recording.points.shape[1]
    nameless = recording._replace(
        labels=tuple(label.format(number) for number in range(100, 100 + count)))
    # Some markers are hidden now and then, in a quarter of the frames.
    nameless.points[::8, 3] = nameless.points[4::8, 5] = np.nan
    best, *_ = likely_layouts(nameless)
    assert (best.name, best.side, best.is_complete) == (name, 'unknown', False)
    assert .7 < best.likelihood < .8
    # Far from each other they are of no hand.
    apart = nameless._replace(points=nameless.points + .05 * np.arange(count)[:, None])
    assert not likely_layouts(apart)


def test_markers_that_are_not_there_are_named():
    recording = recording_of('sig18_19')
    fewer = recording._replace(labels=recording.labels[1:], points=recording.points[:, 1:])
    chosen = choose_markers(fewer, layout=preset_layout('sig18_19'))
    assert chosen.missing == ('ThumbCMC',)
    assert np.isnan(marker_points(fewer, chosen)[:, 0]).all()
    assert choose_markers(fewer, names={'ThumbCMC': 'IndexMCP'},
                          layout=preset_layout('sig18_19')).columns[0] == (3,)
    palmless = recording._replace(labels=recording.labels[:4], points=recording.points[:, :4])
    with pytest.raises(UnknownMarkers, match='no label for IndexMCP, .*--markers IndexMCP=LABEL'):
        choose_markers(palmless, layout=preset_layout('sig18_19'))


def test_a_layout_that_is_there_is_named_where_the_eight_are_not():
    with pytest.raises(UnknownMarkers, match='expected --layout dfki13, whose markers are all'):
        choose_markers(recording_of('dfki13'))
    assert choose_markers(hand_recording(5)).side == 'right'


def test_a_calibration_knows_one_marker_at_a_landmark_of_a_digit():
    places = ('wrist', 'index_mcp', 'little_mcp', 'index_tip', 'index_tip')
    with pytest.raises(InvalidLayout, match='markers d and e: both at index_tip'):
        names_in_layout(MarkerLayout(places, names=tuple('abcde')))
    names, usual = names_in_layout(preset_layout('sig18_19'))
    assert names[:5] == ('thumb_cmc', 'thumb_mcp', 'thumb_ip', 'thumb_tip', 'index_mcp')
    assert {'back_hand_1', 'back_hand_2', 'back_hand_3'} == set(usual)
