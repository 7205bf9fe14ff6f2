"""The tracker with layouts of any markers: accuracy, hidden markers, the palm's arch."""

import os
import subprocess
import sys

import numpy as np
import pytest
from helpers.capture_files import capture_path
from hypothesis import given, settings
from hypothesis import strategies as st

from hand_tracker.core.model.hand import DIGITS, FINGERS, JOINTS, Hand, preset_limits
from hand_tracker.core.model.kinematics import forward, joint_table, tip_offsets
from hand_tracker.core.model.layout_presets import preset_layout
from hand_tracker.core.model.marker_layout import (
    ALL_LANDMARKS,
    MARKERS,
    PALM_LANDMARKS,
    PAPER_PLACES,
    MarkerLayout,
    marker_positions,
)
from hand_tracker.core.model.states import MarkerState, PalmState
from hand_tracker.core.tracker import HandTracker, TrackerOptions
from hand_tracker.simulation.motions import motion_named

RATE = 120.
HAND = Hand.scaled()
LAST_LINKS = [4, 9, 14, 19, 24]


def motion(count, start=3., hand=HAND, **angles):
    """Return angles and wrist of some frames of the demo motion, some joints replaced [deg]."""
    found, rotation, position = motion_named('demo', hand).sample(np.arange(count) / RATE + start)
    for joint, value in angles.items():
        found[:, JOINTS.index(joint)] = np.radians(value)
    return found, rotation, position


def markers_of(layout, moved, hand=HAND, noise=0.):
    # Not named as the paper's eight, knuckles ride on their metacarpals.
    riding = MarkerLayout(layout.places, layout.offsets, layout.deviations,
                          [f'{name}.' for name in layout.names], layout.skin_shares)
    found = marker_positions(
        riding.mounting(hand), forward(joint_table(hand), *moved), *moved[1:])
    return found + np.random.default_rng(0).normal(scale=noise, size=found.shape)


def tips(hand, *pose):
    links = forward(joint_table(hand), *pose)
    return links.position[..., LAST_LINKS, :] + np.einsum(
        '...ijk,ik->...ij', links.rotation[..., LAST_LINKS, :, :], tip_offsets(hand))


def tracked(tracker, frames):
    return [tracker.update(frame, i / RATE) for i, frame in enumerate(frames)]


def with_fourth(place, offset=(0., 0., 0.)):
    return MarkerLayout([*PAPER_PLACES, place], np.vstack((np.zeros((8, 3)), offset)),
                        names=[*MARKERS, 'fourth'])


@pytest.mark.parametrize('side', ['right', 'left'])
def test_many_markers_tell_all_angles(side):
    hand = HAND.replace(side=side)
    layout, moved = preset_layout('kyutech23'), motion(40, hand=hand)
    states = tracked(HandTracker(hand, layout), markers_of(layout, moved, hand))
    off = np.abs([state.angles for state in states] - moved[0])
    assert np.degrees(off.mean()) < .5
    assert np.nanmax([state.residuals for state in states[5:]]) < 1e-3
    assert states[-1].markers.shape == (23, 3)
    assert (states[-1].marker_states == MarkerState.SEEN).all()


def test_a_permuted_layout_of_the_eight_is_tracked_to_the_bit_as_the_eight():
    order = np.random.default_rng(1).permutation(8)
    layout = MarkerLayout([PAPER_PLACES[i] for i in order],
                          names=[f'm{i}' for i in range(8)])
    frames = markers_of(MarkerLayout(), motion(20), noise=2e-4)
    eight, permuted = HandTracker(HAND), HandTracker(HAND, layout)
    for frame in frames:
        one, other = eight.update(frame), permuted.update(frame[order])
        assert np.array_equal(one.angles, other.angles)
        assert np.array_equal(one.markers[order], other.markers)
        assert one.residuals[order] == pytest.approx(other.residuals, abs=1e-12)


