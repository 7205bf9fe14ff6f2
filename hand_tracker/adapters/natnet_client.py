"""Receive frames of OptiTrack's Motive over NatNet, by unicast or multicast.

Frames are stamped with the middle of their exposure, in this machine's time: `ClockEstimate` maps
the server's clock, from echoes and from each frame's time of sending.
"""

from __future__ import annotations

import selectors
import socket
import struct
import time
from collections.abc import Callable
from contextlib import ExitStack
from threading import Event

import numpy as np

from ..messages.stamps import stamp_of
from .clock_estimate import ClockEstimate, ClockLine, wall_offset
from .natnet_packets import (
    CONNECT,
    ECHO_REQUEST,
    ECHO_RESPONSE,
    FRAME,
    FRAME_TIMES,
    KEEP_ALIVE,
    MODEL,
    OCCLUDED,
    REQUEST_MODEL,
    SERVER_INFO,
    DataDescriptions,
    FramePacket,
    FrameStructure,
    ServerInfo,
    echo_response,
    frame_packet,
    message,
    message_id,
    model_definitions,
    server_info,
)
from .packet_reception import Relay, receive
from .packet_structure import NO_PLACE, PacketOrigin
from .point_frame import MalformedFrame, SourceFrame, SourceUnavailable, point_frame

COMMAND_PORT = 1510
RECEIVE_BUFFER = 2**20   # [bytes]
ASK_PERIOD = 1.          # [s] between two requests that were not answered, and to keep alive
PATIENT_REQUESTS = 3     # for the model, until the lack of an answer is logged
SILENCE = 3.             # [s] without any packet, after which the server is sought anew
ECHO_PERIOD = .1         # [s]
FIRST_ECHOES, FIRST_ECHO_PERIOD = 50, .01
POLL_TIME = .05          # [s]
OVERTAKEN = 1.           # [s] by which a frame may be older than the last; else the server is new
PING = b'Ping\0'


