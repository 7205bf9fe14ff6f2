"""What comes before the tests: what they need, and compiled kernels."""

import ast
import importlib.util
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

UPDATE = """
from hand_tracker.core.tracker import HandTracker
tracker = HandTracker()
tracker.update([[0.] * 3] * 8)
tracker.update([[0.] * 3] * 8, distal_flexion=[0.] * 5)
"""
DIRECT = UPDATE + """
from contextlib import suppress
from hand_tracker.nodes.fast_path.middleware import Direct
from hand_tracker.nodes.fast_path.rcl import Unavailable
from hand_tracker.nodes.serialization import codec_agrees
codec_agrees()
with suppress(Unavailable):
    Direct(tracker)
"""


def pytest_configure(config):
    """Compile the kernels once, where several processes would do so side by side."""
    if not getattr(config.option, 'numprocesses', None) or hasattr(config, 'workerinput'):
        return
    program = DIRECT if importlib.util.find_spec('rclpy') else UPDATE
    done = subprocess.run([sys.executable, '-c', program], cwd=Path(__file__).parents[1],
                          stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    if done.returncode:
        warnings.warn(f'the kernels were not compiled: {done.stderr[-2000:]}', stacklevel=1)


class LackingFile(pytest.File):
    """A file of tests that cannot be imported here; it is reported as skipped."""

    def collect(self):
        """Skip all of it."""
        pytest.skip(f"not installed: {', '.join(missing(self.path))}")


@pytest.hookimpl(tryfirst=True)
def pytest_pycollect_makemodule(module_path, parent):
    """Skip a file whose `NEEDS` are not all installed.

    It is not imported, as a skip while a file is imported ends the collection of launch_testing.
    """
    if missing(module_path):
        return LackingFile.from_parent(parent, path=module_path)


def missing(path):
    """Return the top-level packages that a file names in `NEEDS` and that are not installed."""
    for node in ast.parse(path.read_bytes()).body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets) == 'NEEDS':
            return [name for name in ast.literal_eval(node.value)
                    if importlib.util.find_spec(name) is None]
    return []


@pytest.fixture(scope='session')
def conformal():
    """Return the paper's conformal algebra, an oracle for the vector forms."""
    pytest.importorskip('clifford', reason='clifford, the oracle, is not installed')
    from helpers import conformal
    return conformal
