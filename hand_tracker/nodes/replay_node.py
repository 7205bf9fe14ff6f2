"""Replay node: publish the messages of a rosbag2 recording at their recorded times.

Messages are published as recorded, without deserialising them, with the QoS that their publishers
offered, else reliable; points that are not in MarkerArrays become such. Topics have relative
names, so that `-r markers:=/other` and `-r __ns:=/left` act on them. The node ends with the
recording. Its exit code is 0 then and when interrupted, 1 when the recording cannot be played.
"""

import struct
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from importlib import import_module
from itertools import count
from math import inf
from types import SimpleNamespace
from typing import Any, NamedTuple

from rclpy.duration import Duration
from rclpy.node import Node, NodeNameNonExistentError
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock as ClockMessage

from ..core.errors import HandTrackerError
from ..core.model.hand import BOTH, SIDES
from ..core.model.marker_layout import MARKERS
from ..files.bag_points import POINT_MESSAGES
from ..files.bags import Bag, BagError, open_bag
from ..files.layout_file import choose_layout
from ..files.point_recording import HANDEDNESS, UNIT_SPELLINGS, UP_AXES
from ..files.recordings import ReadingOptions, is_bag
from ..messages.marker_array import MARKER_ARRAY
from ..messages.stamps import header_stamp, marker_stamps, restamp, stamp_of
from ..package_data import packaged_recording
from ..tracking.opened_recording import named_labels, open_recording
from ..tracking.playback import Playback, read_ahead
from ..tracking.point_bag import MarkerChoice, PointBag
from ..tracking.setting_names import in_parameters
from .executors import steady_clock
from .parameters import Parameter
from .runner import declare, run, spinning, work_in_thread

try:
    from rosbag2_interfaces import srv
except ImportError:
    srv = None

PLAYER_SERVICES = 'pause, resume, toggle_paused, is_paused, set_rate, play_next'
GLOBAL_TOPICS = ('/tf', '/tf_static', '/clock', '/rosout', '/parameter_events')
TRACKER_NODE = 'hand_tracker'  # name of the tracker's node
REPLAY_DEPTH = 1000       # messages: a slow subscriber gets all of a second at 960 Hz
CLOCK_DEPTH = 10          # messages of /clock
READ_AHEAD = 500          # messages read in advance
SWITCH_INTERVAL = 5e-4    # [s] after which the reading thread gives way to the playing one
DISCOVERY_POLL = .02      # [s]
DISCOVERY_TIME = .5       # [s] for subscribers to discover this publisher in turn
ACKNOWLEDGE_TIME = 1.     # [s]
ONE_MESSAGE_LAP = 10**8   # [ns] lap of a recording of a single message

REPLAY_PARAMETERS = tuple(row._replace(read_only=True) for row in (
    Parameter('recording', '', 'rosbag2 folder, .mcap or .db3 file, or a file of points (C3D, TRC, '
              'TSV, CSV, BVH, npz); empty for the packaged one of a right hand'),
    Parameter('rate', 1., 'How many times as fast as recorded', (1e-3, 1e3)),
    Parameter('loop', False, 'Begin again at the end instead of exiting'),
    Parameter('start_offset', 0., 'Where in the recording each lap begins [s]', (0., 1e9)),
    Parameter('start_paused', False, 'Wait for ~/resume or ~/play_next before the first message'),
    Parameter('restamp', True, 'Write the time at which a message is due into its stamps, as if '
              'it were live; a loop with old stamps silences robot_state_publisher. Without '
              'effect when clock is on, which the recorded stamps follow'),
    Parameter('clock', 0., 'Publications of the recorded time on /clock [Hz]; 0 is none',
              (0., 1e3)),
    Parameter('topics', '', 'Topics to play, as recorded, separated by spaces; empty for all but '
              'exclude_topics'),
    Parameter('exclude_topics', '', 'Topics not to play, separated by spaces: as recorded, or the '
              'last part of their names; those named in topics are played all the same'),
    Parameter('wait_for_subscriber', 10., 'How long to wait for subscribers of the markers '
              'before playing [s], .inf for ever; longer while a tracker in the same namespace '
              'is preparing; not when started paused', (0., inf)),
    Parameter('subscribers', 1, 'How many subscribers of the markers to wait for', (1, 100)),
    Parameter('side', '', 'Of the hand, or both, where a file of points has two',
              choices=('', *SIDES, BOTH)),
    Parameter('layout', '', "Markers of a file of points: a layout preset's name, or a layout file "
              "(YAML); empty for the paper's eight"),
    Parameter('markers', '', 'Which point of a file is which marker, as index=LFIN,thumb=LTHM: '
              'those that their labels do not tell'),
    Parameter('units', '', 'Unit of a file of points; empty: as it says',
              choices=('', *UNIT_SPELLINGS)),
    Parameter('up', '', 'Upward axis of a file of points; empty: as it says, else as its format '
              f'has it; one of {", ".join(UP_AXES)}', any_type=True),
    Parameter('handed', '', "Handedness of a file's axes; empty: as the hand tells",
              choices=('', *HANDEDNESS)),
    Parameter('frame_rate', 0., 'Of a file of points [Hz]; 0: as it says', (0., 1e5)),
    Parameter('subject', '', "Whose points of a file are played, where labels are such as "
              "'NAME:RIndexTip'; empty for all"),
    Parameter('partial', False, 'Play a file of points that is cut as far as it goes'),
))


