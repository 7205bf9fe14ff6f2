"""Read and write BVH files: a skeleton and its motion."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO, NamedTuple

import numpy as np

from .point_recording import Axes, PointBuffer, PointRecording, RecordingError, unique_labels
from .skeleton_motion import SkeletonMotion
from .text_table import TextTable, count_of, number_of, open_packed
from .written_kinds import EULER_ORDERS

BVH_START = 'HIERARCHY'
CHANNELS = tuple(f'{axis}{kind}' for kind in ('position', 'rotation') for axis in 'XYZ')
MAX_BVH_JOINTS = 4096
MAX_BVH_NUMBERS = 2**28    # of a motion that is read whole
END_SUFFIX = '_end'        # of the label of an end site, after that of its joint
CENTIMETRES = 100.         # in a metre: the unit of written files
BVH_DECIMALS = 6               # of numbers of a tracked hand


class BvhJoint(NamedTuple):
    """A joint of a hierarchy, or the end of a chain.

    Attributes
    ----------
    name : str
    parent : int
        Place of its parent, -1 of a root.
    offset : tuple of float, length 3
        From the parent, in the file's unit.
    channels : tuple of str
        Of `CHANNELS`; empty at the end of a chain.
    """

    name: str
    parent: int
    offset: tuple[float, ...]
    channels: tuple[str, ...]


class BvhMotion(NamedTuple):
    """A BVH file as it is: a hierarchy and the numbers of its channels.

    Attributes
    ----------
    joints : tuple of BvhJoint
        Depth first, as in the file.
    values : ndarray, shape (T, C)
        Of all channels, joint by joint, in the file's unit and in degrees.
    period : float
        Time between two frames [s].
    """

    joints: tuple[BvhJoint, ...]
    values: np.ndarray
    period: float


def channel_columns(joints: Sequence[BvhJoint]) -> list[slice]:
    """Return for each joint the columns of its channels."""
    ends = np.cumsum([len(joint.channels) for joint in joints])
    return [slice(int(end) - len(joint.channels), int(end)) for joint, end in zip(joints, ends)]


def read_bvh(path: Path, file: IO[bytes], zero_is_missing: bool = True,
             partial: bool = False) -> tuple[PointRecording, Axes]:
    """Read a BVH file: the places of its joints, and of the ends of its chains, over time.

    Parameters
    ----------
    path : Path
        For messages.
    file : binary file
    zero_is_missing : bool
        Not used: a joint may be at the origin.
    partial : bool
        See `ReadingOptions`.

    Returns
    -------
    PointRecording
        Its points as in the file, y up in an unknown unit.
    Axes

    Raises
    ------
    RecordingError
    """
    del zero_is_missing
    frames = _BvhFrames(path, file)
    joints = frames.joints
    ends = [i for i, joint in enumerate(joints) if not joint.channels]
    # The end of a chain that has no length of its own says nothing.
    shown = [i for i in range(len(joints)) if i not in ends or any(joints[i].offset)]
    labels, repeated = unique_labels([joints[i].name for i in shown])
    buffer = PointBuffer(path, [label or f'joint_{i}' for i, label in enumerate(labels)], False)
    for numbers in frames.blocks():
        buffer.append(joint_poses(joints, numbers)[0][:, shown])
    note = frames.cut_note(buffer.frames, partial)
    found, points = buffer.finish()
    notes = [note for note in (repeated, note) if note]
    if len(shown) < len(joints):
        notes.append(f'left out: {len(joints) - len(shown)} ends of chains without a length')
    rate = 1. / frames.period if 0. < frames.period < np.inf else np.nan
    return PointRecording(path.name, 'BVH', found, points, rate, None, Axes(), tuple(notes),
                          True), Axes(None, 'y')


def rest_size(joints: Sequence[BvhJoint]) -> float:
    """Return how large a skeleton is with no rotation, along its longest axis.

    Parameters
    ----------
    joints : sequence of BvhJoint

    Returns
    -------
    float
        More than zero, in the file's unit.
    """
    places = np.zeros((len(joints), 3))
    for i, joint in enumerate(joints):
        if joint.parent >= 0:
            places[i] = places[joint.parent] + joint.offset
    return max(float(np.ptp(places, axis=0).max()), 1e-9)


def read_bvh_joints(path: Path) -> Sequence[BvhJoint]:
    """Return the joints of a BVH file.

    Parameters
    ----------
    path : Path
        Also gzipped.

    Raises
    ------
    RecordingError
        If it is no BVH file.
    """
    with open_packed(path) as file:
        return _BvhFrames(path, file).joints


def read_bvh_motion(path: Path, partial: bool = False) -> BvhMotion:
    """Read a BVH file as it is.

    Parameters
    ----------
    path : Path
        Also gzipped.
    partial : bool, optional
        See `ReadingOptions`.

    Returns
    -------
    BvhMotion

    Raises
    ------
    RecordingError
        If it is no whole BVH file, or says no time between frames.
    """
    if not path.exists():
        raise RecordingError(f'{path}: no such file; expected a BVH file')
    with open_packed(path) as file:
        frames = _BvhFrames(path, file)
        columns = sum(len(joint.channels) for joint in frames.joints)
        blocks, count = [np.empty((0, columns))], 0
        for numbers in frames.blocks():
            blocks.append(numbers)
            count += len(numbers)
            if count * columns > MAX_BVH_NUMBERS:
                raise RecordingError(f'{path}: more than {MAX_BVH_NUMBERS} numbers; expected a '
                                     'shorter motion')
        frames.cut_note(count, partial)
        if not count or not 0. < frames.period < np.inf:
            raise RecordingError(f'{path}: {count} frames, {frames.period} s apart; expected a '
                                 'motion with a frame time')
    return BvhMotion(tuple(frames.joints), np.concatenate(blocks), frames.period)


class _BvhFrames:
    """A file's hierarchy and timing, read at once, and its frames, read in blocks."""

    def __init__(self, path: Path, file: IO[bytes]) -> None:
        self._table = TextTable(path, file)
        self.joints = _read_hierarchy(self._table)
        self._expected, self.period = _read_timing(self._table)

    def blocks(self) -> Iterator[np.ndarray]:
        """Yield the numbers of some frames at once, shape (n, C)."""
        columns = sum(len(joint.channels) for joint in self.joints)
        for rows in self._table.numbers(' ', columns):
            if not np.isfinite(rows.numbers).all():
                raise self._table.fault(f'a frame without all of its {columns} numbers',
                                        rows.first_line)
            yield rows.numbers

    def cut_note(self, frames: int, partial: bool) -> str:
        """Return a note on a file that is cut, empty for a whole one; raise unless `partial`."""
        if not self._table.is_cut and frames >= self._expected:
            return self._table.doubt
        note = f'cut: {frames} whole frames of {self._expected}'
        if not partial or not frames:
            raise self._table.fault(f'{note}; expected a whole file' + (
                ' (--partial reads what is there)' if frames else ''))
        return note


