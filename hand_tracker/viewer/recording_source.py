"""A recording as the viewer's source of frames: read and tracked while it plays."""

import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from math import isfinite
from os import PathLike
from statistics import median
from threading import Lock
from typing import Any, cast

from ..core.constraints import DEFAULT_CONSTRAINTS, constrained
from ..core.errors import HandTrackerError
from ..core.model.hand import Hand
from ..core.model.marker_layout import MarkerLayout
from ..core.options import TrackerOptions
from ..core.pose.report import mean_residual
from ..core.tracker import HandState, HandTracker
from ..files.bags import BagMessage
from ..tracking.compile_kernels import prepare_kernels
from ..tracking.opened_recording import open_recording
from ..tracking.point_bag import PointBag
from ..tracking.point_labels import PointLabels
from ..tracking.recording import (
    USUAL_READING,
    MarkerReading,
    RecordedFrame,
    marker_topic,
    track,
)

LEAD_IN = 10.         # [s] of the recording, tracked before a shown frame
TIMED_UPDATES = 500   # over which the median time is shown


class Playhead:
    """Playback position of a recording, looped; thread-safe.

    Parameters
    ----------
    duration : float
        Of the recording [s].

    Attributes
    ----------
    duration : float
    playing : bool
    there : bool
        Always True: playback can be controlled.
    """

    there = True

    def __init__(self, duration: float) -> None:
        self.duration = duration
        self.playing = True
        self._rate = 1.
        self._lock = Lock()
        self._position, self._then = 0., time.monotonic()

    def now(self) -> float:
        """Return the current position [s]."""
        with self._lock:
            now = time.monotonic()
            if self.playing:
                self._position += self._rate * (now - self._then)
                self._position %= self.duration
            self._then = now
            return self._position

    def seek(self, position: float) -> None:
        """Jump to a position [s]."""
        with self._lock:
            self._position, self._then = position, time.monotonic()

    def set_rate(self, rate: float) -> None:
        """Set the playback speed, relative to the recording [1]."""
        self.now()
        self._rate = rate

    def toggle(self) -> None:
        """Pause or resume."""
        self.now()
        self.playing = not self.playing


class TimedTracker(HandTracker):
    """A tracker that measures its last updates: `durations` [s]."""

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self.durations: deque[float] = deque(maxlen=TIMED_UPDATES)

    def update(self, *args: Any) -> HandState:
        """Return the hand for the next frame of markers."""
        start = time.perf_counter()
        state = super().update(*args)
        self.durations.append(time.perf_counter() - start)
        return state


class TrackingRun:
    """Continuous tracking of a recording, up to a given time.

    Parameters
    ----------
    constraints : frozenset of str
        Active ones of `CONSTRAINTS`.
    tracker : TimedTracker
    frames : iterator of RecordedFrame
        Of the tracker.

    Attributes
    ----------
    constraints : frozenset of str
    tracker : TimedTracker
    state : HandState or None
        None before the palm is seen.
    """

    def __init__(self, constraints: frozenset[str], tracker: TimedTracker,
                 frames: Iterator[RecordedFrame]) -> None:
        self.constraints, self.tracker = constraints, tracker
        self.state: HandState | None = None
        self._frames, self._next = frames, next(frames, None)
        self._now: int | None = None

    def reaches(self, time: int) -> bool:
        """Test whether a time [ns] is at most `LEAD_IN` ahead."""
        return self._now is not None and 0 <= time - self._now <= 1e9 * LEAD_IN

    def go(self, time: int) -> None:
        """Track up to a time [ns]."""
        self._now = time
        while self._next is not None and self._next.time <= time:
            self.state, self._next = self._next.state, next(self._frames, None)


class PlayedRecording:
    """A recording that plays: what the hands that are shown of it have in common.

    Parameters
    ----------
    path : path-like or PointBag
        See `open_recording`.
    topic : str, optional
    partial : bool, optional
        As in `open_bag`.

    Attributes
    ----------
    name : Path
    start, end : int
        From the first shown frame on, once it plays [ns].
    rate : float
        Of the frames [Hz].
    playhead : Playhead or None
        None before it plays.
    hands : list of ViewerRecording
    """

    def __init__(self, path: str | PathLike[str] | PointBag, topic: str | None = None,
                 partial: bool = False) -> None:
        self.playhead: Playhead | None = None
        self.hands: list[ViewerRecording] = []
        self._path, self._partial = path, partial
        with open_recording(path, partial=partial) as bag:
            self.name = bag.path
            self._topic = marker_topic(bag, topic)
            self.start, self.end = bag.start, bag.start + bag.duration
            self.rate = (bag.counts[self._topic] - 1) / max(1e-9 * bag.duration, 1e-9)

    def play_from(self, start: int) -> None:
        """Play from a time on, in a loop [ns]."""
        self.start = start
        self.playhead = Playhead(1e-9 * (self.end - start))

    def messages(self, start: int) -> Iterator[BagMessage]:
        """Iterate over the markers from a time on [ns]."""
        with open_recording(self._path, partial=self._partial) as bag:
            yield from bag.messages([self._topic], start)


