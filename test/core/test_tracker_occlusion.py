"""The tracker while markers are hidden, wrong or noisy."""

import copy
from dataclasses import replace

import numpy as np
import pytest
from helpers.hands import markers_of
from scipy.spatial.transform import Rotation

from hand_tracker.core.model.capsules import hand_capsules, pair_gaps
from hand_tracker.core.model.hand import FINGERS, FLEXION_JOINTS, JOINTS, Hand
from hand_tracker.core.model.layout_presets import preset_layout
from hand_tracker.core.model.marker_layout import (
    MARKERS,
    PALM_LANDMARKS,
    PAPER_PLACES,
    MarkerLayout,
)
from hand_tracker.core.model.states import MarkerState, PalmState
from hand_tracker.core.options import TrackerOptions
from hand_tracker.core.pose.deviation import unknown_deviation
from hand_tracker.core.tracker import HandTracker
from hand_tracker.simulation.motions import motion_named
from hand_tracker.simulation.packaged_recordings import demo_recording

RATE = 120.
STEP = 1. / RATE
HAND = Hand.scaled()
MIRROR = np.array((1., -1., 1.))
EXACT = TrackerOptions(smoothing=False, rigidity=False)
TIPS = (*PAPER_PLACES[:3], *(f'{finger}_tip' for finger in FINGERS), 'thumb_tip')
INDEX, MIDDLE, RING = (MARKERS.index(name) for name in ('index', 'middle', 'ring'))


def grasp(frame, hand=HAND):
    """Return the angles of a hand that opens and closes, its fingers one after the other."""
    angles = np.zeros(25)
    for digit in range(5):
        bend = .5 - .35 * np.cos(2. * np.pi * .7 * frame * STEP - .25 * digit)
        first, second, third = FLEXION_JOINTS[digit]
        angles[first], angles[second] = 1.1 * bend, 1.3 * bend
        angles[third] = hand.coupling[digit] @ (angles[second], 1.)
    return np.clip(angles, *hand.limits.T)


def markers_at(frame, hand=HAND, angles=None):
    """Return the markers of the hand that opens and closes while it is waved about."""
    rotation = Rotation.from_rotvec(.3 * np.sin(.02 * frame * np.array((1., .7, .4)))).as_matrix()
    position = np.array((.1, .2, .05)) * np.sin(.015 * frame)
    angles = grasp(frame, hand) if angles is None else angles
    return markers_of(hand, angles, None, rotation, position)


def track(frames, change, options=None, hand=HAND, noise=0., seed=1):
    """Return the states of frames of which `change` alters the markers."""
    tracker = HandTracker(hand, options=options)
    rng = np.random.default_rng(seed)
    states = []
    for frame in range(frames):
        markers = markers_at(frame, hand) + rng.normal(scale=noise, size=(8, 3))
        change(frame, markers)
        states.append(tracker.update(markers, frame * STEP))
    return states


def hide(rows, start, end):
    """Return a change that hides rows in some frames."""
    def change(frame, markers):
        if start <= frame < end:
            markers[list(rows)] = np.nan
    return change


def nothing(frame, markers):
    """Change nothing."""


def truth(frames, hand=HAND):
    return np.array([grasp(frame, hand) for frame in range(frames)])


@pytest.mark.parametrize('rows', [(INDEX,), (MIDDLE, RING), (0,), (1, 2), (0, 1, 2),
                                  (7, RING), tuple(range(8))])
@pytest.mark.parametrize('duration', [.05, .25, 1., 3.])
def test_no_angle_jumps_where_markers_vanish_or_come_back(rows, duration):
    options = replace(EXACT, friction=0.)
    start, frames = 300, 300 + round(duration * RATE)
    states = track(frames + 60, hide(rows, start, frames), options)
    steps = abs(np.diff([state.angles for state in states], axis=0))
    fastest = abs(np.diff(truth(frames + 60), axis=0)).max()
    bound = max(1.5 * fastest, options.reentry_rate * STEP) + 1e-9
    assert steps[start - 2:frames - 1].max() <= bound, 'while they are hidden'
    assert steps[frames - 2:].max() <= bound, 'as they come back'
    np.testing.assert_allclose(states[-1].angles, grasp(frames + 59), atol=np.radians(1.))


