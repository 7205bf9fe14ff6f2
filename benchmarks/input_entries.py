"""Entries of bytes from outside: each function gives bytes to what reads them, as the product does.

`benchmarks.fuzz_inputs` looks for bytes that break one, `test/package/test_corpus.py` gives each
those of `test/corpus` again. An entry may end in a `HandTrackerError`, or in what its reader is
documented to raise and its caller to catch; anything else, a warning too, is a fault.
"""

from __future__ import annotations

import asyncio
import os
import warnings
from collections.abc import Callable
from contextlib import suppress
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import trimesh.exchange.load  # noqa: F401  to be covered
from websockets.frames import Frame
from websockets.http11 import Request
from websockets.protocol import OPEN
from websockets.server import ServerProtocol

from benchmarks.fuzz_files import require_sound
from hand_tracker.adapters.hand_landmarks import (
    LandmarkChecks,
    landmarks_of_markers,
    landmarks_of_poses,
)
from hand_tracker.adapters.marker_arrays import MarkerArrayWriter
from hand_tracker.adapters.marker_messages import MARKER_MESSAGES
from hand_tracker.adapters.natnet_client import NatNetClient
from hand_tracker.adapters.point_cloud import points_of_cloud
from hand_tracker.adapters.point_frame import SourceFrame
from hand_tracker.adapters.qtm_protocol import CheckedQtmProtocol
from hand_tracker.adapters.qualisys import QualisysClient, marker_labels
from hand_tracker.calibration.hand_axes import with_recognised_axes
from hand_tracker.calibration.known_layouts import likely_layouts
from hand_tracker.calibration.take_files import load_take
from hand_tracker.cli.recording_options import chosen_labels, label_map
from hand_tracker.core.errors import HandTrackerError
from hand_tracker.core.model.hand import SIDES
from hand_tracker.core.model.marker_layout import MARKERS
from hand_tracker.files.bag_points import write_bag_points
from hand_tracker.files.bags import TYPE_STORE
from hand_tracker.files.hand_file import load_hand
from hand_tracker.files.layout_file import load_layout
from hand_tracker.files.parameter_file import ParameterFile
from hand_tracker.files.point_recording import Axes, PointRecording
from hand_tracker.files.recordings import ReadingOptions, read_recording
from hand_tracker.files.ros2_control import with_mock_hardware
from hand_tracker.messages.cdr import MarkerReader
from hand_tracker.messages.joint_states import JointStateReader
from hand_tracker.messages.labels import LabelMap, default_labels, label_maps
from hand_tracker.messages.landmark_kinds import LANDMARK_ORDERS
from hand_tracker.messages.marker_array import MARKER_ARRAY, markers_from_message
from hand_tracker.messages.message_kinds import MessageKind
from hand_tracker.messages.points import PointReader
from hand_tracker.messages.stamps import marker_stamps, restamp
from hand_tracker.package_data import share_directory
from hand_tracker.retargeting.robot_file import load_robot
from hand_tracker.skin.mesh_registration import MESH_FORMATS, read_mesh
from hand_tracker.viewer.page_guard import LARGEST_FRAME, PageGuard

Entry = Callable[[bytes], None]

# Names of the files, by the entry's name: the suffix is part of what outside gives.
CASE_FILES = {'c3d': 'case.c3d', 'trc': 'case.trc', 'qualisys_tsv': 'case.tsv',
              'optitrack_csv': 'case.csv', 'vicon_csv': 'case.csv', 'bvh': 'case.bvh',
              'npz': 'case.npz', 'mcap': 'case.mcap', 'db3': 'case.db3'}
LONGEST_MESSAGE = 2000     # characters of an error
SIDE_MARKERS = 'left/0', 'right/0'
OBJECT_TYPES = 'geometry_msgs/msg/PoseArray', MARKER_ARRAY, 'sensor_msgs/msg/PointCloud2'


class Fault(AssertionError):
    """An entry gives what it must not."""


def require(condition: bool, what: str) -> None:
    """Raise `Fault`, with what is wrong, where a condition does not hold."""
    if not condition:
        raise Fault(what)


def give(entry: str, data: bytes) -> None:
    """Give bytes to an entry of `ENTRIES`; whatever it raises is a fault."""
    with warnings.catch_warnings():
        warnings.simplefilter('error')
        with suppress(HandTrackerError):
            ENTRIES[entry](data)


