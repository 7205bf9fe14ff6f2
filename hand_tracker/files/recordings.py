"""Motion capture files of any format: recognised, read as points, written."""

from __future__ import annotations

import shlex
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Callable
from functools import partial
from os import PathLike
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..output_files import require_folder, write_whole
from .angle_table import TIME_COLUMN
from .bag_points import BAG_FORMAT, read_bag_points, write_bag_points
from .bags import BAG_CONTENTS, STORAGE
from .bvh_file import BVH_START, read_bvh
from .c3d_file import C3D_KEY, read_c3d, write_c3d
from .npz_file import NPZ_START, read_npz, write_npz
from .optitrack_csv import MOTIVE_START, read_optitrack_csv, write_optitrack_csv
from .point_recording import (
    HANDEDNESS,
    UNIT_SPELLINGS,
    UP_AXES,
    WRITTEN_RATE,
    Axes,
    PointRecording,
    RecordingError,
    Said,
    conversion_note,
)
from .qualisys_tsv import QTM_START, read_qualisys_tsv, write_qualisys_tsv
from .text_table import open_packed
from .trc_file import TRC_START, read_trc, write_trc
from .vicon_csv import OTHER_VICON_BLOCKS, VICON_BLOCK, read_vicon_csv, write_vicon_csv

HEAD_BYTES = 2**12         # by which formats are recognised
BAG_STARTS = (b'\x89MCAP0', b'SQLite format 3\0')
ROS_1_START = b'#ROSBAG V'
PACKED_SUFFIX = '.gz'


class ReadingOptions(NamedTuple):
    """Overrides of the recognised labels, axes and units of a motion capture file.

    Attributes
    ----------
    units : str or None
        Key of `UNIT_SPELLINGS`; the file's when left out.
    up : str or None
        One of `UP_AXES`; the file's when left out.
    handed : str or None
        'right' or 'left' axes; as recognised when left out.
    zero_is_missing : bool
        Whether a point at exactly (0, 0, 0) is one that the system lost.
    partial : bool
        Whether a file that is cut is read as far as it goes, with a note.
    topic : str or None
        Of the points in a rosbag2 recording; by `point_topic` when left out.
    frame_rate : float or None
        The file's when left out [Hz].
    subject : str or None
        Whose points alone are read, of those labelled 'SUBJECT:NAME'; all when left out.
    names : tuple of str
        Markers that are wanted: of an npz file with markers and joints those are read that have
        most of them.
    is_scaled : bool
        Whether the points are multiplied afterwards, so that their unit is not doubted.
    """

    units: str | None = None
    up: str | None = None
    handed: str | None = None
    zero_is_missing: bool = True
    partial: bool = False
    topic: str | None = None
    frame_rate: float | None = None
    subject: str | None = None
    names: tuple[str, ...] = ()
    is_scaled: bool = False


class FileFormat(NamedTuple):
    """A format of motion capture files.

    Attributes
    ----------
    name : str
    suffixes : tuple of str
        The first is the usual one.
    is_like : callable
        Recognises a file of it by its first bytes.
    read : callable
        Returns a `PointRecording` with the file's points, and their `Axes`.
    write : callable or None
        Writes a `PointRecording` to a path; None where points alone are not enough.
    usual_up, usual_units : str
        Upward axis and unit where neither file nor user say.
    """

    name: str
    suffixes: tuple[str, ...]
    is_like: Callable[[bytes], bool]
    read: Callable[..., tuple[PointRecording, Axes]]
    write: Callable[[Path, PointRecording], None] | None
    usual_up: str = 'z'
    usual_units: str = 'm'


def _starts(*texts: str) -> Callable[[bytes], bool]:
    octets = tuple(text.lower().encode() for text in texts)
    return lambda head: head.removeprefix(b'\xef\xbb\xbf').lstrip(b' \t\r\n"').lower().startswith(
        octets)


def _is_vicon(head: bytes) -> bool:
    first = head.removeprefix(b'\xef\xbb\xbf').partition(b'\n')[0].strip(b' ,;"\t\r')
    return first.decode('latin-1') in (VICON_BLOCK, *OTHER_VICON_BLOCKS)


