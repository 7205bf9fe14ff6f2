"""From joint states of a hand to commands: names, orders, sides, what is lost."""

import numpy as np
import pytest
from helpers.allocations import counted_allocations
from helpers.command_rules import CommandRules, use_deadman
from helpers.hands import markers_of
from helpers.robots import GRIPPER, wide_hand

from hand_tracker.core.model.hand import JOINTS, Hand
from hand_tracker.core.model.marker_layout import MarkerLayout
from hand_tracker.core.numerics.jit import COMPILED
from hand_tracker.core.pose.deviation import unknown_deviation
from hand_tracker.core.tracker import HandTracker
from hand_tracker.files.urdf_file import urdf
from hand_tracker.retargeting.command_guard import GuardState
from hand_tracker.retargeting.follow_kernel import (
    COMMANDED,
    NOT_FOLLOWED,
    UNSTAMPED,
    follow_frame,
)
from hand_tracker.retargeting.guard_options import GuardOptions
from hand_tracker.retargeting.robot_file import load_robot
from hand_tracker.retargeting.robot_inspection import findings, robot_file_text
from hand_tracker.retargeting.robot_urdf import InvalidRobot
from hand_tracker.retargeting.teleoperation import Teleoperation
from hand_tracker.simulation.poses import pose_angles

STEP = .01
RIGHT = [f'right_{joint}' for joint in JOINTS]
# A wrist joint before the hand: it moves no digit against the palm.
ON_AN_ARM = urdf(wide_hand()).replace('</robot>', (
    '<link name="arm"/><joint name="bend" type="revolute"><parent link="arm"/>'
    '<child link="wrist"/><axis xyz="0 1 0"/><limit lower="-1" upper="1"/></joint></robot>'))

# Prints by how many the allocations of followed frames are more than the arrays handed over.
ALLOCATIONS = """
import numpy as np
from numba.core.runtime import rtsys
from hand_tracker.core.model.hand import JOINTS, Hand
from hand_tracker.retargeting.follow_kernel import COMMANDED, UNSTAMPED, follow_frame
from hand_tracker.retargeting.guard_options import GuardOptions
from hand_tracker.retargeting.robot_file import load_robot
from hand_tracker.retargeting.teleoperation import Teleoperation

hand = Hand.scaled()
one = Teleoperation(load_robot('plain'), hand, '', GuardOptions(require_robot_state=False))
one.observe_hand(JOINTS, hand.relaxed(), 0.)
assert one.guard.engage(0.) == ''
packs, angles = one.packs, one._retargeter.human.angles
for frame in range(1, 221):
    if frame == 21:
        before = rtsys.get_allocation_stats().alloc
    angles[0] = hand.relaxed() + .3 * np.sin(.1 * frame)
    assert follow_frame(*packs, UNSTAMPED, .01 * frame) == COMMANDED
print(rtsys.get_allocation_stats().alloc - before - 200 * len(packs))
"""


class Rig:
    """A hand and a robot on one clock; the robot does at once what it is told."""

    def __init__(self, text=None, robot=None, hand=None, order=(), **more):
        path = 'robotiq_2f' if text == GRIPPER else robot
        self.loaded = load_robot(path, text or '', order=order)
        self.hand = hand or wide_hand()
        self.it = Teleoperation(self.loaded, self.hand, f'{self.hand.side}_', **more)
        self.names = list(self.loaded.hand.model.joint_names)
        self.position = self.loaded.hand.model.joint_positions(self.loaded.hand.rest)
        self.now = 10.

    def tick(self, angles=None, names=RIGHT, stamp=UNSTAMPED):
        self.now += STEP
        angles = self.hand.relaxed() if angles is None else angles
        self.it.observe_robot(self.names, self.position, self.now)
        self.it.observe_hand(names, angles, self.now, stamp)
        command = self.it.command(self.now)
        if command is not None:
            for name, value in zip(*command):
                self.position[self.names.index(name)] = value
        return command

    def engaged(self):
        self.tick()
        assert self.it.guard.engage(self.now) == ''
        return self