@pytest.mark.parametrize('motion', ['spelling', 'power_grasp'])
def test_no_angle_jumps_in_any_frame_of_an_occlusion(motion):
    motion = motion_named(motion, HAND, 3, 10.)
    angles, rotation, position = motion.sample(np.arange(600) * STEP)
    markers = markers_of(HAND, angles, None, rotation, position)
    fastest = abs(np.diff(angles, axis=0)).max()
    tracker = HandTracker(HAND, options=EXACT)
    last = None
    for frame in range(540):
        if frame in (321, 435, 500):
            for row in range(8):
                hidden = copy.deepcopy(tracker)
                path = [last]
                for seen, at in zip(markers[frame:frame + 45], range(45)):
                    seen = seen.copy()
                    hide((row,), 0, 30)(at, seen)
                    path.append(hidden.update(seen, (frame + at) * STEP).angles)
                steps = abs(np.diff(path, axis=0)).max()
                assert steps <= 1.5 * fastest, f'{MARKERS[row]} hidden at {frame}'
        last = tracker.update(markers[frame], frame * STEP).angles


@pytest.mark.parametrize('rows', [(INDEX,), (MIDDLE, RING), (1,), (2,)])
def test_a_hidden_marker_is_predicted_near_where_it_is(rows):
    states = track(318, hide(rows, 300, 318), noise=2e-4)
    misses = np.array([np.linalg.norm(state.markers - markers_at(300 + i), axis=1)[list(rows)]
                       for i, state in enumerate(states[300:])])
    moved = np.linalg.norm(markers_at(317) - markers_at(299), axis=1)[list(rows)]
    assert misses.max() < .012 and (misses[-1] < .5 * moved).all()


@pytest.mark.parametrize('rows', [(0,), (1,), (2,), (0, 1), (1, 2)])
@pytest.mark.parametrize('palm_method', ['rigid', 'spheres'])
@pytest.mark.parametrize('hand', [HAND, HAND.mirrored()])
def test_a_palm_whose_skin_slides_stays_where_it_is_when_markers_vanish(hand, palm_method, rows):
    """It does not go back to the shape that it was calibrated with, nor creep."""
    tracker = HandTracker(hand, options=TrackerOptions(palm_method=palm_method))
    markers = markers_of(hand, np.clip(.3 * np.ones(25), *hand.limits.T))
    markers[:3] += .004 * np.array(((1., .5, .2), (-.3, .8, -.5), (.4, -1., .6)))
    for frame in range(120):
        before = tracker.update(markers, frame * STEP)
    hidden = markers.copy()
    hidden[list(rows)] = np.nan
    states = [tracker.update(hidden, frame * STEP) for frame in range(120, 1320)]
    np.testing.assert_allclose([state.markers[:3] for state in states],
                               np.broadcast_to(markers[:3], (1200, 3, 3)), atol=2e-4)
    np.testing.assert_allclose([state.wrist_position for state in states],
                               np.broadcast_to(before.wrist_position, (1200, 3)), atol=2e-4)


def turn_errors(hand, layout, hidden, frames=480, start=360):
    """Return how far the palm of a waved, grasping hand is turned off, markers hidden at last."""
    tracker, errors = HandTracker(hand, layout), []
    for frame in range(frames):
        rotation = Rotation.from_rotvec(.3 * np.sin(.02 * frame * np.array((1., .7, .4))))
        markers = markers_of(hand, grasp(frame, hand), layout, rotation.as_matrix(),
                             np.array((.1, .2, .05)) * np.sin(.015 * frame))
        if frame >= start:
            markers[list(hidden)] = np.nan
        state = tracker.update(markers, frame * STEP)
        errors.append((Rotation.from_matrix(state.wrist_rotation).inv() * rotation).magnitude())
    return np.degrees(errors[start:])


