"""Whatever comes in, only sense goes out: `benchmarks/fuzz.py` in short."""

import os

from benchmarks.fuzz import fuzz

FRAMES = int(os.environ.get('HAND_TRACKER_FUZZ_FRAMES', 10_000))


def test_random_frames_never_fail():
    did, _, _ = fuzz(FRAMES, seed=2)
    # And there was enough of everything.
    for what in ('palm TRACKED', 'palm CARRIED', 'palm LOST', 'marker SEEN', 'marker PREDICTED',
                 'marker REJECTED', 'marker SWAPPED', 'marker STALE', 'configured options',
                 'nonsense', 'stamps any', 'distal flexion wild'):
        assert did[what] > FRAMES / 5000, what
