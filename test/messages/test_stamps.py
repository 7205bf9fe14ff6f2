"""Stamps rewritten in the bytes are those of the message, and nothing else changes."""

import struct

import numpy as np
import pytest

from hand_tracker.files.bags import MARKER_ARRAY, TYPE_STORE, bag_message, joint_state_message
from hand_tracker.messages.stamps import header_stamp, marker_stamps, restamp

LATEST_STAMP = 2**31 * 10**9  # an int32 of seconds [ns]


def make(name, *fields):
    return TYPE_STORE.types[name](*fields)


def header(stamp, frame_id):
    time = make('builtin_interfaces/msg/Time', *divmod(stamp, 10**9))
    return make('std_msgs/msg/Header', time, frame_id)


def random_array(rng, stamp):
    """Return a MarkerArray with every field of variable length at random."""
    def text():
        return 'x' * rng.integers(9)

    def some(item):
        return [item] * rng.integers(3)

    def blob():
        return rng.integers(256, size=rng.integers(6), dtype=np.uint8)

    point = make('geometry_msgs/msg/Point', 1., 2., 3.)
    turn = make('geometry_msgs/msg/Quaternion', 0., 0., 0., 1.)
    color = make('std_msgs/msg/ColorRGBA', .1, .2, .3, .4)
    return make(MARKER_ARRAY, [make(
        'visualization_msgs/msg/Marker', header(stamp, text()), text(), index, 2, 0,
        make('geometry_msgs/msg/Pose', point, turn), make('geometry_msgs/msg/Vector3', 1., 1., 1.),
        color, make('builtin_interfaces/msg/Duration', 1, 2), bool(index % 2), some(point),
        some(color), text(), make('sensor_msgs/msg/CompressedImage', header(5, text()), text(),
                                  blob()),
        some(make('visualization_msgs/msg/UVCoordinate', .5, .5)), text(), text(),
        make('visualization_msgs/msg/MeshFile', text(), blob()), True)
        for index in range(rng.integers(6))])


@pytest.mark.parametrize('little_endian', [True, False])
def test_marker_array(little_endian):
    for seed in range(100):
        old, new = np.random.default_rng(seed).integers(LATEST_STAMP, size=2).tolist()
        before, after = (
            bytes(TYPE_STORE.serialize_cdr(random_array(np.random.default_rng(seed), stamp),
                                      MARKER_ARRAY, little_endian=little_endian))
            for stamp in (old, new))
        assert restamp(before, marker_stamps(before), new) == after


def test_array_written_by_ros():
    serialization = pytest.importorskip('rclpy.serialization')
    from visualization_msgs.msg import Marker, MarkerArray

    array = MarkerArray(markers=[Marker(ns='a', text='knuckle'), Marker(id=3)])
    data = serialization.serialize_message(array)
    written = serialization.deserialize_message(
        restamp(data, marker_stamps(data), 3 * 10**9 + 4), MarkerArray)
    assert [(m.header.stamp.sec, m.header.stamp.nanosec) for m in written.markers] == [(3, 4)] * 2
    for marker in array.markers:
        marker.header.stamp.sec, marker.header.stamp.nanosec = 3, 4
    assert written == array


def test_message_that_begins_with_a_header():
    old, new = (bag_message('/j', 0, joint_state_message(stamp, ['a'], [1.])).data
                for stamp in (7, 3 * 10**9 + 9))
    assert restamp(old, header_stamp(old), 3 * 10**9 + 9) == new


def test_cut_off_message():
    data = bytes(TYPE_STORE.serialize_cdr(random_array(np.random.default_rng(3), 0), MARKER_ARRAY))
    for length in (2, 6, 12, len(data) // 2):
        with pytest.raises((struct.error, IndexError)):
            marker_stamps(data[:length])
