"""Tracked hands in files of animation and science, as independent readers find it."""

import bvhio
import ezc3d
import numpy as np
import pygltflib
import pytest
from scipy.spatial.transform import Rotation

from hand_tracker.core.errors import HandTrackerError
from hand_tracker.core.model.hand import DIGITS, LINKS, SIDES, Hand
from hand_tracker.core.model.kinematics import forward, joint_table, tip_offsets
from hand_tracker.files.recordings import read_recording
from hand_tracker.files.skeleton_motion import (
    NAMINGS,
    SKELETON_LINKS,
    HandAngles,
    TrackedHands,
    joint_names,
)
from hand_tracker.files.written_kinds import EULER_ORDERS
from hand_tracker.skin.load import load_skin
from hand_tracker.skin.skinning import deform
from hand_tracker.tracking.save_motion import bound_mesh, save_motion

NEEDS = 'bvhio', 'ezc3d', 'pygltflib'
FRAMES = 12
TO_Y_UP = np.array(((1., 0., 0.), (0., 0., 1.), (0., -1., 0.)))


def tracked_hand(side='right', seed=3):
    """Return a hand that moves at random within its limits, and turns any way."""
    hand = Hand.scaled(side=side)
    rng = np.random.default_rng(seed)
    angles = rng.uniform(*hand.limits.T, (FRAMES, 25))
    return HandAngles(hand, angles, rng.normal(0., .5, (FRAMES, 3)),
                      Rotation.random(FRAMES, rng).as_matrix(), np.arange(FRAMES) / 120.)


def truth(tracked):
    """Return the places of the wrist and the skeleton's joints, (T, 20, 3), and tips (T, 5, 3)."""
    pose = forward(joint_table(tracked.hand), tracked.angles, tracked.wrist_rotation,
                   tracked.wrist_position)
    rows = [LINKS.index(link) for link in SKELETON_LINKS]
    distal = [LINKS.index(f'{digit}_distal') for digit in DIGITS]
    tips = pose.position[:, distal] + np.einsum(
        'tdij,dj->tdi', pose.rotation[:, distal], tip_offsets(tracked.hand))
    return np.concatenate((tracked.wrist_position[:, None], pose.position[:, rows]), axis=1), tips


def both_hands():
    """Return hands that are tracked together but in some frames, one of which has neither.

    Returns
    -------
    tracked : TrackedHands
        The right one is lost for two frames and at the end, the left one at the beginning.
    whole : list of HandAngles
        The hands in all frames, the one of neither hand, `FRAMES - 3`, too.
    """
    whole = [tracked_hand(side, seed) for seed, side in enumerate(SIDES)]
    all_rows = np.delete(np.arange(FRAMES), FRAMES - 3)
    rows = (np.array([0, 1, 2, 3, 6, 7, 8]), np.arange(2, FRAMES - 1))
    hands = tuple(part_of(hand, all_rows[own]) for hand, own in zip(whole, rows))
    return TrackedHands(hands, rows, whole[0].times[all_rows]), whole


def part_of(hand, rows):
    return HandAngles(hand.hand, *(values[rows] for values in hand[1:]))


@pytest.mark.parametrize('side, naming, order', [
    ('right', 'humanik', 'ZXY'), ('left', 'mixamo', 'XYZ'), ('right', 'xsens', 'YZX'),
    ('left', 'unity', 'ZYX'), ('right', 'humanik', 'XZY'), ('right', 'humanik', 'YXZ')])
def test_bvh_files_have_the_hand_where_the_tracker_has_it(tmp_path, side, naming, order):
    tracked = tracked_hand(side)
    path = tmp_path / 'hand.bvh'
    save_motion(path, tracked, naming, order)
    joints, tips = truth(tracked)
    root = bvhio.readAsHierarchy(str(path))
    names = joint_names(naming, side)
    for frame in range(FRAMES):
        root.loadPose(frame, recursive=True)
        for name, place in zip(names, joints[frame] @ TO_Y_UP.T, strict=True):
            joint, = root.filter(name, isEqual=True)
            np.testing.assert_allclose(.01 * np.array(joint.PositionWorld), place, atol=1e-5)
    # The tips too, as this package reads them.
    found = read_recording(path)
    ends = [found.labels.index(f'{names[1 + SKELETON_LINKS.index(f"{digit}_distal")]}_end')
            for digit in DIGITS]
    np.testing.assert_allclose(.01 * found.points[:, ends], tips, atol=1e-5)
    assert found.rate == pytest.approx(120., rel=1e-5)


