"""Serialized messages of which only stamps and numbers change: templates in plain CDR (XCDR1)."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..core.model.hand import LINKS
from ..core.model.kinematics import JointTable
from ..core.numerics.jit import jit
from ..core.numerics.quaternion import write_transforms
from ..core.tracker import HandState
from .cdr import ENCAPSULATION, LITTLE_ENDIAN
from .marker_array import ADD, SPHERE, TRIANGLE_LIST
from .stamps import Time, stamp_of

# Messages that answer a frame, by number
JOINT_STATES, TRANSFORMS, ANGLE_DEVIATIONS = range(3)
REPLIES = 3
ALL_TRANSFORMS = 1 + len(LINKS)  # the wrist, and the links in their parents
SPHERE_DIAMETER = .01            # [m] of a marker


@jit
def fill_template(words: np.ndarray, doubles: np.ndarray, stamps: np.ndarray,
                  numbers_at: np.ndarray, sec: int, nanosec: int, numbers: np.ndarray) -> None:
    """Write a stamp and the numbers into a template.

    Parameters
    ----------
    words, doubles : ndarray of uint32 and of float
        The template by four and by eight bytes; changed.
    stamps : ndarray of int, shape (m,)
        Where its stamps are in `words`.
    numbers_at : ndarray of int, shape (n,)
        Where its numbers are in `doubles`.
    sec, nanosec : int
    numbers : ndarray, shape (>= n,)
    """
    for i in range(len(stamps)):
        words[stamps[i]] = sec & 0xffffffff
        words[stamps[i] + 1] = nanosec & 0xffffffff
    for i in range(len(numbers_at)):
        doubles[numbers_at[i]] = numbers[i]


class Template:
    """A serialized message of which only stamps and numbers change.

    Parameters
    ----------
    data : bytes
        The message.
    stamps, numbers : sequence of int
        Byte offsets of its stamps and numbers.

    Attributes
    ----------
    body : ndarray
        The message after half a double, so that all behind its encapsulation is aligned.
    size : int
        Of the message [bytes].
    stamps, numbers : ndarray of int
        Where they are in the body, by four and by eight bytes.
    """

    def __init__(self, data: bytes, stamps: Sequence[int], numbers: Sequence[int]) -> None:
        self.body = np.zeros(-(-len(data) // 8) + 1)
        self.size = len(data)
        self.stamps = (np.array(stamps, np.int64) + ENCAPSULATION) // 4
        self.numbers = (np.array(numbers, np.int64) + ENCAPSULATION) // 8
        self._data = self.body.view(np.uint8)[ENCAPSULATION:][:self.size]
        self._data[:] = np.frombuffer(data, np.uint8)
        self._words = self.body.view(np.uint32)

    def fill(self, stamp: Time, numbers: ArrayLike) -> bytes:
        """Return the message with a stamp and with numbers.

        Parameters
        ----------
        stamp : Stamp or Time
        numbers : ndarray, n of any shape

        Returns
        -------
        bytes
        """
        fill_template(self._words, self.body, self.stamps, self.numbers, stamp.sec,
                      stamp.nanosec, np.ravel(np.asarray(numbers, dtype=float)))
        return self._data.tobytes()


class _Writer:
    """Write plain CDR, and note where the stamps and the numbers are."""

    def __init__(self) -> None:
        self._data = bytearray(LITTLE_ENDIAN)
        self._stamps: list[int] = []
        self._numbers: list[int] = []

    def _align(self, to: int) -> None:
        self._data += bytes(-(len(self._data) - ENCAPSULATION) % to)

    def count(self, number: int) -> None:
        """Write the length of a string or of a sequence."""
        self.pack('I', number)

    def pack(self, form: str, *values: Any) -> None:
        """Write values of one size, in a form of `struct`."""
        self._align(struct.calcsize(form[-1]))
        self._data += struct.pack(f'<{form}', *values)

    def string(self, text: str) -> None:
        """Write a string."""
        octets = text.encode() + b'\0'
        self.count(len(octets))
        self._data += octets

    def header(self, frame_id: str) -> None:
        """Write a Header, and note its stamp."""
        self._align(4)
        self._stamps.append(len(self._data))
        self._data += bytes(8)
        self.string(frame_id)

    def numbers(self, count: int) -> None:
        """Write so many doubles, and note them."""
        self._align(8)
        self._numbers += range(len(self._data), len(self._data) + 8 * count, 8)
        self._data += bytes(8 * count)

    def end_of_marker(self) -> None:
        """Write a Marker's fields behind its points, all empty."""
        self.count(0)               # colours
        self.string('')             # texture
        self.pack('2i', 0, 0)
        self.string('')
        self.string('')
        self.count(0)
        self.count(0)               # its coordinates
        for _ in range(3):          # text, mesh and its file
            self.string('')
        self.count(0)
        self.pack('?', False)

    def template(self) -> Template:
        """Return the template of what was written."""
        return Template(bytes(self._data), self._stamps, self._numbers)