@pytest.mark.parametrize('row', [0, 1, 2])
@pytest.mark.parametrize('hand', [HAND, HAND.mirrored()])
def test_digits_that_bend_as_before_do_not_turn_a_palm_of_two_seen_markers(hand, row):
    assert turn_errors(hand, MarkerLayout(), (row,)).max() < 12.5


@pytest.mark.parametrize('name, seen', [
    ('optitrack_hand', ('WristOut', 'WristIn')), ('optitrack_hand', ('WristIn', 'HandIn')),
    ('optitrack_hand', ('HandOut', 'HandIn')), ('kyutech23', ('2', '21')),
    ('kyutech23', ('21', '23')), ('sig18_19', ('BackHand1', 'BackHand2'))])
def test_a_larger_palm_turns_about_the_line_of_the_two_that_are_seen(name, seen):
    layout = preset_layout(name)
    hidden = [row for row, place in enumerate(layout.places)
              if place in PALM_LANDMARKS and layout.names[row] not in seen]
    assert turn_errors(HAND, layout, hidden).max() < 9.


@pytest.mark.parametrize('one, other', [(3, 4), (4, 6), (3, 7), (1, 2), (0, 5)])
def test_swapped_labels_are_put_right_within_three_frames_and_reported(one, other):
    def swap(frame, markers):
        if 200 <= frame < 230:
            markers[[one, other]] = markers[[other, one]]
    swapped, plain = track(260, swap), track(260, nothing)
    states = np.array([state.marker_states for state in swapped])
    told = states[:, [one, other]] == MarkerState.SWAPPED
    assert told[202:230].all()
    assert (states[:200] == MarkerState.SEEN).all() and (states[233:] == MarkerState.SEEN).all()
    for frame in range(203, 230):
        np.testing.assert_allclose(swapped[frame].markers, plain[frame].markers, atol=2e-3)


def exchange(pair, start, end):
    """Return a change that exchanges two labels in some frames."""
    def change(frame, markers):
        if start <= frame < end:
            markers[list(pair)] = markers[list(pair[::-1])]
    return change


def assert_right(states, start, reported=()):
    """Check that markers are where they are from a frame on, and which are reported."""
    for frame in range(start, len(states)):
        np.testing.assert_allclose(states[frame].markers, markers_at(frame), atol=2e-3)
        swapped = np.flatnonzero(states[frame].marker_states == MarkerState.SWAPPED)
        assert swapped.tolist() == list(reported)


@pytest.mark.parametrize('pair', [(1, 2), (0, 1), (0, 2), (2, 7), (3, 6)])
def test_labels_that_are_exchanged_from_the_first_frame_on_are_put_right(pair):
    assert_right(track(120, exchange(pair, 0, 120), EXACT), 0, pair)
    # And are believed when the source mends.
    assert_right(track(200, exchange(pair, 0, 60), EXACT), 60)


@pytest.mark.parametrize('pair', [(3, 4), (3, 7), (4, 7), (6, 7)])
def test_labels_that_begin_exchanged_are_not_held_when_the_source_mends(pair):
    assert_right(track(320, exchange(pair, 0, 60), EXACT), 200)


@pytest.mark.parametrize('pair', [(3, 4), (3, 7), (4, 7), (5, 7), (6, 7)])
def test_labels_that_come_back_exchanged_are_not_held_when_the_source_mends(pair):
    def change(frame, markers):
        hide(pair, 100, 340)(frame, markers)
        exchange(pair, 340, 370)(frame, markers)
    assert_right(track(600, change, EXACT), 510)


@pytest.mark.parametrize('motion, start, digit', [('spelling', 336, 3), ('demo', 336, 3)])
def test_labels_that_stay_exchanged_are_not_given_in_to(motion, start, digit):
    frames = np.arange(start + 300)
    angles, rotation, position = motion_named(motion, HAND, 3, 8.).sample(frames * STEP)
    true = markers_of(HAND, angles, None, rotation, position)
    tracker, change = HandTracker(), exchange((digit, 7), start, len(frames))
    for frame, markers in enumerate(true + np.random.default_rng(3).normal(
            scale=3e-4, size=true.shape)):
        change(frame, markers)
        state = tracker.update(markers, frame * STEP)
        if frame >= start + 3:
            assert np.linalg.norm(state.markers - true[frame], axis=1).max() < .012