@pytest.fixture
def own_hand(tmp_path):
    path = tmp_path / 'robot.yaml'
    path.write_text('name: ours\n')
    return str(path)


def test_the_robot_follows_the_hand(own_hand):
    rig = Rig(urdf(wide_hand()), own_hand).engaged()
    fist = pose_angles('fist', rig.hand)
    for _ in range(600):
        command = rig.tick(fist)
    assert rig.it.guard.state is GuardState.FOLLOWING
    at = dict(zip(*command))
    for finger in ('index', 'middle', 'ring', 'little'):
        for joint in ('mcp', 'pip'):
            name = f'{finger}_{joint}_flexion'
            assert at[name] == pytest.approx(fist[JOINTS.index(name)], abs=.25)


def test_joints_that_move_no_digit_stay_where_they_are(own_hand):
    rig = Rig(ON_AN_ARM, own_hand)
    rig.position[rig.names.index('bend')] = .4
    rig.engaged()
    commands = [dict(zip(*rig.tick())) for _ in range(50)]
    assert [command['bend'] for command in commands] == pytest.approx([.4] * 50)


def test_an_inspected_robot_leaves_its_arm_to_another_controller(tmp_path):
    (tmp_path / 'arm.urdf').write_text(ON_AN_ARM)
    found = load_robot(str(tmp_path / 'arm.urdf'))
    assert any('move the palm, and are not commanded: bend' in line for line in findings(found))
    path = tmp_path / 'arm.yaml'
    path.write_text(robot_file_text(found, str(tmp_path / 'arm.urdf')))
    rig = Rig(robot=str(path)).engaged()
    assert 'bend' not in rig.tick().names
    # Where the arm is, its own driver may say, on another topic or on this one.
    rig = Rig(robot=str(path))
    rig.names, rig.position = rig.names[1:], rig.position[1:]
    assert 'bend' in rig.loaded.hand.model.variables and 'bend' not in rig.names
    for _ in range(600):
        rig.it.observe_robot(['bend'], [.3], rig.now)
        rig.tick()
        rig.it.guard.press(rig.now)
    assert rig.it.guard.state is GuardState.FOLLOWING
    for beyond in (5., np.nan):
        rig = Rig(robot=str(path))
        rig.position[rig.names.index('bend')] = beyond
        assert rig.engaged().tick() is not None


def test_what_the_joint_states_of_the_robot_lack_is_named(own_hand):
    rig = Rig(ON_AN_ARM, own_hand)
    rig.it.observe_robot([name for name in rig.names if name != 'bend'], rig.position[1:], rig.now)
    rig.it.observe_hand(RIGHT, rig.hand.relaxed(), rig.now)
    assert rig.it.guard.engage(rig.now) == (
        "the robot's joint states are missing or old: they lack bend")
    assert rig.engaged().it.guard.is_engaged


def test_what_is_wrong_with_the_joint_states_of_the_robot_is_said(own_hand):
    rig = Rig(urdf(wide_hand()), own_hand)
    guard, joint = rig.it.guard, rig.loaded.hand.model.variables[3]
    row = rig.names.index(joint)

    def run(names, position, stamp=UNSTAMPED):
        for _ in range(60):
            rig.now += STEP
            rig.it.observe_robot(names, position, rig.now, stamp)
            rig.it.observe_hand(RIGHT, rig.hand.relaxed(), rig.now)
            rig.it.command(rig.now)
        return guard.reason

    lacking = [np.delete(one, row).tolist() for one in (rig.names, rig.position)]
    frozen, broken = (rig.names, rig.position, 5), (rig.names, list(rig.position))
    broken[1][row] = np.nan
    for given, kind, fault in ((broken, 'of no use', f'{joint} is not finite'),
                               (frozen, 'of no use',
                                'they have the same stamp again and again'),
                               (lacking, 'old', f'they lack {joint}')):
        run(*given)
        assert guard.engage(rig.now) == (
            f"the robot's joint states are missing or {kind}: {fault}")
        rig.engaged()
        assert run(*given) == f"the robot's joint states ended: {fault}"
    rig.engaged().now += 1.
    assert rig.it.command(rig.now) is None and guard.reason == "the robot's joint states ended"


