"""The package as a whole: what it declares, what it installs, and what its core may import."""

import ast
import importlib
import re
import shutil
import signal
import subprocess
import sys
from dataclasses import fields
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree
from zipfile import ZipFile

import pytest

import hand_tracker
from benchmarks.repository import REPOSITORY
from hand_tracker import TrackerOptions, package_data
from hand_tracker.__main__ import BROKEN_PIPE_EXIT_CODE
from hand_tracker.entry import NODES
from hand_tracker.nodes.tracker_parameters import START

DATA_FOLDERS = ('config', 'config/robots', 'examples', 'launch', 'recordings', 'urdf')

# Import name -> rosdep key, where they differ.
ROSDEP_KEYS = {
    'PIL': 'python3-pil',
    'joblib': 'python3-joblib',
    'matplotlib': 'python3-matplotlib',
    'numpy': 'python3-numpy',
    'rosbags': 'python3-rosbags-pip',
    'scipy': 'python3-scipy',
    'skimage': 'python3-skimage',
    'trimesh': 'python3-trimesh-pip',
    'yaml': 'python3-yaml',
}
# Started, not imported.
STARTED_ONLY = {'ros2launch'}
# Imported only where it is found, and without a package on some supported platforms.
OPTIONAL = {'distributed', 'fsspec', 'numba', 'llvmlite', 'mujoco', 'qtm_rt', 'viser', 'websockets'}

FORBIDDEN_IN_CORE = {'PIL', 'joblib', 'matplotlib', 'rclpy', 'rosbags', 'scipy', 'skimage',
                     'tf2_msgs', 'trimesh', 'yaml'}
CORE = sorted((REPOSITORY / 'hand_tracker' / 'core').rglob('*.py'))


