"""The steps of a frame: each is called, and has its say in the pose."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hand_tracker.core.inverse_kinematics.palm import place_palm_by_spheres
from hand_tracker.core.model.capsules import hand_capsules, pair_gaps
from hand_tracker.core.model.hand import ABDUCTION_JOINTS, FINGERS, FLEXION_JOINTS, SIDES, Hand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.marker_layout import MARKERS, MarkerLayout, marker_positions
from hand_tracker.core.model.states import MarkerState, PalmState
from hand_tracker.core.options import TrackerOptions
from hand_tracker.core.pipeline import CONTACT_RELEASE_TIME
from hand_tracker.core.tracker import HandTracker

STEP = 1. / 120.
HAND = Hand.scaled()
# What is measured is what comes out, and what is hidden stays where it was.
HELD = TrackerOptions(smoothing=False, rigidity=False, inertia=0., transdigital_memory=0.,
                      stale='hold', reentry_rate=1000.)
LEADERS = FLEXION_JOINTS[:4, 0]


def bent(flexion, pip=.5):
    """Return the angles of a hand with these flexions of the four MCPs."""
    angles = np.zeros(25)
    angles[LEADERS] = flexion
    angles[FLEXION_JOINTS[:, 1]] = pip
    angles[FLEXION_JOINTS[:, 2]] = HAND.coupling[:, 0] * pip + HAND.coupling[:, 1]
    return angles


def markers_of(angles, hidden=(), rotation=None, position=None):
    """Return the markers of a pose, those named hidden."""
    pose = forward(joint_table(HAND), angles, rotation, position)
    markers = marker_positions(MarkerLayout().mounting(HAND), pose, rotation, position)
    markers[[MARKERS.index(name) for name in hidden]] = np.nan
    return markers


@pytest.mark.parametrize('finger, neighbour, bound', [
    ('index', 'middle', .5), ('middle', 'ring', .6), ('little', 'ring', .7)])
def test_a_hidden_finger_does_not_stay_bent_while_its_neighbours_open(finger, neighbour, bound):
    tracker = HandTracker(options=replace(
        HELD, bound_index_middle=.5, bound_middle_ring=.6, bound_ring_little=.7))
    last = np.full(4, 1.2)
    tracker.update(markers_of(bent(last)), 0.)
    # The middle finger's other neighbour is kept, so that one bound tells.
    opening = [name for name in FINGERS if name != finger and (finger, name) != (
        'middle', 'index')]
    for frame in range(1, 11):
        last[[FINGERS.index(name) for name in opening]] = 1.2 * (1. - frame / 10.)
        state = tracker.update(markers_of(bent(last), [finger]), frame * STEP)
    flexion = dict(zip(FINGERS, state.angles[LEADERS]))
    assert abs(flexion[neighbour]) < 1e-6
    assert flexion[finger] == pytest.approx(bound, abs=1e-6)


def follow(frames, options=HELD, hand=HAND, step=STEP):
    """Return the states of some frames of markers."""
    tracker = HandTracker(hand, options=options)
    return [tracker.update(markers, i * step) for i, markers in enumerate(frames)]


def waved(frame, angles=None, hidden=()):
    """Return the markers of a hand that is moved about."""
    turn = Rotation.from_rotvec((.02 * frame, .01 * frame, -.01 * frame)).as_matrix()
    return markers_of(bent((.3, .4, .5, .6)) if angles is None else angles, hidden, turn,
                      frame * np.array((.002, -.001, .0015)))


def test_by_spheres_a_palm_that_gave_way_stays_as_it_is():
    markers = markers_of(bent(.4))
    markers[1] += (.002, .003, -.001)
    states = follow([markers] * 20, replace(HELD, palm_method='spheres'))
    for state in states[1:]:
        np.testing.assert_allclose(state.angles, states[0].angles, atol=1e-6)


@pytest.mark.parametrize('side', SIDES)
def test_digits_hang_where_the_spheres_found_their_first_joints(side):
    mirror = np.array((1., 1., 1.) if side == 'right' else (1., -1., 1.))
    markers = markers_of(bent(.4), rotation=Rotation.from_rotvec((.3, .2, 1.)).as_matrix(),
                         position=np.array((.1, .2, .3)))
    markers[1] += (.002, .003, -.001)
    markers[2] -= (.001, .002, -.003)
    hand = HAND.replace(side=side)
    poses = {method: follow([markers * mirror], replace(HELD, palm_method=method), hand)[0].pose
             for method in ('rigid', 'spheres')}
    # The index finger's and the little finger's MCP move by what their markers do.
    rotation, position, roots = np.empty((3, 3)), np.empty(3), HAND.finger_mcp.copy()
    roots = np.vstack((roots, HAND.thumb_cmc))
    template = MarkerLayout().mounting(HAND).position[:3]
    place_palm_by_spheres(markers[:3], template, rotation, position, roots)
    found = (roots @ rotation.T + position) * mirror
    np.testing.assert_allclose(
        poses['spheres'].position[[1, 6, 11, 16, 20]], found, atol=1e-9)
    moved = np.linalg.norm(poses['spheres'].position - poses['rigid'].position, axis=1)
    assert (moved[[1, 16]] > 1e-3).all()


def test_with_fabrik_markers_on_the_tips_keep_the_coupling():
    tips = MarkerLayout(places=('wrist', 'index_mcp', 'little_mcp', 'index_tip', 'middle_tip',
                                'ring_tip', 'little_tip', 'thumb_tip'))
    pose = forward(joint_table(HAND), bent(.4, pip=.7), None, None)
    markers = marker_positions(tips.mounting(HAND), pose, None, None)
    markers[3:] += .004  # which no pose within the coupling reaches
    state = HandTracker(HAND, tips, replace(HELD, finger_ik='fabrik')).update(markers, 0.)
    second, third = state.angles[FLEXION_JOINTS[:, 1]], state.angles[FLEXION_JOINTS[:, 2]]
    np.testing.assert_allclose(
        third, HAND.coupling[:, 0] * second + HAND.coupling[:, 1], atol=1e-9)


def test_a_fist_is_solved_in_its_first_frame():
    angles = bent(1.2, pip=1.3)
    angles[ABDUCTION_JOINTS[:4]] = .1
    state, = follow([markers_of(angles)])
    np.testing.assert_allclose(state.angles[FLEXION_JOINTS[:4]], angles[FLEXION_JOINTS[:4]],
                               atol=1e-3)
    # Abduction follows slowly there: at one frame's pace it would be at a fiftieth.
    np.testing.assert_allclose(state.angles[ABDUCTION_JOINTS[1:3]], .1, atol=.01)


@pytest.mark.parametrize('options, size, palm', [
    ({}, 1.3, PalmState.TRACKED), ({'palm_stretch': 1.2}, 1.3, PalmState.TOO_FAR_APART),
    ({}, .7, PalmState.TRACKED), ({'palm_shrink': .8}, .7, PalmState.TOO_CLOSE)])
def test_what_a_palm_may_be_is_an_option(options, size, palm):
    ungated = replace(HELD, outlier_gate=0., swap_margin=0., **options)
    markers = markers_of(bent(.4))
    wrong = markers.copy()
    wrong[:3] *= size
    _, state = follow([markers, wrong], ungated)
    assert state.palm == palm


@pytest.mark.parametrize('flatness, palm', [(.2, PalmState.TRACKED), (.8, PalmState.COLLINEAR)])
def test_how_flat_a_palm_may_be_is_an_option(flatness, palm):
    markers = markers_of(bent(.4))
    wrong = markers.copy()
    wrong[0] += .75 * (.5 * (wrong[1] + wrong[2]) - wrong[0])
    _, state = follow([markers, wrong], replace(
        HELD, outlier_gate=0., swap_margin=0., palm_flatness=flatness))
    assert state.palm == palm


def test_an_angle_goes_back_at_the_rate_allowed_when_its_marker_comes_back():
    open_, shut = bent(.2), bent(.8)
    frames = [markers_of(open_)] * 3 + [markers_of(shut, ['index'])] * 3 + [markers_of(shut)] * 30
    states = follow(frames, replace(HELD, reentry_rate=3., swap_margin=0., outlier_gate=0.))
    index = np.array([state.angles[LEADERS[0]] for state in states])
    np.testing.assert_allclose(index[:6], .2, atol=1e-6)
    np.testing.assert_allclose(np.diff(index)[5:15], 3. * STEP, atol=1e-6)
    assert index[-1] == pytest.approx(.8, abs=1e-6)
    assert states[6].deviation[LEADERS[0]] > .55 and states[-1].deviation[LEADERS[0]] < .3
    # Fingers that were seen throughout are where they are at once.
    assert states[3].angles[LEADERS[1]] == pytest.approx(.8, abs=1e-6)


def test_while_a_palm_marker_is_hidden_no_angle_turns_faster_than_allowed():
    frames = [markers_of(bent(.2))] * 3 + [markers_of(bent(.8), ['little_mcp'])] * 3
    states = follow(frames, replace(HELD, reentry_rate=3., swap_margin=0., outlier_gate=0.,
                                       palm_from_fingers=False))
    steps = np.diff([state.angles for state in states], axis=0)
    assert steps[2:].max() == pytest.approx(3. * STEP)


def test_a_measured_last_joint_comes_and_goes_at_the_rate_allowed():
    tracker = HandTracker(options=replace(HELD, reentry_rate=3.))
    markers, last = markers_of(bent(.4)), FLEXION_JOINTS[1, 2]
    before = tracker.update(markers, 0.).angles[last]
    measured = np.array((np.nan, 1., np.nan, np.nan, np.nan))
    found = [tracker.update(markers, i * STEP, measured).angles[last] for i in range(1, 4)]
    np.testing.assert_allclose(found, before + 3. * STEP * np.arange(1, 4))


def crossed(adduction):
    """Return angles of an index finger that leans into the middle one."""
    angles = bent((.5, .5, .5, .5))
    angles[ABDUCTION_JOINTS[0]] = -adduction
    angles[ABDUCTION_JOINTS[1]] = adduction
    return angles


def deepest(state):
    """Return the deepest overlap of a pose [m]."""
    return -pair_gaps(hand_capsules(HAND), state.angles).min()


def led_into(hidden, lean):
    """Return frames in which a finger goes into its neighbour, which has been hidden."""
    beside = bent(.5)
    beside[ABDUCTION_JOINTS[:2]] = lean
    return [markers_of(beside), markers_of(crossed(.2), [hidden])]


def test_a_hidden_digit_that_is_in_another_is_moved_out_where_it_is_asked_for():
    frames, free = led_into('index', -.2), replace(HELD, swap_margin=0., outlier_gate=0.)
    assert deepest(follow(frames, free)[-1]) > .003
    parted = follow(frames, replace(free, rigidity=True))[-1]
    assert deepest(parted) <= HELD.penetration + 1e-9
    parted = follow(frames, replace(free, rigidity=True, penetration=.002))[-1]
    assert .0015 < deepest(parted) <= .002 + 1e-9


def test_seen_digits_stay_where_they_are_seen():
    markers = markers_of(crossed(.2))
    crowded, = follow([markers])
    kept, = follow([markers], replace(HELD, rigidity=True, friction=.5))
    assert deepest(crowded) > .003
    np.testing.assert_array_equal(kept.angles, crowded.angles)


@pytest.mark.parametrize('hidden, lean', [('index', -.2), ('middle', .2)])
def test_of_two_that_touch_the_hidden_one_gives_way(hidden, lean):
    index, middle = ABDUCTION_JOINTS[:2]
    states = follow(led_into(hidden, lean), replace(
        HELD, rigidity=True, swap_margin=0., outlier_gate=0.))
    off = abs(states[-1].angles - crossed(.2))[[index, middle]]
    assert off.max() > .05 and off.min() < 1e-6
    assert (off[0] > off[1]) == (hidden == 'index')


def test_digits_that_touched_go_back_in_the_time_of_their_release():
    beside, together = led_into('index', -.2)
    out = bent(.5)
    out[ABDUCTION_JOINTS[:2]] = -.2
    away = markers_of(out, ['index'])
    states = follow([beside] + [together] * 2 + [away] * 15, replace(
        HELD, rigidity=True, swap_margin=0., outlier_gate=0.), step=.02)
    off = np.array([state.angles[ABDUCTION_JOINTS[0]] for state in states[3:]]) + .2
    assert off[0] > .01
    np.testing.assert_allclose(off[1:] / off[:-1], np.exp(-.02 / CONTACT_RELEASE_TIME), rtol=1e-3)


@pytest.mark.parametrize('friction', [0., 1.])
def test_a_hidden_digit_is_carried_by_what_touches_it_only_with_friction(friction):
    together = bent((.5, .5, .5, .5))
    together[ABDUCTION_JOINTS[0]] = -.12
    curled = together.copy()
    frames = [markers_of(together)] * 2
    for i in range(1, 13):
        curled[LEADERS] = .5 + .01 * i, .5, .5, .5
        frames.append(markers_of(curled, ['middle']))
    states = follow(frames, replace(HELD, rigidity=True, friction=friction))
    carried = states[-1].markers[MARKERS.index('middle')] - states[1].markers[
        MARKERS.index('middle')]
    assert (np.linalg.norm(carried) > .001) == (friction > 0.)


def test_markers_that_were_never_seen_are_relaxed_from_the_first_frame_on():
    state, = follow([markers_of(bent(.4), ['thumb'])])
    np.testing.assert_allclose(state.angles[20:], HAND.relaxed()[20:], atol=1e-4)


def test_after_a_pause_nothing_hidden_moves_on():
    tracker = HandTracker(options=replace(HELD, inertia=.5, palm_from_fingers=False))
    axis = markers_of(bent(.2))[1] / np.linalg.norm(markers_of(bent(.2))[1])
    for frame in range(10):
        # Fingers bend, and the palm turns about the line from wrist to index knuckle.
        turn = Rotation.from_rotvec(.02 * frame * axis).as_matrix()
        last = tracker.update(markers_of(bent(.2 + .02 * frame), (), turn), frame * STEP)
    hidden = markers_of(bent(.38), ['little_mcp', 'index'], turn)
    for _ in range(2):
        state = tracker.update(hidden, 9 * STEP + 1.5)
    np.testing.assert_allclose(state.hidden_for[[2, 3]], 1.5, atol=2. * STEP)
    np.testing.assert_allclose(state.markers, last.markers, atol=4e-3)


def test_before_the_palm_is_whole_the_hand_is_relaxed():
    state, = follow([markers_of(bent(.4), ['index_mcp'])])
    assert (state.palm, state.iterations) == (PalmState.WAITING, 0)
    np.testing.assert_array_equal(state.angles, HAND.relaxed())


def test_time_that_jumps_back_leaves_nothing_of_before():
    again, fresh = HandTracker(), HandTracker()
    for frame in range(10):
        again.update(waved(frame, hidden=['ring'] if frame > 5 else ()), 50. + frame * STEP)
    again.update(waved(0), 1.)
    for frame in range(1, 5):
        found = again.update(waved(frame), 1. + frame * STEP)
        assert again.restarted == (frame == 1)
        expected = fresh.update(waved(frame), 1. + frame * STEP)
        for name in ('angles', 'markers', 'marker_states', 'hidden_for', 'deviation'):
            np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), name)


def test_a_left_hand_is_tracked_as_its_mirror_image():
    mirror = np.array((1., -1., 1.))
    frames = [waved(i, hidden=['index', 'little_mcp'] if i > 4 else ()) for i in range(8)]
    frames[3][6] += .2
    right = follow(frames, TrackerOptions())
    left = follow([markers * mirror for markers in frames], TrackerOptions(), HAND.mirrored())
    for a, b in zip(left, right):
        np.testing.assert_array_equal(a.angles, b.angles)
        np.testing.assert_array_equal(a.marker_states, b.marker_states)
        np.testing.assert_allclose(a.markers, b.markers * mirror, atol=1e-12)
        np.testing.assert_allclose(a.wrist_position, b.wrist_position * mirror, atol=1e-12)
        np.testing.assert_allclose(a.residuals, b.residuals, atol=1e-12)


def test_where_markers_are_while_they_are_hidden_is_reported():
    frames = [waved(i, hidden=['index', 'wrist'] if i > 1 else ()) for i in range(6)]
    states = follow(frames, replace(HELD, max_prediction_time=2.5 * STEP))
    told = np.array([state.marker_states for state in states])
    for row in (MARKERS.index('index'), MARKERS.index('wrist')):
        assert told[:, row].tolist() == [MarkerState.SEEN] * 2 + [MarkerState.PREDICTED] * 2 + [
            MarkerState.STALE] * 2
        np.testing.assert_allclose([state.hidden_for[row] for state in states],
                                   STEP * np.array((0, 0, 1, 2, 3, 4)), atol=1e-12)
    assert states[1].palm == PalmState.TRACKED and states[2].palm == PalmState.CARRIED
    np.testing.assert_allclose(states[1].markers, frames[1], atol=1e-12)
    # The index finger goes with the palm.
    np.testing.assert_allclose(states[2].markers, waved(2), atol=2e-3)


def test_noise_that_is_less_than_allowed_is_learned():
    tracker, rng = HandTracker(options=TrackerOptions()), np.random.default_rng(2)
    markers, true = markers_of(bent(.4)), np.where(np.arange(8) < 5, 1e-4, 3e-4)
    for frame in range(60):
        tracker.update(markers + true[:, None] * rng.normal(size=(8, 3)), .05 * frame)
    found = tracker._state.noise.deviation
    assert found[:5].max() < 2e-4 < found[5:].min() < found[5:].max() < 4.5e-4


@pytest.mark.parametrize('change, learning', [
    (lambda markers: None, True),
    (lambda markers: markers.__setitem__(1, np.nan), False),
    (lambda markers: markers.__setitem__(4, np.nan), False)], ids=['seen', 'palm', 'digit'])
def test_habits_are_learned_only_while_all_is_seen(change, learning):
    tracker, weights = HandTracker(options=TrackerOptions()), []
    for frame in range(8):
        markers = waved(frame)
        if frame > 3:
            change(markers)
        tracker.update(markers, frame * STEP)
        weights.append(tracker._state.transdigital.statistics.weight[0])
    assert weights[3] > weights[2] > 0.
    assert (weights[7] > weights[4]) == learning


def test_what_is_known_anew_is_noted_digit_by_digit():
    def noted(*hidden):
        tracker.update(markers_of(bent(.4), hidden))
        return np.flatnonzero(tracker._state.changed).tolist()

    tracker = HandTracker(options=HELD)
    assert noted() == []
    assert noted('index', 'thumb') == [0, 4] and noted('index', 'thumb') == []
    assert noted('thumb') == [0]
    assert noted('index_mcp', 'thumb') == [0, 1, 2, 3, 4] and noted('index_mcp', 'thumb') == []
    # In a palm that is lost no digit is known, seen or not.
    palm = 'wrist', 'index_mcp', 'little_mcp'
    assert noted(*palm) == [0, 1, 2, 3, 4] and noted(*palm, 'ring') == []
    assert noted('wrist') == [0, 1, 2, 3, 4]


@pytest.mark.parametrize('gate, told', [(5., MarkerState.REJECTED), (0., MarkerState.SEEN)])
def test_a_marker_that_leaps_is_refused_where_there_is_a_gate(gate, told):
    frames = [waved(frame) for frame in range(12)]
    frames[11][3] += (.1, .1, .1)
    states = follow(frames, TrackerOptions(outlier_gate=gate, swap_margin=0.))
    assert states[11].marker_states[3] == told
    assert (np.delete(states[11].marker_states, 3) == MarkerState.SEEN).all()


@pytest.mark.parametrize('margin, told', [(2., MarkerState.SWAPPED), (0., MarkerState.SEEN)])
def test_exchanged_labels_are_put_right_where_there_is_a_margin(margin, told):
    frames = [waved(frame) for frame in range(14)]
    for markers in frames[10:]:
        markers[[4, 6]] = markers[[6, 4]]
    state = follow(frames, TrackerOptions(swap_margin=margin, outlier_gate=0.))[-1]
    assert (state.marker_states[[4, 6]] == told).all()


@pytest.mark.parametrize('frozen_frames, told', [
    (3, MarkerState.PREDICTED), (0, MarkerState.SEEN)])
def test_a_marker_that_stands_while_the_palm_moves_is_refused(frozen_frames, told):
    frames = [waved(frame) for frame in range(9)]
    for markers in frames[3:]:
        markers[3] = frames[2][3]
    state = follow(frames, replace(HELD, frozen_frames=frozen_frames, outlier_gate=0.))[-1]
    assert state.marker_states[3] == told
