"""Tables of joint angles: CSV with one row a frame, in seconds and degrees."""

import csv
import os
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from ..core.errors import HandTrackerError

WRIST_COLUMNS = ('wrist_x_m', 'wrist_y_m', 'wrist_z_m',
                 'wrist_qx', 'wrist_qy', 'wrist_qz', 'wrist_qw')


class TableError(HandTrackerError):
    """A table cannot be written."""


def write_angle_table(path, joints, rows, wrist=False):
    """Write a table of angles, row by row; the file appears when it is whole.

    Parameters
    ----------
    path : path-like
        Replaced if it exists.
    joints : sequence of str, length n
    rows : iterable of (float, array_like, sequence of float)
        Time [s], n angles [rad], and, with `wrist`, seven numbers: the wrist's position [m]
        and its quaternion x, y, z, w; else none.
    wrist : bool, optional
        Whether the table has columns for the wrist's pose.

    Raises
    ------
    TableError
        If there is no folder to write into.
    """
    path = Path(path)
    if not path.parent.is_dir():
        raise TableError(f'{path}: no folder {path.parent}; expected one to write into')
    with TemporaryDirectory(dir=path.parent) as scratch:
        unfinished = Path(scratch, path.name)
        with open(unfinished, 'w', newline='', encoding='utf-8') as file:
            csv.writer(file).writerow(['time_s', *(f'{joint}_deg' for joint in joints),
                                       *(WRIST_COLUMNS if wrist else ())])
            line = ','.join(['%.6f', *['%.3f'] * len(joints),
                             *['%.6f'] * len(WRIST_COLUMNS if wrist else ())]) + '\r\n'
            for seconds, angles, pose in rows:
                file.write(line % (seconds, *np.degrees(angles).tolist(), *pose))
        os.replace(unfinished, path)
