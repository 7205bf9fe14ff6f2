"""The first start: plain Python tracks, compiled kernels take over, and what may go wrong."""

import os
import shutil
import subprocess
import sys
import time
from contextlib import nullcontext

import pytest

from benchmarks.repository import REPOSITORY
from hand_tracker.core.numerics import jit
from hand_tracker.tracking import compile_kernels
from hand_tracker.tracking.compilation import PROGRAM, STARTER_VARIABLE, Compilation
from hand_tracker.tracking.compile_kernels import SETS, prepare_kernels

FAST_PATH_PROGRAM = 'hand_tracker.nodes.fast_path.compile_fast_path'
PATIENCE = 600.  # [s]

needs_numba = pytest.mark.skipif(
    not jit.JIT_IS_ON, reason='without numba there is nothing to compile')

# Tracks the packaged recording with the kernels that are there, beside plain Python throughout.
TAKE_OVER = """
import sys, time
import numpy as np
from hand_tracker.core.numerics import jit
from hand_tracker.core.tracker import HandTracker
from hand_tracker.files.bags import open_bag
from hand_tracker.messages.cdr import MarkerReader
from hand_tracker.messages.labels import LabelMap
from hand_tracker.messages.stamps import Stamp
from hand_tracker.tracking.stream import Stream, TrackedFrame

assert jit.DEFERRED and not jit.COMPILED and 'numba' not in sys.modules
stream = Stream(HandTracker(), MarkerReader(LabelMap()))
plain = Stream(HandTracker(), MarkerReader(LabelMap()))
stream.compile_in_background()
with open_bag(sys.argv[1]) as bag:
    messages = [message.data for message in bag.messages(['/markers'])]
number = after = 0
farthest = 0.
while after < 60:
    frame, other = (each.track(messages[number % 600], 0., lambda: Stamp(1, 0))
                    for each in (stream, plain))
    farthest = max(farthest, abs(frame.state.angles - other.state.angles).max(),
                   abs(frame.state.pose.position - other.state.pose.position).max())
    number += 1
    after += stream.is_compiled
    if not after:
        time.sleep(.05)  # what compiles has the processor
    assert not plain.is_compiled
    assert stream.compilation.error is None, stream.compilation.error
print(farthest, *(line for _, line in stream.pop_log_lines()), sep='\\n')
"""


def run(program, cache, *arguments):
    environment = {**os.environ, 'HAND_TRACKER_JIT': 'background', 'NUMBA_CACHE_DIR': str(cache),
                   'PYTHONPATH': os.pathsep.join(
                       [str(REPOSITORY), os.environ.get('PYTHONPATH', '')])}
    return subprocess.run([sys.executable, '-c', program, *arguments], env=environment,
                          capture_output=True, text=True)


def unfinished_cache(folder, unfinished=''):
    """Return a cache folder with the kernels of this process, and no word that they are whole."""
    if jit.CACHE_FOLDER is not None:
        shutil.copytree(jit.CACHE_FOLDER, folder / 'cache' / jit.CACHE_NAME,
                        ignore=shutil.ignore_patterns(f'ready-{unfinished}*', 'lock-*'))
    return folder / 'cache'


@needs_numba
def test_compiled_kernels_take_over_between_two_frames_and_go_on_alike(tmp_path):
    done = run(TAKE_OVER, unfinished_cache(tmp_path), str(REPOSITORY / 'recordings' / 'demo.mcap'))
    assert done.returncode == 0, done.stderr
    farthest, first, second = done.stdout.splitlines()
    assert float(farthest) <= 1e-9
    assert 'first start' in first and 'taken over' in second


