"""How far long work has come: a bar on a terminal, elsewhere a line now and then."""

import sys
import time

BAR = 24           # characters
REDRAWN = .1       # [s] between drawings of the bar
LINE_EVERY = 10.   # [s] between lines
CLEAR = '\r\x1b[K'


class Progress:
    """Show how far work has come.

    Parameters
    ----------
    total : int
        Pieces of the work.
    what : str
        Their name, in the plural.
    stream : file, optional
        Standard error when left out.
    """

    def __init__(self, total, what, stream=None):
        self._total, self._what = total, what
        self._stream = sys.stderr if stream is None else stream
        self._terminal = self._stream.isatty()

    def over(self, items):
        """Pass the pieces on, and show how many were worked on.

        Parameters
        ----------
        items : iterable

        Yields
        ------
        object
            Each of the items.
        """
        every = REDRAWN if self._terminal else LINE_EVERY
        start = time.monotonic()
        due = start + every
        done = 0
        try:
            for item in items:
                yield item
                done += 1
                now = time.monotonic()
                if now >= due:
                    due = now + every
                    self._show(self._line(done, now - start))
        finally:
            if self._terminal:
                self._show(self._line(done, time.monotonic() - start))
                self._stream.write('\n')

    def say(self, text):
        """Write a line; the bar goes on below it.

        Parameters
        ----------
        text : str
        """
        print(f'{CLEAR}{text}' if self._terminal else text, file=self._stream, flush=True)

    def _show(self, line):
        self._stream.write(f'{CLEAR}{line}' if self._terminal else f'{line}\n')
        self._stream.flush()

    def _line(self, done, seconds):
        # A total that is too small is no reason to overflow the bar.
        share = min(1., done / max(self._total, 1))
        full = int(share * BAR)
        left = round(seconds * (1. / share - 1.)) if share else 0
        return (f'[{"#" * full}{"." * (BAR - full)}] {int(100 * share):3d} %  {done} of '
                f'{self._total} {self._what}, {done / max(seconds, 1e-9):.0f} a second, '
                f'{left // 60}:{left % 60:02d} left')
