"""Read and write the CSV files of OptiTrack Motive, format versions 1.0 to 1.25."""

from __future__ import annotations

import csv
import re
from pathlib import Path
from typing import IO, NamedTuple

import numpy as np

from .point_recording import (
    Axes,
    PointBuffer,
    PointRecording,
    RecordingError,
    unique_labels,
    unit_name,
)
from .text_table import (
    TextTable,
    count_of,
    frame_times,
    known_rate,
    number_of,
    read_points,
    write_point_rows,
    written_labels,
)

MOTIVE_START = 'Format Version'
MAX_HEADER_LINES = 40
# Kinds of columns, the measured ones first: of two with one name the first is read.
MARKER_KINDS = ('marker', 'rigid body marker', 'bone marker', 'skeleton marker')
BODY_KINDS = ('bone', 'rigid body')
FALLBACK_DELIMITER = ';'   # of spreadsheets where the comma is the decimal point


class Column(NamedTuple):
    """A point of the table.

    Attributes
    ----------
    kind : str
        One of `MARKER_KINDS` or `BODY_KINDS`.
    name : str
    at : int
        Column of its x; y and z follow.
    """

    kind: str
    name: str
    at: int


def read_optitrack_csv(path: Path, file: IO[bytes], zero_is_missing: bool = True,
                       partial: bool = False) -> tuple[PointRecording, Axes]:
    """Read a CSV file of Motive: y up, in the unit that it names.

    Markers that stand twice, measured and as solved by their rigid body, are read once, as
    measured. Markers without a label, which begin a new column after every gap, are read as a
    cloud of as many points as are seen at once. Dates, in whatever language, are not read.

    Parameters
    ----------
    path : Path
        For messages.
    file : binary file
    zero_is_missing, partial : bool
        See `ReadingOptions`.

    Returns
    -------
    PointRecording
        Its points as in the file.
    Axes

    Raises
    ------
    RecordingError
    """
    table = TextTable(path, file)
    line = table.text_line() or ''
    delimiter = FALLBACK_DELIMITER if line.count(FALLBACK_DELIMITER) > line.count(',') else ','
    head = _keys(_cells(line, delimiter))
    rows = _header_rows(table, delimiter)
    columns, notes = _point_columns(table, rows)
    units = unit_name(head.get('length units', 'meters'))
    if units is None:
        raise table.fault(f'Length Units {head["length units"]!r}; expected a unit of length', 1)
    unique, repeated = unique_labels([column.name for column in columns])
    starts = np.array([column.at for column in columns])
    found = read_points(
        table, delimiter, len(rows[-1]), starts[:, None] + np.arange(3),
        PointBuffer(path, unique, zero_is_missing), 1,
        count_of(head.get('total exported frames', head.get('total frames in take', ''))),
        partial)
    rate, times = frame_times(number_of(head.get(
        'export frame rate', head.get('capture frame rate', ''))), found.times, found.numbers)
    notes += [note for note in (repeated, found.note) if note]
    if any(label == '' for label in unique):
        notes.append(f'{unique.count("")} columns without a label: '
                     f'{found.labels.count("")} points at once')
    recording = PointRecording(path.name, 'OptiTrack CSV', found.labels, found.points, rate,
                               times, Axes(), tuple(notes),
                               columns[0].kind in BODY_KINDS)
    return recording, Axes(units, 'y')


def _cells(line: str, delimiter: str) -> list[str]:
    try:
        return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]
    except csv.Error:
        return [cell.strip() for cell in line.split(delimiter)]


def _keys(cells: list[str]) -> dict[str, str]:
    """Return the first line's values by key: dates may hold commas, so keys are looked for."""
    known = ('format version', 'capture frame rate', 'export frame rate', 'length units',
             'total frames in take', 'total exported frames')
    return {cell.lower(): value for cell, value in zip(cells, cells[1:])
            if cell.lower() in known}


