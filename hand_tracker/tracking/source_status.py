"""The status of a source of points for /diagnostics: its frames, and what is wrong with them."""

from __future__ import annotations

from .diagnostics import QUIET_AFTER, STATUS_PERIOD, Level, Status

WARNED_TIME = 10.   # [s] that a warning lasts, as most are said but once
MOST_WARNINGS = 4   # that last


class SourceStatus:
    """Count the frames of a source, and tell its status.

    Parameters
    ----------
    now : float
        Steady, as that of all calls [s].
    """

    def __init__(self, now: float) -> None:
        self._frames = self._told = self._named = self._anonymous = 0
        self._last: float | None = None     # when a frame came
        self._since, self._rate = now, 0.   # of the last rate
        self._warnings: dict[str, float] = {}

    def add(self, now: float, named: int, anonymous: int) -> None:
        """Count a frame with so many names of markers and anonymous points."""
        self._named, self._anonymous = named, anonymous
        self.add_alike(now, 1)

    def add_alike(self, now: float, count: int) -> None:
        """Count frames that are like the last one but for the places of their points."""
        self._frames += count
        self._last = now

    def warn(self, now: float, text: str) -> None:
        """Note what is wrong."""
        self._warnings.pop(text, None)  # the latest is the last one
        self._warnings[text] = now
        for oldest in list(self._warnings)[:-MOST_WARNINGS]:
            self._warnings.pop(oldest, None)

    def quiet_for(self, now: float) -> float:
        """Return for how long no frame has come, infinite where none came yet [s]."""
        return float('inf') if self._last is None else now - self._last

    def status(self, now: float, silence: str = '') -> Status:
        """Return the status.

        Parameters
        ----------
        now : float
            [s]
        silence : str, optional
            Why no frame may come.
        """
        if now - self._since > .9 * STATUS_PERIOD:
            frames = self._frames
            self._rate = (frames - self._told) / (now - self._since)
            self._told, self._since = frames, now
        quiet = self.quiet_for(now)
        text = 'frames come'
        if is_quiet := quiet > QUIET_AFTER:
            text = 'no frame yet' if self._last is None else f'no frame for {quiet:.1f} s'
        # Another thread may warn meanwhile.
        recent = [warning for warning, said in list(self._warnings.items())
                  if now - said < WARNED_TIME]
        troubles = [silence] * (is_quiet and bool(silence)) + recent
        return Status(Level.WARN if is_quiet or troubles else Level.OK,
                      '; '.join([text, *troubles]), {
                          'frames': str(self._frames), 'rate [Hz]': f'{self._rate:.1f}',
                          'names of markers': str(self._named),
                          'anonymous points': str(self._anonymous)})