@pytest.mark.parametrize('naming', NAMINGS)
@pytest.mark.parametrize('side', ['right', 'left'])
def test_joints_have_different_names_of_their_side(naming, side):
    names = joint_names(naming, side)
    word = side[:1].upper() if naming == 'optitrack' else side.title()
    assert len(set(names)) == 20
    assert all(name.removeprefix('mixamorig:').startswith(word) for name in names)


def test_humanik_names_are_those_that_programs_know():
    names = joint_names('humanik', 'right')
    assert names[:5] == ('RightHand', 'RightInHandIndex', 'RightHandIndex1', 'RightHandIndex2',
                         'RightHandIndex3')
    assert {'RightHandThumb1', 'RightHandThumb3', 'RightHandPinky3'} <= set(names)


def gltf_array(file, number):
    """Return an accessor's numbers."""
    accessor = file.accessors[number]
    view = file.bufferViews[accessor.bufferView]
    width = {'SCALAR': 1, 'VEC3': 3, 'VEC4': 4, 'MAT4': 16}[accessor.type]
    kind = {5121: np.uint8, 5125: np.uint32, 5126: np.float32}[accessor.componentType]
    start = view.byteOffset or 0
    data = file.binary_blob()[start:start + view.byteLength]
    return np.frombuffer(data, kind, accessor.count * width).reshape(accessor.count, width)


def node_frames(file, frame):
    """Return the frames (4, 4) of all nodes in a frame of the animation, by their place."""
    local = []
    for node in file.nodes:
        matrix = np.eye(4)
        matrix[:3, 3] = node.translation or (0., 0., 0.)
        local.append(matrix)
    animation, = file.animations
    for channel in animation.channels:
        value = gltf_array(file, animation.samplers[channel.sampler].output)[frame]
        if channel.target.path == 'translation':
            local[channel.target.node][:3, 3] = value
        else:
            local[channel.target.node][:3, :3] = Rotation.from_quat(value).as_matrix()
    world = {}

    def place(node, above):
        world[node] = above @ local[node]
        for child in file.nodes[node].children or ():
            place(child, world[node])

    for node in file.scenes[file.scene].nodes:
        place(node, np.eye(4))
    return world


@pytest.mark.parametrize('side', ['right', 'left'])
def test_glb_files_have_hand_and_skin_where_the_tracker_has_them(tmp_path, side):
    tracked = tracked_hand(side)
    path = tmp_path / 'hand.glb'
    save_motion(path, tracked)
    file = pygltflib.GLTF2().load(str(path))
    joints, tips = truth(tracked)
    skin, = file.skins
    inverse = gltf_array(file, skin.inverseBindMatrices).reshape(-1, 4, 4).swapaxes(1, 2)
    primitive, = file.meshes[0].primitives
    vertices = gltf_array(file, primitive.attributes.POSITION)
    moving = gltf_array(file, primitive.attributes.JOINTS_0)
    weights = gltf_array(file, primitive.attributes.WEIGHTS_0)
    faces = gltf_array(file, primitive.indices).reshape(-1, 3)
    np.testing.assert_allclose(weights.sum(axis=1), 1., atol=1e-5)
    assert faces.max() == len(vertices) - 1
    model = load_skin(tracked.hand)
    for frame in (0, FRAMES - 1):
        world = node_frames(file, frame)
        places = np.array([world[node][:3, 3] for node in range(len(joints[0]))])
        np.testing.assert_allclose(places, joints[frame] @ TO_Y_UP.T, atol=1e-5)
        ends = {file.nodes[node].name: world[node][:3, 3] for node in world}
        for digit, tip in zip(('Index', 'Middle', 'Ring', 'Pinky', 'Thumb'), tips[frame]):
            np.testing.assert_allclose(ends[f'{side.title()}Hand{digit}3_end'], TO_Y_UP @ tip,
                                       atol=1e-5)
        matrices = np.array([world[joint] @ inverse[i] for i, joint in enumerate(skin.joints)])
        blended = np.einsum('vk,vkij->vij', weights, matrices[moving])
        shown = np.einsum('vij,vj->vi', blended, np.c_[vertices, np.ones(len(vertices))])[:, :3]
        pose = forward(joint_table(tracked.hand), tracked.angles[frame],
                       tracked.wrist_rotation[frame], tracked.wrist_position[frame])
        off = np.linalg.norm(shown - deform(model, pose) @ TO_Y_UP.T, axis=1)
        # Exact but where more than four bones move a vertex; joints at their limits show it most.
        assert np.median(off) < 1e-4 and np.percentile(off, 95) < .001 and off.max() < .004


