"""Recordings of points for tests of files: markers of a moving hand."""

from functools import cache

import numpy as np

from hand_tracker.core.model.hand import Hand
from hand_tracker.files.point_recording import Axes, PointRecording
from hand_tracker.simulation.packaged_recordings import demo_recording

# Names as a person writes them, in the order of `MARKERS`.
WRITTEN_NAMES = ('Wrist', 'IndexMCP', 'PinkyMCP', 'IndexDIP', 'MiddleDIP', 'RingDIP', 'PinkyDIP',
                 'ThumbTip')
FRAMES = 60


@cache
def demo(side):
    return demo_recording(Hand.scaled(side=side))


def hand_recording(frames=FRAMES, side='right', labels=None, start=0):
    """Return some frames of the packaged recording of a side as points with labels."""
    points = demo(side).markers[start:start + frames].astype(np.float32)
    if labels is None:
        labels = tuple(f'{side[0].upper()}_{name}' for name in WRITTEN_NAMES)
    return PointRecording('hand', 'test', labels, points, 120., None, Axes('m', 'z'))


def gappy_recording(frames=FRAMES):
    """Return frames of a hand in which one marker is missing for some frames, and one for all."""
    recording = hand_recording(frames)
    recording.points[5:9, 4] = np.nan
    recording.points[:, 6] = np.nan
    return recording
