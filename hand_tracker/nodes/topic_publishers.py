"""Publishers of a topic of markers: their names, and why a topic is silent."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from rclpy.topic_endpoint_info import TopicEndpointInfo

from ..messages.marker_array import MARKER_ARRAY
from ..tracking.input_monitor import SENDS_NOTHING, UNDISCOVERED

# What rmw reports while discovery knows an endpoint but not yet its node.
UNNAMED_NODE = '_NODE_NAME_UNKNOWN_'
# In a retarget node's answer to who engages it before it has met the hand's tracker.
UNPUBLISHED = "nobody publishes the hand's"


def full_name(endpoint: TopicEndpointInfo) -> str | None:
    """Return the name of an endpoint's node with its namespace; None while it is not discovered.

    Parameters
    ----------
    endpoint : TopicEndpointInfo
    """
    if endpoint.node_name == UNNAMED_NODE:
        return None
    return f"{endpoint.node_namespace.rstrip('/')}/{endpoint.node_name}"


def who_publishes(endpoints: Sequence[TopicEndpointInfo], reliability: str,
                  message_type: str = MARKER_ARRAY,
                  values: Mapping[str, str] | None = None) -> str | None:
    """Explain why the publishers of a topic may deliver no markers.

    Parameters
    ----------
    endpoints : sequence of TopicEndpointInfo
    reliability : str
        That this node asks for.
    message_type : str, optional
        Of the markers.
    values : mapping of str to str, optional
        Of the parameter `marker_message` by type, where this node has it.

    Returns
    -------
    str or None
        None where there is no publisher.
    """
    if not endpoints:
        return None
    for endpoint in endpoints:
        name = full_name(endpoint) or UNDISCOVERED
        if endpoint.topic_type != message_type:
            value = (values or {}).get(endpoint.topic_type)
            return (f'{name} publishes {endpoint.topic_type}, not {message_type}'
                    + (f' (marker_message:={value})' if value else ''))
        if reliability == 'reliable' and endpoint.qos_profile.reliability.name != 'RELIABLE':
            return (f'{name} publishes with best effort, and qos.markers.reliability here is '
                    'reliable')
    names = dict.fromkeys(filter(None, map(full_name, endpoints)))
    return f'{", ".join(names) or UNDISCOVERED} publishes them, but {SENDS_NOTHING}'
