"""The client of OptiTrack before a simulated Motive: names, order, stamps, a bad network."""

import socket
import struct
import time
from threading import Event

import numpy as np
import pytest
from helpers import natnet_server
from helpers.clients import receiving_client, wait
from helpers.natnet_server import LONELY, NatNetServer, Network

from hand_tracker.adapters import natnet_client
from hand_tracker.adapters.clock_estimate import wall_offset
from hand_tracker.adapters.natnet_client import NatNetClient
from hand_tracker.adapters.packet_reception import ReceivedPacket
from hand_tracker.adapters.point_frame import SourceUnavailable
from hand_tracker.messages.stamps import nanoseconds

NAMES = {'RHand': ('wrist', 'index'), 'cup': ('rim',)}
ALL_NAMES = 'RHand:wrist', 'RHand:index', 'cup:rim'
GROUP = '239.255.42.99'


def sets(number):
    """Return the positions of a frame, which tell its number."""
    return {'RHand': np.array([[number, 2., 3.], [4., 5., 6.]]), 'cup': np.array([[7., 8., 9.]])}


def receiving(server, local='127.0.0.1'):
    """Let a client receive; yield its frames and news."""
    return receiving_client(lambda on_frame, tell: NatNetClient(
        '127.0.0.1', on_frame, tell, local, server.port))


def stream(server, condition, **more):
    """Send frames until a condition holds; return how many."""
    number = [0]

    def send():
        if server.is_connected:
            number[0] += 1
            server.send_frame(sets(number[0]), time.monotonic(), **more)

    wait(condition, send)
    return number[0]


def named(frames):
    return [frame for frame in frames if frame.names]


@pytest.mark.parametrize('version', [(3, 0), (4, 0), (4, 1)])
@pytest.mark.parametrize('has_sets', [True, False])
def test_frames_are_named_by_the_model(version, has_sets):
    with NatNetServer(version, NAMES) as server, receiving(server) as (frames, news):
        stream(server, lambda: named(frames), unlabelled=[[.5, .5, .5]], has_sets=has_sets,
               occluded=[('RHand', 1)])
    frame = named(frames)[0]
    assert frame.names == ALL_NAMES
    number = frame.markers[0, 0]
    np.testing.assert_array_equal(frame.markers,
                                  [[number, 2., 3.], [np.nan] * 3, [7., 8., 9.]])
    np.testing.assert_array_equal(frame.points, [[.5, .5, .5], LONELY])
    assert (False, 'Motive speaks NatNet {}.{}, unicast'.format(*version)) in news
    assert 10 in server.requests  # keep alive: else Motive ends its stream


def test_multicast_is_joined():
    with NatNetServer((4, 1), NAMES, group=GROUP) as server:
        require_multicast(server.data_port)
        with receiving(server) as (frames, news):
            stream(server, lambda: named(frames))
    assert any('multicast 239.255.42.99' in text for _, text in news)


