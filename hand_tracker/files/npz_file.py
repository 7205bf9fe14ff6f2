"""Read and write npz files of points, as numpy.savez writes them."""

from __future__ import annotations

import sys
import zipfile
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np

from ..core.errors import HandTrackerError
from ..core.model.hand import SIDES
from ..core.model.layout_presets import LAYOUT_PRESETS
from .point_recording import (
    MAX_POINT_BYTES,
    Axes,
    PointBuffer,
    PointRecording,
    RecordingError,
    unique_labels,
)

NPZ_START = b'PK'
# Fields that hold points and their names, markers first.
NPZ_FIELDS = (('markers', 'marker_names'), ('positions', 'joints'))
TIMES_FIELD = 'times_s'     # of the frames, where a recording has its own


@contextmanager
def open_arrays(path: Path, refusal: type[HandTrackerError]) -> Iterator[Any]:
    """Open an npz file, and refuse one that cannot be read.

    Parameters
    ----------
    path : Path
    refusal : type of HandTrackerError
        Raised where the file, or an array that is read of it, is not what numpy.savez writes.

    Yields
    ------
    NpzFile
    """
    try:
        _check_arrays(path)
        # Opened here: numpy leaves its own file open where it cannot read it.
        with open(path, 'rb') as file, np.load(file, allow_pickle=False) as data:
            yield data
    except HandTrackerError:
        raise
    # Damaged bytes raise whatever the parsers of zipfile and numpy do.
    except Exception as error:
        reason = getattr(error, 'strerror', None)
        # A zip file ends with its index: without it, it was cut.
        is_cut = isinstance(error, zipfile.BadZipFile) and not zipfile.is_zipfile(path)
        raise refusal(f'{path}: {"cut: " * is_cut}no npz file that can be read'
                      + (f' ({reason})' if reason else '')
                      + '; expected plain arrays, as numpy.savez writes them') from None


def _check_arrays(path: Path) -> None:
    """Raise ValueError for arrays that are larger than they may be, or text that is none."""
    if not zipfile.is_zipfile(path):
        return
    with zipfile.ZipFile(path) as archive:
        total = sum(entry.file_size for entry in archive.infolist())
        if total > MAX_POINT_BYTES:
            raise ValueError(f'{total} bytes')
        for entry in archive.infolist():
            with archive.open(entry) as file:
                version = np.lib.format.read_magic(file)
                read = (np.lib.format.read_array_header_1_0 if version == (1, 0)
                        else np.lib.format.read_array_header_2_0)
                shape, _, kind = read(file)
                size = kind.itemsize
                for length in shape:
                    size *= max(length, 0)
                if size > entry.file_size:
                    raise ValueError(f'{entry.filename}: shape {shape}')
                # Any use of a character that does not exist is an error of Python itself.
                if kind.kind == 'U' and (np.frombuffer(file.read(size), np.dtype(
                        'u4').newbyteorder(kind.byteorder)) > sys.maxunicode).any():
                    raise ValueError(f'{entry.filename}: no text')


def named_fields(fields: Mapping[str, np.ndarray]) -> dict[tuple[str, str], list[str]]:
    """Return the names of the points of each pair of `NPZ_FIELDS` that an npz file has."""
    return {pair: [str(name) for name in np.atleast_1d(fields[pair[1]])]
            for pair in NPZ_FIELDS if set(pair) <= set(fields)}


def checked_points(path: Path, fields: Mapping[str, np.ndarray], pair: tuple[str, str],
                   count: int, refusal: type[HandTrackerError],
                   may_be_empty: bool = False) -> np.ndarray:
    """Return the points of an npz file, and refuse those that are none.

    Parameters
    ----------
    path : Path
    fields : mapping of str to ndarray
        Arrays of the file.
    pair : tuple of str
        One of `NPZ_FIELDS` that the file has.
    count : int
        Number of their names.
    refusal : type of HandTrackerError
        Raised where they are no numbers, or not as many as their names.
    may_be_empty : bool, optional
        Whether there may be no frame.

    Returns
    -------
    ndarray, shape (T, count, 3)
        As in the file.
    """
    points = fields[pair[0]]
    if (points.ndim != 3 or points.shape[1:] != (count, 3) or points.dtype.kind not in 'fiu'
            or not (points.size or may_be_empty)):
        raise refusal(f'{path}: {pair[0]} of shape {points.shape}, {points.dtype}; '
                      f'expected numbers (T, {count}, 3), as {pair[1]} names {count}')
    return points