class ReplayedTopic(NamedTuple):
    """A recorded topic that is published again.

    Attributes
    ----------
    publisher : Publisher
    find_stamps : callable
        Returns the offsets of the stamps in a serialised message.
    """

    publisher: Publisher
    find_stamps: Callable[[bytes], tuple]


class ReplayedMessage(NamedTuple):
    """A recorded message that is to be published.

    Attributes
    ----------
    time : int
        When it is due, in recorded time [ns].
    publisher : Publisher
    data : bytes
        Serialised (CDR).
    stamps : tuple of int
        Offsets of the stamps to rewrite; none when they stay as recorded.
    """

    time: int
    publisher: Publisher
    data: bytes
    stamps: tuple


class ReplayNode(Node):
    """Node that plays one recording."""

    def __init__(self) -> None:
        super().__init__('replay')
        self._options = SimpleNamespace(**declare(self, REPLAY_PARAMETERS))

    def play(self) -> None:
        """Play the recording to its end, or for ever when looping.

        Raises
        ------
        BagError
            If it cannot be played.
        """
        options = self._options
        with self._recording() as bag:
            for note in bag.notes:
                self.get_logger().info(f'{bag.path}: {in_parameters(note)}')
            if isinstance(bag, PointBag) and all(hand.side for hand in bag.hands):
                side = BOTH if len(bag.hands) > 1 else bag.hands[0].side
                self.get_logger().info(f'{bag.path}: markers for a tracker with side:={side}')
            if isinstance(bag, PointBag) and not bag.has_labels:
                self.get_logger().info(f'{bag.path}: points without labels, as of a tracker with '
                                       'labels:=none')
            start = bag.start + round(options.start_offset * 1e9)
            outputs = self._open_outputs(bag)
            points = [topic for topic in outputs if bag.topics[topic] in POINT_MESSAGES]
            markers = [topic for topic in points if bag.topics[topic] == MARKER_ARRAY] or points
            interval = bag.duration // max(1, max(bag.counts[topic] for topic in markers) - 1)
            lap = bag.start + bag.duration - start + (interval or ONE_MESSAGE_LAP)
            playback = Playback(start, options.rate, options.start_paused)
            self._serve(playback)
            with spinning(self), closing(playback):
                if not options.start_paused:
                    self._wait_for_subscribers([outputs[topic].publisher for topic in markers])
                if options.clock:
                    self._tick(lambda: start + _within(playback.now - start, lap, options.loop))
                self.get_logger().info(
                    f'Playing {bag.path}: {bag.duration * 1e-9:.1f} s of {", ".join(outputs)}'
                    + (', paused' if playback.paused else ''))
                work_in_thread(lambda: self._publish_all(playback, self._messages(
                    bag, outputs, start, lap)), playback.close)
            for output in outputs.values():
                output.publisher.wait_for_all_acked(Duration(seconds=ACKNOWLEDGE_TIME))
            self.get_logger().info('Played to the end')

    @contextmanager
    def _recording(self) -> Iterator[Bag]:
        """Open the recording; its faults name the node's parameters in place of options."""
        options = self._options
        # ROS reads y as a yes.
        up = 'y' if options.up is True else str(options.up)
        reading = ReadingOptions(options.units or None, up or None, options.handed or None,
                                 partial=options.partial,
                                 frame_rate=options.frame_rate or None,
                                 subject=options.subject or None)
        recording = options.recording or packaged_recording()
        with ExitStack() as stack:
            try:
                layout = choose_layout(options.layout) if options.layout else None
                names = named_labels(options.markers, MARKERS if layout is None else layout.names,
                                     options.side)
                choice = MarkerChoice(reading, options.side or None, names, layout, None)
                # Topics that are named are played as they are.
                bag = stack.enter_context(
                    open_bag(recording, options.partial) if options.topics and is_bag(recording)
                    else open_recording(recording, choice))
            except HandTrackerError as error:
                raise BagError(in_parameters(str(error))) from error
            yield bag

    def _publish_all(self, playback: Playback, messages: Iterator[ReplayedMessage]) -> None:
        with closing(read_ahead(messages, READ_AHEAD)) as ahead:
            playback.play(ahead, self._publish)

    def _publish(self, message: ReplayedMessage, due: int) -> None:
        data = restamp(message.data, message.stamps, due) if message.stamps else message.data
        message.publisher.publish(data)

    def _open_outputs(self, bag: Bag) -> dict[str, ReplayedTopic]:
        """Return a publisher for each recorded topic that is to be played."""
        wanted = list(dict.fromkeys(self._options.topics.split())) or self._not_excluded(bag)
        if unknown := [topic for topic in wanted if topic not in bag.topics]:
            raise BagError(f'{bag.path}: no topic {", ".join(unknown)}; expected topics among '
                           f'{", ".join(bag.topics)}')
        points = [topic for topic in wanted if bag.topics[topic] in POINT_MESSAGES]
        if not points:
            held = ', '.join(f'{topic} ({bag.topics[topic]})' for topic in wanted)
            raise BagError(f'{bag.path}: no markers in {held or "what is not excluded"}; '
                           f'expected a topic of {" or ".join(POINT_MESSAGES)}')
        outputs: dict[str, ReplayedTopic] = {}
        for topic in wanted:
            if topic == '/clock' and self._options.clock:
                continue
            kind = bag.topics[topic]
            message_type = _message_type(kind)
            if message_type is None:
                self.get_logger().warning(f'{topic}: not played, {kind} is not installed')
                continue
            live = self._options.restamp and not self._options.clock
            outputs[topic] = ReplayedTopic(
                self.create_publisher(
                    message_type, topic if topic in GLOBAL_TOPICS else topic.lstrip('/'),
                    _qos(bag.offered_qos[topic])),
                _stamp_finder(kind, message_type) if live else lambda data: ())
        if not outputs.keys() & points:
            raise BagError(f'{bag.path}: {bag.topics[points[0]]} of {points[0]} is not installed; '
                           'expected to be, or no topics: then its points are played as markers')
        return outputs

    def _not_excluded(self, bag: Bag) -> list[str]:
        names = self._options.exclude_topics.split()
        excluded = [topic for topic in bag.topics
                    if topic in names or topic.rpartition('/')[2] in names]
        if excluded:
            self.get_logger().info(f'Not played (exclude_topics): {", ".join(excluded)}')
        return [topic for topic in bag.topics if topic not in excluded]

    def _messages(self, bag: Bag, outputs: dict[str, ReplayedTopic], start: int,
                  lap: int) -> Iterator[ReplayedMessage]:
        for number in count() if self._options.loop else range(1):
            message = None
            for message in bag.messages(outputs, start):
                output = outputs[message.topic]
                try:
                    stamps = output.find_stamps(message.data)
                except (struct.error, IndexError) as error:
                    raise BagError(f'{bag.path}: a message of {message.topic} is cut off; '
                                   f'expected {message.type}') from error
                yield ReplayedMessage(
                    message.time + number * lap, output.publisher, message.data, stamps)
            if message is None:
                raise BagError(f'{bag.path}: no message after start_offset '
                               f'{self._options.start_offset:g} s; expected less than its '
                               f'duration, {bag.duration * 1e-9:.3f} s')

    def _wait_for_subscribers(self, publishers: Sequence[Publisher]) -> None:
        patience, wanted = self._options.wait_for_subscriber, self._options.subscribers
        if not patience:
            return
        names = ', '.join(publisher.topic_name for publisher in publishers)
        self.get_logger().info(f'Replay waits for {_subscribers(wanted)} of {names}')
        until = time.monotonic() + patience
        there, is_logged = 0, False
        while there < wanted:
            time.sleep(DISCOVERY_POLL)
            there = max(publisher.get_subscription_count() for publisher in publishers)
            if there < wanted and time.monotonic() > until:
                if not self._tracker_prepares():
                    self.get_logger().warning(
                        f'{_subscribers(there)} of {names} after {patience:g} s')
                    return
                if not is_logged:
                    is_logged = True
                    self.get_logger().info(f'Replay waits on: {TRACKER_NODE} is preparing')
        # Discovery runs both ways: a subscriber may learn of this publisher a little later.
        time.sleep(DISCOVERY_TIME)

    def _tracker_prepares(self) -> bool:
        """Return whether a tracker in this namespace runs and subscribes to no markers yet."""
        tracker = TRACKER_NODE, self.get_namespace()
        if tracker not in self.get_node_names_and_namespaces():
            return False
        with suppress(NodeNameNonExistentError):
            return not any(set(POINT_MESSAGES) & set(kinds) for _, kinds in
                           self.get_subscriber_names_and_types_by_node(*tracker))
        return False

    def _tick(self, recorded_time: Callable[[], int]) -> None:
        publisher = self.create_publisher(ClockMessage, '/clock', CLOCK_DEPTH)

        def tick() -> None:
            message = ClockMessage()
            message.clock.sec, message.clock.nanosec = stamp_of(recorded_time())
            publisher.publish(message)

        # A timer of ROS time would wait for this very clock.
        self.create_timer(1 / self._options.clock, tick,
                          clock=steady_clock())

    def _serve(self, playback: Playback) -> None:
        if srv is None:
            self.get_logger().warning(
                'rosbag2_interfaces is not installed: playing without the services '
                f'{PLAYER_SERVICES}')
            return

        def service(kind: type, name: str, act: Callable[[Any], dict | None]) -> None:
            def answer(request: Any, response: Any) -> Any:
                for field, value in (act(request) or {}).items():
                    setattr(response, field, value)
                return response
            self.create_service(kind, f'~/{name}', answer)

        service(srv.Pause, 'pause', lambda request: playback.pause())
        service(srv.Resume, 'resume', lambda request: playback.resume())
        service(srv.TogglePaused, 'toggle_paused', lambda request: playback.toggle_paused())
        service(srv.IsPaused, 'is_paused', lambda request: {'paused': playback.paused})
        service(srv.SetRate, 'set_rate',
                lambda request: {'success': playback.set_rate(request.rate)})
        service(srv.PlayNext, 'play_next', lambda request: {'success': playback.play_next()})


