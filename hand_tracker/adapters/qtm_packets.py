"""Decode frames of Qualisys Track Manager's real-time protocol, little-endian.

Only 3D markers are kept. Sizes and counts are checked against the packet's size, so that a damaged
packet ends in `MalformedFrame`. The layout is that of Qualisys' protocol 1.25 and its qtm-rt.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

import numpy as np

from .packet_structure import POINT_SIZE, PacketStructure, point_places, points_at
from .point_frame import MalformedFrame

QTM_HEADER = struct.Struct('<II')       # bytes of the packet, its kind; of a component likewise
DATA_HEADER = struct.Struct('<qII')     # time, number, count of components
QTM_ORDER = 16                          # place of number and count, which go up together
MARKERS_HEADER = struct.Struct('<Ihh')  # count of markers, lost frames, frames out of step
DATA = 3                                # kind of a packet with a frame
LARGEST_QTM_PACKET = 2**24              # [bytes] of parameters or a frame
# Bytes of a marker: position, id where it has no label, residual where that is asked for; by the
# component's kind, without residuals and with them.
LABELLED_KINDS = {1: POINT_SIZE, 9: POINT_SIZE + 4}
UNLABELLED_KINDS = {2: POINT_SIZE + 4, 10: POINT_SIZE + 8}
MILLIMETRE = .001


class QtmStructure(NamedTuple):
    """Byte layout of a QTM frame: offsets of its markers, labelled ones first.

    Attributes
    ----------
    common : PacketStructure
    places : ndarray of int, shape (n, POINT_SIZE)
        Of the positions: labelled markers, then others.
    labelled : int
        Number of labelled markers.
    """

    common: PacketStructure
    places: np.ndarray
    labelled: int


class QtmFrame(NamedTuple):
    """Frame of 3D markers.

    Attributes
    ----------
    number : int
    time : int
        Since the start of the measurement [µs].
    structure : QtmStructure
        The same object while frames are alike.
    markers, points : ndarray, shape (n, 3) and (m, 3)
        Labelled markers, in the order of their labels, and others; NaN where not seen [m].
    """

    number: int
    time: int
    structure: QtmStructure
    markers: np.ndarray
    points: np.ndarray


def qtm_frame(packet: bytes, last: QtmStructure | None = None) -> QtmFrame:
    """Decode a frame.

    Parameters
    ----------
    packet : bytes
        Of the kind `DATA`, with its header.
    last : QtmStructure, optional
        Of another frame, by which one that is alike is read sooner.

    Raises
    ------
    MalformedFrame
    """
    found = last if last is not None and last.common.matches(packet) else _structure(packet)
    time, number, _ = DATA_HEADER.unpack_from(packet, QTM_HEADER.size)
    positions = MILLIMETRE * points_at(np.frombuffer(packet, np.uint8), found.places).astype(float)
    return QtmFrame(number, time, found, positions[:found.labelled], positions[found.labelled:])


def order_of(packet: bytes) -> int:
    """Return a frame's number and count of components as one number."""
    return int.from_bytes(packet[QTM_ORDER:QTM_ORDER + 8], 'little')


def component_places(packet: bytes) -> list[tuple[int, range]]:
    """Return the kind of each component of a frame, and where its data is.

    Raises
    ------
    MalformedFrame
        Where components are not one after the other in it.
    """
    at = QTM_HEADER.size + DATA_HEADER.size
    if at > len(packet):
        raise MalformedFrame(f'QTM frame of {len(packet)} bytes; expected at least {at}')
    count = DATA_HEADER.unpack_from(packet, QTM_HEADER.size)[-1]
    places = []
    for _ in range(count):
        size, kind = (QTM_HEADER.unpack_from(packet, at) if at + QTM_HEADER.size <= len(packet)
                      else (0, 0))
        if not QTM_HEADER.size <= size <= len(packet) - at:
            raise MalformedFrame(f'QTM frame of {len(packet)} bytes, at byte {at}: expected one of '
                                 f'{count} components with its size')
        places.append((kind, range(at + QTM_HEADER.size, at + size)))
        at += size
    return places


def _structure(packet: bytes) -> QtmStructure:
    """Return the structure of a frame; raise MalformedFrame where it has none."""
    components = component_places(packet)
    mask = bytearray(len(packet))

    def decides(start: int, size: int) -> None:
        mask[start:start + size] = b'\xff' * size

    decides(QTM_HEADER.size + DATA_HEADER.size - 4, 4)
    for _, data in components:
        decides(data.start - QTM_HEADER.size, QTM_HEADER.size)
    places = dict(components)
    starts: list[list[int]] = []
    for kinds in LABELLED_KINDS, UNLABELLED_KINDS:
        kind = next(filter(places.__contains__, kinds), None)
        starts.append([])
        if kind is None:
            continue
        data, size = places[kind], kinds[kind]
        first = data.start + MARKERS_HEADER.size
        count = MARKERS_HEADER.unpack_from(packet, data.start)[0] if first <= data.stop else 1
        if first + count * size > data.stop:
            raise MalformedFrame(f'QTM frame, component {kind} of {len(data)} bytes: expected '
                                 f'{MARKERS_HEADER.size} and {count} markers of {size}')
        decides(data.start, 4)
        starts[-1] += range(first, first + count * size, size)
    labelled, others = starts
    return QtmStructure(PacketStructure(packet, bytes(mask)), point_places(labelled + others),
                        len(labelled))
