"""Source node: take a motion capture system's points, publish them as the tracker's MarkerArrays.

`source` names the system: PointCloud2, messages of mocap4r2's drivers, OptiTrack over NatNet,
Qualisys over its real-time protocol, or landmarks of a headset or camera. What it publishes on
~/markers has the name of each marker as namespace; docs/sources.md says more.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from threading import Event, Thread
from traceback import format_exc
from typing import TYPE_CHECKING, Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2
from visualization_msgs.msg import MarkerArray

from ..adapters.hand_landmarks import (
    LandmarkChecks,
    landmark_order,
    landmarks_of_markers,
    landmarks_of_poses,
    named_landmarks,
)
from ..adapters.marker_arrays import MarkerArrayWriter
from ..adapters.marker_messages import (
    FIRST,
    MESSAGES_OF,
    SERVED,
    UP_AS_TOLD,
    USUAL_LANDMARKS,
    USUAL_TOPICS,
)
from ..adapters.mocap4r2 import points_of_markers, points_of_rigid_bodies
from ..adapters.natnet_client import COMMAND_PORT, NatNetClient
from ..adapters.packet_reception import ReceivedPacket
from ..adapters.point_cloud import points_of_cloud
from ..adapters.point_frame import (
    UPRIGHT,
    MalformedFrame,
    SourceFrame,
    SourceUnavailable,
    of_subject,
    subjects,
    turned_upright,
)
from ..adapters.qualisys import QTM_PORT, QualisysClient
from ..calibration.hand_labels import ids_of_both_hands
from ..core.model.hand import BOTH, SIDES
from ..core.model.marker_layout import MarkerLayout
from ..files.hand_file import choose_hand
from ..files.layout_file import choose_layout
from ..messages.builders import diagnostics
from ..messages.landmark_kinds import LANDMARK_ORDERS
from ..messages.marker_ids import SOURCE_FRAME, layout_ids
from ..tracking.diagnostics import QUIET_AFTER, STATUS_PERIOD
from ..tracking.rate_limit import OncePerKey
from ..tracking.source_status import SourceStatus
from .executors import steady_clock
from .message_types import imported_message
from .parameters import Parameter
from .runner import declare, log_line, run

if TYPE_CHECKING:
    from .marker_input import MarkerInput

SOURCE_DEPTH = 10    # messages of ~/markers, and of /diagnostics
INPUT_DEPTH = 5      # messages of a topic that wait
REST_TIME = 1.       # [s] after a fault of a client
SILENT_TIME = 5.     # [s] without a frame, after which a line says so
MOCAP4R2, TELEOP = 'mocap4r2_msgs', 'teleop_ros2_interfaces'

SOURCE_PARAMETERS = tuple(row._replace(read_only=True) for row in (
    Parameter('source', 'point_cloud', 'Where points come from', choices=(*MESSAGES_OF, *SERVED)),
    Parameter('message', FIRST, 'Of mocap4r2: markers, or rigid_bodies with their markers; of '
              'landmarks: pose_array, named_pose_array or marker_array; first is the first of '
              'these', choices=(FIRST, *USUAL_TOPICS)),
    Parameter('topic', '', "Topic of the messages; empty for the system's usual one"),
    Parameter('server', '127.0.0.1', 'Address of the computer with Motive or QTM'),
    Parameter('port', 0, "Its port; 0 for the system's usual one", range=(0, 65535)),
    Parameter('local_address', '', "Address of this computer in Motive's network; empty for any"),
    Parameter('components', '3d 3dnolabels', 'Of QTM: 3d or 3dres, 3dnolabels or 3dnolabelsres'),
    Parameter('latency', 0., 'Least time from exposure to receipt, for Qualisys, whose protocol '
              'does not tell it: all stamps are earlier by it [s]', range=(0., 1.)),
    Parameter('subject', '', 'Rigid body, marker set or subject whose markers alone are taken; '
              'empty for all'),
    Parameter('side', 'right', 'Side of the landmarks: right or left; of other sources both where '
              'names of markers tell the side, else any'),
    Parameter('landmarks', USUAL_LANDMARKS, 'Landmarks of a hand in a marker_array: 21, 25 or 26',
              range=(min(LANDMARK_ORDERS), max(LANDMARK_ORDERS))),
    Parameter('layout', '', "Markers that are worn, as the tracker's: their names get its ids"),
    Parameter('hand_file', '', 'Hand file with the markers that are worn, where layout is empty'),
    Parameter('frame', SOURCE_FRAME, 'Frame of points whose source names none'),
    Parameter('up', UP_AS_TOLD, "Axis that is up in the source's data, of which y is turned "
              'upright (+y in a file, where y is true); auto: as Qualisys says, z of others',
              choices=(UP_AS_TOLD, *UPRIGHT, *(f'+{axis}' for axis in UPRIGHT))),
))


def _worn_layout(values: Mapping[str, Any]) -> MarkerLayout:
    """Return the layout that the parameters name; the paper's eight markers for none."""
    if values['layout']:
        return choose_layout(values['layout'])
    path = values['hand_file']
    return choose_hand(path and Path(path).expanduser())[1]


