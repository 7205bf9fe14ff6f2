"""Labels of points without names: simulated hands, shuffled, with ghosts and hidden markers."""

import numpy as np
import pytest

from hand_tracker.core.errors import HandTrackerError
from hand_tracker.core.model.hand import FLEXION_JOINTS, JOINTS, OTHER_SIDE, SIDES, Hand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.layout_presets import preset_layout
from hand_tracker.core.model.marker_layout import MARKERS, MarkerLayout, marker_positions
from hand_tracker.core.numerics.jit import COMPILED
from hand_tracker.core.point_labelling import cloud_labeller
from hand_tracker.core.point_labelling.cloud_labeller import CloudLabeller
from hand_tracker.core.point_labelling.clutter import FIRST_DEVIATION
from hand_tracker.core.point_labelling.following import DEVIATION_GAIN, LEAST_POINT_DEVIATION
from hand_tracker.core.point_labelling.hand_track import start_places
from hand_tracker.core.point_labelling.natural_poses import (
    ANYBODY,
    SIZED,
    marker_digits,
    model_prototype,
    natural_poses,
)
from hand_tracker.core.point_labelling.prototypes import learn_prototype
from hand_tracker.core.point_labelling.side_evidence import SIDE_PERIOD
from hand_tracker.simulation.packaged_recordings import demo_recording

RATE = 120.


def prototype(side='right', **size):
    return model_prototype(Hand.scaled(side=side, **size), MarkerLayout(), MARKERS)