@cache
def _folder() -> TemporaryDirectory[str]:
    return TemporaryDirectory(
        prefix='hand_tracker-', dir='/dev/shm' if os.path.isdir('/dev/shm') else None)


def _in_file(read: Callable[[Path], Any], name: str, data: bytes) -> None:
    """Read bytes from a file; an error has to name it."""
    path = Path(_folder().name, name)
    path.write_bytes(data)
    try:
        read(path)
    except HandTrackerError as error:
        text = str(error)
        require(path.name in text, f'a message that does not name the file: {text[:200]}')
        require(name not in CASE_FILES.values() or len(text) <= LONGEST_MESSAGE,
                f'a message of {len(text)} characters')
        raise


def _read_recording(path: Path) -> None:
    recording = with_recognised_axes(read_recording(path, ReadingOptions(partial=True)))
    likely_layouts(recording)
    require_sound(recording)
    # A whole file is read alike without that option.
    with suppress(HandTrackerError):
        require_sound(read_recording(path))


def _bag_metadata(data: bytes) -> None:
    """Read the metadata.yaml of a folder with a recording."""
    folder = Path(_folder().name, 'bag')
    if not folder.exists():
        folder.mkdir()
        write_bag_points(folder / 'bag.db3', PointRecording(
            'bag', 'fuzzing', ('1',), np.zeros((1, 1, 3)), 100., None, Axes()))
    (folder / 'metadata.yaml').write_bytes(data)
    read_recording(folder)


def _mesh(data: bytes) -> None:
    """Read a mesh: of the first byte the format, the others are the file."""
    if data:
        _in_file(read_mesh, f'case{MESH_FORMATS[data[0] % len(MESH_FORMATS)]}', data[1:])


def _load_robot(path: Path) -> None:
    """Read a robot file with its own URDF, and with another."""
    with suppress(HandTrackerError):
        load_robot(str(path))
    load_robot(str(path), _plain_urdf())


def _plain_urdf() -> str:
    return str(share_directory() / 'config' / 'robots' / 'plain_hand_right.urdf')


def _urdf(path: Path) -> None:
    """Read a URDF as a robot, and as what a simulation is given."""
    loaded = load_robot(str(path))
    with_mock_hardware(path.read_text(encoding='utf-8'), loaded.order)


# Numbers that no hand has become infinite or NaN, which the tracker refuses.
@np.errstate(all='ignore')
def _message(kind: MessageKind, data: bytes) -> None:
    """Read a message twice, as later ones like it are read otherwise, and its points."""
    reader = MarkerReader(LabelMap(), kind=kind)
    first, second = reader.read(data), reader.read(data)
    require(first.positions.shape == (len(MARKERS), 3), f'positions {first.positions.shape}')
    require(np.array_equal(first.positions, second.positions, equal_nan=True)
            and first[3:] == second[3:], 'read otherwise the second time')
    cloud = PointReader(kind=kind).read(data)
    require(len(cloud.points) == len(cloud.ids), 'points without ids')
    if kind.type == MARKER_ARRAY:
        restamp(data, marker_stamps(data), 10**9)


@np.errstate(all='ignore')
def _message_objects(data: bytes) -> None:
    """Read messages as objects: the first byte says of which type, the others are the message."""
    if not data:
        return
    kind = OBJECT_TYPES[data[0] % len(OBJECT_TYPES)]
    try:
        message = TYPE_STORE.deserialize_cdr(data[1:], kind)
    except Exception:  # the middleware's, of which this stands for
        return
    if kind == MARKER_ARRAY:
        with suppress(HandTrackerError):
            _publish(landmarks_of_markers(message, max(LANDMARK_ORDERS)))
        markers_from_message(message, LabelMap())
    elif kind == OBJECT_TYPES[0]:
        frame = landmarks_of_poses(message)
        LandmarkChecks(SIDES[0], _ignored).check(frame)
        _publish(frame)
    else:
        _publish(points_of_cloud(message))


def _ignored(*_: Any) -> None:
    """Take a line that would be printed."""


