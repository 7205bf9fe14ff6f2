"""Markers as ROS messages, and as bytes."""

import struct

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point
from rclpy.serialization import serialize_message
from visualization_msgs.msg import Marker, MarkerArray

STAMP = Time(sec=12, nanosec=345)
MARKER_POSITIONS = np.arange(24.).reshape(8, 3) / 100. + .01


def marker(number, position=(1., 2., 3.), ns='', frame='mocap', kind=Marker.SPHERE,
           action=Marker.ADD, stamp=STAMP, points=()):
    """Return one marker of a message."""
    message = Marker(ns=ns, id=number, type=kind, action=action)
    message.header.frame_id = frame
    message.header.stamp = stamp
    at = message.pose.position
    at.x, at.y, at.z = map(float, position)
    message.pose.orientation.w = 1.
    message.points = [Point(x=float(x), y=float(y), z=float(z)) for x, y, z in points]
    return message


def eight(positions=MARKER_POSITIONS, **fields):
    """Return the markers of a whole hand."""
    return [marker(i, position, **fields) for i, position in enumerate(positions)]


def data_of(markers):
    """Return the bytes of a message of these markers."""
    return serialize_message(MarkerArray(markers=markers))


def big_endian(markers):
    """Return the bytes of plain markers from a machine of the other byte order."""
    body = bytearray()

    def put(form, *values):
        alignment = struct.calcsize(form[-1])
        body.extend(bytes(-len(body) % alignment))
        body.extend(struct.pack('>' + form, *values))

    def text(string):
        put('I', len(string) + 1)
        body.extend(string.encode() + b'\0')

    put('I', len(markers))
    for each in markers:
        stamp, at = each.header.stamp, each.pose.position
        put('i', stamp.sec)
        put('I', stamp.nanosec)
        text(each.header.frame_id)
        text(each.ns)
        put('3i', each.id, each.type, each.action)
        put('10d', at.x, at.y, at.z, 0., 0., 0., 1., 1., 1., 1.)
        put('4f', 1., 1., 1., 1.)
        put('2I', 0, 0)
        put('?', False)
        for _ in range(2):
            put('I', 0)  # points, colors
        text('')
        put('2I', 0, 0)
        text('')
        text('')
        put('2I', 0, 0)
        text('')
        text('')
        text('')
        put('I', 0)
        put('?', False)
    return b'\0\0\0\0' + bytes(body)