C3D, TRC, TSV, MOTIVE_CSV, VICON_CSV, BVH, NPZ = FORMATS = (
    FileFormat('C3D', ('.c3d',),
               lambda head: len(head) > 1 and head[1] == C3D_KEY and head[0] in range(1, 9),
               read_c3d, write_c3d, usual_units='mm'),
    FileFormat('TRC', ('.trc',), _starts(TRC_START), read_trc, write_trc, 'y', 'mm'),
    FileFormat('Qualisys TSV', ('.tsv',), _starts(QTM_START), read_qualisys_tsv,
               write_qualisys_tsv),
    FileFormat('OptiTrack CSV', ('.csv',), _starts(MOTIVE_START), read_optitrack_csv,
               write_optitrack_csv, 'y'),
    FileFormat('Vicon CSV', ('.csv',), _is_vicon, read_vicon_csv, write_vicon_csv,
               usual_units='mm'),
    FileFormat('BVH', ('.bvh',), _starts(BVH_START), read_bvh, None, 'y'),
    FileFormat('npz', ('.npz',), lambda head: head.startswith(NPZ_START), read_npz, write_npz),
)
FILE_SUFFIXES = tuple(dict.fromkeys(suffix for one in FORMATS for suffix in one.suffixes))
WRITTEN_SUFFIXES = (*sorted({suffix for one in FORMATS if one.write for suffix in one.suffixes}),
                    *STORAGE)
KNOWN_FORMATS = ('C3D, TRC, Qualisys TSV, OptiTrack CSV, Vicon CSV, BVH, npz, or a rosbag2 '
                 'recording (folder, .mcap, .db3)')


def is_bag(path: str | PathLike[str]) -> bool:
    """Return whether a path is, by content or name, a rosbag2 recording."""
    path = Path(path)
    if path.is_dir() or not path.exists():
        return path.is_dir() or path.suffix.lower() in STORAGE or not path.suffix
    try:
        with open(path, 'rb') as file:
            head = file.read(max(map(len, BAG_STARTS)))
    except OSError:
        return path.suffix.lower() in STORAGE
    return head.startswith(BAG_STARTS) or path.suffix.lower() in STORAGE


def unpacked_name(path: Path) -> Path:
    """Return the name of a file, without the extension of a gzipped one."""
    return Path(path.stem if path.suffix.lower() == PACKED_SUFFIX else path.name)


def has_recording_suffix(path: Path) -> bool:
    """Return whether a path has a recording's extension, gzipped or not, whatever its case."""
    return unpacked_name(path).suffix.lower() in (*STORAGE, *FILE_SUFFIXES)


def is_named_as_recording(path: Path) -> bool:
    """Return whether a path has a recording's extension, or is the folder of a rosbag2 one."""
    return has_recording_suffix(path) or (path / BAG_CONTENTS).exists()


def recordings_at(path: Path) -> tuple[list[Path], list[str]]:
    """Return the recording at a path, or those of a folder that is none itself.

    Parameters
    ----------
    path : Path

    Returns
    -------
    recordings : list of Path
        By name.
    left_out : list of str
        Folders in the folder that have recordings, too.

    Raises
    ------
    RecordingError
        If the folder has none.
    """
    if not path.is_dir() or (path / BAG_CONTENTS).exists():
        return [path], []
    contents = sorted(path.iterdir())
    inside = [one for one in contents if is_named_as_recording(one)]
    if not inside:
        raise RecordingError(f'{path}: no recording in this folder, nor {BAG_CONTENTS} of one; '
                             f'expected {KNOWN_FORMATS}')
    return inside, [one.name for one in contents if one.is_dir() and one not in inside
                    and any(map(is_named_as_recording, one.iterdir()))]


def recognised_format(path: str | PathLike[str]) -> FileFormat:
    """Return the format of a file, by its first bytes, else by its name.

    Raises
    ------
    RecordingError
        If it is none of `FORMATS`, or cannot be read.
    """
    path = Path(path)
    if not path.exists():
        raise RecordingError(f'{path}: no such file; expected a motion capture file')
    with open_packed(path) as file:
        head = file.read(HEAD_BYTES)
    if not head:
        raise RecordingError(f'{path}: the file has no bytes; expected {KNOWN_FORMATS}')
    if head.startswith((BOM_UTF16_LE, BOM_UTF16_BE)):
        raise RecordingError(f'{path}: a text of UTF-16; expected one of UTF-8')
    if _starts(f'{TIME_COLUMN},')(head):
        raise RecordingError(f'{path}: angles of joints, as `track` writes them; expected the '
                             'recording that they were found in')
    found = next((one for one in FORMATS if one.is_like(head)), None) or _by_name(path)
    if found is MOTIVE_CSV and not found.is_like(head):
        raise RecordingError(f'{path}: a CSV file that begins neither with {MOTIVE_START!r}, as of '
                             f'OptiTrack, nor with {VICON_BLOCK!r}, as of Vicon; expected one of '
                             'these')
    if found is None:
        cure = '' if not head.startswith(ROS_1_START) else (
            f': of this one of ROS 1 rosbags-convert --src {shlex.quote(str(path))} --dst '
            f'{shlex.quote(path.stem)} --src-typestore ros1_noetic --dst-typestore ros2_jazzy '
            'makes one')
        raise RecordingError(f'{path}: its beginning is that of no known format; expected '
                             f'{KNOWN_FORMATS}{cure}')
    return found


