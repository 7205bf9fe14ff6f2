"""What noise of the markers does to one PIP, with and without smoothing: jitter, gain and lag.

A hand of exactly known size, its markers on its joints, 0.3 mm of noise at 120 Hz. Its index
PIP rests, while the hand is still or sways by 10 mm at 0.3 Hz, or swings at 10 Hz while the hand
is still. The first two seconds, in which the noise is learned, do not count. Four draws of the
noise are judged: they differ much where the hand sways or swings little.
"""

import numpy as np

from ..calibration import landmark_positions
from ..core.model.hand import FLEXION_JOINTS, JOINTS, Hand
from ..core.model.kinematics import forward, joint_table
from ..core.model.marker_layout import MarkerLayout, marker_positions
from ..core.options import TrackerOptions
from ..core.tracker import HandTracker
from .capture_tracking import track, tracked_joints
from .metrics import joint_errors
from .rows import spread
from .tables import Table, number

RATE = 120.             # [Hz]
SECONDS, LEARNING = 8., 2.
DRAWS = 4
NOISE = .3              # [mm] standard deviation per axis
OTHERS = 15.            # [degrees] of the other digits' second joints
SWAY, SWAYING = .01, .3  # [m], [Hz]
SWINGING = 10.          # [Hz]
RESTS = (10., 15., 20., 30., 45., 60.)   # [degrees]
SWINGS = ((15., 5.), (15., 10.), (30., 2.), (30., 5.), (30., 10.),
          (45., 2.), (45., 5.), (45., 10.))  # middle and amplitude [degrees]
PIP = JOINTS.index('index_pip_flexion')


def tasks():
    """Return (PIP, amplitude of its swing [degrees], of the hand's sway [m]) of what is judged."""
    return [(pip, 0., sway) for sway in (0., SWAY) for pip in RESTS] + [
        (pip, swing, 0.) for pip, swing in SWINGS]


def judge(task, seed):
    """Return the row of a task.

    `raw_...` is without smoothing, `smoothed_...` with it: `jitter_degrees` the standard
    deviation of a resting PIP, `gain` and `lag_ms` of a swinging one against the truth, means
    over draws beside the least and the most. Errors of joints are those with smoothing.
    """
    pip, swing, sway = task
    row = {'evaluation': 'noise', 'recording': 'one PIP', 'method': 'hand_tracker',
           'joint_class': 'all', 'sweep': 'swing' if swing else 'rest', 'noise_mm': NOISE,
           'pip': pip, 'swing_degrees': swing, 'sway_mm': 1e3 * sway}
    for name, smoothing in (('raw', False), ('smoothed', True)):
        found, true, errors = map(np.array, zip(*(
            pip_of(*task, TrackerOptions(smoothing=smoothing), (seed, draw))
            for draw in range(DRAWS))))
        if swing:
            wave = np.exp(-2j * np.pi * SWINGING / RATE * np.arange(found.shape[1]))
            response = (found @ wave) / (true @ wave)
            lags = -1e3 * np.angle(response) / (2. * np.pi * SWINGING)
            row.update({f'{name}_{key}{suffix}': round(float(of(values)), 4)
                        for key, values in (('gain', np.abs(response)), ('lag_ms', lags))
                        for suffix, of in (('', np.mean), ('_min', np.min), ('_max', np.max))})
        else:
            row[f'{name}_jitter_degrees'] = round(
                float(np.degrees(np.sqrt(found.var(axis=1).mean()))), 5)
    return {**row, **spread(errors), 'frames': true.size}


def pip_of(pip, swing, sway, options, seed):
    """Return what the tracker says of the index PIP once it has learned the noise.

    Parameters
    ----------
    pip, swing : float
        Middle and amplitude of its flexion [degrees].
    sway : float
        Amplitude of the hand's [m].
    options : TrackerOptions
    seed : int or sequence of int

    Returns
    -------
    found, true : ndarray, shape (n,)
        [rad]
    errors : ndarray
        Of all joints [m].
    """
    hand, layout = Hand.scaled(), MarkerLayout()
    times = np.arange(round(SECONDS * RATE)) / RATE
    angles = np.zeros((len(times), len(JOINTS)))
    angles[:, FLEXION_JOINTS[:, 1]] = np.radians(OTHERS)
    angles[:, PIP] = np.radians(pip + swing * np.sin(2. * np.pi * SWINGING * times))
    angles[:, FLEXION_JOINTS[:, 2]] = (
        hand.coupling[:, 0] * angles[:, FLEXION_JOINTS[:, 1]] + hand.coupling[:, 1])
    position = np.outer(sway * np.sin(2. * np.pi * SWAYING * times), (1., 0., 0.))
    rotation = np.tile(np.eye(3), (len(times), 1, 1))
    pose = forward(joint_table(hand), angles, rotation, position)
    markers = marker_positions(layout.mounting(hand), pose, rotation, position)
    noise = 1e-3 * NOISE * np.random.RandomState(seed).normal(size=markers.shape)
    tracked = track(HandTracker(hand, layout, options), markers + noise, RATE)
    later = slice(round(LEARNING * RATE), None)
    errors = joint_errors(tracked_joints(hand, tracked)[later],
                          landmark_positions(hand, pose, position)[later])['all']
    return tracked.angles[later, PIP], angles[later, PIP], errors


def tables(rows):
    """Return the table of rests and that of swings."""
    rest = [(f'{row["pip"]:g}', 'swaying' if row['sway_mm'] else 'still',
             *(number(row[f'{name}_jitter_degrees'], 3) for name in ('raw', 'smoothed')),
             number(row['raw_jitter_degrees'] / row['smoothed_jitter_degrees'], 1))
            for row in rows if row['sweep'] == 'rest']
    swing = [(f'{row["pip"]:g} ± {row["swing_degrees"]:g}', *(
        '{} ({} to {})'.format(*(number(row[f'{name}_{key}{suffix}'], digits)
                                 for suffix in ('', '_min', '_max')))
        for key, digits in (('gain', 2), ('lag_ms', 1)) for name in ('raw', 'smoothed')))
        for row in rows if row['sweep'] == 'swing']
    return [
        Table(f'Jitter of an index PIP at rest, standard deviation at {NOISE:g} mm of noise, in a '
              f'hand that is still or sways by {1e3 * SWAY:g} mm at {SWAYING:g} Hz',
              ('PIP, deg', 'hand', 'raw, deg', 'smoothed, deg', 'ratio'), rest),
        Table(f'Gain and lag of an index PIP that swings at {SWINGING:g} Hz, at {NOISE:g} mm of '
              'noise, mean (least to most) over draws',
              ('PIP, deg', 'gain, raw', 'smoothed', 'lag, raw, ms', 'smoothed, ms'), swing)]