def test_a_command_has_the_order_that_is_asked_for_and_mimics_by_name(own_hand):
    rig = Rig(GRIPPER, order=('other', 'slide')).engaged()
    command = rig.tick()
    assert command.names == ('other', 'slide')
    assert command.position[0] == command.position[1]
    np.testing.assert_array_equal(rig.it.present, command.position)
    for order, message in ((('slide', 'slide'), 'a joint comes twice'),
                           (('slide', 'knee'), "there is no movable joint 'knee'"),
                           (('other',), 'order: slide missing')):
        with pytest.raises(InvalidRobot, match=message):
            Rig(GRIPPER, order=order)


def test_a_gripper_eases_and_closes_by_its_stroke():
    rig = Rig(GRIPPER).engaged()
    open_hand, pinch = rig.hand.relaxed(), pose_angles('pinch', rig.hand)
    places = [rig.tick(open_hand).position[0] for _ in range(400)]
    assert rig.it.guard.state is GuardState.FOLLOWING
    places += [rig.tick(pinch).position[0] for _ in range(200)]
    # 0.02 rad from a limit, and 0.7 rad/s at first, where the stroke of 40 mm is a quarter turn.
    assert min(places) <= .04 * .02 / (.5 * np.pi) + 1e-6
    assert np.abs(np.diff(places[:40])).max() <= .04 * .7 / (.5 * np.pi) * STEP + 1e-9


def test_a_mimic_joint_that_is_commanded_keeps_its_limits_and_its_speed(tmp_path):
    text = GRIPPER.replace('upper="0.04" velocity="0.2"/><mimic',
                           'upper="0.015" velocity="0.02"/><mimic')
    (tmp_path / 'gripper.yaml').write_text('order: [slide, other]\n')
    rig = Rig(text, str(tmp_path / 'gripper.yaml')).engaged()
    open_hand, pinch = rig.hand.relaxed(), pose_angles('pinch', rig.hand)
    places = np.array([rig.tick(angles).position[1]
                       for angles in (open_hand, pinch, open_hand) for _ in range(400)])
    assert rig.it.guard.state is GuardState.FOLLOWING
    assert np.ptp(places) > .01
    assert places.min() >= 0. and places.max() <= .015
    assert np.abs(np.diff(places)).max() <= .02 * STEP + 1e-9


def test_a_hand_of_the_other_side_is_refused(own_hand):
    rig = Rig(urdf(wide_hand()), own_hand)
    left = [f'left_{joint}' for joint in JOINTS]
    rig.tick(names=left)
    assert 'a hand of the other side is refused: left_' in rig.it.fault
    assert 'no hand' in rig.it.guard.engage(rig.now)
    rig.tick()
    assert rig.it.fault == '' and rig.it.guard.engage(rig.now) == ''
    with pytest.raises(InvalidRobot, match="the person's a left one"):
        Rig(urdf(wide_hand()), own_hand, wide_hand('left'))


def test_others_share_the_topic_while_the_hand_is_there(own_hand):
    rig = Rig(urdf(wide_hand()), own_hand).engaged()
    wheel = dict(names=['wheel'], angles=[1.])
    until = rig.now + 3. * rig.it.guard.options.hand_timeout
    while rig.now < until:
        rig.tick(**wheel)
        assert rig.it.fault == '' and rig.it.guard.is_following
        rig.tick()
    # Without the hand they are named, as one may be taken for the other.
    until = rig.now + 1.1 * rig.it.guard.options.hand_timeout
    while rig.now < until:
        rig.tick(**wheel)
    assert 'they are not of this hand' in rig.it.fault
    rig.tick()
    assert rig.it.fault == ''


