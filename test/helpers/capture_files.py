"""Captures of real hands, kept apart from the project: found, and made into recordings.

The folder is `HAND_TRACKER_CAPTURES`, or `../shared/data` from the project's root. To make
a recording of a capture: `python test/helpers/capture_files.py FILE.npz OUT.mcap`.
"""

import argparse
import os
from pathlib import Path

import numpy as np
import pytest

from hand_tracker.core.model.marker_layout import MARKERS
from hand_tracker.evaluation.captures import load_capture
from hand_tracker.files.bags import bag_message, marker_array_message, write_bag

VARIABLE = 'HAND_TRACKER_CAPTURES'
START_NS = 1_700_000_000_000_000_000


def capture_folder():
    """Return where the captures are, whether or not there are any."""
    return Path(os.environ.get(VARIABLE) or Path(__file__).resolve().parents[3] / 'shared' / 'data')


def capture_path(name):
    """Return the file of a capture; the test that asks is skipped where it is absent."""
    return capture_file(f'{name}.npz')


def capture_file(name):
    """Return a file in the folder of captures; the test that asks is skipped without it."""
    path = capture_folder() / name
    if not path.exists():
        pytest.skip(f'no capture {path}; set {VARIABLE} to the folder that has it')
    return path


def capture_stamps(capture):
    """Return the time of each frame, shape (T,) [ns]."""
    return START_NS + np.round(np.arange(len(capture.joints)) * (1e9 / capture.rate)).astype(
        np.int64)


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
    for stamp, markers in zip(capture_stamps(capture).tolist(), capture.markers):
        yield bag_message(topic, stamp, marker_array_message(stamp, frame_id, MARKERS, markers))


def main():
    parser = argparse.ArgumentParser(description='Make a recording of a capture.')
    parser.add_argument('capture', type=Path, help='npz file')
    parser.add_argument('recording', type=Path, help='.mcap or .db3 file to write')
    arguments = parser.parse_args()
    write_bag(arguments.recording, capture_messages(load_capture(arguments.capture)))


if __name__ == '__main__':
    main()
