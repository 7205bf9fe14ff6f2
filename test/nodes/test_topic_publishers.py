"""Why nothing may come from the publishers of a topic of markers."""

from types import SimpleNamespace

import pytest

from hand_tracker.adapters.marker_messages import MESSAGE_OF_TYPE
from hand_tracker.nodes.topic_publishers import UNNAMED_NODE, full_name, who_publishes

NEEDS = 'rclpy',


def endpoint(kind='visualization_msgs/msg/MarkerArray', reliability='RELIABLE',
             node='driver'):
    """Return a publisher as rclpy describes it."""
    return SimpleNamespace(
        node_namespace='/', node_name=node, topic_type=kind,
        qos_profile=SimpleNamespace(reliability=SimpleNamespace(name=reliability)))


@pytest.mark.parametrize('endpoints, reliability, said', [
    ([endpoint('geometry_msgs/msg/PoseArray')], 'reliable', '/driver publishes geometry_msgs'),
    ([endpoint(reliability='BEST_EFFORT')], 'reliable', 'qos.markers.reliability'),
    ([endpoint(reliability='BEST_EFFORT')], 'best_effort', 'sends nothing'),
    ([endpoint(node=UNNAMED_NODE)], 'reliable', 'a node not yet discovered publishes them'),
    ([endpoint(), endpoint(node=UNNAMED_NODE), endpoint(node='replay')], 'reliable',
     '/driver, /replay publishes them'),
    ([endpoint()], 'reliable', 'sends nothing that arrives; is it paused?')])
def test_says_why_nothing_may_come(endpoints, reliability, said):
    assert said in who_publishes(endpoints, reliability)


@pytest.mark.parametrize('kind, type, end', [
    ('sensor_msgs/msg/PointCloud2', 'visualization_msgs/msg/MarkerArray', 'point_cloud)'),
    ('visualization_msgs/msg/MarkerArray', 'sensor_msgs/msg/PointCloud2', 'marker_array)'),
    ('std_msgs/msg/String', 'sensor_msgs/msg/PointCloud2', 'not sensor_msgs/msg/PointCloud2')])
def test_the_parameter_that_takes_messages_of_another_type_is_named(kind, type, end):
    assert who_publishes([endpoint(kind)], 'reliable', type, MESSAGE_OF_TYPE).endswith(end)


def test_there_may_be_no_publisher():
    assert who_publishes([], 'reliable') is None


def test_a_node_that_discovery_has_not_brought_has_no_name():
    assert full_name(endpoint()) == '/driver'
    assert full_name(endpoint(node=UNNAMED_NODE)) is None
