"""What a live calibration has seen of each movement, on simulated hands."""

import numpy as np
import pytest
from helpers.skin_markers import worn_markers

from hand_tracker.calibration.live_take import TAKE_RATE
from hand_tracker.calibration.prompts import PROMPTS, shown_shares
from hand_tracker.core.model.hand import Hand
from hand_tracker.core.model.marker_layout import MARKERS, MarkerLayout
from hand_tracker.simulation.motions import motion_named
from hand_tracker.simulation.poses import pose_angles
from hand_tracker.simulation.visibility import skin_layout

NAMES = [prompt.name for prompt in PROMPTS]
HAND = Hand.scaled()


def shown(angles, hand=HAND, layout=None, noise=.0003, hide=0.):
    """Return the shares, by name, of a hand that passes through angles (T, 25)."""
    markers = worn_markers(hand, skin_layout(hand) if layout is None else layout, angles)
    random = np.random.default_rng(3)
    markers = markers + noise * random.standard_normal(markers.shape)
    markers[random.random(markers.shape[:2]) < hide] = np.nan
    return dict(zip(NAMES, shown_shares(markers, hand.side)))


def ranged(hand=HAND, rate=TAKE_RATE):
    moving = motion_named('range_of_motion', hand, 2)
    return moving.sample(np.arange(0., moving.duration, 1. / rate))[0]


def between(*poses, hand=HAND, seconds=1.):
    """Return angles that go from pose to pose."""
    rows = [pose_angles(pose, hand) for pose in poses]
    steps = np.linspace(0., 1., round(seconds * TAKE_RATE))[:, None]
    return np.concatenate([(1. - steps) * one + steps * other
                           for one, other in zip(rows, rows[1:])])


@pytest.mark.parametrize(('hand', 'layout'), (
    (HAND, None), (HAND, MarkerLayout()), (Hand.scaled(.165, .073), None),
    (Hand.scaled(.205, .095, side='left'), None)),
    ids=('skin', 'joints', 'small', 'large left'))
def test_the_range_of_motion_shows_everything(hand, layout):
    assert min(shown(ranged(hand), hand, layout).values()) == 1.


def test_it_does_with_gaps_too():
    shares = shown(ranged(), hide=.1)
    assert min(shares.values()) == 1., shares


def test_a_still_hand_shows_its_shape_alone():
    still = shown(np.repeat(pose_angles('open', HAND)[None], 300, axis=0))
    assert still.pop('open hand') == 1.
    assert max(still.values()) < .1, still


def test_open_and_fist_show_no_finger_alone():
    shares = shown(between('open', 'fist', 'open'))
    assert shares['open hand'] == shares['fist'] == 1.
    assert max(shares[f'{finger} finger'] for finger in ('index', 'middle', 'ring', 'little')) < 1.
    # A closing fist passes the thumb by the index finger.
    assert max(shares[name] for name in NAMES[8:]) < 1.


@pytest.mark.parametrize('finger', ('index', 'middle', 'ring', 'little'))
def test_each_opposition_shows_its_finger(finger):
    shares = shown(between('ready', f'oppose_{finger}', 'ready'))
    assert shares.pop(f'thumb to {finger}') == 1.
    assert max(shares[f'thumb to {other}'] for other in ('index', 'middle', 'ring', 'little')
               if other != finger) < 1.


def test_the_other_side_and_single_strays_show_nothing_more():
    angles = np.repeat(pose_angles('open', HAND)[None], 60, axis=0)
    markers = worn_markers(HAND, skin_layout(HAND), angles)
    before = shown_shares(markers, 'right')
    markers[10:13, MARKERS.index('index')] += (0., 0., -.1)
    markers[20] = 1e300
    np.testing.assert_allclose(shown_shares(markers, 'right'), before, atol=1e-6)
    assert not shown_shares(np.full((40, 8, 3), np.nan), 'left').any()
    assert not shown_shares(np.empty((0, 8, 3)), 'right').any()
