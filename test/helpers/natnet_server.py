"""A simulated Motive: NatNet 3.0, 4.0 and 4.1 over real sockets, on a network that misbehaves."""

import random
import socket
import struct
import time
from threading import Event, Thread

import numpy as np

MOTIVE_CONNECT, MOTIVE_SERVER_INFO, MOTIVE_REQUEST_MODEL, MOTIVE_MODEL, MOTIVE_FRAME = 0, 1, 4, 5, 7
MOTIVE_ECHO_REQUEST, MOTIVE_ECHO_RESPONSE = 12, 13
MOTIVE_FREQUENCY = 10_000_000  # of Motive's clock on Windows [Hz]
LONELY = -5., -6., -7.   # [m], a point that is listed among the labelled as an unlabelled one
MOTIVE_CLOCK_OFFSET = 12345.678  # [s] of that clock against this machine's


def packet(number, payload):
    return struct.pack('<HH', number, len(payload)) + payload


def text(value):
    return value.encode() + b'\0'


def section(version, items, data):
    """Return the head of a frame's section, which has its size since 4.1."""
    size = struct.pack('<I', len(data)) if version >= (4, 1) else b''
    return struct.pack('<I', items) + size + data


def points(rows):
    return np.asarray(rows, '<f4').tobytes()


def server_info(version, frequency=MOTIVE_FREQUENCY, port=1511, group=''):
    data = b'Motive'.ljust(256, b'\0') + bytes((3, 0, 0, 0)) + bytes((*version, 0, 0))
    data += struct.pack('<QH?', frequency, port, bool(group))
    return packet(MOTIVE_SERVER_INFO, data + socket.inet_aton(group or '0.0.0.0'))


def rigid_body_model(version, name, count, body=9):
    data = text(name) + struct.pack('<Ii3f', body, -1, 0., 0., 0.)
    if version >= (4, 2):
        data += struct.pack('<4f', 0., 0., 0., 1.)
    data += struct.pack('<I', count) + bytes(16 * count)
    return data + (b''.join(text(f'm{i}') for i in range(count)) if version >= (4, 0) else b'')


def model(version, sets):
    """Return model definitions: marker sets among rigid bodies, skeletons, cameras, devices."""
    parts = []
    for place, (name, names) in enumerate(sets.items(), 1):
        parts.append((1, rigid_body_model(version, name, len(names), place)))
        parts.append((2, text('body') + struct.pack('<II', 30 + place, 2)
                      + 2 * rigid_body_model(version, 'bone', 4)))
        parts.append((4, struct.pack('<I', 8) + text('glove') + text('SN1')
                      + struct.pack('<III', 1, 2, 2) + text('x') + text('y')))
        parts.append((5, text('camera') + struct.pack('<7f', *range(7))))
        parts.append((0, text(name) + struct.pack('<I', len(names)) + b''.join(map(text, names))))
    parts.append((0, text('all') + struct.pack('<I', 1) + text('whatever_1')))
    data = struct.pack('<I', len(parts))
    for kind, part in parts:
        size = struct.pack('<I', len(part)) if version >= (4, 1) else b''
        data += struct.pack('<I', kind) + size + part
    return packet(MOTIVE_MODEL, data)


def frame(version, number, sets, unlabelled=(), occluded=(), exposure=0, transmit=0,
          changed=False, has_sets=True):
    """Return a frame, with a rigid body, a skeleton, a force plate and a device in it.

    Parameters
    ----------
    sets : dict of str to array_like (n, 3)
    occluded : sequence of (str, int)
        Set and row of markers that are filled in.
    exposure, transmit : int
        [ticks]
    has_sets : bool
        Whether the markers are in their sets too; else labelled alone, and among the unlabelled.
    """
    body = struct.pack('<I8fH', 7, *range(8), 1)
    every = np.concatenate([np.asarray(rows, float).reshape(-1, 3) for rows in sets.values()]
                           or [np.empty((0, 3))])
    if not has_sets:
        unlabelled = [*every, *unlabelled]
    blocks = b''.join(text(name) + struct.pack('<I', len(rows)) + points(rows)
                      for name, rows in [*sets.items(), ('all', every)] if has_sets)
    labelled = b''.join(
        struct.pack('<I', (place + 1 << 16) + row + 1) + points(at)
        + struct.pack('<fHf', .014, 8 | ((name, row) in occluded), .0002)
        for place, (name, rows) in enumerate(sets.items()) for row, at in enumerate(rows))
    labelled += struct.pack('<I', 50007) + points(LONELY) + struct.pack('<fHf', .02, 18, .0005)
    analog = struct.pack('<III2fI1f', 4, 2, 2, 1., 2., 1, 3.)
    data = struct.pack('<I', number) + section(version, (len(sets) + 1) * has_sets, blocks)
    data += section(version, len(unlabelled), points(unlabelled)) + section(version, 1, body)
    data += section(version, 1, struct.pack('<II', 3, 2) + 2 * body)
    if version >= (4, 1):
        asset = struct.pack('<III', 1, 1, 7) + struct.pack('<8fH', *range(8), 1)
        asset += struct.pack('<II', 1, 5) + points((1., 2., 3.)) + struct.pack('<fHf', .01, 0, 0.)
        data += section(version, 1, asset)
    data += section(version, sum(map(len, sets.values())) + 1, labelled)
    data += section(version, 1, analog) + section(version, 1, analog)
    data += struct.pack('<IIdQQQ', 0, 0, 1.5, exposure, exposure, transmit)
    if version >= (4, 1):
        data += struct.pack('<II', 0, 0)
    return packet(MOTIVE_FRAME, data + struct.pack('<HI', 2 * changed, 0))


