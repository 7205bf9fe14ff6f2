"""How one hand's tracking fares, for diagnostics: a level, a line and values. No ROS."""

import enum
from typing import NamedTuple

import numpy as np

from ..core.model.marker_layout import MARKERS
from ..core.model.states import MarkerState, PalmState
from .statistics import Latency

PERIOD = 1.  # [s] over which the rate is counted
GAP = .1     # [s] at least between two changes that are told

TROUBLES = {
    MarkerState.STALE: 'stale', MarkerState.REJECTED: 'rejected', MarkerState.SWAPPED: 'swapped',
    MarkerState.ABSENT: 'never seen'}


class Level(enum.IntEnum):
    """Those of diagnostic_msgs/DiagnosticStatus, as REP 107 has them."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


class Status(NamedTuple):
    """How it fares.

    Attributes
    ----------
    level : Level
    text : str
    values : dict of str to str
    """

    level: Level
    text: str
    values: dict


class Diagnosis:
    """Follow the tracking of one hand.

    Parameters
    ----------
    now : float
        Of a clock that never jumps, as in every method [s].
    watch : Watch
    """

    def __init__(self, now, watch):
        self._watch = watch
        self._state = None
        self._frames = self._counted = self._passed = 0
        self._since = now
        self._rate = 0.  # [Hz]
        self._latency = Latency()
        self._timing = self._latency.summary()
        self._told, self._told_at = None, -np.inf

    def tracked(self, now, state, passed=0):
        """Note what the tracker made of frames.

        Parameters
        ----------
        now : float
        state : HandState
        passed : int, optional
            Frames that took the short way, of which this is the last; 0 for one that did not.

        Returns
        -------
        bool
            Whether something changed that is to be told at once.
        """
        self._frames += passed or 1
        self._passed += passed
        self._state = state
        return now - self._told_at >= GAP and self._summary(now) != self._told

    def published(self, received, now, stamp):
        """Note when a frame was published.

        Parameters
        ----------
        received, now : float
        stamp : float or None
            Of the frame [s].
        """
        self._latency.published(now - received, stamp)

    def status(self, now, publishers):
        """Return how it fares now.

        Parameters
        ----------
        now : float
        publishers : callable
            Returns a text on who publishes the markers; called when none come.

        Returns
        -------
        Status
        """
        self._told, self._told_at = self._summary(now), now
        if now - self._since >= .9 * PERIOD:
            self._rate = (self._frames - self._counted) / (now - self._since)
            self._counted, self._since = self._frames, now
            self._timing = self._latency.summary()
        watch, state = self._watch, self._state
        worn = [bool(label) for label in watch.labels.labels]
        level, text = self._judge(now, publishers, worn)
        values = {'palm': 'not seen yet', 'rate [Hz]': f'{self._rate:.1f}',
                  'frames': str(self._frames), 'frames direct': str(self._passed),
                  'mean residual [mm]': '',
                  **_timing(self._timing)}
        if state is not None:
            seen = state.residuals[np.isfinite(state.residuals)]
            values['palm'] = _words(state.palm)
            values['mean residual [mm]'] = f'{1e3 * seen.mean():.2f}' if seen.size else ''
        for slot, marker in enumerate(MARKERS):
            values[f'{marker} marker'] = _marker(state, slot) if worn[slot] else 'not worn'
        return Status(level, text, values)

    def _summary(self, now):
        states = None if self._state is None else self._state.marker_states.tobytes()
        return self._watch.situation(now), states

    def _judge(self, now, publishers, worn):
        situation = self._watch.situation(now)
        text = self._watch.describe(now, situation, publishers)
        if situation in (None, 'silent'):
            return Level.STALE, text
        if situation == 'off':
            return Level.WARN, text
        if situation is not PalmState.TRACKED:
            return Level.ERROR, text
        troubles = [f'{text}: {", ".join(markers)}' for kind, text in TROUBLES.items()
                    if (markers := [MARKERS[slot] for slot in np.flatnonzero(
                        worn & (self._state.marker_states == kind))])]
        return Level.WARN if troubles else Level.OK, '; '.join([text, *troubles])


def _timing(timing):
    times = {'p50': timing.p50, 'p99': timing.p99, 'max': timing.longest}
    return {**{f'latency {name} [ms]': f'{1e3 * time:.3f}' if np.isfinite(time) else ''
               for name, time in times.items()},
            'frames late': str(timing.late), 'frames dropped': str(timing.dropped)}


def _marker(state, slot):
    if state is None:
        return _words(MarkerState.ABSENT)
    words, hidden_for = _words(MarkerState(state.marker_states[slot])), state.hidden_for[slot]
    return f'{words} for {hidden_for:.2f} s' if hidden_for else words


def _words(state):
    return state.name.lower().replace('_', ' ')