def test_a_digit_goes_on_by_its_other_markers_as_one_after_the_other_is_hidden():
    layout, moved = preset_layout('kyutech23'), motion(60)
    frames = markers_of(layout, moved)
    rows = [row for row, place in enumerate(layout.places) if place.startswith('index_')
            and place != 'index_mcp']
    frames[20:, rows[1]] = np.nan          # the principal one, at the DIP
    frames[40:, rows[2]] = np.nan          # the tip
    states = tracked(HandTracker(HAND, layout), frames)
    off = 1e3 * np.linalg.norm(
        np.array([state.markers for state in states])
        - markers_of(layout, moved), axis=2)[:, rows]
    assert off[20:40].max() < 3.
    assert off[40:].max() < 25.
    assert states[30].marker_states[rows[1]] == MarkerState.PREDICTED
    assert np.isnan(states[30].residuals[rows[1]]) and states[30].hidden_for[rows[1]] > 0.


def test_the_palm_is_placed_by_the_markers_that_are_seen():
    layout, moved = preset_layout('sig18_19'), motion(40)
    frames = markers_of(layout, moved)
    frames[10:, list(layout.principal[:3])] = np.nan
    states = tracked(HandTracker(HAND, layout), frames)
    off = np.linalg.norm([state.wrist_position for state in states] - moved[2], axis=1)
    assert off.max() < 2e-3
    assert states[-1].palm is PalmState.TRACKED


@pytest.mark.parametrize('hidden', ['wrist', 'index_mcp', 'little_mcp'])
@pytest.mark.parametrize('side', ['right', 'left'])
def test_a_palm_whose_skin_slides_hardly_moves_when_a_marker_vanishes(side, hidden):
    """What the marker held back the palm gives way to by and by, as if it had never been worn."""
    hand, layout = HAND.replace(side=side), preset_layout('kyutech23')
    on_palm = [place in PALM_LANDMARKS for place in layout.places]
    markers = markers_of(layout, motion(1, hand=hand), hand)[0]
    slid = np.random.default_rng(2).normal(scale=.003, size=markers.shape)
    markers += np.where(np.array(on_palm)[:, None], slid, 0.)
    without = markers.copy()
    without[layout.places.index(hidden)] = np.nan
    tracker = HandTracker(hand, layout)
    before = tracked(tracker, 120 * [markers])[-1]
    never = tracked(HandTracker(hand, layout), 120 * [without])[-1]

    def moved(state, other):
        return np.linalg.norm(state.wrist_position - other.wrist_position)

    gone = [tracker.update(without, (120 + i) / RATE) for i in range(300)]
    assert moved(gone[0], before) < .1 * moved(never, before)
    assert moved(gone[-1], never) < .05 * moved(never, before)
    steps = [moved(one, other) for one, other in zip(gone[1:], gone)]
    assert max(steps) < .15 * moved(never, before)


def test_a_palm_whose_skin_slides_hardly_moves_when_a_marker_blinks():
    layout = preset_layout('kyutech23')
    markers = markers_of(layout, motion(1))[0]
    markers += np.random.default_rng(2).normal(scale=.003, size=markers.shape)
    blinking, tracker = layout.places.index('index_mcp'), HandTracker(HAND, layout)
    places = []
    for frame in range(360):
        seen = markers.copy()
        if frame >= 120 and frame // 12 % 2:
            seen[blinking] = np.nan
        places.append(tracker.update(seen, frame / RATE).wrist_position)
    without = markers.copy()
    without[blinking] = np.nan
    never = tracked(HandTracker(HAND, layout), 120 * [without])[-1].wrist_position
    moved = np.linalg.norm(np.array(places) - places[119], axis=1)[120:]
    assert moved.max() < .5 * np.linalg.norm(never - places[119])


