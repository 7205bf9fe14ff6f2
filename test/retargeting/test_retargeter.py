"""Retargeting: the same hand keeps its pose, tips touch, limits and speed hold, nothing lags."""

import numpy as np
import pytest
from helpers.capture_files import capture_folder
from helpers.robots import (
    GRIPPER,
    PARALLEL_GRIPPER,
    human_robot,
    third_party_robot,
    wide_hand,
)

from benchmarks.retarget import Ours, pinches, run, touchable
from hand_tracker.calibration.landmarks import LANDMARKS, landmark_positions
from hand_tracker.cli import robot as robot_command
from hand_tracker.core.model.hand import JOINTS, SIDES
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.numerics.packs import packed
from hand_tracker.retargeting import retarget_kernel
from hand_tracker.retargeting.retarget_options import InvalidRetargetOption, RetargetOptions
from hand_tracker.retargeting.retarget_problem import make_problem, new_solution
from hand_tracker.retargeting.retargeter import Retargeter
from hand_tracker.retargeting.robot_file import load_robot
from hand_tracker.retargeting.robot_hand import robot_hand
from hand_tracker.retargeting.robot_urdf import InvalidRobot, read_urdf_tree
from hand_tracker.simulation.poses import pose_angles

RATE = 120.


def landmarks_of(hand, angles):
    return landmark_positions(hand, forward(joint_table(hand), angles))


def settled(solver, landmarks, frames=60):
    for _ in range(frames):
        position = solver.update(landmarks, 1. / RATE)
    return position


def surface_gap(robot, position, role):
    roles = list(robot.anatomy.digits)
    tips = robot.tip_positions(position)
    thumb, finger = roles.index('thumb'), roles.index(role)
    return (np.linalg.norm(tips[thumb] - tips[finger]) - robot.spheres['thumb'].radius
            - robot.spheres[role].radius)


def touching(hand, role, apart=.002):
    """Return landmarks of a relaxed hand whose thumb tip is beside a finger's tip."""
    landmarks = landmarks_of(hand, hand.relaxed())
    tip = landmarks[LANDMARKS.index(f'{role}_tip')]
    landmarks[LANDMARKS.index('thumb_tip')] = tip + (0., 0., -apart)
    return landmarks


def test_the_gradient_is_that_of_the_cost():
    robot, hand = human_robot(), wide_hand()
    (problem,), task = packed(make_problem(robot, hand, RetargetOptions()))
    (solution,), state = packed(new_solution(robot.rest[:task.counts[1]]))
    random, n = np.random.default_rng(0), task.counts[1]
    middle = .5 * (task.lower[:n] + task.upper[:n])
    state.trial[:n] = middle + random.normal(scale=.1, size=n)
    retarget_kernel._set_targets(problem, solution, touching(hand, 'index', .01))
    unknown = np.full(len(JOINTS), np.nan)
    retarget_kernel._evaluate(problem, solution, unknown)
    gradient, start = state.qp.gradient[:n].copy(), state.trial[:n].copy()
    for i in range(n):
        costs = []
        for step in (1e-6, -1e-6):
            state.trial[:n] = start
            state.trial[i] += step
            costs.append(retarget_kernel._evaluate(problem, solution, unknown))
        # The gradient is of half the cost.
        assert (costs[0] - costs[1]) / 4e-6 == pytest.approx(gradient[i], abs=1e-9)


@pytest.mark.parametrize('side', ['right', 'left'])
@pytest.mark.parametrize('pose', ['open', 'fist', 'five'])
def test_the_same_hand_keeps_its_fingers(pose, side):
    robot, hand = human_robot(side), wide_hand(side)
    landmarks = landmarks_of(hand, pose_angles(pose, hand))
    position = settled(Retargeter(robot, hand), landmarks)
    roles = list(robot.anatomy.digits)
    tips = robot.tip_positions(position) @ robot.anatomy.axes.T
    for role in ('index', 'middle', 'ring', 'little'):
        tip = landmarks[LANDMARKS.index(f'{role}_tip')]
        # The sphere's centre is that far from the tip.
        assert np.linalg.norm(tips[roles.index(role)] - tip) < robot.spheres[role].radius + .004


@pytest.mark.parametrize('role', ['index', 'middle'])
def test_when_the_person_touches_so_do_the_robots_tips(role):
    robot, hand = human_robot(), wide_hand()
    position = settled(Retargeter(robot, hand), touching(hand, role))
    assert abs(surface_gap(robot, position, role)) < .001
    without = settled(Retargeter(robot, hand, RetargetOptions(touch_weight=0.)),
                      touching(hand, role))
    assert abs(surface_gap(robot, without, role)) > .002


