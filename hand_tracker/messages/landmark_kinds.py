"""Landmarks of a hand in messages: their names, by their number or as XR calls them. No ROS.

Known are the 21 of MediaPipe, the 25 of WebXR and the 26 of OpenXR, by their number in a message
or, in a NamedPoseArray of IsaacTeleop, by their names, 'left_INDEX_TIP'. OpenXR and IsaacTeleop
call a joint by the bone that begins there: INDEX_PROXIMAL is the index finger's MCP.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..core.model.hand import FINGERS, SIDES
from ..core.model.layout_presets import preset_layout
from .message_kinds import (
    PARSE_POSE_ARRAY,
    HeadRows,
    MalformedMessage,
    MessageKind,
    PointNames,
    texts_of,
)
from .pose_array_parser import BESIDE_ORIGIN

# Joints of a finger and of the thumb by the bones that begin there, as XR names them.
XR_FINGER = {'METACARPAL': 'cmc', 'PROXIMAL': 'mcp', 'INTERMEDIATE': 'pip', 'DISTAL': 'dip',
             'TIP': 'tip'}
XR_THUMB = {'METACARPAL': 'cmc', 'PROXIMAL': 'mcp', 'DISTAL': 'ip', 'TIP': 'tip'}
# Our landmark by its name in OpenXR, in the order of OpenXR.
OPENXR = {'PALM': 'palm', 'WRIST': 'wrist',
          **{f'THUMB_{bone}': f'thumb_{joint}' for bone, joint in XR_THUMB.items()},
          **{f'{finger.upper()}_{bone}': f'{finger}_{joint}'
             for finger in FINGERS for bone, joint in XR_FINGER.items()}}
# Landmarks in the order of messages without names, by how many there are.
LANDMARK_ORDERS = {21: tuple(preset_layout('mediapipe21').places),
                   25: tuple(OPENXR.values())[1:], 26: tuple(OPENXR.values())}
OTHER_COUNT = ('PoseArray of {} poses; expected are '
               + ', '.join(map(str, LANDMARK_ORDERS)) + ' landmarks')


def _names_of_poses(rows: HeadRows, strings: bytes) -> tuple[str, PointNames]:
    """Return the frame and the names of the landmarks of a serialized PoseArray."""
    names = LANDMARK_ORDERS.get(len(rows))
    if names is None:
        raise MalformedMessage(OTHER_COUNT.format(len(rows)))
    return texts_of(strings, [rows[0][0]])[0], list(names)


LANDMARK_POSES = MessageKind('geometry_msgs/msg/PoseArray', PARSE_POSE_ARRAY, _names_of_poses)


class NamedHand(NamedTuple):
    """Landmarks of one hand of a NamedPoseArray.

    Attributes
    ----------
    names : list of str
        As in `LANDMARK_ORDERS`.
    points : ndarray, shape (n, 3)
        NaN where `is_valid` is false, and where `mark_missing` has it [m].
    """

    names: list[str]
    points: np.ndarray


def named_hands(message: Any, sides: Collection[str] = SIDES) -> dict[str, NamedHand]:
    """Return the landmarks in a NamedPoseArray by the side of their hand, without other names.

    Parameters
    ----------
    message : teleop_ros2_interfaces/NamedPoseArray
        Of rclpy or of rosbags.
    sides : collection of str, optional
        Of the hands that are wanted.

    Raises
    ------
    MalformedMessage
        If names, poses and validity are not equally many.
    """
    counts = len(message.name), len(message.pose), len(message.is_valid)
    if len(set(counts)) > 1:
        raise MalformedMessage('NamedPoseArray: {} names, {} poses, {} validities; expected as '
                               'many of each'.format(*counts))
    found: dict[str, tuple[list[str], list[Sequence[float]]]] = {}
    for name, pose, is_valid in zip(message.name, message.pose, message.is_valid):
        side, _, landmark = name.partition('_')
        if side.lower() in sides and landmark.upper() in OPENXR:
            names, places = found.setdefault(side.lower(), ([], []))
            at = pose.position
            names.append(OPENXR[landmark.upper()])
            places.append((at.x, at.y, at.z) if is_valid else (np.nan,) * 3)
    hands = {side: NamedHand(names, np.array(places)) for side, (names, places) in found.items()}
    for hand in hands.values():
        mark_missing(hand.points)
    return hands


def mark_missing(points: np.ndarray) -> None:
    """Set points at exactly (0, 0, 0) to NaN; but one alone is where its source has the origin.

    That one is moved by nothing to speak of, as drivers' markers at exactly zero are lost ones.
    """
    # Not `any`, which warns of signalling NaN.
    at_origin = (points == 0.).all(axis=1)
    points[at_origin] = np.nan if at_origin.sum() > 1 else (BESIDE_ORIGIN, 0., 0.)
