"""Postures of the wearer that a labeller learns: the mixture, and what it is good for."""

import numpy as np
import pytest

from hand_tracker.core.model.hand import SIDES, Hand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.marker_layout import MARKERS, MarkerLayout, marker_positions
from hand_tracker.core.point_labelling.cloud_labeller import CloudLabeller
from hand_tracker.core.point_labelling.hand_track import begin_track
from hand_tracker.core.point_labelling.natural_poses import (
    FITTED,
    marker_digits,
    model_prototype,
    natural_poses,
)
from hand_tracker.core.point_labelling.palm_search import blank_finding
from hand_tracker.core.point_labelling.posture import hidden_places, reset_matrix
from hand_tracker.core.point_labelling.prototypes import learn_prototype
from hand_tracker.core.point_labelling.wearer_postures import (
    FIRST_POSTURES,
    LABELLED_TIME,
    POSTURE_PERIOD,
    REMEMBERED_POSTURES,
    UNRIVALLED_TIME,
    WEARER_SHARE,
    WearerPostures,
)

RATE = 120.
GRASPED_POSES = 40, 90  # two natural poses between which the wearer goes
HIDDEN = MARKERS.index('middle')


def prototype(side='right'):
    return model_prototype(Hand.scaled(side=side), MarkerLayout(), MARKERS, FITTED)


def grasping(frames, side='right'):
    """Return the markers of a wearer that grasps every two seconds, (T, 8, 3) [m]."""
    hand = Hand.scaled(side=side)
    first, second = natural_poses(hand, max(GRASPED_POSES) + 1)[list(GRASPED_POSES)]
    share = .5 - .5 * np.cos(np.pi * np.arange(frames) / RATE)
    return marker_positions(MarkerLayout().mounting(hand), forward(
        joint_table(hand), first + share[:, None] * (second - first)))


def postures_of(count):
    """Return the markers of a hand in natural poses, each far from the last, (count, 8, 3) [m]."""
    hand = Hand.scaled()
    return marker_positions(MarkerLayout().mounting(hand), forward(
        joint_table(hand), natural_poses(hand, count)))


def track_of(prototype, markers, hidden=()):
    """Return the track of a hand found by markers (8, 3) [m] of which some are hidden."""
    found = blank_finding(len(markers))
    found.rows[:] = np.arange(len(markers))
    found.rows[list(hidden)] = -1
    found.rotation[:], found.position[:], found.size[0] = np.eye(3), 0., 1.
    found.cost[0] = found.distance[0] = 0.
    track = begin_track(prototype.statistics, found, markers)
    track.seen_for[:], track.trusted_for[:] = LABELLED_TIME, UNRIVALLED_TIME
    return track


def with_learned(natural, frames):
    """Return a prototype with the postures of frames learned: markers, and which are hidden."""
    postures, present = WearerPostures(natural), natural
    for markers, hidden in frames:
        mixed = postures.add(track_of(natural, markers, hidden), present, POSTURE_PERIOD)
        present = mixed or present
    return present


def local(prototype, markers):
    """Return frames (T, 8, 3) placed by their palm as the template is [m]."""
    palm = prototype.statistics.rigid > 0.
    return markers + (prototype.statistics.template - markers)[:, palm].mean(axis=1)[:, None]


def place_error(prototype, frames):
    """Return how far the middle finger is from its conditional mean in frames, on average [m]."""
    errors = []
    for frame in frames:
        rows = np.arange(len(MARKERS))
        rows[HIDDEN] = -1
        matrix, places = np.empty((frame.size,) * 2), np.empty(frame.shape)
        reset_matrix(prototype.statistics, rows, matrix)
        hidden_places(prototype.statistics, frame, rows, matrix, places)
        errors.append(np.linalg.norm(places[HIDDEN] - frame[HIDDEN]))
    return np.mean(errors)


