"""Jitter, gain and lag of a single PIP under marker noise, with and without smoothing.

An exact hand model with markers at the joints, 0.3 mm of noise at 120 Hz. The index PIP rests
while the hand is still or sways by 10 mm at 0.3 Hz, or it swings at 10 Hz while the hand is still.
The first two seconds, in which the noise is estimated, are left out. Four draws of the noise are
judged, which differ much for a swaying hand and for small swings.
"""

from typing import NamedTuple

import numpy as np

from ..calibration import landmark_positions
from ..core.model.hand import FLEXION_JOINTS, JOINTS, Hand
from ..core.model.kinematics import forward, joint_table
from ..core.model.marker_layout import MarkerLayout, marker_positions
from ..core.options import TrackerOptions
from ..core.tracker import HandTracker
from .capture_tracking import track_markers, tracked_joints
from .metrics import joint_errors
from .rows import Row, error_statistics
from .tables import Table, fixed

PIP_RATE = 120.                        # [Hz]
PIP_DURATION, LEARNING_TIME = 8., 2.   # [s]
NOISE_DRAWS = 4
USUAL_NOISE = .3                       # [mm] standard deviation per axis
OTHER_PIPS = 15.                       # [degrees] flexion of the other digits' second joints
SWAY_AMPLITUDE, SWAY_FREQUENCY = .01, .3                 # [m], [Hz]
SWING_FREQUENCY = 10.                                    # [Hz]
REST_ANGLES = (10., 15., 20., 30., 45., 60.)             # [degrees]
SWING_ANGLES = ((15., 5.), (15., 10.), (30., 2.), (30., 5.), (30., 10.),
                (45., 2.), (45., 5.), (45., 10.))        # mean and amplitude [degrees]
INDEX_PIP = JOINTS.index('index_pip_flexion')


class PipTask(NamedTuple):
    """Motion of the index PIP and of the hand.

    Attributes
    ----------
    pip, swing : float
        Mean and amplitude of the PIP's flexion [degrees].
    sway : float
        Amplitude of the hand's sway [m].
    """

    pip: float
    swing: float
    sway: float


def pip_tasks() -> list[PipTask]:
    """Return the judged motions: rests of a still and of a swaying hand, then swings."""
    return [PipTask(pip, 0., sway) for sway in (0., SWAY_AMPLITUDE) for pip in REST_ANGLES] + [
        PipTask(pip, swing, 0.) for pip, swing in SWING_ANGLES]


def judge(task: PipTask, seed: int) -> Row:
    """Return the row of one motion.

    Prefix `raw` is without smoothing, `smoothed` with it: `jitter_degrees` is the standard
    deviation of a resting PIP, `gain` and `lag_ms` are the response of a swinging one, as mean,
    least and greatest over draws. Joint errors are with smoothing.
    """
    pip, swing, sway = task
    row: Row = {'evaluation': 'noise', 'recording': 'one PIP', 'method': 'hand_tracker',
                'joint_class': 'all', 'sweep': 'swing' if swing else 'rest',
                'noise_mm': USUAL_NOISE, 'pip': pip, 'swing_degrees': swing, 'sway_mm': 1e3 * sway}
    for name, smoothing in (('raw', False), ('smoothed', True)):
        found, true, errors = map(np.array, zip(*(
            _tracked_pip(PipTask(*task), TrackerOptions(smoothing=smoothing), (seed, draw))
            for draw in range(NOISE_DRAWS))))
        if swing:
            wave = np.exp(-2j * np.pi * SWING_FREQUENCY / PIP_RATE * np.arange(found.shape[1]))
            response = (found @ wave) / (true @ wave)
            lags = -1e3 * np.angle(response) / (2. * np.pi * SWING_FREQUENCY)
            row.update({f'{name}_{key}{suffix}': round(float(of(values)), 4)
                        for key, values in (('gain', np.abs(response)), ('lag_ms', lags))
                        for suffix, of in (('', np.mean), ('_min', np.min), ('_max', np.max))})
        else:
            row[f'{name}_jitter_degrees'] = round(
                float(np.degrees(np.sqrt(found.var(axis=1).mean()))), 5)
    return {**row, **error_statistics(errors), 'frames': true.size}


def _tracked_pip(task: PipTask, options: TrackerOptions, seed: int | tuple[int, ...]
                 ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the index PIP as tracked after the noise has been estimated, and the truth.

    Parameters
    ----------
    task : PipTask
    options : TrackerOptions
    seed : int or tuple of int
        Of the marker noise.

    Returns
    -------
    found, true : ndarray, shape (n,)
        Flexion [rad].
    errors : ndarray
        Position errors of all joints [m].
    """
    pip, swing, sway = task
    hand, layout = Hand.scaled(), MarkerLayout()
    times = np.arange(round(PIP_DURATION * PIP_RATE)) / PIP_RATE
    angles = np.zeros((len(times), len(JOINTS)))
    angles[:, FLEXION_JOINTS[:, 1]] = np.radians(OTHER_PIPS)
    angles[:, INDEX_PIP] = np.radians(pip + swing * np.sin(2. * np.pi * SWING_FREQUENCY * times))
    angles = hand.coupled(angles, hand.limits)
    position = np.outer(sway * np.sin(2. * np.pi * SWAY_FREQUENCY * times), (1., 0., 0.))
    rotation = np.tile(np.eye(3), (len(times), 1, 1))
    pose = forward(joint_table(hand), angles, rotation, position)
    markers = marker_positions(layout.mounting(hand), pose, rotation, position)
    noise = 1e-3 * USUAL_NOISE * np.random.RandomState(seed).normal(size=markers.shape)
    tracked = track_markers(HandTracker(hand, layout, options), markers + noise, PIP_RATE)
    later = slice(round(LEARNING_TIME * PIP_RATE), None)
    errors = joint_errors(tracked_joints(hand, tracked)[later],
                          landmark_positions(hand, pose, position)[later])['all']
    return tracked.angles[later, INDEX_PIP], angles[later, INDEX_PIP], errors


def tables(rows: list[Row]) -> list[Table]:
    """Return the tables of resting and of swinging PIPs."""
    rest = [(f'{row["pip"]:g}', 'swaying' if row['sway_mm'] else 'still',
             *(fixed(row[f'{name}_jitter_degrees'], 3) for name in ('raw', 'smoothed')),
             fixed(row['raw_jitter_degrees'] / row['smoothed_jitter_degrees'], 1))
            for row in rows if row['sweep'] == 'rest']
    swing = [(f'{row["pip"]:g} ± {row["swing_degrees"]:g}', *(
        '{} ({} to {})'.format(*(fixed(row[f'{name}_{key}{suffix}'], digits)
                                 for suffix in ('', '_min', '_max')))
        for key, digits in (('gain', 2), ('lag_ms', 1)) for name in ('raw', 'smoothed')))
        for row in rows if row['sweep'] == 'swing']
    return [
        Table('Jitter of an index PIP at rest, standard deviation at '
              f'{USUAL_NOISE:g} mm of noise, in a hand that is still or sways by '
              f'{1e3 * SWAY_AMPLITUDE:g} mm at {SWAY_FREQUENCY:g} Hz',
              ('PIP, deg', 'hand', 'raw, deg', 'smoothed, deg', 'ratio'), rest),
        Table(f'Gain and lag of an index PIP that swings at {SWING_FREQUENCY:g} Hz, at '
              f'{USUAL_NOISE:g} mm of noise, mean (least to most) over draws',
              ('PIP, deg', 'gain, raw', 'smoothed', 'lag, raw, ms', 'smoothed, ms'), swing)]
