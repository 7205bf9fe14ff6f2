"""Forward kinematics against two independent libraries, and the sense of every axis."""

import io

import numpy as np
import pytest
from helpers.palms import random_rotation

from hand_tracker.core.model.hand import DIGITS, FINGERS, JOINTS, LINKS, Hand, preset_limits
from hand_tracker.core.model.kinematics import digit_base, forward, joint_table, tip_offsets
from hand_tracker.files.urdf_file import urdf

MIRROR = np.diag((1., -1., 1.))
CLOSE = 1e-6  # [m], [rad]: the URDF's nine decimals
HANDS = {
    'right': Hand.scaled(),
    'left': Hand.scaled(side='left'),
    'arched': Hand.scaled(.21, .09, splay=(.12, .02, -.08, -.2)),
    'paper thumb': Hand.scaled().with_paper_thumb(),
    'leaning axes': Hand.scaled(splay=(.1, 0., 0., -.1), finger_abduction_axes=(
        (.3, .1, 1.), (.2, 0., 1.), (.1, -.1, 1.), (-.1, -.1, 1.))),
}


@pytest.fixture(params=HANDS)
def hand(request):
    return HANDS[request.param]


def random_angles(rng, n):
    """Return angles [rad] beyond every limit, moving the locked joints too."""
    return rng.uniform(-2., 2., size=(n, 25))


def angle_between(a, b):
    """Return the angle [rad] of the rotation from a to b; exact for small ones."""
    return np.linalg.norm(a - b) / np.sqrt(2.)


def tips(hand, angles):
    """Return the five tips in the wrist's frame."""
    pose = forward(joint_table(hand), angles)
    last = [LINKS.index(f'{digit}_distal') for digit in DIGITS]
    return pose.position[last] + np.einsum(
        'dij,dj->di', pose.rotation[last], tip_offsets(hand))


def moved(hand, joint, angle=.3):
    """Return how far each tip moves when one joint turns from zero."""
    angles = np.zeros(25)
    angles[JOINTS.index(joint)] = angle
    return tips(hand, angles) - tips(hand, np.zeros(25))


def test_same_as_pinocchio(hand):
    pinocchio = pytest.importorskip('pinocchio', reason='pinocchio, the oracle, is not installed')
    model = pinocchio.buildModelFromXML(urdf(hand, 'p_'))
    data = model.createData()
    table = joint_table(hand)
    rng = np.random.default_rng(1)
    for angles in random_angles(rng, 40):
        turned, at = random_rotation(rng), rng.uniform(-2., 2., 3)
        wrist = pinocchio.SE3(turned, at)
        q = pinocchio.neutral(model)
        for joint, angle in zip(JOINTS, angles):
            q[model.joints[model.getJointId(f'p_{joint}')].idx_q] = angle
        pinocchio.framesForwardKinematics(model, data, q)
        pose = forward(table, angles, turned, at)
        for i, link in enumerate(LINKS):
            expected = wrist * data.oMf[model.getFrameId(f'p_{link}')]
            assert pose.position[i] == pytest.approx(expected.translation, abs=CLOSE), link
            assert angle_between(pose.rotation[i], expected.rotation) < CLOSE, link


def test_same_as_yourdfpy(hand):
    yourdfpy = pytest.importorskip('yourdfpy', reason='yourdfpy, the oracle, is not installed')
    robot = yourdfpy.URDF.load(io.BytesIO(urdf(hand).encode()), load_meshes=False)
    table = joint_table(hand)
    for angles in random_angles(np.random.default_rng(2), 20):
        robot.update_cfg(dict(zip(JOINTS, angles)))
        pose = forward(table, angles)
        for i, link in enumerate(LINKS):
            expected = robot.get_transform(link, 'wrist')
            assert pose.position[i] == pytest.approx(expected[:3, 3], abs=CLOSE), link
            assert angle_between(pose.rotation[i], expected[:3, :3]) < CLOSE, link
        for digit, tip in zip(DIGITS, tips(hand, angles)):
            expected = robot.get_transform(f'{digit}_tip', 'wrist')
            assert tip == pytest.approx(expected[:3, 3], abs=CLOSE)


