"""The tracker as a whole: what goes in comes out, and nothing bad comes out."""

from dataclasses import replace

import hypothesis.strategies as st
import numpy as np
import pytest
from helpers.hands import markers_of, skeleton
from hypothesis import assume, given, settings
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from hand_tracker.core.errors import InvalidLayout, InvalidOption
from hand_tracker.core.inverse_kinematics.abduction_plane import FIST_FAR
from hand_tracker.core.inverse_kinematics.digit import digit_chains
from hand_tracker.core.model.hand import (
    ABDUCTION_JOINTS,
    FLEXION_JOINTS,
    JOINTS,
    SIDES,
    Hand,
    preset_limits,
)
from hand_tracker.core.model.marker_layout import MARKERS, MarkerLayout
from hand_tracker.core.model.states import MarkerState, PalmState
from hand_tracker.core.options import TrackerOptions
from hand_tracker.core.pose.deviation import unknown_deviation
from hand_tracker.core.tracker import HandTracker
from hand_tracker.simulation.simulator import calibrated
from hand_tracker.simulation.visibility import skin_layout

MIRROR = np.array((1., -1., 1.))
# What is measured is what comes out: no filter, nothing moved apart.
EXACT = TrackerOptions(smoothing=False, rigidity=False)
UNCROWDED = TrackerOptions(rigidity=False)
# And no frame is too far from the last.
UNGATED = replace(EXACT, outlier_gate=0., swap_margin=0.)
TIPS = MarkerLayout(places=('wrist', 'index_mcp', 'little_mcp', 'index_tip', 'middle_tip',
                            'ring_tip', 'little_tip', 'thumb_tip'))
settings.register_profile('tracker', deadline=None, max_examples=100, derandomize=True)
settings.load_profile('tracker')

shares = arrays(float, 25, elements=st.floats(0., 1.))
anywhere = st.tuples(st.integers(0, 2 ** 32 - 1), arrays(float, 3, elements=st.floats(-5., 5.)))


def observable(hand, share):
    """Return angles that eight markers tell in full: what the couplings leave free."""
    lower, upper = hand.limits.T
    angles = lower + share * (upper - lower)
    # Named singularity: a straight chain (PIP near 0) has no side to bend to.
    bends = FLEXION_JOINTS[:, 1]
    angles[bends] = np.radians(2.) + share[bends] * (upper[bends] - np.radians(2.))
    follow = FLEXION_JOINTS[:, 2]
    angles[follow] = np.clip(hand.coupling[:, 0] * angles[bends] + hand.coupling[:, 1],
                             lower[follow], upper[follow])
    for joint in ('thumb_mcp_abduction',):
        angles[JOINTS.index(joint)] = 0.
    return angles


def in_fist(hand, angles, layout):
    """Return which digits have their marker so little in front of the joint that it is blended."""
    right = hand.as_right()
    digits = digit_chains(right, skeleton(right, layout)[1])
    local = markers_of(right, angles, layout)[3:] - digits.root
    ahead = np.einsum('dji,dj->di', digits.base, local)[:, 0]
    return abs(ahead) < FIST_FAR * digits.bones.sum(axis=1)


def random_pose(where):
    seed, position = where
    return Rotation.random(random_state=seed).as_matrix(), position


@pytest.mark.parametrize('side', SIDES)
@pytest.mark.parametrize('preset', ['paper', 'wide'])
@pytest.mark.parametrize('layout', [MarkerLayout(), TIPS], ids=['paper', 'tips'])
@pytest.mark.parametrize('palm_method', ['rigid', 'spheres'])
@given(share=shares, where=anywhere)
@settings(max_examples=20)
def test_angles_come_back_at_the_first_frame(side, preset, layout, palm_method, share, where):
    hand = Hand.scaled(side=side, limits=preset_limits(preset))
    angles = observable(hand, share)
    assume(not in_fist(hand, angles, layout).any())
    rotation, position = random_pose(where)
    # Labels as given: of fingers that cross each other they would be exchanged.
    tracker = HandTracker(hand, layout, replace(UNGATED, palm_method=palm_method))
    state = tracker.update(markers_of(hand, angles, layout, rotation, position))
    # The angles' noise is the markers' rounding times the gain of a nearly straight finger.
    np.testing.assert_allclose(state.angles, angles, atol=2e-6)
    np.testing.assert_allclose(state.wrist_rotation, rotation, atol=1e-9)
    np.testing.assert_allclose(state.wrist_position, position, atol=1e-9)
    assert state.palm == PalmState.TRACKED
    assert state.residuals.max() < 1e-7