def test_a_palm_that_is_exchanged_before_digits_are_seen_is_put_right_with_them():
    def change(frame, markers):
        exchange((1, 2), 0, 400)(frame, markers)
        hide(range(3, 8), 0, 60)(frame, markers)
    assert_right(track(240, change, EXACT), 160, (1, 2))


@pytest.mark.parametrize('row', range(8))
def test_an_outlier_is_rejected_and_predicted(row):
    def stray(frame, markers):
        if 200 <= frame < 210:
            # Another place each time: not where the marker could be after all.
            markers[row] += .1 * np.random.default_rng(frame).choice((-1., 1.), 3)
    states = track(240, stray)
    plain = track(240, nothing)
    found = np.array([state.marker_states for state in states])
    assert (found[200:210, row] == MarkerState.REJECTED).all()
    assert (np.delete(found, row, axis=1) == MarkerState.SEEN).all()
    for frame in range(200, 240):
        assert np.linalg.norm(states[frame].markers - plain[frame].markers, axis=1).max() < .01
    assert (found[212:] == MarkerState.SEEN).all()


@pytest.mark.parametrize('row', range(3))
def test_a_palm_marker_that_repeats_is_not_believed_for_long(row):
    def repeat(frame, markers):
        if frame >= 240:
            markers[row] = stuck[row]

    stuck = markers_at(240)
    states = track(480, repeat, noise=3e-4)
    believed = [state.marker_states[row] == MarkerState.SEEN for state in states[240:]]
    assert not any(believed[30:])


def test_a_hand_that_is_elsewhere_at_once_is_followed_at_once():
    def teleport(frame, markers):
        if frame >= 200:
            markers += (1., -2., .5)
    states = track(230, teleport, EXACT)
    for frame in range(200, 230):
        np.testing.assert_allclose(states[frame].angles, grasp(frame), atol=1e-6)
        assert states[frame].palm == PalmState.TRACKED
    # And a palm marker that then vanishes is not flung after the leap.
    states = track(230, lambda frame, markers: (
        teleport(frame, markers), hide((2,), 202, 230)(frame, markers)), EXACT)
    assert np.linalg.norm(states[-1].wrist_position - markers_at(229)[0] - (1., -2., .5)) < .02


def test_time_that_jumps_back_begins_anew():
    tracker, fresh = HandTracker(), HandTracker()
    rng = np.random.default_rng(1)
    for frame in range(300):
        markers = markers_at(frame) + rng.normal(scale=3e-4, size=(8, 3))
        hide((4, 1), 250, 300)(frame, markers)
        tracker.update(markers, 100. + frame * STEP)
    tracker.update(markers_at(0), 1.)
    for frame in range(1, 60):
        markers = markers_at(frame) + rng.normal(scale=3e-4, size=(8, 3))
        hide((3,), 30, 50)(frame, markers)
        again = tracker.update(markers, 1. + frame * STEP)
        assert tracker.restarted == (frame == 1)
        first = fresh.update(markers, 1. + frame * STEP)
        for name in ('angles', 'markers', 'marker_states', 'hidden_for', 'deviation',
                     'wrist_position', 'wrist_rotation'):
            np.testing.assert_array_equal(getattr(again, name), getattr(first, name), name)


@pytest.mark.parametrize('stray', [0., 1e9, None])
def test_a_stray_stamp_changes_nothing(stray):
    even, disturbed = HandTracker(), HandTracker()
    rng = np.random.default_rng(1)
    for frame in range(500):
        markers = markers_at(frame) + rng.normal(scale=3e-4, size=(8, 3))
        hide((MIDDLE, 0), 450, 480)(frame, markers)
        time = 100. + frame * STEP
        expected = even.update(markers, time)
        found = disturbed.update(markers, stray if frame in (200, 400, 460) else time)
        assert not disturbed.restarted
        np.testing.assert_allclose(found.angles, expected.angles, atol=1e-4)
        np.testing.assert_array_equal(found.marker_states, expected.marker_states)
    for name in ('weight', 'first', 'second', 'motion'):
        np.testing.assert_allclose(
            *(getattr(tracker._state.transdigital.statistics, name)
              for tracker in (disturbed, even)), rtol=1e-3, atol=1e-6)
    np.testing.assert_allclose(disturbed._state.noise.deviation, even._state.noise.deviation,
                               rtol=1e-3)


