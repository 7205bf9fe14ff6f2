"""Stamps: a time of a message, and where serialized messages have theirs."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable
from typing import NamedTuple, Protocol

from ..core.numerics.jit import jit


class Time(Protocol):
    """A time of a message: a `Stamp`, or a builtin_interfaces/msg/Time of rclpy or rosbags."""

    @property
    def sec(self) -> int: ...

    @property
    def nanosec(self) -> int: ...


class Stamp(NamedTuple):
    """A time, with the fields of builtin_interfaces/msg/Time."""

    sec: int
    nanosec: int


NO_STAMP = Stamp(0, -1)  # that no message has
UNSTAMPED = 0            # [s] and [ns] of a stamp of a driver without a clock


@jit
def stamp_time(sec: int, nanosec: int) -> float:
    """Return a stamp as one number [s]; NaN for one that is unset."""
    return math.nan if sec == UNSTAMPED and nanosec == UNSTAMPED else sec + 1e-9 * nanosec


@jit
def is_repeated(sec: int, nanosec: int, last_sec: int, last_nanosec: int) -> bool:
    """Return whether a stamp is the last one again.

    Listeners of TF refuse a second transform of one stamp, each with a warning: a frame with a
    repeated stamp has none on /tf, on both paths.
    """
    return sec == last_sec and nanosec == last_nanosec


@jit
def stands_still(stamp: int, last: int) -> bool:
    """Return whether a stamp that is set is the last one again, as of a sender that hangs [ns]."""
    return stamp == last and stamp != UNSTAMPED


def seconds(stamp: Time) -> float | None:
    """Return a stamp as one number, None for one that is unset.

    Parameters
    ----------
    stamp : Time or Stamp

    Returns
    -------
    float or None
        [s]
    """
    time = stamp_time(stamp.sec, stamp.nanosec)
    return None if math.isnan(time) else time


def stamp_of(nanoseconds: int) -> Stamp:
    """Return a time in nanoseconds as a stamp."""
    return Stamp(*divmod(nanoseconds, 10**9))


def nanoseconds(stamp: Time) -> int:
    """Return a stamp in nanoseconds."""
    return stamp.sec * 10**9 + stamp.nanosec


def header_stamp(data: bytes) -> tuple[int, ...]:
    """Return the byte offset of the stamp in a message whose first field is a std_msgs/Header.

    Parameters
    ----------
    data : bytes
        The message in CDR.

    Returns
    -------
    tuple of int
    """
    return (4,)


def marker_stamps(data: bytes) -> tuple[int, ...]:
    """Return the byte offsets of the stamps of a MarkerArray.

    Parameters
    ----------
    data : bytes
        The visualization_msgs/msg/MarkerArray in CDR.

    Returns
    -------
    tuple of int
        One for each marker.

    Raises
    ------
    struct.error
        If the bytes end before the message does.
    """
    number = struct.Struct(_order(data) + 'I').unpack_from

    def after(at: int, size: int = 1) -> int:
        """Return the end of the string or sequence that begins at or after `at`."""
        at = at + 3 & ~3
        count, at = number(data, at)[0], at + 4
        if size == 24 and count:
            at = (at + 3 & ~7) + 4
        return at + count * size

    stamps = []
    at = 8
    for _ in range(number(data, 4)[0]):
        at = at + 3 & ~3
        stamps.append(at)
        at = after(after(at + 8))           # header, ns
        at = (at + 3 & ~3) + 12             # id, type, action
        at = (at + 3 & ~7) + 4              # doubles are aligned after the 4 bytes of preamble
        at += 56 + 24 + 16 + 8 + 1          # pose, scale, color, lifetime, frame_locked
        at = after(after(at, 24), 16)       # points, colors
        at = after(at)                      # texture_resource
        at = (at + 3 & ~3) + 8
        at = after(after(after(at)))        # texture: frame_id, format, data
        at = after(at, 8)                   # uv_coordinates
        at = after(after(at))               # text, mesh_resource
        at = after(after(at)) + 1           # mesh_file, mesh_use_embedded_materials
    return tuple(stamps)


def restamp(data: bytes, stamps: Iterable[int], time: int) -> bytes:
    """Replace the stamps of a serialized message.

    Parameters
    ----------
    data : bytes
        The message in CDR.
    stamps : iterable of int
        Byte offsets of its stamps.
    time : int
        The new stamp [ns].

    Returns
    -------
    bytes
    """
    changed = bytearray(data)
    for at in stamps:
        struct.pack_into(_order(data) + 'iI', changed, at, *stamp_of(time))
    return bytes(changed)


def _order(data: bytes) -> str:
    return '<' if data[1] & 1 else '>'