def test_a_palm_marker_vanishes_where_it_last_was_though_another_vanished_shortly_before():
    """What is expected of the markers is what they last showed, not what they first did."""
    layout = preset_layout('kyutech23')
    still = markers_of(layout, motion(1))[0]
    on_palm = [row for row, place in enumerate(layout.places) if place in PALM_LANDMARKS]
    slid = np.zeros(still.shape)
    slid[on_palm] = np.random.default_rng(5).normal(scale=.003, size=(len(on_palm), 3))
    first, second = (layout.places.index(name) for name in ('ring_mcp', 'index_mcp'))
    tracker = HandTracker(HAND, layout)
    for frame in range(260):
        # A blink before the skin slides, and the other marker for good.
        markers = still + np.clip((frame - 120) / 120., 0., 1.) * slid
        expected = markers[second].copy()
        if 115 <= frame < 120:
            markers[first] = np.nan
        if frame >= 242:
            markers[second] = np.nan
        state = tracker.update(markers, frame / RATE)
    assert np.linalg.norm(state.markers[second] - expected) < 1.5e-3


@pytest.mark.parametrize('other', ['index_pip', 'index_tip'])
def test_a_palm_does_not_cup_as_a_knuckle_has_the_label_of_another_marker(other):
    layout, moved = preset_layout('kyutech23'), motion(30)
    frames = markers_of(layout, moved)
    rows = [layout.places.index('little_mcp'), layout.places.index(other)]
    clean = tracked(HandTracker(HAND, layout), frames)
    frames[10:, rows] = frames[10:, rows[::-1]]
    states = tracked(HandTracker(HAND, layout), frames)
    arch = np.degrees([state.angles[[10, 15]] for state in (clean[-1], states[-1])])
    assert np.abs(arch[1] - arch[0]).max() < .1


PLAIN_PYTHON = """
import sys
import numpy as np
from hand_tracker.core.model.hand import Hand
from hand_tracker.core.model.layout_presets import preset_layout
from hand_tracker.core.tracker import HandTracker
tracker = HandTracker(Hand.scaled(), preset_layout('kyutech23'))
states = [tracker.update(frame, i / 120.) for i, frame in enumerate(np.load(sys.argv[1]))]
assert not tracker.is_compiled
np.save(sys.argv[1], [(*state.wrist_position, *state.angles, state.palm) for state in states])
"""


def test_plain_python_tracks_a_palm_of_knuckles_as_the_kernels_do(tmp_path):
    layout = preset_layout('kyutech23')
    frames = markers_of(layout, motion(24))
    hidden = [row for row, place in enumerate(layout.places) if place == 'wrist']
    frames[8:, hidden] = np.nan
    frames[16:, layout.places.index('index_mcp')] = np.nan
    np.save(tmp_path / 'frames.npy', frames)
    subprocess.run([sys.executable, '-c', PLAIN_PYTHON, str(tmp_path / 'frames.npy')], check=True,
                   env={**os.environ, 'HAND_TRACKER_JIT': '0',
                        'PYTHONPATH': os.pathsep.join(filter(None, sys.path))})
    compiled = [(*state.wrist_position, *state.angles, state.palm)
                for state in tracked(HandTracker(HAND, layout), frames)]
    np.testing.assert_allclose(np.load(tmp_path / 'frames.npy'), compiled, atol=1e-6)


