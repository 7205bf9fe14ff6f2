"""Compile the kernels of tracking, of the fast path and of labelling into the cache.

Run as ``python -m hand_tracker.nodes.fast_path.compile_fast_path [SET...]``; needs no running ROS.
"""

import sys

from ...tracking.compile_kernels import SETS, compile_tracking, run_compilation
from ..serialization import codec_agrees
from .packet_relay import PacketRelay
from .rcl import FastPathUnavailable
from .track_path import FastPath


def compile_fast_path() -> None:
    """Compile the fast path; raise FastPathUnavailable where it cannot serve here."""
    codec_agrees()
    PacketRelay(FastPath(compile_tracking().kernel_arguments()))


if __name__ == '__main__':
    sys.exit(run_compilation(sys.argv[1:], {**SETS, FastPath.KERNEL_SET: compile_fast_path},
                             FastPathUnavailable))
