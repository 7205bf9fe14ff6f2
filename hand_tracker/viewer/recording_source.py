"""A recording as a source of the viewer: read and tracked as it plays, however long it is."""

import time
from collections import deque
from statistics import median
from threading import Lock

import numpy as np

from ..core.constraints import DEFAULT_CONSTRAINTS, constrained
from ..core.errors import HandTrackerError
from ..core.options import TrackerOptions
from ..core.tracker import HandTracker
from ..files.bags import open_bag
from ..tracking.compile_kernels import prepare_kernels
from ..tracking.recording import marker_topic, track

WARM_UP = 10.   # [s] that the tracker has seen of the recording before it is looked at
TIMED = 500     # updates of which the median is told


class Playhead:
    """Where a recording is played; any thread may steer it.

    Parameters
    ----------
    duration : float
        After which it begins again [s].

    Attributes
    ----------
    duration : float
    playing : bool
    there : bool
        That there is something to steer.
    """

    there = True

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


class TimedTracker(HandTracker):
    """A tracker that keeps how long its last updates took, `costs` [s]."""

    def __init__(self, *args):
        super().__init__(*args)
        self.costs = deque(maxlen=TIMED)

    def update(self, *args):
        """Return the hand for the next frame of markers."""
        start = time.perf_counter()
        state = super().update(*args)
        self.costs.append(time.perf_counter() - start)
        return state


class Stream:
    """A recording that is tracked on and on.

    Parameters
    ----------
    constraints : frozenset of str
        With which it is tracked.
    tracker : TimedTracker
    frames : iterator of TrackedFrame
        Of the tracker.

    Attributes
    ----------
    constraints : frozenset of str
    tracker : TimedTracker
    state : HandState or None
        None before the palm is seen.
    """

    def __init__(self, constraints, tracker, frames):
        self.constraints, self.tracker, self.state = constraints, tracker, None
        self._frames, self._next = frames, next(frames, None)
        self._now = None

    def reaches(self, time):
        """Return whether it comes to a time [ns] at once: later, but not by much."""
        return 0 <= time - self._now <= 1e9 * WARM_UP

    def go(self, time):
        """Go on to a time [ns]."""
        self._now = time
        while self._next is not None and self._next.time <= time:
            self.state, self._next = self._next.state, next(self._frames, None)


class Recording:
    """A recording of markers.

    Of the time before an instant the tracker knows the last `WARM_UP`, or what was played.

    Parameters
    ----------
    path : path-like
    hand : Hand
    layout : MarkerLayout
    topic : str, optional
    **reading
        Of `track`: labels, frame_id, scale, zero_is_missing.

    Attributes
    ----------
    hand : Hand
    constraints : frozenset of str
        Those of `CONSTRAINTS` that are on.
    playhead : Playhead
        Once it is prepared.
    """

    def __init__(self, path, hand, layout, topic=None, **reading):
        self.hand, self._layout = hand, layout
        self.constraints = DEFAULT_CONSTRAINTS
        self.playhead = None
        self._path, self._reading = path, reading
        self._shown = self._bare = None
        with open_bag(path) as bag:
            self._topic = marker_topic(bag, topic)
            self._start, self._end = bag.start, bag.start + bag.duration
            self._rate = (bag.counts[self._topic] - 1) / max(1e-9 * bag.duration, 1e-9)

    def prepare(self, say):
        """Find the hand in the recording; the very first time, kernels may be compiled.

        Parameters
        ----------
        say : callable
            Told in a line what it waits for.

        Raises
        ------
        HandTrackerError
            If nothing can be tracked in it.
        """
        say('Preparing')
        prepare_kernels(say)
        first = next(self._track(self._tracker(DEFAULT_CONSTRAINTS), self._start), None)
        if first is None or first.time >= self._end:
            raise HandTrackerError(f'{self._path}: nothing to show; expected frames in which the '
                                   "palm's three markers are seen together")
        self._start = first.time
        self.playhead = Playhead(1e-9 * (self._end - self._start))

    def _tracker(self, constraints):
        hand, options = constrained(self.hand, TrackerOptions(), constraints)
        return TimedTracker(hand, self._layout, options)

    def _track(self, tracker, start):
        with open_bag(self._path) as bag:
            yield from track(bag.messages([self._topic], start), tracker, **self._reading)

    def attend(self, looked_at, compared):
        """Do nothing: a recording is at hand as it is."""

    def constrain(self, constraints):
        """Track with these constraints from now on."""
        self.constraints = frozenset(constraints)

    def state(self):
        """Return the hand as it is now; None while the palm was not seen for `WARM_UP`."""
        self._shown = self._stream(self._shown, self.constraints)
        return self._shown.state

    def bare_state(self):
        """Return the hand as it is now without any constraint, or None as `state`."""
        self._bare = self._stream(self._bare, frozenset())
        return self._bare.state

    def _stream(self, stream, constraints):
        """Return what is tracked up to now: the given stream, unless it does not lead there."""
        now = self._start + round(1e9 * self.playhead.now())
        if stream is None or stream.constraints != constraints or not stream.reaches(now):
            tracker = self._tracker(constraints)
            start = max(self._start, now - round(1e9 * WARM_UP))
            stream = Stream(constraints, tracker, self._track(tracker, start))
        stream.go(now)
        return stream

    def numbers(self, state):
        """Return what is measured, as texts by name."""
        residuals = state.residuals[np.isfinite(state.residuals)]
        return {
            'rate': f'{self._rate:.0f} Hz',
            'tracking time': f'{1e6 * median(self._shown.tracker.costs):.0f} µs',
            'residual': f'{1e3 * residuals.mean():.2f} mm' if residuals.size else '–'}
