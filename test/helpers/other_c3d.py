"""C3D files as another library writes them."""

import ezc3d
import numpy as np


def ezc3d_file(path, labels, points, units='mm', rate=100., **parameters):
    """Write a C3D file by another library; points (T, N, 3), NaN where missing."""
    file = ezc3d.c3d()
    homogeneous = np.ones((4, points.shape[1], len(points)))
    homogeneous[:3] = np.moveaxis(points, 2, 0).swapaxes(1, 2)
    file['data']['points'] = homogeneous
    file['parameters']['POINT']['RATE']['value'] = [rate]
    file['parameters']['POINT']['LABELS']['value'] = list(labels)
    file['parameters']['POINT']['UNITS']['value'] = [units]
    for name, value in parameters.items():
        file.add_parameter('POINT', name, value)
    file.write(str(path))
    return path
