"""Tracked hands among the markers of a body."""

import re

import bvhio
import numpy as np
import pygltflib
import pytest
from helpers.bodies import LEVER, SimulatedBody, body_that_carries, swayed
from helpers.point_files import hand_recording

from hand_tracker.__main__ import main
from hand_tracker.files.bvh_file import write_bvh, write_bvh_motion
from hand_tracker.files.glb_file import write_glb
from hand_tracker.files.point_recording import ROTATIONS, Axes, PointRecording
from hand_tracker.files.recordings import read_recording, write_recording
from hand_tracker.splicing.body_skeleton import SkeletonError
from hand_tracker.splicing.clock_alignment import Trajectory, align_clocks
from hand_tracker.splicing.marker_skeleton import marker_mesh, marker_skeleton
from hand_tracker.splicing.spliced_body import wrist_motion
from hand_tracker.splicing.spliced_points import hand_world, marker_wrist, splice_points

NEEDS = 'bvhio', 'pygltflib'
OFFSET = .6
TURN_UPRIGHT = np.array(ROTATIONS['y'], dtype=float)


@pytest.fixture(scope='module')
def simulated():
    """Return a body, what was captured of its right wrist, and the hand on it."""
    body = SimulatedBody(seconds=10., seed=9)
    path, turns = wrist_motion(body.motion(100.), body.wrists['right'])
    across = turns @ np.array((0., 0., .03))
    middle = .01 * path.positions
    points = np.stack([middle + across, middle - across, middle + 1.], axis=1) @ TURN_UPRIGHT.T
    recording = PointRecording('body', 'test', ('Anna:RWRA', 'Anna:RWRB', 'Anna:C7'),
                               points.astype(np.float32), 100., None, Axes('m', 'z'))
    tracked = body.hand('right', np.arange(1000) / 120., lambda t: t + OFFSET)
    return body, recording, tracked


def test_joints_are_put_into_the_world_of_the_body(simulated):
    body, recording, tracked = simulated
    wrist = marker_wrist(recording, 'right')
    alignment = align_clocks(wrist, Trajectory(tracked.times, tracked.wrist_position))
    assert alignment.offset == pytest.approx(OFFSET, abs=.004)
    world = hand_world(wrist, tracked, alignment)
    assert not world.is_same and world.distance < 2. * np.linalg.norm(LEVER)
    turned = TURN_UPRIGHT @ body.world.T @ TURN_UPRIGHT.T
    angle = np.degrees(np.arccos((np.trace(world.rotation.T @ turned) - 1.) / 2.))
    assert angle < 6.
    spliced = splice_points(recording, [(tracked, alignment, world)])
    assert spliced.labels[:3] == recording.labels
    assert np.array_equal(spliced.points[:, :3], recording.points)
    at_wrist = spliced.points[:, spliced.labels.index('right_wrist')]
    seen = np.isfinite(at_wrist).all(axis=1)
    assert not seen[:55].any() and seen[65:890].all() and not seen[900:].any()
    away = np.linalg.norm(at_wrist - wrist.positions, axis=1)[seen]
    assert np.median(away) == pytest.approx(world.distance, rel=.2)


def test_hands_of_the_same_world_stay_where_they_were_measured(simulated):
    _, recording, tracked = simulated
    wrist = marker_wrist(recording, 'right')
    alignment = align_clocks(wrist, Trajectory(tracked.times, tracked.wrist_position))
    moved = np.stack([np.interp(tracked.times + OFFSET, wrist.times, axis)
                      for axis in wrist.positions.T], axis=1)
    world = hand_world(wrist, tracked._replace(wrist_position=moved + .01), alignment)
    assert world.is_same and np.array_equal(world.rotation, np.eye(3))


def test_a_body_without_wrist_markers_is_refused(simulated):
    _, recording, _ = simulated
    with pytest.raises(SkeletonError, match='no marker is at the left wrist.*Anna:C7'):
        marker_wrist(recording, 'left')