def test_it_is_forgotten_as_fast_at_any_rate_that_a_marker_was_not_seen():
    unseen = []
    for rate in (60, 240):
        tracker = HandTracker()
        for frame in range(2 * rate):
            markers = markers_at(120)
            markers[MIDDLE] = np.nan if rate <= frame < 1.9 * rate else markers[MIDDLE]
            tracker.update(markers, frame / rate)
        unseen.append(tracker._state.association.unseen_for[MIDDLE])
    assert 0. < unseen[0] < .01 and unseen[0] == pytest.approx(unseen[1], rel=.05)


def test_after_a_pause_hidden_markers_are_where_they_were():
    tracker = HandTracker(options=EXACT)
    for frame in range(200):
        last = tracker.update(markers_at(frame), frame * STEP)
    markers = markers_at(199)
    markers[INDEX] = np.nan
    for frame in range(2):
        state = tracker.update(markers, (199 + frame) * STEP + 1.5)
    assert state.hidden_for[INDEX] > 1.5
    np.testing.assert_allclose(state.angles, last.angles, atol=np.radians(2.))


def test_measured_distal_flexion_replaces_the_coupling_within_limits():
    tracker = HandTracker(options=EXACT)
    dip = FLEXION_JOINTS[:, 2]
    markers = markers_at(60)
    coupled = tracker.update(markers).angles
    for _ in range(120):
        state = tracker.update(markers, None, (np.nan, .3, 5., -5., np.inf))
    np.testing.assert_allclose(state.angles[dip[[0, 4]]], coupled[dip[[0, 4]]], atol=1e-9)
    assert state.angles[dip[1]] == .3
    assert state.angles[dip[2]] == HAND.limits[dip[2], 1]
    assert state.angles[dip[3]] == HAND.limits[dip[3], 0]
    for _ in range(120):
        state = tracker.update(markers)
    np.testing.assert_allclose(state.angles, coupled, atol=1e-9)


@pytest.mark.parametrize('places', [PAPER_PLACES, TIPS])
def test_no_angle_jumps_where_a_measured_flexion_comes_or_is_missed(places):
    layout, options = MarkerLayout(places=places), replace(EXACT, reentry_rate=3.)
    markers = markers_of(HAND, grasp(60), layout)
    tracker = HandTracker(HAND, layout, options)
    measured = np.array((1.2, np.nan, .9, np.nan, .8))
    path = [tracker.update(markers).angles]
    for frame in range(200):
        path.append(tracker.update(
            markers, None, measured if 50 <= frame < 120 else None).angles)
    steps = abs(np.diff(path, axis=0))
    assert steps.max() <= 3. * STEP + 1e-9
    # It is measured in the end, and coupled again.
    last = FLEXION_JOINTS[[0, 2, 4], 2]
    np.testing.assert_allclose(path[120][last], measured[[0, 2, 4]], atol=1e-9)
    np.testing.assert_allclose(path[-1], path[0], atol=1e-9)


