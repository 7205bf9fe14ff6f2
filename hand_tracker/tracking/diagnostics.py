"""The status of one hand's tracking for /diagnostics: a level, a line and values (REP 107)."""

from __future__ import annotations

import enum
import math
from collections import deque
from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np

from ..core.model.states import MarkerState, PalmState
from ..core.pose.report import mean_residual
from ..core.tracker import HandState
from .fit_check import BAD_FIT_RESIDUAL, FAR_OFF_AFTER
from .input_monitor import PALM_FAULTS, SLOW_LABELLING, InputMonitor, StateRun

STATUS_PERIOD = 1.  # [s] over which the rate is counted
STATUS_GAP = .1     # [s] at least between two changes that are published
FRAMES_KEPT = 10_000  # between two summaries of latency
STAMP_GAP = 1.      # [s] between two stamps that counts as a pause, not as lost frames
EVEN_STEP = .25     # [median steps] that even stamps may be off whole ones
EVEN_SHARE = .75    # of the steps that may not be more, at least
FEW_GAPS = 2        # in `STATUS_PERIOD`, of any length
QUIET_AFTER = 1.    # [s] without markers before the tracking is no longer fine

MARKER_TROUBLES = {
    MarkerState.STALE: 'stale', MarkerState.REJECTED: 'rejected', MarkerState.SWAPPED: 'swapped',
    MarkerState.ABSENT: 'never seen'}


