"""PointCloud2 messages, laid out by numpy."""

import numpy as np

from hand_tracker.files.bags import TYPE_STORE

NUMBER_FORMATS = {'i1': 1, 'u1': 2, 'i2': 3, 'u2': 4, 'i4': 5, 'u4': 6, 'f4': 7, 'f8': 8}


def cloud(points, fields=('x', 'y', 'z'), form='f4', order='<', padding=0, height=1,
          row_padding=0):
    """Return a PointCloud2 of rosbags with points (n, 3); other fields are filled with bytes."""
    types = TYPE_STORE.types
    kinds = [form if name in ('x', 'y', 'z') else 'u4' for name in fields]
    layout = np.dtype([(name, order + kind) for name, kind in zip(fields, kinds)])
    step = layout.itemsize + padding
    layout = np.dtype({'names': fields, 'formats': [order + kind for kind in kinds],
                       'offsets': [layout.fields[name][1] for name in fields], 'itemsize': step})
    width = len(points) // height
    rows = np.full((height, width * step + row_padding), 0xab, np.uint8)
    for row, part in zip(rows, np.reshape(points, (height, width, 3))):
        values = row[:width * step].view(layout)
        for axis, name in enumerate(('x', 'y', 'z')):
            values[name] = part[:, axis]
    return types['sensor_msgs/msg/PointCloud2'](
        header=types['std_msgs/msg/Header'](
            stamp=types['builtin_interfaces/msg/Time'](sec=5, nanosec=7), frame_id='world'),
        height=height, width=width, is_bigendian=order == '>', point_step=step,
        fields=[types['sensor_msgs/msg/PointField'](
            name=name, offset=layout.fields[name][1], datatype=NUMBER_FORMATS[kind], count=1)
            for name, kind in zip(fields, kinds)],
        row_step=width * step + row_padding, data=rows.ravel(), is_dense=False)