def require_multicast(port):
    """Skip the test where this machine does not carry multicast on its loopback."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver, \
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        receiver.settimeout(5.)
        receiver.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            receiver.bind((GROUP, port))
            local = socket.inet_aton('127.0.0.1')
            receiver.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP,
                                socket.inet_aton(GROUP) + local)
            sender.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, local)
            sender.sendto(b'?', (GROUP, port))
            receiver.recv(1)
        except OSError as error:
            pytest.skip(f'no multicast on the loopback: {error}')


def test_a_bad_network_costs_frames_and_nothing_else():
    network = Network(drop=.1, duplicate=.2, cut=.1, jitter=.005)
    with NatNetServer((4, 1), NAMES, network) as server, receiving(server) as (frames, news):
        sent = stream(server, lambda: len(named(frames)) > 200)
    numbers = [frame.markers[0, 0] for frame in named(frames)]
    assert (np.diff(numbers) > 0).all() and max(numbers) <= sent < 10 * len(numbers)
    for frame, number in zip(named(frames), numbers):
        np.testing.assert_array_equal(
            frame.markers, [[number, 2., 3.], [4., 5., 6.], [7., 8., 9.]])
    stamps = np.array([nanoseconds(frame.stamp) for frame in named(frames)])
    assert (np.diff(stamps) > 0).mean() > .9
    assert [text.partition(':')[0] for is_warning, text in news if is_warning] == [
        'left out is a damaged packet']


def test_another_model_brings_other_names():
    with NatNetServer((4, 1), NAMES) as server, receiving(server) as (frames, _):
        stream(server, lambda: named(frames))
        server.sets = {'RHand': ('wrist', 'thumb'), 'cup': ('rim',)}
        stream(server, lambda: 'RHand:thumb' in frames[-1].names, changed=True)


def test_names_that_nobody_tells_are_missed_once(monkeypatch):
    monkeypatch.setattr(natnet_client, 'ASK_PERIOD', .01)
    with NatNetServer((3, 0), NAMES) as server:
        server.answers_models = False
        with receiving(server) as (frames, news):
            stream(server, lambda: server.requests.count(natnet_server.MOTIVE_REQUEST_MODEL) > 8)
    assert not named(frames)
    assert ['does not tell the names' in text for is_warning, text in news if is_warning] == [True]


def test_a_silent_server_is_told_once_and_found_when_it_comes(monkeypatch):
    monkeypatch.setattr(natnet_client, 'SILENCE', .1)
    monkeypatch.setattr(natnet_client, 'ASK_PERIOD', .02)
    server = NatNetServer((3, 0), NAMES)
    with receiving(server) as (frames, news):
        wait(lambda: news)
        with server:
            stream(server, lambda: named(frames))
    assert ['nothing comes' in text for _, text in news].count(True) == 1
    assert news[0][0] and not news[1][0]


@pytest.mark.parametrize('group', ['', '239.255.42.98'])
def test_a_server_that_answers_but_sends_no_frames_is_told_each_time(group, monkeypatch):
    monkeypatch.setattr(natnet_client, 'SILENCE', .3)

    def told():
        return ['no frame came' in text for _, text in news].count(True)

    with NatNetServer((4, 1), NAMES, group=group) as server, receiving(server) as (frames, news):
        wait(told)
        assert ('239.255.42.98' in news[-1][1]) == bool(group)
        stream(server, lambda: named(frames))
        wait(lambda: told() >= 2)


@pytest.mark.parametrize('server, local', [('no.such.host.invalid', ''), ('127.0.0.1', '1.2.3.4')])
def test_addresses_that_are_none_are_refused(server, local):
    with pytest.raises(SourceUnavailable, match=server):
        NatNetClient(server, print, print, local)


@pytest.mark.parametrize('drift', [0., 8e-5])
def test_stamps_are_the_exposures_times_under_jitter(drift):
    """Packets are handed over at simulated times: 5 ms of jitter each way, 60 s, no waiting."""
    rng, frames = np.random.default_rng(3), []
    client = NatNetClient('127.0.0.1', frames.append, print)
    client.take(natnet_server.server_info((4, 1)), 0)
    client.take(natnet_server.model((4, 1), NAMES), 0)

    def ticks(at):
        return round((777. + at * (1. + drift)) * natnet_server.MOTIVE_FREQUENCY)

    start, rate = 1000., 60.
    packets, exposed = [], start + np.arange(60. * rate) / rate
    for number, at in enumerate(exposed):
        out, back, way = 3e-4 + .005 * rng.random(3)
        data = natnet_server.frame((4, 1), number, sets(number), exposure=ticks(at),
                                   transmit=ticks(at + .004))
        packets.append((at + .004 + way, data))
        if number % 6 == 0:  # as each tenth of a second
            echo = struct.pack('<QQ', round(1e9 * at), ticks(at + out))
            packets.append((at + out + back, natnet_server.packet(13, echo)))
    for received, data in sorted(packets, key=lambda each: each[0]):
        client.take(data, round(1e9 * received))
    # Overtaken frames are left out.
    numbers = np.array([int(frame.markers[0, 0]) for frame in frames])
    assert len(numbers) > .9 * len(exposed) and (np.diff(numbers) > 0).all()
    wall = wall_offset()
    errors = np.array([1e-9 * (nanoseconds(frame.stamp) - wall) for frame in frames])
    errors -= exposed[numbers]
    settled = exposed[numbers] > start + 10.
    assert np.abs(errors[settled]).max() < 2e-4


def client_with_model(frames):
    """Return a client without a network that knows its server and the model."""
    client = NatNetClient('127.0.0.1', frames.append, lambda *news: None)
    client.take(natnet_server.server_info((4, 1)), 0)
    client.take(natnet_server.model((4, 1), NAMES), 0)
    return client


def frame_at(number, **more):
    ticks = NatNetServer.ticks(1000. + .01 * number)
    return natnet_server.frame(
        (4, 1), number, sets(number), exposure=ticks, transmit=ticks, **more)


@pytest.mark.parametrize('is_new', ['model', 'server'])
def test_frames_of_another_model_or_server_are_decoded_before_any_is_relayed(is_new, monkeypatch):
    frames, relayed, ended = [], [], Event()
    client = NatNetClient('127.0.0.1', frames.append, lambda *news: None)
    client.relay = object()
    others = natnet_server.model((4, 1), {**NAMES, 'RHand': ('ring', 'index')})
    info = natnet_server.server_info((4, 1))
    packets = [info, natnet_server.model((4, 1), NAMES), frame_at(1), frame_at(2),
               *[None, info][:2 * (is_new == 'server')], others, frame_at(3), frame_at(4)]

    def receive(selector, timeout, relay):
        """Let each packet come once, and the server be sought anew where there is None."""
        data = packets.pop(0)
        if not packets:
            ended.set()
        if data is None:
            client._reset()
            return ()
        is_relayed = relay is not None and data[0] == natnet_server.MOTIVE_FRAME
        relayed.extend([data] * is_relayed)
        return ReceivedPacket(data, time.monotonic_ns(), is_relayed),

    monkeypatch.setattr(natnet_client, 'receive', receive)
    client.run(ended)
    assert relayed == [frame_at(2), frame_at(4)]
    assert [frame.names[0] for frame in frames] == ['RHand:wrist', 'RHand:ring']


def test_the_origin_of_a_frame_knows_its_occluded_markers():
    frames = []
    client = client_with_model(frames)
    client.take(frame_at(1), 0)
    # Filled in elsewhere than in its set, so that it is not known which of its markers is occluded.
    data = bytearray(frame_at(2, occluded=[('RHand', 1)]))
    data[data.index(natnet_server.points(sets(2)['RHand'][1]))] ^= 1
    client.take(bytes(data), 0)
    client.take(frame_at(3), 0)
    assert [len(frame.origin.filled_in) for frame in frames] == [0, 1, 0]
    assert np.isfinite(frames[1].markers).all()
