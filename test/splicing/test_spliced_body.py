"""Tracked hands on a simulated body: names, places, and what stays to the bit."""

import bvhio
import numpy as np
import pygltflib
import pytest
from helpers.bodies import BODY_NAMES, SimulatedBody
from scipy.spatial.transform import Rotation

from hand_tracker.core.errors import HandTrackerError
from hand_tracker.files.bvh_file import (
    channel_columns,
    joint_poses,
    read_bvh_motion,
    write_bvh_motion,
)
from hand_tracker.files.glb_file import write_glb
from hand_tracker.files.skeleton_motion import joint_names, skeleton_motion
from hand_tracker.skin.load import load_skin
from hand_tracker.splicing.body_glb import body_mesh, skeleton_of
from hand_tracker.splicing.body_skeleton import (
    SkeletonError,
    body_hands,
    body_unit,
    require_hand,
    skeleton_naming,
)
from hand_tracker.splicing.clock_alignment import ClockAlignment
from hand_tracker.splicing.hand_mount import rest_mount
from hand_tracker.splicing.spliced_body import SplicedHand, mount_hand, splice

NEEDS = 'bvhio', 'pygltflib'
OFFSET, RATE, HAND_RATE, UNIT = .75, 60., 120., .01
ALIGNMENT = ClockAlignment(OFFSET)
READ_AGAIN = 'mixamo', 'optitrack'     # by the slow reader, which knows no names


def spliced_hand(body, motion, side):
    """Return the hand of a side, placed on the body, and what it was tracked as."""
    tracked = body.hand(side, np.arange(700) / HAND_RATE, lambda t: t + OFFSET)
    hand = skeleton_motion(tracked)
    place = require_hand(motion.joints, side, 'body.bvh')
    mount = mount_hand(motion, place, hand, ALIGNMENT, UNIT)
    return SplicedHand(place, hand, ALIGNMENT, mount), tracked


@pytest.mark.parametrize('naming', BODY_NAMES)
def test_skeletons_are_recognised_by_their_names(naming):
    joints = SimulatedBody(naming).joints
    assert skeleton_naming(joints) == naming
    hands = body_hands(joints)
    assert {side: hand.wrist for side, hand in hands.items()} == SimulatedBody(naming).wrists
    # The finger and its end, which will be replaced.
    assert all(hand.digits == {hand.wrist + 1, hand.wrist + 2} for hand in hands.values())
    assert body_unit(joints, None)[0] == UNIT and body_unit(joints, .0098)[0] == UNIT
    assert body_unit(joints, .0564)[0] == .0564


@pytest.mark.parametrize('naming', BODY_NAMES)
def test_fingers_move_on_the_body_and_all_else_stays_to_the_bit(tmp_path, naming):
    body = SimulatedBody(naming, seconds=7.)
    motion = body.motion(RATE)
    sides = 'right', 'left'
    pairs = [spliced_hand(body, motion, side) for side in sides]
    assert all(np.degrees(hand.mount.spread) < .5 for hand, _ in pairs)
    path = tmp_path / 'spliced.bvh'
    write_bvh_motion(path, splice(motion, [hand for hand, _ in pairs], UNIT))
    found = read_bvh_motion(path)
    names = [joint.name for joint in found.joints]
    columns, own_columns = channel_columns(found.joints), channel_columns(motion.joints)
    kept = [i for i, joint in enumerate(motion.joints) if 'Index1' not in joint.name
            and joint.channels]
    for i in kept:
        j = names.index(motion.joints[i].name)
        assert found.joints[j].offset == motion.joints[i].offset
        assert np.array_equal(found.values[:, columns[j]], motion.values[:, own_columns[i]])
    assert found.period == motion.period
    if naming not in READ_AGAIN:
        return
    # An independent reader has the fingers where the tracker has them.
    root = bvhio.readAsHierarchy(str(path))
    for hand, _ in pairs:
        labels = [name.rpartition(':')[2] for name in joint_names(naming, hand.place.side)[1:]]
        for frame in (60, 200, 333):
            root.loadPose(frame, recursive=True)
            truth = joint_places(hand.motion, round(HAND_RATE * (frame / RATE - OFFSET)))
            places = np.array([root.filter(hand.place.prefix + label, isEqual=True)[0].PositionWorld
                               for label in labels])
            wrist = np.array(root.filter(motion.joints[hand.place.wrist].name,
                                         isEqual=True)[0].PositionWorld)
            np.testing.assert_allclose(.01 * (places - wrist) @ body.world.T,
                                       truth[1:] - truth[0], atol=1.5e-3)


def joint_places(skeleton, frame):
    """Return the places of a skeleton's joints in a frame, (J, 3)."""
    places, turns = [], []
    for joint, parent in enumerate(skeleton.parents):
        turn = Rotation.from_quat(skeleton.rotation[frame, joint])
        if parent < 0:
            places.append(skeleton.root_position[frame])
        else:
            places.append(places[parent] + turns[parent].apply(skeleton.offsets[joint]))
            turn = turns[parent] * turn
        turns.append(turn)
    return np.array(places)


