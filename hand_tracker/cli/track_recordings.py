"""Work of the command `hand_tracker track`: recordings tracked, one or many."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from textwrap import shorten
from typing import Any, NamedTuple

from ..core.errors import HandTrackerError
from ..core.model.hand import BOTH
from ..files.bags import BagError
from ..files.recordings import has_recording_suffix, unpacked_name
from ..files.remote_files import Url, local_copy, matching, upload
from ..files.written_kinds import (
    OUTPUT_KINDS,
    SKELETON_KINDS,
    SKINNED_KIND,
    TABLE,
    TRACKED_KINDS,
)
from ..output_files import require_folder, require_suffix
from ..parallel import Interruptions, TaskResult, run_tasks
from ..progress import Progress
from ..skin.surface import require_surface_library
from ..tracking.compile_kernels import prepare_kernels
from ..tracking.recording import save_hands
from ..tracking.save_motion import collect_hands, save_motion
from .recording_options import recordings_of
from .resumption import is_done, note_options
from .tracking_job import ProgressDisplay, ProgressMaker, tracking_job

ALREADY_THERE = 'already there'
LATE_START = .02    # [s] after which a motion is said to begin late
REASON_WIDTH = 80   # [characters] in the summary; the whole is printed before


class TrackedFile(NamedTuple):
    """Result of tracking one recording.

    Attributes
    ----------
    output : Path or Url
    read, tracked, held : int
        Frames, those with a hand, and of these those that show no palm.
    rate : float
        Frames in a second of work.
    residual : float
        As of `TrackingJob` [m].
    late : float
        As of `TrackingJob`, 0 where the times of the output tell it [s].
    """

    output: Path | Url
    read: int
    tracked: int
    held: int
    rate: float
    residual: float
    late: float = 0.

    @property
    def is_late(self) -> bool:
        """Whether a motion begins notably later than its recording."""
        return self.late >= LATE_START

    def __str__(self) -> str:
        remarks = f'{self.held} of them show no palm, ' if self.held else ''
        if self.tracked < self.read and PurePath(str(self.output)).suffix.lower() in OUTPUT_KINDS:
            remarks += 'the others are not written, '
        if self.is_late:
            remarks += f'it begins {self.late:.2f} s after the recording, '
        return (f'{self.output}: {self.tracked} of {self.read} frames tracked, {remarks}'
                f'markers {1e3 * self.residual:.1f} mm off the hand, {self.rate:.0f} a second')


def refuse_to_replace(recording: Path, output: Path) -> None:
    """Raise `BagError` where an output would replace the recording, or a folder."""
    sources = recording.iterdir() if recording.is_dir() else (recording,)
    there = output.exists() and recording.exists()
    if output.is_dir() or there and any(map(output.samefile, sources)):
        raise BagError(f'{output}: would replace the recording or a folder; '
                       'expected another name for the output')


def track_file(options: argparse.Namespace, interrupted: Interruptions,
                progress: ProgressMaker = Progress) -> TrackedFile:
    """Track the recordings of a command line; return their results, for the closing lines."""
    output = options.output
    require_suffix(output, TRACKED_KINDS)
    kind = output.suffix.lower()
    if kind == SKINNED_KIND:
        require_surface_library()
    refuse_to_replace(options.recording, output)
    require_folder(output)
    prepare_kernels(partial(print, file=sys.stderr))
    start = time.monotonic()
    # The frames look for an interruption: it never comes while a file is begun or ended.
    with tracking_job(options, interrupted, progress) as job, interrupted.only_noted():
        if kind in OUTPUT_KINDS:
            prefixes = [f'{side}_' for side in job.hands()]
            wrists = prefixes if options.side == BOTH else ['']
            save_hands(output, ({f'{side}_': frame for side, frame in frames.items()}
                                for frames in job.frames()), prefixes,
                       wrists if options.wrist else (),
                       job.layout.names if options.quality else (), job.zero)
        else:
            tracked = collect_hands(job.frames(), job.hands)
            save_motion(output, tracked if options.side == BOTH else tracked.hands[0],
                        options.names, options.order,
                        0. if job.zero is None else 1e-9 * (tracked.start - job.zero))
    elapsed = time.monotonic() - start
    return TrackedFile(output, job.read, job.tracked, job.held, job.read / elapsed, job.residual,
                       job.late if kind in SKELETON_KINDS else 0.)


def _track_located(options: argparse.Namespace, interrupted: Interruptions,
                   progress: ProgressMaker = Progress) -> TrackedFile:
    """Track a recording; its input and output may be URLs: download first, upload after."""
    if isinstance(options.recording, Url):
        url = options.recording
        with local_copy(url) as copy:
            try:
                return _track_located(
                    _with(options, recording=copy), interrupted,
                    lambda total, what: _RemoteProgress(progress(total, what), copy, url))
            except HandTrackerError as error:
                raise BagError(str(error).replace(str(copy), url)) from None
    if isinstance(options.output, Url):
        with TemporaryDirectory(prefix='hand_tracker-') as folder:
            local = Path(folder, options.output.name)
            found = track_file(_with(options, output=local), interrupted, progress)
            upload(local, options.output)
        return found._replace(output=options.output)
    return track_file(options, interrupted, progress)


class _RemoteProgress:
    """Progress display whose lines have the URL of a file in place of the path of its copy."""

    def __init__(self, display: ProgressDisplay, copy: Path, url: Url) -> None:
        self._copy, self._url = str(copy), url
        self._say, self.over = display.say, display.over

    def say(self, text: str) -> None:
        """Write a line above the bar."""
        self._say(text.replace(self._copy, self._url))


def _with(options: argparse.Namespace, **changed: Any) -> argparse.Namespace:
    return argparse.Namespace(**{**vars(options), **changed})


def _expanded(recordings: list[Path | Url]) -> list[Path | Url]:
    """Return recordings, those in a folder that is no rosbag2 recording in its place."""
    return [found for one in recordings
            for found in (matching(one) if isinstance(one, Url) else recordings_of(one))]


def _track_into_folder(options: argparse.Namespace, interrupted: Interruptions) -> str:
    """Track several recordings, a file for each; return what to say at the end."""
    folder = options.output
    if Path(folder).suffix.lower() in TRACKED_KINDS:
        raise BagError(f'{folder}: several recordings, or --format, fill a folder; '
                       f'expected a name without {Path(folder).suffix}')
    stems = _different_names(options.recordings)
    names = [f'{stem}.{options.format or TABLE[1:]}' for stem in stems]
    outputs = [Url(f'{folder.rstrip("/")}/{name}') if isinstance(folder, Url)
               else (folder / name).absolute() for name in names]
    for name, output in zip(names, outputs):
        if outputs.count(output) > 1:
            same = [str(recording) for recording, other in zip(options.recordings, outputs)
                    if other == output]
            raise BagError(f'{folder}/{name}: would be written for {" and ".join(same)}; '
                           'expected different names, or a command for each')
    if isinstance(folder, Path):
        folder.mkdir(parents=True, exist_ok=True)
        note_options(folder, options)
    is_there = [options.resume and is_done(recording, output, options)
                for recording, output in zip(options.recordings, outputs)]
    # Workers of a cluster may be in other folders.
    tasks = [_with(options, recording=recording if isinstance(recording, Url)
                   else recording.absolute(), output=output)
             for recording, output, skip in zip(options.recordings, outputs, is_there) if not skip]
    rows: dict[Path | Url, tuple[str, ...]] = {
        output: (ALREADY_THERE,) for output, skip in zip(outputs, is_there) if skip}
    progress = Progress(len(tasks), 'recordings')
    results = run_tasks(_track_located, tasks, options.jobs, interrupted, options.cluster)
    tracked = len(rows)
    for result, task in zip(progress.over(results), tasks):
        tracked += result.value is not None
        rows[task.output] = _row(result, task)
        for line in result.lines:
            line = line.replace(f'{Path(task.output).parent}/', f'{folder}/') \
                if isinstance(folder, Path) else line
            named = line.startswith((str(task.recording), f'{task.recording.name}: '))
            progress.say(line if named else f'{task.recording.name}: {line}')
    print(_table([(stem, *rows[output]) for stem, output in zip(stems, outputs)]))
    count = len(options.recordings)
    if tracked < count:
        raise BagError(f'{folder}: only {tracked} of {count} recordings tracked')
    return f'{folder}: {count} recording{"s" * (count > 1)} tracked'


def _row(result: TaskResult, task: argparse.Namespace) -> tuple[str, ...]:
    """Return the cells of a recording's row behind its name: result, and its numbers."""
    found = result.value
    if found is None:
        reason = result.lines[-1].removeprefix(f'{task.recording}: ').removeprefix(
            f'{task.recording.name}: ')
        return (f'failed: {shorten(reason, REASON_WIDTH, placeholder=" ...")}',)
    late = f', begins {found.late:.2f} s late' if found.is_late else ''
    return (task.output.name + late, str(found.read),
            f'{100. * found.tracked / max(found.read, 1):.1f}', f'{1e3 * found.residual:.1f}',
            f'{found.rate:.0f}')