def _publish(frame: SourceFrame, writer: MarkerArrayWriter | None = None) -> None:
    """Write a frame as the source node does, and read it as the tracker does."""
    require(frame.markers.shape == (len(frame.names), 3), f'markers {frame.markers.shape}')
    require(bool(np.isfinite(frame.points).all()), 'anonymous points that are nowhere')
    if frame.stamp is not None:
        message = (writer or MarkerArrayWriter(_ignored)).write(frame, frame.stamp)
        MarkerReader(LabelMap()).read(bytes(message))


def _joint_states(data: bytes) -> None:
    reader = JointStateReader()
    first, second = reader.read(data), reader.read(data)
    require(first.names is second.names and len(first.positions) == len(second.positions),
            'read otherwise the second time')


@np.errstate(all='ignore')
def _natnet(data: bytes) -> None:
    """Take packets, which say their own size, as from a server."""
    client = NatNetClient('127.0.0.1', partial(_publish, writer=MarkerArrayWriter(_ignored)),
                          _ignored)
    received = 10**12
    while data:
        size = 4 + int.from_bytes(data[2:4], 'little')
        with suppress(HandTrackerError):
            client.take(data[:size], received)
        data, received = data[size:], received + 10**7


@cache
def _loop() -> asyncio.AbstractEventLoop:
    return asyncio.new_event_loop()


@np.errstate(all='ignore')
def _qtm(data: bytes) -> None:
    """Take bytes of a connection with QTM that streams."""
    client = QualisysClient('127.0.0.1', partial(_publish, writer=MarkerArrayWriter(_ignored)),
                            _ignored)
    client._names = 'wrist', 'index'
    protocol = CheckedQtmProtocol(loop=_loop())
    protocol.set_on_packet(client.take)
    try:
        protocol.data_received(data)
    except Fault:
        raise
    except Exception:
        # Ends the connection.
        pass


def _qtm_parameters(data: bytes) -> None:
    marker_labels(data.decode(errors='replace'))


def _page_request(data: bytes) -> None:
    """Ask the viewer for its page by the bytes of a request, with and without a token."""
    for guard in PageGuard(True, None), PageGuard(False, 'token'):
        server = ServerProtocol(max_size=LARGEST_FRAME)
        server.receive_data(data)
        for event in server.events_received():
            if isinstance(event, Request):
                with suppress(StopIteration):
                    guard.guarded(None)(_Connection, event).send(None)


class _Connection:
    """Connection through which the guard of the page answers."""

    respond = staticmethod(_ignored)


def _page_message(data: bytes) -> None:
    """Give the viewer's server the bytes of a browser's websocket."""
    from viser._messages import Message
    server = ServerProtocol(state=OPEN, max_size=LARGEST_FRAME)
    server.receive_data(data)
    for event in server.events_received():
        if isinstance(event, Frame):
            # Whatever viser raises ends this connection, and no other.
            with suppress(Exception):
                Message.deserialize(event.data)


def _labels(data: bytes) -> None:
    """Take lines as the labels of a command line."""
    lines = data.decode(errors='replace').split('\n')
    for take in (label_map, chosen_labels,
                 lambda texts: LabelMap((texts + [''] * len(MARKERS))[:len(MARKERS)]),
                 lambda texts: label_maps(default_labels(MARKERS), dict(
                     zip(SIDES, (texts + [*SIDE_MARKERS])[:len(SIDES)])))):
        with suppress(HandTrackerError):
            take(lines)


ENTRIES: dict[str, Entry] = {
    **{entry: partial(_in_file, _read_recording, name) for entry, name in CASE_FILES.items()},
    'bag_metadata': _bag_metadata,
    'take': partial(_in_file, load_take, 'case.npz'),
    'mesh': _mesh,
    'hand_file': partial(_in_file, load_hand, 'case.yaml'),
    'layout_file': partial(_in_file, load_layout, 'case.yaml'),
    'parameter_file': partial(
        _in_file, lambda path: ParameterFile(path).parameters('/hand_tracker'), 'case.yaml'),
    'robot_file': partial(_in_file, _load_robot, 'case.yaml'),
    'urdf': partial(_in_file, _urdf, 'case.urdf'),
    **{message: partial(_message, kind) for message, kind in MARKER_MESSAGES.items()},
    'message_objects': _message_objects,
    'joint_states': _joint_states,
    'natnet': _natnet,
    'qtm': _qtm,
    'qtm_parameters': _qtm_parameters,
    'page_request': _page_request,
    'page_message': _page_message,
    'labels': _labels,
}
