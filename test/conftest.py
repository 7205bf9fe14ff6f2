"""What comes before the tests: what they need, byte code and compiled kernels."""

import ast
import importlib.util
import os
import subprocess
import sys
import tempfile
import warnings
from pathlib import Path

import pytest

# Humble's pytest, 6.2, has paths of another kind.
HAS_PATHS = int(pytest.__version__.split('.')[0]) >= 7
# Compiles what the tests of tracking and of the fast path need.
COMPILE_ALL = 'hand_tracker.nodes.fast_path.compile_fast_path'
COMPILE = 'hand_tracker.tracking.compile_kernels'
# The longest first, so that no process is left alone with one of them at the end.
LONGEST = ('nodes/test_replay_node.py', 'core/test_tracker.py', 'core/test_tracker_occlusion.py',
           'nodes/test_tracker_node.py', 'cli/test_demo.py', 'viewer/test_viewer_browser.py',
           'calibration/test_fit.py', 'nodes/test_faults.py', 'evaluation/test_evaluation.py',
           'package/test_benchmarks.py', 'tracking/test_recording.py',
           'evaluation/test_captures.py', 'skin/test_load.py', 'nodes/fast_path/test_track_path.py',
           'package/test_security.py', 'nodes/test_hand_services.py', 'simulation/test_motions.py',
           'calibration/test_marker_fit.py', 'test_parallel.py', 'calibration/test_calibrate.py',
           'package/test_examples.py', 'package/test_end_to_end.py', 'core/test_tracker_layouts.py',
           'package/test_package.py', 'nodes/test_retarget_node.py',
           'calibration/test_layout_labels.py', 'nodes/test_mount_node.py', 'core/test_fuzz.py',
           'tracking/test_compilation.py', 'simulation/test_visibility.py',
           'nodes/test_all_node.py', 'core/pose/test_contact.py')


def pytest_configure(config):
    """Keep the byte code of all processes; compile the kernels, and import the tests, once.

    A node imports for three seconds where nothing keeps byte code, and tests start some hundred.
    """
    if os.environ.pop('PYTHONDONTWRITEBYTECODE', None):
        # Kernels may still be compiled in the background, by a process that outlives its node.
        folder = tempfile.TemporaryDirectory(prefix='hand_tracker-byte-code-',
                                             ignore_cleanup_errors=True)
        config.add_cleanup(folder.cleanup)
        os.environ.setdefault('PYTHONPYCACHEPREFIX', folder.name)
    # The threads of each worker's BLAS would spin beside all other workers.
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    if not getattr(config.option, 'numprocesses', None) or hasattr(config, 'workerinput'):
        return
    # One compiles all: kernels that two compile beside each other may differ in their last bits.
    # The other leaves the byte code of the tests, which every worker would make anew.
    run_together((COMPILE_ALL if importlib.util.find_spec('rclpy') else COMPILE,),
                 ('pytest', '--collect-only', '--numprocesses=0', *config.args))


def run_together(*programs):
    """Run modules with their arguments, all at once, and wait for them."""
    children = [subprocess.Popen(
        [sys.executable, '-m', *program], cwd=Path(__file__).parents[1],
        stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) for program in programs]
    for child in children:
        _, complaints = child.communicate()
        if child.returncode:
            warnings.warn(f'{child.args} failed: {complaints[-2000:]}', stacklevel=1)


def pytest_collection_finish(session):
    """Compile the kernels before nodes run, if only one process tests.

    The last bits of what kernels compiled in this process and those loaded by a node tell differ.
    """
    options = session.config.option
    if (options.collectonly or getattr(options, 'numprocesses', None)
            or hasattr(session.config, 'workerinput')
            or not any('nodes' in path_of(item).parts for item in session.items)
            or not importlib.util.find_spec('rclpy')):
        return
    from hand_tracker.core.numerics import jit
    from hand_tracker.nodes.fast_path.track_path import FastPath

    sets = jit.TRACKING_SET, FastPath.KERNEL_SET, jit.LABELLING_SET
    if jit.COMPILED and not all(map(jit.is_ready, sets)):
        run_together((COMPILE_ALL,))


def pytest_collection_modifyitems(items):
    """Run the longest files first."""
    folder = Path(__file__).parent

    def place(item):
        path = path_of(item)
        name = path.relative_to(folder).as_posix() if folder in path.parents else ''
        return LONGEST.index(name) if name in LONGEST else len(LONGEST)

    items.sort(key=place)


class LackingFile(pytest.File):
    """A file of tests that cannot be imported here; it is reported as skipped."""

    def collect(self):
        """Skip all of it."""
        pytest.skip(f"not installed: {', '.join(missing(path_of(self)))}")


def lacking_file(path, parent):
    """Skip a file whose `NEEDS` are not all installed.

    It is not imported, as a skip while a file is imported ends the collection of launch_testing.
    """
    if missing(Path(path)):
        return LackingFile.from_parent(parent, **{'path' if HAS_PATHS else 'fspath': path})


# By the names of its arguments pytest gives a hook what it asks for.
if HAS_PATHS:
    @pytest.hookimpl(tryfirst=True)
    def pytest_pycollect_makemodule(module_path, parent):
        """Hook of pytest from 7 on."""
        return lacking_file(module_path, parent)
else:
    @pytest.hookimpl(tryfirst=True)
    def pytest_pycollect_makemodule(path, parent):
        """Hook of pytest 6."""
        return lacking_file(path, parent)


def path_of(node):
    """Return the path of a file or of a test."""
    return node.path if HAS_PATHS else Path(node.fspath)


def missing(path):
    """Return the top-level packages that a file names in `NEEDS` and that are not installed."""
    source = path.read_bytes()
    for node in ast.parse(source).body if b'\nNEEDS = ' in source else ():
        if isinstance(node, ast.Assign) and ast.unparse(node.targets) == 'NEEDS':
            return [name for name in ast.literal_eval(node.value)
                    if importlib.util.find_spec(name) is None]
    return []
