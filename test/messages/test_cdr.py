"""The codec: the same as the normal way, for every message; hostile bytes are refused."""

import struct
import time

import numpy as np
import pytest
import rclpy
from builtin_interfaces.msg import Time
from helpers.hands import rest_state
from helpers.markers import MARKER_POSITIONS, STAMP, big_endian, data_of, eight, marker
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray, UVCoordinate

from hand_tracker.core.numerics.quaternion import quaternion
from hand_tracker.core.tracker import HandTracker
from hand_tracker.messages import marker_array_parser, sequences
from hand_tracker.messages.builders import joint_state, prefixed_names
from hand_tracker.messages.cdr import (
    ENCAPSULATION,
    SIGNATURES_KEPT,
    SMALLEST_POINT,
    MalformedMessage,
    MarkerReader,
)
from hand_tracker.messages.labels import LabelMap
from hand_tracker.messages.marker_array import markers_from_message, placed
from hand_tracker.messages.marker_array_parser import parse_marker_array
from hand_tracker.messages.stamps import Stamp
from hand_tracker.messages.templates import joint_state_template, transforms_template
from hand_tracker.nodes import serialization

NEEDS = 'rclpy', 'visualization_msgs'

LABELS = LabelMap(['0', '1', 'leds/2', '3', 'b/*', '5', '', 'leds/7'])
PLAIN_WALK = getattr(parse_marker_array, 'py_func', parse_marker_array)


def read(markers, labels=LABELS, **options):
    """Return what the codec reads of a message of these markers."""
    return MarkerReader(labels, **options).read(data_of(markers))


def check(frame, expected):
    """Check that two frames are the same."""
    assert (frame.stamp is None) == (expected.stamp is None)
    if frame.stamp is not None:
        assert frame.stamp == (expected.stamp.sec, expected.stamp.nanosec)
    assert np.array_equal(frame.positions, expected.positions, equal_nan=True)
    assert frame.frame_id == expected.frame_id
    assert frame[3:] == expected[3:]


# --- markers in

numbers = st.one_of(st.floats(), st.sampled_from([0., -0., 1., np.nan]))
positions = st.tuples(numbers, numbers, numbers)
texts = st.one_of(st.sampled_from(['', 'leds', 'b', 'mocap', 'ä']), st.text(
    st.characters(exclude_categories=['Cs'], exclude_characters='\0'), max_size=9))
int32 = st.integers(-2**31, 2**31 - 1)


@st.composite
def any_marker(draw):
    """Return a marker of which every field may be anything."""
    message = marker(
        draw(st.one_of(st.integers(-1, 8), int32)), draw(positions), draw(texts),
        draw(st.sampled_from(['', 'mocap', 'mocap', 'base', 'x' * 5])),
        draw(st.one_of(st.integers(0, 12), int32)),
        draw(st.sampled_from([0, 0, 0, 0, 1, 2, 3, -1])),
        Time(sec=draw(int32), nanosec=draw(st.integers(0, 2**32 - 1))),
        draw(st.lists(positions, max_size=9)))
    message.pose.orientation.x = draw(numbers)
    message.pose.orientation.w = draw(numbers)
    message.colors = [ColorRGBA()] * draw(st.integers(0, 2))
    message.uv_coordinates = [UVCoordinate()] * draw(st.integers(0, 2))
    message.texture_resource, message.text = draw(texts), draw(texts)
    message.mesh_resource, message.mesh_file.filename = draw(texts), draw(texts)
    message.texture.header.frame_id, message.texture.format = draw(texts), draw(texts)
    message.texture.data = draw(st.binary(max_size=5))
    message.mesh_file.data = draw(st.binary(max_size=5))
    message.mesh_use_embedded_materials = draw(st.booleans())
    return message


@pytest.mark.filterwarnings('ignore::RuntimeWarning')
@settings(max_examples=300, deadline=None)
@given(st.lists(any_marker(), max_size=12), st.sampled_from(['', 'mocap']),
       st.sampled_from([1., .001, 1e3]), st.booleans())
