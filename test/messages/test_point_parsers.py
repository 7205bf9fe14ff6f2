"""Messages of systems as bytes: the same as their adapters read of rclpy's; any bytes survived."""

import struct
from functools import partial
from types import FunctionType
from typing import NamedTuple

import numpy as np
import pytest
from geometry_msgs.msg import Point, Pose, PoseArray, Quaternion
from helpers.clouds import NUMBER_FORMATS, cloud
from hypothesis import given, settings
from hypothesis import strategies as st
from mocap4r2_msgs.msg import Marker, Markers, RigidBodies, RigidBody
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2
from teleop_ros2_interfaces.msg import NamedPoseArray
from visualization_msgs.msg import Marker as ArrayMarker
from visualization_msgs.msg import MarkerArray

from hand_tracker.adapters.hand_landmarks import (
    landmarks_of_markers,
    landmarks_of_poses,
    mark_missing,
    named_landmarks,
)
from hand_tracker.adapters.marker_arrays import MarkerArrayWriter
from hand_tracker.adapters.mocap4r2 import points_of_markers, points_of_rigid_bodies
from hand_tracker.adapters.point_cloud import points_of_cloud
from hand_tracker.adapters.point_frame import MalformedFrame, SourceFrame
from hand_tracker.core.model.hand import SIDES
from hand_tracker.core.model.layout_presets import preset_layout
from hand_tracker.core.model.marker_layout import MARKERS, PAPER_PLACES
from hand_tracker.files.bags import TYPE_STORE
from hand_tracker.messages import cdr, message_kinds
from hand_tracker.messages.cdr import (
    ENCAPSULATION,
    MalformedMessage,
    MarkerReader,
    number_capacity,
    parse_points,
    point_capacity,
)
from hand_tracker.messages.labels import LabelMap, default_labels
from hand_tracker.messages.landmark_kinds import (
    LANDMARK_MARKERS,
    LANDMARK_ORDERS,
    LANDMARK_POSES,
    NAMED_LANDMARKS,
    OPENXR,
    kind_of_hand,
)
from hand_tracker.messages.marker_array import MARKER_ARRAY
from hand_tracker.messages.marker_ids import ANONYMOUS_NAMESPACE, SOURCE_FRAME, layout_ids
from hand_tracker.messages.message_kinds import (
    MOCAP4R2_MARKERS,
    POINT_CLOUD,
    RIGID_BODIES,
    MessageKind,
)
from hand_tracker.messages.point_cloud_parser import MOST_MARKERS
from hand_tracker.messages.stamps import Stamp

NEEDS = 'rclpy', 'mocap4r2_msgs', 'teleop_ros2_interfaces'

# By id and by name; 'x/*' and 1001 are no names of markers of the hand.
LABELS = LabelMap(['0', '1', 'RHand:thumb/7', '3', 'x/*', '1001', '', '7'])


class System(NamedTuple):
    """A kind of messages, its class in rclpy and its adapter."""

    kind: MessageKind
    message: type
    points: object


MARKERS_SYSTEM = System(MOCAP4R2_MARKERS, Markers, points_of_markers)
BODIES_SYSTEM = System(RIGID_BODIES, RigidBodies, points_of_rigid_bodies)
POSES_SYSTEM = System(LANDMARK_POSES, PoseArray, landmarks_of_poses)
CLOUD_SYSTEM = System(POINT_CLOUD, PointCloud2, points_of_cloud)
NAMED_SYSTEMS = {f'{NAMED_LANDMARKS.type} {side}': System(
    kind_of_hand(NAMED_LANDMARKS, side), NamedPoseArray, partial(named_landmarks, side=side))
    for side in SIDES}

numbers = st.one_of(st.floats(), st.sampled_from([0., -0., 1., np.nan]))
places = st.builds(Point, x=numbers, y=numbers, z=numbers)
texts = st.one_of(st.sampled_from(['', 'x', 'index', 'Wrist', 'RHand:thumb', 'LHand:thumb']),
                  st.text(st.characters(exclude_categories=['Cs'], exclude_characters='\0'),
                          max_size=9))
