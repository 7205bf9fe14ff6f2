"""Write the results of all benchmarks into one document.

    python -m benchmarks.write_document FOLDER [-o docs/benchmarks.md]

FOLDER has the output of `python -m benchmarks.NAME --json FOLDER/NAME.json` on this machine. Of a
benchmark that it lacks the document keeps the section that it has, and says so.
"""

import argparse
import json
import sys
from importlib import import_module
from pathlib import Path

if not __package__:
    sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from benchmarks.common import environment
from hand_tracker.evaluation.tables import Table

EARLIER = 'Measured with an earlier revision.'
REPORTED_BENCHMARKS = ('core', 'layouts', 'labelling', 'instructions', 'round_trip', 'peers',
                       'retarget', 'command_round_trip', 'offline', 'startup', 'memory')


def section(name, rows):
    """Return heading, documentation and table of a benchmark as paragraphs."""
    what, _, rest = import_module(f'benchmarks.{name}').__doc__.partition('\n')
    command, _, rest = rest.strip().partition('\n')
    columns = list(dict.fromkeys(key for row in rows for key in row))
    lines = [[_text(row.get(column)) for column in columns] for row in rows]
    return [f'## {name}', what, f'`{command}`', rest.strip(),
            Table(f'{len(rows)} rows', tuple(columns), lines).text()]


def kept_section(name, document):
    """Return the section of a benchmark that a document has, as paragraphs, none if it has none."""
    _, found, rest = document.partition(f'\n## {name}\n')
    text = rest.partition('\n## ')[0].strip()
    if not found:
        return []
    return [f'## {name}', text if text.startswith(EARLIER) else f'{EARLIER}\n\n{text}']


def _text(value):
    return '' if value is None else f'{value:g}' if isinstance(value, float) else str(value)


def main():
    """Write the document."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('folder', type=Path, help='of NAME.json')
    parser.add_argument('-o', '--output', type=Path, default=Path('docs/benchmarks.md'))
    options = parser.parse_args()
    parts = ['# Benchmarks', 'Made by `python -m benchmarks.write_document`, not by hand.',
             environment()]
    before = options.output.read_text(encoding='utf-8') if options.output.exists() else ''
    for name in REPORTED_BENCHMARKS:
        path = options.folder / f'{name}.json'
        if path.exists():
            parts += section(name, json.loads(path.read_text(encoding='utf-8')))
        else:
            print(f'{path}: not there, its section is that of before', file=sys.stderr)
            parts += kept_section(name, before)
    options.output.write_text('\n\n'.join(part for part in parts if part) + '\n',
                              encoding='utf-8')
    return 0


if __name__ == '__main__':
    sys.exit(main())
