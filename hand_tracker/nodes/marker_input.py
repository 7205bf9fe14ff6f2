"""The markers of one topic, for one hand or both: subscription, slow path and fast path."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from rclpy.timer import Timer

from ..tracking.rate_limit import period_ns
from ..tracking.stream import TrackedFrame
from .executors import steady_clock, wake_timer
from .fast_path import PUBLISHER_SILENCE, FastPath, InstalledHand, PacketRelay
from .replies import Replies
from .tracked_hand import TrackedHand

if TYPE_CHECKING:
    from ..adapters.marker_arrays import MarkerArrayWriter
    from ..adapters.packet_structure import PacketOrigin
    from .tracker_node import TrackerNode

# Discovery may bring a publisher's node later than its messages: asked for this often, at reports.
NAME_LOOKUPS = 50


class MarkerInput:
    """Track the hands whose markers come on one topic, each message on the slow or the fast path.

    Parameters
    ----------
    node : TrackerNode
    kind : type
        Of the messages.
    topic : str
    qos : QoSProfile
    hands : sequence of TrackedHand
        That are in its messages.
    replies : Replies
        Of these hands, in this order.
    raw : bool
        Whether messages are taken as bytes.
    keeps_publisher : bool
        See `FastPath.start`.

    Attributes
    ----------
    topic : str
        Its full name.
    subscription : rclpy.subscription.Subscription or None
        None where a node of this process hands its messages over.
    hands, replies
    fast_path : FastPath or None
        While it serves the subscription.
    is_active : bool
        Whether messages are tracked; set it where the fast path is disabled.
    """

    def __init__(self, node: TrackerNode, kind: type, topic: str, qos: QoSProfile,
                 hands: Sequence[TrackedHand], replies: Replies, raw: bool,
                 keeps_publisher: bool) -> None:
        self.hands, self.replies = hands, replies
        self.fast_path: FastPath | None = None
        self.is_active = True
        self._node, self._raw, self._keeps_publisher = node, raw, keeps_publisher
        self._name_lookups = NAME_LOOKUPS
        self.subscription: Subscription | None = node.create_subscription(
            kind, topic, self._on_markers, qos, raw=raw)
        self.topic = self.subscription.topic_name
        self._relay: PacketRelay | None = None
        self._handed: deque[bytes] = deque(maxlen=qos.depth)
        self._handed_timer = wake_timer(node, self._track_handed)
        self._handed_timer.cancel()
        self._waiting: list[tuple[Any, float]] = []
        self._newest_timer = wake_timer(node, self._track_newest)
        self._newest_timer.cancel()
        self._drain_timer: Timer | None = None
        for hand in hands:
            hand.listen_to(self.topic)

    def start_fast_path(self, fast_path: FastPath) -> None:
        """Serve the subscription by a fast path, until `stop_fast_path`."""
        self.fast_path = fast_path
        self._drain_timer = self._node.create_timer(1., self.drain, clock=steady_clock())
        self._drain_timer.cancel()
        fast_path.start(self._node, self.subscription, self._drain_fast_path, self._on_markers,
                        self._keeps_publisher, self._handed)
        if self.subscription is None:
            self._relay = PacketRelay(fast_path)

    def taker(self, topic: str, kind: type) -> Callable[[bytes], None] | None:
        """Return the callback that takes a topic's messages from a node of this process.

        The topic is not subscribed to then; to be called before the executor is there.

        Parameters
        ----------
        topic : str
            Its full name.
        kind : type
            Of the messages.

        Returns
        -------
        callable or None
            To be called with each message as bytes, always in the same thread, in which it is
            tracked on the fast path. None where it is not this topic, or messages are no bytes.
        """
        if self.subscription is None or not self._raw or (topic, kind) != (
                self.topic, self.subscription.msg_type):
            return None
        self._node.destroy_subscription(self.subscription)
        self.subscription = None
        return self._take

    def _take(self, message: bytes) -> None:
        # The executor's thread may stop it meanwhile.
        fast_path = self.fast_path
        # What waits is of an earlier time.
        if self._handed or fast_path is None or not fast_path.process(message):
            self._handed.append(message)
            self._handed_timer.reset()

    @property
    def relay(self) -> PacketRelay | None:
        """Relay of a source's packets; None without a fast path, or while messages wait."""
        return None if self._handed else self._relay

    def install_relay(self, origin: PacketOrigin | None, writer: MarkerArrayWriter) -> None:
        """Relay packets like the last one, also where it waits; see `PacketRelay.install`.

        To be called in the thread that hands messages over.
        """
        relay = self._relay
        if relay is not None:
            relay.install(origin, writer)

    def _track_handed(self) -> None:
        """Track what was handed over, in the executor's thread."""
        self._handed_timer.cancel()
        if self.fast_path is not None:
            self.fast_path.serve_slow_path()
            return
        while self._handed:
            self._on_markers(self._handed.popleft())

    def stop_fast_path(self) -> None:
        """Leave the subscription to the executor; to be called while it is still there."""
        if self.fast_path is not None:
            self.fast_path.stop()
            self._node.destroy_timer(self._drain_timer)
        self.fast_path = self._drain_timer = self._relay = None

    def disable_fast_path(self) -> None:
        """Let the next message take the slow path."""
        if self.fast_path is not None:
            self.fast_path.disable()

    def _on_markers(self, message: Any) -> None:
        if not self.is_active:
            return
        received = time.monotonic()
        if not all(hand.stream.is_compiled for hand in self.hands):
            # Plain Python may be slower than frames come: all that wait are taken before the
            # newest is tracked, and other callbacks have their turn in between.
            self._waiting.append((message, received))
            if self._newest_timer.is_canceled():
                self._newest_timer.reset()
        else:
            self._track(message, received)

    def _track_newest(self) -> None:
        """Track the newest of the waiting frames; count the others as left out."""
        self._newest_timer.cancel()
        # Executors that wait for conditions bring one message at a time.
        while (message := self._next()) is not None:
            self._waiting.append((message, time.monotonic()))
        waiting, self._waiting = self._waiting, []
        for older, (message, received) in reversed(list(enumerate(waiting))):
            if self._track(message, received):
                self.drain()
                for hand in self.hands:
                    hand.left_out(older)
                return

    def _next(self) -> Any:
        """Return the next message that waits for the slow path alone, or None."""
        if self.subscription is None:
            return self._handed.popleft() if self._handed else None
        taken = self.subscription.handle.take_message(self.subscription.msg_type, self._raw)
        return None if taken is None else taken[0]

    def _track(self, message: Any, received: float) -> bool:
        """Track each hand's markers of a message, and answer with all together.

        Returns
        -------
        bool
            Whether a marker of a hand was in it.
        """
        markers = [hand.read(message) for hand in self.hands]
        if any(found is not None and found.stamp is None for found in markers):
            # What has none of a hand's markers is noted after the frames before it.
            self.drain()
        frames: dict[int, TrackedFrame] = {}
        for number, (hand, found) in enumerate(zip(self.hands, markers)):
            frame = None if found is None else hand.track(found, received)
            if frame is not None:
                frames[number] = frame
        if not frames:
            return False
        if self.fast_path is not None:
            self.fast_path.invalidate()
        valid = {number: frame for number, frame in frames.items() if frame.is_valid}
        if not self.replies.publish(valid):
            self.hands[0].warn_once('repeated', 'stamps repeat: /tf has each stamp only once')
        for number, frame in frames.items():
            self.hands[number].published(frame)
        if self.fast_path is not None and all(
                frame.is_valid and frame.is_regular
                and not self.hands[number].needs_each_frame
                for number, frame in frames.items()):
            self._install(self.fast_path, frames)
        return True

    def _install(self, fast_path: FastPath, frames: dict[int, TrackedFrame]) -> None:
        """Let the fast path process messages like this one."""
        hands = []
        for number in frames:
            stream = self.hands[number].stream
            signature = stream.reader.signature
            assert signature is not None
            hands.append(InstalledHand(
                number, stream.tracker.kernel_arguments(), stream.tracker.layout, signature))
        settings = self.hands[0].settings
        first, *others = (frame.stamp for frame in frames.values())
        if all(stamp == first for stamp in others):
            fast_path.install(hands, first, settings.unit_scale, settings.zero_is_missing,
                              self.replies.replies_to(frames))

    def _drain_fast_path(self) -> None:
        """Take over the frames of the fast path, before those of the slow path."""
        if self.fast_path is None:
            return
        for number, hand in enumerate(self.hands):
            frames = self.fast_path.drain(number)
            if frames is not None:
                self.replies.published_until(number, frames.stamp)
                hand.published_by_fast_path(frames)

    def drain(self) -> None:
        """Monitor the frames published since the last call, of both paths."""
        self._drain_fast_path()
        for hand in self.hands:
            hand.monitor()

    def name_publishers(self) -> None:
        """Say once that messages of another publisher than the one tracked are left out."""
        publishers = None if self.fast_path is None else self.fast_path.publishers
        if publishers is None or not self._name_lookups:
            return
        self._name_lookups -= 1
        topic = self.topic
        names = [self._node.publisher_name(topic, guid) for guid in publishers]
        if None in names and self._name_lookups:
            return
        self._name_lookups = 0
        kept, other = (name or 'an unknown publisher' for name in names)
        other = f'another {other}' if other == kept else other
        self.hands[0].warn_once(
            'publishers', f'several nodes publish on {topic}: {kept} is tracked until it is silent '
            f'for {PUBLISHER_SILENCE:g} s, and what {other} sends meanwhile is left out '
            '(publishers)')

    def drain_at(self, rate: float | None) -> None:
        """Drain the fast path at a rate [Hz], for displays; None to leave it to the caller."""
        if self._drain_timer is None:
            return
        if rate is None:
            self._drain_timer.cancel()
            return
        self._drain_timer.timer_period_ns = period_ns(rate)
        if self._drain_timer.is_canceled():
            self._drain_timer.reset()
