"""Retarget node: joint states of a hand in, commands for a robot hand out, and for its wrist.

Nothing moves before the robot is engaged: ~/engage (service or topic), or the deadman. See
docs/teleoperation.md.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from threading import Event, Thread, Timer
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion, Twist, TwistStamped, Vector3
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Header, String
from std_srvs.srv import SetBool

from ..core.model.hand import SIDES, Hand
from ..core.numerics.jit import DEFERRED
from ..messages.builders import diagnostics
from ..messages.cdr import MalformedMessage
from ..messages.joint_states import JointPositions, JointStateReader
from ..messages.pose_fields import pose_numbers
from ..messages.stamps import Stamp, nanoseconds, stamp_of
from ..messages.templates import Template
from ..retargeting.command_guard import NO_HAND, ROBOT_MISSING, WAS_LOST, GuardState
from ..retargeting.command_pace import CommandPace
from ..retargeting.guard_options import GuardOptions
from ..retargeting.robot_file import LoadedRobot, load_robot
from ..retargeting.teleoperation import Teleoperation, compile_following
from ..retargeting.wrist_follower import WristCommand, WristOptions, wrist_pose_of
from ..retargeting.wrist_teleoperation import WristTeleoperation
from ..tracking.compilation import COMPILE_TIME
from ..tracking.diagnostics import Level, Status
from .command_messages import OUTPUTS, command_template
from .executors import SubscriptionHidingNode, steady_clock
from .fast_path import CommandPath, FastPathUnavailable, ListedJoints
from .message_types import imported_message
from .parameters import Parameter, option_parameters, options_of
from .runner import InvalidArguments, declare, names_of, namesake_fault, refuse_unknown, run
from .serialization import UNKNOWN_LAYOUT, Serialization
from .topic_publishers import UNPUBLISHED, full_name
from .tracker_parameters import AUTO, START, starting_hand, with_defaults

RETARGET_DEPTH = 10     # messages that wait at most
RETARGET_STATUS_PERIOD = 1.  # [s]
NOTICE_AFTER = 2.       # [s] of compiling or loading kernels
FAR_FROM_COMMAND = .5   # [rad] above which a robot does not do what is commanded
FAR_TIME = .9           # [s] for which it is so: at two statuses
RESTART_TURNS = 3       # of the publishers of the hand between two statuses; one restart takes one
SHOWN_PERIOD = .05      # [s] between two frames that show the robot while kernels are compiled
# What to do where others publish joint states on the topic of the hand, or of the robot.
SHARED_HAND = ('give the hand a topic of its own (remap joint_states). Joints of others are left '
               'out, which takes time; two trackers of one hand would both move the robot (one '
               'that was killed counts for 20 s)')
SHARED_ROBOT = ("only one of them may name this robot's joints; a joint_state_publisher beside the "
                'driver contradicts it')
LAST_STATE_WAIT = .2    # [s] that the last messages may take to reach their listeners
DISCOVERED_AFTER = 3.   # [s] after which all topics of a node are known
WAKING_PERIOD = .01     # [s] between two checks of what waits
WRIST_OUTPUTS = {'pose': ('robot/wrist_target', PoseStamped),
                 'twist': ('robot/wrist_twist', TwistStamped)}
# Those that the tracker has too and that shape the hand.
PERSON_PARAMETERS = ('hand_file', 'side', 'hand_length', 'hand_breadth', 'limits.preset', 'thumb',
                     'prefix', 'wrist_frame', 'on_body')
RETARGET_PARAMETERS = tuple(row._replace(read_only=True) for row in (
    *(row for row in START if row.name in PERSON_PARAMETERS),
    Parameter('robot', '', 'Robot hand: a preset, a robot file, a dex-retargeting file or a URDF'),
    Parameter('robot_description', '', "The robot's URDF: path, package:// path or XML; empty for "
              "the robot file's"),
    Parameter('outputs', 'joint_state', f'What is sent, separated by spaces: {" ".join(OUTPUTS)}'),
    Parameter('order', '', "Joints of a command in their order, separated by spaces; empty for the "
              "robot file's"),
    Parameter('rate', 100., 'Of commands while no frame of the hand comes [Hz]; each frame is '
              'answered at once', (1., 1000.)),
    Parameter('fast_path', True, 'Answer regular frames of the hand in compiled code alone, in the '
              "middleware's own thread"),
    Parameter('min_confidence', .05, 'How much must be known of the hand, by the deviations of its '
              'angles: 1 all, 0 as much as without any marker; the hand is lost below', (0., 1.)),
    Parameter('show_robot', False, 'Publish on robot/shown, for those who show the robot, what is '
              'commanded, and while it is not engaged where it is'),
    *option_parameters(GuardOptions, 'safety.'),
    Parameter('wrist.outputs', '', "What is sent for the robot's wrist, separated by spaces: "
              f'{" ".join(WRIST_OUTPUTS)}; empty for nothing'),
    Parameter('wrist.base_frame', 'base_link', "Frame of the robot's base, in which it is sent"),
    *option_parameters(WristOptions, 'wrist.'),
))


class RetargetNode(SubscriptionHidingNode):
    """Node that drives one robot hand by one human hand."""

    _fast_path: CommandPath | None = None
    _wrist: WristTeleoperation | None = None
    _shown: Publisher | None = None

    def __init__(self) -> None:
        super().__init__('retarget')
        values = declare(self, RETARGET_PARAMETERS)
        # A robot is not moved by other limits than those meant.
        refuse_unknown(self, ('safety', 'wrist'))
        if not values['robot']:
            raise InvalidArguments('robot: empty; expected a preset or a file, as '
                                   '--ros-args -p robot:=allegro')
        loaded, hand = _robot_and_person(values)
        names = names_of(hand, values['prefix'], values['wrist_frame'], values['on_body'])
        self._teleoperation = Teleoperation(
            loaded, hand, names.prefix, options_of(GuardOptions, values, 'safety.'),
            values['min_confidence'])
        self._period = 1. / values['rate']
        self._outputs = self._make_command_outputs(values)
        self._wrist_outputs = self._make_outputs(
            'wrist.outputs', WRIST_OUTPUTS, values['wrist.outputs'].split())
        raw = Serialization().raw
        if not raw:
            self.get_logger().warning(f'{UNKNOWN_LAYOUT}: slower')
        self._templates = [command_template(name, self._teleoperation.order, self._period, raw)
                           for name, _ in self._outputs]
        self._compile(loaded, hand)
        self._wrist_frame, self._base_frame = names.tracked, values['wrist.base_frame']
        if self._wrist_outputs:
            # Not without need, as it imports scipy, which takes longer than all else here.
            self._wrist = WristTeleoperation(
                options_of(WristOptions, values, 'wrist.'), self._base_frame,
                any(name == 'pose' for name, _ in self._wrist_outputs),
                self._teleoperation.guard.options.robot_timeout)
        self._status_name = f'{self.get_name()}: {loaded.hand.name} {loaded.hand.side}'
        self._said: tuple[str, str] | None = None
        self._known_jumps = self._known_turns = 0   # of the last status
        self._judges_hand = values['min_confidence'] > 0.
        self._judged_time = time.monotonic()  # when deviations last said how much is known of it
        self._known_judged_count = 0
        self._unjudged = ''     # why nobody judges the hand, as it was logged last
        self._sent = self._wrist_sent = -self._period
        self._namesake_fault = ''  # as of the last status, or of who engages
        self._far_joint, self._far_since = '', 0.   # from its command, at the last status [s]
        self._warned: set[str] = set()  # of what
        if values['fast_path'] and raw:
            self._prepare_fast_path()
        self._listen(raw)
        for line in loaded.notes:
            self.get_logger().warning(f'unsure: {line}')
        self.get_logger().info(f'{loaded.hand.name}: not engaged; listening for the {hand.side} '
                               f"hand on {self.resolve_topic_name('joint_states')}")
        self._publish_state()

    def _compile(self, loaded: LoadedRobot, hand: Hand) -> None:
        """Compile or load the kernels; log a line where that takes long."""
        notice = Timer(NOTICE_AFTER, self.get_logger().info, [
            f'preparing the kernels; the first time they are compiled, for {COMPILE_TIME}'])
        notice.start()
        try:
            with self._shown_in_thread():
                compile_following(loaded, hand)
        finally:
            notice.cancel()

    @contextmanager
    def _shown_in_thread(self) -> Iterator[None]:
        """Show the robot beside the hand, in a thread."""
        if self._shown is None:
            yield
            return
        is_over = Event()
        executor = SingleThreadedExecutor(context=self.context)
        executor.add_node(self)

        def serve() -> None:
            while not is_over.wait(SHOWN_PERIOD) and self.context.ok():
                try:
                    executor.spin_once(timeout_sec=0.)
                except Exception as error:
                    if self.context.ok():
                        self.get_logger().error(f'{type(error).__name__}: {error}',
                                                throttle_duration_sec=10.)

        thread = Thread(target=serve)
        hands = self.create_subscription(
            JointState, 'joint_states', lambda hand: self._show_present(hand.header.stamp),
            QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT))
        thread.start()
        try:
            yield
        finally:
            is_over.set()
            thread.join()
            executor.remove_node(self)
            executor.shutdown()
            self.destroy_subscription(hands)

    def _make_command_outputs(self, values: Mapping[str, Any]) -> list[tuple[str, Publisher]]:
        """Return the name and publisher of each output for the robot, and of what is shown."""
        outputs = self._make_outputs('outputs', OUTPUTS, values['outputs'].split())
        if not outputs:
            raise InvalidArguments(f"outputs: empty; expected of {', '.join(OUTPUTS)}")
        if values['show_robot']:
            self._shown = self.create_publisher(JointState, 'robot/shown', RETARGET_DEPTH)
            outputs.append(('joint_state', self._shown))
        return outputs

    def _make_outputs(self, parameter: str, known: Mapping[str, tuple[str, Any]],
                      chosen: list[str]) -> list[tuple[str, Publisher]]:
        """Return the name and publisher of each chosen output."""
        for name in chosen:
            if name not in known:
                raise InvalidArguments(f"{parameter}: '{name}'; expected of {', '.join(known)}")
        return [(name, self.create_publisher(known[name][1], known[name][0], RETARGET_DEPTH))
                for name in dict.fromkeys(chosen)]

    def _listen(self, raw: bool) -> None:
        self._hand_fault, self._faulty_reason = '', ''   # the fault, and the guard's reason then
        latest, recent = (QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)
                          for depth in (1, RETARGET_DEPTH))
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', RETARGET_DEPTH)
        self._state = self.create_publisher(String, '~/state', latched)
        # Of the hand, its deviations and the robot.
        self._joint_readers: list[JointStateReader] = []
        self._joint_subscriptions: list[Any] = []
        self._read_joints: list[Callable[[Any], None]] = []
        # An arm of 1 kHz on the same topic leaves room for the states of a hand; of those, plain
        # Python may be too slow for all, and answers the latest.
        of_hand = latest if self._fast_path is None else recent
        for topic, callback, profile in (('joint_states', self._on_hand, of_hand),
                                         ('joint_confidence', self._on_deviations, latest),
                                         ('robot/joint_states', self._on_robot, recent)):
            reader = JointStateReader()
            read = partial(self._read, reader.read if raw else _read_object, callback)
            self._joint_readers.append(reader)
            self._read_joints.append(read)
            self._joint_subscriptions.append(
                self.create_subscription(JointState, topic, read, profile, raw=raw))
        self.create_subscription(Bool, '~/engage', self._on_engage, RETARGET_DEPTH)
        self.create_subscription(Bool, '~/deadman', self._on_deadman, latest)
        self.create_service(SetBool, '~/engage', self._serve_engage)
        if self._wrist_outputs:
            self.create_subscription(
                imported_message('tf2_msgs', 'TFMessage'), '/tf', self._on_transforms, recent)
            self.create_subscription(PoseStamped, 'robot/wrist_pose', self._on_robot_wrist, latest)
            self.create_subscription(Bool, '~/clutch', self._on_clutch, RETARGET_DEPTH)
        tick = min(self._period, WAKING_PERIOD)
        self._pace, self._wrist_pace = (CommandPace(self._period, tick) for _ in range(2))
        self.create_timer(tick, self._on_timer, clock=steady_clock())
        self.create_timer(RETARGET_STATUS_PERIOD, self._publish_status, clock=steady_clock())

    # The fast path

    def _prepare_fast_path(self) -> None:
        try:
            self._fast_path = CommandPath(self._teleoperation.packs)
        except FastPathUnavailable as error:
            until = (': once the tracker has compiled them, this node uses them when it is started '
                     'anew' if DEFERRED else '')
            self.get_logger().info(f'no fast path, frames are slower: {error}{until}')

    @contextmanager
    def served_by_events(self) -> Iterator[None]:
        """Use the fast path while an EventsExecutor serves the node."""
        if self._fast_path is None:
            yield
            return
        hand, *others = self._joint_subscriptions
        self._fast_path.start_all(
            self, hand, others, self._take_over, self._on_slow_message)
        try:
            yield
        finally:
            self._fast_path.stop()

    def hidden_subscriptions(self) -> Sequence[Subscription]:
        """Return the subscriptions that the fast path serves now."""
        return () if self._started_path is None else self._joint_subscriptions

    @property
    def _started_path(self) -> CommandPath | None:
        """The fast path, while it is started."""
        path = self._fast_path
        return path if path is not None and path.is_started else None

    def _take_over(self) -> None:
        """Take over from the fast path, and read what waits."""
        path = self._started_path
        if path is None:
            return
        path.disable()
        self._sent = max(self._sent, path.served_time)
        for topic, data in path.take_others():
            self._read_joints[1 + topic](data)

    def _on_slow_message(self, data: bytes) -> None:
        """Answer a message of the hand, and let the fast path answer those like it."""
        assert self._fast_path is not None
        self._fast_path.invalidate()
        self._read_joints[0](data)
        templates = [one for one in self._templates if isinstance(one, Template)]
        # What is shown of a robot that is not engaged, the slow path publishes.
        is_served = self._shown is None or self._teleoperation.guard.is_engaged
        if is_served and self._teleoperation.is_regular and len(templates) == len(self._outputs):
            hand, *others = map(ListedJoints, self._joint_readers, self._teleoperation.rows)
            self._fast_path.install(hand, others, [
                (publisher, template)
                for (_, publisher), template in zip(self._outputs, templates)])

    def destroy_node(self) -> None:
        """Stop the arm, and say on `~/state` that nothing moves the robot any more."""
        if self.context.ok():
            self._teleoperation.guard.disengage('the node ends')
            self._stop_wrist()
            self._publish_state()
            for publisher in (self._state, *(one for _, one in self._wrist_outputs)):
                publisher.wait_for_all_acked(Duration(seconds=LAST_STATE_WAIT))
        super().destroy_node()

    # What comes in

    def _read(self, read: Callable[[Any], JointPositions],
              callback: Callable[[JointPositions], None], message: Any) -> None:
        try:
            callback(read(message))
        except MalformedMessage as error:
            self.get_logger().warning(f'left out: {error}', throttle_duration_sec=10.)

    def _on_hand(self, hand: JointPositions) -> None:
        now = time.monotonic()
        if self._teleoperation.observe_hand(
                hand.names, hand.positions, now, nanoseconds(hand.stamp)):
            self._send(now, hand.stamp)
        self._show_present(hand.stamp)
        self._publish_state()

    def _on_deviations(self, hand: JointPositions) -> None:
        self._teleoperation.observe_deviations(hand.names, hand.positions, hand.effort)

    def _on_robot(self, robot: JointPositions) -> None:
        self._teleoperation.observe_robot(
            robot.names, robot.positions, time.monotonic(), nanoseconds(robot.stamp))

    def _on_transforms(self, message: Any) -> None:
        assert self._wrist is not None
        for transform in message.transforms:
            if transform.child_frame_id == self._wrist_frame:
                now = time.monotonic()
                self._wrist.observe(wrist_pose_of(*pose_numbers(transform.transform)), now,
                                    transform.header.frame_id)
                self._send_wrist(now)

    def _on_robot_wrist(self, message: PoseStamped) -> None:
        assert self._wrist is not None
        if fault := self._wrist.observe_robot(
                wrist_pose_of(*pose_numbers(message.pose)), time.monotonic(),
                message.header.frame_id, nanoseconds(message.header.stamp)):
            self.get_logger().warning(f'left out: {fault}', once=True)

    def _on_clutch(self, message: Bool) -> None:
        assert self._wrist is not None
        self._wrist.is_clutched = message.data

    def _on_timer(self) -> None:
        now, sent, guard = time.monotonic(), self._sent, self._teleoperation.guard
        if self._started_path is not None:
            sent = max(sent, self._started_path.served_time)
        # Frames of the hand are answered as they come; this is for when they do not.
        if self._pace.is_due(now, sent):
            self._take_over()
            self._send(now)
        elif not guard.is_engaged:
            guard.judge_ages(now)
        if self._wrist is not None and self._wrist_pace.is_due(now, self._wrist_sent):
            self._send_wrist(now)
        self._publish_state()

    def _on_deadman(self, message: Bool) -> None:
        self._take_over()
        if message.data:
            self._engage_by(self._teleoperation.guard.press)
        else:
            self._teleoperation.guard.release()
            self._stop_wrist()
        self._publish_state()

    def _on_engage(self, message: Bool) -> None:
        self._engage(message.data, self._teleoperation.guard.request)

    def _serve_engage(self, request: Any, response: Any) -> Any:
        reason = self._engage(request.data, self._teleoperation.guard.engage)
        response.success, response.message = not reason, reason or self._reason
        return response

    def _engage(self, wanted: bool, engage: Callable[[float], str]) -> str:
        self._take_over()
        reason = ''
        if wanted:
            self._namesake_fault = namesake_fault(self)
            reason = self._engage_by(engage)
        else:
            self._teleoperation.guard.disengage()
            self._stop_wrist()
        self._publish_state()
        return reason

    def _engage_by(self, act: Callable[[float], str]) -> str:
        """Engage the robot by an act of its guard, and the arm with it; return why not."""
        now = time.monotonic()
        guard = self._teleoperation.guard
        topic, _, robot_topic = (one.topic_name for one in self._joint_subscriptions)
        if not guard.is_engaged:
            self._stop_wrist()
            if self._namesake_fault:
                self.get_logger().warning(f'not engaged: {self._namesake_fault}',
                                          throttle_duration_sec=10.)
                return self._namesake_fault
        reason, self._hand_fault = act(now), ''
        if reason and not self.count_publishers(topic):
            self._hand_fault, self._faulty_reason = (
                f'{UNPUBLISHED} {topic}', guard.reason)
            reason = f'{reason}; {self._hand_fault}'
        elif reason == NO_HAND and (why := self._teleoperation.why_lost(now)):
            reason = f'{reason}; {why}'
        elif reason.startswith(ROBOT_MISSING) and not self.count_publishers(robot_topic):
            reason = f'{reason}; nobody publishes {robot_topic}'
        if self._wrist is not None and not reason:
            self._wrist.engage(now)
        return reason

    def _send(self, now: float, stamp: Stamp | None = None) -> None:
        """Send the commands of now; those that answer a frame of the hand have its stamp."""
        command = self._teleoperation.command(now)
        # Before the commands of a state, so that none seems to be of the state before.
        self._publish_state()
        if command is not None:
            self._sent = now
            stamp = stamp or stamp_of(self.get_clock().now().nanoseconds)
            for (_, publisher), template in zip(self._outputs, self._templates):
                publisher.publish(template.fill(stamp, command.position))

    def _show_present(self, stamp: Stamp) -> None:
        """Publish where the robot is while it is not engaged, for those who show it."""
        if self._shown is not None and not self._teleoperation.guard.is_engaged:
            self._shown.publish(self._templates[-1].fill(stamp, self._teleoperation.present))

    def _send_wrist(self, now: float) -> None:
        """Send the wrist's command; it moves only while the fingers follow."""
        self._wrist_sent = now
        assert self._wrist is not None
        guard = self._teleoperation.guard
        if reason := self._wrist.ended(now):
            self._take_over()
            guard.disengage(reason)
        if not guard.is_engaged:
            self._stop_wrist()
            self._publish_state()
        self._publish_wrist(self._wrist.command(now, guard.is_following), ('pose', 'twist'))

    def _stop_wrist(self) -> None:
        """Let the arm stay where it is: a twist that nobody follows by another ends in zero."""
        if self._wrist is not None:
            self._publish_wrist(self._wrist.disengage(), ('twist',))

    def _publish_wrist(self, sent: WristCommand | None, kinds: Sequence[str]) -> None:
        """Publish a command, if there is one, on the outputs of some of `WRIST_OUTPUTS`."""
        if sent is None:
            return
        header = Header(stamp=self.get_clock().now().to_msg(), frame_id=self._base_frame)
        for name, publisher in self._wrist_outputs:
            if name in kinds:
                publisher.publish(_wrist_message(name, header, sent))

    @property
    def _reason(self) -> str:
        """Why the robot is in its state, and why its arm stays, for a person."""
        guard = self._teleoperation.guard
        fault = self._wrist_fault if guard.is_engaged else (
            self._hand_fault if guard.reason == self._faulty_reason else '')
        if not fault and (guard.reason in (NO_HAND, WAS_LOST) or guard.state in (
                GuardState.HOLDING, GuardState.RELAXING)):
            fault = self._teleoperation.why_lost(time.monotonic())
        return f'{guard.reason}; {fault}' if fault else guard.reason

    @property
    def _wrist_fault(self) -> str:
        """Why the arm stays though the fingers are engaged, or nothing."""
        return '' if self._wrist is None else self._wrist.fault

    def _publish_state(self) -> None:
        """Publish and log the state where it has changed."""
        guard = self._teleoperation.guard
        said = guard.state.value, self._teleoperation.fault or self._reason
        if said == self._said:
            return
        self._said = said
        self._state.publish(String(data=said[0]))
        self.get_logger().info(f'{said[0]}: {said[1]}')
        self._publish_status()

    def _publishers_of(self, topic: str) -> list[str]:
        """Return the names of the nodes that publish a topic, as often as they do, sorted."""
        return sorted(filter(None, map(full_name, self.get_publishers_info_by_topic(topic))))

    def _warn_of_shared_topics(self) -> None:
        """Warn once where not the hand's tracker, or the robot's driver, alone publishes."""
        for number, advice in ((0, SHARED_HAND), (2, SHARED_ROBOT)):
            topic = self._joint_subscriptions[number].topic_name
            if self.count_publishers(topic) < 2:
                continue
            names = self._publishers_of(topic)
            # Two of one name are told by their frames; or one was killed, and started anew.
            if len(set(names)) > 1:
                self._warn_once(
                    topic, f'{topic} has {len(names)} publishers ({", ".join(names)}): {advice}')

    def _find_second_hand(self) -> str:
        """Return that several publishers send this hand by turns, with their names, or nothing."""
        turns = self._fast_path.turns if self._fast_path else 0
        new_turns, self._known_turns = turns - self._known_turns, turns
        if new_turns <= RESTART_TURNS:
            return ''
        topic = self._joint_subscriptions[0].topic_name
        text = (f'{topic} has frames of this hand from several publishers by turns '
                f'({", ".join(self._publishers_of(topic))}): all of them move the robot; end all '
                'but one tracker, or give each a topic of its own (remap joint_states)')
        self._warn_once('turns', text)
        return text

    def _find_unjudged(self) -> str:
        """Return why nobody judges how much is known of the hand, or nothing."""
        now, judged = time.monotonic(), self._teleoperation.judged_count
        if judged != self._known_judged_count or not self._judges_hand or (
                not self._teleoperation.guard.has_hand(now)):
            self._judged_time, self._known_judged_count = now, judged
        # Of a tracker that starts, discovery may have found one of its topics alone.
        if now - self._judged_time < DISCOVERED_AFTER:
            return ''
        topic = self._joint_subscriptions[1].topic_name
        fault = (f'{topic} says nothing of this hand' if self.count_publishers(topic)
                 else f'nobody publishes {topic}')
        return (f'{fault}: a hand whose markers are lost is followed '
                '(remap joint_confidence, or set min_confidence to 0)')

    def _shared_commands(self) -> list[str]:
        """Return who publishes its commands too, in words; log each once."""
        own = self.get_fully_qualified_name()
        faults = [f'{topic} is published by {other} too: the limits of speed and acceleration hold '
                  'for the commands of this node alone'
                  for topic in sorted({publisher.topic_name for _, publisher in self._outputs
                                       if publisher is not self._shown})
                  for other in sorted({*self._publishers_of(topic)} - {own})]
        for text in faults:
            self._warn_once(text, text)
        return faults

    def _find_blocked(self) -> str:
        """Return which joint has not done for a second what is commanded, or nothing."""
        now = time.monotonic()
        joint, off = self._teleoperation.guard.farthest_from_command(now)
        if off <= FAR_FROM_COMMAND:
            joint = ''
        if joint != self._far_joint:
            self._far_joint, self._far_since = joint, now
        if not joint or now - self._far_since < FAR_TIME:
            return ''
        text = (f'{joint} is {off:.1f} rad from its command: it grasps something, or is stopped, '
                'and goes there at its own speed once it is free')
        self._warn_once(joint, text)
        return text

    def _warn_once(self, key: str, text: str) -> None:
        if key not in self._warned:
            self._warned.add(key)
            self.get_logger().warning(text)

    def _publish_status(self) -> None:
        self._warn_of_shared_topics()
        self._namesake_fault = namesake_fault(self)
        unjudged = self._find_unjudged()
        if unjudged and unjudged != self._unjudged:
            self.get_logger().warning(unjudged)
            self._unjudged = unjudged
        guard, fault = self._teleoperation.guard, self._teleoperation.fault
        refused = self._teleoperation.refused_jumps
        new_jumps, self._known_jumps = refused - self._known_jumps, refused
        text = fault or f'{guard.state.value}: {self._reason}'
        if new_jumps:
            text += f'; jumps of the hand refused: {new_jumps}'
        others = [*filter(None, (self._namesake_fault, self._find_second_hand(), unjudged,
                                 self._find_blocked())),
                  *(self._shared_commands() if guard.is_engaged else ())]
        text = '; '.join((text, *others))
        is_fine = guard.is_following and not (self._wrist_fault or new_jumps or others)
        level = Level.ERROR if fault else Level.OK if is_fine else Level.WARN
        status = Status(level, text, {
            'state': guard.state.value,
            'missing to engage': '' if guard.is_engaged else (
                self._namesake_fault or guard.missing(time.monotonic()) or 'nothing'),
            'refused jumps': str(refused),
            'refused values': str(guard.refused_values),
            'repeated frames': str(self._teleoperation.repeated_frames),
            'frames on fast path': str(self._fast_path.frame_count if self._fast_path else 0),
            **({} if self._wrist is None else {'wrist': self._wrist.status(time.monotonic())})})
        self._diagnostics.publish(diagnostics(
            self.get_clock().now().to_msg(), self._status_name, self.get_namespace(), status))


