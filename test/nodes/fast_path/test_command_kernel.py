"""The fast path of a robot: the same commands to the bit as the slow path, whatever comes."""

import numpy as np
import pytest
from helpers.robots import GRIPPER, wide_hand

from hand_tracker.core.model.hand import JOINTS
from hand_tracker.core.numerics.packs import packed
from hand_tracker.files.urdf_file import urdf
from hand_tracker.messages.joint_states import JointStateReader
from hand_tracker.messages.stamps import Stamp, nanoseconds
from hand_tracker.messages.templates import (
    joint_state_template,
    joint_trajectory_template,
    position_array_template,
)
from hand_tracker.nodes.fast_path.command_kernel import (
    MOST_FOREIGN,
    install_numbers,
    new_command_memory,
    process_deviations,
    process_hand,
    process_position,
)
from hand_tracker.nodes.fast_path.track_kernel import install_reply
from hand_tracker.retargeting.follow_kernel import (
    COMMANDED,
    NO_COMMAND,
    NOT_ENGAGED,
    NOT_FOLLOWED,
)
from hand_tracker.retargeting.guard_kernel import FOLLOWING
from hand_tracker.retargeting.guard_options import GuardOptions
from hand_tracker.retargeting.robot_file import load_robot
from hand_tracker.retargeting.teleoperation import Teleoperation
from hand_tracker.simulation.poses import pose_angles

NEEDS = 'rclpy',

STEP = 1. / 120.
NAMES = [f'right_{joint}' for joint in JOINTS]


def bytes_of(data):
    """Return a message as the callback has it."""
    return np.array(np.frombuffer(data, np.uint8))


class SlowPath:
    """A robot that follows joint states as the node does without a fast path."""

    def __init__(self, loaded, options):
        self.it = Teleoperation(loaded, wide_hand(), 'right_', options, min_confidence=.2)
        self.templates = [joint_state_template(self.it.order),
                          joint_trajectory_template(self.it.order, 20_000_000),
                          position_array_template(len(self.it.order))]
        self.readers = [JointStateReader() for _ in range(3)]

    def deviations(self, data, now):
        read = self.readers[1].read(data)
        self.it.observe_deviations(read.names, read.positions, read.effort)

    def robot(self, data, now):
        read = self.readers[2].read(data)
        self.it.observe_robot(read.names, read.positions, now, nanoseconds(read.stamp))

    def hand(self, data, now):
        """Return the messages that answer a frame."""
        read = self.readers[0].read(data)
        if not self.it.observe_hand(read.names, read.positions, now, nanoseconds(read.stamp)):
            return None
        return self.filled(self.it.command(now), read.stamp)

    def filled(self, command, stamp):
        return command and [one.fill(stamp, command.position) for one in self.templates]


class BothPaths(SlowPath):
    """The same with the fast path before it, as the compiled callback takes it."""

    def __init__(self, loaded, options):
        super().__init__(loaded, options)
        self.commands, self.memory = packed(new_command_memory())
        self.has_layout = False
        self.done = []

    def deviations(self, data, now):
        follow, guard = self.it.packs[0], self.it.packs[-1]
        if not process_deviations(self.commands, follow, guard, bytes_of(data)):
            super().deviations(data, now)
            self.install()

    def robot(self, data, now):
        if not process_position(
                self.commands, self.it.packs[0], self.it.packs[-1], bytes_of(data), now):
            super().robot(data, now)
            self.install()

    def hand(self, data, now):
        done = NOT_FOLLOWED
        if self.has_layout:
            done = process_hand(self.commands, self.it.packs, bytes_of(data), now)
        self.done.append(done)
        if done == NOT_FOLLOWED:
            answer = super().hand(data, now)
            self.install()
            return answer
        if done != COMMANDED:
            return None
        return [self.memory.replies[i].view(np.uint8)[4:4 + one.size].tobytes()
                for i, one in enumerate(self.templates)]

    def install(self):
        self.has_layout = self.it.is_regular
        if self.has_layout:
            for listed, reader, rows in zip(self.memory[:3], self.readers, self.it.rows):
                install_numbers(listed, reader, rows)
            for number, template in enumerate(self.templates):
                assert install_reply(self.memory, number, template)
                self.memory.wanted[number] = 1


def following_rig(folder):
    """Return both paths of a robot that follows a relaxed hand, a message of it, and the time."""
    path = folder / 'robot.yaml'
    path.write_text('name: ours\n')
    rig = BothPaths(load_robot(str(path), urdf(wide_hand())),
                    GuardOptions(require_robot_state=False))
    # Of a sender without a clock: with a stamp it would be the same frame again.
    data, now = joint_state_template(NAMES).fill(Stamp(0, 0), wide_hand().relaxed()), 10.
    while rig.it.guard.memory.state[0] != FOLLOWING or not rig.has_layout:
        now += STEP
        rig.hand(data, now)
        rig.it.guard.engage(now)
    return rig, data, now