def _read_hierarchy(table: TextTable) -> list[BvhJoint]:
    """Read the joints up to the line MOTION, each after its parent."""
    joints: list[BvhJoint] = []
    opened: list[int] = []       # joints whose braces are open
    begun: tuple[str, int] | None = None
    while True:
        line = table.text_line()
        if line is None:
            raise table.fault('the file ends in its hierarchy; expected MOTION')
        words = line.split()
        if not words or words == [BVH_START]:
            continue
        key = words[0].upper()
        if key == 'MOTION':
            break
        if key in ('ROOT', 'JOINT', 'END'):
            parent = opened[-1] if opened else -1
            if key == 'END':
                begun = (joints[parent].name if opened else '') + END_SUFFIX, parent
            else:
                begun = ' '.join(words[1:]) or f'joint_{len(joints)}', parent
            if line.rstrip().endswith('{'):
                begun, key = (begun[0].removesuffix('{').strip(), parent), '{'
        if key == '{':
            if begun is None or len(joints) >= MAX_BVH_JOINTS:
                raise table.fault('a brace without a joint' if begun is None else
                                  f'more than {MAX_BVH_JOINTS} joints')
            opened.append(len(joints))
            joints.append(BvhJoint(begun[0], begun[1], (0., 0., 0.), ()))
            begun = None
        elif key == '}':
            if not opened:
                raise table.fault('a closing brace without an open one')
            opened.pop()
        elif key in ('OFFSET', 'CHANNELS'):
            if not opened:
                raise table.fault(f'{key} outside of a joint')
            joints[opened[-1]] = _with_line(table, joints[opened[-1]], key, words[1:])
        elif key not in ('ROOT', 'JOINT', 'END'):
            raise table.fault(f'{words[0][:24]!r}; expected JOINT, End Site, OFFSET, CHANNELS or '
                              'MOTION')
    if opened or not any(joint.channels for joint in joints):
        raise table.fault('a hierarchy that is not whole in front of MOTION')
    return joints