def test_four_bones_of_a_vertex_are_enough():
    skin = load_skin(Hand.scaled())
    mesh = bound_mesh(skin, 'right')
    assert mesh.weights.shape == (len(skin.vertices), 4)
    kept = np.sort(skin.weights, axis=1)[:, -4:].sum(axis=1)
    assert kept.min() > .8 and np.median(kept) > .99


@pytest.mark.parametrize('suffix', ['.trc', '.c3d'])
def test_joint_centres_are_those_of_the_hand(tmp_path, suffix):
    tracked = tracked_hand('left')
    path = tmp_path / f'hand{suffix}'
    save_motion(path, tracked)
    joints, tips = truth(tracked)
    labels, points = read_centres(path)
    assert labels[0] == 'left_wrist' and labels[-1] == 'left_thumb_tip'
    np.testing.assert_allclose(points, np.concatenate((joints, tips), axis=1), atol=1e-5)


def read_centres(path):
    """Return the labels and points (T, N, 3) [m] of a file, missing ones NaN."""
    if path.suffix == '.c3d':
        file = ezc3d.c3d(str(path))
        labels = file['parameters']['POINT']['LABELS']['value']
        points = .001 * np.moveaxis(file['data']['points'][:3], 0, 2).swapaxes(0, 1)
    else:
        lines = path.read_text(encoding='utf-8').splitlines()
        labels = [name for name in lines[3].split('\t')[2:] if name]
        table = np.genfromtxt(path, delimiter='\t', skip_header=5)
        points = table[:, 2:2 + 3 * len(labels)].reshape(
            len(table), -1, 3) @ (.001 * TO_Y_UP)
    return labels, points


@pytest.mark.parametrize('suffix', ['.trc', '.c3d'])
def test_joint_centres_of_both_hands_are_missing_where_a_hand_is_lost(tmp_path, suffix):
    tracked, _ = both_hands()
    path = tmp_path / f'hands{suffix}'
    save_motion(path, tracked)
    labels, points = read_centres(path)
    assert len(set(labels)) == len(labels) == 50
    # The frame that has neither hand is there, and empty.
    frames = np.delete(np.arange(FRAMES), FRAMES - 3)
    expected = np.full((FRAMES, 50, 3), np.nan)
    for first, hand, rows in zip((0, 25), tracked.hands, tracked.rows):
        expected[frames[rows], first:first + 25] = np.concatenate(truth(hand), axis=1)
        assert {label.partition('_')[0] for label in labels[first:first + 25]} == {hand.hand.side}
    assert np.isnan(expected).any(axis=(1, 2)).sum() == 7
    np.testing.assert_allclose(points, expected, atol=1e-5)


@pytest.mark.parametrize('naming, order', [('humanik', 'ZXY'), ('mixamo', 'XYZ'),
                                           ('optitrack', 'YZX')])
def test_bvh_files_have_both_hands_below_one_root(tmp_path, naming, order):
    tracked, whole = both_hands()
    path = tmp_path / 'hands.bvh'
    save_motion(path, tracked, naming, order)
    root = bvhio.readAsHierarchy(str(path))
    lines = path.read_text(encoding='utf-8').splitlines()
    assert sum(line.startswith('ROOT') for line in lines) == 1
    assert f'Frames: {FRAMES}' in lines
    assert ' '.join(f'{axis}rotation' for axis in order) in lines[4]
    shown = [root.filter(name, isEqual=True)[0] for side in SIDES
             for name in joint_names(naming, side)]
    wrists = shown[0], shown[20]
    assert all(wrist.Parent.Name == root.Name == 'hands' for wrist in wrists)
    frames = np.delete(np.arange(FRAMES), FRAMES - 3)
    poses = []
    for frame in range(FRAMES):
        root.loadPose(frame, recursive=True)
        assert np.array_equal(root.PositionWorld, np.zeros(3))
        poses.append(np.array([.01 * np.array(joint.PositionWorld) for joint in shown]))
    for first, hand, rows in zip((0, 20), tracked.hands, tracked.rows):
        found = np.array(poses)[frames[rows], first:first + 20]
        np.testing.assert_allclose(found, truth(hand)[0] @ TO_Y_UP.T, atol=1e-5)
    # A lost hand is between its poses, and rests before the first and after the last.
    right, left = (np.array(poses)[:, first:first + 20] for first in (0, 20))
    start, end = (part_of(whole[0], [frame]) for frame in (3, 6))
    for frame, share in ((4, 1. / 3.), (5, 2. / 3.)):
        np.testing.assert_allclose(right[frame, 0], TO_Y_UP @ (
            (1. - share) * start.wrist_position[0] + share * end.wrist_position[0]), atol=1e-5)
    np.testing.assert_allclose(right[9:], np.repeat(right[8:9], FRAMES - 9, axis=0), atol=1e-6)
    np.testing.assert_allclose(left[:2], np.repeat(left[2:3], 2, axis=0), atol=1e-6)


