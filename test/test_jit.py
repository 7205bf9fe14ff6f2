"""The switch: kernels give the same numbers compiled and as plain Python."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[1]
PROGRAM = """
import sys
import numpy as np
from hand_tracker.core import jit
from hand_tracker.core.hand import Hand
from hand_tracker.core.kinematics import forward, joint_table
from hand_tracker.core.layout import MarkerLayout, marker_positions
from hand_tracker.core.tracker import HandTracker, TrackerOptions

assert jit.COMPILED == (sys.argv[1] == '1'), jit.COMPILED
rng = np.random.default_rng(1)
hand = Hand.scaled(side='left')
mounting = MarkerLayout().mounting(hand)
rows = []
for options in (TrackerOptions(), TrackerOptions('spheres', 'fabrik')):
    tracker = HandTracker(hand, options=options)
    lower, upper = hand.limits.T
    phase = rng.uniform(0., 6., 25)
    for frame in range(60):
        angles = lower + (upper - lower) * (.5 + .3 * np.sin(phase + .1 * frame))
        markers = marker_positions(mounting, forward(joint_table(hand), angles))
        markers += rng.normal(scale=.0005, size=(8, 3))
        if 20 <= frame < 50:
            markers[[0, 4, 6][:frame // 10 - 1]] = np.nan
        if frame in (15, 35):
            markers[[3, 5]] = markers[[5, 3]]
        if frame == 55:
            markers[7] += .1
        state = tracker.update(markers)
        rows.append(np.concatenate((state.angles, state.confidence, state.marker_states,
                                    state.wrist_position, state.pose.position.ravel())))
np.save(sys.argv[2], rows)
"""


def rows(tmp_path, switch):
    out = tmp_path / f'{switch}.npy'
    environment = {**os.environ, 'HAND_TRACKER_JIT': switch, 'PYTHONPATH': os.pathsep.join(
        [str(ROOT), os.environ.get('PYTHONPATH', '')])}
    subprocess.run([sys.executable, '-c', PROGRAM, switch, str(out)], check=True, env=environment)
    return np.load(out)


def test_compiled_and_plain_kernels_agree(tmp_path):
    pytest.importorskip('numba', reason='numba is not installed: there is only plain Python')
    compiled, plain = rows(tmp_path, '1'), rows(tmp_path, '0')
    # What feeds back, FABRIK and separating, makes rounding grow, and a straight finger does.
    np.testing.assert_allclose(compiled, plain, atol=1e-6)


def test_the_switch_turns_numba_off(tmp_path):
    assert np.isfinite(rows(tmp_path, '0')).all()