class SourceNode(Node):
    """Node that publishes the points of one source as MarkerArrays."""

    _input: MarkerInput    # of a tracker in this process

    def __init__(self) -> None:
        super().__init__('source')
        values = self._values = declare(self, SOURCE_PARAMETERS)
        landmark_order(values['landmarks'])
        self._once, self._status = OncePerKey(), SourceStatus(time.monotonic())
        layout = _worn_layout(values)
        self._ids_of_both = ids_of_both_hands(layout)
        self._writer = MarkerArrayWriter(
            self._warn_once, self._ids_of_both if values['side'] == BOTH else layout_ids(layout))
        self._publisher = self.create_publisher(MarkerArray, '~/markers', SOURCE_DEPTH)
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', SOURCE_DEPTH)
        self._checks: LandmarkChecks | None = None
        self._take: Callable[[bytes], None] | None = None
        self._client: NatNetClient | QualisysClient | None = None
        self._has_frame = self._has_names = False
        self._ended, self._thread = Event(), None
        if values['source'] in SERVED:
            self._origin = f"{values['source']} server {values['server']}"
            self._client = self._new_client()
            self._thread = Thread(target=self._receive, args=(self._client,), daemon=True)
            self._thread.start()
        else:
            self._subscribe()
            self._origin = self._source.topic_name
            self._silence = self.create_timer(
                SILENT_TIME, self._report_silence, clock=steady_clock())
        self.create_timer(STATUS_PERIOD, self._publish_status, clock=steady_clock())
        self.get_logger().info(f'{self._origin}: publishing on {self._publisher.topic_name}')

    def _new_client(self) -> NatNetClient | QualisysClient:
        values = self._values
        common = values['server'], self._publish, self._on_news
        if values['source'] == 'natnet':
            return NatNetClient(*common, values['local_address'], values['port'] or COMMAND_PORT)
        return QualisysClient(*common, tuple(values['components'].split()), values['latency'],
                              values['port'] or QTM_PORT)

    def _receive(self, client: NatNetClient | QualisysClient) -> None:
        """Let a client receive until the node ends; after a fault of its own it begins anew."""
        while not self._ended.is_set():
            try:
                client.run(self._ended)
            except Exception as error:
                self._warn_once(f'fault {error!r}', f'{self._origin}: begun anew after a fault: '
                                f'{error!r}', f'\n{format_exc()}')
                self._ended.wait(REST_TIME)

    def _subscribe(self) -> None:
        values = self._values
        allowed = MESSAGES_OF[values['source']]
        name = allowed[0] if values['message'] == FIRST else values['message']
        if name not in allowed:
            raise SourceUnavailable(f"message: '{name}' is none of {values['source']}'s: "
                                    f"{', '.join(allowed)}")
        readers: dict[str, tuple[Any, Callable[[Any], SourceFrame]]] = {
            'point_cloud': (PointCloud2, points_of_cloud),
            'markers': ((MOCAP4R2, 'Markers'), points_of_markers),
            'rigid_bodies': ((MOCAP4R2, 'RigidBodies'), points_of_rigid_bodies),
            'pose_array': (PoseArray, landmarks_of_poses),
            'named_pose_array': ((TELEOP, 'NamedPoseArray'),
                                 partial(named_landmarks, side=values['side'])),
            'marker_array': (MarkerArray, partial(landmarks_of_markers,
                                                  count=values['landmarks']))}
        kind, self._read = readers[name]
        if values['source'] == 'landmarks':
            # A process's other nodes may have a side too, as `both`.
            if values['side'] not in SIDES:
                raise SourceUnavailable(f"side: '{values['side']}'; expected of landmarks: "
                                        f"{', '.join(SIDES)}")
            self._checks = LandmarkChecks(values['side'], self._warn_once)
        self._source = self.create_subscription(
            imported_message(*kind) if isinstance(kind, tuple) else kind,
            values['topic'] or USUAL_TOPICS[name], self._on_message,
            QoSProfile(depth=INPUT_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT))

    def hand_over(self, inputs: Iterable[MarkerInput]) -> None:
        """Hand the messages over to the input of a tracker in this process that takes the topic."""
        for one in inputs:
            take = one.taker(self._publisher.topic_name, MarkerArray)
            if take is not None:
                # The client's thread takes the input where there is a `_take`.
                self._input, self._take = one, take
                if self._client is not None:
                    self._client.relay = self._relay

    def _relay(self, sockets: Sequence[int], timeout: float,
               is_stream: bool = False) -> Sequence[ReceivedPacket] | None:
        """Receive for the client, as `Relay`; packets like the last one are handed over."""
        relay = self._input.relay
        if relay is None:
            return None
        packets = relay.receive(sockets, timeout, is_stream)
        relayed = sum(packet.is_relayed for packet in packets)
        if relayed:
            self._status.add_alike(time.monotonic(), relayed)
            if self._publisher.get_subscription_count():
                self._publisher.publish(relay.message())
        return packets

    def _on_message(self, message: Any) -> None:
        try:
            frame = self._read(message)
        except MalformedFrame as error:
            self._warn_once('malformed', f'left out is a message on {self._origin}: {error}')
            return
        if self._checks is not None:
            self._checks.check(frame)
        self._publish(frame)

    def _publish(self, frame: SourceFrame) -> None:
        """Publish a frame, in the thread in which it came."""
        values = self._values
        if subject := values['subject']:
            names, frame = frame.names, of_subject(frame, subject)
            if names and not frame.names:
                known = ', '.join(subjects(names))
                self._warn_once(f'subject {known}', f"{self._origin}: subject: '{subject}'; " + (
                    f'expected one of {known}' if known else
                    'expected none, as its markers have no subject'))
        up = values['up'].removeprefix('+')
        if up == UP_AS_TOLD:
            up = self._client.up if self._client is not None else 'z'
            if up not in UPRIGHT:
                self._warn_once('up', f'{self._origin}: {up} is up; expected z or y: the hand is '
                                'shown turned')
                up = 'z'
        if up != 'z':
            frame = turned_upright(frame, up)
        if not frame.frame_id:
            frame = frame._replace(frame_id=values['frame'])
        stamp = self.get_clock().now().to_msg() if frame.stamp is None else frame.stamp
        message = self._writer.write(frame, stamp)
        if self._take is not None:
            self._take(message)
            self._input.install_relay(frame.origin, self._writer)
        # Others may listen too.
        if self._take is None or self._publisher.get_subscription_count():
            self._publisher.publish(message)
        self._status.add(time.monotonic(), len(frame.names), len(frame.points))
        # Names may come later than the first points.
        if not self._has_frame or frame.names and not self._has_names:
            self._report_names(frame)

    def _report_names(self, frame: SourceFrame) -> None:
        """Log what a frame has, and that the names are of both hands where only one's are taken."""
        self._has_frame, self._has_names = True, bool(frame.names)
        log_line(self, False, f'{self._origin}: {len(frame.names)} named markers '
                          f'({", ".join(frame.names[:3])}{"..." if frame.names[3:] else ""}), '
                          f'{len(frame.points)} anonymous points')
        hands = {found[0] for found in map(self._ids_of_both, frame.names) if found is not None}
        if len(hands) > 1 and self._values['side'] != BOTH:
            self._warn_once('sides', f'{self._origin}: names of both hands; side:=both takes each '
                                     'by its side, as the tracker of both expects them')

    def _report_silence(self) -> None:
        self._silence.cancel()
        if not self._has_frame:
            log_line(self, True, f'{self._origin}: no frame yet; {self._who_publishes()}')

    def _who_publishes(self) -> str:
        """Return a line on the publishers of the source's topic."""
        kinds = sorted({info.topic_type for info in
                        self.get_publishers_info_by_topic(self._origin)})
        return f'it is published as {", ".join(kinds)}' if kinds else 'nobody publishes it'

    def _publish_status(self) -> None:
        now = time.monotonic()
        is_silent = self._client is None and self._status.quiet_for(now) > QUIET_AFTER
        status = self._status.status(now, self._who_publishes() if is_silent else '')
        self._diagnostics.publish(diagnostics(
            self.get_clock().now().to_msg(), f"{self.get_name()}: {self._values['source']}",
            self._origin, status))

    def _warn_once(self, key: str, text: str, details: str = '') -> None:
        """Log a warning once for each key; note it, without the details, in the status."""
        self._status.warn(time.monotonic(), text)
        if self._once.allows(key):
            log_line(self, True, text + details)

    def _on_news(self, is_warning: bool, text: str) -> None:
        log_line(self, is_warning, text)
        if is_warning:
            self._status.warn(time.monotonic(), text)

    def end(self) -> None:
        """End the client, which hands over nothing from then on."""
        self._ended.set()
        if self._thread is not None:
            self._thread.join()

    def destroy_node(self) -> None:
        """End the client too."""
        self.end()
        super().destroy_node()


def main(args: list[str] | None = None) -> int:
    """Run the source node until it is interrupted; return its exit code."""
    return run(SourceNode, args=args, name='source')


if __name__ == '__main__':
    sys.exit(main())