def test_mixed_postures_are_those_of_frames_mixed():
    hand, layout = Hand.scaled(), MarkerLayout()
    mounting = layout.mounting(hand)
    poses = natural_poses(hand)
    frames = marker_positions(mounting, forward(joint_table(hand), poses))
    digits = marker_digits(mounting.link)
    bent = poses[:, 2] > np.median(poses[:, 2])
    one, other, both = (learn_prototype(MARKERS, frames[kept], digits, 'right')
                        for kept in (bent, ~bent, np.ones_like(bent)))
    # Palms of a model are alike in all frames: they are aligned alike.
    off = (frames[~bent] - frames[~bent].mean(axis=0)).reshape(sum(~bent), -1)
    mixed = one.mixed_with(other.statistics.template.ravel(), off.T @ off / len(off), .5)
    for name in ('template', 'precision', 'marginal', 'constant', 'marginal_constant'):
        value, expected = (getattr(each.statistics, name) for each in (mixed, both))
        assert np.allclose(value, expected, rtol=2e-3, atol=1e-4 * np.abs(expected).max()), name


@pytest.mark.parametrize('hidden', ((), (MARKERS.index('ring'), MARKERS.index('thumb'))))
def test_hidden_markers_are_better_placed_by_the_postures_of_the_wearer(hidden):
    natural = prototype()
    frames = local(natural, grasping(960))
    present = with_learned(natural, ((frame, hidden) for frame in frames[::6]))
    assert present is not natural
    assert place_error(present, frames) < .8 * place_error(natural, frames)


def test_a_marker_that_is_never_seen_stays_as_uncertain_as_it_was():
    natural = prototype()
    frames = local(natural, postures_of(1500))
    present = with_learned(natural, ((frame, (HIDDEN,)) for frame in frames))
    before, after = (np.linalg.inv(one.statistics.precision[3 * HIDDEN:, 3 * HIDDEN:][:3, :3])
                     for one in (natural, present))
    assert .9 < np.trace(after) / np.trace(before) < 1.02


def test_random_occlusions_leave_a_covariance():
    natural, random = prototype(), np.random.default_rng(1)
    frames, digits = local(natural, grasping(240)), np.flatnonzero(natural.statistics.rigid == 0.)
    present = with_learned(natural, (
        (frames[number % 240], random.permutation(digits)[:random.integers(4)])
        for number in range(2 * REMEMBERED_POSTURES)))
    precision = present.statistics.precision
    assert np.allclose(precision, precision.T, rtol=1e-9)
    assert np.linalg.eigvalsh(precision).min() > 0.


def test_the_template_goes_towards_the_mean_posture_by_the_share_of_the_wearer():
    natural = prototype()
    postures = WearerPostures(natural)
    frames = local(natural, postures_of(FIRST_POSTURES))
    mixed = [postures.add(track_of(natural, frame), natural, POSTURE_PERIOD) for frame in frames]
    assert mixed[:-1] == [None] * (FIRST_POSTURES - 1)
    template = natural.statistics.template
    assert np.allclose(mixed[-1].statistics.template, (1. - WEARER_SHARE) * template
                       + WEARER_SHARE * frames.mean(axis=0), atol=1e-12)


def hide_wrist(track):
    track.finding.rows[MARKERS.index('wrist')] = -1


@pytest.mark.parametrize('spoil', (
    hide_wrist,
    lambda track: track.doubt.__setitem__(0, 1.),
    lambda track: track.shaken_for.__setitem__(0, .05),
    lambda track: track.finding.distance.__setitem__(0, 100.),
    lambda track: track.finding.distance.__setitem__(0, np.nan),
    lambda track: track.finding.rows.__setitem__(slice(4, 8), -1),
    lambda track: track.returns.age.__setitem__(slice(4, 8), .1),
    lambda track: track.seen_for.__setitem__(slice(4, 8), .5 * LABELLED_TIME),
    lambda track: track.trusted_for.__setitem__(slice(4, 8), 0.)))
