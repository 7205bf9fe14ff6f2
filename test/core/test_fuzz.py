"""Whatever comes in, only sense goes out: `benchmarks/fuzz.py` in short."""

import os

from benchmarks.fuzz import fuzz, fuzz_clouds

FRAMES = int(os.environ.get('HAND_TRACKER_FUZZ_FRAMES', 10_000))


def test_random_frames_never_fail():
    did, _, _ = fuzz(FRAMES, seed=2)
    # And there was enough of everything.
    for what in ('palm TRACKED', 'palm CARRIED', 'palm LOST', 'marker SEEN', 'marker PREDICTED',
                 'marker REJECTED', 'marker SWAPPED', 'marker STALE', 'configured options',
                 'nonsense', 'stamps any', 'distal flexion wild'):
        assert did[what] > FRAMES / 5000, what


def test_random_clouds_of_one_hand_and_of_two_never_fail():
    did, _, _ = fuzz_clouds(FRAMES // 10, seed=2)
    for what in ('hand found', 'hand not found', 'palm TRACKED', 'palm LOST', 'marker SEEN',
                 'nonsense', 'with hidden markers'):
        assert did[what] > FRAMES / 5000, what
