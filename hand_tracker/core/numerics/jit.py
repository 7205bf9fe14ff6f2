"""Kernels: the same functions compiled by numba or as plain Python.

`HAND_TRACKER_JIT` chooses, where numba is installed:

- ``1``, the default: compiled from the import on; the first call of a kernel compiles it.
- ``background``: as ``1`` where the kernels are on disk; else plain Python at first, and
  `load_kernel` fetches what another process has compiled meanwhile.
- ``0``: plain Python.

Compiled kernels are kept on disk, in a folder named after a hash of their sources, in
`NUMBA_CACHE_DIR` where that is set, else in the user's cache; there kernels of other sources are
removed when none has used them for a month and new ones come. Where that folder is full, or cannot
be written to, each process compiles its own.
"""

from __future__ import annotations

import hashlib
import logging
import os
import platform
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from threading import Lock
from typing import Any, TypeVar

import numpy as np

Kernel = TypeVar('Kernel', bound=Callable[..., Any])

UNUSED_KERNELS_AGE = 30 * 86400.  # [s] after which kernels of other sources are removed
KERNELS_SIZE = 100_000_000  # [bytes] on disk, of all sets, with some to spare

PACKAGE = Path(__file__).parents[2]
KERNEL_DECORATOR = re.compile(rb'@(partial\()?(labelling_)?jit\b')
# Files without kernels of their own, whose constants or intrinsics are compiled into kernels.
COMPILED_IN = ('joint_states.py', 'landmarks.py', 'marker_array.py', 'message_kinds.py',
               'packet_reception.py', 'packet_structure.py', 'rcl.py')

SWITCH = os.environ.get('HAND_TRACKER_JIT', '1')
HAS_NUMBA = find_spec('numba') is not None
JIT_IS_ON = HAS_NUMBA and SWITCH != '0'


class KernelsUnavailable(Exception):
    """Compiled kernels cannot be loaded; the message says why."""


def kernel_sources() -> list[Path]:
    """Return the files with kernels, or with constants that are compiled into kernels."""
    return [path for path in sorted(PACKAGE.rglob('*.py'))
            if path.is_relative_to(PACKAGE / 'core') or path.name in COMPILED_IN
            or KERNEL_DECORATOR.search(path.read_bytes())]


def _sources_digest() -> str:
    """Return a hash of numba's version and of all sources that kernels are compiled from."""
    try:
        numba_version = version('numba')
    except PackageNotFoundError:
        numba_version = ''
    digest = hashlib.sha256(f'{numba_version} {sys.version}'.encode())
    for path in kernel_sources():
        place = path.relative_to(PACKAGE).as_posix()
        digest.update(f'{place}\n'.encode() + path.read_bytes())
    return digest.hexdigest()[:16]


def _cache_folder(name: str) -> Path | None:
    """Return the folder for compiled kernels of these sources, None where there is no home."""
    if given := os.environ.get('NUMBA_CACHE_DIR'):
        # Of kernels of other sources there, numba would load those whose own file is the same.
        folder = Path(given) if Path(given).name == name else Path(given) / name
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
        return folder
    try:
        caches = Path(os.environ.get('XDG_CACHE_HOME') or Path.home() / '.cache')
    except RuntimeError:  # there is no home
        return None
    folder = caches / 'hand_tracker' / name
    with suppress(OSError):
        if not folder.is_dir():
            _remove_unused(folder.parent)
            folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)
    return folder


def _remove_unused(caches: Path) -> None:
    for folder in caches.glob('kernels-*'):
        # Another process may use it.
        with suppress(OSError):
            if time.time() - folder.stat().st_mtime > UNUSED_KERNELS_AGE:
                shutil.rmtree(folder, ignore_errors=True)


SOURCES_DIGEST = _sources_digest() if JIT_IS_ON else ''
CACHE_NAME = f'kernels-{SOURCES_DIGEST}'  # of the cache folder
CACHE_FOLDER = _cache_folder(CACHE_NAME) if JIT_IS_ON else None
# What first kept a kernel of this process from the disk.
_unkept: list[KernelsUnavailable] = []
_import_lock = Lock()   # sets of kernels are loaded by a thread each


@contextmanager
def keeping_in(folder: Path) -> Iterator[None]:
    """Raise KernelsUnavailable, with the folder and the cure, in place of an OSError."""
    try:
        yield
    except OSError as error:
        raise _cannot_keep(folder, error) from error


def _cannot_keep(folder: Path, error: OSError) -> KernelsUnavailable:
    return KernelsUnavailable(
        f'compiled kernels cannot be kept in {folder} ({error.strerror}): free space there, or '
        'set NUMBA_CACHE_DIR to a folder that can be written to')


