"""Points of a recording of any format, with names, unit and axes by the hands in it."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from ..core.model.hand import SIDES
from ..core.model.marker_layout import PAPER_PLACES
from ..files.bag_points import marker_names
from ..files.bvh_file import read_bvh_joints, rest_size
from ..files.point_recording import PointRecording
from ..files.recordings import BVH, ReadingOptions, read_recording
from ..messages.labels import LabelMap, default_labels, label_maps
from ..messages.marker_array import MARKER_ARRAY
from .hand_axes import is_body, with_recognised_axes


def recorded_points(path: str | PathLike[str],
                    reading: ReadingOptions | None = None) -> PointRecording:
    """Read a recording as points, with unit and handedness by its hands, or by the body in it.

    Parameters
    ----------
    path : path-like
    reading : ReadingOptions, optional

    Returns
    -------
    PointRecording
        Markers of MarkerArrays have the names of their namespaces, where each has one of its own;
        else those of the paper's places, where all have the ids 0 to 7, or these in the
        namespaces right and left.

    Raises
    ------
    HandTrackerError
    """
    recording = read_recording(path, reading)
    if recording.origin is not None and recording.origin.type == MARKER_ARRAY:
        labels = recording.labels
        recording = recording._replace(
            labels=marker_names(labels) or _paper_places(labels) or labels)
    size = None
    if recording.format == BVH.name and is_body(recording):
        size = rest_size(read_bvh_joints(Path(path)))
    return with_recognised_axes(recording, size)


def _paper_places(labels: tuple[str, ...]) -> tuple[str, ...]:
    """Return the places of markers of the ids 0 to 7 of a hand, or of both; empty for others."""
    of_both = label_maps(default_labels(PAPER_PLACES), {side: f'{side}/0' for side in SIDES})
    for hands in ({f'{side}_': by_id for side, by_id in of_both.items()}, {'': LabelMap()}):
        named = []
        for label in labels:
            space, _, number = label.rpartition('/')
            named += [prefix + PAPER_PLACES[slot] for prefix, by_id in hands.items()
                      if (slot := by_id.slot(space, int(number))) is not None]
        if len(named) == len(set(named)) == len(labels):
            return tuple(named)
    return ()