@pytest.mark.parametrize('name', ['plain', 'allegro', 'leap', 'shadow', 'ability', 'inspire'])
def test_when_the_persons_pads_touch_so_do_the_robots_tips_and_noise_does_not_part_them(name):
    robot = load_robot('plain').hand if name == 'plain' else third_party_robot(f'{name}_hand_right')
    hand, random = wide_hand(), np.random.default_rng(0)
    landmarks = landmarks_of(hand, pose_angles('pinch', hand))
    ends = [landmarks[LANDMARKS.index(f'{role}_tip')] for role in ('thumb', 'index')]
    assert np.linalg.norm(np.subtract(*ends)) > .01
    solver = Retargeter(robot, hand)
    assert abs(surface_gap(robot, settled(solver, landmarks), 'index')) < .001
    gaps = [surface_gap(robot, solver.update(
        landmarks + random.normal(scale=.001, size=landmarks.shape), 1. / RATE), 'index')
        for _ in range(240)]
    assert np.abs(gaps).max() < .002


def test_without_the_joints_before_them_tips_touch_as_the_persons_tips_do():
    robot, hand = human_robot(), wide_hand()
    landmarks = touching(hand, 'index')
    landmarks[[LANDMARKS.index(name) for name in ('thumb_ip', 'index_dip')]] = np.nan
    assert abs(surface_gap(robot, settled(Retargeter(robot, hand), landmarks), 'index')) < .001


def test_the_plain_hand_touches_with_each_finger_as_the_person_does():
    recording, robot = pinches(), load_robot('plain').hand
    row = run(Ours(robot, recording.hand), recording, robot, touchable(robot))
    assert row['pinch_frames'] > 300 and row['out_of_reach_frames'] < 110
    assert row['pinch_share'] >= .99


@pytest.mark.parametrize('name', ['allegro', 'leap', 'shadow', 'ability', 'inspire'])
def test_third_party_hands_touch_with_the_index_finger(name):
    robot, hand = third_party_robot(f'{name}_hand_right'), wide_hand()
    position = settled(Retargeter(robot, hand), touching(hand, 'index'))
    assert abs(surface_gap(robot, position, 'index')) < .002


@pytest.mark.parametrize('side', SIDES)
@pytest.mark.parametrize('name', ['allegro', 'leap', 'shadow', 'ability', 'inspire'])
def test_a_robot_that_was_only_inspected_follows_the_person(name, side, tmp_path):
    path = capture_folder() / 'robots' / f'{name}_hand_{side}.urdf'
    if not path.exists():
        pytest.skip(f'no URDF {path}')
    assert robot_command.main(['inspect', str(path), '-o', str(tmp_path / 'robot.yaml')]) == 0
    loaded, hand = load_robot(str(tmp_path / 'robot.yaml')), wide_hand(side)
    robot, solver = loaded.hand, Retargeter(loaded.hand, hand, loaded.options)
    assert robot.side == side
    roles = list(robot.anatomy.digits)
    reach = {}
    for pose in ('five', 'fist'):
        position = settled(solver, landmarks_of(hand, pose_angles(pose, hand)), 240)
        assert (position >= robot.model.lower - 1e-9).all()
        assert (position <= robot.model.upper + 1e-9).all()
        reach[pose] = np.linalg.norm(robot.tip_positions(position), axis=1)
    fingers = [row for row, role in enumerate(roles) if role != 'thumb']
    # A fist brings each finger's tip nearer to the palm's origin by a third of its reach.
    assert (reach['fist'][fingers] < .67 * reach['five'][fingers]).all()
    assert abs(surface_gap(robot, settled(solver, touching(hand, 'index'), 240), 'index')) < .002


def test_limits_and_speed_hold_for_jumping_and_broken_input():
    robot, hand = human_robot(), wide_hand()
    solver = Retargeter(robot, hand)
    random = np.random.default_rng(0)
    model, last = robot.model, settled(solver, landmarks_of(hand, hand.relaxed()), 1)
    for frame in range(300):
        landmarks = random.normal(scale=.1, size=(len(LANDMARKS), 3))
        if frame % 3 == 0:
            landmarks[random.integers(len(LANDMARKS), size=4)] = np.nan
        dt = random.uniform(0., .05)
        position = solver.update(landmarks, dt)
        assert np.isfinite(position).all()
        assert (position >= model.lower - 1e-12).all() and (position <= model.upper + 1e-12).all()
        assert np.abs(position - last).max() <= solver.options.max_speed * dt + 1e-12
        last = position


def test_a_frame_without_anything_known_holds_the_pose():
    robot, hand = human_robot(), wide_hand()
    solver = Retargeter(robot, hand)
    before = settled(solver, landmarks_of(hand, pose_angles('fist', hand)))
    after = solver.update(np.full((len(LANDMARKS), 3), np.nan), 1. / RATE)
    np.testing.assert_array_equal(before, after)


@pytest.mark.parametrize('angles', [
    np.degrees(wide_hand().relaxed()), np.full(len(JOINTS), np.nan), np.zeros(5), 0.])
def test_what_are_no_angles_in_radians_is_named(angles):
    solver = Retargeter(human_robot(), wide_hand())
    with pytest.raises(ValueError, match='angles: .*; expected 25 finite numbers, in radians'):
        solver.update_angles(angles, 1. / RATE)


