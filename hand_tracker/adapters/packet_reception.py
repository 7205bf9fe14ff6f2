"""Receive a system's packets from sockets, or by a `Relay` that also reads them."""

from __future__ import annotations

import os
import selectors
from collections.abc import Sequence
from time import monotonic_ns
from typing import NamedTuple, Protocol

MOST_AT_ONCE = 2**16   # [bytes], a packet of UDP at least


class ReceivedPacket(NamedTuple):
    """Bytes that were received.

    Attributes
    ----------
    data : bytes
    received : int
        When, of the monotonic clock [ns].
    is_relayed : bool
        Whether they are a packet that was read by its `PacketOrigin` alone: nothing is left to do.
    """

    data: bytes
    received: int
    is_relayed: bool


class Relay(Protocol):
    """Interface of receivers that may process a client's packets, by their `PacketOrigin` alone."""

    def __call__(self, sockets: Sequence[int], timeout: float,
                 is_stream: bool = False) -> Sequence[ReceivedPacket] | None:
        """Wait for bytes on one of some sockets.

        Parameters
        ----------
        sockets : sequence of int
            Their file descriptors.
        timeout : float
            After which nothing is returned [s].
        is_stream : bool, optional
            Whether packets come one after the other, the next one from its first byte on, each
            beginning with its size in four bytes.

        Returns
        -------
        sequence of ReceivedPacket or None
            None where it cannot receive now, and did not wait.
        """


def receive(selector: selectors.BaseSelector, timeout: float, relay: Relay | None = None,
            is_stream: bool = False) -> Sequence[ReceivedPacket]:
    """Return what comes next on the sockets of a selector, nothing after a timeout.

    Parameters
    ----------
    selector : selectors.BaseSelector
    timeout : float
        [s]
    relay : Relay, optional
        Asked first.
    is_stream : bool, optional
        See `Relay`.
    """
    if relay is not None:
        packets = relay([key.fd for key in selector.get_map().values()], timeout, is_stream)
        if packets is not None:
            return packets
    return [ReceivedPacket(os.read(key.fd, MOST_AT_ONCE), monotonic_ns(), False)
            for key, _ in selector.select(timeout)]
