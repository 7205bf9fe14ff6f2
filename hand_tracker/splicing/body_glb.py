"""A spliced body as a skeleton with meshes, for glTF: bones of the body, skin of the hands."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from ..core.model.hand import Hand
from ..files.bvh_file import BvhMotion, channel_columns
from ..files.glb_file import BoundMesh, joined_meshes, rigid_mesh
from ..files.skeleton_motion import SkeletonMotion
from ..skin.load import load_skin
from ..tracking.save_motion import bound_mesh
from .body_skeleton import hand_joint_names
from .spliced_body import SplicedHand, body_times

BONE_WIDTH = .12           # of a drawn bone, of its length
WIDEST_AT = .2             # of its length
# Triangles of an octahedron, anticlockwise from outside: its root, four corners around, its end.
BONE_FACES = np.array([(0, 1 + (i + 1) % 4, 1 + i) for i in range(4)]
                      + [(5, 1 + i, 1 + (i + 1) % 4) for i in range(4)])


def skeleton_of(body: BvhMotion, unit: float) -> SkeletonMotion:
    """Return the motion of a BVH file as a skeleton in metres.

    Parameters
    ----------
    body : BvhMotion
    unit : float
        Of the file [m].

    Returns
    -------
    SkeletonMotion
    """
    shown = [i for i, joint in enumerate(body.joints) if joint.channels or joint.parent < 0]
    new = {-1: -1} | {joint: i for i, joint in enumerate(shown)}
    columns = channel_columns(body.joints)
    frames = len(body.values)
    rotation = np.zeros((frames, len(shown), 4))
    rotation[..., 3] = 1.
    translations: dict[int, np.ndarray] = {}
    for i, joint in enumerate(shown):
        channels, values = body.joints[joint].channels, body.values[:, columns[joint]]
        turned = [k for k, channel in enumerate(channels) if channel.endswith('rotation')]
        if turned:
            order = ''.join(channels[k][0] for k in turned)
            rotation[:, i] = Rotation.from_euler(order, values[:, turned], degrees=True).as_quat()
        places = np.tile(body.joints[joint].offset, (frames, 1))
        for k, channel in enumerate(channels):
            if k not in turned:
                places[:, 'XYZ'.index(channel[0])] = values[:, k]
        if not i or len(turned) < len(channels):
            translations[i] = unit * places
    ends = {new[joint.parent]: unit * np.array(joint.offset) for i, joint in
            enumerate(body.joints) if i not in new}
    return SkeletonMotion(
        tuple(body.joints[joint].name for joint in shown),
        tuple(new[body.joints[joint].parent] for joint in shown),
        unit * np.array([body.joints[joint].offset for joint in shown]), ends,
        translations.pop(0), rotation, body_times(body), translations)


def body_mesh(skeleton: SkeletonMotion, hands: Sequence[tuple[SplicedHand, Hand]],
              naming: str) -> BoundMesh:
    """Return a mesh of a spliced body: an octahedron for each of its bones, the hands' skins.

    Parameters
    ----------
    skeleton : SkeletonMotion
        Of the spliced body.
    hands : sequence of (SplicedHand, Hand)
    naming : str
        One of `NAMINGS`, of the joints.

    Returns
    -------
    BoundMesh
    """
    origins = skeleton.origins
    meshes: list[BoundMesh] = []
    of_hands: set[int] = set()
    for spliced, hand in hands:
        wrist = _joint_of_wrist(skeleton, spliced, naming)
        joints = np.array([wrist, *(skeleton.names.index(name)
                                    for name in hand_joint_names(naming, spliced.place))])
        of_hands.update(joints[1:].tolist())
        skin = bound_mesh(load_skin(hand), hand.side)
        meshes.append(skin._replace(
            vertices=origins[wrist] + skin.vertices @ spliced.mount.wrist.T,
            joints=joints[skin.joints]))
    for joint, parent in enumerate(skeleton.parents):
        if parent >= 0 and joint not in of_hands:
            meshes.append(_bone(origins[parent], skeleton.offsets[joint], parent))
    meshes += [_bone(origins[joint], end, joint) for joint, end in skeleton.ends.items()
               if joint not in of_hands]
    return joined_meshes(meshes)


def _joint_of_wrist(skeleton: SkeletonMotion, spliced: SplicedHand, naming: str) -> int:
    first = skeleton.names.index(hand_joint_names(naming, spliced.place)[0])
    return skeleton.parents[first]


def _bone(start: np.ndarray, along: np.ndarray, joint: int) -> BoundMesh:
    """Return an octahedron from a joint along a bone that it turns."""
    length = np.linalg.norm(along)
    across = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
    across *= .5 * BONE_WIDTH * length / max(np.linalg.norm(across), 1e-12)
    other = np.cross(along, across) / max(length, 1e-12)
    ring = start + WIDEST_AT * along + np.array((across, other, -across, -other))
    vertices = np.concatenate((start[None], ring, (start + along)[None]))
    return rigid_mesh(vertices, BONE_FACES, joint)
