"""Load the skin of a hand: from the user's cache, or computed and then cached."""

import hashlib
import os
import zipfile
from dataclasses import fields
from os import PathLike
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..core.errors import InvalidMesh
from ..core.model.hand import JOINTS, OTHER_SIDE, Hand
from ..core.model.kinematics import Pose, forward, joint_table, tip_offsets
from ..core.model.skeleton import DIGIT_CHAINS, PALM_BONES, skeleton_points
from ..output_files import OutputError, write_whole
from .signed_distance import hand_shape
from .skinning import Skin, deform

# From wrist to thumb CMC; it moves with the palm, not with the thumb.
WRIST_TO_THUMB = PALM_BONES[len(DIGIT_CHAINS) - 1]
SKINNED_BONES = PALM_BONES[:len(DIGIT_CHAINS)] + tuple(
    bone for chain in DIGIT_CHAINS for bone in zip(chain, chain[1:]))
# Link that each of these bones moves with.
BONE_LINKS = tuple(
    DIGIT_CHAINS[0][0] if bone == WRIST_TO_THUMB else bone[1] if bone in PALM_BONES else bone[0]
    for bone in SKINNED_BONES)
SKIN_LINKS = tuple(sorted(set(BONE_LINKS)))
RIGHT_TO_LEFT = (1., -1., 1.)
# On the skin of a right hand.
FIELDS_WITHOUT_EFFECT = ('limits', 'range_of_motion', 'coupling', 'coupling_spread',
                         'natural_flexion', 'palm_synergy', 'thumb_mcp_abduction', 'side')


class SkinArrays(NamedTuple):
    """The cached part of a `Skin`.

    Attributes
    ----------
    vertices : ndarray, shape (V, 3)
        [m]
    faces : ndarray of int, shape (F, 3)
    weights : ndarray, shape (V, B)
    """

    vertices: np.ndarray
    faces: np.ndarray
    weights: np.ndarray


def load_skin(hand: Hand, mesh: str | PathLike[str] | None = None) -> Skin:
    """Return the skin of a hand.

    Computing it takes some seconds; it is then cached in the user's cache folder
    (``$XDG_CACHE_HOME`` or ``~/.cache``), keyed by the content of hand and mesh.

    Parameters
    ----------
    hand : Hand
    mesh : path-like, optional
        Closed mesh (OBJ, PLY, STL) of a hand of this side with its joints at zero angles, of any
        size and pose: it is registered with the hand. Generated from the hand when left out.

    Returns
    -------
    Skin

    Raises
    ------
    InvalidMesh
        Naming the file, what is wrong and what is expected.
    MissingLibrary
        If the skin is not cached and a library to compute it is not installed.
    """
    path = _cache_directory() / f'skin-{_cache_key(hand, mesh)}.npz'
    arrays = _read_cache(path)
    if arrays is None:
        arrays = _registered_mesh_arrays(hand, mesh) if mesh else generated_arrays(hand)
        _write_cache(path, arrays)
    vertices, faces, weights = arrays
    if hand.side == 'left' and not mesh:
        vertices, faces = vertices * RIGHT_TO_LEFT, faces[:, ::-1].copy()
    return Skin(vertices, faces, weights, SKIN_LINKS, _skin_frames(_rest_pose(hand)))


def generated_arrays(hand: Hand) -> SkinArrays:
    """Return the skin generated from a hand, as that of a right hand."""
    # Here, as a skin that is kept needs none of scipy, which takes long to import.
    from .surface import surface_mesh

    right = hand.as_right()
    shape = hand_shape(right)
    vertices, faces = surface_mesh(shape)
    weights = _weights(vertices, faces, shape.points)
    spread = Skin(vertices, faces, weights, SKIN_LINKS, _skin_frames(shape.pose))
    return SkinArrays(deform(spread, _rest_pose(right)), faces, weights)