int32 = st.integers(-2**31, 2**31 - 1)
markers = st.builds(Marker, id_type=st.sampled_from([0, 0, 1, 2, -1]),
                    marker_index=st.one_of(st.integers(0, 3), int32), marker_name=texts,
                    translation=places)
bodies = st.builds(RigidBody, rigid_body_name=texts, markers=st.lists(markers, max_size=5))


@st.composite
def headed(draw, message):
    """Return a message with any header."""
    found = draw(message)
    found.header.frame_id = draw(texts)
    found.header.stamp.sec = draw(int32)
    found.header.stamp.nanosec = draw(st.integers(0, 2**32 - 1))
    return found


frame_numbers = st.integers(0, 2**32 - 1)
any_markers = headed(st.builds(Markers, frame_number=frame_numbers,
                               markers=st.lists(markers, max_size=12)))
any_bodies = headed(st.builds(RigidBodies, frame_number=frame_numbers,
                              rigidbodies=st.lists(bodies, max_size=4)))
poses = st.builds(Pose, position=places, orientation=st.just(Quaternion(w=1.)))
any_poses = headed(st.sampled_from([0, 1, *LANDMARK_ORDERS]).flatmap(
    lambda count: st.builds(PoseArray, poses=st.lists(
        poses, min_size=count, max_size=count))))

landmark_names = st.one_of(texts, st.sampled_from([
    *(f'{side}_{name}' for side in ('left', 'LEFT', 'right', 'Right')
      for name in ('WRIST', 'index_tip', 'PALM', 'INDEX_DISTAL', 'HEEL', '')),
    'left', 'leftover_WRIST', 'HEAD']))


@st.composite
def named_poses(draw):
    """Return a NamedPoseArray of rclpy, seldom with a validity too few."""
    rows = draw(st.lists(st.tuples(landmark_names, poses, st.booleans()), max_size=12))
    names, places, valid = ([row[column] for row in rows] for column in range(3))
    return NamedPoseArray(name=names, pose=places, is_valid=valid[draw(
        st.sampled_from([0, 0, 0, 1])):])


any_named = headed(named_poses())


@st.composite
def landmark_markers(draw):
    """Return a MarkerArray of rclpy with landmarks, and other markers beside."""
    ids = draw(st.lists(st.one_of(st.integers(0, 20), st.integers(26, 99), int32.filter(
        lambda number: not 0 <= number < 26)), max_size=12, unique=True))
    header = draw(headed(st.builds(PoseArray))).header
    return MarkerArray(markers=[ArrayMarker(
        header=header, ns=draw(texts), id=number, type=draw(st.sampled_from([2, 2, 1, 3, 7, 9])),
        action=draw(st.sampled_from([0, 0, 0, 2])), pose=draw(poses),
        points=draw(st.lists(places, max_size=2))) for number in ids])


@st.composite
def clouds(draw):
    """Return a PointCloud2 of rclpy, of any layout."""
    height, width = draw(st.integers(0, 3)), draw(st.integers(0, 4))
    form = draw(st.sampled_from(sorted(NUMBER_FORMATS)))
    kind = numbers if form.startswith('f') else st.integers(0, 127)
    if form == 'f4':
        kind = st.one_of(st.floats(width=32), st.sampled_from([0., np.nan]))
    points = np.array(draw(st.lists(kind, min_size=3 * height * width,
                                    max_size=3 * height * width)), float).reshape(-1, 3)
    fields = draw(st.permutations(['x', 'y', 'z', *draw(st.sets(
        st.sampled_from(['rgb', 'ring', 'xy', 'X']), max_size=3))]))
    data = TYPE_STORE.serialize_cdr(cloud(
        points, tuple(fields), form, draw(st.sampled_from('<>')), draw(st.integers(0, 5)),
        max(height, 1), draw(st.integers(0, 5)) if height > 1 else 0), POINT_CLOUD.type)
    return deserialize_message(bytes(data), PointCloud2)