def test_what_is_no_hand_is_named_and_left_out(own_hand):
    rig = Rig(urdf(wide_hand()), own_hand)
    rig.tick(names=['wheel'], angles=[1.])
    assert rig.it.fault == 'joint states without right_index_cmc_flexion: they are not of this hand'
    rig.tick(angles=[0.] * 3)
    broken = rig.hand.relaxed()
    broken[3] = np.nan
    rig.tick(angles=broken)
    rig.tick(angles=np.degrees(rig.hand.relaxed()))
    assert rig.it.guard.refused_values == 2
    assert 'no hand' in rig.it.guard.engage(rig.now)


def test_a_jump_of_the_hand_is_followed_only_when_it_persists(own_hand):
    rig = Rig(urdf(wide_hand()), own_hand).engaged()
    for _ in range(300):
        before = rig.tick().position
    fist = pose_angles('fist', rig.hand)
    for _ in range(rig.it.guard.options.jump_frames - 1):
        assert np.abs(rig.tick(fist).position - before).max() < 1e-3
    assert rig.it.refused_jumps == rig.it.guard.options.jump_frames - 1
    assert rig.it.guard.state is GuardState.FOLLOWING
    for _ in range(100):
        after = rig.tick(fist).position
    assert np.abs(after - before).max() > .5


def test_a_frame_that_comes_again_and_again_is_no_hand(own_hand):
    rig = Rig(urdf(wide_hand()), own_hand).engaged()
    for stamp in range(1, 300):
        rig.tick(stamp=stamp)
    assert rig.it.guard.state is GuardState.FOLLOWING and rig.it.repeated_frames == 0
    # As old as if nothing came: the clock that counts is that of its first receipt.
    allowed = round(rig.it.guard.options.hand_timeout / STEP)
    states = []
    for _ in range(allowed + 1):
        rig.tick(pose_angles('fist', rig.hand), stamp=stamp)
        states.append(rig.it.guard.state)
    assert states[-2:] == [GuardState.FOLLOWING, GuardState.HOLDING]
    assert rig.it.repeated_frames == allowed + 1
    for _ in range(round(rig.it.guard.options.disengage_after / STEP) + 2):
        rig.tick(stamp=stamp)
    assert not rig.it.guard.is_engaged and 'no hand' in rig.it.guard.engage(rig.now)
    # One that goes on, or back as a recording that begins anew, is a hand; so is one without clock.
    for one in (stamp + 1, 5, UNSTAMPED, UNSTAMPED):
        rig.tick(stamp=one)
        assert rig.it.guard.engage(rig.now) == ''
    assert rig.tick() is not None


def test_a_hand_of_which_little_is_known_is_lost(own_hand):
    rig = Rig(urdf(wide_hand()), own_hand, min_confidence=.2).engaged()
    assert rig.tick() is not None
    rig.it.observe_deviations(RIGHT, [.5] * len(RIGHT), [.5] * len(RIGHT))
    before = rig.tick(pose_angles('fist', rig.hand)).position
    assert rig.it.guard.state is GuardState.HOLDING
    for _ in range(20):
        after = rig.tick(pose_angles('fist', rig.hand)).position
    assert np.abs(after - before).max() < .01
    # Those of some joints say nothing of the hand.
    rig.it.observe_deviations(RIGHT[:20], [.02] * 20, [.5] * 20)
    rig.tick()
    assert not rig.it.guard.is_following
    rig.it.observe_deviations(RIGHT, [.02] * len(RIGHT), [.5] * len(RIGHT))
    rig.tick()
    assert rig.it.guard.is_following
    # Nor is a hand trusted of which is not said what little is.
    rig.it.observe_deviations(RIGHT, [.02] * len(RIGHT), [])
    rig.tick()
    assert not rig.it.guard.is_following