def moving(frames, side='right', at=(0., 0., 0.), seed=0):
    """Return the markers of a hand that goes smoothly from pose to pose, and moves, (T, 8, 3)."""
    hand = Hand.scaled(side=side)
    keys = natural_poses(hand, 400)[100 * seed:][:2 + frames // 60]
    places = np.arange(frames) / 60.
    angles = np.array([np.interp(places, np.arange(len(keys)), column) for column in keys.T]).T
    time = np.arange(frames) / RATE
    position = np.array(at) + .1 * np.sin(np.outer(time, (1.1, 1.7, .9)))
    turn, rotation = .5 * np.sin(2. * time), np.tile(np.eye(3), (frames, 1, 1))
    rotation[:, 0, 0] = rotation[:, 1, 1] = np.cos(turn)
    rotation[:, 1, 0], rotation[:, 0, 1] = np.sin(turn), -np.sin(turn)
    return marker_positions(
        MarkerLayout().mounting(hand), forward(joint_table(hand), angles, rotation, position),
        rotation, position)


def shaken(marker, bend, rate):
    """Return 200 frames of a hand that is shaken at a rate [Hz] and bends a finger in the 90th."""
    hand = Hand.scaled()
    angles = np.tile(natural_poses(hand, 400)[110], (200, 1))
    angles[90:, FLEXION_JOINTS[marker - 3, :2]] += bend
    position = np.zeros((200, 3))
    position[:, 0] = .05 * np.sin(2. * np.pi * rate * np.arange(200) / RATE)
    rotation = np.tile(np.eye(3), (200, 1, 1))
    return marker_positions(
        MarkerLayout().mounting(hand), forward(joint_table(hand), angles, rotation, position),
        rotation, position)


def thrown_about(layout, frames):
    """Return the markers of a still hand that goes 14 mm anywhere in each frame, (T, M, 3)."""
    hand = Hand.scaled()
    pose = marker_positions(layout.mounting(hand), forward(
        joint_table(hand), natural_poses(hand, 400)[110:111]))
    return pose + np.cumsum(np.random.default_rng(0).normal(0., .008, (frames, 1, 3)), axis=0)


def shuffled(markers, random, ghosts=0):
    """Return the visible of markers (M, 3) and ghosts in random order; the row of each marker."""
    visible = np.flatnonzero(np.isfinite(markers[:, 0]))
    middle = np.nanmean(markers, axis=0) if ghosts else 0.
    false = middle + random.uniform(-.25, .25, (ghosts, 3))
    order = random.permutation(len(visible) + ghosts)
    rows = np.full(len(markers), -1)
    rows[visible] = np.argsort(order)[:len(visible)]
    return np.concatenate((markers[visible], false))[order], rows


def test_a_measured_hand_is_told_from_ghosts_more_often_than_anybodys():
    random = np.random.default_rng(4)
    clouds = []
    for frame in moving(1200)[::20]:
        frame[random.integers(3)] = np.nan   # a marker of the palm is hidden
        clouds.append(shuffled(frame, random, ghosts=4))
    right = []
    for tolerances in (ANYBODY, SIZED):
        labeller = CloudLabeller([model_prototype(
            Hand.scaled(), MarkerLayout(), MARKERS, tolerances)])
        right.append(sum(np.array_equal(labeller.label_frame(points).rows[0], rows)
                         for points, rows in clouds))
    assert right[1] > right[0] + 5


def test_a_single_frame_is_labelled_whatever_the_order_and_the_pose_of_the_wrist():
    random = np.random.default_rng(1)
    labeller = CloudLabeller([prototype()])
    right = 0
    for frame in moving(400)[::20]:
        points, rows = shuffled(frame, random)
        right += np.array_equal(labeller.label_frame(points).rows[0], rows)
    assert right >= 19  # of 20


def test_a_stream_keeps_its_labels_beside_ghosts():
    random = np.random.default_rng(2)
    labeller = CloudLabeller([prototype()])
    right = 0
    for number, frame in enumerate(moving(300, seed=2)):
        points, rows = shuffled(frame, random, ghosts=4)
        right += np.array_equal(labeller.update(points, number / RATE).rows[0], rows)
    assert right >= 295


def test_ids_that_are_dealt_anew_in_each_frame_are_no_hint():
    random = np.random.default_rng(2)
    plain, numbered = CloudLabeller([prototype()]), CloudLabeller([prototype()])
    for number, frame in enumerate(moving(300, seed=2)):
        points, _ = shuffled(frame, random)
        by_place = plain.update(points, number / RATE).rows[0]
        by_id = numbered.update(points, number / RATE, random.permutation(len(points))).rows[0]
        assert np.array_equal(by_place, by_id), number


def test_a_hidden_marker_has_no_label_and_gets_its_own_back():
    random = np.random.default_rng(3)
    labeller = CloudLabeller([prototype()])
    frames = moving(240, seed=2)
    frames[60:90, 4] = np.nan
    frames[120:140, 1] = np.nan
    for number, frame in enumerate(frames):
        points, rows = shuffled(frame, random)
        found = labeller.update(points, number / RATE).rows[0]
        assert np.array_equal(found, rows), number


@pytest.mark.parametrize(('marker', 'bend'), ((3, -.5), (4, .8), (5, -.5), (6, -.5), (7, -.5)))
def test_a_finger_that_went_far_while_hidden_has_its_label_within_frames(marker, bend):
    random = np.random.default_rng(1)
    labeller = CloudLabeller([prototype()])
    frames = shaken(marker, bend, 1.)
    assert np.linalg.norm(np.diff(frames[[89, 90], marker], axis=0)) > .03
    frames[60:120, marker] = np.nan
    wrong = 0
    for number, frame in enumerate(frames):
        points, rows = shuffled(frame, random)
        wrong += not np.array_equal(labeller.update(points, number / RATE).rows[0], rows)
    assert wrong <= 5


@pytest.mark.parametrize('marker', range(3, 7))
def test_a_stray_point_taken_for_a_hidden_marker_is_given_up_as_it_goes_on_evenly(marker):
    random = np.random.default_rng(1)
    labeller = CloudLabeller([prototype()])
    frames = shaken(marker, 0., 2.)
    # It comes just where the hidden marker is.
    stray = frames[80, marker] + np.outer(np.arange(120), (0., .1, .1)) / RATE
    frames[60:140, marker] = np.nan
    frames = np.insert(frames, 8, np.nan, axis=1)
    frames[80:, 8] = stray
    taken = 0
    for number, frame in enumerate(frames):
        points, rows = shuffled(frame, random)
        found = labeller.update(points, number / RATE).rows[0]
        taken += number >= 80 and found[marker] == rows[8]
        if number >= 140:
            assert np.array_equal(found, rows[:8]), number
    assert 0 < taken < 30


def test_a_stray_point_that_fits_the_posture_is_not_taken_for_a_hidden_marker_of_the_palm():
    random = np.random.default_rng(1)
    labeller = CloudLabeller([prototype()])
    frames = shaken(3, 0., .5)
    stray = frames[70, 2] + (.02, 0., 0.) + np.outer(np.arange(80), (0., 0., .2)) / RATE
    frames[40:170, 2] = np.nan
    frames = np.insert(frames, 8, np.nan, axis=1)
    frames[70:150, 8] = stray
    for number, frame in enumerate(frames):
        points, rows = shuffled(frame, random)
        assert np.array_equal(labeller.update(points, number / RATE).rows[0], rows[:8]), number


@pytest.mark.parametrize('marker', ('ThumbTip', 'IndexTip', 'RingPIP'))
def test_a_point_that_comes_as_a_marker_of_a_fast_hand_vanishes_does_not_get_its_label(marker):
    layout = preset_layout('sig18_19')
    labeller = CloudLabeller([
        model_prototype(Hand.scaled(), layout, tuple(layout.names), SIZED)])
    random = np.random.default_rng(1)
    *frames, last = thrown_about(layout, 60)
    for frame in frames:
        points, rows = shuffled(frame, random)
        np.testing.assert_array_equal(labeller.update(points).rows[0], rows)
    points, rows = shuffled(last, random)
    number = layout.names.index(marker)
    points[rows[number]] += (0., 0., .03)
    rows[number] = -1
    np.testing.assert_array_equal(labeller.update(points).rows[0], rows)


def sig18_labeller():
    """Return the layout of 19 markers, eight of them on the palm, and a labeller of such a hand."""
    layout = preset_layout('sig18_19')
    return layout, CloudLabeller([
        model_prototype(Hand.scaled(), layout, tuple(layout.names), SIZED)])


def follow(labeller, frames, random):
    """Label frames in random order, check the labels, and return the track."""
    for number, frame in enumerate(frames):
        points, rows = shuffled(frame, random)
        np.testing.assert_array_equal(labeller.update(points).rows[0], rows, str(number))
    return labeller._hands[0].track


def test_a_palm_marker_that_vanishes_or_returns_leaves_the_errors_in_the_palms_frame():
    layout, labeller = sig18_labeller()
    frames, random = thrown_about(layout, 66), np.random.default_rng(1)
    frames[60:65, layout.names.index('BackHand1')] = np.nan
    for start, changed in ((0, 60), (61, 65)):
        before = follow(labeller, frames[start:changed], random).own_error.copy()
        after = follow(labeller, frames[changed:changed + 1], random).own_error
        np.testing.assert_array_equal(after, before)


def test_the_first_followed_frame_leaves_the_errors():
    layout, labeller = sig18_labeller()
    frames, random = thrown_about(layout, 3), np.random.default_rng(1)
    track = follow(labeller, frames[:2], random)
    assert (track.error == FIRST_DEVIATION).all() and (track.own_error == FIRST_DEVIATION).all()
    follow(labeller, frames[2:], random)
    assert (track.error > FIRST_DEVIATION).any() and (track.own_error < FIRST_DEVIATION).all()


def test_the_errors_of_a_hand_that_comes_to_rest_fall_alike():
    layout, labeller = sig18_labeller()
    frames, random = thrown_about(layout, 60), np.random.default_rng(1)
    track = follow(labeller, np.concatenate((frames, frames[[-1] * 30])), random)
    before = track.error.copy(), track.own_error.copy()
    follow(labeller, frames[[-1] * 3], random)
    for error, last in zip((track.error, track.own_error), before):
        np.testing.assert_allclose(
            error - LEAST_POINT_DEVIATION,
            (1. - DEVIATION_GAIN) ** 3 * (last - LEAST_POINT_DEVIATION), atol=1e-12)


def swaying(pose, frames):
    """Return the markers of a hand in a pose that sways, (T, 8, 3), and where to, (T, 1, 3)."""
    sway = np.zeros((frames, 1, 3))
    sway[:, 0, 0] = .03 * np.sin(1.4 * np.pi * np.arange(frames) / RATE)
    return markers_of(pose) + sway, sway


def followed_from_a_stray_point(pose, stray, frames=300, stray_frames=60):
    """Follow a swaying hand, with a point at `stray` at first; return which labels are right."""
    markers, sway = swaying(pose, frames)
    random = np.random.default_rng(1)
    labeller, right = CloudLabeller([prototype()]), []
    for number, frame in enumerate(markers):
        points, rows = shuffled(frame, random)
        if number < stray_frames:
            points = np.vstack((points, stray + sway[number]))
        right.append(labeller.update(points, number / RATE).rows[0] == rows)
    return np.array(right)


def markers_of(angles):
    hand = Hand.scaled()
    return marker_positions(MarkerLayout().mounting(hand), forward(joint_table(hand), angles))


@pytest.mark.parametrize('number', (231, 238, 399))
def test_a_thumb_whose_label_a_stray_point_had_from_the_first_frame_gets_it(number):
    poses = natural_poses(Hand.scaled(), 400)
    thumb = MARKERS.index('thumb')
    right = followed_from_a_stray_point(poses[number], markers_of(poses.mean(axis=0))[thumb])
    if right[0, thumb]:
        pytest.skip('the stray point does not have its label at first')
    assert right[-60:].all()


@pytest.mark.parametrize(('number', 'turn'), ((110, .3), (110, .45), (200, -.3), (200, -.45)))
def test_a_wrist_whose_label_a_stray_point_had_from_the_first_frame_gets_it(number, turn):
    pose = natural_poses(Hand.scaled(), 400)[number]
    wrist, index, little = markers_of(pose)[:3]
    # Turned about the line of the knuckles: the palm's sides are the same.
    axis = (little - index) / np.linalg.norm(little - index)
    arm = wrist - index
    stray = index + np.cos(turn) * arm + np.sin(turn) * np.cross(axis, arm) + (
        1. - np.cos(turn)) * (axis @ arm) * axis
    right = followed_from_a_stray_point(pose, stray)
    if right[0, 0]:
        pytest.skip('the stray point does not have its label at first')
    assert right[-60:].all()


@pytest.mark.parametrize('marker', range(3, 8))
def test_a_resting_point_near_a_marker_that_is_hidden_for_long_does_not_get_its_label(marker):
    markers, _ = swaying(natural_poses(Hand.scaled(), 400)[110], 840)
    stray = markers[0, marker] + (-.03, 0., .03)
    markers[120:600, marker] = np.nan
    random, labeller = np.random.default_rng(1), CloudLabeller([prototype()])
    right = []
    for number, frame in enumerate(markers):
        points, rows = shuffled(frame, random)
        right.append(np.array_equal(
            labeller.update(np.vstack((points, stray)), number / RATE).rows[0], rows))
    assert all(right[:600]) and all(right[-60:])


# A thumb may go there as well.
@pytest.mark.parametrize('marker', range(3, 7))
def test_a_resting_point_that_comes_near_a_hidden_marker_does_not_get_its_label_soon(marker):
    markers, _ = swaying(natural_poses(Hand.scaled(), 400)[110], 180)
    stray = markers[0, marker] + (-.03, 0., .03)
    markers[60:, marker] = np.nan
    random, labeller = np.random.default_rng(1), CloudLabeller([prototype()])
    for number, frame in enumerate(markers):
        points, rows = shuffled(frame, random)
        if number >= 66:
            points = np.vstack((points, stray))
        found = labeller.update(points, number / RATE).rows[0]
        assert number >= 66 + .5 * RATE or np.array_equal(found, rows), number


@pytest.mark.parametrize('bent', (21, 24))
def test_a_marker_that_comes_back_far_from_where_it_went_has_its_label_within_a_second(bent):
    poses, index = natural_poses(Hand.scaled(), 400), MARKERS.index('index')
    there = poses[110].copy()
    columns = [JOINTS.index(joint) for joint in JOINTS if joint.startswith('index')]
    there[columns] = poses[bent, columns]
    markers = np.concatenate((swaying(poses[110], 120)[0], swaying(there, 360)[0][120:]))
    assert np.linalg.norm(markers[120, index] - markers[119, index]) > .08
    markers[120:180, index] = np.nan
    random, labeller = np.random.default_rng(1), CloudLabeller([prototype()])
    for number, frame in enumerate(markers):
        points, rows = shuffled(frame, random)
        found = labeller.update(points, number / RATE).rows[0]
        assert 180 <= number < 300 or np.array_equal(found, rows), number


def test_a_wrist_of_another_palm_than_the_usual_one_has_its_label_back_at_once():
    hand = Hand.scaled(.17, .095)
    before, after = natural_poses(hand, 60)[12:14]
    share = np.clip((np.arange(300.)[:, None] - 130.) / 60., 0., 1.)
    markers = marker_positions(MarkerLayout().mounting(hand), forward(
        joint_table(hand), (1. - share) * before + share * after))
    markers[120:200, MARKERS.index('wrist')] = np.nan
    random, labeller = np.random.default_rng(12), CloudLabeller([prototype()])
    for number, frame in enumerate(markers):
        points, rows = shuffled(frame, random)
        found = labeller.update(points, number / RATE).rows[0]
        assert number < 100 or 120 <= number < 200 or np.array_equal(found, rows), number


@pytest.mark.parametrize('hidden', ((), (0,), (1, 5, 6, 7), tuple(range(8))))
def test_a_hand_keeps_its_labels_as_its_prototype_is_replaced(hidden):
    random, labeller = np.random.default_rng(3), CloudLabeller([prototype()])
    for number, frame in enumerate(moving(120)):
        if 60 <= number < 76:
            frame[list(hidden)] = np.nan  # too few to be found, but not to be followed
        if number == 70:
            labeller.replace_prototype(0, model_prototype(
                Hand.scaled(.195, .09), MarkerLayout(), MARKERS, SIZED))
        points, rows = shuffled(frame, random)
        assert np.array_equal(labeller.update(points, number / RATE).rows[0], rows), number


def test_a_prototype_of_other_markers_replaces_none():
    labeller = CloudLabeller([prototype()])
    with pytest.raises(ValueError, match='prototype: of left markers'):
        labeller.replace_prototype(0, prototype('left'))


def test_two_hands_in_one_cloud_keep_their_own_markers():
    random = np.random.default_rng(4)
    labeller = CloudLabeller([prototype(side) for side in SIDES])
    hands = [moving(200, side, at, seed) for seed, (side, at) in enumerate(
        zip(SIDES, ((0., 0., 0.), (.1, .3, 0.))))]
    for number, frame in enumerate(np.concatenate(hands, axis=1)):
        points, rows = shuffled(frame, random, ghosts=2)
        found = labeller.update(points, number / RATE)
    assert found.found == (True, True)
    assert np.array_equal(np.concatenate(found.rows), rows)


def test_a_hand_of_the_other_side_is_named_not_labelled():
    labeller = CloudLabeller([prototype('left')])
    named = 0
    for number, frame in enumerate(moving(120, seed=2)):
        found = labeller.update(frame, number / RATE)
        named += found.other_side[0]
        assert not found.found[0]
    assert named > 60


def counted(monkeypatch, *names):
    """Count the calls of functions of the labeller, by name, in the dictionary returned."""
    calls = dict.fromkeys(names, 0)

    def count(owner, name):
        call = getattr(owner, name)

        def counting(*arguments):
            calls[name] += 1
            return call(*arguments)
        monkeypatch.setattr(owner, name, counting)

    for name in names:
        count(CloudLabeller if hasattr(CloudLabeller, name) else cloud_labeller, name)
    return calls


def test_hands_apart_are_searched_once_each_and_not_in_every_order(monkeypatch):
    calls = counted(monkeypatch, '_search_points')
    labeller, random = CloudLabeller([prototype(side) for side in SIDES]), np.random.default_rng(3)
    hands = [moving(10, side, (0., apart, 0.)) for side, apart in zip(SIDES, (0., .25))]
    for frames in zip(*hands):
        points, rows = shuffled(np.concatenate(frames), random)
        calls['_search_points'] = 0
        assert np.array_equal(np.concatenate(labeller.label_frame(points).rows), rows)
        assert calls['_search_points'] == 2


@pytest.mark.parametrize('rate', [RATE, 8.])
def test_a_frame_has_one_review_at_most_and_none_is_left_out(rate, monkeypatch):
    reviews = '_note_side', '_found_together'
    labeller, random = CloudLabeller([prototype(side) for side in SIDES]), np.random.default_rng(3)
    hands = [moving(360, side, (0., apart, 0.)) for side, apart in zip(SIDES, (0., .25))]
    calls, in_frame = counted(monkeypatch, *reviews), []
    for number, frames in enumerate(zip(*hands)):
        points, _ = shuffled(np.concatenate(frames), random)
        before = sum(calls.values())
        labeller.update(points, number / rate)
        in_frame.append(sum(calls.values()) - before)
        if number == 120:
            begun = dict(calls)
    periods = 239 / rate / SIDE_PERIOD
    if rate == RATE:
        assert max(in_frame[120:]) == 1
    assert calls['_note_side'] - begun['_note_side'] >= 2 * (periods / 2. - 1.)
    assert calls['_found_together'] - begun['_found_together'] >= periods / 2. - 1.


def test_two_hands_one_above_the_other_have_their_own_markers_at_once():
    random = np.random.default_rng(4)
    labeller = CloudLabeller([prototype(side) for side in SIDES])
    right, left = (moving(60, side) for side in SIDES)
    for number, frame in enumerate(np.concatenate((right, left + (0., 0., .08)), axis=1)):
        points, rows = shuffled(frame, random, ghosts=4)
        found = labeller.update(points, number / RATE)
        assert np.array_equal(np.concatenate(found.rows), rows), number


@pytest.mark.parametrize('side', SIDES)
def test_a_hand_of_the_other_side_that_begins_flat_is_given_up_as_it_bends(side):
    hand = Hand.scaled(side=side)
    flat = marker_positions(MarkerLayout().mounting(hand),
                            forward(joint_table(hand), np.zeros((30, len(JOINTS)))))
    labeller = CloudLabeller([prototype(OTHER_SIDE[side])])
    for number, frame in enumerate(np.concatenate((flat, moving(480, side)))):
        found = labeller.update(frame, number / RATE)
        if number > 360:
            assert not found.found[0] and found.other_side[0], number


@pytest.mark.parametrize('seed, side', [(0, 'right'), (1, 'left'), (2, 'right'), (3, 'left')])
def test_a_hand_of_the_other_side_that_comes_after_is_not_taken_for_the_one_that_left(seed, side):
    random, third = np.random.default_rng(seed), 360
    own, other = (moving(2 * third, one, seed=number % 4) for number, one in (
        (seed, side), (seed + 1, OTHER_SIDE[side])))
    frames = np.concatenate((own[:third], other[third + 60:2 * third], own[third:]))
    times = np.delete(np.arange(3 * third), np.s_[third:third + 60]) / RATE
    labeller = CloudLabeller([prototype(side)])
    found = np.array([labeller.update(shuffled(frame, random)[0], time).found[0]
                      for frame, time in zip(frames, times)])
    # One of the four for half a second; they were for 0 to 2.5 s.
    assert found[third:2 * third - 60].sum() <= .6 * RATE
    assert found[2 * third - 60 + round(1.1 * RATE):].all()


def exchange_index_and_thumb(labeller, points, rows, trusted):
    """Exchange two labels of a followed hand, trusted for a time [s] if that is given."""
    index, thumb = (MARKERS.index(name) for name in ('index', 'thumb'))
    hand = labeller._hands[0]
    hand.track.finding.rows[[index, thumb]] = rows[[thumb, index]]
    start_places(hand.statistics, points, hand.track)
    if trusted is not None:
        hand.track.trusted_for[:] = trusted


def check_exchanged_back(frames, start, end, trusted=None):
    """Exchange two labels in a frame, trusted for a time [s]; check that all are right from end."""
    random = np.random.default_rng(3)
    labeller = CloudLabeller([prototype()])
    for number, frame in enumerate(frames):
        points, rows = shuffled(frame, random)
        found = labeller.update(points, number / RATE)
        if not start < number < end:
            assert np.array_equal(found.rows[0], rows), number
        if number == start:
            exchange_index_and_thumb(labeller, points, rows, trusted)


def test_labels_that_others_have_long_been_better_than_are_exchanged():
    check_exchanged_back(moving(600), 100, 400, trusted=.8)


def test_labels_that_were_trusted_for_long_are_exchanged_as_soon_as_others():
    check_exchanged_back(moving(1200, seed=2), 700, 1100)


def time_until_exchanged_back(rate, clock):
    """Exchange two trusted labels of a moving hand; return after how long all are right [s].

    The clock [s] is that of the first frame.
    """
    frames = moving(240)
    times = np.arange(int(1.9 * rate)) / rate
    markers = np.array([np.interp(times, np.arange(240) / RATE, coordinate)
                        for coordinate in frames.reshape(240, -1).T]).T.reshape(-1, 8, 3)
    random, labeller = np.random.default_rng(1), CloudLabeller([prototype()])
    start = int(rate)
    for number, frame in enumerate(markers):
        points, rows = shuffled(frame, random)
        found = labeller.update(points, clock + times[number])
        if number == start:
            exchange_index_and_thumb(labeller, points, rows, trusted=.8)
        elif number > start and np.array_equal(found.rows[0], rows):
            return times[number] - times[start]
    return np.inf


@pytest.mark.parametrize('rate', (30., 50., 60., 90., 480.))
def test_labels_are_exchanged_after_the_same_time_at_any_rate(rate):
    usual = time_until_exchanged_back(RATE, 0.)
    for clock in (0., 1.7e9 + .003):
        assert abs(time_until_exchanged_back(rate, clock) - usual) < .03


def test_a_hand_that_is_lost_is_found_again():
    labeller = CloudLabeller([prototype()])
    frames = moving(300, seed=2)
    for number in range(100):
        labeller.update(frames[number], number / RATE)
    for number in range(100, 150):
        found = labeller.update(np.empty((0, 3)), number / RATE)
        assert (found.rows[0] < 0).all()
    assert not found.found[0]
    for number in range(150, 180):
        found = labeller.update(frames[number], number / RATE)
    assert np.array_equal(found.rows[0], np.arange(8))


def test_rows_are_those_of_all_points_where_some_are_not_finite():
    labeller = CloudLabeller([prototype()])
    points = np.insert(moving(1)[0], 3, np.nan, axis=0)
    assert labeller.update(points).rows[0].tolist() == [0, 1, 2, 4, 5, 6, 7, 8]


def test_clouds_without_a_hand_are_none():
    random = np.random.default_rng(5)
    labeller = CloudLabeller([prototype()])
    for number, count in enumerate((0, 1, 2, 3, 40, 80, 5)):
        found = labeller.update(random.uniform(-5., 5., (count, 3)), number / RATE)
        assert (found.rows[0] == -1).all() or found.found[0]
    with pytest.raises(ValueError, match=r'points: shape \(4, 2\); expected \(n, 3\)'):
        labeller.update(np.zeros((4, 2)))
    with pytest.raises(ValueError, match=r'ids: shape \(3,\); expected \(4,\)'):
        labeller.update(np.zeros((4, 3)), ids=np.zeros(3))


def test_a_learned_hand_needs_frames_and_a_triangle_of_palm_markers():
    frames, digits = moving(60), marker_digits(MarkerLayout().mounting(Hand.scaled()).link)
    assert digits == [-1, -1, -1, 0, 1, 2, 3, 4]
    learned = learn_prototype(MARKERS, frames, digits, 'right')
    assert CloudLabeller([learned]).label_frame(frames[7]).rows[0].tolist() == list(range(8))
    with pytest.raises(HandTrackerError, match='5 frames with all of the 8 markers; at least 20'):
        learn_prototype(MARKERS, frames[:5], digits, 'right')
    with pytest.raises(HandTrackerError, match='2 markers on the palm; at least three'):
        learn_prototype(MARKERS, frames, [0, *digits[1:]], 'right')
    with pytest.raises(HandTrackerError, match='lie on one line'):
        learn_prototype(MARKERS, frames[:, [0, 0, 0, 3, 4, 5, 6, 7]], digits, 'right')


def test_the_thumb_that_touches_each_finger_and_vanishes_for_moments_keeps_its_label():
    recording = demo_recording()
    random = np.random.default_rng(0)
    labeller = CloudLabeller([prototype()])
    for stamp, markers in zip(recording.stamps, recording.markers):
        points, rows = shuffled(markers, random)
        np.testing.assert_array_equal(labeller.update(points, 1e-9 * stamp).rows[0], rows)


@pytest.mark.parametrize('layout', ('paper8', 'optitrack_hand', 'sig18_19', 'kyutech23'))
def test_hands_that_change_places_in_a_cut_do_not_keep_each_others_markers(layout):
    if not COMPILED and layout != 'paper8':
        pytest.skip('takes minutes in plain Python')
    layout = preset_layout(layout)
    hands = [Hand.scaled(side=side) for side in SIDES]
    labeller = CloudLabeller([
        model_prototype(hand, layout, tuple(layout.names), SIZED) for hand in hands])
    angles = natural_poses(hands[0], 400)[100:104]
    poses = np.array([np.interp(np.arange(240) / 80., range(4), joint) for joint in angles.T]).T
    right, left = (marker_positions(layout.mounting(hand), forward(joint_table(hand), poses))
                   for hand in hands)
    random = np.random.default_rng(1)
    for number in range(240):
        at = (0., .3, 0.) if number < 120 else (0., 0., 0.)
        frame = np.concatenate((right[number] + at, left[number] + (.3 - at[1]) * np.eye(3)[1]))
        points, rows = shuffled(frame, random)
        found = labeller.update(points, number / RATE)
        if 60 <= number < 120 or number >= 160:
            for own, true in zip(found.rows, np.split(rows, 2)):
                assert {*own.tolist()} == {*true.tolist()}, number
