"""Write a tracked hand for animation and science: BVH, GLB, TRC and C3D of joint centres."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from ..core.errors import HandTrackerError
from ..core.model.hand import LINKS, Hand
from ..files.bvh_file import write_bvh
from ..files.glb_file import BoundMesh, strongest_influences, write_glb
from ..files.recordings import write_recording
from ..files.skeleton_motion import (
    SKELETON_LINKS,
    HandAngles,
    evenly_timed,
    joint_centres,
    skeleton_motion,
    t_pose_turn,
)
from ..files.written_kinds import EULER_ORDERS, MOTION_KINDS, NAMINGS, POINT_KINDS
from ..output_files import write_whole
from ..skin.load import load_skin
from ..skin.skinning import Skin
from .recording import RecordedFrame


def collect_frames(frames: Iterable[RecordedFrame], hand: Callable[[], Hand]) -> HandAngles:
    """Return tracked frames as one motion of one hand.

    Parameters
    ----------
    frames : iterable of RecordedFrame
    hand : callable
        Returns the hand, asked for after the last frame: its size may be learned meanwhile.

    Returns
    -------
    HandAngles

    Raises
    ------
    HandTrackerError
        If there are no frames.
    """
    angles, positions, rotations, stamps = [], [], [], []
    for _, stamp, _, state in frames:
        angles.append(state.angles.copy())
        positions.append(state.wrist_position.copy())
        rotations.append(state.wrist_rotation.copy())
        stamps.append(stamp)
    if not stamps:
        raise HandTrackerError('no tracked frame to write; expected frames that show the palm')
    times = 1e-9 * (np.array(stamps) - stamps[0])
    return HandAngles(hand(), np.array(angles), np.array(positions), np.array(rotations), times)


def save_motion(path: Path, tracked: HandAngles, naming: str = NAMINGS[0],
                order: str = EULER_ORDERS[0]) -> None:
    """Write a tracked hand; the file appears when it is whole.

    Parameters
    ----------
    path : Path
        Of one of `MOTION_KINDS`: a skeleton in motion (`.bvh`), the same with the skin that
        follows it (`.glb`), or joint centres and tips (`.trc`, `.c3d`).
    tracked : HandAngles
    naming, order : str, optional
        Names of the joints, of `NAMINGS`; order of the Euler angles, of `EULER_ORDERS`.

    Raises
    ------
    HandTrackerError
        If the path has another extension, or cannot be written to.
    """
    if path.suffix in POINT_KINDS:
        write_recording(path, joint_centres(tracked, path.stem))
        return
    if path.suffix not in MOTION_KINDS:
        raise HandTrackerError(f'{path}: unknown extension {path.suffix!r}; expected '
                               f'{", ".join(MOTION_KINDS)}')
    if not path.parent.is_dir():
        raise HandTrackerError(f'{path}: no folder {path.parent}; expected one to write into')
    if path.suffix == '.bvh':
        # Its frames have no times of their own.
        motion = skeleton_motion(evenly_timed(tracked), naming)
        write_whole(path, lambda unfinished: write_bvh(unfinished, motion, order))
    else:
        motion = skeleton_motion(tracked, naming)
        mesh = bound_mesh(load_skin(tracked.hand), tracked.hand.side)
        write_whole(path, lambda unfinished: write_glb(unfinished, motion, mesh))


def bound_mesh(skin: Skin, side: str) -> BoundMesh:
    """Return a skin as a mesh that is bound to the joints of `skeleton_motion`."""
    columns = np.array([1 + SKELETON_LINKS.index(LINKS[link]) for link in skin.links])
    joints, weights = strongest_influences(skin.weights, columns)
    return BoundMesh(skin.vertices @ t_pose_turn(side).T, skin.faces, joints, weights)