class ViewerRecording:
    """A hand of a recording of markers, tracked while it plays.

    After a jump, the `LEAD_IN` before the new position is tracked first.

    Parameters
    ----------
    played : PlayedRecording
    hand : Hand
    layout : MarkerLayout
    reading : MarkerReading, optional
    beside : ViewerRecording, optional
        The other hand of the same recording, which is shown too.

    Attributes
    ----------
    hand : Hand
    layout : MarkerLayout
    constraints : frozenset of str
        Active ones of `CONSTRAINTS`.
    beside : ViewerRecording or None
    """

    def __init__(self, played: PlayedRecording, hand: Hand, layout: MarkerLayout,
                 reading: MarkerReading = USUAL_READING,
                 beside: 'ViewerRecording | None' = None) -> None:
        self.hand, self.layout, self.beside = hand, layout, beside
        self.constraints = DEFAULT_CONSTRAINTS
        self._played, self._reading = played, reading
        self._shown: TrackingRun | None = None
        self._bare: TrackingRun | None = None
        played.hands.append(self)

    @property
    def playhead(self) -> Any:
        """The `Playhead` of the recording, which both hands share; None before `prepare`."""
        return self._played.playhead

    def prepare(self, say: Callable[[str], None]) -> None:
        """Find the hand in the recording; the very first time, kernels may be compiled.

        Parameters
        ----------
        say : callable
            Called with a line of text about what is waited for.

        Raises
        ------
        HandTrackerError
            If no frame of it can be tracked.
        """
        say('Preparing')
        prepare_kernels(say, not self._reading.has_labels)
        played = self._played
        first = next(self._track(self._tracker(DEFAULT_CONSTRAINTS), played.start), None)
        if first is None or first.time >= played.end:
            raise HandTrackerError(f'{played.name}: nothing to show; expected frames in which the '
                                   "palm's three markers are seen together")
        if self.beside is not None:
            self.beside.prepare(say)
        # Both at one time, whichever is seen first.
        played.play_from(first.time)

    def _tracker(self, constraints: frozenset[str]) -> TimedTracker:
        hand, options = constrained(self.hand, TrackerOptions(), constraints)
        return TimedTracker(hand, self.layout, options)

    def _track(self, tracker: TimedTracker, start: int) -> Iterator[RecordedFrame]:
        return track(self._played.messages(start), tracker, self._reading,
                     point_labels=self._point_labels())

    def _point_labels(self) -> PointLabels:
        """Return what labels points without labels, of the other hand too."""
        labels = PointLabels()
        for other in () if self._reading.has_labels else self._played.hands:
            if other is not self:
                labels.set_hand(other.hand, other.layout, self._reading.point_reader())
        return labels

    def set_demand(self, looked_at: bool, compared: bool) -> None:
        """Do nothing: a recording needs no subscription."""

    def constrain(self, constraints: Iterable[str]) -> None:
        """Set the active constraints."""
        self.constraints = frozenset(constraints)
        if self.beside is not None:
            self.beside.constrain(self.constraints)

    def state(self) -> HandState | None:
        """Return the current hand; None if the palm was not seen within `LEAD_IN`."""
        self._shown = self._run(self._shown, self.constraints)
        return self._shown.state

    def bare_state(self) -> HandState | None:
        """Return the current hand tracked without constraints, or None as `state`."""
        self._bare = self._run(self._bare, frozenset())
        return self._bare.state

    def calibration(self) -> None:
        """Return None: nobody moves a hand for a calibration here."""

    def _run(self, run: TrackingRun | None, constraints: frozenset[str]) -> TrackingRun:
        """Return a run tracked up to now: the given one if it can continue, else a new one."""
        now = self._played.start + round(1e9 * self.playhead.now())
        if run is None or run.constraints != constraints or not run.reaches(now):
            tracker = self._tracker(constraints)
            start = max(self._played.start, now - round(1e9 * LEAD_IN))
            run = TrackingRun(constraints, tracker, self._track(tracker, start))
        run.go(now)
        return run

    def numbers(self, state: HandState) -> dict[str, str]:
        """Return rate, tracking time and residual as texts, by name."""
        residual = mean_residual(state.residuals)
        shown = cast(TrackingRun, self._shown)    # of that state
        return {
            'rate': f'{self._played.rate:.0f} Hz',
            'tracking time': f'{1e6 * median(shown.tracker.durations):.0f} µs',
            'residual': f'{1e3 * residual:.2f} mm' if isfinite(residual) else '–'}


def viewed_hands(path: str | PathLike[str] | PointBag,
                 hands: Sequence[tuple[Hand, MarkerLayout, MarkerReading]],
                 topic: str | None = None) -> ViewerRecording:
    """Return the hand of a recording for the viewer, the other one beside it.

    Parameters
    ----------
    path : path-like or PointBag
        See `open_recording`.
    hands : sequence of (Hand, MarkerLayout, MarkerReading)
        One, or the right and the left one.
    topic : str, optional

    Returns
    -------
    ViewerRecording
    """
    first, *others = hands
    played = PlayedRecording(path, topic, partial=first[2].partial)
    return ViewerRecording(played, *first, *(ViewerRecording(played, *one) for one in others))