class Network:
    """What happens to packets on their way; none of it to the first of each kind.

    Attributes
    ----------
    drop, duplicate, cut : float
        Share of packets.
    jitter : float
        Longest delay, so that packets overtake each other [s].
    """

    def __init__(self, drop=0., duplicate=0., cut=0., jitter=0., seed=1):
        self.drop, self.duplicate, self.cut, self.jitter = drop, duplicate, cut, jitter
        self._random = random.Random(seed)

    def carry(self, data):
        """Return (delay [s], packet) of each packet that arrives."""
        draw = self._random.random
        if draw() < self.drop:
            return []
        if draw() < self.cut:
            data = data[:int(len(data) * draw())]
        return [(self.jitter * draw(), data)
                for _ in range(1 + (draw() < self.duplicate))]


class NatNetServer:
    """Motive on 127.0.0.1: answers requests, and sends frames as it is told.

    Parameters
    ----------
    version : tuple of int
    sets : dict of str to sequence of str
        Names of the markers of each marker set.
    network : Network, optional
    group : str, optional
        Multicast address; unicast when left out.
    """

    def __init__(self, version, sets, network=None, group=''):
        self.version, self.sets, self._group = version, sets, group
        self._network = network or Network()
        self.requests = []
        self.answers_models = True
        self._client, self._number = None, 0
        self._ended, self._waiting = Event(), []
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(('127.0.0.1', 0))
        self._socket.setblocking(False)
        self.port = self._socket.getsockname()[1]
        self.data_port = self.port
        if group:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
                free.bind(('', 0))
                self.data_port = free.getsockname()[1]
            self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF,
                                    socket.inet_aton('127.0.0.1'))
            self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 1)
        self._thread = Thread(target=self._serve, daemon=True)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *error):
        self._ended.set()
        self._thread.join()
        self._socket.close()

    @staticmethod
    def ticks(monotonic):
        """Return the server's clock at a time of this machine's monotonic clock [s]."""
        return round((monotonic + MOTIVE_CLOCK_OFFSET) * MOTIVE_FREQUENCY)

    @property
    def is_connected(self):
        return self._client is not None

    def send_frame(self, sets, exposed, **more):
        """Send a frame exposed at a time of the monotonic clock [s]; return the packet."""
        self._number += 1
        data = frame(self.version, self._number, sets, exposure=self.ticks(exposed),
                     transmit=self.ticks(time.monotonic()), **more)
        target = (self._group, self.data_port) if self._group else self._client
        self._send(data, target)
        return data

    def packed(self, sets, **more):
        """Return a frame for `send_at_once`, with what `frame` takes besides."""
        self._number += 1
        return bytearray(frame(self.version, self._number, sets, **more))

    def send_at_once(self, data):
        """Send a frame, exposed now, from the caller's thread, past the network's faults."""
        times = 3 * (self.ticks(time.monotonic()),)
        behind = 14 if self.version >= (4, 1) else 6
        struct.pack_into('<QQQ', data, len(data) - behind - 24, *times)
        if self._client is not None:
            self._socket.sendto(data, self._client)

    def _send(self, data, target, through=True):
        carried = self._network.carry(data) if through else [(0., data)]
        now = time.monotonic()
        self._waiting += [(now + delay, part, target) for delay, part in carried]

    def _serve(self):
        while not self._ended.wait(.0005):
            now, waiting = time.monotonic(), self._waiting
            for each in [each for each in waiting if each[0] <= now]:
                waiting.remove(each)
                self._socket.sendto(each[1], each[2])
            try:
                data, address = self._socket.recvfrom(2**16)
            except BlockingIOError:
                continue
            number, = struct.unpack_from('<H', data)
            self.requests.append(number)
            if number == MOTIVE_CONNECT:
                self._client = address
                self._send(server_info(self.version, port=self.data_port, group=self._group),
                           address, through=False)
            elif number == MOTIVE_REQUEST_MODEL and self.answers_models:
                self._send(model(self.version, self.sets), address, through=False)
            elif number == MOTIVE_ECHO_REQUEST:
                ticks = struct.pack('<Q', self.ticks(time.monotonic()))
                self._send(packet(MOTIVE_ECHO_RESPONSE, data[4:12] + ticks), address)
