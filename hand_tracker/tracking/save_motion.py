"""Write tracked hands for animation and science: BVH, GLB, TRC and C3D of joint centres."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

import numpy as np

from ..core.errors import HandTrackerError
from ..core.model.hand import JOINTS, LINKS, Hand
from ..files.bvh_file import write_bvh
from ..files.glb_file import BoundMesh, strongest_influences, write_glb
from ..files.recordings import write_recording
from ..files.skeleton_motion import (
    SKELETON_LINKS,
    HandAngles,
    SkeletonMotion,
    TrackedHands,
    evenly_timed,
    hands_centres,
    hands_motion,
    joint_centres,
    skeleton_motion,
    t_pose_turn,
)
from ..files.written_kinds import EULER_ORDERS, MOTION_KINDS, NAMINGS, POINT_KINDS, SKELETON_KIND
from ..output_files import require_folder, require_suffix, write_whole
from ..skin.load import load_skin
from ..skin.skinning import Skin
from .recording import RecordedFrame


def collect_hands(frames: Iterable[Mapping[str, RecordedFrame]],
                  hands: Callable[[], Mapping[str, Hand]]) -> TrackedHands:
    """Return tracked frames of several hands as their motions.

    Parameters
    ----------
    frames : iterable of mapping of str to RecordedFrame
        Of one stamp, by the hands' names: those that the frame has.
    hands : callable
        Returns all hands by their names, asked for after the last frame.

    Returns
    -------
    TrackedHands

    Raises
    ------
    HandTrackerError
        If there are no frames.
    """
    rows: defaultdict[str, list[int]] = defaultdict(list)
    poses: defaultdict[str, list[tuple[np.ndarray, ...]]] = defaultdict(list)
    stamps: list[int] = []
    for tracked in frames:
        for name, (_, _, _, state) in tracked.items():
            rows[name].append(len(stamps))
            poses[name].append((state.angles.copy(), state.wrist_position.copy(),
                                state.wrist_rotation.copy()))
        stamps.append(next(iter(tracked.values())).stamp)
    if not stamps:
        raise HandTrackerError('no tracked frame to write; expected frames that show the palm')
    times = 1e-9 * (np.array(stamps) - stamps[0])
    found, frames_of = [], []
    for name, hand in hands().items():
        own = np.array(rows[name], dtype=int)
        angles, positions, rotations = (
            np.array([pose[i] for pose in poses[name]]).reshape(-1, *shape)
            for i, shape in enumerate(((len(JOINTS),), (3,), (3, 3))))
        found.append(HandAngles(hand, angles, positions, rotations, times[own]))
        frames_of.append(own)
    return TrackedHands(tuple(found), tuple(frames_of), times, stamps[0])


def save_motion(path: Path, tracked: HandAngles | TrackedHands, naming: str = NAMINGS[0],
                order: str = EULER_ORDERS[0], start: float = 0.) -> None:
    """Write a tracked hand, or both; the file appears when it is whole.

    Parameters
    ----------
    path : Path
        Of one of `MOTION_KINDS`: a skeleton in motion (`.bvh`), the same with the skin that
        follows it (`.glb`), or joint centres and tips (`.trc`, `.c3d`).
    tracked : HandAngles or TrackedHands
    naming, order : str, optional
        Names of the joints, of `NAMINGS`; order of the Euler angles, of `EULER_ORDERS`.
    start : float, optional
        Time of the first frame in files of joint centres; skeletons in motion begin at 0 [s].

    Raises
    ------
    HandTrackerError
        If the path has another extension, or cannot be written to.
    """
    kind = path.suffix.lower()
    if kind in POINT_KINDS:
        centres = hands_centres(tracked, path.stem) if isinstance(
            tracked, TrackedHands) else joint_centres(tracked, path.stem)
        write_recording(path, centres._replace(stamps=centres.times() + start))
        return
    require_suffix(path, MOTION_KINDS)
    require_folder(path)
    # Frames of BVH have no times of their own.
    evenly = kind == SKELETON_KIND
    if isinstance(tracked, TrackedHands):
        motion = hands_motion(tracked, naming, evenly)
    else:
        motion = skeleton_motion(evenly_timed(tracked) if evenly else tracked, naming)
    if kind == SKELETON_KIND:
        write_whole(path, lambda unfinished: write_bvh(unfinished, motion, order))
    else:
        meshes = _skins(tracked, motion)
        write_whole(path, lambda unfinished: write_glb(unfinished, motion, *meshes))


def _skins(tracked: HandAngles | TrackedHands, motion: SkeletonMotion) -> list[BoundMesh]:
    """Return the skin of a hand, or those of both, on the joints of their motion."""
    if isinstance(tracked, HandAngles):
        return [placed_skin(tracked.hand, motion, 0)]
    wrists = [joint for joint, parent in enumerate(motion.parents) if parent == 0]
    shown = [one.hand for one in tracked.hands if len(one.times)]
    return [placed_skin(hand, motion, wrist)._replace(name=f'{hand.side}_skin')
            for hand, wrist in zip(shown, wrists)]


def placed_skin(hand: Hand, skeleton: SkeletonMotion, wrist: int) -> BoundMesh:
    """Return the skin of a hand on a skeleton with its joints: its wrist, those behind it.

    Parameters
    ----------
    hand : Hand
    skeleton : SkeletonMotion
    wrist : int
        Its root, or a joint of it.

    Returns
    -------
    BoundMesh
    """
    skin = bound_mesh(load_skin(hand), hand.side)
    return skin._replace(vertices=skeleton.offsets[wrist] + skin.vertices,
                         joints=wrist + skin.joints)


def bound_mesh(skin: Skin, side: str) -> BoundMesh:
    """Return a skin as a mesh that is bound to the joints of `skeleton_motion`."""
    columns = np.array([1 + SKELETON_LINKS.index(LINKS[link]) for link in skin.links])
    joints, weights = strongest_influences(skin.weights, columns)
    return BoundMesh(skin.vertices @ t_pose_turn(side).T, skin.faces, joints, weights)
