"""The rules of docs/architecture.md: what may import what, and one meaning for a name."""

import ast
import os
import re
import subprocess
import sys
from collections import defaultdict
from functools import cache

import pytest

from benchmarks.import_order import ORDER, PACKAGE_FOLDER, imported_files, place, upward_imports
from benchmarks.repository import REPOSITORY

FAST_PATH = 'nodes/fast_path/'
FOLDERS = 'hand_tracker', 'launch', 'benchmarks', 'docs', 'examples', 'security', 'test'
UNPICKLING = {'pickle', 'marshal', 'shelve', 'dill', 'cloudpickle'}
SLOW_TO_IMPORT = {'matplotlib', 'numba', 'rosbags', 'scipy', 'skimage'}
TEXT_TO_CODE = {'eval', 'exec', 'os.system', 'os.popen', 'subprocess.getoutput'}


@cache
def sources():
    """Return the syntax tree of each module of the package by its path."""
    return {path.relative_to(PACKAGE_FOLDER).as_posix():
            ast.parse(path.read_text(encoding='utf-8'))
            for path in sorted(PACKAGE_FOLDER.rglob('*.py'))}


def top(name):
    """Return the folder of a module, or the module itself where it is in none."""
    return name.split('/')[0].removesuffix('.py')


def imports_of(name, tree):
    """Yield the dotted name below the package of every relative import of a module."""
    folder = ['hand_tracker', *name.split('/')[:-1]]
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = folder[:len(folder) - node.level + 1]
            base += node.module.split('.') if node.module else []
            for alias in node.names:
                yield '.'.join((*base[1:], alias.name))


def top_level_constants(tree):
    """Yield the uppercase names that a module assigns, each once."""
    found = set()
    for node in tree.body:
        targets = (node.targets if isinstance(node, ast.Assign) else
                   [node.target] if isinstance(node, ast.AnnAssign) else ())
        for target in targets:
            for leaf in ast.walk(target):
                if isinstance(leaf, ast.Name) and re.fullmatch('[A-Z][A-Z0-9_]*', leaf.id):
                    found.add(leaf.id)
    return found


def repeated(pairs):
    """Return the names that stand for several places."""
    places = defaultdict(list)
    for name, where in pairs:
        places[name].append(where)
    return {name: where for name, where in places.items() if len(where) > 1}


def test_every_file_has_its_place_in_the_order_and_every_place_a_file():
    assert {place(name) for name in sources()} == set(ORDER)


def test_no_import_runs_upwards():
    assert upward_imports() == []


def test_only_the_fast_path_imports_from_its_modules():
    imported = {target for name in sources() if not name.startswith(FAST_PATH)
                for target in imported_files(PACKAGE_FOLDER / name) if target.startswith(FAST_PATH)}
    assert imported == {f'{FAST_PATH}__init__.py'}


def test_imports_within_the_package_are_relative():
    absolute = [(name, node.lineno) for name, tree in sources().items() for node in ast.walk(tree)
                if isinstance(node, (ast.Import, ast.ImportFrom))
                and re.search(r"(module|name)='hand_tracker\b", ast.dump(node))]
    assert absolute == []


def test_only_commands_import_the_evaluation():
    importing = {top(name) for name, tree in sources().items()
                 for target in imports_of(name, tree) if top(target.replace('.', '/')) ==
                 'evaluation'}
    assert importing <= {'evaluation', 'cli'}


