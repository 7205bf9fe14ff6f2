"""Read and write TRC files, the table of markers of Motion Analysis and OpenSim."""

from __future__ import annotations

from pathlib import Path
from typing import IO

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

TRC_START = 'PathFileType'
BLANK = ' \t,'   # what a line without a cell has
TRC_LEAD = 2  # columns in front of the coordinates: frame and time


def read_trc(path: Path, file: IO[bytes], zero_is_missing: bool = True,
             partial: bool = False) -> tuple[PointRecording, Axes]:
    """Read a TRC file.

    Columns counted from X0 or X1, a tab at the end of lines, a blank line behind the header or
    none, empty cells, and commas in place of tabs, as of a spreadsheet, are all read. Axes are as
    in OpenSim, y up, as the file does not say.

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
    lines: list[str] = []
    for what in (TRC_START, 'DataRate, CameraRate, ...', 'their values', 'names of markers',
                 'X1, Y1, Z1, ...'):
        line = table.text_line()
        if line is None:
            raise table.fault(f'the file ends; expected a line with {what}', len(lines) + 1)
        lines.append(line)
    delimiter = '\t' if '\t' in lines[3] else ',' if ',' in lines[4] else ' '
    keys, values, names, axes = ([cell.strip() for cell in (
        line.split() if delimiter not in line or delimiter == ' ' else line.split(delimiter))]
        for line in lines[1:])
    # Though tabs are doubled, as of some scripts.
    if sum(map(bool, values)) == sum(map(bool, keys)):
        keys, values = ([cell for cell in row if cell] for row in (keys, values))
    head = {key.lower(): value for key, value in zip(keys, values)}
    if 'datarate' not in head and 'nummarkers' not in head:
        raise table.fault(f'{", ".join(keys[:4])}; expected DataRate, NumMarkers, Units, ...', 2)
    count = sum(axis[:1].upper() == 'X' for axis in axes)
    labels = names[TRC_LEAD:] if delimiter == ' ' else names[TRC_LEAD::3]
    if not count:
        raise table.fault('no X, Y, Z columns; expected X1, Y1, Z1, ... under the names')
    if sum(bool(axis) for axis in axes) != 3 * count or (
            count_of(head.get('nummarkers', '')) or 0) > count:
        raise table.fault(f'columns of {count} markers of {head.get("nummarkers", "")}; the header '
                          'is cut: expected X, Y and Z of each')
    if len([name for name in labels if name]) > count:
        raise table.fault(f'{count} columns X for {len(labels)} names; expected one for each')
    labels = (labels + [''] * count)[:count]
    _skip_blank(table)
    unique, repeated = unique_labels(labels)
    found = read_points(
        table, delimiter, TRC_LEAD + 3 * count, TRC_LEAD + np.arange(3 * count).reshape(-1, 3),
        PointBuffer(path, unique, zero_is_missing), 1, count_of(head.get('numframes', '')),
        partial)
    units = unit_name(head.get('units', ''))
    rate, times = frame_times(number_of(head.get('datarate', '')), found.times, found.numbers)
    notes = [note for note in (repeated, found.note) if note]
    if head.get('units') and units is None:
        notes.append(f'units {head["units"]!r} are no length')
    recording = PointRecording(path.name, 'TRC', found.labels, found.points, rate, times, Axes(),
                               tuple(notes))
    return recording, Axes(units)


def _skip_blank(table: TextTable) -> None:
    while (line := table.text_line()) is not None:
        if line.strip(BLANK):
            table.put_back()
            return


def write_trc(path: Path, recording: PointRecording) -> None:
    """Write points as a TRC file as OpenSim takes it: millimetres, y up.

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
    if not count or not frames:
        raise RecordingError(f'{path}: {frames} frames of {count} points; expected at least one')
    rate = f'{known_rate(recording.rate, recording.stamps):.6g}'
    names = written_labels(recording.labels, '\t')
    header = (
        f'{TRC_START}\t4\t(X/Y/Z)\t{path.name}\n'
        'DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\t'
        'OrigNumFrames\n'
        f'{rate}\t{rate}\t{frames}\t{count}\tmm\t{rate}\t1\t{frames}\n'
        + 'Frame#\tTime\t' + '\t\t\t'.join(names) + '\t\t\n'
        + '\t\t' + '\t'.join(f'X{i}\tY{i}\tZ{i}' for i in range(1, count + 1)) + '\n\n')
    write_point_rows(path, header, recording, np.linalg.inv(Axes('mm', 'y').matrix), 5, '\t',
                     '{number}\t{time:.8f}')