def test_why_a_hand_whose_joint_states_come_is_lost_is_said(own_hand):
    rig = Rig(urdf(wide_hand()), own_hand, min_confidence=.2).engaged()
    known, unknown = [.02] * len(RIGHT), [.5] * len(RIGHT)
    rig.it.observe_deviations(RIGHT, known, unknown)
    rig.tick()
    assert rig.it.why_lost(rig.now) == ''
    rig.tick(np.degrees(pose_angles('fist', rig.hand)))
    assert 'degrees?' in rig.it.why_lost(rig.now)
    rig.tick()
    assert rig.it.why_lost(rig.now) == ''
    rig.it.observe_deviations(RIGHT, unknown, unknown)
    assert 'too little is known' in rig.it.why_lost(rig.now)
    rig.it.observe_deviations(RIGHT, known, [])
    assert 'no effort' in rig.it.why_lost(rig.now)
    rig.it.observe_deviations(RIGHT, known, unknown)
    for _ in range(2):
        rig.tick(stamp=7)
    assert 'same stamp' in rig.it.why_lost(rig.now)
    # Of a hand that is silent that is no reason.
    assert rig.it.why_lost(rig.now + 1.) == ''


def test_a_hidden_hand_is_lost_whatever_limits_the_tracker_has(own_hand):
    narrow = np.radians(10.) * np.sign(wide_hand().limits)
    for limits in (narrow, Hand.scaled().limits, wide_hand().limits):
        rig = Rig(urdf(wide_hand()), own_hand, min_confidence=.05).engaged()
        hand, layout = Hand.scaled(limits=limits), MarkerLayout()
        tracker, unknown = HandTracker(hand, layout), unknown_deviation(hand.limits)
        markers = markers_of(hand, np.clip(hand.relaxed(), *limits.T), layout)
        for frame in range(40):
            state = tracker.update(markers, .01 * frame)
        rig.it.observe_deviations(RIGHT, state.deviation, unknown)
        rig.tick()
        assert rig.it.guard.is_following
        for frame in range(30):
            state = tracker.update(np.full((8, 3), np.nan), .5 + .1 * frame)
        rig.it.observe_deviations(RIGHT, state.deviation, unknown)
        rig.tick()
        assert rig.it.guard.state is GuardState.HOLDING


def test_joint_states_of_the_robot_without_positions_are_named(own_hand):
    rig = Rig(urdf(wide_hand()), own_hand)
    rig.position = []
    rig.tick()
    assert 'they lack positions' in rig.it.guard.engage(rig.now)


def test_a_robot_whose_states_lack_a_joint_is_not_engaged(own_hand):
    rig = Rig(urdf(wide_hand()), own_hand)
    rig.names, rig.position = rig.names[1:], rig.position[1:]
    rig.tick()
    assert 'joint states are missing' in rig.it.guard.engage(rig.now)


def test_two_hands_drive_two_robots_independently(own_hand):
    right = Rig(urdf(wide_hand()), own_hand).engaged()
    left = Rig(urdf(wide_hand('left')), own_hand, wide_hand('left'), options=GuardOptions())
    names = [f'left_{joint}' for joint in JOINTS]
    assert right.tick() is not None and left.tick(names=names) is None
    assert left.it.guard.engage(left.now) == ''
    right.it.guard.disengage()
    assert right.tick() is None and left.tick(names=names) is not None


