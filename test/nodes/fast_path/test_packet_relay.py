"""Packets relayed by their numbers alone: the messages that decoding and writing make of them."""

import ctypes
import socket
import time
from contextlib import suppress

import numpy as np
import pytest
from helpers import natnet_server
from helpers.qtm_server import data_packet

from hand_tracker.adapters import qualisys
from hand_tracker.adapters.clock_estimate import LONGEST_LOOK
from hand_tracker.adapters.marker_arrays import MarkerArrayWriter
from hand_tracker.adapters.natnet_client import NatNetClient
from hand_tracker.adapters.point_frame import MalformedFrame, of_subject, turned_upright
from hand_tracker.core.numerics.jit import COMPILED
from hand_tracker.core.numerics.packs import packed
from hand_tracker.messages.cdr import ENCAPSULATION
from hand_tracker.messages.stamps import Stamp, nanoseconds
from hand_tracker.nodes.fast_path.packet_relay import (
    LARGEST_NUMBER,
    NO_PACKET,
    POINTS_CAPACITY,
    PacketRelay,
    fill_message,
    install_origin,
    new_relay_memory,
)

NEEDS = 'rclpy', 'qtm_rt'
NAMES = {'RHand': tuple('abcdefgh'), 'cup': ('rim', 'foot')}
VERSION = 4, 1
HEAD = 24
RATE = 100
FIRST_TIME, WAY = 1000., .002  # [s]


def changed_somewhere(random, data):
    """Return a packet with one of its bytes changed, but of its head, or cut."""
    found = bytearray(data)
    found[random.integers(HEAD, len(found))] = random.integers(256)
    return bytes(found[:len(found) if random.random() < .7 else random.integers(HEAD, len(found))])


class Motive:
    """Packets of NatNet: markers, some occluded for a while or nowhere, and points.

    Parameters
    ----------
    has_sets : bool
        See `natnet_server.frame`.
    """

    def __init__(self, has_sets=True):
        self._has_sets, self.occluded, self._points = has_sets, [], 0

    def __call__(self, random, number):
        sets = {name: random.normal(size=(len(names), 3)) for name, names in NAMES.items()}
        if random.random() < .03:
            sets['cup'][0, 1] = np.nan
        if random.random() < .05:
            self.occluded = [('RHand', 3), ('cup', 1), ('RHand', 0)][:random.integers(4)]
        if random.random() < .05:
            self._points = int(random.integers(4))
        points = random.normal(size=(self._points, 3))
        if random.random() < .1:       # one is a labelled marker's, or has no place
            points[:1] = sets['RHand'][2] if random.random() < .5 else np.nan
        ticks = natnet_server.NatNetServer.ticks(FIRST_TIME + number / RATE)
        return natnet_server.frame(
            VERSION, number, sets, points, self.occluded, exposure=ticks, transmit=ticks,
            changed=random.random() < .02, has_sets=self._has_sets)


class Qtm:
    """Packets of QTM, in which markers are hidden and points come and go."""

    def __init__(self):
        self.occluded, self._points = [], 2

    def __call__(self, random, number):
        markers = 1e3 * random.normal(size=(3, 3))
        if random.random() < .1:
            self.occluded = [0, 2, 1][:random.integers(3)]
        markers[self.occluded] = np.nan
        if random.random() < .05:
            self._points = int(random.integers(4))
        return data_packet(number, round(1e6 * number / RATE), {
            '3d': markers, '3dnolabels': 1e3 * random.normal(size=(self._points, 3))})


def motive_client(on_frame):
    client = NatNetClient('127.0.0.1', on_frame, lambda *news: None)
    client.take(natnet_server.server_info(VERSION), 0)
    client.take(natnet_server.model(VERSION, NAMES), 0)
    return client.take


def qtm_client(on_frame, monkeypatch):
    now = [0]
    monkeypatch.setattr(qualisys, 'monotonic_ns', lambda: now[0])
    client = qualisys.QualisysClient('127.0.0.1', on_frame, lambda *news: None)
    client._names = 'wrist', 'index'

    def take(packet, received):
        now[0] = received
        client.take(packet)

    return take


