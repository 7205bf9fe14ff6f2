"""Takes that are refused, and why."""

from functools import cache

import numpy as np
import pytest
from helpers.capture_files import capture_path
from helpers.skin_markers import EVERY_JOINT, WORN_PLACES, simulated_take

from hand_tracker.calibration.fitted_hand import place_mounted
from hand_tracker.calibration.take_checks import check_takes
from hand_tracker.calibration.take_files import load_take, recorded_take
from hand_tracker.calibration.takes import InvalidTake
from hand_tracker.core.model.hand import FLEXION_JOINTS, Hand
from hand_tracker.core.model.layout_presets import preset_layout
from hand_tracker.simulation.skin_take import skin_mount


@cache
def good_take():
    return simulated_take(Hand.scaled(), EVERY_JOINT, seconds=12.)[0]


def test_a_good_take_passes():
    assert check_takes([good_take()]) == []


def test_a_short_take_is_refused():
    with pytest.raises(InvalidTake, match=r'3\.0 s long; expected at least 5 s'):
        check_takes([good_take().part(np.arange(90))])


def test_short_takes_together_are_long_enough():
    take = good_take()
    check_takes([take.part(np.arange(0, 100)), take.part(np.arange(100, 300))])


@pytest.mark.parametrize(('factor', 'unit'), ((1000., 'millimetres'), (100., 'centimetres')))
def test_another_unit_is_refused(factor, unit):
    take = good_take()
    with pytest.raises(InvalidTake, match=f'{unit}, it seems; expected metres'):
        check_takes([take._replace(points=factor * take.points)])


def test_a_still_hand_is_refused():
    take = good_take()
    points = np.tile(take.points[:1], (len(take.points), 1, 1))
    points += 1e-4 * np.random.default_rng(1).standard_normal(points.shape)
    with pytest.raises(InvalidTake, match='the hand does not move'):
        check_takes([take._replace(points=points)])


def test_the_other_side_is_refused():
    with pytest.raises(InvalidTake, match=r'this is a right one \(--side right\)'):
        check_takes([good_take()._replace(side='left')])


def test_a_take_of_the_other_side_among_others_is_refused():
    take = good_take()
    other = take._replace(name='other', points=take.points * (1., -1., 1.))
    for takes in ((take, other), (other, take), (take.part(np.arange(60, 200)), other, other)):
        with pytest.raises(InvalidTake, match=r'^other: .* this is a left one \(--side left\)'):
            check_takes(takes)


def test_exchanged_labels_of_fingers_are_refused():
    take = simulated_take(Hand.scaled(), WORN_PLACES, seconds=12.)[0]
    names = list(take.names)
    names[3], names[5] = names[5], names[3]
    with pytest.raises(InvalidTake, match='wrong order beside each other: wrong labels'):
        check_takes([take._replace(names=tuple(names))])


@pytest.mark.parametrize('exchanged', (
    ('middle_pip', 'ring_pip'), ('index_tip', 'middle_tip'), ('index_mcp', 'index_pip'),
    ('thumb_mcp', 'thumb_ip'), ('index_dip', 'ring_tip')))
def test_two_exchanged_labels_among_many_are_refused_by_name(exchanged):
    take = good_take()
    first, second = exchanged
    names = tuple({first: second, second: first}.get(name, name) for name in take.names)
    with pytest.raises(InvalidTake, match='wrong order .*: wrong labels, ('
                       f'{first} and {second}|{second} and {first}) exchanged, it seems; '):
        check_takes([take._replace(names=names)])


@pytest.mark.parametrize(('name', 'layout'), (
    ('sig18__user1_left', 'sig18_19'), ('sig18__user1_right', 'sig18_19'),
    ('dfki__pillow', 'dfki13')))
def test_right_labels_of_captures_are_not_refused(name, layout):
    check_takes([recorded_take(capture_path(name), layout=preset_layout(layout))])


def test_missing_markers_are_named():
    take = good_take()
    with pytest.raises(InvalidTake, match='expected at least wrist, index_mcp and little_mcp'):
        check_takes([take._replace(names=('wrist', 'a', *take.names[2:]))])
    fingers = [i for i, name in enumerate(take.names) if not name.startswith('ring_')]
    with pytest.raises(InvalidTake, match='no marker at the end of ring'):
        check_takes([take._replace(names=tuple(take.names[i] for i in fingers),
                                   points=take.points[:, fingers])])


def test_both_hands_are_refused():
    with pytest.raises(InvalidTake, match='of both hands'):
        check_takes([good_take(), good_take()._replace(side='left')])


@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize('other, said', [
    ('dfki__pillow', 'back_hand_3 of the palm: never seen with three of hand_top, '),
    ('kyutech_s1__trial4_task1', 'wrist of the palm: never seen with three of thumb_cmc')])
def test_takes_without_common_markers_on_the_palm_are_refused(other, said):
    takes = [load_take(capture_path(name)) for name in ('sig18__user1_right', other)]
    with pytest.raises(InvalidTake, match=said):
        check_takes(takes)


def test_a_finger_that_does_not_move_is_noted():
    take = load_take(capture_path('kyutech_s1__trial4_task1'))
    points = np.concatenate([take.points] * 3)
    notes = check_takes([take._replace(points=points, sequence=np.zeros(len(points)))])
    assert any(note.startswith('the index finger hardly moves') for note in notes)
    assert not any('thumb' in note.split(':')[0] for note in notes)


def test_a_palm_marker_that_slips_is_told_of():
    take = good_take()
    points, wrist = take.points.copy(), take.names.index('wrist')
    towards = points[:, take.names.index('index_mcp')] - points[:, wrist]
    half = len(points) // 2
    points[half:, wrist] -= .008 * (
        towards / np.linalg.norm(towards, axis=1, keepdims=True))[half:]
    said = check_takes([take._replace(points=points)])
    assert any('did a marker slip?' in one and 'wrist' in one for one in said)
    assert not any('slip' in one for one in check_takes([take]))


def test_a_take_of_bent_fingers_tells_no_order_along_them():
    hand, time = Hand.scaled(), np.arange(240) / 30.
    angles = np.tile(hand.relaxed(), (len(time), 1))
    wave = .5 - .5 * np.cos(2. * np.pi * .4 * time)[:, None]
    for joints, least, most in zip(FLEXION_JOINTS[:4].T, (40., 60., 25.), (85., 105., 42.)):
        angles[:, joints] = np.radians(least + (most - least) * wave)
    points = place_mounted(hand, [skin_mount(hand, name, height=.008) for name in EVERY_JOINT],
                           angles, np.tile(np.eye(3), (len(time), 1, 1)), np.zeros((len(time), 3)))
    fists = good_take()._replace(names=tuple(EVERY_JOINT), points=points,
                                 sequence=np.zeros(len(time), dtype=int))
    assert all('thumb hardly moves' in weakness for weakness in check_takes([fists]))
