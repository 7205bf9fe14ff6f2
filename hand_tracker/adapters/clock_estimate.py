"""Clock of another machine in terms of this one's, from messages that the network delays.

A message that shows the time `remote` and is received at `local` bounds the offset of the clocks
from above; a request sent at `local` that is answered with the time `remote` bounds it from below.
Delays vary, bounds do not lie: the offset is the straight line with the widest margin between the
bounds of the last half minute, its slope the clocks' drift. So no delay enters but half the
difference of the least delays of both ways, and nothing accumulates.
"""

from __future__ import annotations

import math
import time

import numpy as np

BIN = .5               # [s] of the remote clock, of which the tightest bounds are kept
BINS = 60
MAX_DRIFT = 3e-4       # of a clock of quartz [s/s]
# Drifts to try, from least to most, and then about the best of them, as finely.
COARSE_DRIFTS = np.array(sorted(np.linspace(-MAX_DRIFT, MAX_DRIFT, 81), key=abs))
FINE_DRIFTS = np.array(sorted(
    np.linspace(-1., 1., 41) * 2. * MAX_DRIFT / (len(COARSE_DRIFTS) - 1), key=abs))
LONGEST_LOOK = 50_000  # [ns] at two clocks, if nothing comes in between
TOLERANCE = .001       # [s] by which bounds may contradict each other before all begins anew


def local_time(remote: float, offset: float, drift: float, centre: float) -> float:
    """Return the local time of a remote one, by a clock's `ClockEstimate.line` [s]."""
    return remote + offset + drift * (remote - centre)


class ClockEstimate:
    """Estimate of a remote clock. Times in seconds; the local clock must never jump."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._origin = math.nan
        # Of each bin the time and the bound of the offset, from above and from below.
        self._upper = np.full((BINS, 2), np.inf)
        self._lower = np.full((BINS, 2), -np.inf)
        self._bin = 0
        self._offset, self._drift, self._centre = math.nan, 0., 0.

    @property
    def is_known(self) -> bool:
        """Whether there was any message yet."""
        return not math.isnan(self._offset)

    @property
    def line(self) -> tuple[float, float, float]:
        """Offset at a remote time, drift, and that time, as of `local_time`."""
        return self._offset, self._drift, self._centre

    def received(self, remote: float, local: float) -> None:
        """Take a message that was sent at `remote` and received at `local`."""
        self._take(self._upper, remote, local - remote, 1.)

    def echoed(self, sent: float, remote: float, received: float) -> None:
        """Take a request sent at the local time `sent`, its answer received at `received`.

        Parameters
        ----------
        sent, received : float
        remote : float
            Time of the remote clock in between.
        """
        self._take(self._lower, remote, sent - remote, -1.)
        self._take(self._upper, remote, received - remote, 1.)

    def local(self, remote: float) -> float:
        """Return the local time of a remote one; NaN before the first message."""
        return local_time(remote, *self.line)

    def _take(self, bounds: np.ndarray, remote: float, offset: float, sign: float) -> None:
        """Keep a bound if it is the tightest of its bin; fit where the line passes it."""
        if remote < self._origin + (self._bin - BINS + 1) * BIN:
            self._restart(remote, offset, sign)
            return
        if math.isnan(self._origin):
            self._origin = remote
        number = math.floor((remote - self._origin) / BIN)
        is_new = number > self._bin
        if is_new:
            gone = np.arange(self._bin + 1, min(number, self._bin + BINS) + 1) % BINS
            self._upper[gone], self._lower[gone] = (np.inf, np.inf), (-np.inf, -np.inf)
            self._bin = number
        row = bounds[number % BINS]
        if not sign * offset < sign * row[1]:
            return
        row[:] = remote, offset
        passes = sign * (self.local(remote) - remote - offset) > 0.
        if is_new or passes or not self.is_known:
            if self._fit() < -TOLERANCE:
                self._restart(remote, offset, sign)

    def _restart(self, remote: float, offset: float, sign: float) -> None:
        """Begin anew with a bound: one of the clocks was set."""
        self.reset()
        self._take(self._upper if sign > 0. else self._lower, remote, offset, sign)

    def _fit(self) -> float:
        """Fit the line; return its margin to the bounds [s]."""
        upper = self._upper[np.isfinite(self._upper[:, 1])]
        lower = self._lower[np.isfinite(self._lower[:, 1])]
        times = np.concatenate((upper[:, 0], lower[:, 0]))
        self._centre = times.mean()
        margin = math.inf
        for drifts in (COARSE_DRIFTS, self._drift_about):
            tried = drifts() if callable(drifts) else drifts
            above = (upper[:, 1] - tried[:, None] * (upper[:, 0] - self._centre)).min(
                axis=1, initial=np.inf)
            below = (lower[:, 1] - tried[:, None] * (lower[:, 0] - self._centre)).max(
                axis=1, initial=-np.inf)
            if not len(lower):
                # Nothing is known of the delay: taken for none at its least.
                best = int(np.argmax(above))
                self._offset = float(above[best])
            elif not len(upper):
                best = int(np.argmin(below))
                self._offset = float(below[best])
            else:
                best = int(np.argmax(above - below))
                self._offset = .5 * float(above[best] + below[best])
                margin = .5 * float(above[best] - below[best])
            self._drift = float(tried[best])
        return margin

    def _drift_about(self) -> np.ndarray:
        return self._drift + FINE_DRIFTS

def wall_offset() -> int:
    """Return the system's time less that of the clock that never jumps [ns]."""
    while True:
        before, wall, after = time.monotonic_ns(), time.time_ns(), time.monotonic_ns()
        if after - before < LONGEST_LOOK:
            return wall - (before + after) // 2
