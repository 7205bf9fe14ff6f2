"""Names of the simulated motions, and what their options are unless said: imports nothing."""

from __future__ import annotations

MOTION_NAMES = ('demo', 'spelling', 'power_grasp', 'precision_grasp', 'lateral_grasp', 'typing',
                'piano', 'shaking', 'tremor', 'range_of_motion')
MOTION_DURATION = 20.       # [s]
PAPER_RATE = 480.           # [Hz] of the paper's cameras