def report_unkept(error: KernelsUnavailable) -> None:
    """Log, once in a process, why its kernels are not kept on disk."""
    if not _unkept:
        _unkept.append(error)
        logging.getLogger(__name__).warning('%s', error)


def needed_folder() -> Path:
    """Return the cache folder; raise KernelsUnavailable where there is no home."""
    if CACHE_FOLDER is None:
        raise KernelsUnavailable('compiled kernels cannot be kept without a home folder: set '
                                 'NUMBA_CACHE_DIR to a folder that can be written to')
    return CACHE_FOLDER


def folder_with_room(folder: Path) -> Path:
    """Return a folder for compiled kernels; raise KernelsUnavailable unless it can take them."""
    with keeping_in(folder):
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as file:
            if hasattr(os, 'posix_fallocate'):
                os.posix_fallocate(file.fileno(), 0, KERNELS_SIZE)
    return folder


def ready_file(kernel_set: str, folder: Path) -> Path:
    """Return the file that says that a set of kernels is complete in a cache folder.

    It is of this machine and of this place of the package: numba keeps kernels by both, and by
    another place where the package is imported through a link, as of colcon's --symlink-install.
    """
    place = hashlib.sha256(f'{platform.node()} {PACKAGE}'.encode()).hexdigest()[:8]
    return folder / f'ready-{kernel_set}-{SOURCES_DIGEST}-{place}'


def mark_ready(kernel_set: str) -> None:
    """Note on disk that every kernel of a set has been compiled.

    Parameters
    ----------
    kernel_set : str
        Such as 'tracking'.

    Raises
    ------
    KernelsUnavailable
        If one could not be kept there.
    """
    if _unkept:
        raise _unkept[0]
    folder = needed_folder()
    with keeping_in(folder):
        ready_file(kernel_set, folder).touch()


def is_ready(kernel_set: str) -> bool:
    """Return whether every kernel of a set is on disk."""
    # Unlike that of a Path it raises nothing where the folder may not be read.
    return CACHE_FOLDER is not None and os.path.exists(ready_file(kernel_set, CACHE_FOLDER))


# The kernels from a message's bytes to the hand, and those that label points; the fast path's
# are another set.
TRACKING_SET, LABELLING_SET = 'tracking', 'labelling'
# Plain Python now, compiled kernels once another process has compiled them; those that label
# points call kernels of tracking.
DEFERRED = JIT_IS_ON and SWITCH == 'background' and not is_ready(TRACKING_SET)
LABELLING_IS_DEFERRED = DEFERRED or (
    JIT_IS_ON and SWITCH == 'background' and not is_ready(LABELLING_SET))
COMPILED = JIT_IS_ON and not DEFERRED


def _compiler(folder: Path | None) -> Any:
    """Import numba, set to keep kernels in a folder."""
    numba: Any = import_module('numba')
    linalg: Any = import_module('numba.np.linalg')

    if folder is not None:
        # Numba looks for changes in a kernel's own file only: the folder's name covers the others.
        numba.config.CACHE_DIR = str(folder)
    with _import_lock:
        if 'numba.np.arraymath' not in sys.modules:
            # It would import scipy.linalg, a fifth of a start, to see whether it is there.
            check, linalg.ensure_blas = linalg.ensure_blas, lambda: None
            import_module('numba.np.arraymath')
            linalg.ensure_blas = check
    return numba


if COMPILED:
    try:
        _compiler(CACHE_FOLDER)
    except ImportError:  # not of this numpy, say
        HAS_NUMBA = JIT_IS_ON = COMPILED = False

_deferred_options: dict[Callable[..., Any], dict[str, Any]] = {}
_loaded: dict[Callable[..., Any], Callable[..., Any]] = {}
_record_layouts: dict[np.dtype, np.dtype] = {}
_record_types: dict[np.dtype, Any] = {}


def jit(kernel: Kernel, is_deferred: bool = DEFERRED, **options: Any) -> Kernel:
    """Return a kernel compiled where numba is used, or deferred, else unchanged.

    Parameters
    ----------
    kernel : callable
        Pure function of scalars, tuples and fixed-size arrays. It may call other kernels, which
        become parts of it; the caller checks its arguments.
    is_deferred : bool, optional
        Whether it is plain Python until `load_kernel`.
    **options
        Further options of `numba.njit`; `is_whole`: whether it is never a part, so that all its
        callers run the same code.
    """
    if is_deferred:
        _deferred_options[kernel] = options
    elif JIT_IS_ON:
        return _dispatcher(kernel, CACHE_FOLDER is not None, options)
    return kernel


def labelling_jit(kernel: Kernel) -> Kernel:
    """Return a kernel of those that label points, as `jit` does."""
    return jit(kernel, LABELLING_IS_DEFERRED)