def test_any_message_is_read_as_message_objects_are(markers, frame_id, scale, zero):
    options = dict(frame_id=frame_id, scale=scale, zero_is_missing=zero)
    data = data_of(markers)
    # rclpy sees strings that DDS has cut or mended.
    expected = markers_from_message(deserialize_message(data, MarkerArray), LABELS, **options)
    reader = MarkerReader(LABELS, **options)
    check(reader.read(data), expected)
    check(reader.read(data), expected)


def test_phasespace_message_with_texts_that_change():
    reader = MarkerReader(LabelMap())
    for i in range(3):
        message = [marker(0, (0, 0, 0), frame='', action=Marker.DELETEALL, stamp=Time())]
        for sphere in eight(MARKER_POSITIONS + i, ns='leds'):
            message += [sphere, marker(sphere.id, ns='ids', kind=Marker.TEXT_VIEW_FACING)]
            message[-1].text = 'x' * i
        frame = reader.read(data_of(message))
        assert np.array_equal(frame.positions, MARKER_POSITIONS + i)
        assert (frame.stamp, frame.frame_id, frame.doubled) == (
            (STAMP.sec, STAMP.nanosec), 'mocap', ())


def test_what_lies_between_the_fields_does_not_matter():
    data = np.frombuffer(data_of(eight(ns='leds')), np.uint8).copy()
    reader = MarkerReader(LabelMap())
    reader.read(data.tobytes())
    end_of_frame = data.tobytes().index(b'mocap\0') + 6
    data[end_of_frame:end_of_frame + 2] = 170
    assert np.array_equal(reader.read(data.tobytes()).positions, MARKER_POSITIONS)
    assert len(reader._sources) == 1


def test_a_list_of_points_and_markers_in_one_message():
    cloud = marker(0, (1., 2., 3.), kind=Marker.POINTS, points=MARKER_POSITIONS)
    cloud.pose.orientation.z = 1.
    message = [cloud, marker(3, (9., 9., 9.)), marker(1, (0., 0., 0.))]
    expected = markers_from_message(MarkerArray(markers=message), LabelMap(), scale=.001)
    check(read(message, LabelMap(), scale=.001), expected)
    assert expected.doubled == (1, 3)


def test_the_other_byte_order():
    message = [*eight(ns='leds'), marker(9, ns='ö')]
    check(MarkerReader(LabelMap()).read(big_endian(message)),
          markers_from_message(MarkerArray(markers=message), LabelMap()))


def test_strings_end_at_their_first_nul():
    data = data_of(eight(ns='leds')).replace(b'leds\0', b'le\0s\0').replace(b'mocap\0', b'mocapx')
    assert MarkerReader(LabelMap(['le/0', *'1234567'])).read(data).frame_id == 'mocapx'


def test_kinds_of_messages_are_remembered_within_bounds():
    reader = MarkerReader(LabelMap())
    for i in range(SIGNATURES_KEPT + 10):
        reader.read(data_of(eight(ns=f'{i}')))
    assert len(reader._sources) <= SIGNATURES_KEPT
    crowd = [marker(100 + i, (1, 1, 1), ns='x' * 100) for i in range(1000)]
    reader = MarkerReader(LabelMap())
    assert len(reader.read(data_of([*crowd, *eight()])).unknown) == 8
    assert not reader._sources


# --- hostile bytes

class Words:
    """Words of a message that count how often they are read."""

    def __init__(self, words):
        self._words = memoryview(words)
        self.reads = 0

    def __getitem__(self, at):
        self.reads += 1
        return self._words[at]


