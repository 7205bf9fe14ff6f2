"""Write joint angles as CSV: a row for each frame, in seconds and degrees."""

import csv
import os
from collections.abc import Iterable, Sequence
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ..core.errors import HandTrackerError
from ..output_files import folder_beside, require_folder

TIME_COLUMN = 'time_s'   # the first
WRIST_COLUMNS = ('wrist_x_m', 'wrist_y_m', 'wrist_z_m',
                 'wrist_qx', 'wrist_qy', 'wrist_qz', 'wrist_qw')


class TableError(HandTrackerError):
    """An angle table cannot be written; the message names the path."""


def write_angle_table(
        path: str | PathLike[str], joints: Sequence[str],
        rows: Iterable[tuple[float, ArrayLike, Sequence[float]]],
        wrists: Sequence[str] = (), others: Sequence[str] = ()) -> None:
    """Write an angle table row by row, to a temporary file that is renamed at the end.

    Parameters
    ----------
    path : path-like
        Replaced if it exists.
    joints : sequence of str, length n
    rows : iterable of (float, array_like, sequence of float)
        Time [s], n angles [rad], and the other numbers: of each wrist position [m] and quaternion
        x, y, z, w, then those of `others`.
    wrists : sequence of str, optional
        For each wrist what its columns' names begin with.
    others : sequence of str, optional
        Names of the last columns.

    Raises
    ------
    TableError
        If the folder to write into does not exist, or the file cannot be written.
    """
    path = Path(path)
    poses = [wrist + column for wrist in wrists for column in WRIST_COLUMNS]
    require_folder(path, TableError)
    with folder_beside(path, TableError) as scratch:
        unfinished = scratch / path.name
        with open(unfinished, 'w', newline='', encoding='utf-8') as file:
            csv.writer(file).writerow(
                [TIME_COLUMN, *(f'{joint}_deg' for joint in joints), *poses, *others])
            line = ','.join(['%.6f', *['%.3f'] * len(joints), *['%.6f'] * len(poses),
                             *['%.3f'] * len(others)]) + '\r\n'
            for seconds, angles, numbers in rows:
                file.write(line % (seconds, *np.degrees(angles).tolist(), *numbers))
        os.replace(unfinished, path)