class NatNetClient:
    """Client of one server.

    Parameters
    ----------
    server : str
        Its address or host name.
    on_frame : callable
        Called with each `SourceFrame`, in the thread of `run`; duplicates and overtaken frames are
        left out.
    on_news : callable
        Called with (is_warning, text).
    local : str, optional
        Address of this machine's network interface; any when empty.
    port : int, optional
        Of the server's commands.

    Raises
    ------
    SourceUnavailable
        If the server's name is unknown, or this machine has no such address.

    Attributes
    ----------
    relay : Relay or None
        Receives once there was a frame of this model.
    up : str
        Upward axis of what is handed over, such as 'z' or '-y', as far as the server says it.
    """

    relay: Relay | None = None
    up = 'z'

    def __init__(self, server: str, on_frame: Callable[[SourceFrame], None],
                 on_news: Callable[[bool, str], None], local: str = '',
                 port: int = COMMAND_PORT) -> None:
        self._server, self._local, self._port = server, local, port
        self._on_frame, self._on_news = on_frame, on_news
        try:
            self._address = socket.gethostbyname(server), port
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as tried:
                tried.bind((local, 0))
        except OSError as error:
            raise SourceUnavailable(
                f"NatNet server '{server}', local address '{local}': {error}") from None
        self._clock = ClockEstimate()
        self._warned: set[str] = set()
        self._frames = 0    # that came, damaged ones too
        self._reset()

    def _reset(self) -> None:
        self._info: ServerInfo | None = None
        self._model = DataDescriptions({}, {})
        self._structure: FrameStructure | None = None   # of the last frame, with this model
        self._model_requests = 0     # that were not answered
        self._wants_model = True
        self._sent: int | None = None
        self._echoes = 0
        self._clock.reset()

    def run(self, ended: Event) -> None:
        """Receive until `ended` is set.

        Parameters
        ----------
        ended : threading.Event
        """
        while not ended.is_set():
            with ExitStack() as sockets:
                self._serve(sockets, ended)

    def _serve(self, sockets: ExitStack, ended: Event) -> None:
        """Receive until the server is silent for long."""
        selector = sockets.enter_context(selectors.DefaultSelector())
        self._commands = self._socket(sockets, selector, self._local, 0)
        self._reset()
        is_joined = False
        heard, self._asked, self._echoed = time.monotonic(), -ASK_PERIOD, 0.
        framed, frames = heard, self._frames
        while not ended.is_set():
            now = time.monotonic()
            if now - heard > SILENCE:
                self._warn_once(
                    'silence', f'nothing comes from the NatNet server {self._server} '
                    f"({self._address[0]}:{self._port}) for {SILENCE:g} s: is Motive's streaming "
                    'on, and do firewalls let UDP through?')
                return
            if self._info is None:
                framed = now
            elif self._frames != frames:
                framed, frames = now, self._frames
                self._warned.discard('frames')
            elif now - framed > SILENCE:
                group = self._info.group
                self._warn_once(
                    'frames', f'the NatNet server {self._server} answers, but no frame came for '
                    f'{SILENCE:g} s: is Motive live, not paused, and its streaming on'
                    + (f', and does multicast ({group}) reach this machine?' if group else '?'))
            self._ask(now)
            # Without a structure, of another model or server, what is relayed has the old names.
            relay = None if self._structure is None else self.relay
            for data, received, is_relayed in receive(selector, self._wait, relay):
                heard = now
                try:
                    if not is_relayed:
                        self.take(data, received)
                except MalformedFrame as error:
                    self._warn_once('malformed', f'left out is a damaged packet: {error}')
            if self._info is not None and self._info.group and not is_joined:
                is_joined = True
                self._join(sockets, selector, self._info)

    @property
    def _wait(self) -> float:
        return FIRST_ECHO_PERIOD if self._echoes < FIRST_ECHOES else POLL_TIME

    def _socket(self, sockets: ExitStack, selector: selectors.BaseSelector, address: str,
                port: int) -> socket.socket:
        made = sockets.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
        made.bind((address, port))
        selector.register(made, selectors.EVENT_READ)
        return made

    def _join(self, sockets: ExitStack, selector: selectors.BaseSelector,
              info: ServerInfo) -> None:
        """Join the multicast group of the frames."""
        joined = self._socket(sockets, selector, info.group, info.data_port)
        joined.setsockopt(
            socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP,
            socket.inet_aton(info.group) + socket.inet_aton(self._local or '0.0.0.0'))

    def _ask(self, now: float) -> None:
        """Ask for what is missing, keep the connection alive, compare the clocks."""
        if now - self._asked >= ASK_PERIOD:
            self._asked = now
            if self._info is None:
                self._send(CONNECT, PING)
            else:
                self._send(KEEP_ALIVE)
                if self._wants_model:
                    self._send(REQUEST_MODEL)
                    self._model_requests += 1
                    if self._model_requests > PATIENT_REQUESTS:
                        self._warn_once('model', f'the NatNet server {self._server} does not tell '
                                        'the names of its markers: named ones are left out')
        period = FIRST_ECHO_PERIOD if self._echoes < FIRST_ECHOES else ECHO_PERIOD
        if self._info is not None and now - self._echoed >= period:
            self._echoed = now
            self._echoes += 1
            self._send(ECHO_REQUEST, struct.pack('<Q', time.monotonic_ns()))

    def _send(self, number: int, payload: bytes = b'') -> None:
        try:
            self._commands.sendto(message(number, payload), self._address)
        except OSError as error:
            self._warn_once('send', f'NatNet server {self._server}: {error}')

    def take(self, data: bytes, received: int) -> None:
        """Take a packet, received at a time of the monotonic clock [ns].

        Raises
        ------
        MalformedFrame
        """
        number = message_id(data)
        if number == SERVER_INFO:
            info = server_info(data)
            if self._info is None:
                self._info, self._asked = info, -ASK_PERIOD
                self._warned.discard('silence')
                major, minor = info.version
                how = f'multicast {info.group}' if info.group else 'unicast'
                self._on_news(False, f'{info.name} speaks NatNet {major}.{minor}, {how}')
        elif self._info is None:
            return
        elif number == FRAME:
            self._frames += 1
            self._take_frame(frame_packet(data, self._info.version, self._structure), received)
        elif number == MODEL:
            self._model = model_definitions(data, self._info.version)
            self._structure = None
            self._wants_model, self._model_requests = False, 0
        elif number == ECHO_RESPONSE:
            sent, ticks = echo_response(data)
            if 0 <= received - sent < 1e9 * SILENCE:
                self._clock.echoed(1e-9 * sent, ticks / self._info.frequency, 1e-9 * received)

    def _take_frame(self, packet: FramePacket, received: int) -> None:
        frequency = self._frequency
        if self._sent is not None and packet.transmit <= self._sent:
            if self._sent - packet.transmit < OVERTAKEN * frequency:
                return
            self._clock.reset()
        self._sent = packet.transmit
        self._wants_model |= packet.models_changed
        self._clock.received(packet.transmit / frequency, 1e-9 * received)
        exposed = self._clock.local(packet.exposure / frequency)
        stamp = stamp_of(round(1e9 * exposed) + wall_offset())
        if packet.structure is not self._structure:
            self._arrange(packet.structure)
        self._wants_model |= not self._is_named
        points = packet.points
        if len(self._nameless):
            points = np.concatenate((points, packet.markers[self._nameless]))
        frame = point_frame(stamp, '', self._names, packet.markers[self._taken], points)
        self._on_frame(frame._replace(origin=self._origin(packet)))

    def _origin(self, packet: FramePacket) -> PacketOrigin | None:
        """Return the offsets of a frame's numbers in its packet; None while names are missing."""
        structure = packet.structure
        if len(self._nameless) or packet.models_changed:
            return None
        places, free = structure.places[:, 0], structure.free
        parameters = np.frombuffer(structure.common.data, np.uint8)[structure.parameters]
        is_hidden = parameters & OCCLUDED > 0
        in_sets = structure.unlabelled - len(is_hidden)
        labelled = places[in_sets:structure.unlabelled]
        shown = np.concatenate((places[:in_sets], np.where(is_hidden, NO_PLACE, labelled)))
        lonely, unlabelled = shown[free:], places[structure.unlabelled:]
        return PacketOrigin(
            structure.common, shown[self._taken],
            np.concatenate((unlabelled, lonely[lonely != NO_PLACE])), np.eye(3),
            structure.times + 16, structure.times, 1. / self._frequency, self._now, self._follow,
            labelled[is_hidden], self._taken < in_sets, labelled, len(unlabelled))

    def _now(self) -> tuple[int, ClockLine, int]:
        assert self._sent is not None
        return self._sent, self._clock.line, wall_offset()

    def _follow(self, data: bytes, received: int) -> None:
        """Note a frame that was relayed."""
        self._frames += 1
        assert self._structure is not None
        _, _, self._sent = FRAME_TIMES.unpack_from(data, self._structure.times)
        self._clock.received(self._sent / self._frequency, 1e-9 * received)

    @property
    def _frequency(self) -> float:
        assert self._info is not None
        return self._info.frequency

    def _arrange(self, structure: FrameStructure) -> None:
        """Find the names of a frame's markers by the model."""
        names: list[str] = []
        taken: list[int] = []
        nameless: list[int] = []
        is_named, first = True, 0
        for name, count in structure.sets:
            own = self._model.sets.get(name, ())
            if len(own) == count:
                names += [f'{name}:{marker}' for marker in own]
                taken += range(first, first + count)
            else:
                # The model is not known yet, or no longer this one.
                is_named = False
            first += count
        sent = {name for name, _ in structure.sets}
        for row, (body, number) in enumerate(structure.labelled, first):
            name = self._model.bodies.get(body, '')
            own = self._model.sets.get(name, ())
            if name in sent:
                continue
            if 0 < number <= len(own):
                names.append(f'{name}:{own[number - 1]}')
                taken.append(row)
            elif not sent:
                is_named = False
                nameless.append(row)
        self._structure = structure
        self._names, self._is_named = tuple(names), is_named
        self._taken, self._nameless = np.array(taken, int), np.array(nameless, int)

    def _warn_once(self, key: str, text: str) -> None:
        if key not in self._warned:
            self._warned.add(key)
            self._on_news(True, text)
