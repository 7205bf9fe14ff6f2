"""Why nothing may come from the publishers of a topic of markers."""

from types import SimpleNamespace

import pytest

from hand_tracker.nodes.topic_publishers import who_publishes

NEEDS = 'rclpy',


def endpoint(kind='visualization_msgs/msg/MarkerArray', reliability='RELIABLE'):
    """Return a publisher as rclpy describes it."""
    return SimpleNamespace(
        node_namespace='/', node_name='driver', topic_type=kind,
        qos_profile=SimpleNamespace(reliability=SimpleNamespace(name=reliability)))


@pytest.mark.parametrize('endpoints, reliability, said', [
    ([], 'reliable', 'nothing publishes them'),
    ([endpoint('geometry_msgs/msg/PoseArray')], 'reliable', '/driver publishes geometry_msgs'),
    ([endpoint(reliability='BEST_EFFORT')], 'reliable', 'qos.markers.reliability'),
    ([endpoint(reliability='BEST_EFFORT')], 'best_effort', 'sends nothing'),
    ([endpoint()], 'reliable', 'sends nothing that arrives; is it paused?')])
def test_says_why_nothing_may_come(endpoints, reliability, said):
    assert said in who_publishes(endpoints, reliability)
