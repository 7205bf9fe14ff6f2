"""What `track --resume` leaves out: outputs that are there, and were made with the same options."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from ..files.remote_files import Url, exists
from ..output_files import write_whole_text

OPTIONS_FILE = 'track_options.json'
# Options that change no output, or its name alone.
OTHER_OPTIONS = {'recordings', 'output', 'format', 'jobs', 'cluster', 'resume'}
FILE_OPTIONS = 'hand', 'left_hand', 'layout'


def note_options(folder: Path, options: argparse.Namespace) -> None:
    """Write the options of a command line into its folder, where others are there or none.

    Outputs that are older than this file were made with other options. Without `--resume` nothing
    is written into a folder that has none, and never into one of outputs without their options.

    Parameters
    ----------
    folder : Path
    options : argparse.Namespace
        Of `hand_tracker track`.
    """
    path = folder / OPTIONS_FILE
    if not (options.resume or path.exists()):
        return
    chosen = json.loads(json.dumps({name: value for name, value in vars(options).items()
                                    if name not in OTHER_OPTIONS}, default=str))
    before = _read(path)
    if before == chosen:
        return
    is_new = not path.exists()
    if is_new and any(folder.iterdir()):
        print(f'{folder}: with which options the files in it were made is not known: they are '
              'left as they are', file=sys.stderr)
        return
    write_whole_text(path, json.dumps(chosen, indent=1) + '\n')
    changes = [f'--{name.replace("_", "-")}: {_told(before.get(name))}, now '
               f'{_told(chosen.get(name))}'
               for name in sorted({*before, *chosen}) if before.get(name) != chosen.get(name)]
    if options.resume and not is_new:
        print(f'{folder}: made with other options ({"; ".join(changes)}): tracked again',
              file=sys.stderr)


def is_done(recording: Path | Url, output: Path | Url, options: argparse.Namespace) -> bool:
    """Return whether an output is there, no older than all that it is made of.

    Parameters
    ----------
    recording, output : Path or Url
        Of a store it counts alone whether the output is there.
    options : argparse.Namespace
        Whose hand files and layout it is made with.
    """
    if isinstance(output, Url):
        return exists(output)
    if not output.exists():
        return False
    files = [recording, output.with_name(OPTIONS_FILE), *(
        Path(path) for path in (getattr(options, name) for name in FILE_OPTIONS) if path)]
    return all(output.stat().st_mtime >= path.stat().st_mtime for path in files
               if isinstance(path, Path) and path.exists())


def _told(value: object) -> str:
    """Return what was given for an option, in words."""
    if value is True:
        return 'given'
    if isinstance(value, list):
        value = ', '.join(map(str, value))
    return 'not given' if value in (None, False, '') else str(value)


def _read(path: Path) -> dict[str, object]:
    """Return the options in a file, none where it is not there or was changed to something else."""
    try:
        found = json.loads(path.read_text(encoding='utf-8'))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}
