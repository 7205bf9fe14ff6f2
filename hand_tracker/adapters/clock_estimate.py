"""Clock of another machine in terms of this one's, from messages that the network delays.

A message that shows the time `remote` and is received at `local` bounds the offset of the clocks
from above; a request sent at `local` that is answered with the time `remote` bounds it from below.
Delays vary, bounds do not lie: the offset is the straight line with the widest margin between the
bounds of the last half minute, its slope the clocks' drift. So no delay enters but half the
difference of the least delays of both ways, and nothing accumulates. Where a tighter bound moves
the line back by less than 0.1 s, times do not step back but go on more slowly until they are on it.
"""

from __future__ import annotations

import math
import time
from typing import NamedTuple

import numpy as np

BIN = .5               # [s] of the remote clock, of which the tightest bounds are kept
BINS = 60
MAX_DRIFT = 3e-4       # of a clock of quartz [s/s]
# Drifts to try, from least to most, and then about the best of them, as finely.
COARSE_DRIFTS = np.array(sorted(np.linspace(-MAX_DRIFT, MAX_DRIFT, 81), key=abs))
FINE_DRIFTS = np.array(sorted(
    np.linspace(-1., 1., 41) * 2. * MAX_DRIFT / (len(COARSE_DRIFTS) - 1), key=abs))
# [ns] Readings of both clocks that take longer were interrupted: they are repeated, so many times
# at most, and the quickest counts.
LONGEST_LOOK, MOST_LOOKS = 50_000, 10
TOLERANCE = .001       # [s] by which bounds may contradict each other before all begins anew
CATCH_UP = .1          # [1] by which times go on more slowly while they are ahead of the line
MOST_AHEAD = .1        # [s] ahead of the line; where that is farther back, a clock was set


class ClockLine(NamedTuple):
    """A remote clock in terms of the local one.

    Attributes
    ----------
    offset, centre : float
        Local time less remote time at the remote time `centre` [s].
    drift : float
        Of the offset [s/s].
    ahead, since : float
        How far times up to the remote time `since` are ahead of that line, less from then on [s].
    """

    offset: float
    drift: float
    centre: float
    ahead: float
    since: float


def local_time(remote: float, offset: float, drift: float, centre: float, ahead: float,
               since: float) -> float:
    """Return the local time of a remote one, by the numbers of a `ClockLine` [s]."""
    return remote + offset + drift * (remote - centre) + max(
        ahead - CATCH_UP * max(remote - since, 0.), 0.)


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
        self._latest = -math.inf
        self._line = ClockLine(math.nan, 0., 0., 0., 0.)

    @property
    def is_known(self) -> bool:
        """Whether there was any message yet."""
        return not math.isnan(self._line.offset)

    @property
    def line(self) -> ClockLine:
        """The clock, for `local_time`."""
        return self._line

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
        return local_time(remote, *self._line)

    def _take(self, bounds: np.ndarray, remote: float, offset: float, sign: float) -> None:
        """Keep a bound if it is the tightest of its bin; fit where the line passes it."""
        if math.isnan(self._origin):
            self._origin = remote
        number = math.floor((remote - self._origin) / BIN)
        if abs(number - self._bin) >= BINS:
            self._restart(remote, offset, sign)
            return
        self._latest = max(self._latest, remote)
        is_new = number > self._bin
        if is_new:
            gone = np.arange(self._bin + 1, number + 1) % BINS
            self._upper[gone], self._lower[gone] = (np.inf, np.inf), (-np.inf, -np.inf)
            self._bin = number
        row = bounds[number % BINS]
        if not sign * offset < sign * row[1]:
            return
        row[:] = remote, offset
        passes = sign * (self.local(remote) - remote - offset) > 0.
        if (is_new or passes or not self.is_known) and self._fit() < -TOLERANCE:
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
        centre, offset, drift = float(times.mean()), math.nan, 0.
        margin = math.inf
        for drifts in (COARSE_DRIFTS, FINE_DRIFTS):
            tried = drift + drifts
            above = (upper[:, 1] - tried[:, None] * (upper[:, 0] - centre)).min(
                axis=1, initial=np.inf)
            below = (lower[:, 1] - tried[:, None] * (lower[:, 0] - centre)).max(
                axis=1, initial=-np.inf)
            if not len(lower):
                # Nothing is known of the delay: taken for none at its least.
                best = int(np.argmax(above))
                offset = float(above[best])
            elif not len(upper):
                best = int(np.argmin(below))
                offset = float(below[best])
            else:
                best = int(np.argmax(above - below))
                offset = .5 * float(above[best] + below[best])
                margin = .5 * float(above[best] - below[best])
            drift = float(tried[best])
        line = ClockLine(offset, drift, centre, 0., self._latest)
        ahead = self.local(self._latest) - local_time(self._latest, *line)
        self._line = line._replace(ahead=ahead) if 0. < ahead < MOST_AHEAD else line
        return margin


def wall_offset() -> int:
    """Return the system's time less that of the clock that never jumps [ns]."""
    best, offset = math.inf, 0
    for _ in range(MOST_LOOKS):
        before, wall, after = time.monotonic_ns(), time.time_ns(), time.monotonic_ns()
        if after - before < best:
            best, offset = after - before, wall - (before + after) // 2
        if best < LONGEST_LOOK:
            break
    return offset