def test_bent_finger_by_plane_trigonometry():
    hand = HANDS['right']
    mcp, pip, dip = np.radians((30., 50., 40.))
    angles = np.zeros(25)
    angles[[JOINTS.index(f'middle_{joint}_flexion') for joint in ('mcp', 'pip', 'dip')]] = (
        mcp, pip, dip)
    sums = np.cumsum((mcp, pip, dip))
    tip = hand.finger_mcp[1] + (
        hand.finger_bones[1] @ np.cos(sums), 0., -hand.finger_bones[1] @ np.sin(sums))
    assert tips(hand, angles)[1] == pytest.approx(tip, abs=1e-15)


def test_batch_equals_single_frames(hand):
    rng = np.random.default_rng(3)
    angles = random_angles(rng, 7)
    turned = np.array([random_rotation(rng) for _ in angles])
    at = rng.normal(size=(7, 3))
    table = joint_table(hand)
    batch = forward(table, angles, turned, at)
    assert batch.rotation.shape == (7, 25, 3, 3)
    for i in range(7):
        single = forward(table, angles[i], turned[i], at[i])
        assert np.array_equal(single.position, batch.position[i])
        assert np.array_equal(single.rotation, batch.rotation[i])
    one_wrist = forward(table, angles, turned[0], at[0])
    assert np.array_equal(one_wrist.position[0], batch.position[0])


def test_wrist_pose_moves_the_hand_as_a_rigid_body(hand):
    rng = np.random.default_rng(4)
    angles, turned, at = random_angles(rng, 1)[0], random_rotation(rng), rng.normal(size=3)
    still = forward(joint_table(hand), angles)
    pose = forward(joint_table(hand), angles, turned, at)
    assert pose.position == pytest.approx(still.position @ turned.T + at, abs=1e-12)
    assert pose.rotation == pytest.approx(turned @ still.rotation, abs=1e-12)


def test_left_hand_is_the_mirror_image():
    right, left = HANDS['right'], HANDS['right'].mirrored()
    for angles in random_angles(np.random.default_rng(6), 20):
        a, b = forward(joint_table(right), angles), forward(joint_table(left), angles)
        assert b.position == pytest.approx(a.position @ MIRROR, abs=1e-15)
        assert b.rotation == pytest.approx(MIRROR @ a.rotation @ MIRROR, abs=1e-15)
        assert np.linalg.det(b.rotation) == pytest.approx(np.ones(25))


@pytest.mark.parametrize('side', ('right', 'left'))
@pytest.mark.parametrize('finger', FINGERS)
def test_flexion_of_a_finger_moves_its_tip_alone_and_towards_the_palm(side, finger):
    digit = FINGERS.index(finger)
    for joint in ('cmc_flexion', 'mcp_flexion', 'pip_flexion', 'dip_flexion'):
        shift = moved(HANDS[side], f'{finger}_{joint}')
        assert shift[digit, 2] < -.003, joint
        assert np.abs(np.delete(shift, digit, axis=0)).max() < 1e-15, joint


@pytest.mark.parametrize('finger', FINGERS)
def test_abduction_leads_away_from_the_middle_finger(finger):
    towards_thumb = moved(HANDS['right'], f'{finger}_mcp_abduction')[FINGERS.index(finger), 1]
    assert np.sign(towards_thumb) == (1. if finger in ('index', 'middle') else -1.)
    on_the_left = moved(HANDS['left'], f'{finger}_mcp_abduction')[FINGERS.index(finger), 1]
    assert on_the_left == pytest.approx(-towards_thumb)


def test_thumb_flexes_across_the_palm_and_abducts_out_of_it():
    for joint in ('cmc_flexion', 'mcp_flexion', 'ip_flexion'):
        shift = moved(HANDS['right'], f'thumb_{joint}')[4]
        assert shift[1] < -.003, f'{joint} is ulnar'
        assert abs(shift[1]) > abs(shift[2]), f'{joint} runs along the palm'
    abducted = moved(HANDS['right'], 'thumb_cmc_abduction')[4]
    assert abducted[2] < -.02, 'palmar abduction'
    assert abs(abducted[2]) > abs(abducted[1])


