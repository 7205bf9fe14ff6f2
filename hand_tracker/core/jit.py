"""One switch: the same kernels, compiled by numba or as plain Python.

Numba is used when it is importable; ``HAND_TRACKER_JIT=0`` turns it off.
"""

import os

try:
    import numba
except ImportError:
    numba = None

COMPILED = numba is not None and os.environ.get('HAND_TRACKER_JIT', '1') != '0'


def jit(kernel):
    """Return `kernel` compiled when the switch is on, else unchanged.

    Parameters
    ----------
    kernel : callable
        Pure function of scalars, tuples of floats and fixed-size arrays.
        It may call other kernels; the caller checks its arguments.
    """
    if COMPILED:
        return numba.njit(kernel)
    return kernel
