"""The document of results: every table and picture, and how they were made."""

import os
import platform
import re
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from .. import __version__
from ..core.numerics.jit import COMPILED
from . import simulated
from .tables import Table

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


def processor():
    """Return the name of the processor."""
    try:
        lines = Path('/proc/cpuinfo').read_text(encoding='utf-8').splitlines()
        return next(line.partition(':')[2].strip() for line in lines
                    if line.startswith('model name'))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()  # not Linux, or one without a name


def hardware():
    """Return processor, its cores and the system in words."""
    return f'{processor()}, {os.cpu_count()} cores, {platform.system()} {platform.machine()}'


def command_line(name, files, options, path):
    """Return the command that made the results, its files in the folder `$CAPTURES`."""
    files = ' '.join(f'$CAPTURES/{Path(file).name}' for file in files)
    # Relative to the project, where the document belongs.
    document = path if not path.is_absolute() else Path(path.parent.name, path.name)
    return (f'hand_tracker evaluate {name} {files}'.rstrip()
            + f' --seed {options.seed} --jobs {options.jobs} --results {document}')


def write_results(path, rows, modules, options, command):
    """Write the document, and its pictures into the folder named after it.

    Parameters
    ----------
    path : Path
        Of a Markdown file.
    rows : list of dict
        Of all evaluations, as `run` returns them or a JSON file has them.
    modules : dict of module
        The evaluations to write about, by name.
    options : Options
        Of the evaluations.
    command : str
        That made the rows.
    """
    folder = path.parent / path.stem
    folder.mkdir(parents=True, exist_ok=True)
    rows = {name: [row for row in rows if row['evaluation'] == name] for name in modules}
    made = ', '.join(f'{name} {number}' for name, number in versions().items())
    parts = ['# Results', 'Made by a command, not by hand; the same seed gives the same '
             'numbers, but for times measured by the clock. Speed, start-up and memory have '
             'commands of their own, and tables in [benchmarks.md](benchmarks.md).',
             f'```\n{command}\n```',
             *(['`CAPTURES` is the folder of the recordings.'] if '$' in command else []),
             f'- Versions: {made}; kernels {"compiled" if COMPILED else "not compiled"}.\n'
             f'- Hardware: {hardware()}.']
    parts += _losses(rows, modules)
    if any(not getattr(module, 'NEEDS_FILES', False) for module in modules.values()):
        parts += ['## How hands are simulated', simulated.__doc__.partition('\n')[2].strip()]
    if options.captures or options.left_out:
        parts += _captures(options)
    for name, module in modules.items():
        parts += [f'## {module.TITLE}', module.__doc__.strip(),
                  f'`hand_tracker evaluate {name}`, {len(rows[name])} rows.']
        parts += [table.text() for table in module.tables(rows[name])]
        parts += [f'![{picture.caption}]({path.stem}/{picture.file})'
                  for picture in module.pictures(rows[name], folder)]
    path.write_text('\n\n'.join(parts) + '\n', encoding='utf-8')


def _losses(rows, modules):
    """Return where the tracker loses to the paper, to a baseline or to itself with less."""
    judging = {name: module for name, module in modules.items() if hasattr(module, 'losses')}
    if not judging:
        return []
    parts = ['## Where it loses']
    for name, module in judging.items():
        lines = module.losses(rows[name])
        if lines:
            parts += [f'{module.TITLE}:', '\n'.join(f'- {line}.' for line in lines), module.WHY]
    return parts if len(parts) > 1 else [*parts, 'Nowhere in what was evaluated.']


def _captures(options):
    """Return the captures with those to be credited, and what was left out."""
    lines = [(capture.name, capture.side, f'{capture.rate:g}', str(len(capture.joints)),
              str(int(capture.whole[capture.split:].sum())), ', '.join(capture.missing) or 'none',
              capture.source or 'not said', capture.licence or 'not said')
             for capture in options.captures]
    parts = ['## Recordings', 'They are not part of the project.', Table(
        'Recordings, and of their last four fifths the frames with all eight markers',
        ('recording', 'side', 'Hz', 'frames', 'judged', 'joints it lacks', 'source', 'licence'),
        lines).text()]
    # Where on somebody's disk it was does not matter to a reader.
    left_out = [re.sub(r'\S*/', '', what.partition(': ')[0]) + ': ' + what.partition(': ')[2]
                for what in dict.fromkeys(options.left_out)]
    return parts + (['Left out:', '\n'.join(f'- {what}.' for what in left_out)]
                    if left_out else [])
