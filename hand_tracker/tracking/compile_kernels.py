"""Compile the kernels of tracking and of labelling into the cache.

Run as ``python -m hand_tracker.tracking.compile_kernels [SET...]`` by `Compilation`.
"""

import gc
import os
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, suppress
from importlib.util import find_spec
from pathlib import Path
from threading import Event, Thread

import numpy as np

from ..core.model.hand import DIGITS, JOINTS
from ..core.model.kinematics import forward, joint_table
from ..core.model.marker_layout import PALM_MARKERS, marker_positions
from ..core.model.palm_triangle import fit_wrist
from ..core.numerics import jit
from ..core.numerics.quaternion import quaternion, write_transforms
from ..core.numerics.rigid_fit import fit_rigid
from ..core.point_labelling.cloud_labeller import compile_kernels as compile_labelling
from ..core.pose.report import mean_residual
from ..core.tracker import HandTracker
from ..interruption import INTERRUPTED_EXIT_CODE, ended_by_interrupt
from ..messages.cdr import LITTLE_ENDIAN, MarkerReader
from ..messages.labels import LabelMap
from ..messages.stamps import NO_STAMP, Stamp, is_repeated, seconds
from ..messages.templates import joint_state_template
from ..progress import Progress
from .compilation import COMPILE_TIME, STARTER_VARIABLE

EMPTY_MARKER_ARRAY = LITTLE_ENDIAN + bytes(4)
LOCK_POLL = .1  # [s]
COUNT_PERIOD = .5  # [s] between looks for new kernels
COLLECTION_THRESHOLD = 10_000   # new objects; a higher one saves little, and costs memory
COMPILED_SO_FAR = 'interrupted; kernels that were complete are kept'
KERNEL_PLACES = 'core', 'messages'  # of the sets here


class StarterEnded(Exception):
    """Another process compiles the kernels, and the one that asked for them has ended."""


def compile_tracking() -> HandTracker:
    """Compile all that turns the bytes of a MarkerArray into a hand; return a tracker."""
    tracker = HandTracker()
    table = joint_table(tracker.hand)
    markers = marker_positions(
        tracker.layout.mounting(tracker.hand), forward(table, tracker.hand.relaxed()))
    state = tracker.update(markers)
    tracker.update(markers, distal_flexion=np.full(len(DIGITS), np.nan))
    write_transforms(table.parent, *state.pose, state.wrist_rotation, state.wrist_position,
                    np.empty((1, 7)))
    MarkerReader(LabelMap()).read(EMPTY_MARKER_ARRAY)
    quaternion(state.wrist_rotation)
    # Those who show a tracked hand call these two.
    palm, rotation, position = markers[:len(PALM_MARKERS)], np.eye(3), np.zeros(3)
    fit_wrist(palm, palm, rotation, position)
    fit_rigid(markers, markers, np.ones(len(markers)), rotation, position)
    mean_residual(state.residuals)
    seconds(Stamp(1, 0))
    is_repeated(1, 0, *NO_STAMP)
    joint_state_template(JOINTS).fill(Stamp(1, 0), state.angles)
    return tracker


def prepare_kernels(say: Callable[[str], object], labels_points: bool = False,
                    is_quiet: bool = False,
                    interrupted_code: int = INTERRUPTED_EXIT_CODE) -> None:
    """Compile missing kernels before they are needed, announce the wait, and show how far it is.

    Parameters
    ----------
    say : callable
        Takes a line.
    labels_points : bool, optional
        Whether those that label points are needed too.
    is_quiet : bool, optional
        Whether to show no progress on the standard error.
    interrupted_code : int, optional
        Exit code at Ctrl-C or SIGTERM meanwhile.
    """
    needed = [jit.TRACKING_SET, *[jit.LABELLING_SET] * labels_points]
    # Deferred kernels are plain Python here: they are for another process to compile.
    missing = [name for name in needed if jit.COMPILED and not jit.is_ready(name)
               and not (name == jit.LABELLING_SET and jit.LABELLING_IS_DEFERRED)]
    if missing:
        say(f'compiling the kernels, which are kept, for {COMPILE_TIME} ...')
    for name in missing:
        with ended_by_interrupt(COMPILED_SO_FAR, interrupted_code), (
                nullcontext() if is_quiet else _progress_of(name)):
            try:
                complete_set(name, SETS[name])
            except jit.KernelsUnavailable as error:
                # Without a folder to keep them in they are compiled each time.
                jit.report_unkept(error)
                SETS[name]()