# Labels the markers of a moving hand among other points, before and after its kernels are there.
TAKE_OVER_LABELLING = """
import time
import numpy as np
from hand_tracker.core.point_labelling import cloud_labeller
from hand_tracker.core.point_labelling.following import follow_cloud
from hand_tracker.core.point_labelling.natural_poses import model_prototype, natural_poses
from hand_tracker.core.model.hand import Hand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.marker_layout import MARKERS, MarkerLayout, marker_positions
from hand_tracker.core.numerics import jit
from hand_tracker.core.tracker import HandTracker
from hand_tracker.messages.cdr import MarkerReader
from hand_tracker.messages.labels import LabelMap
from hand_tracker.tracking.stream import Stream

assert jit.DEFERRED
hand = Hand.scaled()
keys = natural_poses(hand)[:4]
angles = np.array([np.interp(np.linspace(0., 3., 90), range(4), joint) for joint in keys.T]).T
markers = marker_positions(MarkerLayout().mounting(hand), forward(joint_table(hand), angles))
rng = np.random.default_rng(1)
order = [rng.permutation(10) for _ in markers]

def label():
    labeller = cloud_labeller.CloudLabeller([model_prototype(hand, MarkerLayout(), MARKERS)])
    ghosts = markers[:, :2] + (.3, .2, .1)
    return [labeller.update(np.concatenate(points)[rows], .01 * number).rows[0]
            for number, (*points, rows) in enumerate(zip(markers, ghosts, order))]

plain = label()
stream = Stream(HandTracker(), MarkerReader(LabelMap()))
stream.compile_in_background()
while jit.LABELLING_SET not in stream.compilation.loaded:
    assert stream.compilation.error is None, stream.compilation.error
    time.sleep(.01)
for rows, others, places in zip(label(), plain, order):
    assert np.array_equal(rows, others)
    assert (places[rows] == np.arange(8)).all()
for kernel, calls in cloud_labeller.kernel_calls():
    loaded = jit.loaded_or_plain(kernel)
    assert loaded is not kernel and len(loaded.signatures) == len(calls), kernel
"""


# Points are to be labelled by a stream that read labels at its start.
LABEL_LATER = """
import time
from hand_tracker.core.numerics import jit
from hand_tracker.core.point_labelling.following import follow_cloud
from hand_tracker.core.tracker import HandTracker
from hand_tracker.messages.cdr import MarkerReader
from hand_tracker.messages.labels import LabelMap
from hand_tracker.tracking.stream import Stream

assert jit.LABELLING_IS_DEFERRED and not jit.DEFERRED
stream = Stream(HandTracker(), MarkerReader(LabelMap()))
stream.compile_in_background()
assert stream.compilation is None
lines = []
while len(lines) < 2:
    stream.compile_for_points()
    lines += stream.pop_log_lines()
    time.sleep(.01)
assert jit.loaded_or_plain(follow_cloud) is not follow_cloud
stream.compile_for_points()
lines += stream.pop_log_lines()
print(*lines, sep='\\n')
"""


@needs_numba
def test_kernels_that_label_points_are_compiled_once_they_are_needed(tmp_path):
    cache = unfinished_cache(tmp_path, jit.LABELLING_SET)
    subprocess.run([sys.executable, '-m', PROGRAM, jit.TRACKING_SET], check=True, env={
        **os.environ, 'HAND_TRACKER_JIT': '1', 'NUMBA_CACHE_DIR': str(cache)})
    done = run(LABEL_LATER, cache)
    assert done.returncode == 0, done.stderr
    first, second = done.stdout.splitlines()
    assert 'kernels that label points are compiled in the background' in first
    assert 'compiled kernels label points now' in second


@needs_numba
def test_points_are_labelled_alike_before_and_after_their_kernels_are_there(tmp_path):
    done = run(TAKE_OVER_LABELLING, unfinished_cache(tmp_path))
    assert done.returncode == 0, done.stderr


