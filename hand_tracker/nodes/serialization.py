"""Messages as bytes where the codec knows their layout, else as objects of rclpy.

The codec is faster, but knows one layout of each message. Where rclpy's own serialiser has
another one, messages are built and read as objects.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from geometry_msgs.msg import Point
from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray, UVCoordinate

from ..messages.builders import (
    Names,
    fill_transforms,
    joint_state,
    new_transforms,
    prefixed_names,
    time_message,
)
from ..messages.cdr import MarkerReader
from ..messages.labels import LabelMap
from ..messages.marker_array import MarkerFrame, markers_from_message
from ..messages.marker_ids import HandIds, no_warning
from ..messages.message_kinds import MARKER_ARRAY_KIND, MessageKind
from ..messages.rviz_markers import LIFETIME, RVIZ_SKIN_COLOUR, RVIZ_SKIN_OPACITY, hand_skin
from ..messages.stamps import Stamp, Time
from ..messages.templates import (
    Template,
    joint_state_template,
    transforms_template,
    triangles_template,
)
from .tracker_parameters import Settings

try:
    from tf2_msgs.msg import TFMessage
except ImportError:
    TFMessage = None

SAMPLE_STAMP = Stamp(-7, 2**32 - 1)
UNKNOWN_LAYOUT = 'rclpy lays messages out in a way that the codec does not know'


class Reply(NamedTuple):
    """Reply template with its publisher and hands.

    Attributes
    ----------
    publisher : rclpy.publisher.Publisher
    template : Template
        Its numbers are those of its hands, one after the other, as many of each.
    kind : int
        `JOINT_STATES`, `TRANSFORMS` or `ANGLE_DEVIATIONS`.
    hands : tuple of int
        Numbers of its hands.
    """

    publisher: Publisher
    template: Template
    kind: int
    hands: tuple[int, ...]


class Serialization:
    """Read markers and fill replies.

    Attributes
    ----------
    raw : bool
        Whether messages are bytes, so that markers are subscribed to as such.
    """

    def __init__(self) -> None:
        self.raw = codec_agrees()

    def markers(self, settings: Settings, frame_id: str, kind: MessageKind = MARKER_ARRAY_KIND,
                warn_once: Callable[[str, str], None] = no_warning,
                ids: HandIds | None = None) -> MarkerReader | _ObjectReader:
        """Return a reader of markers: its `read` returns the MarkerFrame of a message.

        Parameters
        ----------
        settings : Settings
        frame_id : str
            See `markers_from_message`.
        kind : MessageKind
            MarkerArrays, where messages are no bytes.
        warn_once : callable
            Logs a warning (key, text) once for each key.
        ids : callable
            See `MarkerReader`.
        """
        how = settings.labels, frame_id, settings.unit_scale, settings.zero_is_missing
        if self.raw:
            return MarkerReader(*how, kind, warn_once, ids)
        return _ObjectReader(lambda message: markers_from_message(message, *how))

    def joint_states(self, joints: Sequence[str],
                     effort: Sequence[float] = ()) -> Template | _ObjectTemplate:
        """Return the template of a JointState of a number for each of the joints.

        Parameters
        ----------
        joints : sequence of str
        effort : sequence of float, optional
            Constant; one for each joint, or none.
        """
        if self.raw:
            return joint_state_template(joints, effort)
        return _ObjectTemplate(lambda stamp, numbers: joint_state(stamp, joints, numbers, effort))

    def transforms(self, frames: Sequence[tuple[str, str]]) -> Template | _ObjectTemplate:
        """Return the template of a TFMessage of n times 7 numbers.

        Parameters
        ----------
        frames : sequence of (str, str)
            Parent and child of each transform.
        """
        if self.raw:
            return transforms_template(frames)
        messages = new_transforms(frames)

        def filled(stamp: Time, numbers: np.ndarray) -> Any:
            fill_transforms(messages, time_message(stamp), numbers.reshape(-1, 7))
            return TFMessage(transforms=messages)

        return _ObjectTemplate(filled)

    def skin(self, names: Names, corners: int) -> Template | _ObjectTemplate:
        """Return the template of a Marker of triangles with corners (3 F, 3).

        Parameters
        ----------
        names : Names
        corners : int
            Three for each triangle.
        """
        if self.raw:
            return _skin_template(names, corners)
        return _ObjectTemplate(
            lambda stamp, places: hand_skin(time_message(stamp), names, places))


class _ObjectReader(NamedTuple):
    """Reads message objects as `MarkerReader` reads bytes."""

    read: Callable[[MarkerArray], MarkerFrame]

    @property
    def signature(self) -> None:
        """Objects have no signature."""

    def load_kernels(self, folder: Path | None = None) -> None:
        """Do nothing: objects are read by plain Python."""

    def use_loaded_kernels(self) -> None:
        """Do nothing: objects are read by plain Python."""


class _ObjectTemplate(NamedTuple):
    """Fills message objects as `Template` fills bytes."""

    fill: Callable[[Time, np.ndarray], Any]


def _skin_template(names: Names, corners: int) -> Template:
    colour = *RVIZ_SKIN_COLOUR, RVIZ_SKIN_OPACITY
    return triangles_template(
        names.wrist, f'{names.prefix}skin', colour, LIFETIME.sec, corners)


def codec_agrees() -> bool:
    """Return whether rclpy's own serialiser has the layout that the codec knows."""
    try:
        return _reads_alike() and _writes_alike()
    # Whatever another layout leads to: the normal way is always there.
    except Exception:
        return False