@contextmanager
def _progress_of(kernel_set: str) -> Iterator[None]:
    """Show how many kernels of a set this process has compiled, of how many."""
    # With numba, which plain Python does without.
    from ..core.numerics.kernel_compiler import KernelCompiler

    total, first = kernel_count(kernel_set), KernelCompiler.finished
    ended, is_whole = Event(), False

    def new_kernels() -> Iterator[None]:
        shown = 0
        while not ended.wait(COUNT_PERIOD):
            now = min(KernelCompiler.finished - first, total)
            yield from [None] * (now - shown)
            shown = now
        yield from [None] * (total - shown if is_whole else 0)

    # Beside this thread, which compiles, and which Ctrl-C reaches.
    shown = Progress(total, f'kernels of {kernel_set}').over(new_kernels())
    display = Thread(target=deque, args=(shown, 0))
    display.start()
    try:
        yield
        is_whole = True
    finally:
        ended.set()
        display.join()


def kernel_count(kernel_set: str) -> int:
    """Return how many kernels the sources of a set have."""
    count = 0
    for source in jit.kernel_sources():
        decorators = jit.KERNEL_DECORATOR.findall(source.read_bytes())
        labels_points = any(labelling for _, labelling in decorators)
        if (source.relative_to(jit.PACKAGE).parts[0] in KERNEL_PLACES
                and labels_points == (kernel_set == jit.LABELLING_SET)):
            count += len(decorators)
    return count


@contextmanager
def compile_lock(kernel_set: str, starter: int | None = None) -> Iterator[None]:
    """Lock a set of kernels in the cache folder: one process at a time compiles it.

    Nobody waits for a process of low priority, as `Compilation` starts it, which may take long: it
    has a lock of its own, and only begins while no other compiles.

    Parameters
    ----------
    kernel_set : str
    starter : int, optional
        Parent process for which this one waits: once it has ended there is nothing to wait for.

    Raises
    ------
    KernelsUnavailable
        If there is no such folder, or it cannot be written to.
    StarterEnded
    """
    # Not on POSIX: both compile, and the later files replace the others.
    if find_spec('fcntl') is None:
        yield
        return
    folder = jit.needed_folder()
    with jit.keeping_in(folder):
        folder.mkdir(parents=True, exist_ok=True)
    lock = folder / f'lock-{kernel_set}'
    if os.nice(0) <= 0:
        with _locked(lock, starter):
            yield
        return
    with _locked(lock.with_name(f'{lock.name}-background'), starter):
        with _locked(lock, starter):
            pass
        yield


@contextmanager
def _locked(path: Path, starter: int | None) -> Iterator[None]:
    """Lock a file; wait for it as long as the starter runs."""
    import fcntl

    with jit.keeping_in(path.parent):
        lock = open(path, 'w')
    with lock:
        while True:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if starter is not None and os.getppid() != starter:
                    raise StarterEnded from None
                time.sleep(LOCK_POLL)
        yield


def complete_set(kernel_set: str, compile_set: Callable[[], object],
                 starter: int | None = None) -> None:
    """Compile a set of kernels, and mark it as ready, unless it is on disk.

    Parameters and errors are those of `compile_lock`.
    """
    with compile_lock(kernel_set, starter):
        if not jit.is_ready(kernel_set):
            with _rare_collections():
                compile_set()
            jit.mark_ready(kernel_set)


@contextmanager
def _rare_collections() -> Iterator[None]:
    """Look for garbage seldom: a seventh of numba's time goes there, as its objects live on."""
    thresholds = gc.get_threshold()
    if thresholds[0] > 0:   # else it is off
        gc.set_threshold(max(thresholds[0], COLLECTION_THRESHOLD), *thresholds[1:])
    try:
        yield
    finally:
        gc.set_threshold(*thresholds)


SETS: dict[str, Callable[[], object]] = {
    jit.TRACKING_SET: compile_tracking, jit.LABELLING_SET: compile_labelling}


def run_compilation(names: Sequence[str], sets: Mapping[str, Callable[[], object]] = SETS,
                    *unavailable: type[Exception]) -> int:
    """Compile sets by their names, all where none is given; return the exit code.

    Parameters
    ----------
    names : sequence of str
    sets : mapping of str to callable, optional
        What compiles each.
    *unavailable : exception types
        That a set may raise which cannot serve here.
    """
    is_background = STARTER_VARIABLE in os.environ
    # That process may have ended since.
    starter = int(os.environ.get(STARTER_VARIABLE, os.getppid()))
    try:
        for name in names or sets:
            with suppress(*unavailable), ended_by_interrupt(COMPILED_SO_FAR), (
                    _progress_of(name) if name in SETS and not is_background else nullcontext()):
                complete_set(name, sets[name], starter)
    except StarterEnded:
        pass
    except jit.KernelsUnavailable as error:
        jit.report_unkept(error)
        return 1
    return 0


if __name__ == '__main__':
    sys.exit(run_compilation(sys.argv[1:]))