def test_doubtful_labels_teach_nothing(spoil):
    natural = prototype()
    postures = WearerPostures(natural)
    for frame in local(natural, grasping(240))[::6]:
        track = track_of(natural, frame)
        spoil(track)
        assert postures.add(track, natural, POSTURE_PERIOD) is None
    assert any(postures.add(track_of(natural, frame), natural, POSTURE_PERIOD)
               for frame in local(natural, grasping(240))[::6])


def test_a_hidden_marker_stays_where_it_is_as_postures_are_mixed_in():
    labeller = CloudLabeller([prototype()])
    mixed = 0
    for number, frame in enumerate(grasping(1200)):
        if number >= 300:
            frame = frame.copy()
            frame[HIDDEN] = np.nan
        before = labeller._hands[0].prototype
        labeller.update(frame, number / RATE)
        hand = labeller._hands[0]
        if hand.prototype is not before and hand.track.hidden_for[HIDDEN] > 0.:
            mixed += 1
            place = hand.track.local[HIDDEN].copy()
            labeller.update(frame, number / RATE + 1e-3)    # the hand rests
            assert np.linalg.norm(hand.track.local[HIDDEN] - place) < 1e-3
    assert mixed


def test_a_doubtful_marker_does_not_teach_its_place():
    natural = prototype()
    mixed = []
    for far in (0., .5):
        postures = WearerPostures(natural)
        for frame in local(natural, grasping(240))[::6]:
            track = track_of(natural, frame + far * (np.arange(8) == HIDDEN)[:, None])
            track.returns.age[HIDDEN] = .1
            mixed.append(postures.add(track, natural, POSTURE_PERIOD))
    one, other = (each.statistics for each in mixed if each is not None)
    assert np.array_equal(one.template, other.template)
    assert np.array_equal(one.precision, other.precision)


@pytest.mark.parametrize(('frames', 'step'), (
    (postures_of(80), .4 * POSTURE_PERIOD), (postures_of(1).repeat(80, axis=0), 1.)))
def test_frames_at_once_and_a_hand_at_rest_are_one_posture(frames, step):
    natural = prototype()
    postures = WearerPostures(natural)
    mixed = [postures.add(track_of(natural, frame), natural, step) is not None
             for frame in local(natural, frames)]
    if step < 1.:   # each third frame is a posture
        assert mixed.index(True) + 1 == 3 * FIRST_POSTURES
    else:           # it is one for ever
        assert not any(mixed)


def test_a_labeller_learns_while_it_follows_and_forgets_as_it_is_reset():
    labeller = CloudLabeller([prototype()])
    first = labeller.prototypes[0]
    for number, frame in enumerate(grasping(960)):
        labeller.update(frame, number / RATE)
    learned, frames = labeller._hands[0].prototype, local(first, grasping(960))
    assert place_error(learned, frames) < .8 * place_error(first, frames)
    assert labeller.prototypes == (first,)
    labeller.update(np.empty((0, 3)), 100.)     # the hand is lost, and found
    labeller.update(frames[0], 100.1)
    assert labeller._hands[0].prototype is learned
    labeller.update(frames[0], 0.)              # a recording begins anew
    assert labeller._hands[0].prototype is first
    labeller.reset()
    for number, frame in enumerate(grasping(960)):
        labeller.update(frame, number / RATE)
    again = labeller._hands[0].prototype
    assert np.array_equal(again.statistics.precision, learned.statistics.precision)
    other = model_prototype(Hand.scaled(.17, .08), MarkerLayout(), MARKERS, FITTED)
    labeller.replace_prototype(0, other)
    assert labeller._hands[0].prototype is other


def test_mirrored_hands_learn_mirrored_postures_to_the_bit():
    learned = []
    for side in SIDES:
        labeller = CloudLabeller([prototype(side)])
        for number, frame in enumerate(grasping(480, side)):
            labeller.update(frame, number / RATE)
        learned.append(labeller._hands[0].prototype)
    right, left = (one.statistics for one in (learned[0], learned[1].mirrored()))
    for name in right._fields:
        assert np.array_equal(getattr(right, name), getattr(left, name)), name