def _robot_and_person(values: Mapping[str, Any]) -> tuple[LoadedRobot, Hand]:
    """Return the robot and the person's hand; one whose side is not given takes the other's."""
    person = with_defaults(values)
    follows_robot = values['side'] == AUTO and not values['hand_file']
    preferred = SIDES[0] if follows_robot else starting_hand(person)[0].side
    loaded = load_robot(values['robot'], values['robot_description'], preferred_side=preferred,
                        order=values['order'].split())
    if follows_robot:
        person['side'] = loaded.hand.side
    return loaded, starting_hand(person)[0]


def _wrist_message(name: str, header: Header, sent: WristCommand) -> PoseStamped | TwistStamped:
    """Return one of `WRIST_OUTPUTS`."""
    if name == 'twist':
        linear, angular = (Vector3(**dict(zip('xyz', vector.tolist())))
                           for vector in (sent.linear, sent.angular))
        return TwistStamped(header=header, twist=Twist(linear=linear, angular=angular))
    place, turn = sent.pose.position.tolist(), sent.pose.rotation.as_quat().tolist()
    return PoseStamped(header=header, pose=Pose(
        position=Point(**dict(zip('xyz', place))),
        orientation=Quaternion(**dict(zip('xyzw', turn)))))


def _read_object(message: JointState) -> JointPositions:
    """Return the fields of a JointState object as `JointStateReader` reads them from bytes."""
    return JointPositions(
        Stamp(message.header.stamp.sec, message.header.stamp.nanosec), message.name,
        message.position, message.effort)


def main(args: list[str] | None = None) -> int:
    """Run the retarget node until it is interrupted; return its exit code."""
    return run(RetargetNode, args=args, name='retarget')


if __name__ == '__main__':
    sys.exit(main())