@given(share=shares)
def test_in_a_fist_all_but_abduction_comes_back(share):
    hand = Hand.scaled()
    angles = observable(hand, .9 + .1 * share)
    angles[ABDUCTION_JOINTS] = 0.
    state = HandTracker(hand, options=EXACT).update(markers_of(hand, angles))
    np.testing.assert_allclose(state.angles, angles, atol=2e-6)


@pytest.mark.parametrize('side, layout, options', [
    ('right', MarkerLayout(), TrackerOptions()), ('left', TIPS, TrackerOptions('spheres'))],
    ids=['default', 'left tips spheres'])
@given(share=shares, where=anywhere)
def test_rigid_motion_of_the_markers_changes_only_the_wrist(side, layout, options, share, where):
    hand = Hand.scaled(side=side)
    rng = np.random.default_rng(where[0])
    markers = markers_of(hand, observable(hand, share), layout)
    markers += rng.normal(scale=.003, size=(8, 3))
    rotation, position = random_pose(where)
    here = HandTracker(hand, layout, options).update(markers)
    there = HandTracker(hand, layout, options).update(markers @ rotation.T + position)
    np.testing.assert_allclose(there.angles, here.angles, atol=1e-5)
    np.testing.assert_allclose(there.wrist_rotation, rotation @ here.wrist_rotation, atol=1e-9)
    np.testing.assert_allclose(
        there.wrist_position, rotation @ here.wrist_position + position, atol=1e-9)


@pytest.mark.parametrize('options', [TrackerOptions(), TrackerOptions('spheres', 'fabrik')],
                         ids=['default', 'spheres fabrik'])
@given(share=shares, where=anywhere)
def test_mirrored_input_mirrors_output(options, share, where):
    hand = Hand.scaled()
    rng = np.random.default_rng(where[0])
    rotation, position = random_pose(where)
    markers = markers_of(hand, observable(hand, share), None, rotation, position)
    markers += rng.normal(scale=.003, size=(8, 3))
    right = HandTracker(hand, options=options).update(markers)
    left = HandTracker(hand.mirrored(), options=options).update(markers * MIRROR)
    np.testing.assert_array_equal(left.angles, right.angles)
    np.testing.assert_allclose(left.pose.position, right.pose.position * MIRROR, atol=1e-12)
    np.testing.assert_allclose(
        left.pose.rotation, MIRROR[:, None] * right.pose.rotation * MIRROR, atol=1e-12)


wild = st.one_of(
    st.floats(-.2, .2), st.floats(), st.sampled_from((0., np.nan, np.inf, -np.inf, 1e30, 1e-300)))
# A sound palm lets the frame through to the digits; without one the pose is only kept.
frames_of_any_kind = st.lists(st.tuples(
    st.booleans(), arrays(float, (8, 3), elements=wild), shares, anywhere), min_size=1, max_size=6)
OFFSETS = np.array(((-.01, .002, .015), (0., .001, .009), (0., 0., .009), (.002, .003, .006),
                    (0., 0., .008), (.001, 0., -.006), (0., -.002, .007), (.003, .001, .008)))


@pytest.mark.parametrize('side, preset, layout, options, thumb', [
    ('right', 'paper', MarkerLayout(), TrackerOptions(), 'saddle'),
    ('right', 'paper', MarkerLayout(), UNGATED, 'saddle'),
    ('left', 'wide', TIPS, TrackerOptions(outlier_gate=0., swap_margin=0.), 'saddle'),
    ('left', 'paper', MarkerLayout(offsets=OFFSETS), TrackerOptions('spheres'), 'index_mcp'),
    ('right', 'wide', MarkerLayout(), replace(UNGATED, finger_ik='fabrik'), 'index_mcp'),
    ('right', 'paper', TIPS, TrackerOptions('spheres', 'fabrik'), 'saddle')],
    ids=['default', 'ungated', 'left tips', 'left offsets', 'fabrik', 'tips spheres fabrik'])
