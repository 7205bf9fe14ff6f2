"""The client of Qualisys before a simulated QTM, through Qualisys' own package."""

import os
import resource
import struct
import sys
from contextlib import ExitStack
from threading import Event, Thread

import numpy as np
import pytest
from helpers.clients import receiving_client, relay_of, wait
from helpers.qtm_server import (
    QTM_COMMAND,
    QTM_XML,
    QtmServer,
    data_packet,
    packet,
    parameters_packet,
)

from hand_tracker.adapters import qualisys
from hand_tracker.adapters.clock_estimate import wall_offset
from hand_tracker.adapters.point_frame import SourceUnavailable
from hand_tracker.adapters.qualisys import QualisysClient
from hand_tracker.messages.stamps import nanoseconds

NEEDS = ('qtm_rt',)

LABELS = 'wrist', 'index'
NOWHERE = [np.nan] * 3


def receiving(server, components=('3d', '3dnolabels'), **more):
    """Let a client receive; yield its frames and news."""
    return receiving_client(lambda on_frame, tell: QualisysClient(
        '127.0.0.1', on_frame, tell, components, port=server.port, **more))


def streams_begun(server):
    """Return how often a client has asked for data."""
    return sum(command.lower().startswith('streamframes') for command in server.commands)


@pytest.mark.parametrize('ending', ['', 'res'])
def test_named_markers_and_anonymous_points_are_read(ending):
    named, anonymous = f'3d{ending}', f'3dnolabels{ending}'
    with QtmServer(LABELS) as server, receiving(server, (named, anonymous)) as (frames, news):
        wait(lambda: server.streams)
        server.send(data_packet(1, 5000, {
            named: [[1., 2., 3.], NOWHERE, [10., 0., 0.]], anonymous: [[4., 5., 6.]]}))
        server.send(data_packet(2, 15000, {named: [[1., 2., 3.], [7., 8., 9.]], anonymous: []}))
        wait(lambda: len(frames) == 2)
    assert frames[0].names == frames[1].names == LABELS
    np.testing.assert_allclose(frames[0].markers, [[.001, .002, .003], NOWHERE], rtol=1e-7)
    # A marker that QTM has no name for is anonymous.
    np.testing.assert_allclose(frames[0].points, [[.01, 0., 0.], [.004, .005, .006]], rtol=1e-7)
    np.testing.assert_allclose(frames[1].markers[1], [.007, .008, .009], rtol=1e-7)
    assert f'streamframes allframes {named} {anonymous}' in server.commands
    assert news == [(False, f'QTM on 127.0.0.1 streams {named}, {anonymous}, 2 named markers')]


@pytest.mark.parametrize('said, up, news', [
    ('+Z', 'z', [(False, 'named markers')]), ('+Y', 'y', [(False, 'named markers, y up')]),
    ('-Z', '-z', [(False, 'named markers, -z up')]),
    ('', 'z', [(False, 'named markers')])])
def test_the_upward_axis_is_what_qtm_says(said, up, news):
    clients = []

    def make(on_frame, tell):
        clients.append(QualisysClient('127.0.0.1', on_frame, tell, port=server.port))
        return clients[0]

    with QtmServer(LABELS, up=said) as server, receiving_client(make) as (_, logged):
        wait(lambda: server.streams)
        server.send(data_packet(1, 5000, {'3d': []}))
        wait(lambda: len(logged) == len(news))
    assert clients[0].up == up
    assert [is_warning for is_warning, _ in logged] == [is_warning for is_warning, _ in news]
    assert all(part in text for (_, text), (_, part) in zip(logged, news))
    assert logged[-1][1].endswith(news[-1][1])


def test_packets_in_pieces_repeated_and_lost():
    with QtmServer(LABELS) as server, receiving(server) as (frames, _):
        wait(lambda: server.streams)
        sent = b''.join(data_packet(number, 1000 * number, {'3d': [[number, 0., 0.]] * 2})
                        for number in (1, 2, 2, 3, 7, 8))
        for start in range(0, len(sent), 13):
            server.send(sent[start:start + 13])
        wait(lambda: len(frames) == 5)
    assert [round(1e3 * frame.markers[0, 0]) for frame in frames] == [1, 2, 3, 7, 8]


