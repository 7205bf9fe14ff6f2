"""Read and write the CSV (ASCII) files of Vicon Nexus and Shogun: their block of trajectories."""

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
    frame_times,
    known_rate,
    number_of,
    read_points,
    write_point_rows,
    written_labels,
)

VICON_BLOCK = 'Trajectories'
OTHER_VICON_BLOCKS = ('Devices', 'Joints', 'Model Outputs', 'Segments', 'Events')


def read_vicon_csv(path: Path, file: IO[bytes], zero_is_missing: bool = True,
                   partial: bool = False) -> tuple[PointRecording, Axes]:
    """Read the block `Trajectories` of a CSV file of Vicon: z up, in the unit under each column.

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
    while (line := table.text_line()) is not None:
        if line.strip(' ,;"\t') == VICON_BLOCK:
            break
    else:
        raise table.fault(f'the file ends; expected a block {VICON_BLOCK}')
    lines = [table.text_line() or '' for _ in range(4)]
    delimiter = next((c for c in ',;\t' if c in lines[2]), ',')
    rate_cells, names, axes, units = ([cell.strip().strip('"') for cell in line.split(delimiter)]
                                      for line in lines)
    if not axes or axes[0].lower() != 'frame':
        raise table.fault('no line Frame, Sub Frame, X, Y, Z; expected it under the names',
                          table.line - 1)
    if not table.has_line_end:
        raise table.fault('cut: no frame; expected a whole file')
    starts = [i for i in range(len(axes) - 2)
              if [axis.upper() for axis in axes[i:i + 3]] == ['X', 'Y', 'Z']]
    if not starts:
        raise table.fault('no columns X, Y, Z; expected three for each marker', table.line - 1)
    labels = [names[i] if i < len(names) else '' for i in starts]
    unit = unit_name(units[starts[0]] if starts[0] < len(units) else '')
    unique, repeated = unique_labels(labels)
    found = read_points(
        table, delimiter, len(axes), np.array(starts)[:, None] + np.arange(3),
        PointBuffer(path, unique, zero_is_missing), None, None, partial)
    notes = tuple(note for note in (repeated, found.note) if note)
    rate, times = frame_times(number_of(rate_cells[0] if rate_cells else ''),
                              found.times, found.numbers)
    return PointRecording(path.name, 'Vicon CSV', found.labels, found.points, rate, times, Axes(),
                          notes), Axes(unit)


def write_vicon_csv(path: Path, recording: PointRecording) -> None:
    """Write points as Vicon Nexus does: millimetres, z up.

    Parameters
    ----------
    path : Path
    recording : PointRecording

    Raises
    ------
    RecordingError
        If it has no points.
    """
    count = recording.points.shape[1]
    if not count:
        raise RecordingError(f'{path}: no points to write; expected at least one')
    names = written_labels(recording.labels, ',')
    rate = known_rate(recording.rate, recording.stamps)
    header = (f'{VICON_BLOCK}\n{rate:.6g}\n,,' + ',,,'.join(names) + ',,\nFrame,Sub Frame,'
              + ','.join(['X,Y,Z'] * count) + '\n,,' + ','.join(['mm'] * (3 * count)) + '\n')
    write_point_rows(
        path, header, recording, np.linalg.inv(Axes('mm').matrix), 5, ',', '{number},0',
        first=recording.first_number(rate))
