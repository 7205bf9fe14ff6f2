"""Landmarks of a hand in messages: their names, by their number or as XR calls them. No ROS.

Known are the 21 of MediaPipe, the 25 of WebXR and the 26 of OpenXR: by their place in a PoseArray
of as many, by the ids of a MarkerArray or, in a NamedPoseArray of IsaacTeleop, by their names,
'left_INDEX_TIP'. OpenXR and IsaacTeleop call a joint by the bone that begins there: INDEX_PROXIMAL
is the index finger's MCP.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from ..core.model.hand import FINGERS, SIDES
from ..core.model.layout_presets import preset_layout
from .marker_array import MARKER_ARRAY, POINT_TYPES
from .message_definitions import NAMED_POSE_ARRAY
from .message_kinds import (
    PARSE_LANDMARK_MARKERS,
    PARSE_NAMED_POSES,
    PARSE_POSE_ARRAY,
    HeadRows,
    MalformedMessage,
    MessageKind,
    PointNames,
    texts_of,
)

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
OTHER_COUNTS = 'NamedPoseArray: {} names, {} poses, {} validities; expected as many of each'


def _names_of_poses(rows: HeadRows, strings: bytes) -> tuple[str, PointNames]:
    """Return the frame and the names of the landmarks of a serialized PoseArray."""
    names = LANDMARK_ORDERS.get(len(rows))
    if names is None:
        raise MalformedMessage(OTHER_COUNT.format(len(rows)))
    return texts_of(strings, [rows[0][0]])[0], list(names)


def _names_of_markers(names: Sequence[str], rows: HeadRows,
                      strings: bytes) -> tuple[str, PointNames]:
    """Return the frame and the names of the landmarks of a serialized MarkerArray."""
    frames = texts_of(strings, [length for row in rows for length in row[:2]])[::2]
    found = [names[number] if kind in POINT_TYPES and 0 <= number < len(names) else ''
             for _, _, number, kind, _ in rows]
    return next((frame for frame, name in zip(frames, found) if name), ''), list(found)


def sided_landmark(name: str) -> tuple[str, str]:
    """Return side and landmark of a name such as 'left_INDEX_TIP'; empty where it is of no hand."""
    side, _, landmark = name.partition('_')
    side, landmark = side.lower(), OPENXR.get(landmark.upper(), '')
    return (side, landmark) if side in SIDES and landmark else ('', '')


def _names_of_named(only: str, rows: HeadRows, strings: bytes) -> tuple[str, PointNames]:
    """Return the frame and the names of the landmarks of a serialized NamedPoseArray.

    They are such as 'left_index_tip'; where one side alone is asked for, such as 'index_tip'.
    """
    counts = rows[0][1:4]
    if len(set(counts)) > 1:
        raise MalformedMessage(OTHER_COUNTS.format(*counts))
    frame_id, *names = texts_of(strings, [rows[0][0], *(row[4] for row in rows)])
    found = map(sided_landmark, names)
    if only:
        return frame_id, [landmark if side == only else '' for side, landmark in found]
    return frame_id, ['_'.join(each) if all(each) else '' for each in found]


def _named_kind(side: str) -> MessageKind:
    return MessageKind(NAMED_POSE_ARRAY, PARSE_NAMED_POSES, partial(_names_of_named, side))


LANDMARK_POSES = MessageKind('geometry_msgs/msg/PoseArray', PARSE_POSE_ARRAY, _names_of_poses)
NAMED_LANDMARKS = _named_kind('')
NAMED_LANDMARKS_OF = {side: _named_kind(side) for side in SIDES}
# By their number; a marker's id is that of the landmark in its order.
LANDMARK_MARKERS = {count: MessageKind(
    MARKER_ARRAY, PARSE_LANDMARK_MARKERS, partial(_names_of_markers, names))
    for count, names in LANDMARK_ORDERS.items()}
LANDMARK_KINDS = LANDMARK_POSES, NAMED_LANDMARKS, *LANDMARK_MARKERS.values()


def kind_of_hand(kind: MessageKind, side: str) -> MessageKind:
    """Return a kind of messages with the points of one hand alone, where their names say whose.

    Parameters
    ----------
    kind : MessageKind
    side : {'right', 'left'}
    """
    return NAMED_LANDMARKS_OF[side] if kind is NAMED_LANDMARKS else kind