class Level(enum.IntEnum):
    """Severity levels of diagnostic_msgs/DiagnosticStatus (REP 107)."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


class Status(NamedTuple):
    """Status of the tracking, or of another task.

    Attributes
    ----------
    level : Level
    text : str
    values : dict of str to str
    """

    level: Level
    text: str
    values: dict[str, str]


class LatencySummary(NamedTuple):
    """Latency of the frames since the last summary, and counts since the start.

    Attributes
    ----------
    p50, p99, longest : float
        From receipt to published, NaN where there was no frame [s].
    late : int
        Frames that took longer than the time between two.
    dropped : int
        Frames that never came, by the stamps of the others.
    """

    p50: float
    p99: float
    longest: float
    late: int
    dropped: int


class LatencyStatistics:
    """Collect the times of frames; all arithmetic waits for the summary."""

    def __init__(self) -> None:
        self._latencies: deque[float] = deque(maxlen=FRAMES_KEPT)
        self._times: deque[float] = deque(maxlen=FRAMES_KEPT)
        self._late = self._dropped = self._left_out = 0

    def add(self, latency: float, time: float | None) -> None:
        """Add a frame.

        Parameters
        ----------
        latency : float
            From receipt to published [s].
        time : float or None
            Of its stamp [s].
        """
        self._latencies.append(latency)
        if time is not None:
            self._times.append(time)

    def left_out(self, count: int) -> None:
        """Count received frames that were not tracked, which are not dropped ones."""
        self._left_out += count

    def summary(self) -> LatencySummary:
        """Return the statistics of the frames since the last summary."""
        latencies = np.array(self._latencies)
        steps = np.diff(np.array(self._times))
        forward = steps[steps > 0.]
        if forward.size:
            step = np.median(forward)
            self._late += int((latencies > step).sum())
            self._dropped += max(0, _missing(forward[forward < STAMP_GAP] / step) - self._left_out)
            self._left_out = 0
        self._latencies.clear()
        # The last stamp stays, as frames may be lost after it.
        for _ in range(len(self._times) - 1):
            self._times.popleft()
        p50, p99, longest = (np.percentile(latencies, (50, 99, 100)).tolist() if latencies.size
                             else (np.nan,) * 3)
        return LatencySummary(p50, p99, longest, self._late, self._dropped)


def _missing(periods: np.ndarray) -> int:
    """Return how many frames are missing by the steps of stamps, (n,), in median steps.

    0 where the stamps are of no even rate: of bursts, or as irregular as a network's delays.
    """
    whole = np.round(periods)
    is_even = (np.abs(periods - whole) <= EVEN_STEP).sum() >= EVEN_SHARE * len(periods)
    missing = (whole - 1.).clip(0)
    # Bursts have more gaps than an outage or two, wider than all else.
    is_likely = missing.sum() <= len(periods) or (missing > 0.).sum() <= FEW_GAPS
    return int(missing.sum()) if is_even and is_likely else 0


class Diagnostics:
    """Collect the status of one hand's tracking.

    Parameters
    ----------
    now : float
        Of a clock that never jumps, as in every method [s].
    input_monitor : InputMonitor

    Attributes
    ----------
    latency : LatencyStatistics
        Of the frames, added by the caller.
    size : str
        How far the hand's size is learned, as of `Stream.size`.
    calibration : dict of str to str
        How far a calibration is, as of `LiveCalibration.values`.
    """

    def __init__(self, now: float, input_monitor: InputMonitor) -> None:
        self._input = input_monitor
        self.size = 'given'
        self.calibration: dict[str, str] = {}
        self._state: HandState | None = None
        # Troubles of the palm and of each marker that came since the last status.
        self._passed: set[PalmState | tuple[int, int]] = set()
        self._last_passed: set[PalmState | tuple[int, int]] = set()  # of the last one
        self._frames = self._counted = self._on_fast_path = self._left_out = 0
        self._since = now
        self._rate = 0.  # [Hz]
        self.latency = LatencyStatistics()
        self._last_latency = self.latency.summary()
        self._last_summary: object = None
        self._last_status = -np.inf

    def left_out(self, count: int) -> None:
        """Count frames that were left out, as newer ones had come before they could be tracked."""
        self._left_out += count
        self.latency.left_out(count)

    def tracked(self, now: float, state: HandState, count: int, on_fast_path: bool,
                runs: Iterable[tuple[float, StateRun | HandState]] = ()) -> bool:
        """Add the results of consecutive frames.

        Parameters
        ----------
        now : float
            On a clock that never jumps [s].
        state : HandState
            After the last of them.
        count : int
        on_fast_path : bool
        runs : iterable of (float, StateRun or HandState), optional
            Of `TrackedFrames`: states that were there for some of the frames only.

        Returns
        -------
        bool
            Whether the status has changed, so that it is to be published before `STATUS_PERIOD`
            is over.
        """
        self._frames += count
        self._on_fast_path += count if on_fast_path else 0
        self._state = state
        for _, run in runs:
            if run.palm in PALM_FAULTS:
                self._passed.add(run.palm)
            self._passed.update((slot, kind) for slot, kind in enumerate(run.marker_states.tolist())
                                if kind in MARKER_TROUBLES)
        return now - self._last_status >= STATUS_GAP and (
            self._summary(now) != self._last_summary or not self._passed <= self._last_passed)

    def status(self, now: float, publishers: Callable[[], str | None]) -> Status:
        """Return the status.

        Parameters
        ----------
        now : float
            On a clock that never jumps [s].
        publishers : callable
            Returns a text on who publishes the markers; called when none come.

        Returns
        -------
        Status
        """
        self._last_summary, self._last_status = self._summary(now), now
        if now - self._since >= .9 * STATUS_PERIOD:
            self._rate = (self._frames - self._counted) / (now - self._since)
            self._counted, self._since = self._frames, now
            self._last_latency = self.latency.summary()
        state = self._state
        worn = [bool(label) for label in self._input.labels.labels]
        level, text = self._level(now, publishers, worn)
        values = {'palm': 'not seen yet', 'rate [Hz]': f'{self._rate:.1f}',
                  'frames': str(self._frames), 'frames on fast path': str(self._on_fast_path),
                  'frames left out': str(self._left_out), 'hand size': self.size,
                  **self.calibration, 'mean residual [mm]': '',
                  **_latency_values(self._last_latency)}
        # What was so before the markers ended is not so now.
        before = 'last ' if self._input.situation(now) in ('silent', 'unlabelled') else ''
        if state is not None:
            values['palm'] = before + _words(state.palm)
            values['mean residual [mm]'] = _number(1e3 * mean_residual(state.residuals), 2)
            values['palm'] += _passing(
                palm for palm in PALM_FAULTS if palm in self._passed and palm is not state.palm)
        for slot, marker in enumerate(self._input.labels.names):
            value = _marker(state, slot) if worn[slot] else 'not worn'
            if state is not None and worn[slot]:
                value = before + value + _passing(
                    kind for kind in MARKER_TROUBLES if (slot, kind) in self._passed
                    and kind != state.marker_states[slot])
            values[f'{marker} marker'] = value
        self._last_passed, self._passed = self._passed, set()
        return Status(level, text, values)

    def _summary(self, now: float) -> object:
        states = None if self._state is None else self._state.marker_states.tobytes()
        return (self._input.situation(now), states,
                self._input.fit.far_off_for >= FAR_OFF_AFTER)

    def _level(self, now: float, publishers: Callable[[], str | None],
               worn: list[bool]) -> tuple[Level, str]:
        situation = self._input.situation(now)
        text = self._input.describe(now, situation, publishers)
        if situation in (None, 'silent'):
            return Level.STALE, text
        if situation == 'slow':
            return Level.WARN, text
        if situation is not PalmState.TRACKED:
            if self._input.why_not_found and situation in (PalmState.LOST, PalmState.WAITING):
                text += f'; {self._input.why_not_found}'
            return Level.ERROR, text
        assert self._state is not None
        troubles = [f'{text}: {", ".join(markers)}' for kind, text in MARKER_TROUBLES.items()
                    if (markers := [self._input.labels.names[slot] for slot in np.flatnonzero(
                        worn & (self._state.marker_states == kind))])]
        if (quiet := self._input.quiet_for(now)) > QUIET_AFTER:
            troubles.append(f'no markers for {quiet:.1f} s')
        if self._input.awaits_labelling:
            troubles.append(SLOW_LABELLING)
        if self._input.label_doubt is not None:
            troubles.append(self._input.label_doubt)
        if self._input.fit.far_off_for >= FAR_OFF_AFTER:
            troubles.append(f'{1e3 * self._input.fit.residual:.0f} mm off the hand')
        if self._input.fit.misfit > BAD_FIT_RESIDUAL:
            troubles.append(f'{1e3 * self._input.fit.misfit:.1f} mm off the hand on average')
        return Level.WARN if troubles else Level.OK, '; '.join([text, *troubles])


def _latency_values(latency: LatencySummary) -> dict[str, str]:
    times = {'p50': latency.p50, 'p99': latency.p99, 'max': latency.longest}
    return {**{f'latency {name} [ms]': _number(1e3 * time, 3) for name, time in times.items()},
            'frames late': str(latency.late), 'frames dropped': str(latency.dropped)}


def _number(value: float, decimals: int) -> str:
    return '' if math.isnan(value) else f'{value:.{decimals}f}'


def _marker(state: HandState | None, slot: int) -> str:
    if state is None:
        return _words(MarkerState.ABSENT)
    words, hidden_for = _words(MarkerState(state.marker_states[slot])), state.hidden_for[slot]
    return f'{words} for {hidden_for:.2f} s' if hidden_for else words


def _passing(states: Iterable[enum.Enum]) -> str:
    """Return the text added to a value: states that have come and gone since the last status."""
    words = ' and '.join(map(_words, states))
    return f', {words} since the last status' if words else ''


def _words(state: enum.Enum) -> str:
    return state.name.lower().replace('_', ' ')
