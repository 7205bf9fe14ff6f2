"""Receive frames of Qualisys Track Manager over its real-time protocol, with Qualisys' qtm-rt.

Frames have QTM's time since the start of the measurement, in microseconds of the camera system's
clock; `ClockEstimate` maps it to this machine's, less the least delay seen, which QTM does not
send: `latency` gives it where it is known.
"""

from __future__ import annotations

import asyncio
import selectors
from collections import deque
from collections.abc import Callable
from threading import Event
from time import monotonic_ns
from typing import Any

import numpy as np

from ..core.errors import HandTrackerError
from ..files.plain_xml import parse_plain_xml
from ..messages.stamps import stamp_of
from .clock_estimate import ClockEstimate, ClockLine, wall_offset
from .packet_reception import Relay, receive
from .packet_structure import PacketOrigin
from .point_frame import MalformedFrame, SourceFrame, SourceUnavailable, point_frame
from .qtm_packets import (
    DATA_HEADER,
    MILLIMETRE,
    QTM_HEADER,
    QTM_ORDER,
    QtmStructure,
    order_of,
    qtm_frame,
)

QTM_PORT = 22223
QTM_VERSION = '1.25'     # of the protocol
QTM_COMPONENTS = '3d', '3dres', '3dnolabels', '3dnolabelsres'
RETRY_TIME = 2.     # [s]
END_POLL = .05      # [s]
ANSWER_TIME = 5.    # [s]
QTM_SILENCE = 5 * 10**9     # [ns] without a frame before that is said