any_clouds = headed(clouds())
SYSTEM_READERS = {system.kind.type: (system, strategy) for system, strategy in (
    (MARKERS_SYSTEM, any_markers), (BODIES_SYSTEM, any_bodies), (POSES_SYSTEM, any_poses),
    (CLOUD_SYSTEM, any_clouds))} | {
        name: (system, any_named) for name, system in NAMED_SYSTEMS.items()}


def expected_points(frame):
    """Return what counts of an adapter's frame: places by names, and those without a name."""
    named = {}
    for name, at in zip(frame.names, frame.markers):
        named.setdefault(name, at)
    return named, frame.points


def found_points(reader, data):
    """Return the same of what a reader finds, with frame and stamp of the first point."""
    found = list(reader.points(data))
    named = {one.ns: one.position for one in found if one.id < 1000 or
             one.ns != ANONYMOUS_NAMESPACE}
    anonymous = [one.position for one in found if one.ns not in named]
    return named, np.array(anonymous).reshape(-1, 3), found


def same(place, other):
    """Return whether places are the same; one with a number that is not finite is none."""
    return np.array_equal(place, other) or not (
        np.isfinite(place).all() or np.isfinite(other).all())


def check_against_adapter(system, message):
    """Check that bytes are read as the adapter and a source node would hand them on."""
    data = serialize_message(message)
    message = deserialize_message(data, system.message)
    reader = MarkerReader(LABELS, kind=system.kind)
    try:
        frame = system.points(message)
    except MalformedFrame as error:
        if 'no name' in str(error) or not getattr(message, 'poses', True):
            assert not list(reader.points(data)) and reader.read(data).stamp is None
            return
        with pytest.raises(MalformedMessage, match=str(error)):
            reader.read(data)
        return
    named, anonymous, found = found_points(reader, data)
    expected, others = expected_points(frame)
    assert list(named) == list(expected)
    assert all(map(same, named.values(), expected.values()))
    if system is not CLOUD_SYSTEM:
        anonymous = anonymous[np.isfinite(anonymous).all(axis=1)]
    np.testing.assert_array_equal(anonymous, others)
    stamp = Stamp(message.header.stamp.sec, message.header.stamp.nanosec)
    assert all(one.stamp == stamp for one in found)
    assert {one.frame_id for one in found} <= {message.header.frame_id or SOURCE_FRAME}
    # Labels mean what they mean behind a source node.
    handed_on = MarkerArrayWriter(lambda key, text: None).write(
        frame._replace(frame_id=frame.frame_id or SOURCE_FRAME), stamp)
    through_node = MarkerReader(LABELS).read(handed_on)
    for _ in range(2):
        read = reader.read(data)
        if system is MARKERS_SYSTEM and len(anonymous) < len(message.markers) - len(frame.names):
            continue  # a node numbers points without a place otherwise
        assert all(map(same, read.positions, through_node.positions))
        if read.stamp is not None:
            assert read.stamp == through_node.stamp == stamp
            assert read.frame_id == through_node.frame_id


@pytest.mark.parametrize('name', SYSTEM_READERS)
def test_any_message_is_read_as_its_adapter_reads_it(name):
    system, strategy = SYSTEM_READERS[name]

    @settings(max_examples=150, deadline=None)
    @given(strategy)
    def check(message):
        check_against_adapter(system, message)

    check()


@pytest.mark.parametrize('count', LANDMARK_ORDERS)
@settings(max_examples=100, deadline=None)
@given(landmark_markers())
def test_any_markers_of_landmarks_are_read_as_their_adapter_reads_them(count, message):
    data = serialize_message(message)
    message = deserialize_message(data, MarkerArray)
    reader = MarkerReader(LABELS, kind=LANDMARK_MARKERS[count])
    named, anonymous, found = found_points(reader, data)
    assert not len(anonymous)
    try:
        frame = landmarks_of_markers(message, count)
    except MalformedFrame:
        assert not found and reader.read(data).stamp is None
        return
    nowhere = np.full(3, np.nan)
    assert all(same(named.pop(name, nowhere), at) for name, at in zip(frame.names, frame.markers))
    assert not named
    header = message.markers[0].header
    stamp = Stamp(header.stamp.sec, header.stamp.nanosec)
    assert {(one.stamp, one.frame_id) for one in found} == {
        (stamp, header.frame_id or SOURCE_FRAME)}
    handed_on = MarkerArrayWriter(lambda key, text: None).write(frame, stamp)
    through_node = MarkerReader(LABELS).read(handed_on)
    for _ in range(2):
        pairs = list(zip(reader.read(data).positions, through_node.positions))
        # Those that are no markers of the hand a node numbers otherwise.
        assert all(same(*pair) for pair, label in zip(pairs, LABELS.labels) if label != '1001')


