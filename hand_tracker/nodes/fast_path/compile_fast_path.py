"""Compile the kernels of tracking and of the fast path into the cache.

Run as ``python -m hand_tracker.nodes.fast_path.compile_fast_path``; needs no running ROS.
"""

import sys
from contextlib import suppress

from ...core.numerics import jit
from ...tracking.compile_kernels import compile_lock, compile_tracking, complete_tracking_set
from ..serialization import codec_agrees
from .middleware import FastPath
from .rcl import FastPathUnavailable


def main() -> int:
    """Compile set by set; return the exit code."""
    with compile_lock():
        complete_tracking_set()
        if not jit.is_ready(FastPath.KERNEL_SET):
            codec_agrees()
            with suppress(FastPathUnavailable):
                FastPath(compile_tracking().kernel_arguments())
                jit.mark_ready(FastPath.KERNEL_SET)
    return 0


if __name__ == '__main__':
    sys.exit(main())
