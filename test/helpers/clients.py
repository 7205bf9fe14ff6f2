"""Clients of motion capture systems that receive in a thread while a test looks on."""

import os
import select
import time
from contextlib import contextmanager
from threading import Event, Thread

from hand_tracker.adapters.packet_reception import MOST_AT_ONCE, ReceivedPacket

CLIENT_PATIENCE = 60.  # [s]


@contextmanager
def receiving_client(make):
    """Let a client receive, made of callbacks for frames and news; yield what it has told."""
    frames, news, ended = [], [], Event()
    client = make(frames.append, lambda *each: news.append(each))
    thread = Thread(target=client.run, args=(ended,))
    thread.start()
    try:
        yield frames, news
    finally:
        ended.set()
        thread.join(CLIENT_PATIENCE)
        assert not thread.is_alive()


def relay_of(asked):
    """Return a relay that receives for a client, and takes all packets, which it appends."""
    def relay(sockets, timeout, is_stream=False):
        ready, _, _ = select.select(sockets, [], [], timeout)
        if not ready:
            return ()
        data = os.read(ready[0], MOST_AT_ONCE)
        if data:
            asked.append(data)
        return ReceivedPacket(data, time.monotonic_ns(), bool(data)),

    return relay


def wait(condition, act=lambda: None):
    """Wait until a condition holds, acting meanwhile; fail when it does not in time."""
    until = time.monotonic() + CLIENT_PATIENCE
    while not condition():
        assert time.monotonic() < until
        act()
        time.sleep(.002)
