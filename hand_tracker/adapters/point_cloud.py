"""Points of a sensor_msgs/PointCloud2, whatever fields it has beside x, y and z."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from .point_frame import MalformedFrame, SourceFrame, point_frame

# Of sensor_msgs/PointField, by its constants INT8 to FLOAT64.
FIELD_FORMATS = {1: 'i1', 2: 'u1', 3: 'i2', 4: 'u2', 5: 'i4', 6: 'u4', 7: 'f4', 8: 'f8'}
AXES = 'x', 'y', 'z'


def points_of_cloud(message: Any) -> SourceFrame:
    """Return the points of a cloud: all are anonymous.

    Parameters
    ----------
    message : PointCloud2
        Of rclpy or of rosbags.

    Returns
    -------
    SourceFrame
        Without points that have a NaN or infinite coordinate.

    Raises
    ------
    MalformedFrame
        If x, y or z is missing, or the cloud's sizes contradict each other.
    """
    order = '>' if message.is_bigendian else '<'
    fields = {field.name: field for field in message.fields}
    formats, offsets = [], []
    for axis in AXES:
        if axis not in fields:
            raise MalformedFrame(f"point cloud: no field '{axis}'; it has "
                                 f"{', '.join(fields) or 'none'}, expected are x, y and z")
        field = fields[axis]
        if field.datatype not in FIELD_FORMATS:
            raise MalformedFrame(f"point cloud: field '{axis}' has data type {field.datatype}; "
                                 f'expected one of 1 to {max(FIELD_FORMATS)}')
        form = order + FIELD_FORMATS[field.datatype]
        if field.offset + np.dtype(form).itemsize > message.point_step:
            raise MalformedFrame(
                f"point cloud: field '{axis}' at byte {field.offset} goes beyond point_step "
                f'{message.point_step}')
        formats.append(form)
        offsets.append(field.offset)
    width, height = message.width, message.height
    data = memoryview(message.data)
    needed = (height - 1) * message.row_step + width * message.point_step if width * height else 0
    if message.row_step < width * message.point_step and height > 1 or needed > data.nbytes:
        raise MalformedFrame(
            f'point cloud: {data.nbytes} bytes of data; {height} rows of {width} points of '
            f'{message.point_step} bytes, a row every {message.row_step}, need {needed}')
    if math.prod((width, height)) == 0:
        return point_frame(message.header.stamp, message.header.frame_id)
    cloud = np.ndarray(
        (height, width), np.dtype({'names': AXES, 'formats': formats, 'offsets': offsets,
                                   'itemsize': message.point_step}),
        data, strides=(message.row_step, message.point_step)).ravel()
    return point_frame(message.header.stamp, message.header.frame_id,
                       points=np.stack([cloud[axis] for axis in AXES], axis=-1))