def test_deviations_grow_while_a_marker_is_hidden_and_are_back_with_it():
    row, joints = INDEX, [JOINTS.index('index_mcp_flexion'), JOINTS.index('index_pip_flexion')]
    states = track(700, hide((row,), 300, 660), noise=2e-4)
    seen = track(700, lambda *_: None, noise=2e-4)
    deviation, own = (np.array([state.deviation for state in some]) for some in (states, seen))
    ratio = deviation[:, joints] / own[:, joints]
    unknown = unknown_deviation(HAND.limits)[joints]
    assert abs(ratio[:300] - 1.).max() < 1e-9 and abs(ratio[670:] - 1.).max() < .1
    assert (ratio[310] > 1.2).all() and (deviation[310, joints] < .8 * unknown).all()
    np.testing.assert_allclose(deviation[659, joints], unknown, rtol=.01)
    others = [i for i in range(25)
              if i not in FLEXION_JOINTS[0] and not JOINTS[i].startswith('index')]
    np.testing.assert_allclose(deviation[:, others], own[:, others], atol=1e-3)
    hidden_for = np.array([state.hidden_for[row] for state in states])
    np.testing.assert_allclose(hidden_for[300:660], STEP * np.arange(1, 361), atol=1e-9)
    assert (hidden_for[1:300] == 0.).all() and (hidden_for[660:] == 0.).all()
    found = np.array([state.marker_states[row] for state in states])
    stale = 300 + round(2. * RATE)
    assert (found[300:stale - 1] == MarkerState.PREDICTED).all()
    assert (found[stale + 1:660] == MarkerState.STALE).all()


def test_deviation_tells_of_an_angle_that_still_goes_back_to_its_marker():
    def bent(frame):
        # It closes while nobody sees it.
        angles = np.zeros(25)
        angles[FLEXION_JOINTS[:, 1]] = .3
        angles[FLEXION_JOINTS[0, 1]] += 1. if frame >= 210 else 0.
        angles[FLEXION_JOINTS[:, 2]] = HAND.coupling[:, 0] * angles[FLEXION_JOINTS[:, 1]]
        return angles
    tracker, pip = HandTracker(options=EXACT), FLEXION_JOINTS[0, 1]
    for frame in range(260):
        markers = markers_at(frame, angles=bent(frame))
        hide((INDEX,), 200, 220)(frame, markers)
        state = tracker.update(markers, frame * STEP)
        off = abs(state.angles[pip] - bent(frame)[pip])
        if frame in (220, 225):
            assert off > np.radians(25.) and state.deviation[pip] > .9 * off
            assert state.deviation[FLEXION_JOINTS[1, 1]] < .2
    assert off < 1e-3 and state.deviation[pip] < .12


def test_of_what_was_never_seen_nothing_is_known():
    states = track(60, hide((MIDDLE,), 0, 60))
    unknown = unknown_deviation(HAND.limits)
    middle = [i for i, name in enumerate(JOINTS) if name.startswith('middle')]
    np.testing.assert_allclose(states[-1].deviation[middle], unknown[middle])
    waiting = HandTracker().update(np.full((8, 3), np.nan))
    np.testing.assert_allclose(waiting.deviation, unknown)


@pytest.mark.parametrize('rows', [(INDEX,), (1,), (0, 1, 2, MIDDLE)])
def test_a_left_hand_is_a_mirrored_right_hand_under_occlusion_too(rows):
    right, left = HandTracker(HAND), HandTracker(HAND.mirrored())
    rng = np.random.default_rng(3)
    for frame in range(150):
        markers = markers_at(frame) + rng.normal(scale=3e-4, size=(8, 3))
        hide(rows, 90, 130)(frame, markers)
        if 60 <= frame < 70:
            markers[[3, 4]] = markers[[4, 3]]
        a, b = right.update(markers, frame * STEP), left.update(markers * MIRROR, frame * STEP)
        np.testing.assert_array_equal(b.angles, a.angles)
        np.testing.assert_array_equal(b.marker_states, a.marker_states)
        np.testing.assert_allclose(b.deviation, a.deviation, rtol=1e-9)
        np.testing.assert_allclose(b.markers, a.markers * MIRROR, atol=1e-12)
        np.testing.assert_allclose(b.wrist_position, a.wrist_position * MIRROR, atol=1e-12)


