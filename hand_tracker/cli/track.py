"""`hand_tracker track`: track recordings without ROS; write a table or a recording of angles."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from ..files.bags import STORAGE, BagError
from ..parallel import Interruptions, run_tasks
from ..progress import Progress
from ..tracking.compile_kernels import prepare_kernels
from ..tracking.recording import OUTPUT_KINDS, TABLE, save
from .recording_options import add_recording_options, run_command, tracked_recording


def _refuse_to_replace(recording: Path, output: Path) -> None:
    sources = recording.iterdir() if recording.is_dir() else (recording,)
    there = output.exists() and recording.exists()
    if output.is_dir() or there and any(map(output.samefile, sources)):
        raise BagError(f'{output}: would replace the recording or a folder; '
                       'expected another name for the output')


def _track_file(options: argparse.Namespace, interrupted: Interruptions,
                progress: Callable[..., Any] = Progress) -> str:
    """Do what the command line asks for; return what to say at the end."""
    output = options.output
    if output.suffix not in OUTPUT_KINDS:
        raise BagError(f'{output}: unknown extension {output.suffix!r}; '
                       f'expected {", ".join(OUTPUT_KINDS)}')
    prepare_kernels(partial(print, file=sys.stderr))
    start = time.monotonic()
    _refuse_to_replace(options.recording, output)
    # The frames look for an interruption: it never comes while a file is begun or ended.
    with (tracked_recording(options, interrupted, progress) as (hand, job, frames),
          interrupted.only_noted()):
        save(output, frames, f'{hand.side}_', options.wrist)
    elapsed = time.monotonic() - start
    return (f'{output}: {job.tracked} of {job.read} frames tracked, '
            f'{job.read / elapsed:.0f} a second')


def _track_into_folder(options: argparse.Namespace, interrupted: Interruptions) -> str:
    """Track several recordings, a file for each; return what to say at the end."""
    tasks = [argparse.Namespace(**{
        **vars(options), 'recording': recording,
        'output': options.output / f'{_name(recording)}.{options.format or TABLE[1:]}'})
        for recording in options.recordings]
    if options.output.suffix in OUTPUT_KINDS:
        raise BagError(f'{options.output}: several recordings, or --format, fill a folder; '
                       f'expected a name without {options.output.suffix}')
    outputs = [task.output for task in tasks]
    for output in outputs:
        if outputs.count(output) > 1:
            raise BagError(f'{output}: several recordings have this name; '
                           'expected different names, or a command for each')
    options.output.mkdir(parents=True, exist_ok=True)
    count, tracked = len(tasks), 0
    progress = Progress(count, 'recordings')
    results = run_tasks(_track_file, tasks, options.jobs)
    for task, (is_tracked, lines) in zip(tasks, progress.over(results)):
        tracked += is_tracked
        for line in lines:
            named = line.startswith(str(task.recording))
            progress.say(line if named else f'{task.recording.name}: {line}')
    if tracked < count:
        raise BagError(f'{options.output}: only {tracked} of {count} recordings tracked')
    return f'{options.output}: {count} recordings tracked'


def _name(recording: Path) -> str:
    # A folder's name may have dots.
    recording = recording.resolve()
    return recording.stem if recording.suffix in STORAGE else recording.name


def _jobs(text: str) -> int:
    if not text.isdecimal() or not int(text):
        raise argparse.ArgumentTypeError(f"'{text}'; expected a number from 1 on")
    return int(text)


def _parse(args: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog='hand_tracker track', description=main.__doc__)
    add_recording_options(parser, several=True)
    parser.add_argument('-o', '--output', type=Path, required=True, metavar='OUT',
                        help='table (.csv) or recording of /joint_states (.mcap, .db3); '
                        'for several recordings the folder of such')
    parser.add_argument('--format', choices=[kind[1:] for kind in OUTPUT_KINDS],
                        help='of the files in a folder OUT, for one recording too; default: csv')
    parser.add_argument('--jobs', type=_jobs, default=1, metavar='N',
                        help='processes for several recordings; default: 1')
    parser.add_argument('--wrist', action='store_true', help="write the wrist's pose too: as "
                        'columns of the table, or as /tf')
    return parser.parse_args(args)


def main(args: list[str] | None = None) -> int:
    """Track recordings without ROS, and write the angles of every frame."""
    options = _parse(args)
    if len(options.recordings) > 1 or options.format:
        return run_command('hand_tracker track', _track_into_folder, options)
    options.recording, = options.recordings
    return run_command('hand_tracker track', _track_file, options)


if __name__ == '__main__':
    sys.exit(main())
