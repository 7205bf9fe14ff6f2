"""Size of a cloud of points without names, relative to the markers of a hand."""

from __future__ import annotations

import numpy as np

from ..core.model.hand import Hand
from ..core.model.kinematics import forward, joint_table
from ..core.model.layout_presets import LAYOUT_PRESETS, PAPER_LAYOUT, preset_layout
from ..core.model.marker_layout import PAPER_PLACES, marker_positions
from ..core.numerics.sampling import every_few
from ..files.point_recording import PointRecording
from .hand_labels import are_nameless

NEAR_POINTS = len(PAPER_PLACES)  # points that are near each other on a hand
SAMPLED_CLOUDS = 50              # frames
MOST_POINTS = 200                # of a cloud that is looked at
WHOLE_SHARE = 10.                # [%] of the frames that show a hand whole, at least; ours


def nameless_columns(recording: PointRecording) -> list[int]:
    """Return the columns of points without a label, else all where labels name nothing."""
    unnamed = [i for i, label in enumerate(recording.labels) if not label]
    return unnamed or list(
        range(len(recording.labels)) if are_nameless(recording.labels) else ())


def cloud_scale(recording: PointRecording) -> float | None:
    """Return how far apart nameless points are, relative to the markers of a hand.

    Parameters
    ----------
    recording : PointRecording

    Returns
    -------
    float or None
        By the nearest eight of each frame, as there may be others than the hand's; None where
        there are seldom eight [1].
    """
    some = every_few(recording.points, SAMPLED_CLOUDS)
    points = some[:, nameless_columns(recording)].astype(float)
    radii = _group_radii(points)
    if not len(radii):
        return None
    count = int(np.median(np.isfinite(points).all(axis=2).sum(axis=1)))
    layouts = map(preset_layout, LAYOUT_PRESETS)
    layout = next((one for one in layouts if len(one.names) == count), preset_layout(PAPER_LAYOUT))
    hand = Hand.scaled()
    usual = marker_positions(layout.mounting(hand), forward(joint_table(hand), hand.relaxed()))
    return float(np.percentile(radii, WHOLE_SHARE) / _group_radii(usual[None])[0]) or None


def _group_radii(points: np.ndarray) -> np.ndarray:
    """Return in each frame the least distance of a point within which eight points are.

    Parameters
    ----------
    points : ndarray, shape (T, n, 3)

    Returns
    -------
    ndarray, shape (t,)
        Of the frames with so many, and not too many.
    """
    radii = []
    for frame in points:
        seen = frame[np.isfinite(frame).all(axis=1)]
        if NEAR_POINTS <= len(seen) <= MOST_POINTS:
            distances = np.linalg.norm(seen[:, None] - seen[None], axis=2)
            radii.append(np.partition(distances, NEAR_POINTS - 1, axis=1)[:, NEAR_POINTS - 1].min())
    return np.array(radii)
