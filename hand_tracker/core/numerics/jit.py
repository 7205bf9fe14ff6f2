"""One switch: the same kernels, compiled by numba or as plain Python.

Numba is used when it is importable; ``HAND_TRACKER_JIT=0`` turns it off. Compiled kernels
are kept on disk, in a folder that is named after their sources; those of other sources go
when none has used them for a month and new ones come.
"""

import hashlib
import os
import re
import shutil
import time
from contextlib import suppress
from pathlib import Path

import numpy as np

try:
    import numba
except ImportError:
    numba = None

UNUSED = 30 * 86400.  # [s] after which kernels of other sources may go

PACKAGE = Path(__file__).parents[2]
COMPILED_IN = 'marker_frame.py', 'rcl.py'  # files without kernels of their own
KERNEL = re.compile(rb'@(partial\()?jit\b')

COMPILED = numba is not None and os.environ.get('HAND_TRACKER_JIT', '1') != '0'


def kernel_sources():
    """Return the files that kernels are in, or constants that are compiled into them."""
    return [path for path in sorted(PACKAGE.rglob('*.py'))
            if path.is_relative_to(PACKAGE / 'core') or path.name in COMPILED_IN
            or KERNEL.search(path.read_bytes())]


def _cache_folder():
    """Return a writable folder of the user's for the kernels of just these sources, or None."""
    digest = hashlib.sha256(numba.__version__.encode())
    for path in kernel_sources():
        place = path.relative_to(PACKAGE).as_posix()
        digest.update(f'{place}\n'.encode() + path.read_bytes())
    caches = Path(os.environ.get('XDG_CACHE_HOME') or Path.home() / '.cache')
    folder = caches / 'hand_tracker' / f'kernels-{digest.hexdigest()[:16]}'
    try:
        if not folder.is_dir():
            _remove_unused(folder.parent)
            folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)
    except OSError:
        return None
    return folder if os.access(folder, os.W_OK) else None


def _remove_unused(caches):
    for folder in caches.glob('kernels-*'):
        # Another process may be at it.
        with suppress(OSError):
            if time.time() - folder.stat().st_mtime > UNUSED:
                shutil.rmtree(folder, ignore_errors=True)


CACHED = False
_LAYOUTS = {}
if COMPILED:
    # Numba looks at a kernel's own file only: a change in a kernel it calls would go unseen.
    folder = os.environ.get('NUMBA_CACHE_DIR') or _cache_folder()
    CACHED = folder is not None
    if CACHED:
        numba.config.CACHE_DIR = str(folder)


def jit(kernel, **options):
    """Return `kernel` compiled when the switch is on, else unchanged.

    Parameters
    ----------
    kernel : callable
        Pure function of scalars, tuples of floats and fixed-size arrays.
        It may call other kernels; the caller checks its arguments.
    **options
        Of `numba.njit`, in addition.
    """
    if COMPILED:
        # Nothing calls them from C, which would cost as much compiling as from Python. What
        # numba would do to raise where it divides by zero is a tenth of the code.
        return numba.njit(
            kernel, cache=CACHED, no_cfunc_wrapper=True, error_model='numpy', **options)
    return kernel


if COMPILED:
    @jit
    def indexed(array):
        """Return an array as what a kernel reads and writes single numbers of."""
        return array

    @jit
    def overwrite(pack, other):
        """Put into a pack what another one of its kind holds."""
        pack[0] = other[0]
else:
    # Plain Python gets floats of it, twice as fast as numpy's numbers, which are slow themselves.
    indexed = memoryview

    def overwrite(pack, other):
        """Put into a pack what another one of its kind holds."""
        for part, new in zip(pack[0], other[0]):
            if hasattr(part, '_fields'):
                overwrite((part,), (new,))
            else:
                part[...] = new


def packed(values):
    """Return nested named tuples of arrays as what a kernel takes in one piece.

    Compiled, a record array, which holds copies: the arrays of a tuple would be handed over
    one by one, and each would cost every call 0.1 µs and every compilation 50 ms. Truth
    values become bytes there. As plain Python, `values` as they are.

    Parameters
    ----------
    values : NamedTuple
        Of arrays, numbers and such tuples.

    Returns
    -------
    pack : sequence of one
        Its item has the fields of `values`.
    values : NamedTuple
        Of the same type, whose arrays are those of the pack.
    """
    if not COMPILED:
        return (values,), values
    layout = _layout(values)
    # Numba knows a layout at once only if it is the very object.
    record = np.zeros(1, _LAYOUTS.setdefault(layout, layout))
    return record, _filled(record[0], values)


def another(pack):
    """Return a pack like this one, with nothing in it yet."""
    if COMPILED:
        return np.empty_like(pack)
    return (type(pack[0])(*(np.empty_like(part) for part in pack[0])),)


def parts(pack):
    """Return the arrays of a pack, in order."""
    return pack[0].item() if COMPILED else tuple(pack[0])


def _layout(values):
    kinds = []
    for name, part in zip(values._fields, values):
        if hasattr(part, '_fields'):
            kinds.append((name, _layout(part)))
        else:
            part = np.asarray(part)
            truth = part.dtype == bool and part.ndim > 0  # numba has no such arrays in records
            kinds.append((name, np.uint8 if truth else part.dtype, part.shape))
    return np.dtype(kinds, align=True)


def _filled(record, values):
    parts = []
    for name, part in zip(values._fields, values):
        if hasattr(part, '_fields'):
            parts.append(_filled(record[name], part))
            continue
        record[name] = part
        view = record[name]
        parts.append(view.view(bool) if np.asarray(part).dtype == bool else view)
    return type(values)(*parts)