def _dispatcher(kernel: Callable[..., Any], cached: bool, options: dict[str, Any]) -> Any:
    from .kernel_compiler import KernelCompiler, KernelDispatcher

    # Nothing calls kernels from C, which would cost as much compiling as from Python. The checks
    # that numba adds to raise ZeroDivisionError are a tenth of the code.
    dispatcher = KernelDispatcher(
        kernel, pipeline_class=KernelCompiler, targetoptions={
            'nopython': True, 'boundscheck': None, 'no_cfunc_wrapper': True,
            'error_model': 'numpy',
            **{name: value for name, value in options.items() if name != 'is_whole'}})
    dispatcher.is_whole = options.get('is_whole', False)
    if cached:
        dispatcher._cache = _kernel_cache(kernel)
    return dispatcher


def _kernel_cache(kernel: Callable[..., Any]) -> Any:
    config: Any = import_module('numba').config
    from .kernel_cache import KernelCache

    folder = Path(config.CACHE_DIR)
    return KernelCache(kernel, lambda error: report_unkept(_cannot_keep(folder, error)))


def c_callback(signature: str) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator that compiles a function for C, or loads it from the disk.

    Parameters
    ----------
    signature : str
        In numba's words, such as 'void(voidptr, uintp)'.

    Returns
    -------
    callable
        Returns numba's CFunc, whose `address` is that of the machine code.
    """
    def compiled(function: Callable[..., Any]) -> Any:
        ccallback: Any = import_module('numba.core.ccallback')
        sigutils: Any = import_module('numba.core.sigutils')
        from .kernel_compiler import KernelCompiler

        callback = ccallback.CFunc(function, sigutils.normalize_signature(signature), locals={},
                                   options={'error_model': 'numpy'},
                                   pipeline_class=KernelCompiler)
        if DEFERRED or CACHE_FOLDER is not None:
            callback._cache = _kernel_cache(function)
        callback.compile()
        return callback

    return compiled


def load_kernel(kernel: Kernel, arguments: Sequence[Any], folder: Path | None = None,
                others: Sequence[Sequence[Any]] = ()) -> Kernel:
    """Return a kernel that is ready for arguments of these types: deferred, it comes from the disk.

    Parameters
    ----------
    kernel : callable
        Decorated by `jit`; compiled for them, and returned as it is, where none is deferred.
    arguments : sequence
        Arguments like those that it will be called with.
    folder : Path, optional
        Cache folder to load from; `CACHE_FOLDER` when left out.
    others : sequence of sequence, optional
        Arguments of other types that it will also be called with.

    Returns
    -------
    callable

    Raises
    ------
    KernelsUnavailable
        If a deferred one is not on disk.
    """
    calls = arguments, *others
    if kernel not in _deferred_options:
        # It may be a part of others until Python calls it.
        for call in calls if JIT_IS_ON else ():
            kernel.compile(tuple(map(_type_of, call)))  # type: ignore[attr-defined]
        return kernel
    _compiler(folder or CACHE_FOLDER)
    dispatcher = _dispatcher(kernel, True, _deferred_options[kernel])
    try:
        for call in calls:
            dispatcher.compile(tuple(map(_type_of, call)))
    except Exception as error:  # compiling fails, as the kernels that it calls are plain Python
        raise KernelsUnavailable(f'{kernel.__name__} is not on disk') from error
    if sum(dispatcher.stats.cache_hits.values()) < len(calls):
        raise KernelsUnavailable(f'{kernel.__name__} is not on disk')
    _loaded[kernel] = dispatcher
    return dispatcher


def loaded_or_plain(kernel: Kernel) -> Kernel:
    """Return the compiled kernel that `load_kernel` has loaded, else the plain Python one."""
    return _loaded.get(kernel, kernel)  # type: ignore[return-value]


def for_types_of(kernel: Kernel, arguments: Sequence[Any]) -> Kernel:
    """Return a kernel specialised for the arguments' types, called without type dispatch.

    Parameters
    ----------
    kernel : callable
        Compiled by `jit`; returned as it is where it is plain Python.
    arguments : sequence

    Returns
    -------
    callable
        By position only.
    """
    if not hasattr(kernel, 'compile'):
        return kernel
    return kernel.compile(tuple(map(_type_of, arguments)))


def record_layout(layout: np.dtype) -> np.dtype:
    """Return a layout of records, each time the same object, which numba recognises quickly."""
    return _record_layouts.setdefault(layout, layout)


def _type_of(argument: Any) -> Any:
    """Return numba's type of an argument, that of a pack as found before: it takes 1 ms to find."""
    numba: Any = import_module('numba')
    layout = getattr(argument, 'dtype', None)
    if layout not in _record_layouts:
        return numba.typeof(argument)
    if layout not in _record_types:
        _record_types[layout] = numba.typeof(argument)
    return _record_types[layout]
