"""The skin of a hand: made once, kept in the user's cache, found there again."""

import hashlib
import os
import tempfile
import zipfile
from dataclasses import fields
from pathlib import Path

import numpy as np

from ..core.errors import InvalidMesh
from ..core.model.hand import JOINTS, SIDES
from ..core.model.kinematics import Pose, forward, joint_table, tip_offsets
from ..core.model.skeleton import DIGIT_CHAINS, PALM_BONES, skeleton_points
from .bone_heat import bone_weights
from .own_mesh import FARTHEST, laid_upon, read_mesh
from .signed_distance import flesh_of
from .skinning import Skin, deform
from .surface import surface

# The thumb moves on its root, the way there is the palm's.
TO_THUMB = PALM_BONES[len(DIGIT_CHAINS) - 1]
BONES = PALM_BONES[:len(DIGIT_CHAINS)] + tuple(
    bone for chain in DIGIT_CHAINS for bone in zip(chain, chain[1:]))
CARRIERS = tuple(DIGIT_CHAINS[0][0] if bone == TO_THUMB
                 else bone[1] if bone in PALM_BONES else bone[0]
                 for bone in BONES)
SKIN_LINKS = tuple(sorted(set(CARRIERS)))
MIRROR = (1., -1., 1.)
IRRELEVANT = ('limits', 'coupling', 'side')  # to the skin of a right hand


def load_skin(hand, mesh=None, cache=True):
    """Return the skin of a hand.

    It takes some seconds to make, and is kept in the user's cache (``$XDG_CACHE_HOME`` or
    ``~/.cache``) for hands and meshes of the same content.

    Parameters
    ----------
    hand : Hand
    mesh : path-like, optional
        A closed mesh of a hand of this side with its joints at zero angles (OBJ, PLY, STL), of
        any size and anywhere: it is laid upon the hand. Made from the hand when left out.
    cache : bool
        Whether to look into the cache and to leave the skin there.

    Returns
    -------
    Skin

    Raises
    ------
    InvalidMesh
        Naming the file, what is wrong and what is expected.
    MissingLibrary
        When the skin is neither in the cache nor can be made.
    """
    path = cache_directory() / f'skin-{_key(hand, mesh)}.npz' if cache else None
    arrays = _kept(path) if path else None
    if arrays is None:
        arrays = own_arrays(hand, mesh) if mesh else model_arrays(hand)
        if path:
            _keep(path, arrays)
    vertices, faces, weights = arrays
    if hand.side == 'left' and not mesh:
        vertices, faces = vertices * MIRROR, faces[:, ::-1].copy()
    return Skin(vertices, faces, weights, SKIN_LINKS, _frames(_rest(hand)))


def model_arrays(hand):
    """Return vertices, faces and weights of the skin of a hand, as a right hand."""
    right = hand.replace(side='right')
    flesh = flesh_of(right)
    vertices, faces = surface(flesh)
    weights = _weights(vertices, faces, flesh.points)
    spread = Skin(vertices, faces, weights, SKIN_LINKS, _frames(flesh.pose))
    return deform(spread, _rest(right)), faces, weights


def own_arrays(hand, mesh):
    """Return vertices, faces and weights of a person's own mesh, of the hand's own side."""
    own, faces = read_mesh(mesh)
    model = load_skin(hand).vertices
    vertices, apart = laid_upon(own, model)
    if apart > FARTHEST:
        raise InvalidMesh(
            f'{mesh}: laid upon the {hand.side} hand it is off by {1000. * apart:.0f} mm in the '
            f'mean; expected is a hand with straight joints and without forearm, within '
            f'{1000. * FARTHEST:.0f} mm')
    if laid_upon(own, model * MIRROR)[1] < apart:
        other = SIDES[1 - SIDES.index(hand.side)]
        raise InvalidMesh(f'{mesh}: it fits a {other} hand, expected is a {hand.side} one')
    points = skeleton_points(tip_offsets(hand), _rest(hand), np.zeros(3))
    return vertices, faces, _weights(vertices, faces, points)


def _weights(vertices, faces, points):
    carriers = np.array([SKIN_LINKS.index(link) for link in CARRIERS])
    return bone_weights(vertices, faces, points[np.array(BONES)], carriers, len(SKIN_LINKS))


def _rest(hand):
    return forward(joint_table(hand), np.zeros(len(JOINTS)))


def _frames(pose):
    return Pose(*(part[list(SKIN_LINKS)] for part in pose))


def cache_directory():
    """Return the folder where skins are kept: hand_tracker in the user's cache."""
    return Path(os.environ.get('XDG_CACHE_HOME') or Path.home() / '.cache') / 'hand_tracker'


def _key(hand, mesh):
    """Return a hash of all that a skin is made from: hand, mesh, and the code that makes it."""
    found = hashlib.sha256()
    for code in sorted(Path(__file__).parent.glob('*.py')):
        found.update(code.read_bytes())
    for field in fields(hand):
        if field.name not in IRRELEVANT:
            found.update(np.ascontiguousarray(getattr(hand, field.name)).tobytes())
    if mesh:
        found.update(hand.side.encode())
        try:
            found.update(Path(mesh).expanduser().read_bytes())
        except OSError as error:
            raise InvalidMesh(f'{mesh}: {error.strerror}') from None
    return found.hexdigest()[:32]


def _kept(path):
    """Return what is kept in a file, or None when there is none or it is damaged."""
    try:
        with np.load(path, allow_pickle=False) as file:
            vertices, faces, weights = (file[name] for name in ('vertices', 'faces', 'weights'))
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
        return None
    sound = (vertices.shape == (len(vertices), 3) and faces.shape == (len(faces), 3)
             and weights.shape == (len(vertices), len(SKIN_LINKS)))
    return (vertices, faces, weights) if sound else None


def _keep(path, arrays):
    """Write a file in one step, so that no one ever reads half of it."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, suffix='.part', delete=False) as file:
            np.savez(file, **dict(zip(('vertices', 'faces', 'weights'), arrays)))
        os.replace(file.name, path)
    # A cache that cannot be written is no reason to have no skin.
    except OSError:
        pass