@pytest.mark.parametrize('name', [POSES_SYSTEM.kind.type, CLOUD_SYSTEM.kind.type,
                                  NAMED_LANDMARKS.type])
def test_the_other_byte_order(name):
    if name == POINT_CLOUD.type:
        message = cloud(np.arange(24.).reshape(8, 3))
        kind = POINT_CLOUD
    else:
        types = TYPE_STORE.types
        at = types['geometry_msgs/msg/Quaternion'](x=0., y=0., z=0., w=1.)
        message = types[POSES_SYSTEM.kind.type](header=cloud(np.empty((0, 3))).header, poses=[
            types['geometry_msgs/msg/Pose'](
                position=types['geometry_msgs/msg/Point'](x=float(i), y=0., z=0.), orientation=at)
            for i in range(21)])
        kind = LANDMARK_POSES
    if name == NAMED_LANDMARKS.type:
        message = types[name](header=message.header, name=[f'left_{one}' for one in OPENXR][:21],
                              pose=message.poses, is_valid=np.arange(21) != 3)
        kind = NAMED_LANDMARKS
    frames = [MarkerReader(LabelMap(), kind=kind).points(bytes(
        TYPE_STORE.serialize_cdr(message, name, little_endian=little))) for little in (True, False)]
    one, other = ([(point.ns, point.id, point.stamp, *point.position) for point in points]
                  for points in frames)
    # As texts, of which those of NaN are equal.
    assert str(one) == str(other) and len(one) in (8, 21)


def landmark_message(points):
    return PoseArray(poses=[Pose(position=Point(**dict(zip('xyz', map(float, at)))))
                            for at in points])


@pytest.mark.parametrize('zero_is_missing', [True, False])
def test_one_landmark_at_the_origin_is_there_and_several_are_missing(zero_is_missing):
    points = np.arange(63.).reshape(21, 3) + 1.
    reader = MarkerReader(LabelMap(), zero_is_missing=zero_is_missing, kind=LANDMARK_POSES)
    points[0] = 0.
    found = reader.read(serialize_message(landmark_message(points))).positions
    np.testing.assert_allclose(found[0], 0., atol=1e-8)
    points[5] = 0.
    found = reader.read(serialize_message(landmark_message(points))).positions
    assert np.isnan(found[:2]).all() and np.isfinite(found[2:]).all()


def named_hands(points):
    """Return a NamedPoseArray of both hands with these points, and what is of none."""
    names = [*OPENXR][:21]
    return NamedPoseArray(
        name=['HEAD', *(f'{side}_{name}' for side in SIDES for name in names), 'left_HEEL'],
        pose=[Pose(), *2 * landmark_message(points).poses, Pose(position=Point(x=1.))],
        is_valid=[True] * 44)


def test_landmarks_at_the_origin_are_told_apart_by_their_hand():
    points = np.arange(63.).reshape(21, 3) + 1.
    points[0] = 0.
    message = named_hands(points)
    for side in SIDES:
        reader = MarkerReader(LabelMap(), kind=kind_of_hand(NAMED_LANDMARKS, side))
        found = np.array([one.position for one in reader.points(serialize_message(message))])
        np.testing.assert_allclose(found, points, atol=1e-8)
    message.pose[5] = Pose()    # of the right hand
    for side in SIDES:
        reader = MarkerReader(LabelMap(), kind=kind_of_hand(NAMED_LANDMARKS, side))
        found = [one.position for one in reader.points(serialize_message(message))]
        assert np.flatnonzero(np.isnan(found).any(axis=1)).tolist() == (
            [0, 4] if side == 'right' else [])
    both = MarkerReader(LabelMap(), kind=NAMED_LANDMARKS).points(serialize_message(message))
    assert [one.ns for one in both] == [
        f'{side}_{OPENXR[name]}' for side in SIDES for name in [*OPENXR][:21]]


