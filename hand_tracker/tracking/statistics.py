"""Statistics over frames: latency, late and dropped frames, and how well markers fit the hand."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

FRAMES_KEPT = 10_000  # between two summaries
STAMP_GAP = 1.        # [s] between two stamps that counts as a pause, not as lost frames
FIT_STEP = .1         # [s] that a frame counts for at most: a pause tells nothing of the fit


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
        """Note frames that came and were not tracked: they are not dropped."""
        self._left_out += count

    def summary(self) -> LatencySummary:
        """Return the statistics of the frames since the last summary."""
        latencies = np.array(self._latencies)
        steps = np.diff(np.array(self._times))
        forward = steps[steps > 0.]
        if forward.size:
            step = np.median(forward)
            self._late += int((latencies > step).sum())
            whole = forward[forward < STAMP_GAP]
            missing = int((np.round(whole / step) - 1.).clip(0).sum())
            self._dropped += max(0, missing - self._left_out)
            self._left_out = 0
        self._latencies.clear()
        # The last stamp stays, as frames may be lost after it.
        for _ in range(len(self._times) - 1):
            self._times.popleft()
        p50, p99, longest = (np.percentile(latencies, (50, 99, 100)).tolist() if latencies.size
                             else (np.nan,) * 3)
        return LatencySummary(p50, p99, longest, self._late, self._dropped)


class FitStatistics:
    """The mean residual of the seen markers over seconds of tracking."""

    def __init__(self) -> None:
        self._last: float | None = None
        self._reset()

    def _reset(self) -> None:
        self._seconds = self._total = 0.

    def add(self, now: float, residual: float) -> None:
        """Add a frame.

        Parameters
        ----------
        now : float
            [s]
        residual : float
            Mean distance of its seen markers from the hand [m].
        """
        if self._last is not None:
            step = min(now - self._last, FIT_STEP)
            self._seconds += step
            self._total += step * residual
        self._last = now

    def mean(self, least: float) -> float | None:
        """Return the mean residual once enough was tracked, and begin anew.

        Parameters
        ----------
        least : float
            [s]

        Returns
        -------
        float or None
            [m]
        """
        if self._seconds < least:
            return None
        mean = self._total / self._seconds
        self._reset()
        return mean