@pytest.mark.parametrize('system', ['motive', 'without sets', 'subject', 'upright', 'qtm'])
def test_a_relayed_packet_has_the_message_of_one_that_is_decoded(system, monkeypatch):
    random, frames = np.random.default_rng(7), []
    take = (qtm_client(frames.append, monkeypatch) if system == 'qtm'
            else motive_client(frames.append))
    packets = Qtm() if system == 'qtm' else Motive(system != 'without sets')
    writer = MarkerArrayWriter(lambda key, text: None)
    memories, memory = packed(new_relay_memory())
    relayed = decoded = incomplete = 0
    for number in range(1, 1500):
        # Over UDP some are overtaken.
        packet = packets(random, number - 2 * (system != 'qtm' and random.random() < .03))
        if random.random() < .1:
            packet = changed_somewhere(random, packet)
        with np.errstate(invalid='ignore'):  # signalling NaN
            received = round(1e9 * (FIRST_TIME + number / RATE + WAY))
            is_relayed = fill_message(memories, np.frombuffer(packet, np.uint8), received)
            message = memory.message.tobytes()[ENCAPSULATION:][:int(memory.message_size[0])]
            frames.clear()
            with suppress(MalformedFrame):
                take(packet, received)
        if not frames:
            assert not is_relayed
            continue
        frame, = frames
        if system == 'subject':
            frame = of_subject(frame, 'RHand')
        if system == 'upright':
            frame = turned_upright(frame, 'y')
        if is_relayed:
            stamp = Stamp(*np.frombuffer(message[8:16], np.uint32).tolist())
            assert abs(nanoseconds(stamp) - nanoseconds(frame.stamp)) < LONGEST_LOOK
            assert writer.write(frame._replace(frame_id='mocap'), stamp) == message
            relayed += 1
            incomplete += bool(packets.occluded)
        else:
            writer.write(frame._replace(frame_id='mocap'), frame.stamp)
            decoded += 1
        # As PacketRelay does.
        memory.size[0] = NO_PACKET
        if frame.origin is not None:
            install_origin(memory, *writer.rows(frame.origin), writer.template)
            memory.last[0], memory.clock[:], memory.wall[0] = frame.origin.now()
    assert relayed > 900 and incomplete > 300 and decoded > 50


def test_a_hand_in_a_large_packet_is_relayed():
    random, frames = np.random.default_rng(3), []
    sets = {**NAMES, 'crowd': tuple(map(str, range(450)))}
    client = NatNetClient('127.0.0.1', frames.append, lambda *news: None)
    client.take(natnet_server.server_info(VERSION), 0)
    client.take(natnet_server.model(VERSION, sets), 0)
    writer = MarkerArrayWriter(lambda key, text: None)
    memories, memory = packed(new_relay_memory())
    for number in range(1, 4):
        ticks = natnet_server.NatNetServer.ticks(FIRST_TIME + number / RATE)
        packet = natnet_server.frame(
            VERSION, number, {name: random.normal(size=(len(names), 3))
                              for name, names in sets.items()}, random.normal(size=(20, 3)),
            [('crowd', 7), ('RHand', 2)], exposure=ticks, transmit=ticks)
        assert 2**14 < len(packet) <= 2**16
        received = round(1e9 * (FIRST_TIME + number / RATE + WAY))
        is_relayed = fill_message(memories, np.frombuffer(packet, np.uint8), received)
        assert is_relayed == (number > 1)
        message = memory.message.tobytes()[ENCAPSULATION:][:int(memory.message_size[0])]
        client.take(packet, received)
        frame = of_subject(frames[-1], 'RHand')._replace(frame_id='mocap')
        stamp = Stamp(*np.frombuffer(message[8:16], np.uint32).tolist()) if is_relayed else (
            frame.stamp)
        assert writer.write(frame, stamp) == message or number == 1
        if number == 1:
            install_origin(memory, *writer.rows(frame.origin), writer.template)
        memory.last[0], memory.clock[:], memory.wall[0] = frame.origin.now()


def frame_of_motive(points=0, ticks=1):
    """Return a frame as a client hands it over, and the writer of its message."""
    frames = []
    sets = {name: np.ones((len(names), 3)) for name, names in NAMES.items()}
    motive_client(frames.append)(natnet_server.frame(
        VERSION, 1, sets, np.ones((points, 3)), exposure=ticks, transmit=ticks), 0)
    writer = MarkerArrayWriter(lambda key, text: None)
    writer.write(frames[0]._replace(frame_id='mocap'), frames[0].stamp)
    return frames[0], writer


def test_packets_of_too_many_points_are_not_relayed():
    frame, writer = frame_of_motive()
    memory = new_relay_memory()
    install_origin(memory, *writer.rows(frame.origin), writer.template)
    assert memory.size[0] == len(frame.origin.structure.data)
    origin, markers, points = writer.rows(frame.origin._replace(
        points=np.arange(POINTS_CAPACITY + 1)))
    install_origin(memory, origin, markers, points, writer.template)
    assert memory.size[0] == NO_PACKET


def test_a_number_beyond_those_of_the_relay_leaves_packets_to_be_decoded():
    relay = PacketRelay.__new__(PacketRelay)  # without its compiled callback
    frame, writer = frame_of_motive(ticks=2**63 + 5)
    relay._memory, relay._installed = new_relay_memory(), None
    relay.install(frame.origin, writer)
    assert frame.origin.now()[0] == 2**63 + 5 and relay._memory.last[0] == LARGEST_NUMBER