def test_one_marker_at_the_origin_is_the_wrist_and_several_are_missing():
    markers = [ArrayMarker(type=2, id=number, pose=pose)
               for number, pose in enumerate(landmark_message(np.ones((21, 3))).poses)]
    reader = MarkerReader(LabelMap(), kind=LANDMARK_MARKERS[21])
    markers[0].pose.position = Point()
    # Neither a list at the origin nor a marker of another id is a landmark.
    others = [ArrayMarker(type=7, id=3, points=[Point()]), ArrayMarker(type=2, id=26)]
    found = reader.read(serialize_message(MarkerArray(markers=markers + others))).positions
    np.testing.assert_allclose(found[0], 0., atol=1e-8)
    markers[8].pose.position = Point()
    found = reader.read(serialize_message(MarkerArray(markers=markers))).positions
    assert np.isnan(found[0]).all() and np.isfinite(found[1:]).all()


@pytest.mark.parametrize('preset', ['mediapipe21', 'openxr26', 'dfki13'])
def test_landmarks_and_names_are_the_markers_of_the_layout(preset):
    layout = preset_layout(preset)
    labels = LabelMap(default_labels(layout.names), layout.names)
    alone = [row for row, place in enumerate(layout.places) if layout.places.count(place) == 1]
    assert len(alone) >= 8
    order = LANDMARK_ORDERS[26]
    points = 1. + np.arange(78.).reshape(26, 3)
    expected = [points[order.index(layout.places[row])] for row in alone]
    reader = MarkerReader(labels, kind=LANDMARK_POSES, ids=layout_ids(layout))
    found = reader.read(serialize_message(landmark_message(points))).positions
    np.testing.assert_array_equal(found[alone], expected)
    names = [f'RHand:{name.upper()}' for name in layout.names]
    points = 1. + np.arange(3. * len(names)).reshape(-1, 3)
    frame = SourceFrame(None, 'mocap', tuple(names), points, np.empty((0, 3)))
    data = MarkerArrayWriter(lambda key, text: None, layout_ids(layout)).write(frame, Stamp(1, 2))
    np.testing.assert_array_equal(MarkerReader(labels).read(data).positions, points)


def test_other_numbers_of_names_are_refused():
    message = named_hands(np.ones((21, 3)))
    message.is_valid = message.is_valid[1:]
    reader = MarkerReader(LabelMap(), kind=NAMED_LANDMARKS)
    said = 'NamedPoseArray: 44 names, 44 poses, 43 validities; expected as many of each'
    with pytest.raises(MalformedMessage, match=said):
        reader.read(serialize_message(message))
    with pytest.raises(MalformedMessage, match='0 names, 44 poses, 43 validities'):
        message.name = []
        list(reader.points(serialize_message(message)))


def named_markers(names):
    return [Marker(marker_name=name, translation=Point(x=1. + row, y=2., z=3.))
            for row, name in enumerate(names)]


def read_markers(reader, names):
    """Return the coordinates x of the hand's markers in a message of named markers."""
    return reader.read(serialize_message(Markers(markers=named_markers(names)))).positions[:, 0]


@pytest.mark.parametrize('names', [MARKERS, PAPER_PLACES, [f'RHand:{name}' for name in MARKERS]])
def test_the_tracker_takes_markers_by_their_names(names):
    reader = MarkerReader(LabelMap(), kind=MOCAP4R2_MARKERS)
    np.testing.assert_array_equal(read_markers(reader, names), np.arange(1., 9.))
    np.testing.assert_array_equal(read_markers(reader, names[::-1]), np.arange(8., 0., -1.))


