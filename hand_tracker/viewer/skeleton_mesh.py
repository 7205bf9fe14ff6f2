"""Skeleton as a rigidly skinned mesh, deformed by the browser like the skin."""

import numpy as np

from ..core.model.hand import JOINTS, LINKS, Hand
from ..core.model.kinematics import Pose, forward, joint_table, tip_offsets
from ..core.model.skeleton import (
    DIGIT_TIPS,
    PALM_BONES,
    SKELETON_BONES,
    SKELETON_POINTS,
    skeleton_points,
)
from ..skin.skinning import Skin

BONE_RADIUS, JOINT_RADIUS = .0018, .0034  # [m]
FIRST_TIP = SKELETON_POINTS.index(DIGIT_TIPS[0])
CYLINDER_SIDES = 10
# As the CMC joints of the fingers are locked, any metacarpal moves with the palm.
PALM_LINK = LINKS.index('index_metacarpal')


def skeleton_mesh(hand: Hand) -> Skin:
    """Return the bones of a hand as cylinders with a ball at each joint.

    Distal phalanges end at the centre of the fingertip, as the tip itself is soft tissue.

    Parameters
    ----------
    hand : Hand

    Returns
    -------
    Skin
    """
    from trimesh import Trimesh
    from trimesh.creation import cylinder, icosphere

    rest = forward(joint_table(hand), np.zeros(len(JOINTS)))
    points = skeleton_points(tip_offsets(hand), rest, np.zeros(3))
    meshes: list[Trimesh] = []
    carriers: list[int] = []

    def add(mesh: Trimesh, carrier: int) -> None:
        meshes.append(mesh)
        carriers.append(carrier)

    def add_ball(centre: np.ndarray, radius: float, carrier: int) -> None:
        ball = icosphere(subdivisions=2, radius=radius)
        ball.apply_translation(centre)
        add(ball, carrier)

    for bone in SKELETON_BONES:
        carrier = PALM_LINK if bone in PALM_BONES else bone[0]
        start, end = points[list(bone)]
        if (digit := bone[1] - FIRST_TIP) >= 0:
            end = end - hand.radii[digit, -1] * (end - start) / np.linalg.norm(end - start)
            add_ball(end, BONE_RADIUS, carrier)
        add(cylinder(BONE_RADIUS, segment=(start, end), sections=CYLINDER_SIDES), carrier)
        add_ball(start, JOINT_RADIUS, carrier)
    links = tuple(sorted(set(carriers)))
    sizes = [len(mesh.vertices) for mesh in meshes]
    starts = np.concatenate(([0], np.cumsum(sizes)[:-1]))
    columns = np.repeat([links.index(carrier) for carrier in carriers], sizes)
    return Skin(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([start + mesh.faces for start, mesh in zip(starts, meshes)]),
        np.eye(len(links))[columns], links, Pose(*(part[list(links)] for part in rest)))