def stream(frames, random):
    """Yield frames of a hand with faults: angles, deviations, seconds since the last one."""
    hand = wide_hand()
    relaxed, fist = hand.relaxed(), pose_angles('fist', hand)
    for i in range(frames):
        share = .3 + .3 * np.sin(2. * np.pi * 1.3 * STEP * i)
        angles, deviations = relaxed + share * (fist - relaxed), np.full(len(JOINTS), .02)
        step = STEP * random.uniform(.8, 1.2)
        fault = random.integers(200)
        if fault == 0:
            angles[random.integers(len(JOINTS))] = np.nan
        elif fault == 1:
            angles = fist + 1.
        elif fault == 2:
            deviations[:] = .5
        elif fault == 3:
            step = .2
        elif fault == 4:
            step = 0.
        yield angles, deviations, step


@pytest.mark.parametrize('options', [
    {}, {'hold_to_engage': True}, {'require_robot_state': False, 'max_speed': 1.}])
@pytest.mark.parametrize('robot', ['hand', 'gripper'])
def test_both_paths_send_the_same_bits_whatever_comes(robot, options, tmp_path):
    path = tmp_path / 'robot.yaml'
    path.write_text('name: ours\n')
    loaded = load_robot(*((str(path), urdf(wide_hand())) if robot == 'hand'
                          else ('robotiq_2f', GRIPPER)))
    rigs = [kind(loaded, GuardOptions(**options)) for kind in (SlowPath, BothPaths)]
    model, random = loaded.hand.model, np.random.default_rng(3)
    hands, told = joint_state_template(NAMES), joint_state_template(NAMES, [.3] * len(NAMES))
    # Of limits that a change has narrowed, and of a tracker that says nothing of the unknown.
    narrowed, silent = joint_state_template(NAMES, [.03] * len(NAMES)), joint_state_template(NAMES)
    robots = joint_state_template(model.joint_names)
    # Of another driver on the same topic.
    others = joint_state_template(model.joint_names[1:])
    at, now, sent, reasons = model.joint_positions(loaded.hand.rest), 50., 0, set()
    for number, (angles, deviations, step) in enumerate(stream(2500, random)):
        now += step
        # Now and then the tracker hangs, and sends its last frame again and again.
        frame = number - max(number % 400 - 360, 0)
        stamp = Stamp(frame, 7 * frame)
        # Its driver, too, for longer than that may take.
        of_robot = Stamp(1 + number - max(number % 500 - 400, 0), 5)
        answers = []
        for rig in rigs:
            if number % 700 < 600:
                rig.robot(robots.fill(of_robot, at), now)
            if number % 50 < 3:
                rig.robot(others.fill(stamp, at[1:]), now)
                rig.robot(others.fill(stamp, at[1:] + 1.), now)
            rig.it.guard.press(now)
            answers.append(rig.hand(hands.fill(stamp, angles), now))
            if not rig.it.guard.is_engaged:
                rig.it.guard.engage(now)
            of_frame = narrowed if number % 50 > 45 else silent if number % 300 > 297 else told
            rig.deviations(of_frame.fill(stamp, deviations), now)
        assert answers[0] == answers[1], number
        assert rigs[0].it.guard.state is rigs[1].it.guard.state
        np.testing.assert_array_equal(rigs[0].it.guard.robot, rigs[1].it.guard.robot)
        assert rigs[0].it.guard.memory.robot_time == rigs[1].it.guard.memory.robot_time
        reasons.add(rigs[1].it.guard.reason)
        assert rigs[0].it.refused_jumps == rigs[1].it.refused_jumps
        assert rigs[0].it.repeated_frames == rigs[1].it.repeated_frames
        assert rigs[0].it._memory.is_confident[0] == rigs[1].it._memory.is_confident[0]
        np.testing.assert_array_equal(rigs[0].it._memory.held, rigs[1].it._memory.held)
        if answers[0] is not None:
            sent += 1
    done = rigs[1].done
    assert min(done.count(kind) for kind in (NOT_FOLLOWED, COMMANDED)) > 20
    assert rigs[0].it.repeated_frames > 200
    assert any('they have the same stamp' in reason for reason in reasons) == (
        'require_robot_state' not in options)
    assert (NOT_ENGAGED in done) == ('require_robot_state' not in options)
    assert done.count(NO_COMMAND) > 0 and sent > done.count(COMMANDED) > .5 * len(done)


@pytest.mark.parametrize('what, after', [
    ('the hand was lost', .16), ('the deadman was released', .3), ('the robot is silent', .6)])
