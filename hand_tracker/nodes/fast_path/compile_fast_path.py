"""Compile the kernels of tracking and of the fast path into the cache.

Run as ``python -m hand_tracker.nodes.fast_path.compile_fast_path``; needs no running ROS.
"""

import os
import sys
from contextlib import suppress

from ...core.numerics import jit
from ...tracking.compile_kernels import (
    NICENESS,
    compile_lock,
    compile_tracking,
    complete_tracking_set,
)
from ..serialization import codec_agrees
from .middleware import FastPath
from .rcl import FastPathUnavailable

FAST_PATH_SET = 'fast_path'
FAST_PATH_PROGRAM = 'hand_tracker.nodes.fast_path.compile_fast_path'


def main() -> int:
    """Compile at low priority, set by set; return the exit code."""
    os.nice(NICENESS)
    with compile_lock():
        complete_tracking_set()
        if not jit.is_ready(FAST_PATH_SET):
            codec_agrees()
            with suppress(FastPathUnavailable):
                FastPath(compile_tracking().kernel_arguments())
                jit.mark_ready(FAST_PATH_SET)
    return 0


if __name__ == '__main__':
    sys.exit(main())
