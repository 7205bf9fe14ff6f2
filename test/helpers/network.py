"""Networks of their own for some of a test's nodes, and a bad cable between two of them."""

import ctypes
import fcntl
import heapq
import os
import random
import selectors
import shutil
import struct
import subprocess
import time
from contextlib import contextmanager
from itertools import count
from threading import Event, Thread

NEW_NETWORK = 0x40000000        # CLONE_NEWNET of sched.h
TUNSETIFF, TAP = 0x400454ca, 0x1002  # of if_tun.h; frames without a header
MOST_DELAY = .02  # [s]


def lack():
    """Return what is missing for networks of their own, '' where nothing is."""
    if not hasattr(os, 'geteuid') or os.geteuid():
        return 'only root makes network namespaces'
    if shutil.which('ip') is None:
        return 'needs ip (iproute2)'
    if not os.access('/dev/net/tun', os.W_OK):
        return 'needs /dev/net/tun'
    return ''


def _enter(network):
    """Move this thread, and what it starts from now on, to a network."""
    _succeed(ctypes.CDLL(None, use_errno=True).setns(network, NEW_NETWORK))


def _succeed(result):
    if result:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))


class Network:
    """A network namespace with one end of a cable; what starts in its context is in it.

    Parameters
    ----------
    address : str
        IPv4 of that end.
    """

    def __init__(self, address):
        self._outside = os.open('/proc/thread-self/ns/net', os.O_RDONLY)
        _succeed(ctypes.CDLL(None, use_errno=True).unshare(NEW_NETWORK))
        try:
            self._inside = os.open('/proc/thread-self/ns/net', os.O_RDONLY)
            self.end = os.open('/dev/net/tun', os.O_RDWR | os.O_NONBLOCK)
            fcntl.ioctl(self.end, TUNSETIFF, struct.pack('16sH22x', b'cable', TAP))
            for words in ('link set lo up', f'addr add {address}/24 dev cable',
                          'link set cable up'):
                subprocess.run(['ip', *words.split()], check=True)
        finally:
            _enter(self._outside)

    def __enter__(self):
        _enter(self._inside)

    def __exit__(self, *error):
        _enter(self._outside)

    def close(self):
        """Give it back to the system, once nothing is in it any more."""
        for file in (self.end, self._inside, self._outside):
            os.close(file)


class Cable:
    """A cable that loses packets of some and brings others late, so out of order.

    Parameters
    ----------
    ends : sequence of int
        Two files of frames.

    Attributes
    ----------
    loss, lateness : float
        Shares of packets that are lost, and of those carried that are late; 0 at first.
    carried, lost, late : int
        Packets so far.
    """

    def __init__(self, ends):
        self.loss = self.lateness = 0.
        self.carried = self.lost = self.late = 0
        self._other = dict(zip(ends, reversed(ends)))
        self._cut = Event()
        self._thread = Thread(target=self._carry, daemon=True)
        self._thread.start()

    def _carry(self):
        rng, numbers, waiting = random.Random(1), count(), []
        with selectors.DefaultSelector() as selector:
            for end in self._other:
                selector.register(end, selectors.EVENT_READ)
            while not self._cut.is_set():
                for key, _ in selector.select(.001 if waiting else .1):
                    packet, due = os.read(key.fd, 2**16), time.monotonic()
                    if rng.random() < self.loss:
                        self.lost += 1
                        continue
                    self.carried += 1
                    if rng.random() < self.lateness:
                        self.late += 1
                        due += rng.uniform(0., MOST_DELAY)
                    heapq.heappush(waiting, (due, next(numbers), self._other[key.fd], packet))
                while waiting and waiting[0][0] <= time.monotonic():
                    _, _, end, packet = heapq.heappop(waiting)
                    os.write(end, packet)

    def cut(self):
        """Carry nothing any more."""
        self._cut.set()
        self._thread.join()


@contextmanager
def connected_networks():
    """Yield two networks and the cable between them."""
    networks = [Network('10.77.0.1'), Network('10.77.0.2')]
    cable = Cable([network.end for network in networks])
    try:
        yield *networks, cable
    finally:
        cable.cut()
        for network in networks:
            network.close()
