"""What is written is read by rosbags and by the tracker's own reader."""

import numpy as np
import pytest

from hand_tracker.adapters.marker_arrays import MOST_MARKERS, MarkerArrayWriter
from hand_tracker.adapters.packet_structure import PacketOrigin, PacketStructure
from hand_tracker.adapters.point_frame import of_subject, point_frame, turned_upright
from hand_tracker.core.model.marker_layout import MARKERS, PAPER_PLACES
from hand_tracker.files.bags import MARKER_ARRAY, TYPE_STORE
from hand_tracker.messages.cdr import MarkerReader
from hand_tracker.messages.labels import LabelMap
from hand_tracker.messages.stamps import Stamp

STAMP = Stamp(3, 4)
PLACES = np.arange(24.).reshape(8, 3) + 1.


@pytest.fixture
def said():
    return {}


@pytest.fixture
def writer(said):
    return MarkerArrayWriter(said.setdefault)


def written(writer, *given, **more):
    """Return the message of a frame, and its markers as (namespace, id, position)."""
    data = writer.write(point_frame(None, 'mocap', *given, **more), STAMP)
    message = TYPE_STORE.deserialize_cdr(data, MARKER_ARRAY)
    # All of it was understood: nothing is left and nothing was lacking.
    assert bytes(TYPE_STORE.serialize_cdr(message, MARKER_ARRAY)) == data
    assert {marker.header.frame_id for marker in message.markers} <= {'mocap'}
    return data, [(marker.ns, marker.id, np.array([marker.pose.position.x, marker.pose.position.y,
                                                   marker.pose.position.z]))
                  for marker in message.markers]


@pytest.mark.parametrize('names', [MARKERS, PAPER_PLACES,
                                   [f'RHand:{marker.upper()}' for marker in MARKERS]])
def test_the_tracker_takes_markers_by_their_names(writer, names):
    order = [4, 2, 7, 0, 1, 6, 5, 3]
    data, _ = written(writer, [names[row] for row in order], PLACES[order])
    frame = MarkerReader(LabelMap()).read(data)
    np.testing.assert_array_equal(frame.positions, PLACES)
    assert frame.stamp == STAMP and frame.frame_id == 'mocap' and not frame.doubled


def test_other_names_are_labels_and_no_ids(writer):
    data, markers = written(writer, ['RFIN', 'RWRA'], PLACES[:2], PLACES[2:5])
    assert [number for _, number, _ in markers if number < len(MARKERS)] == []
    assert len({number for _, number, _ in markers}) == len(markers)
    labels = LabelMap(['RWRA/*', *[''] * 6, 'RFIN/*'])
    found = MarkerReader(labels).read(data).positions
    np.testing.assert_array_equal(found[[7, 0]], PLACES[:2])
    assert np.isnan(MarkerReader(LabelMap()).read(data).positions).all()


def test_anonymous_points_have_a_namespace_and_spare_places(writer):
    _, markers = written(writer, points=PLACES[:3])
    assert {ns for ns, _, _ in markers} == {'unlabelled'}
    found = np.array([at for _, _, at in markers])
    np.testing.assert_array_equal(found[:3], PLACES[:3])
    assert len(found) > 3 and np.isnan(found[3:]).all()


def test_the_layout_stays_while_markers_and_points_come_and_go(writer):
    layouts = set()
    written(writer, ['a', 'b'], PLACES[:2], PLACES)
    for names, count in ((['a', 'b'], 8), (['b'], 0), (['b', 'a'], 5)):
        _, markers = written(writer, names, PLACES[:len(names)], PLACES[:count])
        layouts.add(tuple((ns, number) for ns, number, _ in markers))
        at = {ns: place for ns, _, place in markers if ns in ('a', 'b')}
        for name, place in zip(names, PLACES):
            np.testing.assert_array_equal(at[name], place)
        assert np.isnan(at['a']).all() == ('a' not in names)
    assert len(layouts) == 1


def test_markers_of_two_subjects_that_are_called_alike_are_nobodys(writer, said):
    names = ['RHand:index', 'LHand:index', 'RHand:thumb']
    data, markers = written(writer, names, PLACES[:3])
    assert 'subject' in said['subjects']
    assert np.flatnonzero(np.isfinite(MarkerReader(LabelMap()).read(data).positions[:, 0])) == [7]
    assert len({(ns, number) for ns, number, _ in markers}) == 3
    frame = of_subject(point_frame(None, 'mocap', names, PLACES[:3], PLACES[3:4]), 'LHand')
    assert frame.names == ('LHand:index',) and len(frame.points) == 1
    np.testing.assert_array_equal(frame.markers, PLACES[1:2])


def test_one_name_twice_in_a_frame_is_told(writer, said):
    _, markers = written(writer, ['a', 'a'], PLACES[:2])
    assert "called 'a'" in said['doubled'] and len(markers) == 1
    np.testing.assert_array_equal(markers[0][2], PLACES[0])


def test_a_flood_of_points_is_cut(writer, said):
    _, markers = written(writer, points=np.ones((MOST_MARKERS + 1, 3)))
    assert len(markers) == MOST_MARKERS and '1001 anonymous points' in said['points']


def test_the_markers_that_count_have_rows_and_points_the_places_behind_them(writer):
    written(writer, ['a'], PLACES[:1], np.ones((MOST_MARKERS + 1, 3)))
    origin = PacketOrigin(PacketStructure(b'', b''), np.array([7]), np.arange(MOST_MARKERS + 1),
                          np.eye(3), 0, 0, 1., lambda: (0, (0., 0., 0.), 0), print)
    found, markers, points = writer.rows(origin)
    assert found.markers.tolist() == [7] and markers.tolist() == [0]
    np.testing.assert_array_equal(points, range(1, MOST_MARKERS + 1))
    assert len(writer.template.numbers) == 3 * (MOST_MARKERS + 1)


def test_points_are_turned_upright():
    frame = turned_upright(point_frame(None, '', ['a'], [[1., 2., 3.]], [[0., 1., 0.]]), 'y')
    np.testing.assert_array_equal(frame.markers, [[1., -3., 2.]])
    np.testing.assert_array_equal(frame.points, [[0., 0., 1.]])