def walk_plainly(data, words=None):
    """Walk in plain Python, where a place beyond the end is an error."""
    size = len(data) - ENCAPSULATION
    octets = np.frombuffer(data, np.uint8, offset=ENCAPSULATION)
    if words is None:
        words = memoryview(np.frombuffer(data, np.int32, size // 4, ENCAPSULATION))
    most = size // SMALLEST_POINT + 1
    return PLAIN_WALK(octets, words, size, np.zeros((most, 5), np.int32),
                      np.zeros((most, 3), np.int64), np.zeros(size, np.uint8))


def survive(data):
    """Read bytes that may be anything; return whether they were taken for a message."""
    if len(data) > ENCAPSULATION:
        found = walk_plainly(data)[0]
    try:
        frame = MarkerReader(LABELS).read(data)
    except MalformedMessage:
        return False
    assert found >= 0
    assert frame.positions.shape == (8, 3)
    return True


def whole_message():
    """Return the bytes of a message that leaves no sequence empty."""
    return serialize_message(serialization._sample_markers())


def test_every_truncation_is_refused():
    data = whole_message()
    markers = MarkerReader(LABELS)
    markers.read(data)
    # rclpy leaves space at the end that holds nothing.
    end = max(i for i in range(len(data)) if not survive(data[:i])) + 1
    assert len(data) - end < 16
    for i in range(end):
        with pytest.raises(MalformedMessage, match=f'^{i} bytes'):
            markers.read(data[:i])


@settings(max_examples=500, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 1500), st.sampled_from(
    [-1, -2**31, 2**31 - 1, 2**30, 2**16, 1000, 100, 25, 5, 1, 0])), min_size=1, max_size=5))
