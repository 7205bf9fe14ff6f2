"""Compile the kernels of tracking, of the fast path and of labelling into the cache.

Run as ``python -m hand_tracker.nodes.fast_path.compile_fast_path``; needs no running ROS.
"""

import sys
from contextlib import suppress

from ...core.numerics import jit
from ...core.point_labelling.cloud_labeller import compile_kernels as compile_labelling
from ...tracking.compile_kernels import compile_tracking, complete_set, run_compilation
from ..serialization import codec_agrees
from .packet_relay import PacketRelay
from .rcl import FastPathUnavailable
from .track_path import FastPath


def main() -> int:
    """Compile set by set; return the exit code."""
    return run_compilation(complete_sets)


def complete_sets(starter: int) -> None:
    """Compile set by set for a process that waits for them."""
    complete_set(jit.TRACKING_SET, compile_tracking, starter)
    with suppress(FastPathUnavailable):
        complete_set(FastPath.KERNEL_SET, compile_fast_path, starter)
    complete_set(jit.LABELLING_SET, compile_labelling, starter)


def compile_fast_path() -> None:
    """Compile the fast path; raise FastPathUnavailable where it cannot serve here."""
    codec_agrees()
    PacketRelay(FastPath(compile_tracking().kernel_arguments()))


if __name__ == '__main__':
    sys.exit(main())
