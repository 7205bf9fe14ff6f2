"""qtm-rt's side of the protocol, behind a check of each packet's sizes.

qtm-rt follows the sizes and counts in a packet wherever they lead: a size of zero keeps it busy
for hours, a large one makes it gather gigabytes.
"""

from __future__ import annotations

import struct

from qtm_rt.protocol import QTMProtocol

from .point_frame import MalformedFrame

QTM_HEADER = struct.Struct('<II')       # bytes of the packet, its kind
DATA_HEADER = struct.Struct('<qII')     # time, number, count of components
DATA = 3                                # kind of a packet with a frame
LARGEST_QTM_PACKET = 2**24              # [bytes] of parameters or a frame


class CheckedQtmProtocol(QTMProtocol):
    """Hand over whole packets whose sizes are sound; another ends the connection."""

    _waiting = b''

    def data_received(self, data: bytes) -> None:
        """Take bytes as they arrive.

        Raises
        ------
        MalformedFrame
            If a packet's sizes contradict each other.
        """
        self._waiting += data
        while len(self._waiting) >= QTM_HEADER.size:
            size, kind = QTM_HEADER.unpack_from(self._waiting)
            if not QTM_HEADER.size <= size <= LARGEST_QTM_PACKET:
                raise MalformedFrame(f'QTM packet of {size} bytes; expected {QTM_HEADER.size} to '
                                     f'{LARGEST_QTM_PACKET}')
            if len(self._waiting) < size:
                return
            packet, self._waiting = self._waiting[:size], self._waiting[size:]
            if kind == DATA:
                _check_components(packet)
            super().data_received(packet)


def _check_components(packet: bytes) -> None:
    """Raise `MalformedFrame` where the components of a frame are not in it, one after the other."""
    at = QTM_HEADER.size + DATA_HEADER.size
    if at > len(packet):
        raise MalformedFrame(f'QTM frame of {len(packet)} bytes; expected at least {at}')
    count = DATA_HEADER.unpack_from(packet, QTM_HEADER.size)[-1]
    for _ in range(count):
        size = QTM_HEADER.unpack_from(packet, at)[0] if at + QTM_HEADER.size <= len(packet) else 0
        if not QTM_HEADER.size <= size <= len(packet) - at:
            raise MalformedFrame(f'QTM frame of {len(packet)} bytes, at byte {at}: expected one of '
                                 f'{count} components with its size')
        at += size