def _with_line(table: TextTable, joint: BvhJoint, key: str, words: list[str]) -> BvhJoint:
    if key == 'OFFSET':
        offset = tuple(number_of(word) for word in words[:3])
        if len(offset) < 3 or not np.isfinite(offset).all():
            raise table.fault(f'OFFSET {" ".join(words[:3])}; expected three numbers')
        return joint._replace(offset=offset)
    names = tuple(word[:1].upper() + word[1:].lower() for word in words[1:])
    if (not words or count_of(words[0]) not in (None, len(names)) or len(names) > 6
            or len(set(names)) < len(names) or set(names) - set(CHANNELS)):
        raise table.fault(f'CHANNELS {" ".join(words)[:60]}; expected their number and names as '
                          'Xposition, Zrotation')
    return joint._replace(channels=names)


def _read_timing(table: TextTable) -> tuple[int, float]:
    """Return the number of frames, and the time between two, NaN where it is not given [s]."""
    frames, period = 0, np.nan
    for key in ('frames', 'frame time'):
        line = table.text_line()
        name, _, value = (line or '').partition(':')
        if name.strip().lower() != key:
            raise table.fault(f'{(line or "the end")[:40]!r}; expected {key.title()}: and a number')
        if key == 'frames':
            count = count_of(value)
            if count is None:
                raise table.fault(f'{line!r}; expected Frames: and a number from 1 on')
            frames = count
        else:
            period = number_of(value)
    return frames, period


def joint_poses(joints: Sequence[BvhJoint], numbers: np.ndarray
                ) -> tuple[np.ndarray, list[np.ndarray]]:
    """Return the places and rotations of joints by the numbers of their channels.

    Parameters
    ----------
    joints : sequence of BvhJoint, length J
        Parents first.
    numbers : ndarray, shape (T, C)

    Returns
    -------
    positions : ndarray, shape (T, J, 3)
    rotations : list of ndarray, shape (T, 3, 3)
        Of each joint's axes in the world; that of its parent for one without channels.
    """
    frames = len(numbers)
    rotations: list[np.ndarray] = []
    positions = np.empty((frames, len(joints), 3))
    upright = np.broadcast_to(np.eye(3), (frames, 3, 3))
    column = 0
    for i, joint in enumerate(joints):
        local = np.broadcast_to(np.array(joint.offset), (frames, 3))
        turn = None
        for channel in joint.channels:
            value = numbers[:, column]
            column += 1
            axis = 'XYZ'.index(channel[0])
            if channel.endswith('position'):
                # Positions stand for the offset, they are not added to it.
                local = local.copy()
                local[:, axis] = value
            else:
                one = _axis_rotations(axis, np.radians(value))
                turn = one if turn is None else turn @ one
        above = upright
        if joint.parent < 0:
            positions[:, i] = local
        else:
            above = rotations[joint.parent]
            positions[:, i] = positions[:, joint.parent] + np.einsum('tij,tj->ti', above, local)
        rotations.append(above if turn is None else above @ turn)
    return positions, rotations


