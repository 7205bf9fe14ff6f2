"""Compile the kernels of tracking, of the fast path and of labelling into the cache.

Run as ``python -m hand_tracker.nodes.fast_path.compile_fast_path [SET...]``; needs no running ROS.
"""

import sys
from collections.abc import Sequence
from contextlib import suppress

from ...core.numerics import jit
from ...core.point_labelling.cloud_labeller import compile_kernels as compile_labelling
from ...tracking.compile_kernels import compile_tracking, complete_set, run_compilation
from ..serialization import codec_agrees
from .packet_relay import PacketRelay
from .rcl import FastPathUnavailable
from .track_path import FastPath


def compile_fast_path() -> None:
    """Compile the fast path; raise FastPathUnavailable where it cannot serve here."""
    codec_agrees()
    PacketRelay(FastPath(compile_tracking().kernel_arguments()))


ALL_SETS = {jit.TRACKING_SET: compile_tracking, FastPath.KERNEL_SET: compile_fast_path,
            jit.LABELLING_SET: compile_labelling}


def main(names: Sequence[str]) -> int:
    """Compile sets by their names, all where none is given; return the exit code."""
    def complete(starter: int) -> None:
        for name in names or ALL_SETS:
            with suppress(FastPathUnavailable):
                complete_set(name, ALL_SETS[name], starter)

    return run_compilation(complete)


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