WITHOUT_CACHE = """
import time
import numpy as np
from hand_tracker.core.tracker import HandTracker
from hand_tracker.messages.cdr import MarkerReader
from hand_tracker.messages.labels import LabelMap
from hand_tracker.messages.marker_array import MarkerFrame
from hand_tracker.messages.stamps import Stamp
from hand_tracker.tracking.stream import Stream

stream = Stream(HandTracker(), MarkerReader(LabelMap()))
stream.compile_in_background()
frame = MarkerFrame(Stamp(1, 0), 'mocap', np.zeros((8, 3)), (), (), ())
lines = []
while len(lines) < 2:
    assert stream.track(frame, 0., lambda: Stamp(1, 0)).state is not None
    lines += stream.pop_log_lines()
    time.sleep(.01)
print(*lines, sep='\\n')
"""


@needs_numba
def test_where_kernels_cannot_be_kept_plain_python_goes_on_and_says_why(tmp_path):
    (tmp_path / 'file').touch()
    done = run(WITHOUT_CACHE, tmp_path / 'file' / 'cache')
    assert done.returncode == 0, done.stderr
    start, end = done.stdout.splitlines()
    assert "False, 'first start" in start
    assert end.startswith('(True') and 'the kernels could not be compiled' in end
    assert 'Not a directory' in end or 'cannot cache' in end


def wait_for(condition):
    until = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < until
        time.sleep(.01)


@needs_numba
def test_a_compiling_process_that_ends_without_kernels_is_named():
    loaded = []
    # A module that does nothing when it is run.
    compilation = Compilation({'nonesuch': loaded.append}, 'this')
    wait_for(lambda: compilation.error is not None)
    assert not loaded and not compilation.loaded
    assert 'ended with 0' in compilation.error


@needs_numba
def test_a_compiling_process_that_is_killed_is_named(tmp_path, monkeypatch):
    (tmp_path / 'killed.py').write_text('import os, signal\nos.kill(os.getpid(), signal.SIGKILL)\n')
    monkeypatch.setenv('PYTHONPATH', str(tmp_path))
    compilation = Compilation({'nonesuch': print}, 'killed')
    wait_for(lambda: compilation.error is not None)
    assert 'ended with -9' in compilation.error


@needs_numba
def test_what_cannot_be_loaded_is_named(tmp_path, monkeypatch):
    def load(folder):
        raise jit.KernelsUnavailable('track_frame is not on disk')

    monkeypatch.setattr(jit, 'CACHE_FOLDER', tmp_path)
    jit.ready_file('one', tmp_path).touch()
    compilation = Compilation({'one': load}, 'this')
    wait_for(lambda: compilation.error is not None)
    assert 'track_frame is not on disk' in compilation.error and not compilation.loaded


# Ends while a set is being loaded, with another to come.
END_WHILE_LOADING = """
import time
from threading import Event
from hand_tracker.tracking.compilation import Compilation

begun = Event()

def load(folder):
    print('begun', flush=True)
    begun.set()
    time.sleep(.5)
    print('ended', flush=True)

compilation = Compilation({'one': load, 'two': load}, 'mark')
begun.wait()
"""


@needs_numba
def test_a_process_that_ends_loads_its_set_to_the_end_and_no_other(tmp_path, monkeypatch):
    (tmp_path / 'mark.py').write_text(
        'from hand_tracker.core.numerics import jit\n'
        "for name in ('one', 'two'):\n    jit.mark_ready(name)\n")
    monkeypatch.setenv('PYTHONPATH', str(tmp_path))
    done = run(END_WHILE_LOADING, tmp_path / 'cache')
    assert (done.returncode, done.stdout.split(), done.stderr) == (0, ['begun', 'ended'], '')


WAIT_FOR_ONE = """
import resource, sys, time
from hand_tracker.tracking.compilation import Compilation

exec(sys.argv[2])
compilation = Compilation({'one': lambda folder: None}, sys.argv[1])
while not compilation.loaded and compilation.error is None:
    time.sleep(.01)
print(compilation.error, compilation.unkept, sep='\\n')
"""