def _by_name(path: Path) -> FileFormat | None:
    suffix = unpacked_name(path).suffix.lower()
    return next((one for one in FORMATS if suffix in one.suffixes), None)


def read_recording(path: str | PathLike[str],
                   options: ReadingOptions | None = None) -> PointRecording:
    """Read a motion capture file of any format.

    Parameters
    ----------
    path : path-like
        Also gzipped, where the format is a text.
    options : ReadingOptions, optional

    Returns
    -------
    PointRecording
        In metres, z up, right-handed; its notes say what was converted and assumed.

    Raises
    ------
    HandTrackerError
        Naming the file, the place and what is expected.
    """
    path = Path(path)
    options = options or ReadingOptions()
    for name, value, allowed in (('units', options.units, UNIT_SPELLINGS),
                                 ('up', options.up, UP_AXES),
                                 ('handed', options.handed, HANDEDNESS)):
        if value is not None and value not in allowed:
            raise RecordingError(f'{name}: {value!r}; expected one of {", ".join(allowed)}')
    usual = Axes('m', 'z')
    # Damaged bytes are refused by every reader; none may end in another error.
    try:
        if is_bag(path):
            recording, axes = read_bag_points(
                path, options.zero_is_missing, options.topic, options.partial)
        else:
            form = recognised_format(path)
            usual = Axes(form.usual_units, form.usual_up)
            # No other format has both markers and joints.
            read = partial(read_npz, names=options.names) if form is NPZ else form.read
            with open_packed(path) as file:
                recording, axes = read(path, file, options.zero_is_missing, options.partial)
    except MemoryError:
        raise RecordingError(f'{path}: not enough memory; expected a recording that fits') from None
    if options.subject:
        recording = _of_subject(path, recording, options.subject)
    if options.frame_rate:
        recording = recording._replace(rate=options.frame_rate, stamps=None)
    elif recording.stamps is None and not np.isfinite(recording.rate):
        recording = recording._replace(notes=(*recording.notes, (
            f'the file does not say its rate: {WRITTEN_RATE:g} Hz is assumed (--frame-rate)')))
    return _in_metres(recording, axes, usual, options)


def _of_subject(path: Path, recording: PointRecording, subject: str) -> PointRecording:
    """Return the points of a subject."""
    columns = [column for column, label in enumerate(recording.labels)
               if label.rpartition(':')[0] == subject]
    if not columns:
        subjects = {label.rpartition(':')[0] for label in recording.labels}
        raise RecordingError(f"{path}: no points of '{subject}'; expected one of its subjects: "
                             + (', '.join(sorted(filter(None, subjects))) or 'it has none'))
    return recording._replace(labels=tuple(recording.labels[column] for column in columns),
                              points=recording.points[:, columns])


def _in_metres(recording: PointRecording, axes: Axes, usual: Axes,
               options: ReadingOptions) -> PointRecording:
    """Convert a recording's points, and say so."""
    units, up = (options.units or axes.units or usual.units,
                 options.up or axes.up or usual.up)
    final = Axes(units, up, options.handed or axes.handed)
    said = Said(bool(options.units or axes.units), bool(options.handed),
                bool(options.up or axes.up))
    notes = (*recording.notes, *filter(None, (conversion_note(final, said),)))
    return recording.converted(final)._replace(notes=notes, said=said)


def write_recording(path: str | PathLike[str], recording: PointRecording,
                    form: FileFormat | None = None) -> str:
    """Write points as a motion capture file; it appears when it is whole.

    Frames that were left out, as the times of the others say, are written with missing points.

    Parameters
    ----------
    path : path-like
        Replaced if it exists.
    recording : PointRecording
    form : FileFormat, optional
        That of the path's suffix when left out: for .csv that of OptiTrack.

    Returns
    -------
    str
        Name of the format.

    Raises
    ------
    HandTrackerError
        If the format is not known, or cannot hold the recording.
    """
    path = Path(path)
    require_folder(path, RecordingError)
    if form is None and path.suffix.lower() in STORAGE:
        write_bag_points(path, recording)
        return BAG_FORMAT
    form = form or _by_name(path)
    if form is None or form.write is None:
        raise RecordingError(f'{path}: points are not written as {path.suffix!r}; expected '
                             f'{", ".join(WRITTEN_SUFFIXES)}')
    write, even = form.write, recording.evenly_spaced()
    if form not in (C3D, NPZ) and even.stamps is None and not np.isfinite(even.rate):
        # Others cannot hold a rate that is not known.
        even = even._replace(rate=WRITTEN_RATE)
    write_whole(path, lambda unfinished: write(unfinished, even))
    return form.name

