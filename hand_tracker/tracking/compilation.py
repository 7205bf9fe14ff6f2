"""The first start: a child process compiles the kernels, a thread loads them."""

from __future__ import annotations

import atexit
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from threading import Lock, Thread
from typing import IO

from ..background import start_low_priority
from ..core.numerics import jit

POLL_PERIOD = .1  # [s]
COMPILE_TIME = 'one to four minutes'  # on two cores, as is logged
PROGRAM = 'hand_tracker.tracking.compile_kernels'
STARTER_VARIABLE = 'HAND_TRACKER_STARTER'  # names the process that asks


class Compilation:
    """Kernels that are compiled and loaded beside the tracking.

    The child process runs at low priority and goes on to its end even when this process
    ends before it, so that the next start finds the kernels on disk. This process ends when
    the set that it is loading is loaded: LLVM aborts where Python ends a thread in it.

    Parameters
    ----------
    loaders : mapping of str to callable
        For each set of kernels what loads it: called in a thread, with the cache folder, once the
        set is on disk.
    program : str
        Module that compiles them, run as ``python -m`` with their names.

    Attributes
    ----------
    loaded : list of str
        Sets that are loaded so far.
    error : str or None
        Why no more will be loaded.
    unkept : str or None
        Why they are compiled for this process alone.
    """

    def __init__(self, loaders: Mapping[str, Callable[[Path], None]],
                 program: str = PROGRAM) -> None:
        self.loaded: list[str] = []
        self.error: str | None = None
        self.unkept: str | None = None
        self._loaders, self._program = loaders, program
        self._loading, self._ending = Lock(), False
        atexit.register(self._end)
        Thread(target=self._run, name='load kernels', daemon=True).start()

    def _run(self) -> None:
        try:
            if jit.CACHE_FOLDER is not None and all(map(jit.is_ready, self._loaders)):
                # Compiled since this process started.
                for kernel_set, load in self._loaders.items():
                    self._load(kernel_set, load, jit.CACHE_FOLDER.resolve())
                return
            folder = self._folder_with_room().resolve()
            with tempfile.TemporaryFile('w+') as complaints:
                child = self._start(folder, complaints)
                if self.unkept is not None:
                    atexit.register(child.kill)
                for kernel_set, load in self._loaders.items():
                    if not _wait(child, jit.ready_file(kernel_set, folder)):
                        complaints.seek(0)
                        lines = complaints.read().split('\n')
                        self.error = next((line for line in reversed(lines) if line.strip()),
                                          f'the compiling process ended with {child.returncode}')
                        return
                    self._load(kernel_set, load, folder)
                child.wait()
        # Tracking goes on in plain Python, whatever the reason.
        except jit.KernelsUnavailable as error:
            self.error = str(error)
        except Exception as error:
            self.error = f'{type(error).__name__}: {error}'

    def _load(self, kernel_set: str, load: Callable[[Path], None], folder: Path) -> None:
        """Load a set of kernels, but never once this process ends."""
        with self._loading:
            if self._ending:
                return
            load(folder)
        self.loaded.append(kernel_set)

    def _end(self) -> None:
        """Wait for the set that is being loaded, and let no other begin."""
        self._ending = True  # before the lock, which its last owner may take once more
        self._loading.acquire()

    def _folder_with_room(self) -> Path:
        """Return the user's cache folder, or a temporary one where that can take no kernels."""
        try:
            return jit.folder_with_room(jit.needed_folder())
        except jit.KernelsUnavailable as error:
            if not os.environ.get('NUMBA_CACHE_DIR'):
                with suppress(OSError, jit.KernelsUnavailable):
                    folder = jit.folder_with_room(_temporary_folder())
                    self.unkept = str(error)
                    return folder
            raise

    def _start(self, folder: Path, complaints: IO[str]) -> subprocess.Popen[bytes]:
        return start_low_priority(
            ['-m', self._program, *self._loaders],
            {'HAND_TRACKER_JIT': '1', 'NUMBA_CACHE_DIR': str(folder),
             STARTER_VARIABLE: str(os.getpid())},
            subprocess.DEVNULL, complaints)


def _temporary_folder() -> Path:
    """Return a cache folder for this process alone, removed at its end."""
    folder = Path(tempfile.mkdtemp(prefix='hand_tracker-kernels-'))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder / jit.CACHE_NAME


def _wait(child: subprocess.Popen[bytes], ready: Path) -> bool:
    """Wait until a file is there; return False where the child ends without it."""
    while not ready.exists():
        if child.poll() is not None:
            return ready.exists()
        time.sleep(POLL_PERIOD)
    return True
