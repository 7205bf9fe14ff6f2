"""What goes wrong between camera system and tracker: labels swap, drop out, freeze, find ghosts.

Events are drawn in seconds: the same happens at whatever rate the hand is sampled.
"""

from typing import NamedTuple

import numpy as np

from ..core.errors import HandTrackerError

# Unsourced: how long an event lasts [s].
SWAP_LENGTH = (.05, .5)
GHOST_LENGTH = (.02, .2)
DROPOUT_LENGTH = (.03, .3)
FROZEN_LENGTH = (.1, 1.)
MIRROR_HEIGHT = .80   # [m] of the table that reflects the lights
RATE_RANGE = (0., 50.)


class InvalidFaults(HandTrackerError, ValueError):
    """A rate of faults is not allowed."""


class Faults(NamedTuple):
    """How often labels go wrong.

    Attributes
    ----------
    swaps : float
        A marker and the one nearest to it exchange labels [1/s].
    ghosts : float
        A marker's reflection in the table is taken for it [1/s].
    dropouts : float
        A marker is not reported though it is seen [1/s].
    frozen : float
        A marker is reported where it was, to the last bit [1/s].
    """

    swaps: float = 0.
    ghosts: float = 0.
    dropouts: float = 0.
    frozen: float = 0.


class Event(NamedTuple):
    """What befalls one marker for a while: 'swap', 'ghost', 'dropout', 'frozen'; times in [s]."""

    kind: str
    marker: int
    start: float
    end: float


def fault_events(faults, duration, markers, random):
    """Return when which marker suffers what.

    Parameters
    ----------
    faults : Faults
    duration : float
        [s]
    markers : int
    random : numpy.random.RandomState

    Returns
    -------
    list of Event

    Raises
    ------
    InvalidFaults
        Naming the rate, its value and what is allowed.
    """
    events = []
    for name, kind, lengths in (('swaps', 'swap', SWAP_LENGTH), ('ghosts', 'ghost', GHOST_LENGTH),
                                ('dropouts', 'dropout', DROPOUT_LENGTH),
                                ('frozen', 'frozen', FROZEN_LENGTH)):
        rate = getattr(faults, name)
        if not RATE_RANGE[0] <= rate <= RATE_RANGE[1]:
            raise InvalidFaults(f'{name}: {rate!r} per second; allowed is '
                                f'{RATE_RANGE[0]:g} to {RATE_RANGE[1]:g}')
        for start in np.sort(random.uniform(0., duration, random.poisson(rate * duration))):
            events.append(Event(kind, int(random.randint(markers)), start,
                                start + random.uniform(*lengths)))
    return events


def with_faults(positions, truth, times, events, held=None):
    """Return what is reported of measured markers.

    Parameters
    ----------
    positions : ndarray, shape (n, m, 3)
        Measured, NaN where not seen [m].
    truth : ndarray, shape (n, m, 3)
        True places, which tell which markers are near each other [m].
    times : ndarray, shape (n,)
        [s]
    events : sequence of Event
    held : dict, optional
        Where frozen markers are, by their events: what one part of a recording hands on to the
        next [m].

    Returns
    -------
    ndarray, shape (n, m, 3)
        [m]
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
            # The mirror image shows whether or not the light itself is seen.
            image = truth[part, marker].copy()
            image[:, 2] = 2. * MIRROR_HEIGHT - image[:, 2]
            error = positions[part, marker] - truth[part, marker]
            reported[part, marker] = image + np.where(np.isfinite(error), error, 0.)
        elif kind == 'frozen':
            reported[part, marker] = held.setdefault(event, reported[first, marker].copy())
        else:
            reported[part, marker] = np.nan
    return reported