def test_the_wrist_of_the_hand_turns_as_the_hand_does():
    body = SimulatedBody(seconds=7.)
    motion = body.motion(RATE, noise=2.)
    hand, _ = spliced_hand(body, motion, 'right')
    found = splice(motion, [hand], UNIT, 'hand')
    clean = SimulatedBody(seconds=7.).motion(RATE)
    wrist = hand.place.wrist
    seen = slice(60, 380)
    _, noisy = joint_poses(found.joints, found.values[seen])
    _, true = joint_poses(clean.joints, clean.values[seen])
    cosine = (np.einsum('tij,tij->t', noisy[wrist], true[wrist]) - 1.) / 2.
    # The body's own is off by several degrees.
    assert np.degrees(np.arccos(np.clip(cosine, -1., 1.))).max() < 1.5
    columns = channel_columns(motion.joints)
    assert np.array_equal(found.values[:, :columns[wrist].start],
                          motion.values[:, :columns[wrist].start])


def test_where_the_wrist_says_nothing_the_hand_is_mounted_as_in_the_t_pose():
    body = SimulatedBody(seconds=7.)
    motion = body.motion(RATE)
    hand, tracked = spliced_hand(body, motion, 'left')
    still = skeleton_motion(tracked._replace(
        wrist_position=np.zeros_like(tracked.wrist_position)))
    mount = mount_hand(motion, hand.place, still, ALIGNMENT, UNIT)
    assert not mount.is_fitted
    np.testing.assert_allclose(mount.wrist, np.eye(3), atol=1e-12)
    with pytest.raises(HandTrackerError, match='expected --wrist body'):
        splice(motion, [hand._replace(mount=mount)], UNIT, 'hand')
    for side, sign in (('left', 1.), ('right', -1.)):
        for bone in np.array(((0., -2., 0.), (0., 0., 1.), (1., 0., 0.), (-1., 0., 0.))):
            turned = rest_mount(side, bone).wrist @ (sign, 0., 0.)
            np.testing.assert_allclose(turned, bone / np.linalg.norm(bone), atol=1e-9)


def test_a_body_without_a_wrist_by_name_is_refused():
    body = SimulatedBody()
    joints = tuple(joint._replace(name=f'bone{i}') for i, joint in enumerate(body.joints))
    with pytest.raises(SkeletonError, match='no joint is a right wrist by its name.*bone1'):
        require_hand(joints, 'right', 'body.bvh')
    alone = [joints[0]._replace(name='RightHand'), *joints[1:]]
    with pytest.raises(SkeletonError, match='RightHand is its root: the skeleton of a hand alone'):
        require_hand(alone, 'right', 'hand.bvh')


def test_the_glb_moves_as_the_bvh(tmp_path):
    body = SimulatedBody(seconds=7.)
    motion = body.motion(RATE)
    hand, tracked = spliced_hand(body, motion, 'right')
    spliced = splice(motion, [hand], UNIT)
    skeleton = skeleton_of(spliced, UNIT)
    mesh = body_mesh(skeleton, [(hand, tracked.hand)], 'humanik')
    path = tmp_path / 'body.glb'
    write_glb(path, skeleton, mesh)
    document = pygltflib.GLTF2().load(str(path))
    assert [node.name for node in document.nodes[:len(skeleton.names)]] == list(skeleton.names)
    assert len(document.skins[0].joints) == len(skeleton.names)
    np.testing.assert_allclose(mesh.weights.sum(axis=1), 1., atol=1e-6)
    # At rest each vertex of the skin is near the joint that moves it most.
    rest = np.zeros((len(skeleton.names), 3))
    for joint, parent in enumerate(skeleton.parents):
        if parent >= 0:
            rest[joint] = rest[parent] + skeleton.offsets[joint]
    strongest = mesh.joints[:, 0]
    of_hand = np.isin(strongest, [skeleton.names.index(name) for name in
                                  joint_names('humanik', 'right')[1:]])
    assert of_hand.sum() > 500
    away = np.linalg.norm(mesh.vertices - rest[strongest], axis=1)
    assert away[of_hand].max() < .09
    # Faces of the bones' octahedra look outwards: renderers cull others.
    bones = mesh.faces[len(load_skin(tracked.hand).faces):].reshape(-1, 8, 3)
    corners = mesh.vertices[bones] - mesh.vertices[bones].mean(axis=(1, 2), keepdims=True)
    assert len(bones) > 10 and (np.linalg.det(corners) > 0.).all()
    # Forward kinematics of the quaternions are those of the angles.
    places, _ = joint_poses(spliced.joints, spliced.values[100:101])
    shown = [i for i, joint in enumerate(spliced.joints) if joint.channels]
    np.testing.assert_allclose(
        joint_places(skeleton, 100), UNIT * places[0, shown], atol=1e-9)