def _registered_mesh_arrays(hand: Hand, mesh: str | PathLike[str]) -> SkinArrays:
    """Return the skin of a mesh file, registered with a hand of the same side.

    Raises
    ------
    InvalidMesh
        If the mesh cannot be read, does not resemble the hand, or is of the other side.
    """
    from .mesh_registration import MAX_REGISTRATION_ERROR, read_mesh, register

    scanned, faces = read_mesh(mesh)
    model = load_skin(hand).vertices
    vertices, error = register(scanned, model)
    if error > MAX_REGISTRATION_ERROR:
        raise InvalidMesh(
            f'{mesh}: laid upon the {hand.side} hand it is off by {1000. * error:.0f} mm in the '
            f'mean; expected is a hand with straight joints and without forearm, within '
            f'{1000. * MAX_REGISTRATION_ERROR:.0f} mm')
    if register(scanned, model * RIGHT_TO_LEFT)[1] < error:
        other = OTHER_SIDE[hand.side]
        raise InvalidMesh(f'{mesh}: it fits a {other} hand, expected is a {hand.side} one')
    points = skeleton_points(tip_offsets(hand), _rest_pose(hand), np.zeros(3))
    return SkinArrays(vertices, faces, _weights(vertices, faces, points))


def _weights(vertices: np.ndarray, faces: np.ndarray, points: np.ndarray) -> np.ndarray:
    from .bone_heat import bone_weights

    columns = np.array([SKIN_LINKS.index(link) for link in BONE_LINKS])
    return bone_weights(
        vertices, faces, points[np.array(SKINNED_BONES)], columns, len(SKIN_LINKS))


def _rest_pose(hand: Hand) -> Pose:
    return forward(joint_table(hand), np.zeros(len(JOINTS)))


def _skin_frames(pose: Pose) -> Pose:
    return Pose(*(part[list(SKIN_LINKS)] for part in pose))


def _cache_directory() -> Path:
    """Return the folder of cached skins: hand_tracker in the user's cache folder."""
    return Path(os.environ.get('XDG_CACHE_HOME') or Path.home() / '.cache') / 'hand_tracker'


def _cache_key(hand: Hand, mesh: str | PathLike[str] | None) -> str:
    """Return a hash of everything the skin depends on: hand, mesh and the code of this folder."""
    key = hashlib.sha256()
    for code in sorted(Path(__file__).parent.glob('*.py')):
        key.update(code.read_bytes())
    for values in _shape_of(hand):
        key.update(np.ascontiguousarray(values).tobytes())
    if mesh:
        key.update(hand.side.encode())
        try:
            key.update(Path(mesh).expanduser().read_bytes())
        except OSError as error:
            raise InvalidMesh(f'{mesh}: {error.strerror}') from None
    return key.hexdigest()[:32]


def has_skin_of(hand: Hand, other: Hand) -> bool:
    """Return whether two hands of one side have the same skin, and the same table of joints."""
    return all(map(np.array_equal, _shape_of(hand), _shape_of(other)))


def _shape_of(hand: Hand) -> list[np.ndarray | float]:
    """Return what a hand's skin depends on."""
    return [getattr(hand, field.name) for field in fields(hand)
            if field.name not in FIELDS_WITHOUT_EFFECT]


def _read_cache(path: Path) -> SkinArrays | None:
    """Return the cached arrays, or None if there are none or they are damaged."""
    try:
        with np.load(path, allow_pickle=False) as file:
            arrays = SkinArrays(*(file[name] for name in SkinArrays._fields))
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
    vertices, faces, weights = arrays
    valid = (vertices.shape == (len(vertices), 3) and faces.shape == (len(faces), 3)
             and weights.shape == (len(vertices), len(SKIN_LINKS)))
    return arrays if valid else None


def _write_cache(path: Path, arrays: SkinArrays) -> None:
    """Write the cache file atomically; do nothing if it cannot be written."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, lambda unfinished: np.savez(unfinished, **arrays._asdict()))
    # The cache is optional.
    except (OSError, OutputError):
        pass
