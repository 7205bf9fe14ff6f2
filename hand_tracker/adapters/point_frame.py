"""Frame of points: named markers and anonymous points of one instant, from any source."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..core.errors import HandTrackerError
from ..messages.stamps import Time
from .packet_structure import PacketOrigin

# Rows: x, y, z of a frame with z up in the source's axes, by its upward axis.
UPRIGHT = {'z': np.eye(3), 'y': np.array(((1., 0., 0.), (0., 0., -1.), (0., 1., 0.)))}


class MalformedFrame(HandTrackerError, ValueError):
    """A packet or message that holds no frame: which, where, what was expected."""


class SourceUnavailable(HandTrackerError):
    """A source cannot be opened: which, why, and what it takes."""


class SourceFrame(NamedTuple):
    """Points of one instant.

    Attributes
    ----------
    stamp : Time or None
        None where the source has no clock.
    frame_id : str
        Empty where the source does not say.
    names : tuple of str
        Names of the named markers: 'index', or with their subject 'RHand:index'.
    markers : ndarray, shape (len(names), 3)
        NaN where not seen [m].
    points : ndarray, shape (n, 3)
        Anonymous points, in any order [m].
    origin : PacketOrigin or None
        Where these numbers are in the packet that was read; None where that is not known.
    """

    stamp: Time | None
    frame_id: str
    names: tuple[str, ...]
    markers: np.ndarray
    points: np.ndarray
    origin: PacketOrigin | None = None


def point_frame(stamp: Time | None, frame_id: str, names: Sequence[str] = (),
                markers: ArrayLike = (), points: ArrayLike = ()) -> SourceFrame:
    """Return a `SourceFrame` of sequences of points.

    A marker without finite coordinates is NaN; such an anonymous point is left out.
    """
    named = np.array(markers, dtype=float).reshape(-1, 3)
    if not np.isfinite(named).all():
        named[~np.isfinite(named).all(axis=1)] = np.nan
    anonymous = np.array(points, dtype=float).reshape(-1, 3)
    if not np.isfinite(anonymous).all():
        anonymous = anonymous[np.isfinite(anonymous).all(axis=1)]
    return SourceFrame(stamp, frame_id, tuple(names), named, anonymous)


def of_subject(frame: SourceFrame, subject: str) -> SourceFrame:
    """Return a frame with the markers of one subject alone, all anonymous points among them.

    Parameters
    ----------
    frame : SourceFrame
    subject : str
        As in 'subject:marker'.
    """
    names, rows = _names_of_subject(frame.names, subject)
    origin = frame.origin and frame.origin.of_rows(rows)
    return frame._replace(names=names, markers=frame.markers[rows], origin=origin)


@lru_cache(1)
def _names_of_subject(names: tuple[str, ...], subject: str) -> tuple[tuple[str, ...], list[int]]:
    """Return the names of a subject's markers, and their rows."""
    rows = [row for row, name in enumerate(names) if name.startswith(f'{subject}:')]
    return tuple(names[row] for row in rows), rows


@lru_cache(1)
def subjects(names: tuple[str, ...]) -> tuple[str, ...]:
    """Return the subjects of markers' names."""
    return tuple(sorted({name.partition(':')[0] for name in names if ':' in name}))


def turned_upright(frame: SourceFrame, up: str) -> SourceFrame:
    """Return a frame with z up.

    Parameters
    ----------
    frame : SourceFrame
    up : str
        Its upward axis, one of `UPRIGHT`.
    """
    turn = UPRIGHT[up]
    origin = frame.origin and frame.origin._replace(turn=turn @ frame.origin.turn)
    return frame._replace(markers=frame.markers @ turn.T, points=frame.points @ turn.T,
                          origin=origin)
