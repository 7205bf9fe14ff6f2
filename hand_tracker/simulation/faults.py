"""Faults of a motion capture system: swapped labels, drop-outs, frozen markers, reflections.

Events are drawn in seconds, so that they do not depend on the frame rate.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..core.errors import HandTrackerError

# Least and greatest duration of an event [s]; unsourced.
SWAP_LENGTH = (.05, .5)
GHOST_LENGTH = (.02, .2)
DROPOUT_LENGTH = (.03, .3)
FROZEN_LENGTH = (.1, 1.)
MIRROR_HEIGHT = .80         # [m] of a reflecting table
FAULT_RATE_RANGE = (0., 50.)  # [1/s]


class InvalidFaults(HandTrackerError, ValueError):
    """A rate of faults is out of range."""


class Faults(NamedTuple):
    """Rates of each kind of fault.

    Attributes
    ----------
    swaps : float
        Exchanges of the labels of a marker and its nearest neighbour [1/s].
    ghosts : float
        Reflections in the table reported in place of the marker [1/s].
    dropouts : float
        Visible markers that are not reported [1/s].
    frozen : float
        Markers that keep reporting one position [1/s].
    """

    swaps: float = 0.
    ghosts: float = 0.
    dropouts: float = 0.
    frozen: float = 0.


class Event(NamedTuple):
    """Fault of one marker over an interval.

    Attributes
    ----------
    kind : {'swap', 'ghost', 'dropout', 'frozen'}
    marker : int
        Row of the marker.
    start, end : float
        [s]
    """

    kind: str
    marker: int
    start: float
    end: float


def fault_events(faults: Faults, duration: float, markers: int,
                 random: np.random.RandomState) -> list[Event]:
    """Draw the fault events of a recording from Poisson processes.

    Parameters
    ----------
    faults : Faults
    duration : float
        Of the recording [s].
    markers : int
        Number of markers.
    random : numpy.random.RandomState

    Returns
    -------
    list of Event

    Raises
    ------
    InvalidFaults
        Naming the rate, its value and the allowed range.
    """
    events = []
    for name, kind, lengths in (('swaps', 'swap', SWAP_LENGTH), ('ghosts', 'ghost', GHOST_LENGTH),
                                ('dropouts', 'dropout', DROPOUT_LENGTH),
                                ('frozen', 'frozen', FROZEN_LENGTH)):
        rate = getattr(faults, name)
        if not FAULT_RATE_RANGE[0] <= rate <= FAULT_RATE_RANGE[1]:
            raise InvalidFaults(f'{name}: {rate!r} per second; allowed is '
                                f'{FAULT_RATE_RANGE[0]:g} to {FAULT_RATE_RANGE[1]:g}')
        for start in np.sort(random.uniform(0., duration, random.poisson(rate * duration))):
            events.append(Event(kind, int(random.randint(markers)), start,
                                start + random.uniform(*lengths)))
    return events


def with_faults(positions: np.ndarray, truth: np.ndarray, times: np.ndarray,
                events: Sequence[Event], held: dict[Event, np.ndarray] | None = None) -> np.ndarray:
    """Apply fault events to measured markers.

    Parameters
    ----------
    positions : ndarray, shape (n, m, 3)
        Measured, NaN where not seen [m].
    truth : ndarray, shape (n, m, 3)
        True positions, for nearest neighbours and reflections [m].
    times : ndarray, shape (n,)
        [s]
    events : sequence of Event
    held : dict, optional
        Positions of frozen markers by event [m]; changed in place. Pass one dict to all blocks of
        a recording.

    Returns
    -------
    ndarray, shape (n, m, 3)
        Reported positions [m].
    """
    held = {} if held is None else held
    reported = positions.copy()
    for event in events:
        kind, marker, start, end = event
        first, last = np.searchsorted(times, (start, end))
        if first == last:
            continue
        part = slice(first, last)
        if kind == 'swap':
            gaps = np.linalg.norm(truth[first] - truth[first, marker], axis=1)
            gaps[marker] = np.inf
            pair = [marker, int(np.argmin(gaps))]
            reported[part, pair] = reported[part, pair[::-1]]
        elif kind == 'ghost':
            # The reflection is visible whether or not the marker itself is.
            image = truth[part, marker].copy()
            image[:, 2] = 2. * MIRROR_HEIGHT - image[:, 2]
            error = positions[part, marker] - truth[part, marker]
            reported[part, marker] = image + np.where(np.isfinite(error), error, 0.)
        elif kind == 'frozen':
            reported[part, marker] = held.setdefault(event, reported[first, marker].copy())
        else:
            reported[part, marker] = np.nan
    return reported