def imported_modules(tree):
    """Yield the top-level name of every absolute import anywhere in `tree`."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name.split('.')[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            yield node.module.split('.')[0]


def parse(path):
    return ast.parse(path.read_text(encoding='utf-8'), filename=str(path))


@pytest.fixture(scope='module')
def manifest():
    return ElementTree.parse(REPOSITORY / 'package.xml').getroot()


@pytest.fixture(scope='module')
def wheel(tmp_path_factory):
    """Build a wheel from a copy of the checkout, as building writes into its sources."""
    pytest.importorskip('pip', reason='pip, which builds the wheel, is not installed')
    folder = tmp_path_factory.mktemp('wheel')
    ignored = shutil.ignore_patterns('.*', '*.egg-info', 'build', 'install', 'log', '__pycache__')
    shutil.copytree(REPOSITORY, folder / 'checkout', ignore=ignored)
    run_pip('wheel', '--no-build-isolation', '-w', folder, folder / 'checkout')
    return next(folder.glob('*.whl'))


def run_pip(command, *arguments):
    subprocess.run(
        [sys.executable, '-m', 'pip', command, '-q', '--no-deps', *map(str, arguments)], check=True
    )


def run_python(code, cwd, *arguments):
    """Run `code` in a Python of its own, and return what it prints."""
    command = [sys.executable, '-c', code, *arguments]
    return subprocess.run(command, cwd=cwd, check=True, stdout=subprocess.PIPE, text=True).stdout


def test_version_is_stated_alike(manifest):
    assert manifest.findtext('version') == hand_tracker.__version__


def test_the_reference_lists_the_public_names():
    text = (REPOSITORY / 'docs' / 'api.rst').read_text(encoding='utf-8')
    names = re.search(r'toctree: generated\n\n((?: +\w+\n)+)', text)[1]   # of the first list
    assert sorted(names.split()) == sorted(hand_tracker.__all__)


def test_public_names_are_imported_when_they_are_first_used():
    names = ', '.join(hand_tracker.__all__)
    before, listed, after = run_python(
        'import sys, hand_tracker; print(*sys.modules); print(*dir(hand_tracker)); '
        f'from hand_tracker import {names}; print(*sys.modules)', cwd=REPOSITORY).splitlines()
    ours = [name for name in before.split() if name.startswith('hand_tracker')]
    assert ours == ['hand_tracker'] and 'numpy' not in before.split()
    assert set(hand_tracker.__all__) <= set(listed.split())
    assert 'numpy' in after.split()


def test_public_names_are_those_of_their_modules():
    for name, module in hand_tracker._MODULES.items():
        value = getattr(hand_tracker, name)
        assert value is getattr(importlib.import_module(module, 'hand_tracker'), name)
        assert value.__doc__


def test_types_know_the_public_names():
    tree = parse(Path(hand_tracker.__file__))
    (block,) = [node for node in tree.body if isinstance(node, ast.If)]
    typed = {alias.name: f'.{node.module}' for node in block.body for alias in node.names}
    assert typed == hand_tracker._MODULES
    assert sorted(typed) == hand_tracker.__all__


def test_an_unknown_name_is_refused():
    with pytest.raises(AttributeError, match="'hand_tracker' has no attribute 'Glove'"):
        _ = hand_tracker.Glove


def test_help_imports_nothing_that_computes():
    modules = set(run_python(
        'import sys; from hand_tracker.__main__ import main; main(["--help"]); '
        'print(*sys.modules)', cwd=REPOSITORY).split())
    assert modules & {'numpy', 'numba', 'matplotlib', 'rclpy', 'scipy'} == set()


@pytest.mark.parametrize('arguments', [
    ['demo', '--side', 'up'], ['demo', '--hand', 'none.yaml'], ['demo', '--recording', 'none.c3d'],
    ['demo', '--robot', 'none.urdf'], ['view', 'none.mcap'], ['robot', 'inspect', 'none.urdf'],
    ['robot', 'view', 'none.urdf'], ['calibrate', 'none.npz', '-o', 'hand.yaml'],
    ['evaluate', 'markers', 'none.npz'], ['evaluate', 'none'], ['skin', '--side', 'up'],
    ['urdf', '--hand', 'none.yaml'], ['plot', 'none.mcap'], ['record', '--side', 'up'],
    ['track', 'none.mcap', '-o', 'angles.csv'], ['track', '--wrong'], ['simulate', '--wrong'],
    ['convert', 'none.mcap', 'other.c3d'], ['convert', '--wrong'], ['inspect', 'none.c3d'],
    ['splice', 'none.bvh', 'none.mcap', '-o', 'out.bvh'], ['splice', '--wrong']],
    ids=' '.join)
def test_what_is_wrong_is_said_before_anything_heavy_is_imported(arguments):
    code, modules = run_python(
        'import sys; from hand_tracker.__main__ import main\ntry: code = main(sys.argv[1:])\n'
        'except SystemExit as end: code = end.code\nprint(code); print(*sys.modules)',
        REPOSITORY, *arguments).splitlines()[-2:]
    assert code in ('1', '2')
    assert set(modules.split()) & {'matplotlib', 'numba', 'rclpy', 'rosbags', 'scipy'} == set()


@pytest.mark.parametrize('arguments', [['--help'], ['urdf']], ids=' '.join)
def test_output_that_nobody_reads_ends_a_command_quietly(arguments):
    with subprocess.Popen([sys.executable, '-m', 'hand_tracker', *arguments], cwd=REPOSITORY,
                          stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        process.stdout.close()
        assert process.stderr.read() == ''
    assert process.returncode == BROKEN_PIPE_EXIT_CODE


def test_manifest_is_a_format_3_ament_python_package(manifest):
    assert manifest.get('format') == '3'
    assert manifest.findtext('name') == 'hand_tracker'
    assert manifest.findtext('export/build_type') == 'ament_python'


def test_manifest_covers_every_import(manifest):
    declared = {depend.text for depend in manifest.findall('exec_depend')}
    sources = [*(REPOSITORY / 'hand_tracker').rglob('*.py'), *(REPOSITORY / 'launch').glob('*.py')]
    imported = {name for path in sources for name in imported_modules(parse(path))}
    foreign = imported - sys.stdlib_module_names - OPTIONAL - {'hand_tracker'}
    assert {ROSDEP_KEYS.get(name, name) for name in foreign} - declared == set()


def test_manifest_declares_nothing_that_is_not_used(manifest):
    declared = {depend.text for depend in manifest.findall('exec_depend')}
    sources = [*(REPOSITORY / 'hand_tracker').rglob('*.py'), *(REPOSITORY / 'launch').glob('*.py')]
    text = '\n'.join(path.read_text() for path in sources)
    names = {key: name for name, key in ROSDEP_KEYS.items()}
    assert [depend for depend in declared - STARTED_ONLY
            if not re.search(rf'\b{names.get(depend, depend)}\b', text)] == []


def test_no_file_of_tests_skips_while_it_is_imported():
    for path in (REPOSITORY / 'test').rglob('*.py'):
        # A skip at import ends the collection of launch_testing: `NEEDS` is for that.
        found = [ast.unparse(node) for node in ast.parse(path.read_bytes()).body
                 if not isinstance(node, ast.FunctionDef | ast.ClassDef)
                 and re.search(r'\b(importorskip|skip)\(', ast.unparse(node))]
        assert not found, path


def test_markers_of_pytest_are_used():
    (markers,) = re.findall(r'(?m)^markers = \[(.*)\]', (REPOSITORY / 'pyproject.toml').read_text())
    declared = re.findall(r'"(\w+): ', markers)
    assert declared
    tests = '\n'.join(path.read_text() for path in (REPOSITORY / 'test').rglob('*.py'))
    assert [name for name in declared if f'pytest.mark.{name}' not in tests] == []


def test_an_interrupt_while_a_command_is_imported_is_quiet():
    command = [sys.executable, '-X', 'importtime', '-m', 'hand_tracker', 'demo']
    process = subprocess.Popen(command, cwd=REPOSITORY, stderr=subprocess.PIPE, text=True)
    head = []
    # What it needs next comes after its own imports.
    while not head or 'matplotlib' not in head[-1]:
        head.append(process.stderr.readline())
        assert head[-1], ''.join(head)
    process.send_signal(signal.SIGINT)
    rest = process.communicate()[1]
    assert process.returncode == 130
    assert 'Traceback' not in rest


def test_entry_points_lead_to_functions():
    targets = re.findall(r"'(\w+) = ([\w.]+):(\w+)'", (REPOSITORY / 'setup.py').read_text())
    assert len(targets) == 14
    for _, module, function in targets:
        path = REPOSITORY / (module.replace('.', '/') + '.py')
        assert path.is_file()
        names = [node.name for node in parse(path).body if isinstance(node, ast.FunctionDef)]
        assert function in names, path
    assert set(NODES) == {script for script, _, _ in targets} - {'hand_tracker'}


@pytest.mark.parametrize('path', CORE, ids=lambda path: str(path.relative_to(REPOSITORY)))
def test_core_needs_no_ros_no_files_and_no_plots(path):
    tree = parse(path)
    imported = set(imported_modules(tree))
    assert imported & FORBIDDEN_IN_CORE == set()
    assert [name for name in imported if name.endswith(('_msgs', '_interfaces'))] == []
    calls = [node.func for node in ast.walk(tree) if isinstance(node, ast.Call)]
    assert [call for call in calls if isinstance(call, ast.Name) and call.id == 'open'] == []


def test_core_imports_no_other_folder():
    names = ('.'.join(path.relative_to(REPOSITORY).with_suffix('').parts) for path in CORE)
    imports = ''.join(f'import {name.removesuffix(".__init__")}; ' for name in names)
    modules = set(run_python(f'{imports}import sys; print(*sys.modules)', cwd=REPOSITORY).split())
    ours = {name for name in modules if name.startswith('hand_tracker.')}
    assert {name for name in ours if not re.match(r'hand_tracker\.core\b', name)} == set()
    assert modules & {'rclpy', 'matplotlib', 'rosbags'} == set()


def test_checkout_is_its_own_share_directory():
    if not Path(package_data.__file__).resolve().is_relative_to(REPOSITORY):
        pytest.skip('an installed hand_tracker is under test, not the checkout')
    assert package_data.share_directory() == REPOSITORY


@pytest.mark.parametrize(
    'libraries', ['lib/python3.12/site-packages', 'local/lib/python3.12/dist-packages', '.']
)
def test_share_directory_of_an_installed_package(tmp_path, libraries):
    code = tmp_path / libraries / 'hand_tracker'
    data = tmp_path / 'share' / 'hand_tracker'
    code.mkdir(parents=True)
    data.mkdir(parents=True)
    (data / 'package.xml').touch()
    assert package_data._share_directory(code) == data


def test_share_directory_says_what_is_wrong(tmp_path):
    with pytest.raises(FileNotFoundError, match='share/hand_tracker'):
        package_data._share_directory(tmp_path / 'hand_tracker')


def test_wheel_holds_the_data_files(wheel):
    expected = {
        f'{folder}/{path.name}'
        for folder in DATA_FOLDERS
        for path in (REPOSITORY / folder).glob('[!.]*')
        if path.is_file()
    }
    names = ZipFile(wheel).namelist()
    prefix = f'hand_tracker-{hand_tracker.__version__}.data/data/share/'
    shared = {name[len(prefix):] for name in names if name.startswith(prefix)}
    assert shared >= {f'hand_tracker/{name}' for name in expected}
    assert {'hand_tracker/package.xml', 'hand_tracker/security/hand_tracker.policy.xml'} <= shared
    sources = [path for path in (REPOSITORY / 'hand_tracker').rglob('*') if path.suffix == '.py']
    assert set(names) >= {str(path.relative_to(REPOSITORY)) for path in sources}
    assert 'hand_tracker/py.typed' in names
    assert 'ament_index/resource_index/packages/hand_tracker' in shared
    assert [name for name in names if name.startswith(('test/', 'overlay/', 'tf2_ros/'))] == []


def test_installed_wheel_finds_its_data(wheel, tmp_path):
    run_pip('install', '--prefix', tmp_path, '--ignore-installed', wheel)
    (code,) = tmp_path.rglob('hand_tracker/package_data.py')
    ask = 'from hand_tracker.package_data import share_directory; print(share_directory())'
    found = Path(run_python(ask, cwd=code.parent.parent).strip())
    assert found.is_relative_to(tmp_path.resolve())
    assert (found / 'package.xml').is_file()


def test_an_editable_install_is_found_beside_a_checkout_of_its_name(tmp_path):
    # To import it here may fail: another distutils is imported already.
    if find_spec('setuptools') is None:
        pytest.skip('setuptools, which builds the package, is missing')
    checkout, installed = tmp_path / 'hand_tracker', tmp_path / 'installed'
    ignored = shutil.ignore_patterns('.*', '*.egg-info', 'build', 'install', 'log', '__pycache__')
    shutil.copytree(REPOSITORY, checkout, ignore=ignored)
    # As pip has it built.
    run_python('from setuptools.build_meta import build_editable; '
               f'build_editable({str(tmp_path)!r})', cwd=checkout)
    with ZipFile(next(tmp_path.glob('*.whl'))) as built:
        built.extractall(installed)
    # Neither other installs nor PYTHONPATH: the folder beside it and this install alone.
    found = subprocess.run(
        [sys.executable, '-E', '-S', '-c', f'import site; site.addsitedir({str(installed)!r}); '
         'import hand_tracker; print(hand_tracker.__version__, hand_tracker.__file__)'],
        cwd=tmp_path, check=True, stdout=subprocess.PIPE, text=True).stdout
    version, file = found.strip().split(maxsplit=1)
    assert version == hand_tracker.__version__
    assert Path(file) == checkout.resolve() / 'hand_tracker' / '__init__.py'


def test_the_documents_name_every_argument_and_parameter():
    text = (REPOSITORY / 'docs' / 'ros.md').read_text(encoding='utf-8')
    named = set(re.findall(r'`([^`]+)`', text))
    launch = (REPOSITORY / 'launch' / 'track.launch.py').read_text(encoding='utf-8')
    arguments = re.findall(r"ArgumentRow\(\s*'(\w+)'", launch)
    assert len(arguments) > 10
    assert [name for name in arguments if name not in named] == []
    assert [row.name for row in START if not row.name.startswith('qos.')
            and row.name not in named] == []
    options = [option.name for option in fields(TrackerOptions)
               if not option.name.startswith(('link_', 'bound_'))]
    assert [name for name in options if name not in named] == []


def test_links_of_the_documents_lead_somewhere():
    documents = [*REPOSITORY.glob('*.md'), *(REPOSITORY / 'docs').glob('*.md')]
    broken = []
    for document in documents:
        for link in re.findall(r'\]\(([^)#\s]+)', document.read_text(encoding='utf-8')):
            if '://' not in link and not (document.parent / link).exists():
                broken.append((document.name, link))
    assert broken == []
