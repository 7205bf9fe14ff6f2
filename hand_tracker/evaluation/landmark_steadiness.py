"""Landmarks of cameras and headsets: how bones breathe and points jitter, as given and tracked.

Each capture is taken as a stream of 21 landmarks (layout `mediapipe21`), the hand fitted to its
first fifth, the rest judged. `simulated camera` is the demo motion at 30 Hz as a camera's estimate
has it, in the way of GeoRT's recordings: the whole hand's size breathes by 3 % within seconds, each
landmark wanders by 2 mm and jitters by 1 mm; there the truth is known. Breathing is the standard
deviation of a bone's length, mean of the 20 bones. Jitter is the standard deviation of white noise
that would have the same third differences: a fast motion has some at 30 Hz, as the truth shows.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

from ..calibration import LANDMARKS
from ..core.model.hand import DIGITS
from ..core.model.layout_presets import preset_layout
from ..core.numerics.differences import THIRD_GAIN
from ..core.tracker import HandTracker
from .capture_fit import fit_to_capture
from .capture_tracking import track_markers, tracked_joints
from .captures import Capture, InvalidCapture
from .demo_frames import demo_frames
from .evaluation_options import Options
from .rows import Row, error_statistics
from .tables import Picture, Table, fixed, mean_and_p95, words

LANDMARK_LAYOUT = 'mediapipe21'
GIVEN, STEADIED, TRUE_JOINTS = 'as given', 'hand_tracker', 'truth'
SIMULATED_CAMERA = 'simulated camera'
CAMERA_RATE = 30.                  # [Hz]
BREATHING, BREATHING_TIME = .03, 2.    # of the size; [s]
WANDERING, WANDERING_TIME = .002, .3   # [m]; [s]
WHITE_NOISE = .001                 # [m]
SECONDS_OF_CAMERA = 40.
BONES = np.array([(LANDMARKS.index('wrist' if not k else f'{digit}_{chain[k - 1]}'),
                   LANDMARKS.index(f'{digit}_{chain[k]}'))
                  for digit in DIGITS
                  for chain in [('cmc', 'mcp', 'ip', 'tip') if digit == 'thumb'
                                else ('mcp', 'pip', 'dip', 'tip')] for k in range(4)])


def evaluate(options: Options) -> Iterator[Row]:
    """Yield rows for each recording: `as given`, tracked, and where it is known the `truth`.

    `breathing_mm` and `jitter_mm` are as above; `mean_mm` and `p95_mm` are distances of the tracked
    joints from the given landmarks (0 as given), `truth_mm` the mean distance from the truth.
    """
    camera, truth = simulated_camera(options.seed)
    tasks = [(camera, truth), *((capture, None) for capture in options.captures)]
    yield from options.judge_each('recordings', judge, tasks, lambda task: task[0].name,
                                  InvalidCapture('none of the captures can be judged'))


def simulated_camera(seed: int) -> tuple[Capture, np.ndarray]:
    """Return the demo motion as a camera's estimate, and its true joints (T, 21, 3) [m]."""
    rng = np.random.default_rng(seed)
    truth = demo_frames(CAMERA_RATE).joints
    truth = np.tile(truth, (-(-round(SECONDS_OF_CAMERA * CAMERA_RATE) // len(truth)), 1, 1))

    def slow(seconds: float, *shape: int) -> np.ndarray:
        """Return AR(1) noise of unit variance with a correlation time [s]."""
        keep = np.exp(-1. / (seconds * CAMERA_RATE))
        white = rng.normal(size=(len(truth), *shape))
        white[1:] *= np.sqrt(1. - keep**2)
        return np.asarray(lfilter([1.], [1., -keep], white, axis=0))

    wrist = truth[:, :1]
    seen = wrist + (1. + BREATHING * slow(BREATHING_TIME, 1, 1)) * (truth - wrist)
    seen = seen + WANDERING * slow(WANDERING_TIME, *truth.shape[1:])
    seen += WHITE_NOISE * rng.normal(size=truth.shape)
    return Capture(SIMULATED_CAMERA, seen, 'right', CAMERA_RATE), truth


def judge(task: tuple[Capture, np.ndarray | None]) -> list[Row]:
    """Return the rows of a capture, with its true joints where they are known."""
    capture, truth = task
    layout = preset_layout(LANDMARK_LAYOUT)
    hand = fit_to_capture(capture, 'wide')
    given = capture.joints[capture.split:]
    columns = [LANDMARKS.index(place) for place in layout.places]
    tracked = tracked_joints(hand, track_markers(
        HandTracker(hand, layout), given[:, columns], capture.rate))
    judged = np.isfinite(given).all(axis=(1, 2)) & np.isfinite(tracked).all(axis=(1, 2))
    methods = {GIVEN: given, STEADIED: tracked}
    if truth is not None:
        truth = methods[TRUE_JOINTS] = truth[capture.split:]
    rows = []
    for method, joints in methods.items():
        distances = np.linalg.norm(joints - given, axis=2)[judged]
        row = {'evaluation': 'landmarks', 'recording': capture.name, 'method': method,
               'joint_class': 'all',
               'breathing_mm': round(1e3 * breathing(joints[judged]), 4),
               'jitter_mm': round(1e3 * jitter(joints, judged), 4),
               **error_statistics(distances), 'frames': int(judged.sum())}
        if truth is not None:
            errors = np.linalg.norm(joints - truth, axis=2)[judged]
            row['truth_mm'] = round(1e3 * float(errors.mean()), 4)
        rows.append(row)
    return rows


def breathing(joints: np.ndarray) -> float:
    """Return the standard deviation of a bone's length, mean of all bones, (T, 21, 3) [m]."""
    lengths = np.linalg.norm(joints[:, BONES[:, 1]] - joints[:, BONES[:, 0]], axis=2)
    return float(lengths.std(axis=0).mean())


def jitter(joints: np.ndarray, judged: np.ndarray) -> float:
    """Return the jitter of points, (T, 21, 3), over judged frames in a row, (T,) bool [m]."""
    in_a_row = judged[3:] & judged[2:-1] & judged[1:-2] & judged[:-3]
    differences = np.diff(joints, 3, axis=0)[in_a_row]
    return float(np.sqrt(np.mean(differences**2) / THIRD_GAIN))


def tables(rows: list[Row]) -> list[Table]:
    """Return the table of all recordings."""
    lines = []
    for recording in dict.fromkeys(row['recording'] for row in rows):
        of = {row['method']: row for row in rows if row['recording'] == recording}
        lines.append((words(recording), *(
            fixed(of[method][key], 3) for key in ('breathing_mm', 'jitter_mm')
            for method in (GIVEN, STEADIED)), fixed(of.get(TRUE_JOINTS, {}).get('jitter_mm'), 3),
            mean_and_p95(of[STEADIED]),
            *(fixed(of[method].get('truth_mm')) for method in (GIVEN, STEADIED))))
    return [Table('Standard deviations and distances, mm; distances mean (p95)', (
        'recording', 'bones, given', 'bones, tracked', 'jitter, given', 'jitter, tracked',
        'jitter, truth', 'tracked from given', 'given from truth', 'tracked from truth'), lines)]


def pictures(rows: list[Row], folder: Path) -> list[Picture]:
    """Return no pictures: the table says it."""
    return []
