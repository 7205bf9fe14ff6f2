"""The offset of a tracked wrist in a frame of a body, by poses that both captures saw."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from hand_tracker.splicing.frame_tree import FramePose, FrameTree
from hand_tracker.splicing.wrist_offset import OffsetError, PoseTrack, fit_wrist_offset

OFFSET = np.array((.03, -.02, .25)), Rotation.from_rotvec((.4, -1.2, .7))
WORLD = np.array((1., -2., .5)), Rotation.from_rotvec((.2, .3, 2.5))
SECONDS, RATE, BODY_RATE = 20., 120., 60.


def smooth(rng, times, size, columns=3):
    """Return numbers that wander about 0, shape (T, columns)."""
    knots = np.arange(-1., times[-1] + 2., .5)
    return CubicSpline(knots, rng.normal(0., size, (len(knots), columns)))(times)


def captures(place=.2, turn=.5, noise=0., late=0., seed=0):
    """Return what the body's and the hand's capture saw of one moving arm."""
    rng = np.random.default_rng(seed)
    times = np.arange(round(SECONDS * RATE)) / RATE
    places, turns = smooth(rng, times, place), Rotation.from_rotvec(smooth(rng, times, turn))
    body, wrist = PoseTrack(), PoseTrack()
    every = round(RATE / BODY_RATE)
    jitter = rng.normal(0., noise, (len(times), 3))
    for time, at, to in zip(times[::every], places[::every], turns[::every]):
        body.append(FramePose('studio', 100. + time + late, at, to.as_quat()))
    position, rotation = OFFSET
    origin, world = WORLD
    for time, at, to, error in zip(times, places, turns, jitter):
        wrist.append(FramePose(
            'mocap', 100. + time, origin + world.apply(at + to.apply(position)) + error,
            (world * to * rotation * Rotation.from_rotvec(10. * error)).as_quat()))
    return body, wrist


def track_of(rows, root='studio'):
    """Return a PoseTrack with the given rows."""
    track = PoseTrack()
    for row in rows:
        track.append(FramePose(root, row[0], row[1:4], row[4:]))
    return track


@pytest.mark.parametrize('seed', range(5))
def test_the_offset_is_found_in_worlds_that_differ(seed):
    found = fit_wrist_offset(*captures(noise=.001, seed=seed))
    np.testing.assert_allclose(found.position, OFFSET[0], atol=1e-3)
    assert (Rotation.from_quat(found.rotation) * OFFSET[1].inv()).magnitude() < np.radians(.2)
    assert found.distance < .003 and found.spread < np.radians(2.)


def test_captures_without_noise_tell_it_to_interpolation():
    found = fit_wrist_offset(*captures())
    np.testing.assert_allclose(found.position, OFFSET[0], atol=1e-4)
    assert (Rotation.from_quat(found.rotation) * OFFSET[1].inv()).magnitude() < 1e-3


@pytest.mark.parametrize('late', [-.06, .01, .03, .1])
def test_stamps_that_are_late_by_the_same_time_are_told_and_do_no_harm(late):
    found = fit_wrist_offset(*captures(noise=.001, late=late))
    assert found.delay == pytest.approx(late, abs=.0005)
    np.testing.assert_allclose(found.position, OFFSET[0], atol=1e-3)
    assert (Rotation.from_quat(found.rotation) * OFFSET[1].inv()).magnitude() < np.radians(.2)


@pytest.mark.parametrize('given, reason', [
    ({'place': .002}, 'moved too little'), ({'turn': .01}, 'turned too little'),
    ({'late': 3.}, 'turn apart'), ({'late': 60.}, 'are of the same times')])
def test_what_does_not_tell_it_is_refused_with_the_reason(given, reason):
    with pytest.raises(OffsetError, match=reason):
        fit_wrist_offset(*captures(**given))


def test_captures_that_share_an_instant_are_refused_at_any_rate():
    # 20 s in milliseconds that are taken for 20 ms.
    body, wrist = (track_of(track.rows * ([1e-3] + 7 * [1.])) for track in captures())
    with pytest.raises(OffsetError, match=r'share 0\.02 s; expected more than 0\.1 s'):
        fit_wrist_offset(body, wrist)


def test_a_pose_is_that_of_the_last_message_of_its_time():
    # The transforms of each time come in two messages, the hips' first.
    tree, track, places = FrameTree(), PoseTrack(), np.random.default_rng(5).normal(size=(4, 2, 3))
    turn = Rotation.identity().as_quat()
    for time, (hips, arm) in enumerate(places):
        for parent, child, place in (('studio', 'hips', hips), ('hips', 'arm', arm)):
            tree.update(parent, child, float(time), place, turn)
            if tree.chain('arm'):
                track.append(tree.pose('arm'))
    np.testing.assert_array_equal(track.rows[:, 0], range(4))
    np.testing.assert_allclose(track.rows[:, 1:4], places.sum(axis=1), atol=1e-12)
    track.append(FramePose('studio', 1., np.zeros(3), turn))
    assert len(track) == 4


def test_poses_in_another_root_begin_the_track_anew():
    track = track_of(captures()[0].rows)
    track.append(FramePose('world', 1., np.ones(3), Rotation.identity().as_quat()))
    np.testing.assert_array_equal(track.rows, [[1., 1., 1., 1., 0., 0., 0., 1.]])


def test_gaps_of_the_body_are_not_interpolated():
    body, wrist = captures()
    few = track_of(body.rows[::60])
    with pytest.raises(OffsetError, match=f'{len(few)} of the body.* 0 are of the same times'):
        fit_wrist_offset(few, wrist)


def test_a_frame_is_where_the_chain_of_its_parents_has_it():
    rng = np.random.default_rng(3)
    names, expected, tree = ['world', 'hips', 'arm', 'hand'], np.eye(4), FrameTree()
    for number, (parent, child) in enumerate(zip(names, names[1:])):
        to, turn = rng.normal(size=3), Rotation.random(random_state=number)
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = turn.as_matrix(), to
        expected = expected @ matrix
        # Of any length, as other nodes may send them; the arm rests.
        assert tree.update(parent, child, np.nan if child == 'arm' else 5. + number,
                           to, 2. * turn.as_quat())
    pose = tree.pose('hand')
    assert (pose.root, pose.time) == ('world', 7.)
    np.testing.assert_allclose(pose.position, expected[:3, 3], atol=1e-12)
    np.testing.assert_allclose(
        Rotation.from_quat(pose.rotation).as_matrix(), expected[:3, :3], atol=1e-12)
    assert tree.pose('world') is None and tree.chain('hand') == ['hand', 'arm', 'hips']


def test_what_is_no_transform_changes_nothing_and_loops_end():
    tree = FrameTree()
    tree.update('a', 'b', 1., [1., 0., 0.], [0., 0., 0., 1.])
    assert not tree.update('a', 'b', 2., [np.nan, 0., 0.], [0., 0., 0., 1.])
    assert not tree.update('a', 'b', 2., [0.] * 3, [0.] * 4)
    assert tree.pose('b').time == 1.
    tree.update('b', 'a', 2., [0., 1., 0.], [0., 0., 0., 1.])
    assert tree.chain('b') == ['b', 'a'] and np.isfinite(tree.pose('b').position).all()
