"""The results document: tables and pictures of evaluations, versions and hardware."""

import os
import platform
import re
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import ModuleType

from .. import __version__
from ..core.numerics.jit import COMPILED
from ..output_files import write_whole_text
from . import EVALUATIONS, simulated
from .evaluation_options import Options
from .rows import Row
from .tables import Table

LIBRARIES = ('numpy', 'scipy', 'matplotlib', 'numba')


def versions() -> dict[str, str]:
    """Return the versions of this package, Python and the libraries, by name."""
    found = {'hand_tracker': __version__, 'Python': platform.python_version()}
    for library in LIBRARIES:
        try:
            found[library] = version(library)
        except PackageNotFoundError:
            found[library] = 'not installed'
    return found


def processor() -> str:
    """Return the model name of the processor."""
    try:
        lines = Path('/proc/cpuinfo').read_text(encoding='utf-8').splitlines()
        return next(line.partition(':')[2].strip() for line in lines
                    if line.startswith('model name'))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()  # not Linux, or one without a name


def hardware() -> str:
    """Return processor, number of cores and operating system as text."""
    return f'{processor()}, {os.cpu_count()} cores, {platform.system()} {platform.machine()}'


def command_line(name: str, files: Sequence[Path], options: Options, path: Path,
                 fit: Sequence[Path] = ()) -> str:
    """Return the command that reproduces the results, with files in the folder `$CAPTURES`."""
    captures, fitted = (' '.join(f'$CAPTURES/{Path(file).name}' for file in some)
                        for some in (files, fit))
    # Relative to the project.
    document = path if not path.is_absolute() else Path(path.parent.name, path.name)
    return (f'hand_tracker evaluate {name} {captures}'.rstrip()
            + (f' --fit {fitted}' if fit else '')
            + f' --seed {options.seed} --jobs {options.jobs} --results {document}')


def write_results(path: Path, rows: list[Row], names: Sequence[str], options: Options,
                  command: str) -> None:
    """Write the document, and its pictures into a folder beside it of the same name.

    Parameters
    ----------
    path : Path
        Of a Markdown file.
    rows : list of dict
        Of all evaluations, as `run` returns them or as read from a JSON file.
    names : sequence of str
        The evaluations to write about, of `EVALUATIONS`.
    options : Options
        Of the evaluations.
    command : str
        The command that made the rows.
    """
    folder = path.parent / path.stem
    folder.mkdir(parents=True, exist_ok=True)
    rows_of = {name: [row for row in rows if row['evaluation'] == name] for name in names}
    made = ', '.join(f'{name} {number}' for name, number in versions().items())
    parts = ['# Results', 'Made by a command, not by hand; the same seed gives the same '
             'numbers, but for times measured by the clock. Speed, start-up and memory have '
             'commands of their own, and tables in [benchmarks.md](benchmarks.md).',
             f'```\n{command}\n```',
             *(['`CAPTURES` is the folder of the recordings.'] if '$' in command else []),
             f'- Versions: {made}; kernels {"compiled" if COMPILED else "not compiled"}.\n'
             f'- Hardware: {hardware()}.']
    parts += _losses(rows_of)
    if not all(EVALUATIONS[name].judges for name in names):
        parts += ['## How hands are simulated',
                  _documentation(simulated).partition('\n')[2].strip()]
    if options.captures or options.left_out:
        parts += _captures(options)
    if options.takes:
        parts += [Table('Takes of real markers', ('take', 'side', 'Hz', 'frames', 'markers',
                                                  'source', 'licence'), [
            (take.name, take.side, f'{take.rate:g}', str(len(take.points)), str(len(take.names)),
             *(credit or 'not said' for credit in take.credit))
            for take in (*options.takes, *options.fit_takes)]).text()]
    for name, found in rows_of.items():
        module = EVALUATIONS[name].load()
        parts += [f'## {EVALUATIONS[name].title}', _documentation(module),
                  f'`hand_tracker evaluate {name}`, {len(found)} rows.']
        parts += [table.text() for table in module.tables(found)]
        parts += [f'![{picture.caption}]({path.stem}/{picture.file})'
                  for picture in module.pictures(found, folder)]
    write_whole_text(path, '\n\n'.join(parts) + '\n')


def _documentation(module: ModuleType) -> str:
    return (module.__doc__ or '').strip()


def _losses(rows_of: dict[str, list[Row]]) -> list[str]:
    """Return the section on where the tracker is worse than the paper, a baseline or a variant."""
    judging = {name: EVALUATIONS[name].load() for name in rows_of}
    judging = {name: module for name, module in judging.items() if hasattr(module, 'losses')}
    if not judging:
        return []
    parts = ['## Where it loses']
    for name, module in judging.items():
        losses = module.losses(rows_of[name])
        if losses.lines:
            parts += [f'{EVALUATIONS[name].title}:',
                      '\n'.join(f'- {line}.' for line in losses.lines), losses.reason]
    return parts if len(parts) > 1 else [*parts, 'Nowhere in what was evaluated.']


def _captures(options: Options) -> list[str]:
    """Return the section on the captures, with their sources and those left out."""
    lines = [(capture.name, capture.side, f'{capture.rate:g}', str(len(capture.joints)),
              str(int(capture.whole[capture.split:].sum())), ', '.join(capture.missing) or 'none',
              capture.source or 'not said', capture.licence or 'not said')
             for capture in options.captures]
    parts = ['## Recordings', 'They are not part of the project.', Table(
        'Recordings, and of their last four fifths the frames with all eight markers',
        ('recording', 'side', 'Hz', 'frames', 'judged', 'joints it lacks', 'source', 'licence'),
        lines).text()]
    # Without the folder, which is of this machine only.
    left_out = [re.sub(r'\S*/', '', what.partition(': ')[0]) + ': ' + what.partition(': ')[2]
                for what in dict.fromkeys(options.left_out)]
    return parts + (['Left out:', '\n'.join(f'- {what}.' for what in left_out)]
                    if left_out else [])