def test_no_hidden_digit_goes_into_another_or_the_palm():
    shapes = hand_capsules(HAND)
    rng = np.random.default_rng(4)
    lower, upper = HAND.limits.T
    overlaps = {}
    for rigidity in (False, True):
        deepest = []
        for number in range(150):
            angles = lower + rng.random(25) * (upper - lower)
            hidden = number % 5
            tracker = HandTracker(HAND, options=replace(EXACT, rigidity=rigidity))
            markers = markers_at(0, angles=angles)
            markers[3 + hidden] = np.nan
            state = tracker.update(markers)
            gaps = pair_gaps(shapes, state.angles)
            deepest.append(-gaps[(shapes.digits == hidden).any(axis=1)].min())
        overlaps[rigidity] = np.array(deepest)
    asked, left = ((overlaps[rigidity] > 1e-3 + 1e-9).mean() for rigidity in (False, True))
    assert asked > .1, 'the poses ask for it'
    # Seen digits, which stay, leave some hidden ones no way out.
    assert left < .3 * asked


@pytest.mark.parametrize('hidden', [INDEX, MIDDLE])
def test_labels_stay_put_right_as_one_of_those_exchanged_vanishes(hidden):
    relaxed = HAND.relaxed()
    right, exchanged = HandTracker(HAND), HandTracker(HAND)
    rng = np.random.default_rng(5)
    for frame in range(150):
        markers = markers_at(frame, angles=relaxed) + rng.normal(scale=3e-4, size=(8, 3))
        if 90 <= frame < 120:
            markers[hidden] = np.nan
        expected = right.update(markers, frame * STEP)
        if frame >= 60:
            markers[[INDEX, MIDDLE]] = markers[[MIDDLE, INDEX]]
        state = exchanged.update(markers, frame * STEP)
        np.testing.assert_allclose(state.angles, expected.angles, atol=1e-9)
    assert (state.marker_states[[INDEX, MIDDLE]] == MarkerState.SWAPPED).all()


def test_labels_of_markers_that_were_all_hidden_for_long_are_as_given():
    relaxed, tracker = HAND.relaxed(), HandTracker(HAND)
    for frame in range(180):
        markers = markers_at(frame, angles=relaxed)
        if 60 <= frame < 90:
            markers[[INDEX, MIDDLE]] = markers[[MIDDLE, INDEX]]
        if 90 <= frame < 160:
            markers[[INDEX, MIDDLE]] = np.nan
        if frame >= 160:
            markers[INDEX] = np.nan
        state = tracker.update(markers, frame * STEP)
        if frame == 89:
            assert state.marker_states[INDEX] == MarkerState.SWAPPED
    assert state.marker_states[MIDDLE] == MarkerState.SEEN


def test_a_digit_that_overlapped_as_it_was_seen_leaves_the_others_without_a_leap():
    shapes = hand_capsules(HAND)
    tracker = HandTracker(HAND)
    angles = np.zeros(25)
    for finger, flexion, abduction in (('index', 35., -15.), ('middle', 30., 5.),
                                       ('ring', 30., 0.), ('little', 30., 0.)):
        angles[JOINTS.index(f'{finger}_mcp_flexion')] = np.radians(flexion)
        angles[JOINTS.index(f'{finger}_mcp_abduction')] = np.radians(abduction)
    published, overlaps = [], []
    for frame in range(120):
        markers = markers_at(0, angles=angles)
        if frame >= 60:
            markers[INDEX] = np.nan
        state = tracker.update(markers, frame * STEP)
        published.append(state.angles)
        overlaps.append(-pair_gaps(shapes, state.angles)[(shapes.digits == 0).any(axis=1)].min())
    assert overlaps[59] > .004 and overlaps[-1] < 1e-3 + 1e-9
    turned = np.abs(np.diff(published[59:], axis=0)).max(axis=1)
    assert turned.max() < tracker.options.reentry_rate * STEP + 1e-9
    assert turned.sum() > np.radians(5.)


FREQUENCY = 10.


