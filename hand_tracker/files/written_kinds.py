"""Kinds of files that commands write, and their variants, as their options list them.

Nothing is imported here, so that a wrong option is reported at once.
"""

from __future__ import annotations

MCAP = '.mcap'
BAG_SUFFIXES = MCAP, '.db3'
TABLE = '.csv'
OUTPUT_KINDS = (TABLE, *BAG_SUFFIXES)                    # of tracked angles
POINT_KINDS = '.trc', '.c3d'
SKELETON_KINDS = SKELETON_KIND, SKINNED_KIND = '.bvh', '.glb'
MOTION_KINDS = (*SKELETON_KINDS, *POINT_KINDS)   # of a tracked hand in motion
TRACKED_KINDS = (*OUTPUT_KINDS, *MOTION_KINDS)
# Formats of points, as `convert --format` calls them.
WRITTEN_FORMATS = 'c3d', 'trc', 'qualisys-tsv', 'optitrack-csv', 'vicon-csv', 'npz'
WRISTS = 'body', 'hand'     # whose rotation the wrists of a spliced body keep
# Programs whose names joints of a skeleton get, and orders of its Euler angles.
NAMINGS = 'humanik', 'mixamo', 'xsens', 'unity', 'rokoko', 'optitrack'
EULER_ORDERS = 'ZXY', 'ZYX', 'XYZ', 'XZY', 'YXZ', 'YZX'