@given(warm=st.booleans(), frames=frames_of_any_kind)
@settings(max_examples=80)
def test_any_input_gives_finite_angles_within_the_limits(
        side, preset, layout, options, thumb, warm, frames):
    hand = Hand.scaled(side=side, limits=preset_limits(preset))
    hand = hand.with_paper_thumb() if thumb == 'index_mcp' else hand
    tracker = HandTracker(hand, layout, options)
    if warm:
        tracker.update(markers_of(hand, np.zeros(25), layout))
    for sound, markers, share, where in frames:
        if sound:
            rotation, position = random_pose(where)
            markers = markers.copy()
            markers[:3] = markers_of(hand, np.zeros(25), layout, rotation, position)[:3]
            markers[3:] += position  # near the hand, where they are not wild
        state = tracker.update(markers)
        assert not sound or options.outlier_gate > 0. or state.palm == PalmState.TRACKED
        assert (hand.limits[:, 0] <= state.angles).all()
        assert (state.angles <= hand.limits[:, 1]).all()
        for array in (state.wrist_rotation, state.wrist_position, *state.pose, state.markers):
            assert np.isfinite(array).all()
        np.testing.assert_allclose(
            state.wrist_rotation @ state.wrist_rotation.T, np.eye(3), atol=1e-9)
        lower, upper = hand.limits.T
        middle, width = lower + share * (upper - lower), .3 * (upper - lower)
        # 0 is outside the limits of many.
        hand = hand.replace(limits=np.column_stack(
            (np.maximum(middle - width, lower), np.minimum(middle + width, upper))))
        tracker.configure(hand=hand)


def test_the_callers_array_is_left_alone():
    hand = Hand.scaled(side='left')
    markers = markers_of(hand, np.zeros(25))
    before = markers.copy()
    HandTracker(hand).update(markers)
    np.testing.assert_array_equal(markers, before)


DEGENERATE = pytest.mark.parametrize('change, state', [
    (lambda m: m[:3] * 2., PalmState.TOO_FAR_APART),
    (lambda m: m[[0, 1, 1]], PalmState.COINCIDENT),
    (lambda m: np.array((m[0], m[1], .5 * (m[0] + m[1]))), PalmState.COLLINEAR),
    (lambda m: m[:3] * np.nan, PalmState.LOST)], ids=['far', 'coincident', 'collinear', 'lost'])


@DEGENERATE
def test_a_degenerate_palm_is_predicted(change, state):
    hand = Hand.scaled()
    tracker = HandTracker(hand, options=UNGATED)
    markers = markers_of(hand, observable(hand, np.full(25, .4)))
    before = tracker.update(markers)
    wrong = markers.copy()
    wrong[:3] = change(markers)
    after = tracker.update(wrong)
    assert after.palm == state
    assert (after.marker_states[:3] == MarkerState.PREDICTED).all()
    np.testing.assert_allclose(after.angles, before.angles, atol=1e-6)
    np.testing.assert_allclose(after.pose.position, before.pose.position, atol=1e-9)
    assert tracker.update(markers).palm == PalmState.TRACKED


@DEGENERATE
def test_what_makes_a_palm_degenerate_is_refused(change, state):
    hand = Hand.scaled()
    tracker = HandTracker(hand)
    before = tracker.update(markers_of(hand, observable(hand, np.full(25, .4))))
    wrong = before.markers.copy()
    wrong[:3] = change(wrong)
    after = tracker.update(wrong)
    assert after.palm in (PalmState.CARRIED, PalmState.LOST)
    assert (after.marker_states[:3] != MarkerState.SEEN).any()
    np.testing.assert_allclose(after.pose.position, before.pose.position, atol=1e-3)
    assert tracker.update(before.markers).palm == PalmState.TRACKED