def joint_state_template(names: Sequence[str], effort: Sequence[float] = ()) -> Template:
    """Return the template of a JointState with positions and, constant, `effort`.

    Parameters
    ----------
    names : sequence of str
    effort : sequence of float, optional
        One for each name, or none.

    Returns
    -------
    Template
        Of as many numbers.
    """
    writer = _Writer()
    writer.header('')
    writer.count(len(names))
    for name in names:
        writer.string(name)
    writer.count(len(names))
    writer.numbers(len(names))
    writer.count(0)             # velocities
    writer.count(len(effort))
    if len(effort):
        writer.pack(f'{len(effort)}d', *effort)
    return writer.template()


def position_array_template(count: int) -> Template:
    """Return the template of a Float64MultiArray without a layout."""
    writer = _Writer()
    writer.count(0)             # dimensions
    writer.count(0)             # offset
    writer.count(count)
    writer.numbers(count)
    return writer.template()


def joint_trajectory_template(names: Sequence[str], nanoseconds: int) -> Template:
    """Return the template of a JointTrajectory of one point, whose own stamp stays zero.

    Parameters
    ----------
    names : sequence of str
    nanoseconds : int
        Of the point, from the start.
    """
    writer = _Writer()
    writer.pack('2I', 0, 0)
    writer.string('')
    writer.count(len(names))
    for name in names:
        writer.string(name)
    writer.count(1)
    writer.count(len(names))
    writer.numbers(len(names))
    for _ in range(3):          # velocities, accelerations, effort
        writer.count(0)
    writer.pack('iI', *stamp_of(nanoseconds))
    return writer.template()


def transforms_template(frames: Sequence[tuple[str, str]]) -> Template:
    """Return the template of a TFMessage.

    Parameters
    ----------
    frames : sequence of (str, str)
        Parent and child of each transform.

    Returns
    -------
    Template
        Of seven numbers for each: x, y, z of the translation; x, y, z, w of the rotation.
    """
    writer = _Writer()
    writer.count(len(frames))
    for parent, child in frames:
        writer.header(parent)
        writer.string(child)
        writer.numbers(7)
    return writer.template()


def markers_template(frame_id: str, markers: Sequence[tuple[str, int]]) -> Template:
    """Return the template of a MarkerArray of spheres.

    Parameters
    ----------
    frame_id : str
    markers : sequence of (str, int)
        Namespace and id of each.

    Returns
    -------
    Template
        Of three numbers for each: its position.
    """
    writer = _Writer()
    writer.count(len(markers))
    for namespace, number in markers:
        writer.header(frame_id)
        writer.string(namespace)
        writer.pack('3i', number, SPHERE, ADD)
        writer.numbers(3)
        writer.pack('7d', 0., 0., 0., 1., *[SPHERE_DIAMETER] * 3)
        writer.pack('4f', 1., 1., 1., 1.)
        writer.pack('2i', 0, 0)
        writer.pack('?', False)
        writer.count(0)
        writer.end_of_marker()
    return writer.template()


def triangles_template(frame_id: str, namespace: str, colour: tuple[float, ...], lifetime: int,
                       corners: int) -> Template:
    """Return the template of a Marker of triangles that stays with its frame.

    Parameters
    ----------
    frame_id, namespace : str
    colour : tuple of float
        Red, green, blue, opacity.
    lifetime : int
        [s]
    corners : int
        Three for each triangle.

    Returns
    -------
    Template
        Of three numbers for each corner.
    """
    writer = _Writer()
    writer.header(frame_id)
    writer.string(namespace)
    writer.pack('3i', 0, TRIANGLE_LIST, ADD)
    writer.pack('10d', 0., 0., 0., 0., 0., 0., 1., 1., 1., 1.)  # pose and scale
    writer.pack('4f', *colour)
    writer.pack('2i', lifetime, 0)
    writer.pack('?', True)
    writer.count(corners)
    writer.numbers(3 * corners)
    writer.end_of_marker()
    return writer.template()


def transform_numbers(table: JointTable, state: HandState,
                      count: int = ALL_TRANSFORMS) -> np.ndarray:
    """Return the transforms of the wrist in its frame and of the links in their parents.

    Parameters
    ----------
    table : JointTable
        Of the tracked hand.
    state : HandState
    count : int, optional
        1 for the wrist alone.

    Returns
    -------
    ndarray, shape (count, 7)
        x, y, z of the translation and x, y, z, w of the rotation of each [m].
    """
    numbers = np.empty((count, 7))
    write_transforms(table.parent, *state.pose, state.wrist_rotation, state.wrist_position,
                     numbers)
    return numbers
