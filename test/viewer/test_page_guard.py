"""The viewer's server refuses other hosts, other pages, strangers, and too much at once."""

import asyncio
import http.client
import os
import random
import re

import pytest
import viser
import websockets

from hand_tracker.viewer.page import ALL_INTERFACES, Viewer
from hand_tracker.viewer.page_guard import LARGEST_FRAME, PageGuard, cookie_name

NEEDS = 'viser', 'websockets'

FUZZED = int(os.environ.get('HAND_TRACKER_FAULTS', '1')) * 100  # frames


@pytest.fixture
def local():
    """Yield a viewer of this machine alone."""
    viewer = Viewer()
    try:
        yield viewer
    finally:
        viewer.stop()


@pytest.fixture
def shared():
    """Yield a viewer of the whole network."""
    viewer = Viewer(ALL_INTERFACES)
    try:
        yield viewer
    finally:
        viewer.stop()


def port(viewer):
    return int(re.search(r':(\d+)', viewer.addresses[0])[1])


def get(viewer, path='/', **headers):
    """Return status, headers and body of an answer."""
    connection = http.client.HTTPConnection('127.0.0.1', port(viewer), timeout=60.)
    try:
        connection.request('GET', path, headers=headers)
        answer = connection.getresponse()
        return answer.status, answer.headers, answer.read()
    finally:
        connection.close()


def connect(viewer, **options):
    return websockets.connect(f'ws://localhost:{port(viewer)}', open_timeout=60., **options)


def is_refused(viewer, **options):
    """Return whether a websocket is refused."""
    async def attempt():
        try:
            async with connect(viewer, **options):
                return False
        except websockets.exceptions.InvalidStatus as error:
            return error.response.status_code == 403
    return asyncio.run(attempt())


def test_the_page_names_no_path_and_nothing_of_another_host(local):
    status, headers, body = get(local)
    assert status == 200
    policy = headers['Content-Security-Policy']
    assert f'ws://127.0.0.1:{port(local)}' in policy and "frame-ancestors 'none'" in policy
    assert not re.search(r'https?:', policy) and '*' not in policy
    assert headers['X-Content-Type-Options'] == 'nosniff'
    assert 'Set-Cookie' not in headers
    assert os.path.expanduser('~').encode() not in body and os.getcwd().encode() not in body
    for path in '/../../etc/passwd', '/%2e%2e/%2e%2e/etc/passwd', '/..\\..\\x', '//etc/passwd':
        assert get(local, path)[0] == 404, path


def test_another_host_and_another_page_are_refused(local):
    assert get(local, Host='evil.example')[0] == 403
    assert get(local, Host=f'localhost:{port(local)}')[0] == 200
    assert is_refused(local, origin='http://evil.example')
    assert is_refused(local, origin='null')
    assert not is_refused(local, origin=f'http://localhost:{port(local)}')


def test_beyond_this_machine_a_token_is_needed(shared):
    address = shared.addresses[0]
    token = address.rpartition('token=')[2]
    assert len(token) > 20 and get(shared)[0] == 403
    assert get(shared, '/?token=' + 'x' * len(token))[0] == 403
    status, headers, _ = get(shared, f'/?token={token}')
    assert status == 200
    assert all(part in headers['Set-Cookie'] for part in (token, 'HttpOnly', 'SameSite=Strict'))
    assert is_refused(shared)
    host = f'localhost:{port(shared)}'
    assert not is_refused(shared, additional_headers={
        'Cookie': f'{cookie_name(host)}={token}'})


def test_hostile_frames_end_their_connection_and_no_other(local):
    rng = random.Random(3)
    protocol = websockets.Subprotocol(f'viser-v{viser.__version__}')

    async def attack():
        codes = []
        async with connect(local, subprotocols=[protocol], max_size=None) as witness:
            first = await witness.recv()
            for number in range(FUZZED):
                async with connect(local, subprotocols=[protocol], max_size=None) as attacker:
                    if number % 10:
                        # What junk is taken for decides viser.
                        await attacker.send(rng.randbytes(rng.randrange(1, 300)))
                        continue
                    # Binary, masked, of eight bytes' length (RFC 6455, 5.2): the head is enough.
                    attacker.transport.write(
                        b'\x82\xff' + (LARGEST_FRAME + 1).to_bytes(8, 'big') + bytes(4))
                    await attacker.wait_closed()
                    codes.append(attacker.close_code)
            # Who was there before is still served.
            await (await witness.ping())
        return first, codes

    first, codes = asyncio.run(attack())
    assert first and set(codes) == {1009}  # RFC 6455, 7.4.1: too big
    assert get(local)[0] == 200


def test_malformed_headers_are_refused():
    guard = PageGuard(True, 'token')
    for host in '', '[', 'localhost]', 'evil', '127.0.0.1.evil.example', 'localhost@evil':
        try:
            assert guard.refusal('/?token=token', {'Host': host}) is not None, host
        except ValueError:
            pass
    assert guard.refusal('/?token=token', {'Host': 'localhost:1'}) is None
    assert guard.refusal('/', {
        'Host': 'localhost:1', 'Cookie': f"{cookie_name('localhost:1')}=token"}) is None
    # Another viewer of this machine has another token.
    assert guard.refusal('/', {
        'Host': 'localhost:1', 'Cookie': f"{cookie_name('localhost:2')}=token"}) is not None
    assert guard.refusal('/', {'Host': 'localhost', 'Cookie': '\x00;=;' * 99}) is not None
    assert guard.refusal('/?token=%ff%00é', {'Host': 'localhost'}) is not None