def _within(passed: int, lap: int, loop: bool) -> int:
    """Return the time since a lap began; when not looping it stands still at the end."""
    return passed % lap if loop else min(passed, lap)


def _subscribers(number: int) -> str:
    return f'{number or "no"} subscriber{"" if number == 1 else "s"}'


def _message_type(kind: str) -> type | None:
    """Return the Python class of a message type, None when its package is not installed."""
    package, _, name = kind.split('/')
    try:
        return getattr(import_module(f'{package}.msg'), name)
    except (ImportError, AttributeError):
        return None


def _stamp_finder(kind: str, message_type: Any) -> Callable[[bytes], tuple]:
    """Return the function that finds the stamps in serialised messages of a type."""
    if kind == MARKER_ARRAY:
        return marker_stamps
    fields = message_type.get_fields_and_field_types()
    if next(iter(fields.values()), None) == 'std_msgs/Header':
        return header_stamp
    return lambda data: ()


def _qos(offers: Sequence[Any]) -> QoSProfile:
    """Return the QoS of the recorded publishers; reliable if unknown or they differed."""
    qos = QoSProfile(depth=REPLAY_DEPTH)
    if len({(offer.reliability, offer.durability) for offer in offers}) == 1:
        offer = offers[0]
        if offer.history.name == 'KEEP_ALL':
            qos.history = HistoryPolicy.KEEP_ALL
        if offer.reliability.name == 'BEST_EFFORT':
            qos.reliability = ReliabilityPolicy.BEST_EFFORT
        if offer.durability.name == 'TRANSIENT_LOCAL':
            qos.durability = DurabilityPolicy.TRANSIENT_LOCAL
            qos.depth = offer.depth or REPLAY_DEPTH  # for subscribers that come late
    return qos


def main(args: list[str] | None = None) -> int:
    """Run the replay node; return its exit code."""
    sys.setswitchinterval(SWITCH_INTERVAL)
    return run(ReplayNode, ReplayNode.play, args, 'replay')


if __name__ == '__main__':
    sys.exit(main())