@pytest.mark.parametrize('side, sense', [('right', 1.), ('left', -1.)])
def test_positive_roll_turns_the_thumbs_pad_palmar_and_away_from_the_fingers(side, sense):
    hand = Hand.scaled(side=side)
    rolled = hand.replace(thumb_roll=np.radians(50.))
    link = LINKS.index('thumb_distal')
    before, after = (forward(joint_table(one), np.zeros(25)).rotation[link]
                     for one in (hand, rolled))
    np.testing.assert_allclose(after[:, 0], before[:, 0], atol=1e-12)
    # Right-handed about the thumb towards its tip, on a left hand left-handed.
    about = np.cross(before[:, 1], after[:, 1]) @ before[:, 0]
    assert about == pytest.approx(sense * np.sin(np.radians(50.)))
    to_fingers = (hand.finger_mcp[0] - hand.thumb_cmc) * (1., sense, 1.)
    pads = -before[:, 2], -after[:, 2]
    assert pads[1][2] < pads[0][2] - .5
    assert pads[1] @ to_fingers < pads[0] @ to_fingers


def test_zero_angles_are_the_documented_rest():
    hand = HANDS['arched']
    pose = forward(joint_table(hand), np.zeros(25))
    metacarpal = LINKS.index('thumb_metacarpal')
    assert pose.rotation[metacarpal, :, 0] == pytest.approx(hand.thumb_rest_direction)
    for digit, splay in enumerate(hand.splay):
        for link in (2, 3, 4):
            assert pose.rotation[5 * digit + link, :, 0] == pytest.approx(
                (np.cos(splay), np.sin(splay), 0.))
    assert pose.position[[2, 7, 12, 17]] == pytest.approx(hand.finger_mcp)


def test_every_digits_flexion_stays_in_one_plane_with_its_abduction_axis(hand):
    rng = np.random.default_rng(7)
    right = hand.replace(side='right')
    for digit, name in enumerate(DIGITS):
        angles = np.zeros(25)
        flexing = [i for i, joint in enumerate(JOINTS)
                   if joint.startswith(name) and 'flexion' in joint and f'{name}_cmc' not in joint]
        abducting = JOINTS.index(f"{name}_{'cmc' if name == 'thumb' else 'mcp'}_abduction")
        angles[flexing] = rng.uniform(-1., 1., len(flexing))
        angles[abducting] = .3
        base, root, _ = digit_base(right, digit)
        pose = forward(joint_table(right), angles)
        normal = pose.rotation[5 * digit + 4, :, 1]
        assert normal @ base[:, 2] == pytest.approx(0., abs=1e-12)
        assert (pose.position[5 * digit + 2:5 * digit + 5] - root) @ normal == pytest.approx(
            np.zeros(3), abs=1e-12)


def test_a_deviating_phalanx_is_beside_the_plane_and_the_next_parallel_to_it():
    deviation = np.radians((3., 0., -2., -8.))
    hand = Hand.scaled(phalanx_deviation=deviation)
    angles = np.random.default_rng(3).uniform(-.5, 1.2, 25)
    pose, straight = (forward(joint_table(one), angles) for one in (hand, Hand.scaled()))
    np.testing.assert_allclose(pose.rotation, straight.rotation, atol=1e-12)
    for finger in range(4):
        bone = pose.position[5 * finger + 4] - pose.position[5 * finger + 3]
        x, y, z = bone @ pose.rotation[5 * finger + 3]
        assert np.hypot(x, y) == pytest.approx(hand.finger_bones[finger, 1])
        assert np.arctan2(y, x) == pytest.approx(deviation[finger]) and abs(z) < 1e-12


def test_table_has_one_root_per_digit_and_unit_axes(hand):
    table = joint_table(hand)
    assert (table.parent < 0).sum() == 5
    assert (table.parent < np.arange(25)).all()
    assert np.linalg.norm(table.axis, axis=1) == pytest.approx(np.ones(25))
    assert np.linalg.det(table.rotation) == pytest.approx(np.ones(25))
    assert hand.limits.shape == preset_limits().shape == (len(table.parent), 2)


@pytest.mark.parametrize('angles', [np.zeros(24), np.zeros((2, 26)), 0.])
def test_wrong_number_of_angles_is_refused(angles):
    with pytest.raises(ValueError, match='expected \\(25,\\) or \\(n, 25\\)'):
        forward(joint_table(HANDS['right']), angles)