def test_what_is_due_to_end_is_left_to_the_slow_path_unchanged(what, after, tmp_path):
    options = {'the hand was lost': {'hand_timeout': .15},
               'the deadman was released': {'hand_timeout': 10., 'hold_to_engage': True},
               'the robot is silent': {'hand_timeout': 10.}}[what]
    path = tmp_path / 'robot.yaml'
    path.write_text('name: ours\n')
    rig = BothPaths(load_robot(str(path), urdf(wide_hand())), GuardOptions(**options))
    # Of a sender without a clock: with a stamp it would be the same frame again.
    data, now = joint_state_template(NAMES).fill(Stamp(0, 0), wide_hand().relaxed()), 10.
    robot = joint_state_template(rig.it._model.joint_names)
    at = rig.it._model.joint_positions(rig.it._model.open_position())
    while rig.it.guard.memory.state[0] != FOLLOWING or not rig.has_layout:
        now += STEP
        rig.robot(robot.fill(Stamp(0, 0), at), now)
        rig.hand(data, now)
        rig.it.guard.press(now)
    before = [bytes(np.asarray(pack)) for pack in rig.it.packs if isinstance(pack, np.ndarray)]
    guard = rig.it.guard
    times = [float(one[0]) for one in (guard.memory.hand_time, guard.memory.command_time)]
    assert process_hand(rig.commands, rig.it.packs, bytes_of(data), now + after) == NOT_FOLLOWED
    assert before == [bytes(np.asarray(pack)) for pack in rig.it.packs
                      if isinstance(pack, np.ndarray)]
    assert times == [float(one[0]) for one in (guard.memory.hand_time, guard.memory.command_time)]
    # And a moment after the last frame it would have been answered.
    assert process_hand(rig.commands, rig.it.packs, bytes_of(data), now + STEP) == COMMANDED


@pytest.mark.parametrize('damage', [
    lambda data: data[:60], lambda data: data[:-120], lambda data: b'\0\0' + data[2:],
    lambda data: data.replace(b'right_index', b'right_xndex'), lambda data: b''])
def test_messages_of_another_layout_are_refused(damage, tmp_path):
    rig, data, now = following_rig(tmp_path)
    now += STEP
    assert process_hand(
        rig.commands, rig.it.packs, bytes_of(damage(data)), now) == NOT_FOLLOWED
    assert process_hand(rig.commands, rig.it.packs, bytes_of(data), now) == COMMANDED


def test_known_layouts_of_others_on_the_topic_are_left_out_here(tmp_path):
    rig, data, now = following_rig(tmp_path)
    arms = [joint_state_template([f'{arm}_elbow']).fill(Stamp(0, 0), [1.])
            for arm in range(MOST_FOREIGN + 1)]

    def done(message):
        return process_hand(rig.commands, rig.it.packs, bytes_of(message), now)

    for arm in arms:
        now += STEP
        assert done(arm) == NOT_FOLLOWED
        for _ in range(MOST_FOREIGN):
            SlowPath.hand(rig, arm, now)
            rig.install()
        assert done(arm) == NO_COMMAND
        assert done(data) == COMMANDED
    # The oldest of too many is unknown again.
    assert [done(arm) for arm in arms] == [NOT_FOLLOWED] + MOST_FOREIGN * [NO_COMMAND]


def test_known_layouts_of_others_on_the_robots_topic_are_left_out_here(tmp_path):
    path = tmp_path / 'robot.yaml'
    path.write_text('name: ours\n')
    rig = BothPaths(load_robot(str(path), urdf(wide_hand())), GuardOptions())
    arm = joint_state_template(['elbow']).fill(Stamp(0, 0), [1.])
    names = rig.it._model.joint_names
    robot = joint_state_template(names).fill(Stamp(0, 0), np.zeros(len(names)))
    rig.hand(joint_state_template(NAMES).fill(Stamp(0, 0), wide_hand().relaxed()), 10.)

    def is_processed(message, now):
        return process_position(
            rig.commands, rig.it.packs[0], rig.it.packs[-1], bytes_of(message), now)

    for message in (robot, arm):
        assert not is_processed(message, 10.)
        rig.robot(message, 10.)
    time = rig.it.guard.memory.robot_time
    assert is_processed(robot, 11.) and time[0] == 11.
    # An arm is no sign of the robot's hand.
    assert is_processed(arm, 12.) and time[0] == 11.
    assert is_processed(robot, 13.) and time[0] == 13.


@pytest.mark.parametrize('given', [3, len(NAMES) + 1])
def test_another_number_of_positions_than_names_is_never_followed(given, tmp_path):
    rig, data, now = following_rig(tmp_path)
    at = data.rindex(len(NAMES).to_bytes(4, 'little'), 0, -8 * len(NAMES))
    wrong = data[:at] + given.to_bytes(4, 'little') + data[at + 4:] + bytes(8)
    for _ in range(3):
        now += STEP
        rig.hand(wrong, now)
        assert rig.done[-1] == NOT_FOLLOWED
