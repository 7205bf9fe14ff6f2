"""Recognise a recording whose labels name no markers for long: there are points, but no palm."""

from __future__ import annotations

from os import PathLike

import numpy as np

from ..core.model.marker_layout import PALM_MARKERS, MarkerLayout
from .opened_recording import open_recording
from .point_bag import PointBag
from .recording import MarkerReading, marker_topic, sampled_messages

LEAST_PALM_SHARE = .25   # of frames with the palm seen; with fewer, labels are useless
POINTS_SHARE = .5        # if this share has as many points as the hand has markers. Ours
CHECK_STEP = .1          # [s] between frames that are looked at
CHECKED_SECONDS = 60.    # from the start of a recording


def label_fault(recording: str | PathLike[str] | PointBag, topic: str | None,
                reading: MarkerReading, layout: MarkerLayout) -> str | None:
    """Return what is wrong where labels of a recording of enough points seldom show the palm.

    Such are points with numbers that change whenever one is hidden, as of systems that do not
    label.

    Parameters
    ----------
    recording : path-like or PointBag
        For `open_recording`.
    topic : str or None
        For `marker_topic`.
    reading : MarkerReading
    layout : MarkerLayout

    Returns
    -------
    str or None
        The fault, with its cure.
    """
    if not reading.has_labels:
        return None
    palm = [row for row in layout.principal[:len(PALM_MARKERS)] if row >= 0]
    markers, points = reading.marker_reader(), reading.point_reader()
    has_palm, has_points = [], []
    with open_recording(recording, partial=reading.partial) as bag:
        for message in sampled_messages(bag, marker_topic(bag, topic), CHECK_STEP):
            if message.time > bag.start + 1e9 * CHECKED_SECONDS:
                break
            positions = markers.read(message.data).positions
            has_palm.append(np.isfinite(positions[palm]).all())
            has_points.append(len(points.read(message.data).points) >= len(positions))
        if (not has_palm or np.mean(has_palm) >= LEAST_PALM_SHARE
                or np.mean(has_points) <= POINTS_SHARE):
            return None
        return (f"{bag.path}: there are points, but the labels show the palm's markers together "
                f'in only {100. * np.mean(has_palm):.0f} % of the frames; if they are of no use, '
                '--labels none finds the hand among the points by its shape')