def run_compilation_of_one(folder, program, limit='', **caches):
    """Return error and note of a compilation in a process with such cache folders."""
    environment = {**os.environ, 'HAND_TRACKER_JIT': 'background', 'TMPDIR': str(folder),
                   # Python, too, would cut what it writes at a limit.
                   'PYTHONDONTWRITEBYTECODE': '1',
                   'PYTHONPATH': os.pathsep.join([str(REPOSITORY), str(folder)])}
    environment.pop('NUMBA_CACHE_DIR', None)
    environment.update({name: str(place) for name, place in caches.items()})
    done = subprocess.run([sys.executable, '-c', WAIT_FOR_ONE, program, limit], env=environment,
                          capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 0 and done.stderr == '', done.stderr
    return done.stdout.splitlines()


@needs_numba
def test_where_the_users_cache_is_unusable_a_temporary_folder_serves(tmp_path):
    (tmp_path / 'file').touch()
    (tmp_path / 'mark.py').write_text(
        "from hand_tracker.core.numerics import jit\njit.mark_ready('one')\n")
    error, unkept = run_compilation_of_one(tmp_path, 'mark', XDG_CACHE_HOME=tmp_path / 'file')
    assert error == 'None'
    assert str(tmp_path / 'file' / 'hand_tracker') in unkept and 'Not a directory' in unkept
    assert not list(tmp_path.glob('hand_tracker-kernels-*'))  # removed at the end


@needs_numba
@pytest.mark.parametrize('variable', ['XDG_CACHE_HOME', 'NUMBA_CACHE_DIR'])
def test_without_room_for_kernels_nothing_is_compiled_in_vain(tmp_path, variable):
    pytest.importorskip('resource', reason='there is no limit of file sizes here')
    # The module to run is not there: its absence would be the error.
    error, unkept = run_compilation_of_one(
        tmp_path, 'nonesuch', 'resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 20,) * 2)',
        **{variable: tmp_path / 'cache'})
    assert unkept == 'None'
    for word in (str(tmp_path / 'cache'), 'File too large', 'free space', 'NUMBA_CACHE_DIR'):
        assert word in error
    assert not [path for path in tmp_path.rglob('*') if path.is_file()]


@needs_numba
def test_kernels_that_cannot_be_kept_are_compiled_once_and_told_of(tmp_path, monkeypatch, caplog):
    compiled = []
    (tmp_path / 'file').touch()
    monkeypatch.setattr(jit, '_unkept', [])
    monkeypatch.setattr(jit, 'COMPILED', True)
    monkeypatch.setattr(jit, 'LABELLING_IS_DEFERRED', False)
    monkeypatch.setattr(jit, 'CACHE_FOLDER', tmp_path / 'file' / 'cache')
    for name in (jit.TRACKING_SET, jit.LABELLING_SET):
        monkeypatch.setitem(SETS, name, lambda name=name: compiled.append(name))
    lines = []
    prepare_kernels(lines.append, labels_points=True)
    assert compiled == [jit.TRACKING_SET, jit.LABELLING_SET] and len(lines) == 1
    record, = caplog.records
    assert 'Not a directory' in record.getMessage() and 'NUMBA_CACHE_DIR' in record.getMessage()


@needs_numba
@pytest.mark.parametrize('interrupt', [None, KeyboardInterrupt])
def test_compiling_shows_how_many_kernels_are_compiled(tmp_path, monkeypatch, interrupt):
    # With numba.
    from hand_tracker.core.numerics.kernel_compiler import KernelCompiler

    done, shown = [], []

    class Shown:
        def __init__(self, total, what):
            shown.append(f'{total} {what}')

        def over(self, items):
            for _ in items:
                done.append(True)
                yield

    def compile_set():
        KernelCompiler.finished += half
        until = time.monotonic() + PATIENCE
        while len(done) < half:
            assert time.monotonic() < until
            time.sleep(.01)
        if interrupt:
            raise interrupt

    monkeypatch.setattr(compile_kernels, 'Progress', Shown)
    monkeypatch.setattr(jit, 'COMPILED', True)
    monkeypatch.setattr(jit, 'CACHE_FOLDER', tmp_path)
    monkeypatch.setitem(SETS, jit.TRACKING_SET, compile_set)
    monkeypatch.setattr(compile_kernels, 'kernel_count', lambda kernel_set: total)
    total, half = 6, 3
    with pytest.raises(interrupt) if interrupt else nullcontext():
        prepare_kernels(print)
    assert shown == [f'{total} kernels of tracking']
    assert len(done) == (half if interrupt else total)


@needs_numba
@pytest.mark.parametrize('program', [PROGRAM, FAST_PATH_PROGRAM])
def test_a_compiling_process_says_in_one_line_that_it_can_keep_nothing(tmp_path, program):
    if program == FAST_PATH_PROGRAM:
        pytest.importorskip('rclpy', reason='needs ROS 2')
    (tmp_path / 'file').touch()
    done = subprocess.run([sys.executable, '-m', program], capture_output=True, text=True, env={
        **os.environ, 'HAND_TRACKER_JIT': '1', 'NUMBA_CACHE_DIR': str(tmp_path / 'file'),
        'PYTHONPATH': os.pathsep.join([str(REPOSITORY), os.environ.get('PYTHONPATH', '')])})
    line, = done.stderr.splitlines()
    assert done.returncode == 1 and str(tmp_path / 'file') in line


def own_cache(folder):
    """Return a cache folder for the kernels of these sources alone."""
    cache = folder / jit.CACHE_NAME
    cache.mkdir()
    return cache


# Waits for a set of kernels that `mark` has on disk at once.
LINKED = """
import sys, time
from hand_tracker.core.numerics import jit
from hand_tracker.tracking.compilation import Compilation

compilation = Compilation({'one': lambda folder: None}, 'mark')
while not compilation.loaded and compilation.error is None:
    time.sleep(.01)
print(compilation.error, jit.ready_file('one', jit.CACHE_FOLDER))
"""


@needs_numba
@pytest.mark.parametrize('links_parent', [False, True], ids=['package', 'its folder'])
def test_a_package_behind_a_link_has_kernels_of_its_own(tmp_path, monkeypatch, links_parent):
    (tmp_path / 'mark.py').write_text(
        "from hand_tracker.core.numerics import jit\njit.mark_ready('one')\n")
    link = tmp_path / 'link'
    if links_parent:
        link.symlink_to(REPOSITORY)
    else:
        link.mkdir()
        (link / 'hand_tracker').symlink_to(REPOSITORY / 'hand_tracker')
    monkeypatch.chdir(tmp_path)
    ready = set()
    for place in (link, REPOSITORY):
        monkeypatch.setenv('PYTHONPATH', os.pathsep.join(
            [str(place), str(tmp_path), os.environ.get('PYTHONPATH', '')]))
        environment = {**os.environ, 'HAND_TRACKER_JIT': '1', 'NUMBA_CACHE_DIR': str(tmp_path)}
        done = subprocess.run([sys.executable, '-c', LINKED], env=environment,
                              capture_output=True, text=True)
        error, file = done.stdout.split()
        assert error == 'None', done
        ready.add(file)
    # numba keeps its kernels by these paths.
    assert len(ready) == 2


TWO_AT_ONCE = """
import sys, time
from pathlib import Path
from hand_tracker.tracking.compile_kernels import compile_lock
log = Path(sys.argv[1])

def say(word):
    with log.open('a') as file:
        file.write(f'{word}\\n')

say('wants')
with compile_lock('one'):
    say('in')
    while log.read_text().count('wants') < 2:
        time.sleep(.01)
    say('out')
"""


@needs_numba
def test_two_processes_compile_a_set_one_after_the_other(tmp_path):
    pytest.importorskip('fcntl', reason='there are no locks of files here')
    environment = {**os.environ, 'HAND_TRACKER_JIT': '1', 'NUMBA_CACHE_DIR': str(tmp_path),
                   'PYTHONPATH': str(REPOSITORY)}
    both = [subprocess.Popen([sys.executable, '-c', TWO_AT_ONCE, str(tmp_path / 'log')],
                             env=environment) for _ in range(2)]
    assert [process.wait(PATIENCE) for process in both] == [0, 0]
    words = (tmp_path / 'log').read_text().split()
    assert [word for word in words if word != 'wants'] == ['in', 'out', 'in', 'out']


@needs_numba
@pytest.mark.skipif(os.name != 'posix' or os.nice(0) > 0, reason='all runs at low priority')
def test_nobody_waits_for_a_compilation_of_low_priority(tmp_path):
    fcntl = pytest.importorskip('fcntl', reason='there are no locks of files here')
    cache = own_cache(tmp_path)
    environment = {**os.environ, 'HAND_TRACKER_JIT': '1', 'NUMBA_CACHE_DIR': str(cache),
                   'PYTHONPATH': str(REPOSITORY)}
    program = ('from hand_tracker.tracking.compile_kernels import complete_set\n'
               'complete_set("one", lambda: print("compiles", flush=True))')
    with open(cache / 'lock-one-background', 'w') as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        done = subprocess.run([sys.executable, '-c', program], env=environment, text=True,
                              stdout=subprocess.PIPE, timeout=PATIENCE, check=True)
    assert done.stdout == 'compiles\n'
    with open(cache / 'lock-two', 'w') as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        waiting = subprocess.Popen([sys.executable, '-c', program.replace('one', 'two')],
                                   env=environment, text=True, stdout=subprocess.PIPE,
                                   preexec_fn=lambda: os.nice(10))
        wait_for((cache / 'lock-two-background').exists)
        assert waiting.poll() is None
    assert waiting.communicate(timeout=PATIENCE)[0] == 'compiles\n'


WAITER = """
import os
from hand_tracker.tracking.compile_kernels import StarterEnded, complete_set
starter = os.getppid()
print('waits', flush=True)
try:
    complete_set('one', print, starter)
except StarterEnded:
    print('ended', flush=True)
"""
STARTER = f'import subprocess, sys; subprocess.Popen([sys.executable, "-c", {WAITER!r}]); input()'


@needs_numba
def test_who_waits_to_compile_ends_with_its_starter(tmp_path):
    fcntl = pytest.importorskip('fcntl', reason='there are no locks of files here')
    cache = own_cache(tmp_path)
    environment = {**os.environ, 'HAND_TRACKER_JIT': '1', 'NUMBA_CACHE_DIR': str(cache),
                   'PYTHONPATH': str(REPOSITORY)}
    with open(cache / 'lock-one', 'w') as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        starter = subprocess.Popen([sys.executable, '-c', STARTER], env=environment, text=True,
                                   stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        assert starter.stdout.readline() == 'waits\n'
        # Its output ends when both have ended.
        assert starter.communicate('\n', PATIENCE)[0] == 'ended\n'
    assert not list(cache.glob('ready-*'))


@needs_numba
def test_nobody_waits_to_compile_for_a_starter_that_ended_before(tmp_path):
    fcntl = pytest.importorskip('fcntl', reason='there are no locks of files here')
    cache = own_cache(tmp_path)
    ended = subprocess.Popen([sys.executable, '-c', ''])
    ended.wait()
    with open(cache / f'lock-{jit.TRACKING_SET}', 'w') as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        subprocess.run([sys.executable, '-m', PROGRAM], check=True, timeout=PATIENCE, env={
            **os.environ, 'HAND_TRACKER_JIT': '1', 'NUMBA_CACHE_DIR': str(cache),
            'PYTHONPATH': str(REPOSITORY), STARTER_VARIABLE: str(ended.pid)})
    assert not list(cache.glob('ready-*'))
