"""Points of a recording of any format, with names, unit and axes by the hands in it."""

from __future__ import annotations

from collections.abc import Iterable
from os import PathLike
from pathlib import Path

from ..core.model.hand import SIDES
from ..core.model.marker_layout import MARKERS, MarkerLayout
from ..files.bag_points import marker_names
from ..files.bvh_file import read_bvh_joints, rest_size
from ..files.point_recording import PointRecording
from ..files.recordings import BVH, ReadingOptions, read_recording
from ..messages.labels import LabelMap, default_labels, label_maps
from ..messages.marker_array import MARKER_ARRAY
from .hand_axes import is_body, with_recognised_axes


def recorded_points(path: str | PathLike[str],
                    reading: ReadingOptions | None = None,
                    layout: MarkerLayout | None = None,
                    by_label: LabelMap | None = None,
                    wanted: Iterable[str] = ()) -> PointRecording:
    """Read a recording as points, with unit and handedness by its hands, or by the body in it.

    Parameters
    ----------
    path : path-like
    reading : ReadingOptions, optional
    layout : MarkerLayout, optional
        Whose markers are wanted; in MarkerArrays they have the ids from 0 on, beside others.
    by_label : LabelMap, optional
        Of that layout's markers, where they have others.
    wanted : iterable of str, optional
        Labels of points that are wanted, in place of the layout's names.

    Returns
    -------
    PointRecording
        Markers of MarkerArrays have the names of their namespaces, where each has one of its own;
        else those of the layout; without one those of the paper's places, where all have the ids
        0 to 7. The ids may be in the namespaces right and left.

    Raises
    ------
    HandTrackerError
    """
    meant = tuple(wanted) or (() if layout is None else tuple(layout.names))
    reading = (reading or ReadingOptions())._replace(names=meant)
    recording = read_recording(path, reading)
    if recording.origin is not None and recording.origin.type == MARKER_ARRAY:
        labels = recording.labels
        names = marker_names(labels) if by_label is None else ()
        recording = recording._replace(
            labels=names or _names_by_id(labels, layout, by_label) or labels)
    size = None
    if recording.format == BVH.name and is_body(recording):
        size = rest_size(read_bvh_joints(Path(path)))
    return with_recognised_axes(recording, size, reading.is_scaled)


def _names_by_id(labels: tuple[str, ...], layout: MarkerLayout | None,
                 by_label: LabelMap | None) -> tuple[str, ...]:
    """Return the names of a layout's markers for their ids, of a hand or of both.

    Parameters
    ----------
    labels : tuple of str
        As 'namespace/id'.
    layout : MarkerLayout or None
        The paper's eight, if there are no others, where None.
    by_label : LabelMap or None
        Of its markers, where their ids are not those from 0 on.

    Returns
    -------
    tuple of str
        Empty where the ids do not say which is which.
    """
    layout_or_paper = layout or MarkerLayout()
    # The paper's are named by their places, which say more.
    names = (layout_or_paper.places if layout_or_paper.names == MARKERS
             else layout_or_paper.names)
    of_both = label_maps(default_labels(names), {side: f'{side}/0' for side in SIDES}, names)
    both = {f'{side}_': of_side for side, of_side in of_both.items()}
    for hands in ((both, {'': LabelMap(default_labels(names), names)}) if by_label is None
                  else ({'': by_label},)):
        named: list[list[str]] = []
        for label in labels:
            space, _, number = label.rpartition('/')
            named.append([prefix + names[slot] for prefix, of_hand in hands.items()
                          if (slot := of_hand.slot(space, int(number))) is not None])
        found = tuple(one[0] if one else label for one, label in zip(named, labels))
        if len(found) == len(set(found)) and (any(named) if layout else all(named)):
            return found
    return ()