@pytest.mark.parametrize('options', [TrackerOptions(), UNGATED], ids=['default', 'ungated'])
def test_digits_keep_their_places_while_the_palm_is_lost(options):
    hand = Hand.scaled()
    tracker = HandTracker(hand, options=options)
    share = np.full(25, .4)
    before = tracker.update(markers_of(hand, observable(hand, share)))
    index = FLEXION_JOINTS[0, :2]
    for bend in np.linspace(.4, .6, 21)[1:]:
        share[index] = bend
        angles = observable(hand, share)
        markers = markers_of(hand, angles)
        markers[:3] = np.nan
        state = tracker.update(markers)
    # A finger that moves alone turns a palm that nothing else tells of only a little.
    np.testing.assert_allclose(state.wrist_position, 0., atol=.025)
    assert state.palm is PalmState.LOST
    assert (state.marker_states == MarkerState.PREDICTED).all()
    np.testing.assert_allclose(state.angles, before.angles, atol=np.radians(1.))


def test_waits_for_the_first_whole_palm():
    hand = Hand.scaled()
    tracker = HandTracker(hand)
    markers = markers_of(hand, np.zeros(25))
    markers[1] = np.nan
    state = tracker.update(markers)
    assert state.palm == PalmState.WAITING and not tracker.placed
    assert state.marker_states[1] == MarkerState.ABSENT
    np.testing.assert_array_equal(state.angles, hand.relaxed())
    markers[1] = markers_of(hand, np.zeros(25))[1]
    assert tracker.update(markers).palm == PalmState.TRACKED


def never_seen(name, bends, options=None, side='right'):
    """Return the states of a hand whose fingers bend while one marker is never worn."""
    hand = Hand.scaled(side=side, limits=preset_limits('wide'))
    tracker = HandTracker(hand, options=options)
    row, states = MARKERS.index(name), []
    for bend in bends:
        angles = hand.relaxed()
        angles[FLEXION_JOINTS[:4]] = bend * hand.limits[FLEXION_JOINTS[:4], 1]
        markers = markers_of(hand, angles)
        markers[row] = np.nan
        states.append(tracker.update(markers))
        assert states[-1].marker_states[row] == MarkerState.ABSENT
        digit = slice(5 * (row - 3), 5 * (row - 2))
        np.testing.assert_allclose(
            states[-1].deviation[digit], unknown_deviation(hand.limits)[digit])
        assert (states[-1].angles >= hand.limits[:, 0]).all()
        assert (states[-1].angles <= hand.limits[:, 1]).all()
    return hand, states


@pytest.mark.parametrize('side', SIDES)
@pytest.mark.parametrize('stale', ['relax', 'hold'])
def test_a_thumb_that_was_never_seen_is_relaxed(side, stale):
    hand, states = never_seen('thumb', np.linspace(.1, .3, 300),
                              TrackerOptions(stale=stale, rigidity=False), side)
    thumb = slice(20, 25)
    for state in states:
        np.testing.assert_allclose(state.angles[thumb], hand.relaxed()[thumb], atol=1e-4)


@pytest.mark.parametrize('stale', ['relax', 'hold'])
def test_a_finger_that_was_never_seen_goes_along_with_its_neighbours(stale):
    open_to_shut = .1 + .6 * np.sin(np.linspace(0., 2. * np.pi, 1200)) ** 2
    hand, states = never_seen('ring', open_to_shut, TrackerOptions(stale=stale, rigidity=False))
    flexion = np.array([state.angles[FLEXION_JOINTS[2, :2]].sum() for state in states])
    others = open_to_shut * hand.limits[FLEXION_JOINTS[2, :2], 1].sum()
    assert np.corrcoef(flexion, others)[0, 1] > .95
    assert np.ptp(flexion) > .5 * np.ptp(others)
    # From the first frame on, and after it has learned what it was itself taken for.
    assert abs(flexion - others).max() < np.radians(60.)


