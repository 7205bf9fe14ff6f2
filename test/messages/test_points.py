"""All points of a MarkerArray, of bytes and of message objects."""

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point
from rclpy.serialization import serialize_message
from visualization_msgs.msg import Marker, MarkerArray

from hand_tracker.messages.cdr import MalformedMessage
from hand_tracker.messages.points import PointReader

NEEDS = 'rclpy',


def marker(number, place, ns='', frame='mocap', kind=Marker.SPHERE, points=(), action=Marker.ADD):
    one = Marker(ns=ns, id=number, type=kind, action=action, points=[
        Point(x=float(x), y=float(y), z=float(z)) for x, y, z in points])
    one.header.frame_id, one.header.stamp = frame, Time(sec=5, nanosec=7)
    one.pose.position.x, one.pose.position.y, one.pose.position.z = map(float, place)
    one.pose.orientation.w = 1.
    return one


MESSAGE = MarkerArray(markers=[
    marker(0, (0, 0, 0), action=Marker.DELETEALL),
    marker(3, (1, 2, 3)), marker(4, (4, 5, 6), kind=Marker.TEXT_VIEW_FACING),
    marker(5, (0, 0, 0)), marker(6, (7, 8, 9), frame='elsewhere'),
    marker(7, (10, 0, 0), ns='cloud', kind=Marker.POINTS, points=((1, 1, 1), (2, 2, 2)))])


@pytest.mark.parametrize('message', (MESSAGE, serialize_message(MESSAGE)),
                         ids=('object', 'bytes'))
def test_all_points_are_read_whatever_their_labels(message):
    reader = PointReader(scale=.001)
    frame = reader.read(message)
    assert frame.frame_id == 'mocap'
    assert frame.foreign == ('elsewhere',)
    assert (frame.stamp.sec, frame.stamp.nanosec) == (5, 7)
    expected = 1e-3 * np.array(((1, 2, 3), (np.nan,) * 3, (11, 1, 1), (12, 2, 2)))
    assert np.allclose(frame.points, expected, rtol=0, atol=1e-12, equal_nan=True)
    assert len(set(frame.ids.tolist())) == 4
    assert np.array_equal(reader.read(message).ids, frame.ids)


def test_a_message_without_points_has_no_stamp():
    frame = PointReader().read(serialize_message(MarkerArray()))
    assert frame.stamp is None
    assert frame.points.shape == (0, 3)


def test_other_bytes_are_refused():
    with pytest.raises(MalformedMessage, match='no MarkerArray'):
        PointReader().read(b'\0\1\0\0' + b'\7' * 40)