class QualisysClient:
    """Client of one QTM.

    Parameters
    ----------
    server : str
        Address or host name.
    on_frame, on_news : callable
        As of `NatNetClient`.
    components : tuple of str, optional
        Some of `QTM_COMPONENTS`: named markers, anonymous points, each with or without residuals.
    latency : float, optional
        Least time from exposure to receipt [s].
    port : int, optional
        Of the little-endian protocol.

    Raises
    ------
    SourceUnavailable
        If qtm-rt is not installed, or a component is none of these.

    Attributes
    ----------
    relay, up
        As of `NatNetClient`.
    """

    relay: Relay | None = None
    up = 'z'

    def __init__(self, server: str, on_frame: Callable[[SourceFrame], None],
                 on_news: Callable[[bool, str], None],
                 components: tuple[str, ...] = ('3d', '3dnolabels'), latency: float = 0.,
                 port: int = QTM_PORT) -> None:
        try:
            import qtm_rt

            from .qtm_protocol import CheckedQtmProtocol
        except ImportError:
            raise SourceUnavailable('Qualisys needs the package qtm-rt: pip install qtm-rt'
                                    ) from None
        if not components or not set(components) <= set(QTM_COMPONENTS):
            raise SourceUnavailable(f"Qualisys: components {' '.join(components)!r}; expected some "
                                    f"of {' '.join(QTM_COMPONENTS)}")
        self._qtm, self._protocol = qtm_rt, CheckedQtmProtocol
        self._server, self._port, self._components = server, port, components
        self._on_frame, self._on_news, self._latency = on_frame, on_news, latency
        self._clock = ClockEstimate()
        self._names: tuple[str, ...] = ()
        self._structure: QtmStructure | None = None   # of the last frame
        self._last = self._order = -1
        self._is_logged = self._has_told_damage = False

    def run(self, ended: Event) -> None:
        """Receive until `ended` is set, also from a QTM that is started later or anew."""
        asyncio.run(self._run(ended))

    async def _run(self, ended: Event) -> None:
        # A packet that qtm-rt cannot read ends the connection, which is logged as such.
        asyncio.get_running_loop().set_exception_handler(lambda loop, context: None)
        while not ended.is_set():
            await self._serve(ended)
            for _ in range(round(RETRY_TIME / END_POLL)):
                if not ended.is_set():
                    await asyncio.sleep(END_POLL)

    async def _serve(self, ended: Event) -> None:
        """Receive until the connection ends."""
        reason = 'the connection has ended'
        connection = None
        try:
            protocol = await asyncio.wait_for(self._connect(), ANSWER_TIME)
            connection = self._qtm.QRTConnection(protocol, timeout=ANSWER_TIME)
            xml = await connection.get_parameters(['3d'])
            if not isinstance(xml, bytes):
                raise OSError('it answers with a frame where its parameters are asked for')
            parameters = xml.decode(errors='replace')
            self._names = marker_labels(parameters)
            self.up = upward_axis(parameters).removeprefix('+').lower() or 'z'
            self._clock.reset()
            self._last, self._structure = -1, None
            packets: deque[bytes] = deque()
            await connection.stream_frames(
                components=list(self._components), on_packet=packets.append)
            self._on_news(False, f'QTM on {self._server} streams {", ".join(self._components)}, '
                                 f'{len(self._names)} named markers'
                                 + (f', {self.up} up' if self.up != 'z' else ''))
            self._is_logged = self._has_told_damage = False
            self._receive(protocol, packets, ended)
        except (OSError, asyncio.TimeoutError, HandTrackerError,
                self._qtm.QRTCommandException) as error:
            reason = str(error) or 'it does not answer'
        finally:
            if connection is not None and connection.has_transport():
                connection.disconnect()
        if not ended.is_set() and not self._is_logged:
            self._is_logged = True
            self._on_news(True, f'QTM on {self._server}:{self._port}: {reason}; trying again every '
                                f'{RETRY_TIME:g} s. Is QTM measuring, with real-time output on?')

    def _receive(self, protocol: Any, packets: deque[bytes], ended: Event) -> None:
        """Receive frames until the connection ends, without asyncio, which takes longer.

        Parameters
        ----------
        protocol : CheckedQtmProtocol
        packets : deque of bytes
            To which it appends frames.
        ended : threading.Event
        """
        if protocol.transport is None:
            return
        protocol.transport.pause_reading()
        connection = protocol.transport.get_extra_info('socket').fileno()
        fault: Exception | None = None
        heard, is_quiet = monotonic_ns(), False
        with selectors.DefaultSelector() as selector:
            selector.register(connection, selectors.EVENT_READ)
            while not ended.is_set():
                while packets:
                    self.take(packets.popleft())
                if fault is not None:
                    raise OSError(f'the connection has ended: {fault}') from fault
                # Without a structure, of another connection, what is relayed has the old names.
                relay = (self.relay if protocol.is_between_packets
                         and self._structure is not None else None)
                for data, received, is_relayed in receive(
                        selector, END_POLL, relay, is_stream=True):
                    heard, is_quiet = received, False
                    if not data:
                        return
                    try:
                        if not is_relayed:
                            protocol.data_received(data)
                    except Exception as error:
                        fault = error
                if not is_quiet and monotonic_ns() - heard > QTM_SILENCE:
                    is_quiet = True
                    self._on_news(True, f'QTM on {self._server} is connected, but no frame came '
                                  f'for {1e-9 * QTM_SILENCE:g} s: is it measuring?')

    async def _connect(self) -> Any:
        """Return a connection's protocol, as qtm_rt.connect does, but of checked packets."""
        loop = asyncio.get_running_loop()
        _, protocol = await loop.create_connection(
            lambda: self._protocol(loop=loop),
            self._server, self._port)
        try:
            await protocol.set_version(QTM_VERSION)
        except BaseException:
            protocol.transport.close()
            raise
        return protocol

    def take(self, packet: bytes) -> None:
        """Take a packet with a frame as it arrives."""
        received = monotonic_ns()
        try:
            frame = qtm_frame(packet, self._structure)
        except MalformedFrame as error:
            if not self._has_told_damage:
                self._has_told_damage = True
                self._on_news(True, f'left out is a damaged frame of QTM: {error}')
            return
        self._structure = frame.structure
        # QTM's frames come in order over TCP; one that is older begins another measurement.
        if frame.number == self._last:
            return
        if frame.number < self._last:
            self._clock.reset()
        self._last, self._order = frame.number, order_of(packet)
        exposed = 1e-6 * frame.time
        self._clock.received(exposed, 1e-9 * received - self._latency)
        stamp = stamp_of(round(1e9 * self._clock.local(exposed)) + wall_offset())
        names, markers, points = self._names, frame.markers, frame.points
        if len(markers) != len(names):
            # Markers that QTM has no name for are anonymous.
            points = np.concatenate((markers[len(names):], points))
            names, markers = names[:len(markers)], markers[:len(names)]
        found = point_frame(stamp, '', names, markers, points)
        self._on_frame(found._replace(origin=self._origin(frame.structure, len(names))))

    def _origin(self, structure: QtmStructure, named: int) -> PacketOrigin:
        """Return the offsets of a frame's numbers in its packet."""
        places = structure.places[:, 0]
        return PacketOrigin(
            structure.common, places[:named], places[named:], MILLIMETRE * np.eye(3), QTM_ORDER,
            QTM_HEADER.size, 1e-6, self._now, self._follow)

    def _now(self) -> tuple[int, ClockLine, int]:
        return self._order, self._clock.line, wall_offset()

    def _follow(self, packet: bytes, received: int) -> None:
        """Note a frame that was relayed."""
        time, self._last, _ = DATA_HEADER.unpack_from(packet, QTM_HEADER.size)
        self._order = order_of(packet)
        self._clock.received(1e-6 * time, 1e-9 * received - self._latency)


def marker_labels(xml: str) -> tuple[str, ...]:
    """Return the names of the labelled markers, in the order of QTM's 3D data.

    Parameters
    ----------
    xml : str
        QTM's parameters of 3D.

    Raises
    ------
    NotPlainXml
    """
    return tuple(label.findtext('Name', '').strip()
                 for label in parse_plain_xml(xml).iter('Label'))


def upward_axis(xml: str) -> str:
    """Return the upward axis of QTM's parameters of 3D, such as '+Z'; empty where it is not said.

    Raises
    ------
    NotPlainXml
    """
    return next((axis.text or '' for axis in parse_plain_xml(xml).iter('AxisUpwards')), '').strip()