def test_a_damaged_packet_and_a_lost_connection_are_survived(monkeypatch, capfd):
    monkeypatch.setattr(qualisys, 'RETRY_TIME', .1)
    cut = bytearray(data_packet(1, 1000, {'3d': [[1., 2., 3.]] * 2}))
    cut[32] = 200  # markers, of which there are two
    newer = bytearray(data_packet(2, 1000, {'3d': []}))
    newer[28] = 77  # a component that qtm-rt does not know
    with QtmServer(LABELS) as server, receiving(server) as (frames, news):
        wait(lambda: server.streams)
        server.send(bytes(cut))
        server.send(data_packet(3, 3000, {'3d': [[3., 0., 0.]] * 2}))
        wait(lambda: len(frames) == 1)
        server.send(bytes(newer))
        wait(lambda: len(frames) == 2)
        assert frames[1].names == ()
        server.hang_up()
        wait(lambda: streams_begun(server) == 2)
        server.send(data_packet(1, 1000, {'3d': [[4., 0., 0.]] * 2}))
        wait(lambda: len(frames) == 3)
    assert any('damaged frame' in text for _, text in news)
    assert any('connection has ended' in text for _, text in news)
    assert 'Traceback' not in ''.join(capfd.readouterr())


@pytest.mark.parametrize('answer, told', [
    (packet(QTM_XML, b'<!DOCTYPE r [<!ENTITY a "b">]><r><Label><Name>&a;</Name></Label></r>\0'),
     'document type or entities'),
    (packet(QTM_XML, b'<r>\0'), 'not XML'),
    (data_packet(1, 1000, {'3d': []}), 'a frame where its parameters')])
def test_parameters_that_are_none_are_told(monkeypatch, answer, told):
    monkeypatch.setattr(qualisys, 'RETRY_TIME', .1)
    with QtmServer(LABELS) as server:
        server.parameters = answer
        with receiving(server) as (frames, news):
            wait(lambda: news)
            server.parameters = parameters_packet(LABELS)
            wait(lambda: server.streams)
            server.send(data_packet(1, 1000, {'3d': [[4., 0., 0.]] * 2}))
            wait(lambda: frames)
    assert news[0][0] and told in news[0][1]


@pytest.mark.parametrize('hostile', [
    struct.pack('<II', 0, QTM_COMMAND),          # for qtm-rt the next packet begins where it did
    struct.pack('<II', 2**31, QTM_COMMAND)])
def test_sizes_that_lead_nowhere_end_the_connection(monkeypatch, hostile):
    monkeypatch.setattr(qualisys, 'RETRY_TIME', .1)
    with QtmServer(LABELS) as server, receiving(server) as (frames, news):
        wait(lambda: server.streams)
        server.send(data_packet(1, 1000, {'3d': [[3., 0., 0.]] * 2}))
        wait(lambda: len(frames) == 1)
        server.send(hostile)
        wait(lambda: streams_begun(server) == 2)
        server.send(data_packet(1, 1000, {'3d': [[4., 0., 0.]] * 2}))
        wait(lambda: len(frames) == 2)
    assert any('connection has ended' in text for _, text in news)


def test_a_qtm_that_is_not_there_is_told_once_and_found_when_it_comes(monkeypatch):
    monkeypatch.setattr(qualisys, 'RETRY_TIME', .1)
    with QtmServer(LABELS) as former:
        pass
    with receiving(former) as (frames, news):
        wait(lambda: news)
        with QtmServer(LABELS, former.port) as server:
            wait(lambda: server.streams)
            server.send(data_packet(1, 1000, {'3d': [[1., 0., 0.]] * 2}))
            wait(lambda: frames)
    assert [is_warning for is_warning, _ in news[:2]] == [True, False]
    assert 'Is QTM measuring' in news[0][1]


def test_a_qtm_that_sends_no_frames_is_told_once_until_they_come(monkeypatch):
    monkeypatch.setattr(qualisys, 'QTM_SILENCE', 3 * 10**8)

    def told():
        return ['no frame came' in text for _, text in news].count(True)

    with QtmServer(LABELS) as server, receiving(server) as (frames, news):
        wait(lambda: server.streams)
        for number in 1, 2:
            server.send(data_packet(number, 1000 * number, {'3d': [[1., 0., 0.]] * 2}))
            wait(lambda count=number: len(frames) == count and told() >= count)


def test_components_are_checked_and_the_package_is_named(monkeypatch):
    with pytest.raises(SourceUnavailable, match='6d.*expected some of 3d 3dres'):
        QualisysClient('127.0.0.1', print, print, ('3d', '6d'))
    monkeypatch.setitem(sys.modules, 'qtm_rt', None)
    with pytest.raises(SourceUnavailable, match='pip install qtm-rt'):
        QualisysClient('127.0.0.1', print, print)


