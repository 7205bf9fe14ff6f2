"""The demo's recording without labels, as of a system that only sees points."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..files.bag_points import marker_messages
from ..files.bags import Bag, write_bag
from ..messages.cdr import MarkerReader
from .recording_options import WornHand

ANONYMOUS_RECORDING = 'anonymous.mcap'
SHUFFLE_SEED = 1

# Side and row of the marker that was at a place, by the bytes of its coordinates.
PointOwners = dict[bytes, tuple[str, int]]


def take_labels_off(bag: Bag, topic: str, hands: Sequence[WornHand], path: Path) -> PointOwners:
    """Write a recording whose markers are those of a bag, as points without labels.

    As from systems that follow points, each keeps its id as long as it is seen, and comes back
    with another.

    Parameters
    ----------
    bag : Bag
    topic : str
        Of its markers.
    hands : sequence of WornHand
        Whose markers are taken.
    path : Path
        To write.

    Returns
    -------
    PointOwners
        By which labels can be judged: a marker goes through a tracker unchanged.
    """
    readers = [MarkerReader(hand.labels) for hand in hands]
    times, frames = [], []
    owners: PointOwners = {}
    draws = np.random.default_rng(SHUFFLE_SEED)
    columns = np.zeros(0, dtype=int)   # that have the points, and behind them free ones
    was_seen = np.zeros(0, dtype=bool)
    for message in bag.messages([topic]):
        found = [reader.read(message.data).positions for reader in readers]
        for hand, positions in zip(hands, found):
            owners.update((place.tobytes(), (hand.hand.side, row))
                          for row, place in enumerate(positions) if np.isfinite(place).all())
        points = np.concatenate(found)
        is_seen = np.isfinite(points).all(axis=1)
        if not len(columns):
            columns, was_seen = draws.permutation(2 * len(points)), is_seen
        for row in np.flatnonzero(is_seen & ~was_seen):
            other = draws.integers(len(points), len(columns))
            columns[[row, other]] = columns[[other, row]]
        was_seen = is_seen
        frame = np.full((len(columns), 3), np.nan)
        frame[columns[:len(points)]] = points
        times.append(message.time)
        frames.append(frame)
    write_bag(path, marker_messages(np.array(frames), times, ('point',) * frames[0].shape[0]))
    return owners
