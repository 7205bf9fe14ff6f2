"""Which messages the tracker takes as they are, and where a source node is needed."""

import pytest

from hand_tracker.adapters.marker_messages import (
    MARKER_MESSAGES,
    MESSAGES_OF,
    TAKEN_AS_THEY_ARE,
    USUAL_TOPICS,
    direct_input,
)


@pytest.mark.parametrize('parameters, expected', [
    ({'source': 'point_cloud'}, ('point_cloud', '/pointCloud')),
    ({'source': 'mocap4r2', 'side': 'left'}, ('mocap4r2_markers', '/markers')),
    ({'source': 'mocap4r2', 'message': 'rigid_bodies', 'topic': '/bodies', 'up': 'z',
      'subject': '', 'frame': 'mocap'}, ('mocap4r2_rigid_bodies', '/bodies')),
    ({'source': 'landmarks', 'message': 'first'}, ('pose_array', 'landmarks')),
    ({'source': 'landmarks', 'message': 'named_pose_array'},
     ('named_pose_array', '/xr_teleop/hand')),
    ({'source': 'landmarks', 'message': 'marker_array'}, ('landmark_markers_21', 'landmarks')),
    ({'source': 'landmarks', 'message': 'marker_array', 'landmarks': 26},
     ('landmark_markers_26', 'landmarks')),
    ({'source': 'landmarks', 'message': 'marker_array', 'landmarks': 22}, None),
    ({'source': 'natnet'}, None), ({'source': 'qualisys'}, None),
    ({'source': 'mocap4r2', 'subject': 'RHand'}, None),
    ({'source': 'point_cloud', 'up': 'y'}, None),
    ({'source': 'point_cloud', 'frame': 'lab'}, None),
    # Told by the source node.
    ({'source': 'point_cloud', 'message': 'markers'}, None)])
def test_what_leaves_points_as_they_are_needs_no_source_node(parameters, expected):
    assert direct_input(parameters) == expected


def test_all_messages_have_a_usual_topic_and_are_known():
    known = [(source, message) for source, of_it in MESSAGES_OF.items() for message in of_it]
    assert {message for _, message in known} == set(USUAL_TOPICS)
    assert set(TAKEN_AS_THEY_ARE) <= set(known)
    assert set(TAKEN_AS_THEY_ARE.values()) < set(MARKER_MESSAGES)