def test_joint_angles_of_an_unusual_palm_are_followed_from_the_first_frame():
    solver = Retargeter(human_robot(), wide_hand())
    position = solver.update_angles(np.full(len(JOINTS), 1.5), 1. / RATE)
    assert np.isfinite(position).all()


def test_a_swing_at_10_hz_is_hardly_delayed():
    robot, hand = human_robot(), wide_hand()
    solver = Retargeter(robot, hand)
    joint = 'index_mcp_flexion'
    angles = np.tile(hand.relaxed(), (240, 1))
    t = np.arange(len(angles)) / RATE
    angles[:, JOINTS.index(joint)] += np.radians(4.) * np.sin(2. * np.pi * 10. * t)
    moved = np.array([solver.update_angles(row, 1. / RATE) for row in angles])
    wave = moved[120:, list(solver.names).index(joint)]
    phase = np.angle((wave - wave.mean()) @ np.exp(-2j * np.pi * 10. * t[120:])) + np.pi / 2.
    assert abs(phase) / (2. * np.pi * 10.) < .002
    assert np.ptp(wave) == pytest.approx(np.radians(8.), rel=.1)


def test_a_gripper_opens_with_the_persons_pinch():
    robot, hand = robot_hand(read_urdf_tree(GRIPPER)), wide_hand()
    solver = Retargeter(robot, hand)
    openings = [surface_gap(robot, settled(solver, touching(hand, 'index', apart)), 'index')
                for apart in (.002, .02, .04)]
    assert abs(openings[0]) < .001
    assert openings[0] < openings[1] < openings[2]


@pytest.mark.parametrize('text', [GRIPPER, PARALLEL_GRIPPER])
def test_a_gripper_is_closed_as_the_person_touches_and_wide_open_as_far_as_is_said(text):
    loaded, hand = load_robot('robotiq_2f', text), wide_hand()
    solver, model = Retargeter(loaded.hand, hand, loaded.options), loaded.hand.model
    ends = [settled(solver, touching(hand, 'index', apart), 240)
            for apart in (.002, 2. * loaded.options.escape, .002)]
    gaps = [surface_gap(loaded.hand, end, 'index') for end in (*ends, model.lower, model.upper)]
    assert gaps[0] == pytest.approx(min(gaps), abs=5e-4)
    assert gaps[1] == pytest.approx(max(gaps), abs=5e-4)
    assert gaps[2] == pytest.approx(min(gaps), abs=5e-4)
    assert min(gaps) == pytest.approx(0., abs=1e-9)


def test_a_gripper_whose_tips_coincide_opens():
    robot, hand = robot_hand(read_urdf_tree(GRIPPER.replace('0.006', '0'))), wide_hand()
    solver = Retargeter(robot, hand)
    assert np.ptp(robot.tip_positions(robot.rest), axis=0).max() == 0.
    wide = settled(solver, touching(hand, 'index', .2))
    assert wide == pytest.approx(robot.model.upper, abs=1e-3)
    # Again, from where they coincide.
    assert settled(solver, touching(hand, 'index')) == pytest.approx(robot.model.lower, abs=1e-3)
    assert settled(solver, touching(hand, 'index', .2)) == pytest.approx(wide, abs=1e-3)


def test_the_wrong_side_is_refused():
    with pytest.raises(InvalidRobot, match="robot's hand is a right one, the person's a left one"):
        Retargeter(human_robot(), wide_hand('left'))


def test_begin_anew_from_where_the_robot_is():
    robot, hand = human_robot(), wide_hand()
    solver = Retargeter(robot, hand)
    settled(solver, landmarks_of(hand, pose_angles('fist', hand)))
    solver.reset(robot.rest)
    first = solver.update(landmarks_of(hand, hand.relaxed()), 1. / RATE)
    fresh = Retargeter(robot, hand).update(landmarks_of(hand, hand.relaxed()), 1. / RATE)
    np.testing.assert_allclose(first, fresh, atol=1e-6)
    with pytest.raises(ValueError, match='expected 25 numbers'):
        solver.reset([0., 1.])


def test_input_of_another_shape_is_refused():
    solver = Retargeter(human_robot(), wide_hand())
    with pytest.raises(ValueError, match=r'expected \(21, 3\)'):
        solver.update(np.zeros((20, 3)), .01)
    with pytest.raises(ValueError, match='dt: nan'):
        solver.update(np.zeros((21, 3)), np.nan)


@pytest.mark.parametrize('fields, message', [
    ({'touch': -1.}, 'touch: -1.0; allowed is 0 to 0.05 m'),
    ({'iterations': 0}, 'iterations: 0; allowed is a whole number from 1 to 100'),
    ({'max_speed': True}, 'max_speed: True'),
    ({'touch': .05, 'escape': .02}, 'escape: 0.02 m; it must exceed touch, 0.05 m'),
])
def test_options_are_checked(fields, message):
    with pytest.raises(InvalidRetargetOption, match='.') as refusal:
        RetargetOptions(**fields)
    assert message in str(refusal.value)