def test_stamps_are_the_exposures_times_under_jitter(monkeypatch):
    """Packets are handed over at simulated times: 5 ms of jitter, no waiting."""
    rng, frames, now = np.random.default_rng(4), [], [0.]
    monkeypatch.setattr(qualisys, 'monotonic_ns', lambda: round(1e9 * now[0]))
    client = QualisysClient('127.0.0.1', frames.append, print, latency=.003)
    start, rate, drift = 1000., 120., 5e-5
    exposed = start + np.arange(40. * rate) / rate
    last = 0.
    for number, at in enumerate(exposed):
        # TCP keeps the order: what waits, waits for what was sent before.
        now[0] = last = max(last, at + .003 + .005 * rng.random())
        data = data_packet(number, round(1e6 * (50. + at * (1. + drift))), {'3d': [[1., 2., 3.]]})
        client.take(data)
    wall = wall_offset()
    errors = np.array([1e-9 * (nanoseconds(frame.stamp) - wall) for frame in frames]) - exposed
    assert np.abs(errors[exposed > start + 10.]).max() < 2e-4


def test_a_measurement_that_begins_anew_has_a_clock_of_its_own(monkeypatch):
    frames, now = [], [0.]
    monkeypatch.setattr(qualisys, 'monotonic_ns', lambda: round(1e9 * now[0]))
    client = QualisysClient('127.0.0.1', frames.append, print)
    for number, (start, count) in enumerate(((0., 240), (100., 240))):
        for k in range(count):
            now[0] = start + .01 * k
            # Both count frames and microseconds from their own beginning.
            client.take(data_packet(k, 10_000 * k, {'3d': [[number, 0., 0.]]}))
    stamps = np.array([1e-9 * (nanoseconds(frame.stamp) - wall_offset()) for frame in frames])
    expected = np.concatenate((.01 * np.arange(240), 100. + .01 * np.arange(240)))
    np.testing.assert_allclose(stamps, expected, atol=1e-3)


def test_frames_of_another_connection_are_decoded_before_any_is_relayed(monkeypatch):
    monkeypatch.setattr(qualisys, 'RETRY_TIME', .1)
    asked, clients = [], []

    def make(on_frame, tell):
        clients.append(QualisysClient('127.0.0.1', on_frame, tell, port=server.port))
        clients[0].relay = relay_of(asked)
        return clients[0]

    with QtmServer(LABELS) as server, receiving_client(make) as (frames, _):
        for connection in (1, 2):
            wait(lambda connection=connection: streams_begun(server) == connection
                 and server.streams)
            server.send(data_packet(1, 1000, {'3d': [[1., 2., 3.]] * 2}))
            wait(lambda connection=connection: len(frames) == connection)
            server.send(data_packet(2, 2000, {'3d': [[1., 2., 3.]] * 2}))
            wait(lambda connection=connection: len(asked) == connection)
            if connection == 1:
                server.parameters = parameters_packet(('ring', 'little'))
                server.hang_up()
    assert [frame.names for frame in frames] == [LABELS, ('ring', 'little')]


def test_a_fault_of_who_takes_frames_is_no_lost_connection():
    def fail(frame):
        raise ValueError('of ours')

    warnings, ended = [], Event()

    def tell(is_warning, text):
        if is_warning:
            warnings.append(text)
            ended.set()

    with QtmServer(LABELS) as server:
        def send():
            wait(lambda: server.streams)
            server.send(data_packet(1, 1000, {'3d': [[1., 2., 3.]] * 2}))

        client = QualisysClient('127.0.0.1', fail, tell, port=server.port)
        sender = Thread(target=send)
        sender.start()
        with pytest.raises(ValueError, match='of ours'):
            client.run(ended)
        sender.join()
    assert not warnings


def test_a_process_with_many_open_files_receives():
    limit, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    if most < 2048:
        pytest.skip('no process here may open so many files')
    resource.setrlimit(resource.RLIMIT_NOFILE, (max(limit, 2048), most))
    try:
        with ExitStack() as stack:
            opened = os.open(os.devnull, os.O_RDONLY)
            stack.callback(os.close, opened)
            while opened < 1024:
                opened = os.dup(opened)
                stack.callback(os.close, opened)
            server = stack.enter_context(QtmServer(LABELS))
            frames, _ = stack.enter_context(receiving(server))
            wait(lambda: server.streams)
            for number in (1, 2):
                server.send(data_packet(number, 1000 * number, {'3d': [[1., 2., 3.]] * 2}))
                wait(lambda number=number: len(frames) == number)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, (limit, most))