def _reads_alike() -> bool:
    message, labels = _sample_markers(), LabelMap()
    expected = markers_from_message(message, labels)
    frame = MarkerReader(labels).read(serialize_message(message))
    return (np.array_equal(frame.positions, expected.positions, equal_nan=True)
            and frame.stamp is not None and time_message(frame.stamp) == expected.stamp
            and frame.frame_id == expected.frame_id)


def _sample_markers() -> MarkerArray:
    """Return markers that leave no part of the message empty."""
    markers = []
    for number, kind in enumerate((Marker.SPHERE, Marker.POINTS, Marker.CUBE)):
        marker = Marker(
            header=Header(frame_id='mocap', stamp=time_message(SAMPLE_STAMP)), ns='l' * number,
            id=number, type=kind, points=[Point(x=1., y=2., z=3.)] * 5, colors=[ColorRGBA()] * 2,
            texture_resource='texture', uv_coordinates=[UVCoordinate()] * 3, text='text',
            mesh_resource='a mesh')
        marker.texture.header.frame_id, marker.texture.format = 'camera', 'png'
        marker.texture.data = marker.mesh_file.data = b'bytes'
        marker.mesh_file.filename = 'file'
        marker.pose.position.x = 1. + number
        markers.append(marker)
    return MarkerArray(markers=markers)


def _writes_alike() -> bool:
    names, numbers = prefixed_names('left_'), np.linspace(-1., 1., 25)
    for effort in ((), numbers.tolist()):
        data = joint_state_template(names.joints, effort).fill(SAMPLE_STAMP, numbers)
        if not _says(data, joint_state(SAMPLE_STAMP, names.joints, numbers, effort)):
            return False
    corners = np.arange(18.).reshape(6, 3)
    data = _skin_template(names, len(corners)).fill(SAMPLE_STAMP, corners.ravel())
    if not _says(data, hand_skin(time_message(SAMPLE_STAMP), names, corners)):
        return False
    if TFMessage is None:
        return True
    frames, numbers = (('mocap', 'a'), ('wrist', 'bone')), np.arange(14.).reshape(2, 7)
    messages = new_transforms(frames)
    fill_transforms(messages, time_message(SAMPLE_STAMP), numbers)
    data = transforms_template(frames).fill(SAMPLE_STAMP, numbers.ravel())
    return _says(data, TFMessage(transforms=messages))


def _says(data: bytes, message: Any) -> bool:
    kind = type(message)
    return deserialize_message(data, kind) == deserialize_message(serialize_message(message), kind)