def test_core_imports_numpy_and_numba_alone():
    foreign = set()
    for name, tree in sources().items():
        if top(name) != 'core':
            continue
        assert [target for target in imports_of(name, tree) if target.split('.')[0] != 'core'] == []
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                foreign |= {alias.name.split('.')[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                foreign.add(node.module.split('.')[0])
    assert foreign - sys.stdlib_module_names <= {'numpy', 'numba'}


def test_nodes_that_run_beside_a_robot_start_without_slow_libraries():
    pytest.importorskip('rclpy')
    nodes = 'tracker', 'retarget', 'source', 'landmarks', 'skin'
    code = ('import sys; from importlib import import_module\n'
            f'for node in {nodes}: import_module(f"hand_tracker.nodes.{{node}}_node")\n'
            f'print(*sys.modules.keys() & {SLOW_TO_IMPORT})')
    found = subprocess.run(
        [sys.executable, '-c', code], env={**os.environ, 'HAND_TRACKER_JIT': '0'},
        capture_output=True, text=True, check=True)
    assert not found.stdout.split()


def test_no_bytes_become_code():
    """No pickle, no shell, no YAML or XML of more than plain trees."""
    found = []
    launch_files = {f'launch/{path.name}': ast.parse(path.read_text(encoding='utf-8'))
                    for path in (REPOSITORY / 'launch').glob('*.py')}
    for name, tree in {**sources(), **launch_files}.items():
        for node in ast.walk(tree):
            if isinstance(node, (ast.Import, ast.ImportFrom)):
                modules = {getattr(node, 'module', None) or '', *(one.name for one in node.names)}
                found += [(name, module) for module in modules & UNPICKLING]
            elif isinstance(node, ast.Call):
                called = ast.unparse(node.func)
                options = {one.arg: ast.unparse(one.value) for one in node.keywords}
                if (called in TEXT_TO_CODE or 'shell' in options
                        or called == 'np.load' and options.get('allow_pickle') != 'False'
                        or re.fullmatch(r'yaml\.\w*load\w*', called)
                        and name != 'files/plain_yaml.py'
                        or re.fullmatch(r'(ElementTree|minidom)\.(fromstring|parse|iterparse|XML)',
                                        called) and name != 'files/plain_xml.py'):
                    found.append((name, ast.unparse(node)))
    assert found == []


def repository_files():
    """Return the Python files of the repository; not what Sphinx has copied."""
    return [path for folder in FOLDERS for path in sorted((REPOSITORY / folder).rglob('*.py'))
            if '_build' not in path.parts]


def test_no_two_modules_have_one_name():
    names = ((path.name, path) for path in repository_files())
    assert {name: where for name, where in repeated(names).items()
            if name not in ('__init__.py', '__main__.py')} == {}


def constants_of(files):
    """Yield the constants of files of the repository, each with its file."""
    for path in files:
        for constant in top_level_constants(ast.parse(path.read_text(encoding='utf-8'))):
            yield constant, path.relative_to(REPOSITORY).as_posix()


def test_no_constant_has_two_meanings():
    """The constants of test files are their own, but none has the name of one of the package."""
    tests = sorted((REPOSITORY / 'test').rglob('test_*.py'))
    others = [path for path in repository_files() if path not in tests]
    assert repeated(constants_of(others)) == {}
    package = {constant for constant, file in constants_of(others)
               if file.startswith(('hand_tracker/', 'launch/'))}
    assert [(constant, file) for constant, file in constants_of(tests)
            if constant in package] == []


def test_no_two_modules_define_one_class_or_function():
    public = ((node.name, name) for name, tree in sources().items() for node in tree.body
              if isinstance(node, (ast.ClassDef, ast.FunctionDef)) and node.name[0] != '_')
    entry_points = {'main', 'calibrate'}
    # What the modules of evaluation/ have in common.
    interface = {'evaluate', 'judge', 'losses', 'pictures', 'tables'}
    assert set(repeated(public)) <= entry_points | interface


def test_every_folder_of_the_core_names_its_modules():
    for folder in sorted(path for path in (PACKAGE_FOLDER / 'core').iterdir() if path.is_dir()):
        text = ast.get_docstring(
            sources().get(f'core/{folder.name}/__init__.py', ast.Module([], [])))
        modules = {path.stem for path in folder.glob('*.py')} - {'__init__'}
        assert modules <= set(re.findall(r'`(\w+)`', text or '')), folder.name


def test_the_architecture_names_what_is_there():
    text = (REPOSITORY / 'docs' / 'architecture.md').read_text(encoding='utf-8')
    files = {path.name for folder in (PACKAGE_FOLDER, REPOSITORY / 'test')
             for path in folder.rglob('*.py')}
    named = set(re.findall(r'`(\w+\.py)`', text))
    assert named - files == set()
    folders = set(re.findall(r'`([\w/]+)/`', text))
    assert [name for name in folders if not (PACKAGE_FOLDER / name).is_dir()
            and not (REPOSITORY / name).is_dir()] == []


def test_the_architecture_names_every_folder_and_most_modules():
    text = (REPOSITORY / 'docs' / 'architecture.md').read_text(encoding='utf-8')
    expected = {f'{name.rpartition("/")[0]}/' for name in sources() if '/' in name}
    expected |= {name.split('/')[-1] for name in sources() if '__init__' not in name
                 and top(name) in ('core', 'messages', 'tracking', 'nodes', 'files', 'adapters',
                                   'calibration', 'retargeting', 'splicing')}
    assert [name for name in sorted(expected) if f'`{name}`' not in text] == []
