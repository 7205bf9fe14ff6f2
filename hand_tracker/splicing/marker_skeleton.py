"""A body of markers with tracked hands as a skeleton in motion, for BVH and glTF."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..drawing.render import ball_mesh
from ..files.glb_file import BoundMesh, joined_meshes, rigid_mesh
from ..files.point_recording import ROTATIONS, PointRecording, unique_labels
from ..files.skeleton_motion import (
    HandAngles,
    SkeletonMotion,
    joined_skeletons,
    resampled_hand,
    resting_root,
    skeleton_motion,
)
from ..tracking.save_motion import placed_skin
from .clock_alignment import ClockAlignment
from .spliced_points import ASSUMED_BODY_RATE, World

ROOT_NAME = 'body'
MARKER_RADIUS = .008       # [m] of a drawn marker
WHITE = 1., 1., 1.


def marker_skeleton(body: PointRecording, hands: Sequence[tuple[HandAngles, ClockAlignment, World]],
                    naming: str) -> SkeletonMotion:
    """Return a skeleton in motion: markers and hands are joints of one root, at rest in the origin.

    A marker is a joint that is only translated, along a straight line while it is hidden; markers
    without a label are left out. Outside its recording a hand keeps its first or last pose.

    Parameters
    ----------
    body : PointRecording
        The markers of the body [m].
    hands : sequence of (HandAngles, ClockAlignment, World)
        Of each hand its motion, its clock against the body's, and its pose in the body's world.
    naming : str
        Of the hands' joints, one of `NAMINGS`.

    Returns
    -------
    SkeletonMotion
        The markers behind the root, then the joints of each hand, the wrist first.
    """
    to_y_up = np.array(ROTATIONS['y'], dtype=float).T
    times = body.times(ASSUMED_BODY_RATE)
    markers = []
    for column in np.flatnonzero([bool(label) for label in body.labels]).tolist():
        points = body.points[:, column].astype(float)
        seen = np.isfinite(points).all(axis=1)
        if not seen.any():
            continue
        path = np.stack([np.interp(times, times[seen], axis) for axis in points[seen].T], axis=1)
        markers.append(resting_root(body.labels[column], times)._replace(
            root_position=path @ to_y_up.T))
    motions = []
    for tracked, alignment, world in hands:
        own = tracked.times - tracked.times[0]
        hand = resampled_hand(tracked, own, np.clip(
            alignment.hand_times(times), own[0], own[-1]))
        motions.append(skeleton_motion(hand._replace(
            wrist_rotation=world.rotation @ hand.wrist_rotation,
            wrist_position=hand.wrist_position @ world.rotation.T + world.origin), naming))
    joined = joined_skeletons(resting_root(ROOT_NAME, times), [*markers, *motions])
    return joined._replace(names=unique_labels(joined.names)[0])


def marker_mesh(skeleton: SkeletonMotion, hands: Sequence[HandAngles]) -> BoundMesh:
    """Return a mesh of a `marker_skeleton`: balls for its markers, the hands' skins.

    Parameters
    ----------
    skeleton : SkeletonMotion
    hands : sequence of HandAngles
        As it was made of.

    Returns
    -------
    BoundMesh
    """
    meshes = []
    wrists = [joint for joint, parent in enumerate(skeleton.parents) if joint in skeleton.parents
              and parent == 0]
    markers = range(1, wrists[0] if wrists else len(skeleton.names))
    for joint in markers:
        ball = ball_mesh(skeleton.offsets[joint], MARKER_RADIUS, WHITE)
        meshes.append(rigid_mesh(ball.vertices, ball.faces, joint))
    for wrist, tracked in zip(wrists, hands):
        meshes.append(placed_skin(tracked.hand, skeleton, wrist))
    return joined_meshes(meshes)
