"""The hand of a tracker's messages."""

import numpy as np
from builtin_interfaces.msg import Time
from helpers.hands import BENT_ANGLES, RIGHT, hand_at
from rclpy.serialization import serialize_message

from hand_tracker.core.model.kinematics import tip_offsets
from hand_tracker.core.model.marker_layout import MarkerLayout
from hand_tracker.core.tracker import HandTracker
from hand_tracker.messages.builders import joint_state, prefixed_names
from hand_tracker.messages.rviz_markers import hand_markers
from hand_tracker.nodes.published_hand import PublishedHand

NEEDS = 'rclpy',


def test_joints_of_an_arm_are_none_of_the_hands():
    names, tracker = prefixed_names('right_'), HandTracker(RIGHT)
    state = tracker.update(hand_at(BENT_ANGLES), 0.)
    shown = serialize_message(hand_markers(Time(), 'mocap', names, tip_offsets(RIGHT), state))
    published = PublishedHand(names, RIGHT, MarkerLayout())

    def angles_of(joints, angles):
        message = joint_state(Time(), joints, angles)
        found = published.read(serialize_message(message), shown)
        return None if found is None else found.angles

    arm = [f'arm_{number}' for number in range(30)]
    assert angles_of(arm, np.full(30, 9.)) is None
    np.testing.assert_array_equal(angles_of(names.joints, state.angles), state.angles)
    np.testing.assert_array_equal(angles_of(
        [*arm, *names.joints], np.concatenate((np.full(30, 9.), state.angles))), state.angles)
