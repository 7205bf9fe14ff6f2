"""The palm's cupping per flexion of ring and little finger, against a simulated palm."""

import numpy as np
import pytest

from hand_tracker.calibration.palm_synergy import fit_palm_synergy
from hand_tracker.core.model.hand import FINGERS, FLEXION_JOINTS, Hand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.layout_presets import preset_layout
from hand_tracker.core.model.marker_layout import marker_positions

HAND = Hand.scaled().with_open_palm()
LAYOUT = preset_layout('kyutech23')
NOISE = 5e-4  # [m]


def cupping_palm(gains, greatest=1.4):
    """Return markers of the palm, turned as a rigid fit of all would, and the postures."""
    flexion = np.linspace(0., greatest, 60)
    postures = np.zeros((len(flexion), 25))
    postures[:, FLEXION_JOINTS[:4, 0]] = flexion[:, None]
    postures[:, [5 * finger for finger in range(4)]] = flexion[:, None] * gains
    pose = forward(joint_table(HAND), postures)
    markers = marker_positions(LAYOUT.mounting(HAND), pose)
    lean = .02 * flexion
    turn = np.array([((1., 0., 0.), (0., np.cos(a), -np.sin(a)), (0., np.sin(a), np.cos(a)))
                     for a in lean])
    markers = markers @ turn.swapaxes(1, 2) + np.random.default_rng(0).normal(
        scale=NOISE, size=markers.shape)
    names = [f'{place}_{row}' if place == 'wrist' else place
             for row, place in enumerate(LAYOUT.places)]
    return {name: markers[:, row] for row, name in enumerate(names)
            if name.startswith('wrist') or name in (f'{one}_mcp' for one in FINGERS)}, postures


@pytest.mark.parametrize('gains', [(0., 0., .15, .3), (0., 0., 0., .05), (0., 0., .3, .45)])
def test_knuckles_tell_how_the_palm_cups(gains):
    palm, postures = cupping_palm(gains)
    np.testing.assert_allclose(fit_palm_synergy(HAND, palm, postures), gains, atol=.03)


def test_what_no_knuckle_shows_stays():
    palm, postures = cupping_palm((0., 0., .4, .5))
    del palm['ring_mcp']
    ring, little = fit_palm_synergy(HAND, palm, postures)[2:]
    assert ring == HAND.palm_synergy[2] and little == pytest.approx(.5, abs=.03)
    few = {name: palm[name] for name in ('wrist_19', 'index_mcp', 'little_mcp')}
    np.testing.assert_array_equal(fit_palm_synergy(HAND, few, postures), HAND.palm_synergy)
    # A hand that hardly flexes tells little.
    still, postures = cupping_palm((0., 0., .5, .6), greatest=.02)
    np.testing.assert_allclose(
        fit_palm_synergy(HAND, still, postures), HAND.palm_synergy, atol=.1)
