"""The order of the package's folders, and the imports that run against it."""

import ast
from pathlib import Path

from benchmarks.repository import PACKAGE_FOLDER

# Folders and files from the lowest to the highest: each imports only those before it, and those
# in the same place. What stands for a folder holds for all in it that has no place of its own.
ORDER = ('__init__.py', 'core/errors.py', 'core/numerics', 'core/model', 'core/filtering',
         'core/labelling', 'core/occlusion', 'core/inverse_kinematics', 'core/pose',
         'core/point_labelling', 'core', 'background.py', 'package_data.py', 'output_files.py',
         'parallel.py', 'interruption.py', 'progress.py', 'drawing', 'messages', 'files',
         'calibration', 'retargeting', 'simulation', 'skin', 'adapters', 'tracking', 'splicing',
         'evaluation', 'viewer', 'nodes/parameters.py',
         'nodes/tracker_parameters.py', 'nodes/executors.py', 'nodes/runner.py',
         'nodes/serialization.py', 'nodes/fast_path', 'nodes', 'launching', 'cli',
         '__main__.py', 'entry.py')


def place(file):
    """Return the folder or file of `ORDER` that a file belongs to.

    Parameters
    ----------
    file : str
        Relative to the package.

    Raises
    ------
    LookupError
        If it has no place.
    """
    path = Path(file)
    for part in (path, *path.parents):
        if part.as_posix() in ORDER:
            return part.as_posix()
    raise LookupError(f'{file} has no place in {", ".join(ORDER)}')


def is_upward(source, target):
    """Return whether file `target` has a higher place than file `source`."""
    return ORDER.index(place(target)) > ORDER.index(place(source))


def imported_files(path):
    """Return the files of the package that a file imports at run time, relative to the package.

    Parameters
    ----------
    path : Path
        Of a Python file of the package.

    Returns
    -------
    set of str
    """
    package, found = list(path.relative_to(PACKAGE_FOLDER).parts[:-1]), set()
    tree = ast.parse(path.read_text(encoding='utf-8'))
    for_types = {id(inner) for node in ast.walk(tree) if isinstance(node, ast.If)
                 and ast.unparse(node.test) == 'TYPE_CHECKING' for inner in ast.walk(node)}
    for node in ast.walk(tree):
        if not isinstance(node, ast.ImportFrom) or not node.level or id(node) in for_types:
            continue
        base = package[:len(package) - node.level + 1]
        base += node.module.split('.') if node.module else []
        for alias in node.names:
            names = (Path(*base, f'{alias.name}.py'), Path(*base, alias.name, '__init__.py'),
                     Path(*base).with_suffix('.py') if base else Path('__init__.py'),
                     Path(*base, '__init__.py'))
            found.add(next(name.as_posix() for name in names if (PACKAGE_FOLDER / name).is_file()))
    return found


def upward_imports():
    """Return pairs (file, imported file) of which the second has a higher place."""
    return sorted(
        (source, target) for path in PACKAGE_FOLDER.rglob('*.py')
        for source in [path.relative_to(PACKAGE_FOLDER).as_posix()]
        for target in imported_files(path) if is_upward(source, target))
