"""The document of results: every table and picture, and how they were made."""

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from .. import __version__
from ..core.jit import COMPILED

LIBRARIES = ('numpy', 'scipy', 'matplotlib', 'numba')


def versions():
    """Return what the numbers were made with, by name."""
    found = {'hand_tracker': __version__, 'Python': platform.python_version()}
    for library in LIBRARIES:
        try:
            found[library] = version(library)
        except PackageNotFoundError:
            found[library] = 'not installed'
    return found


def hardware():
    """Return processor, its cores and the system in words."""
    processor = platform.processor() or platform.machine()
    try:
        lines = Path('/proc/cpuinfo').read_text(encoding='utf-8').splitlines()
        processor = next(line.partition(':')[2].strip() for line in lines
                         if line.startswith('model name'))
    except (OSError, StopIteration):
        pass  # not Linux, or a processor without a name
    return f'{processor}, {os.cpu_count()} cores, {platform.system()} {platform.machine()}'


def command_line(name, options, path):
    """Return the command that made the results; of files only their names."""
    files = ' '.join(Path(file).name for file in options.files)
    return (f'hand_tracker evaluate {name} {files}'.rstrip()
            + f' --seed {options.seed} --jobs {options.jobs} --results {path.name}')


def write_results(path, rows, modules, command):
    """Write the document, and its pictures into the folder named after it.

    Parameters
    ----------
    path : Path
        Of a Markdown file.
    rows : list of dict
        Of all evaluations, as `run` returns them or a JSON file has them.
    modules : dict of module
        The evaluations to write about, by name.
    command : str
        That made the rows.
    """
    folder = path.parent / path.stem
    folder.mkdir(parents=True, exist_ok=True)
    made = ', '.join(f'{name} {number}' for name, number in versions().items())
    parts = ['# Results', 'Made by a command, not by hand; the same seed gives the same '
             'numbers, but for times measured by the clock.',
             f'```\n{command}\n```',
             f'- Versions: {made}; kernels {"compiled" if COMPILED else "not compiled"}.\n'
             f'- Hardware: {hardware()}.']
    for name, module in modules.items():
        found = [row for row in rows if row['evaluation'] == name]
        parts += [f'## {module.TITLE}', module.__doc__.strip(),
                  f'`hand_tracker evaluate {name}`, {len(found)} rows.']
        parts += [table.text() for table in module.tables(found)]
        parts += [f'![{picture.caption}]({path.stem}/{picture.file})'
                  for picture in module.pictures(found, folder)]
    path.write_text('\n\n'.join(parts) + '\n', encoding='utf-8')
