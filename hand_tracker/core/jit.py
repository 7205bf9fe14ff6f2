"""One switch: the same kernels, compiled by numba or as plain Python.

Numba is used when it is importable; ``HAND_TRACKER_JIT=0`` turns it off. Compiled kernels
are kept on disk, in a folder that is named after their sources.
"""

import hashlib
import os
from pathlib import Path

try:
    import numba
except ImportError:
    numba = None

COMPILED = numba is not None and os.environ.get('HAND_TRACKER_JIT', '1') != '0'


def _cache_folder():
    """Return a writable folder of the user's for the kernels of just these sources, or None."""
    digest = hashlib.sha256(numba.__version__.encode())
    for source in sorted(Path(__file__).parent.glob('*.py')):
        digest.update(source.read_bytes())
    caches = Path(os.environ.get('XDG_CACHE_HOME') or Path.home() / '.cache')
    folder = caches / 'hand_tracker' / f'kernels-{digest.hexdigest()[:16]}'
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return None
    return folder if os.access(folder, os.W_OK) else None


CACHED = False
if COMPILED:
    # Numba looks at a kernel's own file only: a change in a kernel it calls would go unseen.
    folder = os.environ.get('NUMBA_CACHE_DIR') or _cache_folder()
    CACHED = folder is not None
    if CACHED:
        numba.config.CACHE_DIR = str(folder)


def jit(kernel):
    """Return `kernel` compiled when the switch is on, else unchanged.

    Parameters
    ----------
    kernel : callable
        Pure function of scalars, tuples of floats and fixed-size arrays.
        It may call other kernels; the caller checks its arguments.
    """
    if COMPILED:
        return numba.njit(kernel, cache=CACHED)
    return kernel
