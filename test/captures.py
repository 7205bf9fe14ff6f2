"""Captures of real hands, kept apart from the project: found, loaded, made into recordings.

The folder is `HAND_TRACKER_CAPTURES`, or `../shared/data` from the project's root. To make
a recording of a capture: `python test/captures.py FILE.npz OUT.mcap`.
"""

import argparse
import os
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from hand_tracker.calibration import LANDMARKS
from hand_tracker.core.layout import MARKERS, PAPER_PLACES
from hand_tracker.files.bags import bag_message, marker_array_message, write_bag

VARIABLE = 'HAND_TRACKER_CAPTURES'
ROOT = Path(__file__).resolve().parent.parent
ASSUMED_RATE = 30.  # [Hz] of captures that do not say theirs
START_NS = 1_700_000_000_000_000_000
MARKER_ROWS = [LANDMARKS.index(place) for place in PAPER_PLACES]


class Capture(NamedTuple):
    """A captured hand.

    Attributes
    ----------
    joints : ndarray, shape (T, 21, 3)
        In the order of `LANDMARKS`, NaN where not captured [m].
    side : {'right', 'left'}
    rate : float
        [Hz]
    """

    joints: np.ndarray
    side: str
    rate: float

    @property
    def markers(self):
        """Return the paper's eight markers, shape (T, 8, 3), NaN where not captured [m]."""
        return self.joints[:, MARKER_ROWS]

    @property
    def stamps(self):
        """Return the time of each frame, shape (T,) [ns]."""
        return START_NS + np.round(np.arange(len(self.joints)) * (1e9 / self.rate)).astype(np.int64)

    def mirrored_to_right(self):
        """Return the capture as that of a right hand."""
        if self.side == 'right':
            return self
        return self._replace(joints=self.joints * (1., -1., 1.), side='right')


def capture_folder():
    """Return where the captures are, whether or not there are any."""
    return Path(os.environ.get(VARIABLE) or ROOT.parent / 'shared' / 'data')


def capture_path(name):
    """Return the file of a capture; the test that asks is skipped where it is absent."""
    path = capture_folder() / f'{name}.npz'
    if not path.exists():
        pytest.skip(f'no capture {path}; set {VARIABLE} to the folder that has it')
    return path


def load_capture(path):
    """Return a capture of 21 joints.

    Parameters
    ----------
    path : path-like
        npz file with `positions`, `joints`, `side` and `rate_hz`.

    Returns
    -------
    Capture

    Raises
    ------
    ValueError
        If its joints are not the 21 of `LANDMARKS`.
    """
    with np.load(path) as data:
        if len(data['joints']) != len(LANDMARKS) or data['positions'].shape[1:] != (21, 3):
            raise ValueError(f'{path}: {len(data["joints"])} joints, positions of shape '
                             f'{data["positions"].shape}; expected {len(LANDMARKS)} joints')
        joints = data['positions'].astype(float)
        side = str(data['side'])
        rate = float(data['rate_hz'])
    # A joint without one coordinate is not captured.
    joints[~np.isfinite(joints).all(axis=2)] = np.nan
    return Capture(joints, side, rate if np.isfinite(rate) and rate > 0. else ASSUMED_RATE)


def capture_messages(capture, topic='/markers', frame_id='mocap'):
    """Yield a capture's markers as messages, one MarkerArray for each frame.

    Parameters
    ----------
    capture : Capture
    topic, frame_id : str

    Yields
    ------
    BagMessage
    """
    for stamp, markers in zip(capture.stamps.tolist(), capture.markers):
        yield bag_message(topic, stamp, marker_array_message(stamp, frame_id, MARKERS, markers))


def main():
    parser = argparse.ArgumentParser(description='Make a recording of a capture.')
    parser.add_argument('capture', type=Path, help='npz file')
    parser.add_argument('recording', type=Path, help='.mcap or .db3 file to write')
    arguments = parser.parse_args()
    write_bag(arguments.recording, capture_messages(load_capture(arguments.capture)))


if __name__ == '__main__':
    main()