def test_a_finger_that_was_never_seen_stays_natural_however_long():
    hand, states = never_seen('ring', np.tile(.3 + .2 * np.sin(np.linspace(
        0., 2. * np.pi, 240, endpoint=False)), 20), TrackerOptions(rigidity=False))
    first, last = (np.array([state.angles[FLEXION_JOINTS[2, :2]] for state in some])
                   for some in (states[240:480], states[-240:]))
    np.testing.assert_allclose(first, last, atol=np.radians(5.))


def test_a_hidden_finger_keeps_its_angles_while_the_wrist_moves():
    hand = Hand.scaled()
    tracker = HandTracker(hand, options=EXACT)
    angles = observable(hand, np.full(25, .4))
    tracker.update(markers_of(hand, angles))
    rotation = Rotation.from_euler('xyz', (.5, -.2, 1.)).as_matrix()
    markers = markers_of(hand, angles, None, rotation, np.ones(3))
    place = markers[3].copy()
    markers[3] = np.nan
    state = tracker.update(markers)
    np.testing.assert_allclose(state.angles, angles, atol=1e-6)
    np.testing.assert_allclose(state.markers[3], place, atol=1e-9)
    assert state.marker_states[3] == MarkerState.PREDICTED
    assert np.isnan(state.residuals[3]) and np.isfinite(np.delete(state.residuals, 3)).all()


def test_residuals_tell_what_the_hand_cannot_reach():
    hand = Hand.scaled()
    markers = markers_of(hand, np.zeros(25))
    markers[4] += (.02, 0., 0.)
    state = HandTracker(hand).update(markers)
    assert state.residuals[4] == pytest.approx(.02, abs=1e-4)
    assert np.delete(state.residuals, 4).max() < 1e-5


def test_marker_offsets_on_the_skin_are_taken_off():
    hand = Hand.scaled()
    offsets = np.tile((0., 0., .008), (8, 1))
    offsets[0] = (-.01, .002, .015)
    offsets[3] = (.002, .003, .006)
    layout = MarkerLayout(offsets=offsets)
    tracker = HandTracker(hand, layout, EXACT)
    # Nature and continuity tell the two flexions apart that offset markers leave open.
    for bend in np.linspace(.3, .6, 40):
        angles = observable(hand, np.full(25, bend))
        state = tracker.update(markers_of(hand, angles, layout))
    np.testing.assert_allclose(state.angles, angles, atol=1e-6)


@pytest.mark.parametrize('limits', ['paper', 'wide'])
@pytest.mark.parametrize('seed', range(3))
def test_fingers_with_markers_on_the_skin_open_and_close_without_a_jump(limits, seed):
    hand = Hand.scaled(limits=preset_limits(limits))
    layout = skin_layout(hand)
    # From a fist to straight fingers and back twice, resting at each; worn is a calibrated hand.
    rise = .5 - .5 * np.cos(np.linspace(0., np.pi, 60))
    share = np.tile(np.concatenate((np.ones(60), rise[::-1], np.zeros(60), rise)), 2)
    angles = np.zeros((len(share), 25))
    first, second, third = FLEXION_JOINTS[:4].T
    angles[:, first] = np.radians(3. + 77. * share)[:, None]
    angles[:, second] = np.radians(5. + 88. * share)[:, None]
    angles[:, third] = hand.coupling[:4, 0] * angles[:, second]
    markers = markers_of(hand, angles, layout)
    markers += np.random.default_rng(seed).normal(scale=2e-4, size=markers.shape)
    tracker = HandTracker(*calibrated(hand, layout, seed), UNCROWDED)
    found = np.array([tracker.update(frame, i / 120.).angles for i, frame in enumerate(markers)])
    assert np.degrees(np.abs(np.diff(found[:, second], axis=0))).max() < 10.
    straight = share == 0.
    assert np.degrees(np.abs(found - angles)[straight][:, second]).mean() < 15.