def _header_rows(table: TextTable, delimiter: str) -> list[list[str]]:
    """Return the rows of the header below the first line, that of the axes last."""
    rows: list[list[str]] = []
    for _ in range(MAX_HEADER_LINES):
        line = table.text_line()
        if line is None:
            raise table.fault('the file ends in its header; expected a line Frame, Time, X, Y, Z')
        cells = _cells(line, delimiter)
        if any(cells):
            rows.append(cells)
        if cells and cells[0].lower() == 'frame':
            if not table.has_line_end:
                raise table.fault('cut: no frame; expected a whole file')
            return rows
    raise table.fault('no line Frame, Time, X, Y, Z; expected the header of Motive')


def _point_columns(table: TextTable, rows: list[list[str]]) -> tuple[list[Column], list[str]]:
    """Return the columns of points, and notes on those that are left out."""
    *upper, axes = rows
    width = len(axes)
    kinds_at = next((i for i, row in enumerate(upper) if any(
        cell.lower() in MARKER_KINDS + BODY_KINDS for cell in row)), None)
    if kinds_at is None or kinds_at + 1 >= len(upper):
        raise table.fault('no row with Marker, Rigid Body or Bone; expected one above the names')
    kinds, names, channels = (
        (row + [''] * width)[:width] for row in (
            upper[kinds_at], upper[kinds_at + 1], upper[-1]))
    found = [Column(kinds[i].lower(), names[i], i) for i in range(width - 2)
             if [axis.upper() for axis in axes[i:i + 3]] == ['X', 'Y', 'Z']
             and channels[i].lower() in ('position', '')
             and kinds[i].lower() in MARKER_KINDS + BODY_KINDS]
    markers = [column for column in found if column.kind in MARKER_KINDS]
    if not markers:
        if not found:
            raise table.fault('no columns of positions; expected markers, exported with X, Y, Z')
        return found, ['no markers: rigid bodies and bones are read as points']
    best: dict[str, Column] = {}
    kept = []
    for column in sorted(markers, key=lambda column: MARKER_KINDS.index(column.kind)):
        key = re.sub(r'\W|_', '', column.name).lower()
        other = best.setdefault(key, column)
        if other is column or other.kind == column.kind:
            kept.append(column)
    kept.sort(key=lambda column: column.at)
    notes = []
    if len(kept) < len(markers):
        notes.append(f'{len(markers) - len(kept)} markers that stand twice are read as measured, '
                     'not as solved by their rigid body')
    if len(markers) < len(found):
        notes.append(f'left out: {len(found) - len(markers)} rigid bodies and bones')
    return kept, notes


def write_optitrack_csv(path: Path, recording: PointRecording) -> None:
    """Write points as Motive does, format version 1.23: metres, y up.

    Parameters
    ----------
    path : Path
    recording : PointRecording

    Raises
    ------
    RecordingError
        If it has no points.
    """
    frames, count = recording.points.shape[:2]
    if not count:
        raise RecordingError(f'{path}: no points to write; expected at least one')
    rate = f'{known_rate(recording.rate, recording.stamps):.6f}'
    names = written_labels(recording.labels, ',')

    def row(*cells: str) -> str:
        return ',,' + ','.join(cell for cell in cells for _ in range(3)) + '\n'

    header = (f'{MOTIVE_START},1.23,Take Name,{written_labels([path.stem], ",")[0]},'
              f'Capture Frame Rate,{rate},Export Frame Rate,{rate},'
              f'Total Frames in Take,{frames},Total Exported Frames,{frames},'
              'Rotation Type,Quaternion,Length Units,Meters,Coordinate Space,Global\n\n'
              + row(*['Marker'] * count) + row(*names)
              + row(*(str(i + 1) for i in range(count))) + row(*['Position'] * count)
              + 'Frame,Time (Seconds),' + ','.join(['X,Y,Z'] * count) + '\n')
    write_point_rows(path, header, recording, np.linalg.inv(Axes('m', 'y').matrix), 8, ',',
                     '{frame},{time:.8f}')
