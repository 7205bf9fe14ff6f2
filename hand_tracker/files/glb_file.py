"""Write a skeleton in motion, with a skin, as a binary glTF 2.0 file (GLB)."""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ..drawing.mesh import vertex_normals
from .point_recording import RecordingError
from .skeleton_motion import SkeletonMotion

# Numbers of the specification: types of components, targets of buffers, kinds of chunks.
GL_UNSIGNED_BYTE, GL_UNSIGNED_INT, GL_FLOAT = 5121, 5125, 5126
GL_VERTICES, GL_FACES = 34962, 34963
GLB_MAGIC, GLB_JSON, GLB_BINARY = b'glTF', b'JSON', b'BIN\0'
MAX_SKIN_JOINTS = 2**8     # that the bytes of a vertex number
INFLUENCES = 4             # joints of a vertex that every viewer takes
SKIN_COLOUR = (.87, .67, .55, 1.)


class BoundMesh(NamedTuple):
    """A mesh bound to the joints of a `SkeletonMotion` in its T-pose.

    Attributes
    ----------
    vertices : ndarray, shape (V, 3)
        In the axes of the T-pose, from the wrist [m].
    faces : ndarray of int, shape (F, 3)
    joints : ndarray of int, shape (V, 4)
        Joints that move each vertex.
    weights : ndarray, shape (V, 4)
        Of these joints; each row sums to 1.
    name : str
    """

    vertices: np.ndarray
    faces: np.ndarray
    joints: np.ndarray
    weights: np.ndarray
    name: str = 'skin'