def test_new_limits_act_on_the_next_frame():
    hand = Hand.scaled()
    tracker = HandTracker(hand, options=EXACT)
    angles = observable(hand, np.full(25, .6))
    tracker.update(markers_of(hand, angles))
    limits = hand.limits.copy()
    index = JOINTS.index('index_mcp_flexion')
    limits[index] = 0., .2
    tracker.configure(hand=hand.replace(limits=limits))
    state = tracker.update(markers_of(hand, angles))
    assert state.angles[index] == .2
    tracker.configure(hand=hand)
    np.testing.assert_allclose(tracker.update(markers_of(hand, angles)).angles, angles, atol=1e-6)


def test_limits_hold_even_while_the_palm_is_lost():
    hand = Hand.scaled()
    tracker = HandTracker(hand)
    tracker.update(markers_of(hand, observable(hand, np.full(25, .6))))
    tight = hand.limits * .1
    tracker.configure(hand=hand.replace(limits=tight))
    state = tracker.update(np.full((8, 3), np.nan))
    assert ((tight[:, 0] <= state.angles) & (state.angles <= tight[:, 1])).all()


def test_another_side_begins_anew():
    hand = Hand.scaled()
    tracker = HandTracker(hand)
    tracker.update(markers_of(hand, np.zeros(25), None, None, np.array((0., .7, 0.))))
    tracker.configure(hand=hand.mirrored())
    assert tracker.update(np.full((8, 3), np.nan)).palm == PalmState.WAITING


def test_another_layout_keeps_the_pose_of_a_hidden_finger():
    hand = Hand.scaled()
    tracker = HandTracker(hand, options=EXACT)
    angles = observable(hand, np.full(25, .4))
    tracker.update(markers_of(hand, angles))
    tracker.configure(layout=TIPS)
    markers = markers_of(hand, angles, TIPS)
    markers[3] = np.nan
    np.testing.assert_allclose(tracker.update(markers).angles, angles, atol=1e-6)


@pytest.mark.parametrize('layout, message', [
    (MarkerLayout(('wrist', 'wrist', 'little_mcp') + MarkerLayout().places[3:]),
     'they lie within 0.0 mm of one line'),
    (MarkerLayout(('wrist', 'middle_mcp', 'middle_cmc') + MarkerLayout().places[3:]),
     'the palm needs a triangle at least 5 mm high'),
    (MarkerLayout(offsets=np.diag((0., 0., 0., -.026, 0., 0., 0., 0.))[:, [3, 1, 2]]),
     'marker index: its offset puts it within 5 mm of the axis')])
def test_a_layout_without_information_is_refused(layout, message):
    with pytest.raises(InvalidLayout, match=message):
        HandTracker(layout=layout)


@pytest.mark.parametrize('marker', range(3))
def test_a_palm_marker_off_the_palm_is_refused_and_a_jump_of_the_hand_is_not(marker):
    hand = Hand.scaled()
    places = markers_of(hand, np.zeros(len(JOINTS)))
    for off, is_refused in ((np.eye(8)[:, marker:marker + 1], True), (np.ones((8, 1)), False)):
        tracker = HandTracker(hand)
        for _ in range(20):
            tracker.update(places)
        state = tracker.update(places + off * (0., 0., .016))
        assert (state.marker_states[marker] == MarkerState.REJECTED) == is_refused
        assert (np.delete(state.marker_states, marker) == MarkerState.SEEN).all()


def test_a_frame_in_the_order_of_columns_is_the_same_frame():
    hand = Hand.scaled()
    places = markers_of(hand, np.zeros(len(JOINTS)))
    rows, columns = HandTracker(hand), HandTracker(hand)
    for k in range(4):
        one, other = rows.update(places), columns.update(
            places if k % 2 == 0 else np.asfortranarray(places))
        assert (one.angles == other.angles).all() and (one.markers == other.markers).all()


def test_a_frozen_marker_is_held_while_the_hand_moves():
    hand = Hand.scaled()
    tracker = HandTracker(hand, options=TrackerOptions(frozen_frames=5))
    angles = observable(hand, np.full(25, .4))
    first = markers_of(hand, angles)
    states = []
    for frame in range(12):
        markers = markers_of(hand, angles, None, None, np.array((.002 * frame, .01, 0.)))
        markers[3] = first[3]
        states.append(tracker.update(markers).marker_states[3])
    assert states[:5] == [MarkerState.SEEN] * 5
    assert states[6:] == [MarkerState.PREDICTED] * 6