def pip_of(motion, noise, options, seconds=6., middle=15., seed=5):
    """Return the tracked and the true PIP flexion of an index finger that moves by `motion`."""
    rng = np.random.default_rng(seed)
    tracker = HandTracker(options=options)
    pip = JOINTS.index('index_pip_flexion')
    found, true = [], []
    for frame in range(round(seconds * RATE)):
        angles = np.zeros(25)
        angles[FLEXION_JOINTS[:, 1]] = np.radians(15.)
        angles[pip] = np.radians(middle) + motion * np.sin(2. * np.pi * FREQUENCY * frame * STEP)
        angles[FLEXION_JOINTS[:, 2]] = (HAND.coupling * np.column_stack(
            (angles[FLEXION_JOINTS[:, 1]], np.ones(5)))).sum(axis=1)
        markers = markers_of(HAND, angles)
        state = tracker.update(markers + rng.normal(scale=noise, size=(8, 3)), frame * STEP)
        found.append(state.angles[pip])
        true.append(angles[pip])
    return np.array(found), np.array(true)


@pytest.mark.parametrize('middle', [10., 15., 20.])
def test_smoothing_takes_four_fifths_of_the_jitter_at_rest(middle):
    jitter = {}
    for smoothing in (False, True):
        options = replace(TrackerOptions(), smoothing=smoothing)
        found, _ = pip_of(0., 3e-4, options, middle=middle)
        jitter[smoothing] = found[round(2. * RATE):].std()
    assert jitter[False] >= 5. * jitter[True]


@pytest.mark.parametrize('middle, swing', [
    (15., 10.), (30., 10.), pytest.param(15., 5., marks=pytest.mark.xfail(
        reason='a motion of half a millimetre, near the noise, is overshot by a sixth'))])
def test_smoothing_leaves_a_fast_motion_its_amplitude_and_is_not_late(middle, swing):
    found, true = pip_of(np.radians(swing), 3e-4, TrackerOptions(), middle=middle)
    wave = np.exp(-2j * np.pi * FREQUENCY * STEP * np.arange(len(found)))
    later = slice(round(2. * RATE), None)
    response = (found[later] @ wave[later]) / (true[later] @ wave[later])
    assert abs(abs(response) - 1.) < .05
    assert abs(np.angle(response)) / (2. * np.pi * FREQUENCY) < .005


@pytest.mark.parametrize('speed', [1., 2., 4.])
def test_no_marker_is_refused_however_fast_the_hand_moves_while_it_is_hidden(speed):
    tracker = HandTracker(HAND)
    for frame, markers in enumerate(demo_recording().markers):
        states = tracker.update(markers, frame * STEP / speed).marker_states
        assert MarkerState.REJECTED not in states, frame


def test_markers_that_drop_out_for_single_frames_hardly_move_the_tips():
    hand, rate = Hand.scaled(length=.19, breadth=.088), 120.
    motion = motion_named('spelling', hand, 2, 8.)
    angles, rotation, position = motion.sample(np.arange(960) / rate)
    markers = markers_of(hand, angles, None, rotation, position)
    rng = np.random.default_rng(1)
    seen = markers + rng.normal(scale=2e-4, size=markers.shape)
    dropped = seen.copy()
    dropped[60:][rng.random((900, 8)) < .05] = np.nan
    paths = []
    for frames in (seen, dropped):
        tracker = HandTracker(hand)
        paths.append([tracker.update(frame, i / rate).pose.position[4::5]
                      for i, frame in enumerate(frames)])
    apart = np.linalg.norm(np.array(paths[1]) - paths[0], axis=2)
    # It was 14 mm, when each dropout slowed all fingers down.
    assert np.percentile(apart, 99) < .005 and apart.mean() < .0008


def test_no_finger_is_taken_for_a_palm_marker_that_is_hidden():
    hand = Hand.scaled(length=.19, breadth=.088)
    motion = motion_named('range_of_motion', hand, 3, 6.)
    angles, rotation, position = motion.sample(np.arange(400) * STEP)
    markers = markers_of(hand, angles, None, rotation, position)
    markers += np.random.default_rng(3).normal(scale=2e-4, size=markers.shape)
    markers[150:210, 2] = markers[150:270, 0] = np.nan
    tracker = HandTracker(hand)
    for frame, seen in enumerate(markers):
        state = tracker.update(seen, frame * STEP)
        assert (state.marker_states != MarkerState.SWAPPED).all()
        turned = Rotation.from_matrix(state.wrist_rotation @ rotation[frame].T).magnitude()
        assert turned < np.radians(90.)
