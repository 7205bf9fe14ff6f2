"""qtm-rt's side of the protocol, behind a check of each packet's sizes.

qtm-rt follows the sizes and counts in a packet wherever they lead: a size of zero keeps it busy
for hours, a large one makes it gather gigabytes.
"""

from __future__ import annotations

from qtm_rt.protocol import QTMProtocol

from .point_frame import MalformedFrame
from .qtm_packets import DATA, LARGEST_QTM_PACKET, QTM_HEADER, component_places


class CheckedQtmProtocol(QTMProtocol):
    """Hand over whole packets whose sizes are sound; another ends the connection.

    The function set by `set_on_packet` is called with the bytes of each frame.
    """

    _waiting = b''

    @property
    def is_between_packets(self) -> bool:
        """Whether what is received next begins a packet."""
        return not self._waiting

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
            if kind == DATA and self.on_packet is not None:
                self._on_data(packet)
                continue
            if kind == DATA:
                component_places(packet)
            super().data_received(packet)