class FaultyTracker:
    """Joint states and deviations of a hand that moves, with a fault at a time."""

    FAULTS = ('none', 'killed', 'frozen', 'late', 'nan', 'huge', 'short', 'other side', 'foreign',
              'shuffled', 'jump', 'noise', 'clock back', 'unstamped', 'unsure', 'robot lost',
              'robot lacks a joint', 'disengaged', 'released')

    def __init__(self, hand, random):
        self._rest, self._random, self._stamp = hand.relaxed(), random, 1
        self._angles = self._rest

    def frame(self, fault, now):
        """Return names, angles and stamp of a frame, or None, and the time until the next [s]."""
        random, names, step = self._random, RIGHT, float(self._random.uniform(.002, .02))
        if fault != 'frozen':
            self._stamp += 10_000_000
            self._angles = self._rest + .4 * np.sin(now * np.linspace(1., 7., len(JOINTS)))
        angles, stamp = self._angles, self._stamp
        if fault == 'killed':
            return None, .1
        if fault == 'late':
            step = float(random.uniform(.1, 3.))
        elif fault == 'nan':
            angles = np.where(random.random(len(JOINTS)) < .1, np.nan, angles)
        elif fault == 'huge':
            angles = angles * random.choice((1e300, -1e300, np.inf))
        elif fault == 'short':
            angles = angles[:-1]
        elif fault == 'other side':
            names = [name.replace('right', 'left') for name in names]
        elif fault == 'foreign':
            names = [f'joint_{i}' for i in range(len(names))]
        elif fault == 'shuffled':
            order = random.permutation(len(names))
            names, angles = [names[i] for i in order], angles[order]
        elif fault == 'jump':
            angles = random.uniform(-5., 5., len(JOINTS))
        elif fault == 'noise':
            angles = angles + random.normal(scale=.3, size=len(JOINTS))
        elif fault == 'clock back':
            stamp, step = int(random.integers(1, self._stamp)), float(random.choice((-2., 0., 50.)))
        elif fault == 'unstamped':
            stamp = UNSTAMPED
        return (names, angles, stamp), step


@pytest.mark.parametrize('options', [
    {}, {'on_lost': 'stop'}, {'relax': True, 'disengage_after': .1},
    {'hold_to_engage': True, 'jump_frames': 2}])
def test_ten_thousand_faults_of_the_tracker_break_no_rule(own_hand, options):
    """As the node does, regular frames go to the one kernel, and all else to the parts."""
    random = np.random.default_rng(1)
    rig = Rig(urdf(wide_hand()), own_hand, options=GuardOptions(**options), min_confidence=.05)
    guard, model = rig.it.guard, rig.loaded.hand.model
    tracker = FaultyTracker(rig.hand, random)
    rules = CommandRules(model.lower, model.upper, model.velocity, guard.options)
    known = [.02] * len(RIGHT), [.5] * len(RIGHT)
    position, seen, in_kernel = rig.loaded.hand.rest.copy(), set(), 0
    for _ in range(2500):
        fault = random.choice(tracker.FAULTS)
        if fault == 'none' and not guard.is_engaged:
            guard.release()
        for _ in range(80 if fault == 'none' else random.integers(1, 7)):
            frame, step = tracker.frame(fault, rig.now)
            use_deadman(guard, fault, rig.now)
            rules.expect(guard, position, rig.now)
            rig.now += step
            lacking = int(fault == 'robot lacks a joint')
            if fault != 'robot lost':
                rig.it.observe_robot(model.variables[lacking:], position[lacking:], rig.now)
            rig.it.observe_deviations(RIGHT, known[fault == 'unsure'], known[1])
            done = NOT_FOLLOWED
            if frame and frame[0] is RIGHT and len(frame[1]) == len(RIGHT) and rig.it.is_regular:
                rig.it._retargeter.human.angles[0] = frame[1]
                done = follow_frame(*rig.it.packs, frame[2], rig.now)
                in_kernel += done == COMMANDED
            if done == COMMANDED:
                command = guard.present
            else:
                if frame and done == NOT_FOLLOWED:
                    rig.it.observe_hand(*frame[:2], rig.now, frame[2])
                sent = rig.it.command(rig.now)
                command = None if sent is None else sent.position
            seen.add(guard.state)
            rules.check(guard, command, rig.now)
            if command is not None:
                position = command.copy()
    assert rules.sent > 1000 and in_kernel > 300
    assert seen == set(GuardState) - (set() if guard.options.relax else {GuardState.RELAXING})


@pytest.mark.skipif(not COMPILED, reason='plain Python allocates')
def test_kernels_allocate_nothing_while_they_follow():
    assert counted_allocations(ALLOCATIONS) == ['0']
