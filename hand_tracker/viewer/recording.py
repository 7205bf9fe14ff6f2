"""A recording as a source of the viewer: tracked whole, so that any instant is at hand."""

import time
from bisect import bisect_right
from statistics import median
from threading import Lock
from typing import NamedTuple

import numpy as np

from ..codec import MarkerReader
from ..constraints import DEFAULT, constrained
from ..core.errors import HandTrackerError
from ..core.jit import COMPILED
from ..core.tracker import HandTracker, TrackerOptions
from ..files.bags import open_bag
from ..labels import LabelMap
from ..marker_frame import FrameTime
from ..offline import marker_topic

KEPT = 4  # variants that stay tracked


class Playhead:
    """Where a recording is played; any thread may steer it.

    Parameters
    ----------
    duration : float
        After which it begins again [s].

    Attributes
    ----------
    playing : bool
    """

    def __init__(self, duration):
        self.duration = duration
        self.playing = True
        self._rate = 1.
        self._lock = Lock()
        self._position, self._then = 0., time.monotonic()

    def now(self):
        """Return where it is now [s]."""
        with self._lock:
            now = time.monotonic()
            if self.playing:
                self._position += self._rate * (now - self._then)
                self._position %= self.duration
            self._then = now
            return self._position

    def seek(self, position):
        """Go to a place [s]."""
        with self._lock:
            self._position, self._then = position, time.monotonic()

    def set_rate(self, rate):
        """Play so many times as fast as recorded."""
        self.now()
        self._rate = rate

    def toggle(self):
        """Pause or go on."""
        self.now()
        self.playing = not self.playing


class Tracked(NamedTuple):
    """A recording tracked with some constraints: times [s], states, cost of an update [s]."""

    times: list
    states: list
    cost: float


class Recording:
    """A recording of markers.

    Parameters
    ----------
    path : path-like
    hand : Hand
    layout : MarkerLayout
    topic : str, optional
    labels : LabelMap, optional
    frame_id, scale, zero_is_missing
        See `markers_from_message`.

    Attributes
    ----------
    hand : Hand
    constraints : frozenset of str
        Those of `CONSTRAINTS` that are on.
    playhead : Playhead
        Once it is prepared.
    """

    def __init__(self, path, hand, layout, topic=None, labels=None, frame_id='', scale=1.,
                 zero_is_missing=True):
        self.hand, self._layout = hand, layout
        self.constraints = DEFAULT
        self.playhead = None
        self._tracked = {}
        with open_bag(path) as bag:
            self._path = bag.path
            self._messages = list(bag.messages([marker_topic(bag, topic)]))
        self._how = (LabelMap() if labels is None else labels), frame_id, scale, zero_is_missing

    def prepare(self, say):
        """Read and track the recording; the very first time, kernels may be compiled.

        Parameters
        ----------
        say : callable
            Told in a line what it waits for.

        Raises
        ------
        HandTrackerError
            If nothing can be tracked in it.
        """
        say('Preparing; the very first time kernels are compiled for about a minute' if COMPILED
            else 'Preparing')
        read, clock = MarkerReader(*self._how).read, FrameTime()
        frames = [(1e-9 * message.time, read(message.data)) for message in self._messages]
        self._frames = [(received, clock.of(frame.stamp, received), frame.positions)
                        for received, frame in frames if frame.stamp is not None]
        times = self._track(self.constraints).times
        if len(times) < 2 or times[-1] <= times[0]:
            raise HandTrackerError(f'{self._path}: nothing to show; expected frames in which the '
                                   "palm's three markers are seen together")
        self.playhead = Playhead(times[-1] - times[0])
        self._rate = (len(times) - 1) / self.playhead.duration

    def _track(self, constraints):
        """Return the recording tracked with some constraints."""
        if constraints not in self._tracked:
            if len(self._tracked) == KEPT:
                del self._tracked[next(iter(self._tracked))]
            hand, options = constrained(self.hand, TrackerOptions(), constraints)
            tracker = HandTracker(hand, self._layout, options)
            times, states, costs = [], [], []
            for received, stamp, markers in self._frames:
                start = time.perf_counter()
                state = tracker.update(markers, stamp)
                costs.append(time.perf_counter() - start)
                if tracker.placed:
                    times.append(received)
                    states.append(state)
            # The median: the first update may have compiled the kernels.
            self._tracked[constraints] = Tracked(times, states, median(costs or [0.]))
        return self._tracked[constraints]

    def attend(self, looked_at, compared):
        """Do nothing: a recording is at hand as it is."""

    def constrain(self, constraints):
        """Track with these constraints from now on."""
        self.constraints = frozenset(constraints)

    def state(self):
        """Return the hand as it is now."""
        return self._at(self.constraints)

    def bare_state(self):
        """Return the hand as it is now without any constraint."""
        return self._at(frozenset())

    def _at(self, constraints):
        times, states, _ = self._track(constraints)
        return states[bisect_right(times, times[0] + self.playhead.now()) - 1]

    def numbers(self, state):
        """Return what is measured, as texts by name."""
        residuals = state.residuals[np.isfinite(state.residuals)]
        return {
            'rate': f'{self._rate:.0f} Hz',
            'tracking time': f'{1e6 * self._track(self.constraints).cost:.0f} µs',
            'residual': f'{1e3 * residuals.mean():.2f} mm' if residuals.size else '–'}