def test_a_second_subject_is_remembered_and_told():
    said = {}
    reader = MarkerReader(LabelMap(), kind=MOCAP4R2_MARKERS, warn_once=said.setdefault)
    alone = ['RHand:index', 'RHand:thumb']
    assert np.flatnonzero(np.isfinite(read_markers(reader, alone))).tolist() == [3, 7]
    assert not said
    both = [*alone, 'LHand:index', 'RHand:thumb']
    assert np.flatnonzero(np.isfinite(read_markers(reader, both))).tolist() == [7]
    assert 'subject' in said['subjects'] and "called 'RHand:thumb'" in said['doubled']
    # The layout without it was read before; the names are no clearer for that.
    assert np.flatnonzero(np.isfinite(read_markers(reader, alone))).tolist() == [7]


def test_a_flood_of_points_is_cut():
    for points in (np.ones((MOST_MARKERS + 1, 3)), np.ones((MOST_MARKERS, 3))):
        said = {}
        reader = MarkerReader(LabelMap(), kind=POINT_CLOUD, warn_once=said.setdefault)
        data = bytes(TYPE_STORE.serialize_cdr(cloud(points), POINT_CLOUD.type))
        assert len(list(reader.points(data))) == MOST_MARKERS
        assert 'anonymous points' in said['points']


# --- hostile bytes

def plain(kernel):
    """Return a kernel as plain Python, with those that it calls."""
    function = getattr(kernel, 'py_func', kernel)
    names = {name: function.__globals__[name] for name in function.__code__.co_names
             if name in function.__globals__}
    return FunctionType(function.__code__, {
        **function.__globals__, **{name: plain(value) for name, value in names.items()
                                   if hasattr(value, 'py_func')}})


PLAIN_PARSER = plain(parse_points)


class Words:
    """Words of a message, of which none beyond its end or before its start is read."""

    def __init__(self, words):
        self._words = memoryview(words)

    def __getitem__(self, at):
        assert at >= 0
        return self._words[at]


class Octets(np.ndarray):
    """The same of bytes."""

    def __getitem__(self, at):
        assert isinstance(at, slice) or 0 <= at < len(self)
        return super().__getitem__(at)