def test_the_command_takes_bodies_of_markers_and_refuses_the_wrong_output(tmp_path, capsys):
    hand = swayed(hand_recording(480, start=100))
    write_recording(tmp_path / 'take.c3d', hand)
    wrist = hand.points[:, :1] + np.float32(.02)
    write_recording(tmp_path / 'body.c3d', hand._replace(labels=('RWRA',), points=wrist))
    write_bvh_motion(tmp_path / 'body.bvh', body_that_carries(hand.points[:, 0]))
    output = tmp_path / 'out.c3d'
    assert main(['splice', str(tmp_path / 'body.c3d'), str(tmp_path / 'take.c3d'),
                 '-o', str(output)]) == 0
    assert 'in the same world as the body' in capsys.readouterr().err
    found = read_recording(output)
    assert found.labels[0] == 'RWRA' and 'right_index_pip' in found.labels
    for name in ('OUT.BVH', 'out.glb'):
        assert main(['splice', str(tmp_path / 'body.c3d'), str(tmp_path / 'take.c3d'),
                     '-o', str(tmp_path / name)]) == 0
        assert (tmp_path / name).stat().st_size > 10_000
    for body, name in (('body.c3d', 'out.csv'), ('body.bvh', 'out.c3d')):
        assert main(['splice', str(tmp_path / body), str(tmp_path / 'take.c3d'),
                     '-o', str(tmp_path / name)]) == 1
        assert 'unknown extension' in capsys.readouterr().err
    assert main(['splice', str(tmp_path / 'body.bvh'), str(tmp_path / 'take.c3d'), '--offset',
                 '99', '-o', str(tmp_path / 'out.bvh')]) == 1
    assert 'at an offset of 99 s no frame' in capsys.readouterr().err
    assert main(['splice', str(tmp_path / 'body.bvh'), str(tmp_path / 'take.c3d'),
                 '-o', str(tmp_path / 'out.glb')]) == 0
    said = capsys.readouterr().err
    assert re.search(r'begins at -?0\.00[0-4]\d s of the body', said)
    assert 'in cm, as the wrist moves' in said and 'unsure' not in said


def test_a_file_with_both_hands_is_spliced_where_it_is_named_twice(tmp_path, capsys):
    right, left = (swayed(hand_recording(480, side, start=100)) for side in ('right', 'left'))
    write_recording(tmp_path / 'both.c3d', right._replace(
        labels=right.labels + left.labels, points=np.concatenate((right.points, left.points), 1)))
    wrists = np.concatenate((right.points[:, :1], left.points[:, :1]), 1) + np.float32(.02)
    write_recording(tmp_path / 'body.c3d', right._replace(labels=('RWRA', 'LWRA'), points=wrists))
    body, hands, output = (str(tmp_path / name) for name in ('body.c3d', 'both.c3d', 'out.c3d'))
    assert main(['splice', body, hands, '-o', output]) == 0
    assert 'labels name a left hand, too, which is left out (--side left)' in (
        capsys.readouterr().err)
    assert not any(label.startswith('left_') for label in read_recording(output).labels)
    assert main(['splice', body, hands, hands, '-o', output]) == 0
    assert 'left out' not in capsys.readouterr().err
    assert {'right_index_pip', 'left_index_pip'} <= set(read_recording(output).labels)


def test_a_body_of_markers_is_a_skeleton_in_motion_too(simulated, tmp_path):
    body, recording, tracked = simulated
    wrist = marker_wrist(recording, 'right')
    alignment = align_clocks(wrist, Trajectory(tracked.times, tracked.wrist_position))
    world = hand_world(wrist, tracked, alignment)
    points = recording.points.copy()
    points[300:310, 2] = np.nan
    hidden = recording._replace(points=points, labels=('RightHand', *recording.labels[1:]))
    hands = [(tracked, alignment, world)]
    skeleton = marker_skeleton(hidden, hands, 'mixamo')
    assert skeleton.names[:5] == (
        'body', 'RightHand', 'Anna:RWRB', 'Anna:C7', 'mixamorig:RightHand')
    path = tmp_path / 'spliced.bvh'
    write_bvh(path, skeleton)
    root = bvhio.readAsHierarchy(str(path))
    expected = splice_points(recording, hands)
    for frame in (80, 305, 700):
        root.loadPose(frame, recursive=True)
        for name, label in (('RightHand', 'Anna:RWRA'), ('Anna:RWRB', 'Anna:RWRB'),
                            ('Anna:C7', 'Anna:C7'), ('mixamorig:RightHand', 'right_wrist'),
                            ('mixamorig:RightHandIndex1', 'right_index_mcp'),
                            ('mixamorig:RightHandThumb3', 'right_thumb_ip')):
            at = np.array(root.filter(name, isEqual=True)[0].PositionWorld)
            path = expected.points[:, expected.labels.index(label)] @ TURN_UPRIGHT
            is_hidden = (frame, label) == (305, 'Anna:C7')
            # Straight on, from frame 299 to frame 310.
            true = (5. * path[299] + 6. * path[310]) / 11. if is_hidden else path[frame]
            np.testing.assert_allclose(.01 * at, true, atol=2e-5)
    scene = tmp_path / 'spliced.glb'
    write_glb(scene, skeleton, marker_mesh(skeleton, [tracked]))
    document = pygltflib.GLTF2().load(str(scene))
    assert [document.nodes[i].name for i in document.skins[0].joints] == list(skeleton.names)
    moved = {channel.target.node for channel in document.animations[0].channels
             if channel.target.path == 'translation'}
    assert moved == {0, 1, 2, 3, 4}