def strongest_influences(weights: np.ndarray, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the strongest joints of each vertex and their weights, both (V, 4).

    Parameters
    ----------
    weights : ndarray, shape (V, B)
    joints : ndarray of int, shape (B,)
        Joint of each column.

    Returns
    -------
    joints : ndarray of int
    weights : ndarray
        Each row sums to 1.
    """
    order = np.argsort(-weights, axis=1)[:, :INFLUENCES]
    strongest = np.take_along_axis(weights, order, axis=1)
    return joints[order], strongest / strongest.sum(axis=1, keepdims=True)


def rigid_mesh(vertices: np.ndarray, faces: np.ndarray, joint: int) -> BoundMesh:
    """Return a mesh that one joint alone moves."""
    weights = np.zeros((len(vertices), INFLUENCES))
    weights[:, 0] = 1.
    joints = np.zeros((len(vertices), INFLUENCES), dtype=int)
    joints[:, 0] = joint
    return BoundMesh(vertices, faces, joints, weights)


def joined_meshes(meshes: Sequence[BoundMesh]) -> BoundMesh:
    """Return meshes on one skeleton as one."""
    first = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    return BoundMesh(np.concatenate([mesh.vertices for mesh in meshes]),
                     np.concatenate([mesh.faces + n for mesh, n in zip(meshes, first)]),
                     np.concatenate([mesh.joints for mesh in meshes]),
                     np.concatenate([mesh.weights for mesh in meshes]))


class _Buffer:
    """Collect the binary chunk and its accessors."""

    def __init__(self) -> None:
        self.data = bytearray()
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []

    def add(self, values: np.ndarray, kind: str, target: int | None = None,
            bounds: bool = False) -> int:
        """Add an array of a glTF type ('SCALAR', 'VEC3', ...); return its accessor."""
        component = {'f': GL_FLOAT, 'I': GL_UNSIGNED_INT, 'B': GL_UNSIGNED_BYTE}[values.dtype.char]
        self.data += bytes(-len(self.data) % 4)
        view = {'buffer': 0, 'byteOffset': len(self.data), 'byteLength': values.nbytes}
        self.views.append(view | ({'target': target} if target else {}))
        accessor = {'bufferView': len(self.views) - 1, 'componentType': component,
                    'count': len(values), 'type': kind}
        if bounds:
            columns = values.reshape(len(values), -1)
            accessor |= {'min': columns.min(axis=0).tolist(), 'max': columns.max(axis=0).tolist()}
        self.accessors.append(accessor)
        self.data += values.tobytes()
        return len(self.accessors) - 1


def write_glb(path: Path, motion: SkeletonMotion, *meshes: BoundMesh) -> None:
    """Write a skeleton's motion, and the skins that follow it: metres, y up.

    Parameters
    ----------
    path : Path
    motion : SkeletonMotion
    *meshes : BoundMesh
        Each is an object of its own.

    Raises
    ------
    RecordingError
        If there is a skin on more than `MAX_SKIN_JOINTS` joints.
    """
    count = len(motion.names)
    if meshes and count > MAX_SKIN_JOINTS:
        raise RecordingError(f'{path}: a skin on {count} joints; expected {MAX_SKIN_JOINTS} at '
                             'most')
    buffer = _Buffer()
    nodes: list[dict[str, Any]] = [
        {'name': name, 'translation': offset.tolist()}
        for name, offset in zip(motion.names, motion.offsets)]
    for end, offset in motion.ends.items():
        nodes[end]['children'] = [len(nodes)]
        nodes.append({'name': f'{motion.names[end]}_end', 'translation': offset.tolist()})
    for joint, parent in enumerate(motion.parents):
        if parent >= 0:
            nodes[parent].setdefault('children', []).append(joint)
    roots = [0]
    document: dict[str, Any] = {
        'asset': {'version': '2.0', 'generator': 'hand_tracker'}, 'scene': 0,
        'scenes': [{'nodes': roots}], 'nodes': nodes,
        'animations': [_animation(motion, buffer)]}
    if meshes:
        for number, mesh in enumerate(meshes):
            roots.append(len(nodes))
            nodes.append({'name': mesh.name, 'mesh': number, 'skin': 0})
        inverse = np.tile(np.eye(4, dtype=np.float32), (count, 1, 1))
        inverse[:, 3, :3] = -motion.origins    # by columns, as glTF has matrices
        document['skins'] = [{'joints': list(range(count)), 'skeleton': 0,
                              'inverseBindMatrices': buffer.add(
                                  inverse.reshape(count, 16), 'MAT4')}]
        document['meshes'] = [{'name': mesh.name, 'primitives': [_primitive(mesh, buffer)]}
                              for mesh in meshes]
        document['materials'] = [{'name': 'skin', 'pbrMetallicRoughness': {
            'baseColorFactor': list(SKIN_COLOUR), 'metallicFactor': 0., 'roughnessFactor': .7}}]
    document |= {'buffers': [{'byteLength': len(buffer.data)}], 'bufferViews': buffer.views,
                 'accessors': buffer.accessors}
    text = json.dumps(document, separators=(',', ':')).encode()
    text += b' ' * (-len(text) % 4)
    binary = bytes(buffer.data) + bytes(-len(buffer.data) % 4)
    with open(path, 'wb') as file:
        file.write(GLB_MAGIC + struct.pack('<2I', 2, 12 + 8 + len(text) + 8 + len(binary)))
        for kind, chunk in ((GLB_JSON, text), (GLB_BINARY, binary)):
            file.write(struct.pack('<I', len(chunk)) + kind + chunk)


def _animation(motion: SkeletonMotion, buffer: _Buffer) -> dict[str, Any]:
    times = buffer.add(motion.times.astype(np.float32), 'SCALAR', bounds=True)
    channels: list[dict[str, Any]] = []
    samplers: list[dict[str, Any]] = []

    def add(joint: int, what: str, values: np.ndarray, kind: str) -> None:
        samplers.append({'input': times, 'output': buffer.add(
            np.ascontiguousarray(values, dtype=np.float32), kind), 'interpolation': 'LINEAR'})
        channels.append({'sampler': len(samplers) - 1, 'target': {'node': joint, 'path': what}})

    for joint, places in {0: motion.root_position, **motion.translations}.items():
        add(joint, 'translation', places, 'VEC3')
    for joint in range(len(motion.names)):
        add(joint, 'rotation', motion.rotation[:, joint], 'VEC4')
    return {'name': 'tracked', 'channels': channels, 'samplers': samplers}


def _primitive(mesh: BoundMesh, buffer: _Buffer) -> dict[str, Any]:
    vertices = mesh.vertices.astype(np.float32)
    return {'material': 0, 'indices': buffer.add(
        mesh.faces.astype(np.uint32).ravel(), 'SCALAR', GL_FACES), 'attributes': {
        'POSITION': buffer.add(vertices, 'VEC3', GL_VERTICES, bounds=True),
        'NORMAL': buffer.add(
            vertex_normals(mesh.vertices, mesh.faces).astype(np.float32), 'VEC3', GL_VERTICES),
        'JOINTS_0': buffer.add(mesh.joints.astype(np.uint8), 'VEC4', GL_VERTICES),
        'WEIGHTS_0': buffer.add(mesh.weights.astype(np.float32), 'VEC4', GL_VERTICES)}}