def _axis_rotations(axis: int, angles: np.ndarray) -> np.ndarray:
    """Return rotations about a coordinate axis, shape (T, 3, 3), by angles (T,) [rad]."""
    rotations = np.zeros((len(angles), 3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    cosine, sine = np.cos(angles), np.sin(angles)
    rotations[:, axis, axis] = 1.
    rotations[:, i, i] = rotations[:, j, j] = cosine
    rotations[:, j, i], rotations[:, i, j] = sine, -sine
    return rotations


def write_bvh(path: Path, motion: SkeletonMotion, order: str = EULER_ORDERS[0]) -> None:
    """Write a skeleton's motion: centimetres, y up, degrees.

    Parameters
    ----------
    path : Path
    motion : SkeletonMotion
    order : str, optional
        Of the Euler angles, one of `EULER_ORDERS`.

    Raises
    ------
    RecordingError
        If the order is another.
    """
    if order not in EULER_ORDERS:
        raise RecordingError(f'{path}: Euler order {order!r}; expected one of '
                             f'{", ".join(EULER_ORDERS)}')
    joints: list[BvhJoint] = []
    columns: list[np.ndarray] = []
    moving = {0: motion.root_position, **motion.translations}
    places: dict[int, int] = {-1: -1}    # in the file, of each joint of the motion
    for joint in depth_first(motion.parents):
        places[joint] = len(joints)
        offset = tuple((CENTIMETRES * motion.offsets[joint]).tolist())
        joints.append(BvhJoint(motion.names[joint], places[motion.parents[joint]], offset,
                               (CHANNELS[:3] if joint in moving else ())
                               + rotation_channels(order)))
        if joint in moving:
            columns.append(CENTIMETRES * moving[joint])
        columns.append(euler_degrees(motion.rotation[:, joint], order))
        if joint in motion.ends:
            end = tuple((CENTIMETRES * motion.ends[joint]).tolist())
            joints.append(BvhJoint('', places[joint], end, ()))
    rounded = [joint._replace(offset=tuple(round(x, BVH_DECIMALS) for x in joint.offset))
               for joint in joints]
    write_bvh_motion(path, BvhMotion(
        tuple(rounded), np.round(np.concatenate(columns, axis=1), BVH_DECIMALS), motion.period))


def rotation_channels(order: str) -> tuple[str, ...]:
    """Return the channels of Euler angles of an order such as 'ZXY'."""
    return tuple(f'{axis}rotation' for axis in order)


def euler_degrees(quaternions: np.ndarray, order: str) -> np.ndarray:
    """Return Euler angles that go on over frames, shape (T, 3) [degrees].

    Parameters
    ----------
    quaternions : ndarray, shape (T, 4)
        x, y, z, w.
    order : str
        One of `EULER_ORDERS`.
    """
    # Here, as importing scipy's rotations takes longer than reading a file.
    from scipy.spatial.transform import Rotation

    with warnings.catch_warnings():
        # In gimbal lock one of the angles is 0: the rotation is the same.
        warnings.simplefilter('ignore')
        angles = Rotation.from_quat(quaternions).as_euler(order)
    return np.degrees(np.unwrap(angles, axis=0))


def depth_first(parents: Sequence[int], joint: int = 0) -> list[int]:
    """Return a joint and those below it, in the order of a file."""
    found = [joint]
    for child, parent in enumerate(parents):
        if parent == joint:
            found += depth_first(parents, child)
    return found


def _written(number: float) -> str:
    """Return a number to its last bit, without exponent, with `BVH_DECIMALS` or more."""
    text = f'{number:.{BVH_DECIMALS}f}'
    return text if float(text) == number else np.format_float_positional(
        number, min_digits=BVH_DECIMALS)


def write_bvh_motion(path: Path, motion: BvhMotion) -> None:
    """Write a hierarchy and the numbers of its channels, each number to its last bit.

    None has fewer decimals than `BVH_DECIMALS`, so that a cut is known by its last number.

    Parameters
    ----------
    path : Path
    motion : BvhMotion
    """
    lines = [BVH_START]
    opened: list[int] = []
    with_children = {joint.parent for joint in motion.joints}
    for i, joint in enumerate(motion.joints):
        while opened and opened[-1] != joint.parent:
            opened.pop()
            lines.append('\t' * len(opened) + '}')
        indent = '\t' * len(opened)
        is_end = not joint.channels and i not in with_children
        kind = 'End Site' if is_end else f'{"JOINT" if opened else "ROOT"} {joint.name}'
        lines += [f'{indent}{kind}', f'{indent}{{',
                  f'{indent}\tOFFSET {" ".join(map(repr, joint.offset))}']
        if not is_end:
            lines.append(f'{indent}\tCHANNELS {len(joint.channels)} {" ".join(joint.channels)}')
        opened.append(i)
    lines += ['\t' * depth + '}' for depth in reversed(range(len(opened)))]
    lines += ['MOTION', f'Frames: {len(motion.values)}', f'Frame Time: {motion.period!r}', '']
    with open(path, 'w', encoding='utf-8', newline='') as file:
        file.write('\n'.join(lines))
        for row in motion.values:
            file.write(' '.join(map(_written, row.tolist())) + '\n')
