"""Read and write the TSV files of Qualisys Track Manager."""

from __future__ import annotations

from pathlib import Path
from typing import IO

import numpy as np

from .point_recording import Axes, PointBuffer, PointRecording, RecordingError, unique_labels
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

QTM_START = 'NO_OF_FRAMES'
MAX_KEYS = 1000  # lines in front of the numbers


def read_qualisys_tsv(path: Path, file: IO[bytes], zero_is_missing: bool = True,
                      partial: bool = False) -> tuple[PointRecording, Axes]:
    """Read a TSV file of Qualisys Track Manager: millimetres, z up, zeros where missing.

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
    head, names, first = _read_keys(table)
    kind = head.get('DATA_INCLUDED', ['3D'])[0].upper()
    if kind != '3D':
        raise RecordingError(f'{path}: DATA_INCLUDED {kind}; expected 3D, the positions of '
                             'markers')
    count = len(names)
    lead = _lead_columns(table, first, count)
    unique, repeated = unique_labels(names)
    found = read_points(
        table, '\t', lead + 3 * count, lead + np.arange(3 * count).reshape(-1, 3),
        PointBuffer(path, unique, zero_is_missing), 1 if lead > 1 else None,
        count_of(head.get(QTM_START, [''])[0]), partial, 0 if lead else None)
    rate, times = frame_times(number_of(head.get('FREQUENCY', [''])[0]),
                              found.times, found.numbers)
    notes = tuple(note for note in (repeated, found.note) if note)
    return PointRecording(path.name, 'Qualisys TSV', found.labels, found.points, rate,
                          times, Axes(), notes), Axes('mm', None)


def _read_keys(table: TextTable) -> tuple[dict[str, list[str]], list[str], list[str]]:
    """Return the header's values by key, the names, and the cells of the first row of numbers."""
    head: dict[str, list[str]] = {}
    columns: list[str] = []
    for _ in range(MAX_KEYS):
        line = table.text_line()
        if line is None:
            raise table.fault('the file ends in its header; expected rows of numbers')
        cells = [cell.strip() for cell in line.split('\t')]
        if np.isfinite(number_of(cells[0])):
            if not table.has_line_end:
                raise table.fault('cut: no whole frame; expected a whole file')
            table.put_back()
            break
        if cells[0].upper() == 'FRAME' or cells[0].endswith(' X'):
            columns = cells
        elif cells[0]:
            head[cells[0].upper()] = cells[1:] or ['']
    else:
        raise table.fault(f'no numbers in {MAX_KEYS} lines; expected rows of numbers')
    names = head.get('MARKER_NAMES', [])
    while names and not names[-1]:
        names.pop()
    if not names:
        names = [column[:-2] for column in columns if column.endswith(' X')]
    if not names:
        count = count_of(head.get('NO_OF_MARKERS', [''])[0])
        if count is None:
            raise table.fault('no MARKER_NAMES in the header; expected names of markers')
        names = [''] * min(count, len(cells))
    return head, names, cells


def _lead_columns(table: TextTable, cells: list[str], count: int) -> int:
    """Return the number of columns before the coordinates: frame and time, or none."""
    lead = len(cells) - 3 * count
    # A tab at the end of lines.
    if lead in (1, 3) and not cells[-1]:
        lead -= 1
    if lead not in (0, 1, 2):
        raise table.fault(f'{len(cells)} cells; expected 3 for each of {count} markers, and '
                          'perhaps frame and time', table.line + 1)
    return lead


def write_qualisys_tsv(path: Path, recording: PointRecording) -> None:
    """Write points as Qualisys Track Manager does: millimetres, z up, zeros where missing.

    Parameters
    ----------
    path : Path
    recording : PointRecording
    """
    frames, count = recording.points.shape[:2]
    names = written_labels(recording.labels, '\t')
    rate = known_rate(recording.rate, recording.stamps)
    columns = '\t'.join(f'{name} X\t{name} Y\t{name} Z' for name in names)
    header = (f'{QTM_START}\t{frames}\nNO_OF_CAMERAS\t0\nNO_OF_MARKERS\t{count}\n'
              f'FREQUENCY\t{rate:.6g}\nNO_OF_ANALOG\t0\nANALOG_FREQUENCY\t0\n'
              'DESCRIPTION\t--\nTIME_STAMP\t--\nDATA_INCLUDED\t3D\n'
              'MARKER_NAMES\t' + '\t'.join(names) + f'\nFrame\tTime\t{columns}\n')
    write_point_rows(path, header, recording, np.linalg.inv(Axes('mm').matrix), 4, '\t',
                     '{number}\t{time:.5f}', '0.000')
