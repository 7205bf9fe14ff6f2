"""The status of a source of points for /diagnostics: whether frames come, how many, and what of."""

from __future__ import annotations

import time

from .diagnostics import QUIET_AFTER, Level, Status


class SourceStatus:
    """Count the frames of a source, and tell its status."""

    def __init__(self) -> None:
        self._frames = self._told = self._named = self._anonymous = 0
        self._last: float | None = None     # when a frame came, steady [s]
        self._since = time.monotonic()      # of the last status
        self._warning = self._noted = ''    # of the last frame, since then

    def warn(self, text: str) -> None:
        """Note what is wrong with the next frame, or why none comes."""
        self._noted = text

    def add(self, named: int, anonymous: int) -> None:
        """Count a frame with so many named markers and anonymous points."""
        self._named, self._anonymous = named, anonymous
        self._warning = self._noted
        self.add_alike(1)

    def add_alike(self, count: int) -> None:
        """Count frames that are like the last one but for the places of their points."""
        self._frames += count
        self._last, self._noted = time.monotonic(), ''

    def status(self) -> Status:
        """Return the status, with the rate since the last one."""
        now, frames, last = time.monotonic(), self._frames, self._last
        rate = (frames - self._told) / max(now - self._since, 1e-3)
        self._told, self._since = frames, now
        is_quiet = last is None or now - last > QUIET_AFTER
        text = ('no frame yet' if last is None else
                f'no frame for {now - last:.1f} s' if is_quiet else 'frames come')
        if warning := self._noted or self._warning:
            text += f'; {warning}'
        return Status(Level.WARN if is_quiet or warning else Level.OK, text, {
            'frames': str(frames), 'frames per second': f'{rate:.1f}',
            'named markers': str(self._named), 'anonymous points': str(self._anonymous)})
