"""What comes before the tests."""

import importlib.util
import subprocess
import sys
import warnings
from pathlib import Path

UPDATE = """
from hand_tracker.core.tracker import HandTracker
tracker = HandTracker()
tracker.update([[0.] * 3] * 8)
tracker.update([[0.] * 3] * 8, distal_flexion=[0.] * 5)
"""
DIRECT = UPDATE + """
from contextlib import suppress
from hand_tracker.nodes.fast_path.middleware import Direct
from hand_tracker.nodes.fast_path.rcl import Unavailable
from hand_tracker.nodes.serialization import codec_agrees
codec_agrees()
with suppress(Unavailable):
    Direct(tracker)
"""


def pytest_configure(config):
    """Compile the kernels once, where several processes would do so side by side."""
    if not getattr(config.option, 'numprocesses', None) or hasattr(config, 'workerinput'):
        return
    program = DIRECT if importlib.util.find_spec('rclpy') else UPDATE
    done = subprocess.run([sys.executable, '-c', program], cwd=Path(__file__).parents[1],
                          stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    if done.returncode:
        warnings.warn(f'the kernels were not compiled: {done.stderr[-2000:]}', stacklevel=1)
