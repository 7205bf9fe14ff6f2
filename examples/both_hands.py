"""Track both hands of a person: a tracker for each, frame by frame, on one clock."""

from pathlib import Path

import numpy as np

from hand_tracker import Hand, HandTracker
from hand_tracker.files.bags import open_bag
from hand_tracker.tracking.recording import marker_topic, track

RECORDING_FOLDER = Path(__file__).resolve().parents[1] / 'recordings'


def tracked(side, file):
    """Return the tracked frames of one hand's recording, by their stamps."""
    with open_bag(RECORDING_FOLDER / file) as bag:
        tracker = HandTracker(Hand.scaled(side=side))
        frames = track(bag.messages([marker_topic(bag)]), tracker)
        return {frame.stamp: frame.state for frame, _ in zip(frames, range(600))}


right, left = tracked('right', 'demo.mcap'), tracked('left', 'demo_left.mcap')
together = sorted(right.keys() & left.keys())
apart = [np.linalg.norm(right[stamp].wrist_position - left[stamp].wrist_position)
         for stamp in together]
print(f'{len(together)} frames of both hands, wrists {np.mean(apart):.2f} m apart')