class Taker:
    """The entrance of a fast path, that takes messages, or not."""

    def __init__(self):
        self.accepts, self.messages = True, []
        self._handed = np.zeros(3, np.int64)
        self._callback = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_size_t)(self._take)

    def _take(self, context, count):
        self.messages.append(ctypes.string_at(int(self._handed[0]), int(self._handed[1])))
        self._handed[2] = self.accepts

    @property
    def entrance(self):
        callback = ctypes.cast(self._callback, ctypes.c_void_p).value
        return self._handed.ctypes.data, callback, 0


def qtm_at(number):
    """Return a packet whose markers tell its number, and which is exposed some µs after others."""
    return data_packet(number, number, {'3d': np.full((2, 3), 1e3 * number)})


def decoded_by(relay, writer, packet):
    """Decode a packet, and have those like it relayed."""
    frames = []
    client = qualisys.QualisysClient('127.0.0.1', frames.append, lambda *news: None)
    client._names = 'wrist', 'index'
    client.take(packet)
    frame = frames[0]._replace(frame_id='mocap')
    writer.write(frame, frame.stamp)
    relay.install(frame.origin, writer)


@pytest.mark.skipif(not COMPILED, reason='there is no fast path here')
def test_packets_of_a_stream_are_received_one_by_one():
    taker, writer = Taker(), MarkerArrayWriter(lambda key, text: None)
    relay = PacketRelay(taker)
    receiver, sender = socket.socketpair()
    with receiver, sender:
        def receive(timeout=5.):
            return relay.receive([receiver.fileno()], timeout, is_stream=True)

        assert receive(.01) == ()
        # Nothing is installed: all that waits.
        sender.sendall(qtm_at(1) + qtm_at(2))
        (data, _, is_relayed), = receive()
        assert data == qtm_at(1) + qtm_at(2) and not is_relayed and not taker.messages
        decoded_by(relay, writer, qtm_at(2))
        sender.sendall(qtm_at(3) + qtm_at(4))
        for number in (3, 4):
            before = time.monotonic_ns()
            (data, received, is_relayed), = receive()
            assert data == qtm_at(number) and is_relayed
            assert received <= time.monotonic_ns() and (number == 4 or received >= before)
            assert taker.messages[-1] == relay.message()
            assert np.float64(number).tobytes() in taker.messages[-1]
        # One that was before, and one of another size with the beginning of the next.
        sender.sendall(qtm_at(4) + data_packet(5, 5, {'3d': []}) + qtm_at(6))
        found = [packet for _ in range(3) for packet in receive()]
        assert not any(packet.is_relayed for packet in found) and len(taker.messages) == 2
        assert b''.join(packet.data for packet in found) == (
            qtm_at(4) + data_packet(5, 5, {'3d': []}) + qtm_at(6))
        assert receive(.01) == ()
        taker.accepts = False
        sender.sendall(qtm_at(7))
        (data, _, is_relayed), = receive()
        assert data == qtm_at(7) and not is_relayed and len(taker.messages) == 3
        sender.close()
        assert receive()[0].data == b''


@pytest.mark.skipif(not COMPILED, reason='there is no fast path here')
def test_a_packet_of_a_stream_that_comes_in_parts_is_relayed():
    taker, writer = Taker(), MarkerArrayWriter(lambda key, text: None)
    relay = PacketRelay(taker)
    # As datagrams the parts stay apart however late they are read.
    receiver, sender = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    with receiver, sender:
        decoded_by(relay, writer, qtm_at(1))
        for number, cuts in ((2, (0, 20, 50, None)), (3, (0, 4, None))):
            for first, last in zip(cuts, cuts[1:]):
                sender.send(qtm_at(number)[first:last])
            (data, _, is_relayed), = relay.receive([receiver.fileno()], 5., is_stream=True)
            assert data == qtm_at(number) and is_relayed
        # One whose rest does not come, and one that is whole though it is shorter.
        for part in qtm_at(4)[:30], data_packet(5, 5, {'3d': []}):
            sender.send(part)
            (data, _, is_relayed), = relay.receive([receiver.fileno()], 5., is_stream=True)
            assert data == part and not is_relayed


@pytest.mark.skipif(not COMPILED, reason='there is no fast path here')
def test_datagrams_of_two_sockets_are_received_whole():
    relay = PacketRelay(Taker())
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as first, \
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as second, \
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for one in first, second:
            one.bind(('127.0.0.1', 0))
        files = [first.fileno(), second.fileno()]
        for number, one in enumerate((second, first, second)):
            sent = bytes([number]) * (60_000 - number)
            sender.sendto(sent, one.getsockname())
            (data, _, is_relayed), = relay.receive(files, 5.)
            assert data == sent and not is_relayed
        assert relay.receive(files, 0.) == ()