def parse_plainly(parser, data):
    """Parse in plain Python, where a place beyond the message is an error."""
    size = len(data) - ENCAPSULATION
    octets = np.frombuffer(data, np.uint8, offset=ENCAPSULATION).view(Octets)
    numbers = np.zeros(number_capacity(size))
    numbers.view(np.uint8)[:size] = octets
    words = Words(numbers.view(np.int32)[:size // 4])
    count = point_capacity(size)
    return PLAIN_PARSER(parser, octets, words, numbers, size, np.zeros((count, 5), np.int32),
                        np.zeros((count, 3), np.int64), np.zeros(size, np.uint8))


def survive(kind, data):
    """Read bytes that may be anything; return whether they were taken for a message."""
    found = parse_plainly(kind.parser, data)[0] if len(data) > ENCAPSULATION else -1
    reader = MarkerReader(LABELS, kind=kind)
    try:
        frame = reader.read(data)
    except MalformedMessage:
        assert (found < 0 or kind is LANDMARK_POSES and found not in (0, *LANDMARK_ORDERS)
                or kind is NAMED_LANDMARKS and found == 1)
        return False
    assert found >= 0
    assert frame.positions.shape == (8, 3)
    return True


def whole_message(kind):
    """Return the bytes of a message that leaves no sequence empty."""
    some = named_markers(['index', 'ä', '']) + [Marker(id_type=1, marker_index=7)]
    message = {
        MOCAP4R2_MARKERS.type: Markers(markers=some),
        RIGID_BODIES.type: RigidBodies(rigidbodies=[
            RigidBody(rigid_body_name=name, markers=some[:count])
            for name, count in (('RHand', 4), ('', 0), ('cup', 2))]),
        LANDMARK_POSES.type: landmark_message(np.arange(63.).reshape(21, 3)),
        NAMED_LANDMARKS.type: named_hands(np.arange(63.).reshape(21, 3)),
        MARKER_ARRAY: MarkerArray(markers=[
            ArrayMarker(type=2, id=number, ns='x', points=[Point()], pose=pose)
            for number, pose in enumerate(landmark_message(np.arange(15.).reshape(5, 3)).poses)])
    }.get(kind.type)
    if message is None:
        made = cloud(np.arange(24.).reshape(8, 3), ('rgb', 'x', 'y', 'z'), height=2, row_padding=3)
        return bytes(TYPE_STORE.serialize_cdr(made, kind.type))
    header = message.markers[0].header if kind.type == MARKER_ARRAY else message.header
    header.frame_id = 'mocap'
    return serialize_message(message)


KINDS = {kind.type: kind for kind in (MOCAP4R2_MARKERS, RIGID_BODIES, LANDMARK_POSES, POINT_CLOUD,
                                      NAMED_LANDMARKS, LANDMARK_MARKERS[21])}


@pytest.mark.parametrize('name', KINDS)
def test_every_truncation_is_refused(name):
    kind = KINDS[name]
    data = whole_message(kind)
    assert survive(kind, data)
    # rclpy leaves space at the end that holds nothing.
    end = max(i for i in range(len(data)) if not survive(kind, data[:i])) + 1
    assert len(data) - end < 16
    assert not any(survive(kind, data[:i]) for i in range(end))


@pytest.mark.parametrize('name', KINDS)
def test_hostile_lengths_and_counts_are_survived(name):
    kind = KINDS[name]
    whole = whole_message(kind)

    @settings(max_examples=300, deadline=None)
    @given(st.lists(st.tuples(st.integers(0, len(whole) // 4 - 2), st.sampled_from(
        [-1, -2**31, 2**31 - 1, 2**30, 2**16, 1000, 100, 25, 5, 1, 0])), min_size=1, max_size=5),
        st.integers(0, 40))
    def check(changes, cut):
        data = bytearray(whole)
        for at, value in changes:
            data[4 * at + ENCAPSULATION:4 * at + ENCAPSULATION + 4] = struct.pack('<i', value)
        survive(kind, bytes(data[:len(data) - cut]))

    check()


@pytest.mark.parametrize('name', KINDS)
def test_random_bytes_are_survived(name):
    kind = KINDS[name]

    @settings(max_examples=200, deadline=None)
    @given(st.binary(max_size=400), st.sampled_from([b'', b'\0\1\0\0', b'\0\0\0\0']))
    def check(junk, head):
        survive(kind, head + junk)

    check()


def test_what_is_too_much_for_the_memory_is_refused():
    # Of MarkerArrays no message has more than the memory that it is given.
    kinds = [(kind, whole_message(kind)) for kind in KINDS.values() if kind.type != MARKER_ARRAY]
    for kind, data in kinds:
        size = len(data) - ENCAPSULATION
        numbers = np.zeros(number_capacity(size))
        octets = numbers.view(np.uint8)
        octets[:size] = np.frombuffer(data, np.uint8, offset=ENCAPSULATION)
        count, _ = parse_points(
            kind.parser, octets, numbers.view(np.int32), numbers, size,
            np.zeros((3, 5), np.int32), np.zeros((3, 3), np.int64), np.zeros(size, np.uint8))
        assert count == -1


def test_the_error_names_the_message():
    for kind in KINDS.values():
        with pytest.raises(MalformedMessage, match=f'10 bytes that are no {kind.title}'):
            cdr.MarkerReader(LABELS, kind=kind).read(
                b'\0\1\0\0' + (b'\1' if kind.type == MARKER_ARRAY else b'\0') * 6)
    assert message_kinds.PARSE_MARKER_ARRAY == 0


@pytest.mark.filterwarnings('error')
def test_landmarks_of_signalling_nan_are_missing_without_a_warning():
    signalling = np.frombuffer(bytes.fromhex('010000000000f07f'))[0]
    points = np.array([[signalling] * 3, [0., 0., 0.], [0., 0., 0.], [0., .1, 0.]])
    found = mark_missing(points)
    assert np.isnan(found[:3]).all() and np.array_equal(found[3], (0., .1, 0.))
