"""Serialized JointStates are read as rclpy reads them; damaged ones are refused."""

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState

from hand_tracker.messages.cdr import MalformedMessage
from hand_tracker.messages.joint_states import JointStateReader
from hand_tracker.messages.stamps import Stamp
from hand_tracker.messages.templates import joint_state_template

NEEDS = 'rclpy',


def message(names, count=None, frame='', more=0):
    found = JointState(name=names, position=[.1 * i for i in range(
        len(names) if count is None else count)], velocity=[7.] * more, effort=[9.] * more)
    found.header.frame_id = frame
    found.header.stamp.sec, found.header.stamp.nanosec = -3, 2**31 + 5
    return found


@pytest.mark.parametrize('one', [
    message([]), message(['a']), message(['ab', 'c'], frame='base'), message(['x'] * 25, more=25),
    message(['abc', 'de'], 0), message(['abc'], 3), message(['é', 'joint_1.0'])])
def test_all_is_read_as_by_rclpy(one):
    reader = JointStateReader()
    for _ in range(2):
        stamp, names, positions, effort = reader.read(serialize_message(one))
        assert stamp == Stamp(-3, 2**31 + 5) and list(names) == list(one.name)
        np.testing.assert_array_equal(positions, one.position)
        np.testing.assert_array_equal(effort, one.effort)


def test_names_that_change_are_read_anew():
    reader = JointStateReader()
    first = reader.read(serialize_message(message(['a', 'b'])))
    again = reader.read(serialize_message(message(['a', 'b'])))
    assert again.names is first.names
    assert reader.read(serialize_message(message(['b', 'a']))).names == ('b', 'a')
    assert len(reader.read(serialize_message(message(['b', 'a'], 1))).positions) == 1


def test_what_is_cut_off_or_damaged_is_refused_or_read_and_never_more():
    data = serialize_message(message(['thumb', 'index'], frame='base'))
    random = np.random.default_rng(0)
    # Velocities and efforts may be missing.
    for end in range(data.index(np.float64(.1).tobytes()) + 8):
        with pytest.raises(MalformedMessage):
            JointStateReader().read(data[:end])
    reader = JointStateReader()
    for _ in range(500):
        bad = bytearray(data)
        for at in random.integers(len(bad), size=3):
            bad[at] = random.integers(256)
        try:
            assert len(reader.read(bytes(bad)).positions) <= len(bad) / 8
        except MalformedMessage:
            continue
    assert reader.read(data).names == ('thumb', 'index')


def test_a_message_of_the_template_is_read():
    data = joint_state_template(['a', 'bc', 'd']).fill(Stamp(1, 2), [1., 2., 3.])
    read = JointStateReader().read(data)
    np.testing.assert_array_equal(read.positions, (1., 2., 3.))
    assert len(read.effort) == 0 and len(JointStateReader().read(data[:-2]).effort) == 0
    with_effort = joint_state_template(['a', 'bc', 'd'], [4., 5., 6.]).fill(
        Stamp(1, 2), [1., 2., 3.])
    np.testing.assert_array_equal(JointStateReader().read(with_effort).effort, (4., 5., 6.))
    assert len(JointStateReader().read(with_effort[:-2]).effort) == 0
    assert deserialize_message(data, JointState).name == ['a', 'bc', 'd']