def test_glb_files_have_both_hands_with_their_skins(tmp_path):
    tracked, _ = both_hands()
    path = tmp_path / 'hands.glb'
    save_motion(path, tracked)
    file = pygltflib.GLTF2().load(str(path))
    skin, = file.skins
    inverse = gltf_array(file, skin.inverseBindMatrices).reshape(-1, 4, 4).swapaxes(1, 2)
    names = [node.name for node in file.nodes]
    assert [names[node] for node in file.scenes[0].nodes] == ['hands', 'right_skin', 'left_skin']
    assert [names[node] for node in file.nodes[0].children] == ['RightHand', 'LeftHand']
    times = gltf_array(file, file.animations[0].samplers[0].input)[:, 0]
    np.testing.assert_allclose(times, tracked.times, atol=1e-6)
    for row in range(len(times)):
        world = node_frames(file, row)
        matrices = np.array([world[joint] @ inverse[i] for i, joint in enumerate(skin.joints)])
        for hand, rows, mesh in zip(tracked.hands, tracked.rows, file.meshes, strict=True):
            if row not in rows:
                continue
            own = part_of(hand, np.flatnonzero(rows == row))
            joints = [names.index(name) for name in joint_names('humanik', hand.hand.side)]
            places = np.array([world[joint][:3, 3] for joint in joints])
            np.testing.assert_allclose(places, truth(own)[0][0] @ TO_Y_UP.T, atol=1e-5)
            if row not in (2, 8):
                continue
            primitive, = mesh.primitives
            vertices = gltf_array(file, primitive.attributes.POSITION)
            moving = gltf_array(file, primitive.attributes.JOINTS_0)
            blended = np.einsum('vk,vkij->vij', gltf_array(
                file, primitive.attributes.WEIGHTS_0), matrices[moving])
            shown = np.einsum('vij,vj->vi', blended, np.c_[vertices, np.ones(len(vertices))])
            pose = forward(joint_table(own.hand), own.angles[0], own.wrist_rotation[0],
                           own.wrist_position[0])
            off = np.linalg.norm(
                shown[:, :3] - deform(load_skin(own.hand), pose) @ TO_Y_UP.T, axis=1)
            assert np.median(off) < 1e-4 and np.percentile(off, 95) < .001 and off.max() < .004
    # The left hand rests until it is seen.
    left = names.index('LeftHand')
    wrists = [node_frames(file, row)[left] for row in (0, 1, 2)]
    assert np.allclose(wrists[0], wrists[2]) and np.allclose(wrists[1], wrists[2])


@pytest.mark.parametrize('suffix', ['.bvh', '.glb'])
def test_of_two_hands_one_may_have_a_single_frame_or_none(tmp_path, suffix):
    whole = [tracked_hand(side) for side in SIDES]
    for count in (1, 0):
        rows = np.arange(FRAMES), np.arange(count)
        tracked = TrackedHands(tuple(part_of(hand, own) for hand, own in zip(whole, rows)), rows,
                               whole[0].times)
        path = tmp_path / f'hands{suffix}'
        save_motion(path, tracked)
        content = path.read_bytes()
        assert b'RightHandIndex1' in content and (b'LeftHandIndex1' in content) == bool(count)


def test_what_cannot_be_written_is_named(tmp_path):
    with pytest.raises(HandTrackerError, match="unknown extension '.fbx'; expected .bvh, .glb"):
        save_motion(tmp_path / 'hand.fbx', tracked_hand())
    with pytest.raises(HandTrackerError, match='no folder'):
        save_motion(tmp_path / 'none' / 'hand.bvh', tracked_hand())
    with pytest.raises(HandTrackerError, match="Euler order 'ZZZ'; expected one of " + ', '.join(
            EULER_ORDERS)):
        save_motion(tmp_path / 'hand.bvh', tracked_hand(), order='ZZZ')