def _table(rows: list[tuple[str, ...]]) -> str:
    """Return the summary of several recordings."""
    heads = 'frames', 'tracked %', 'residual mm', 'frames/s'
    cells = [('recording', *heads, 'result')]
    cells += [(name, *(numbers or ('',) * len(heads)), result) for name, result, *numbers in rows]
    first, *widths = (max(map(len, column)) for column in list(zip(*cells))[:-1])
    return '\n'.join('  '.join([name.ljust(first), *map(str.rjust, numbers, widths), result])
                     for name, *numbers, result in cells)


def _different_names(recordings: Sequence[Path | Url]) -> list[str]:
    """Return names for recordings: without a suffix, but where two differ by it alone."""
    named = [Path(one.name) if isinstance(one, Url) else one.resolve() for one in recordings]
    # A folder's name may have dots.
    stems = [unpacked_name(one).stem if has_recording_suffix(one) else one.name for one in named]
    return [one.name if stems.count(stem) > 1 else stem for one, stem in zip(named, stems)]


def track_recordings(options: argparse.Namespace, interrupted: Interruptions) -> str:
    """Track one recording into a file, or several into a folder; return the closing line."""
    kind = (f'.{options.format}' if options.format
            else PurePath(str(options.output)).suffix.lower())
    if options.quality and kind in TRACKED_KINDS and kind != TABLE:
        raise BagError(f'{options.output}: --quality adds columns to a table; expected a name with '
                       f'{TABLE}')
    given, options.recordings = options.recordings, _expanded(options.recordings)
    if given != options.recordings or len(given) > 1 or options.format:
        return _track_into_folder(options, interrupted)
    if options.cluster or options.resume:
        raise BagError('--cluster and --resume fill a folder; expected several recordings, a '
                       'folder, or --format')
    options.recording, = options.recordings
    return str(_track_located(options, interrupted))