def without_points(path: Path, fields: Mapping[str, np.ndarray],
                   refusal: type[HandTrackerError]) -> HandTrackerError:
    """Return the error for an npz file that has none of `NPZ_FIELDS`."""
    return refusal(f'{path}: it has {", ".join(fields) or "nothing"}; expected markers '
                   'and marker_names, or positions and joints')


def read_npz(path: Path, file: IO[bytes], zero_is_missing: bool = True,
             partial: bool = False, names: Collection[str] = ()) -> tuple[PointRecording, Axes]:
    """Read points from an npz file: `markers` and `marker_names`, else `positions` and `joints`.

    Parameters
    ----------
    path : Path
    file : binary file
        Not used: the archive is read by its path.
    zero_is_missing : bool
        See `ReadingOptions`.
    partial : bool
        Not used: an archive that is cut cannot be read.
    names : collection of str
        See `ReadingOptions`.

    Returns
    -------
    PointRecording
        Its points as in the file.
    Axes
        Metres, z up.

    Raises
    ------
    RecordingError
    """
    del file, partial
    with open_arrays(path, RecordingError) as data:
        fields = {name: data[name] for name in data.files}
    named = named_fields(fields)
    found = {pair: len(set(names) & set(own)) for pair, own in named.items()}
    pair = max(found, key=lambda each: found[each], default=None)
    if pair is not None and 2 * found[pair] <= len(names):
        # Markers with numbers for names say less than the joints beside them.
        pair = next((each for each, own in named.items() if any(
            name.strip().upper().isupper() for name in own)), pair)
    if pair is None:
        raise without_points(path, fields, RecordingError)
    beside = [f'the {other[0]} beside the {pair[0]} are not read'
              + ('' if names else _layout_hint(own))
              for other, own in named.items() if other != pair]
    points = checked_points(path, fields, pair, len(named[pair]), RecordingError)
    try:
        rate = float(fields['rate_hz']) if 'rate_hz' in fields else np.nan
    except (TypeError, ValueError):
        raise RecordingError(f'{path}: rate_hz {fields["rate_hz"]}; expected a number') from None
    stamps = fields.get(TIMES_FIELD)
    if stamps is not None and (
            stamps.shape != (len(points),) or stamps.dtype.kind not in 'fiu'
            or not np.isfinite(stamps).all() or (np.diff(stamps) < 0.).any()):
        raise RecordingError(f'{path}: {TIMES_FIELD} of shape {stamps.shape}, {stamps.dtype}; '
                             f'expected {len(points)} increasing numbers, the times of the '
                             'frames')
    labels, repeated = unique_labels(named[pair])
    is_landmarks = pair[0] != 'markers'
    # No camera loses a landmark in every frame: such are relative to it.
    is_origin = (points == 0.).all(axis=(0, 2)) & is_landmarks
    buffer = PointBuffer(path, labels, zero_is_missing, len(points), is_origin)
    buffer.append(points)
    labels, points = buffer.finish()
    return PointRecording(
        path.name, 'npz', labels, points, rate if rate > 0. else np.nan,
        None if stamps is None else stamps.astype(float), Axes(),
        (*filter(None, (repeated,)), *beside), is_landmarks,
        side=_side_of(fields.get('side'))), Axes('m', 'z')


def _side_of(field: np.ndarray | None) -> str:
    """Return the side that a field names, else nothing."""
    side = str(field).lower()
    return side if side in SIDES else ''


def _layout_hint(names: Collection[str]) -> str:
    """Return which layout reads markers of these names, in brackets, or nothing."""
    known = {preset: len(layout.names) for preset, make in LAYOUT_PRESETS.items()
             if set((layout := make()).names) <= set(names)}
    return f' (--layout {max(known, key=lambda preset: known[preset])})' if known else ''


def write_npz(path: Path, recording: PointRecording) -> None:
    """Write points as an npz file: `markers` [m] and `marker_names`, or `positions`, `joints`.

    Parameters
    ----------
    path : Path
    recording : PointRecording
    """
    points, names = NPZ_FIELDS[recording.is_landmarks]
    labels = [label or f'unlabeled {i + 1}' for i, label in enumerate(recording.labels)]
    fields: dict[str, Any] = {points: recording.points, names: np.array(labels),
                              'rate_hz': np.array(recording.rate)}
    if recording.stamps is not None:
        fields[TIMES_FIELD] = recording.stamps
    if recording.side:
        fields['side'] = np.array(recording.side)
    with open(path, 'wb') as file:
        np.savez(file, **fields)
