"""The rules of docs/architecture.md: what may import what, and one meaning for a name."""

import ast
import re
import sys
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / 'hand_tracker'
MODULES = {path.relative_to(PACKAGE).as_posix(): ast.parse(path.read_text(encoding='utf-8'))
           for path in sorted(PACKAGE.rglob('*.py'))}
# A folder imports from those before it. The modules beside the folders are in one of them all.
ORDER = ('core', 'package_data', 'parallel', 'progress', 'drawing', 'messages', 'files',
         'calibration', 'simulation', 'skin', 'tracking', 'evaluation', 'viewer', 'nodes', 'cli',
         '__main__', 'entry', '__init__')
# Within the core: tools, then the hand, then the steps of the method in their order.
CORE_ORDER = ('errors', 'numerics', 'model', 'filtering', 'labelling', 'occlusion',
              'inverse_kinematics', 'pose')


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
    for name, place in pairs:
        places[name].append(place)
    return {name: where for name, where in places.items() if len(where) > 1}


def test_every_folder_has_its_place_in_the_order():
    assert {top(name) for name in MODULES} == set(ORDER)


def test_no_import_runs_upwards():
    upwards = [(name, target) for name, tree in MODULES.items()
               for target in imports_of(name, tree)
               if target != '__version__'
               and ORDER.index(target.split('.')[0]) > ORDER.index(top(name))]
    assert upwards == []


def test_no_import_runs_upwards_within_the_core():
    upwards = [(name, target) for name, tree in MODULES.items()
               if top(name) == 'core' and name.split('/')[1] in CORE_ORDER
               for target in imports_of(name, tree)
               if CORE_ORDER.index(target.split('.')[1]) > CORE_ORDER.index(name.split('/')[1])]
    assert upwards == []


def test_imports_within_the_package_are_relative():
    absolute = [(name, node.lineno) for name, tree in MODULES.items() for node in ast.walk(tree)
                if isinstance(node, (ast.Import, ast.ImportFrom))
                and re.search(r"(module|name)='hand_tracker\b", ast.dump(node))]
    assert absolute == []


def test_only_commands_import_the_evaluation():
    importing = {top(name) for name, tree in MODULES.items()
                 for target in imports_of(name, tree) if top(target.replace('.', '/')) ==
                 'evaluation'}
    assert importing <= {'evaluation', 'cli'}


def test_core_imports_numpy_and_numba_alone():
    foreign = set()
    for name, tree in MODULES.items():
        if top(name) != 'core':
            continue
        assert [target for target in imports_of(name, tree) if target.split('.')[0] != 'core'] == []
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                foreign |= {alias.name.split('.')[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and not node.level:
                foreign.add(node.module.split('.')[0])
    assert foreign - sys.stdlib_module_names <= {'numpy', 'numba'}


def test_no_two_modules_have_one_name():
    names = ((path.split('/')[-1], path) for path in MODULES)
    assert {name: where for name, where in repeated(names).items()
            if name not in ('__init__.py', '__main__.py')} == {}


def test_no_two_modules_define_one_constant():
    constants = ((constant, name) for name, tree in MODULES.items()
                 for constant in top_level_constants(tree))
    assert repeated(constants) == {}


def test_the_architecture_names_what_is_there():
    text = (ROOT / 'docs' / 'architecture.md').read_text(encoding='utf-8')
    files = {path.name for folder in (PACKAGE, ROOT / 'test') for path in folder.rglob('*.py')}
    named = set(re.findall(r'`(\w+\.py)`', text))
    assert named - files == set()
    folders = set(re.findall(r'`([\w/]+)/`', text))
    assert [name for name in folders if not (PACKAGE / name).is_dir()
            and not (ROOT / name).is_dir()] == []


def test_the_architecture_names_every_folder_and_the_modules_of_a_frame():
    text = (ROOT / 'docs' / 'architecture.md').read_text(encoding='utf-8')
    expected = {f'{name.rpartition("/")[0]}/' for name in MODULES if '/' in name}
    expected |= {name.split('/')[-1] for name in MODULES if '__init__' not in name
                 and top(name) in ('core', 'messages', 'tracking', 'nodes')}
    assert [name for name in sorted(expected) if f'`{name}`' not in text] == []