def test_reset_returns_to_the_first_frame():
    hand = Hand.scaled()
    tracker = HandTracker(hand)
    first = markers_of(hand, observable(hand, np.full(25, .5)))
    before = tracker.update(first)
    tracker.update(markers_of(hand, observable(hand, np.full(25, .9))))
    tracker.reset()
    np.testing.assert_array_equal(tracker.update(first).angles, before.angles)


def test_fabrik_and_closed_form_agree():
    hand = Hand.scaled()
    exact = HandTracker(hand, options=EXACT)
    iterative = HandTracker(
        hand, options=replace(EXACT, finger_ik='fabrik', fabrik_iterations=2000))
    rng = np.random.default_rng(1)
    share = np.full(25, .5)
    iterations = 0
    for _ in range(100):
        share = np.clip(share + rng.normal(scale=.01, size=25), .3, .7)
        markers = markers_of(hand, observable(hand, share))
        a, b = exact.update(markers), iterative.update(markers)
        iterations += b.iterations
        assert a.iterations == 0
        np.testing.assert_allclose(b.angles[:20], a.angles[:20], atol=np.radians(.5))
        assert np.nanmax(b.residuals) < 1e-4
    assert iterations > 0


@pytest.mark.parametrize('options, message', [
    ({'palm_method': 'kabsch'}, "palm_method: 'kabsch' is not one of rigid, spheres"),
    ({'fabrik_iterations': 0}, 'fabrik_iterations: 0; allowed is a whole number from 1 to 10000'),
    ({'fabrik_iterations': 3.5}, 'fabrik_iterations: 3.5; allowed is a whole number from 1'),
    ({'fabrik_iterations': True}, 'fabrik_iterations: True; allowed is a whole number from 1'),
    ({'palm_stretch': float('nan')}, 'palm_stretch: nan; allowed is 1.05 to 10'),
])
def test_options_say_what_they_allow(options, message):
    with pytest.raises(InvalidOption, match=message):
        TrackerOptions(**options)


def test_a_wrong_shape_is_refused():
    with pytest.raises(ValueError, match=r'shape \(7, 3\); expected \(8, 3\)'):
        HandTracker().update(np.zeros((7, 3)))


@pytest.mark.parametrize('side', ['right', 'left'])
@pytest.mark.parametrize('roll, distance', [(0., 0.), (70., .018)])
def test_a_filtered_thumb_whose_phalanges_leave_its_plane_meets_its_marker(
        side, roll, distance):
    hand = Hand.scaled(side=side, thumb_mcp_abduction=np.radians(-8.),
                       thumb_roll=np.radians(roll), thumb_axis_distance=distance)
    lean = JOINTS.index('thumb_mcp_abduction')
    tracker, misses = HandTracker(hand), []
    for frame, phase in enumerate(np.linspace(0., 4. * np.pi, 240)):
        share = np.full(25, .5) + .2 * np.sin(phase)
        angles = observable(hand, share)
        angles[lean] = hand.thumb_mcp_abduction
        markers = markers_of(hand, angles)
        state = tracker.update(markers, frame / 120.)
        found = markers_of(hand, state.angles, None, state.wrist_rotation, state.wrist_position)
        misses.append(np.linalg.norm(found - markers, axis=1)[7])
        assert state.angles[lean] == pytest.approx(hand.thumb_mcp_abduction)
    # As near as a thumb that stays in its plane: the filter leaves it so much.
    assert max(misses[60:]) < 7e-4


@pytest.mark.parametrize('arguments, message', [
    (('right',), "'right'; expected a Hand, such as Hand.scaled()"),
    ((None, 'kyutech23'), "'kyutech23'; expected a MarkerLayout, such as MarkerLayout()"),
    ((None, None, {'patience': 1.}), 'expected a TrackerOptions')])
def test_an_argument_of_another_kind_is_named(arguments, message):
    with pytest.raises(TypeError, match=message.replace('(', r'\(').replace(')', r'\)')):
        HandTracker(*arguments)
