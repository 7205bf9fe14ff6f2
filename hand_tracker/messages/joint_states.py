"""Read serialized JointStates: the names once, the numbers of every frame.

Names hardly ever change from one message to the next, and building objects of them costs more than
retargeting a frame. The encoding is plain CDR (XCDR1), as in `cdr`; damaged bytes are refused.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from .cdr import ENCAPSULATION, LITTLE_ENDIAN, MalformedMessage
from .stamps import Stamp

STAMP_END = ENCAPSULATION + 8  # [bytes]


class JointPositions(NamedTuple):
    """Stamp, names, positions and efforts of a JointState.

    Attributes
    ----------
    stamp : Stamp
    names : sequence of str
        Of `JointStateReader` the same object as long as the names do not change.
    positions : sequence of float, shape (n,)
        As many as the message has [rad or m].
    effort : sequence of float, shape (m,)
        The same; none where the message ends before.
    """

    stamp: Stamp
    names: Sequence[str]
    positions: Sequence[float] | np.ndarray
    effort: Sequence[float] | np.ndarray


def angles_of(message: Any, names: Sequence[str]) -> np.ndarray | None:
    """Return the positions of some joints in a JointState, in the order of their names.

    Parameters
    ----------
    message : sensor_msgs.msg.JointState
    names : sequence of str

    Returns
    -------
    ndarray, shape (n,), or None
        None unless the message has a finite position of each [rad].
    """
    given = dict(zip(message.name, message.position))
    angles = np.array([given.get(name, np.nan) for name in names])
    return angles if np.isfinite(angles).all() else None


class JointStateReader:
    """Read JointStates of one publisher."""

    def __init__(self) -> None:
        # From the frame's name to the number of positions: the same bytes, the same layout.
        self._head = b''
        self._names: tuple[str, ...] = ()
        self._count = 0

    @property
    def head(self) -> bytes:
        """Bytes from the frame id to the number of positions, of the last message; empty before."""
        return self._head

    @property
    def count(self) -> int:
        """Positions of the last message."""
        return self._count

    @property
    def is_complete(self) -> bool:
        """Whether the last message has as many positions as names."""
        return self._count == len(self._names)

    def read(self, data: bytes) -> JointPositions:
        """Parse a serialized message.

        Parameters
        ----------
        data : bytes

        Raises
        ------
        MalformedMessage
            If the bytes are not those of a JointState in little-endian plain CDR.
        """
        end = STAMP_END + len(self._head)
        if not self._head or data[STAMP_END:end] != self._head or data[:2] != LITTLE_ENDIAN[:2]:
            self._parse_head(data)
            end = STAMP_END + len(self._head)
        start = end + (ENCAPSULATION - end) % 8 if self._count else end
        if len(data) < start + 8 * self._count:
            count, self._head = self._count, b''
            raise MalformedMessage(f'JointState of {len(data)} bytes: expected {count} positions')
        sec, nanosec = struct.unpack_from('<iI', data, ENCAPSULATION)
        return JointPositions(Stamp(sec, nanosec), self._names,
                              np.frombuffer(data, '<f8', self._count, start),
                              _effort(data, start + 8 * self._count))

    def _parse_head(self, data: bytes) -> None:
        """Take the names and the number of positions."""
        self._head = b''
        if data[:2] != LITTLE_ENDIAN[:2]:
            raise MalformedMessage('JointState: expected plain CDR, little-endian')
        try:
            _, at = _string(data, STAMP_END)
            count, at = _count(data, at)
            names = []
            for _ in range(count):
                name, at = _string(data, at)
                names.append(name)
            self._count, at = _count(data, at)
        except (struct.error, UnicodeDecodeError):
            raise MalformedMessage(f'JointState of {len(data)} bytes: cut off or damaged') from None
        self._names, self._head = tuple(names), bytes(data[STAMP_END:at])


def _effort(data: bytes, at: int) -> np.ndarray:
    """Return the efforts behind the velocities, which begin here."""
    try:
        for _ in range(2):
            count, at = _count(data, at)
            start = at + (ENCAPSULATION - at) % 8 if count else at
            at = start + 8 * count
        return np.frombuffer(data, '<f8', count, start)
    except (struct.error, ValueError):
        return np.zeros(0)


def _count(data: bytes, at: int) -> tuple[int, int]:
    """Return a number of four bytes, and where it ends."""
    at += (ENCAPSULATION - at) % 4
    return struct.unpack_from('<I', data, at)[0], at + 4


def _string(data: bytes, at: int) -> tuple[str, int]:
    """Return a text, and where it ends."""
    size, at = _count(data, at)
    if not 0 < size <= len(data) - at:
        raise struct.error
    return data[at:at + size - 1].decode(), at + size