def test_hostile_lengths_and_counts_are_survived(changes):
    data = bytearray(whole_message())
    for at, value in changes:
        at = 4 * (at % (len(data) // 4 - 1)) + ENCAPSULATION
        if at + 4 <= len(data):
            data[at:at + 4] = struct.pack('<i', value)
    survive(bytes(data))


@settings(max_examples=300, deadline=None)
@given(st.binary(max_size=700), st.sampled_from([b'', b'\0\1\0\0', b'\0\0\0\0']))
def test_random_bytes_are_survived(junk, head):
    survive(head + junk)


@pytest.mark.parametrize('count', [2**31 - 1, 2**32 - 1, 10**6])
def test_huge_counts_are_refused_at_once(monkeypatch, count):
    for name in ('aligned', 'counted', 'after'):
        kernel = getattr(sequences, name)
        for module in sequences, marker_array_parser:
            monkeypatch.setattr(module, name, getattr(kernel, 'py_func', kernel))
    data = bytearray(data_of(eight()))
    data[4:8] = struct.pack('<I', count)
    with pytest.raises(MalformedMessage):
        MarkerReader(LABELS).read(bytes(data))
    words = Words(np.frombuffer(data, np.int32, (len(data) - ENCAPSULATION) // 4, ENCAPSULATION))
    assert walk_plainly(bytes(data), words)[0] == -1
    assert words.reads <= len(data)


@pytest.mark.parametrize('head', [b'', b'\0', b'\0\1\0', b'\0\2\0\0', b'\0\7\0\0', b'\1\1\0\0'])
def test_other_encodings_are_refused(head):
    with pytest.raises(MalformedMessage, match='bytes'):
        MarkerReader(LABELS).read(head + (data_of(eight())[4:] if len(head) == 4 else b''))


def test_a_reader_goes_on_after_what_it_refused():
    reader = MarkerReader(LabelMap())
    with pytest.raises(MalformedMessage):
        reader.read(data_of(eight(ns='l' * 1000))[:-100])
    for markers in (eight(), eight(MARKER_POSITIONS + 1.)[:5], eight(ns='l' * 10000)):
        check(reader.read(data_of(markers)),
              markers_from_message(MarkerArray(markers=markers), LabelMap()))


# --- templates

stamps = st.builds(Stamp, int32, st.integers(0, 2**32 - 1))


@settings(max_examples=100, deadline=None)
@given(st.lists(st.tuples(stamps, st.lists(numbers, min_size=25, max_size=25)), min_size=1,
                max_size=3), st.text(st.characters(exclude_categories=['Cs'],
                                                   exclude_characters='\0'), max_size=9))
def test_joint_states_are_the_messages(frames, prefix):
    names = prefixed_names(prefix)
    effort = [] if len(prefix) % 2 else frames[0][1]
    template = joint_state_template(names.joints, effort)
    for stamp, angles in frames:
        message = deserialize_message(template.fill(stamp, angles), JointState)
        expected = joint_state(stamp, names.joints, angles, effort)
        assert message.header == expected.header
        assert list(message.name) == list(names.joints)
        assert np.array_equal(message.position, expected.position, equal_nan=True)
        assert len(message.velocity) == 0
        assert np.array_equal(message.effort, expected.effort, equal_nan=True)
        assert np.array_equal(message.effort, effort, equal_nan=True)


def test_published_bytes_are_no_longer_changed():
    template = joint_state_template(('a',))
    first = template.fill(Stamp(1, 2), [3.])
    template.fill(Stamp(4, 5), [6.])
    assert deserialize_message(first, JointState).position[0] == 3.


@settings(max_examples=100, deadline=None)
@given(stamps, st.lists(st.tuples(texts, texts, positions), max_size=30))
def test_transforms_are_the_messages(stamp, rows):
    kind = pytest.importorskip('tf2_msgs.msg', reason='needs tf2_msgs').TFMessage
    turn = np.array(((0., -1., 0.), (1., 0., 0.), (0., 0., 1.)))
    numbers = np.array([(*at, *quaternion(turn)) for _, _, at in rows])
    template = transforms_template([row[:2] for row in rows])
    message = deserialize_message(
        template.fill(stamp, numbers.ravel()), kind)
    assert len(message.transforms) == len(rows)
    for sent, (parent, child, at) in zip(message.transforms, rows):
        assert (sent.header.frame_id, sent.child_frame_id) == (parent, child)
        assert (sent.header.stamp.sec, sent.header.stamp.nanosec) == stamp
        to, q = sent.transform.translation, sent.transform.rotation
        assert np.array_equal((to.x, to.y, to.z), at, equal_nan=True)
        assert (q.x, q.y, q.z, q.w) == quaternion(turn)


# --- the choice

def test_the_codec_agrees_with_rclpy_here():
    assert serialization.codec_agrees()


@pytest.mark.parametrize('at', [4, 60, 200])
def test_another_layout_is_noticed(monkeypatch, at):
    def other(message):
        data = serialize_message(message)
        return data[:at] + bytes(8) + data[at:]

    monkeypatch.setattr(serialization, 'serialize_message', other)
    assert not serialization.codec_agrees()


def test_another_layout_of_what_goes_out_is_noticed(monkeypatch):
    monkeypatch.setattr(
        serialization, 'joint_state_template', lambda names, effort: joint_state_template(
            names[::-1], effort))
    assert not serialization.codec_agrees()


@pytest.mark.parametrize('agrees', [True, False])
def test_a_node_publishes_the_same_either_way(monkeypatch, agrees):
    from hand_tracker.messages.templates import JOINT_STATES
    from hand_tracker.nodes.tracker_node import TrackerNode
    hand = rest_state().markers + 1.  # none at zero, which is a lost one
    warnings, published = [], []
    monkeypatch.setattr(serialization, 'codec_agrees', lambda: agrees)
    rclpy.init()
    monkeypatch.setattr('rclpy.impl.rcutils_logger.RcutilsLogger.warning',
                        lambda self, text, **_: warnings.append(text) or True)
    node = TrackerNode()
    try:
        markers, = node.inputs
        publisher = markers.replies._publishers[JOINT_STATES, 0]
        monkeypatch.setattr(publisher, 'publish', published.append)
        message = MarkerArray(markers=eight(hand))
        markers._track(serialize_message(message) if agrees else message, time.monotonic())
    finally:
        node.destroy_node()
        rclpy.shutdown()
    sent, = published
    assert isinstance(sent, bytes) == agrees
    if agrees:
        sent = deserialize_message(sent, JointState)
    assert sent.header.stamp == STAMP
    assert np.allclose(sent.position, HandTracker().update(hand).angles, rtol=0, atol=1e-6)
    assert len([text for text in warnings if 'codec' in text]) == (not agrees)


@pytest.mark.parametrize('length', (1e-160, 2., 1e160))
def test_an_orientation_of_any_length_turns_the_points_of_a_list(length):
    turned = placed(np.array([[1., 2., 3.]]), (0., 0., 1.), (0., 0., length, 0.), True)
    assert np.allclose(turned, [[-1., -2., 4.]])