@pytest.mark.parametrize('hidden', [('index_dip', 'index_tip'), ('ring_mcp', 'index_mcp')])
def test_a_still_hand_does_not_creep_as_its_markers_vanish_by_turns(hidden):
    layout = preset_layout('kyutech23')
    markers = markers_of(layout, motion(1, start=1.))[0]
    markers += np.random.default_rng(2).normal(scale=.003, size=markers.shape)
    tracker = HandTracker(HAND, layout)
    before = tracked(tracker, 120 * [markers])[-1].angles
    for frame in range(1200):
        seen = markers.copy()
        seen[layout.places.index(hidden[frame // 12 % 2])] = np.nan
        after = tracker.update(seen, (120 + frame) / RATE).angles
    assert np.degrees(np.abs(after - before).max()) < 1.5


@pytest.mark.parametrize('hidden', [('wrist', 'index_mcp'), ('wrist', 'little_mcp')])
@pytest.mark.parametrize('side', ['right', 'left'])
def test_the_knuckles_that_are_left_say_nothing_of_the_wrist(side, hidden):
    hand, layout = HAND.replace(side=side), preset_layout('kyutech23')
    markers = markers_of(layout, motion(1, hand=hand), hand)[0]
    markers += np.random.default_rng(6).normal(scale=.002, size=markers.shape)
    without = markers.copy()
    without[[row for row, place in enumerate(layout.places) if place in hidden]] = np.nan
    tracker = HandTracker(hand, layout)
    before = tracked(tracker, 120 * [markers])[-1]
    after = [tracker.update(without, (120 + i) / RATE) for i in range(24)]
    moved = [np.linalg.norm(state.wrist_position - before.wrist_position) for state in after]
    assert max(moved) < 3e-3


@pytest.mark.parametrize('ghost', ['ring_mcp', 'index_tip'])
def test_a_marker_that_is_elsewhere_is_not_believed_because_another_blinks(ghost):
    layout, moved = preset_layout('kyutech23'), motion(240)
    frames = markers_of(layout, moved)
    frames[:, layout.places.index(ghost)] += (.02, .02, .02)
    alone = tracked(HandTracker(HAND, layout), frames)
    blinking = layout.places.index('middle_mcp' if ghost == 'ring_mcp' else 'index_pip')
    frames[np.arange(240) // 10 % 10 == 9, blinking] = np.nan
    found = tracked(HandTracker(HAND, layout), frames)
    errors = [np.abs([state.angles for state in states] - moved[0]).max(axis=1).mean()
              for states in (alone, found)]
    assert errors[1] < 1.5 * errors[0] + np.radians(.2)


@pytest.mark.parametrize('layout', [MarkerLayout(), preset_layout('kyutech23')])
def test_options_and_limits_may_change_while_a_marker_is_hidden(layout):
    markers = markers_of(layout, motion(1))[0]
    markers += np.random.default_rng(2).normal(scale=.003, size=markers.shape)
    tracker = HandTracker(HAND, layout)
    tracked(tracker, 120 * [markers])
    markers[layout.principal[0]] = np.nan
    before = [tracker.update(markers, (120 + i) / RATE) for i in range(30)][-1]
    limits = HAND.limits.copy()
    limits[JOINTS.index('middle_pip_flexion'), 0] -= .05
    tracker.configure(hand=HAND.replace(limits=limits), options=tracker.options)
    after = tracker.update(markers, 150 / RATE)
    np.testing.assert_allclose(after.wrist_position, before.wrist_position, atol=3e-4)
    np.testing.assert_allclose(after.angles, before.angles, atol=np.radians(.5))


@pytest.mark.parametrize('hidden', ['index_pip', 'middle_dip', 'ring_tip', 'thumb_tip'])
@pytest.mark.parametrize('side', ['right', 'left'])
def test_a_digit_whose_skin_slides_hardly_moves_when_a_marker_vanishes(side, hidden):
    hand, layout = HAND.replace(side=side), preset_layout('kyutech23')
    markers = markers_of(layout, motion(1, start=1., hand=hand), hand)[0]
    slid = np.random.default_rng(3).normal(scale=.002, size=markers.shape)
    on_palm = np.array([place in PALM_LANDMARKS for place in layout.places])
    markers += np.where(on_palm[:, None], 0., slid)
    row = layout.places.index(hidden)
    without = markers.copy()
    without[row] = np.nan
    tracker = HandTracker(hand, layout)
    before = tracked(tracker, 120 * [markers])[-1]
    never = tracked(HandTracker(hand, layout), 120 * [without])[-1]

    def turned(state, other):
        return np.abs(state.angles - other.angles).max()

    gone = [tracker.update(without, (120 + i) / RATE) for i in range(360)]
    assert turned(gone[30], before) < .35 * turned(never, before)
    assert np.linalg.norm(gone[30].markers[row] - markers[row]) < .5 * np.linalg.norm(
        never.markers[row] - markers[row])
    assert turned(gone[-1], never) < .1 * turned(never, before)


@pytest.mark.parametrize('digit, left', [
    ('index', None), ('index', 'index_dip'), ('middle', None), ('middle', 'middle_dip'),
    ('thumb', None), ('thumb', 'thumb_tip')])
@pytest.mark.parametrize('side', ['right', 'left'])
def test_a_digit_keeps_its_bend_as_all_its_markers_or_all_but_the_principal_vanish(
        side, digit, left):
    hand, layout = HAND.replace(side=side), preset_layout('kyutech23')
    markers = markers_of(layout, motion(1, start=1., hand=hand), hand)[0]
    markers += np.where(
        [[place in PALM_LANDMARKS] for place in layout.places], 0.,
        np.random.default_rng(3).normal(scale=.002, size=markers.shape))
    without = markers.copy()
    without[[row for row, place in enumerate(layout.places) if place not in (*PALM_LANDMARKS, left)
             and place.startswith(digit)]] = np.nan
    tracker = HandTracker(hand, layout)
    before = tracked(tracker, 120 * [markers])[-1]
    gone = [tracker.update(without, (120 + i) / RATE) for i in range(24)]
    turned = np.degrees(np.abs([state.angles - before.angles for state in gone])).max(axis=1)
    assert turned[0] < .5 and turned[12] < 1.5 and turned[-1] < 3.


@pytest.mark.parametrize('side', ['right', 'left'])
def test_the_digits_hold_a_palm_of_which_the_knuckles_alone_are_seen(side):
    """Skin over the knuckles is nearly on a line, about which a palm that slid would turn."""
    hand, layout = HAND.replace(side=side), preset_layout('kyutech23')
    knuckles = [layout.places.index(f'{finger}_mcp') for finger in FINGERS]
    wrist = [row for row, place in enumerate(layout.places) if place == 'wrist']
    markers = markers_of(layout, motion(1, hand=hand), hand)[0]
    markers[knuckles] += np.random.default_rng(4).normal(scale=.002, size=(4, 3))
    without = markers.copy()
    without[wrist] = np.nan
    tracker = HandTracker(hand, layout)
    before = tracked(tracker, 120 * [markers])[-1]
    for i in range(60):
        state = tracker.update(without, (120 + i) / RATE)
    assert np.linalg.norm(state.wrist_position - before.wrist_position) < 2e-3
    assert np.degrees(np.abs(state.angles - before.angles).max()) < 3.


def test_an_outlier_among_many_markers_moves_the_hand_little():
    layout, moved = preset_layout('kyutech23'), motion(30)
    frames = markers_of(layout, moved)
    clean = tracked(HandTracker(HAND, layout), frames)
    frames[10:, layout.further[3]] += (.05, .03, 0.)
    states = tracked(HandTracker(HAND, layout), frames)
    off = np.array([tips(HAND, one.angles, one.wrist_rotation, one.wrist_position)
                    - tips(HAND, other.angles, other.wrist_rotation, other.wrist_position)
                    for one, other in zip(clean, states)])
    assert np.linalg.norm(off, axis=2).max() < 6e-3


@pytest.mark.parametrize('place, offset', [
    ('middle_mcp', (0., 0., 0.)), ('ring_mcp', (0., 0., 0.)), ('index_mcp', (-.02, 0., .01))])
@pytest.mark.parametrize('ring, little', [(10., 20.), (15., 30.)])
def test_a_fourth_palm_marker_shows_the_arch(place, offset, ring, little):
    moved = motion(25, ring_cmc_flexion=ring, little_cmc_flexion=little)
    layout = with_fourth(place, offset)
    states = tracked(HandTracker(HAND, layout), markers_of(layout, moved, noise=1e-4))
    off = 1e3 * np.linalg.norm(np.array([
        tips(HAND, state.angles, state.wrist_rotation, state.wrist_position)
        for state in states]) - tips(HAND, *moved), axis=2)
    assert off[:, FINGERS.index('little')].mean() < 3.
    arch = np.degrees(states[-1].angles[[10, 15]])
    assert arch == pytest.approx((ring, little), abs=2.)


def test_without_a_fourth_marker_the_palm_is_flat_unless_a_synergy_is_asked_for():
    moved = motion(10, ring_cmc_flexion=10., little_cmc_flexion=20.)
    frames = markers_of(MarkerLayout(), moved)
    cmc = [JOINTS.index(f'{finger}_cmc_flexion') for finger in FINGERS]
    for option, cups in (('observed', False), ('flat', False), ('synergy', True)):
        states = tracked(HandTracker(HAND, options=TrackerOptions(palm_arch=option)), frames)
        assert (states[-1].angles[cmc] != 0.).any() == cups
    flat = tracked(HandTracker(HAND, with_fourth('middle_mcp'), TrackerOptions(palm_arch='flat')),
                   np.concatenate((frames, frames[:, :1] + .001), axis=1))
    assert (flat[-1].angles[cmc] == 0.).all()


@st.composite
def layouts(draw):
    extra = draw(st.lists(st.sampled_from(ALL_LANDMARKS), max_size=20))
    palm = draw(st.permutations(('wrist', 'index_mcp', 'little_mcp')))
    places = [*palm, *extra]
    offset = st.floats(-.01, .01)
    offsets = np.array([draw(st.tuples(offset, offset, offset)) for _ in places])
    offsets[:3] = 0.
    return MarkerLayout(places, offsets, names=[f'm{i}' for i in range(len(places))])


@settings(max_examples=10, deadline=None)
@given(layouts(), st.integers(0, 2**32 - 1))
def test_whatever_comes_the_hand_stays_finite_and_within_its_limits(layout, seed):
    random = np.random.default_rng(seed)
    side = ('right', 'left')[seed % 2]
    hand = HAND.replace(side=side)
    tracker = HandTracker(hand, layout)
    frames = markers_of(layout, motion(6, hand=hand), hand)
    for i, frame in enumerate(frames):
        frame[random.random(len(frame)) < .3] = np.nan
        wild = random.random(len(frame)) < .1
        frame[wild] = random.normal(scale=10. ** random.integers(-2, 4), size=(wild.sum(), 3))
        state = tracker.update(frame, i / RATE)
        assert np.isfinite(state.angles).all() and np.isfinite(state.pose.position).all()
        assert np.isfinite(state.markers).all() and np.isfinite(state.wrist_rotation).all()
        lower, upper = tracker.hand.limits.T
        assert (state.angles >= lower).all() and (state.angles <= upper).all()


@pytest.mark.parametrize('shift', [1, 2, 8])
@pytest.mark.parametrize('name', ['sig18_19', 'kyutech23'])
def test_a_hand_is_tracked_again_after_a_spell_of_wrong_labels(name, shift):
    layout = preset_layout(name)
    frames = markers_of(layout, motion(420))
    frames[120:220] = np.roll(frames[120:220], shift, axis=1)
    states = tracked(HandTracker(HAND, layout), frames)
    assert states[-1].palm is PalmState.TRACKED
    assert np.mean(states[-1].residuals) < 2. * np.mean(states[119].residuals) + 1e-3


@pytest.mark.parametrize('name', ['vicon_production5', 'optitrack_hand', 'kyutech23'])
def test_markers_at_one_place_are_no_palm_and_then_one_is_found(name):
    layout = preset_layout(name)
    tracker = HandTracker(HAND, layout)
    for place in (0., .3):
        for frame in range(10):
            state = tracker.update(np.full((len(layout.places), 3), place), frame / RATE)
        assert state.palm is PalmState.COINCIDENT and not tracker.placed
    state = tracker.update(markers_of(layout, motion(1))[0], 1.)
    assert state.palm is PalmState.TRACKED


@pytest.mark.parametrize('digit', DIGITS)
def test_a_digit_with_one_marker_is_solved_in_closed_form_among_others_with_more(digit):
    places = [*PAPER_PLACES, *(f'{other}_{"mcp" if other == "thumb" else "pip"}'
                               for other in DIGITS if other != digit)]
    layout = MarkerLayout(places, names=[f'm{i}' for i in range(len(places))])
    frames = markers_of(layout, motion(10))
    one, many = HandTracker(HAND), HandTracker(HAND, layout)
    rows = slice(5 * DIGITS.index(digit), 5 * DIGITS.index(digit) + 5)
    for frame in frames:
        assert np.array_equal(one.update(frame[:8]).angles[rows],
                              many.update(frame).angles[rows])


@pytest.mark.parametrize('task', range(1, 8))
def test_real_markers_of_a_preset_are_tracked_with_the_mean_hand(task):
    """Before anybody is calibrated: no label is doubted, and all markers are near."""
    capture, layout = np.load(capture_path(f'kyutech_s1__trial4_task{task}')), preset_layout(
        'kyutech23')
    names = capture['marker_names'].tolist()
    frames = capture['markers'][:, [names.index(name) for name in layout.names]]
    tracker, residuals = HandTracker(HAND, layout), []
    for number, markers in enumerate(frames):
        state = tracker.update(markers, number / float(capture['rate_hz']))
        assert (state.marker_states == MarkerState.SEEN).all()
        residuals.append(np.nanmean(state.residuals))
    assert np.mean(residuals) < .007


def with_dropouts(layout, share, rate):
    """Return the states of simulated spelling and its angles, and where markers were missing."""
    time = np.arange(int(6 * rate)) / rate
    angles, rotation, position = motion_named('spelling', HAND, 3, 8.).sample(time + 2.)
    frames = marker_positions(
        layout.mounting(HAND), forward(joint_table(HAND), angles, rotation, position),
        rotation, position)
    random = np.random.default_rng(7)
    frames += random.normal(scale=2e-4, size=frames.shape)
    missing = random.random(frames.shape[:2]) < share
    frames[missing] = np.nan
    tracker = HandTracker(HAND, layout)
    states = [tracker.update(frame, at) for frame, at in zip(frames, time, strict=True)]
    return states, angles, missing


@pytest.mark.parametrize('name', ['optitrack_hand', 'sig18_19'])
def test_markers_that_drop_out_for_a_frame_are_believed_when_they_come_back(name):
    states, _, missing = with_dropouts(preset_layout(name), .1, RATE)
    refused = np.array([state.marker_states for state in states]) == MarkerState.REJECTED
    # Nine of a thousand were refused where an inferred marker counted as a measured one.
    assert (refused & ~missing).mean() < .001


@pytest.mark.parametrize('name, most', [('optitrack_hand', 8.5), ('sig18_19', 4.8)])
def test_dropouts_do_not_slow_digits_with_several_markers_down(name, most):
    states, angles, _ = with_dropouts(preset_layout(name), .2, 60.)
    off = np.degrees(np.abs([state.angles for state in states] - angles))[60:]
    # Limited to the re-entry rate in each frame with a change they were 9.2 and 5.2 degrees.
    assert np.percentile(off, 98) < most


# 0.027, 0.011 and 0.047 of them by gates that take the palm for exact.
@pytest.mark.parametrize('markers, most', [
    (('BackHand1', 'BackHand2', 'BackHand3', 'IndexTip', 'MiddleTip', 'RingTip', 'PinkyTip',
      'ThumbTip'), .01),
    (preset_layout('sig18_19').names, .003), (MARKERS, .02)])
def test_noise_that_turns_the_palm_is_no_reason_to_refuse_markers(markers, most):
    layout = MarkerLayout() if markers == MARKERS else preset_layout('sig18_19').in_order(markers)
    states = tracked(HandTracker(HAND, layout), markers_of(layout, motion(480), noise=.0015))
    assert np.mean([state.marker_states == MarkerState.REJECTED for state in states]) < most


@pytest.mark.parametrize('names', [MARKERS, tuple('abcdefgh')])
def test_the_only_marker_of_a_digit_may_turn_with_its_joint(names):
    shares = [.4 if place.endswith('_dip') else 0. for place in PAPER_PLACES]
    layout = MarkerLayout(names=names, places=PAPER_PLACES, offsets=[(0., 0., .01)] * 8,
                          skin_shares=shares)
    count = 200
    bend = .5 - .5 * np.cos(np.linspace(0., 2. * np.pi, count))
    angles = np.zeros((count, len(JOINTS)))
    for finger in FINGERS:
        angles[:, JOINTS.index(f'{finger}_mcp_flexion')] = .6 * bend
        angles[:, JOINTS.index(f'{finger}_pip_flexion')] = .9 * bend
    angles = HAND.coupled(angles, HAND.limits)
    frames = marker_positions(layout.mounting(HAND), forward(joint_table(HAND), angles))
    tracker = HandTracker(HAND, layout)
    states = [tracker.update(frame, n / RATE) for n, frame in enumerate(frames)]
    flexion = [JOINTS.index(f'{finger}_pip_flexion') for finger in FINGERS]
    errors = np.degrees(np.abs([state.angles for state in states] - angles))[20:, flexion]
    # The closed form, which takes the offset for a fixed one, errs by 4.4 in the mean.
    assert errors.mean() < 2.5 and errors.max() < 8.
    assert np.mean([state.residuals for state in states]) < .0002


@pytest.mark.parametrize('name', ['sig18_19', 'dfki13'])
def test_dropouts_do_not_straighten_a_still_hand(name):
    layout = preset_layout(name)
    pose = forward(joint_table(HAND), HAND.relaxed())
    markers = marker_positions(layout.mounting(HAND), pose, np.eye(3), np.zeros(3))
    missing = np.random.default_rng(5).random((2400, len(markers))) < .2
    missing[:240] = False
    tracker, found = HandTracker(HAND, layout), []
    for number, gone in enumerate(missing):
        found.append(tracker.update(np.where(gone[:, None], np.nan, markers), number / 480.).angles)
    drift = np.degrees(np.mean(found[-240:], axis=0) - np.mean(found[:240], axis=0))
    assert np.abs(drift).max() < .1


@pytest.mark.parametrize('changed', ['hand', 'layout'])
def test_another_hand_and_other_places_of_markers_are_blended_in(changed):
    worn = preset_layout('sig18_19')
    moved = worn.with_offsets(
        worn.offsets + np.random.default_rng(1).normal(scale=.003, size=worn.offsets.shape))
    hand = Hand.scaled(.2, .091) if changed == 'hand' else HAND
    tracker = HandTracker(hand, worn if changed == 'hand' else moved)
    pose = forward(joint_table(HAND), HAND.relaxed())
    markers = marker_positions(worn.mounting(HAND), pose, np.eye(3), np.zeros(3))
    found = []
    for number in range(240):
        if number == 120:
            tracker.configure(**{changed: HAND if changed == 'hand' else worn})
        found.append(tracker.update(markers, number / RATE).angles)
    steps = np.abs(np.diff(found, axis=0))[118:]
    assert steps.max() * RATE < 1.05 * tracker.options.reentry_rate
    assert np.abs(found[-1] - found[118]).max() > np.radians(3.)


def test_a_thumb_whose_skin_turns_with_its_mcp_is_met():
    worn = preset_layout('kyutech23')
    shares = np.where([place == 'thumb_mcp' for place in worn.places], .6, 0.)
    layout = MarkerLayout(worn.places, worn.offsets, worn.deviations, worn.names, shares)
    moved = motion(60)
    angles = moved[0]
    flexion = JOINTS.index('thumb_mcp_flexion')
    angles[:, flexion] = np.linspace(0., np.radians(50.), len(angles))
    hand = HAND.replace(limits=preset_limits('wide'))
    states = tracked(HandTracker(hand, layout), markers_of(layout, moved))[5:]
    off = np.abs([state.angles for state in states] - angles[5:])[:, flexion]
    # As without skin that turns; 10 degrees where its share is left out.
    assert np.degrees(off.max()) < 4.
    assert np.nanmax([state.residuals for state in states]) < 2e-3
