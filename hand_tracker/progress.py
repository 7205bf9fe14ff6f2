"""How far long work has come: a bar on a terminal, elsewhere a line now and then."""

import sys
import threading
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
        self._done, self._start = 0, 0.
        self._lock = threading.Lock()

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
        self._done, self._start = 0, time.monotonic()
        ended = threading.Event()
        # Of its own, so that a single long piece is no reason to fall silent.
        ticker = threading.Thread(target=self._tick, args=(ended,), daemon=True)
        ticker.start()
        try:
            for item in items:
                yield item
                self._done += 1
        finally:
            ended.set()
            ticker.join()
            if self._terminal:
                self._show()
                self._stream.write('\n')

    def _tick(self, ended):
        while not ended.wait(REDRAWN if self._terminal else LINE_EVERY):
            self._show()

    def say(self, text):
        """Write a line; the bar goes on below it.

        Parameters
        ----------
        text : str
        """
        with self._lock:
            print(f'{CLEAR}{text}' if self._terminal else text, file=self._stream, flush=True)

    def _show(self):
        line = self._line(self._done, time.monotonic() - self._start)
        with self._lock:
            self._stream.write(f'{CLEAR}{line}' if self._terminal else f'{line}\n')
            self._stream.flush()

    def _line(self, done, seconds):
        # A total that is too small is no reason to overflow the bar.
        share = min(1., done / max(self._total, 1))
        full = int(share * BAR)
        speed = done / max(seconds, 1e-9)
        pace = f'{speed:.0f} a second, ' if speed >= 10. else ''
        time_left = f'{_clock(seconds * (1. / share - 1.))} left' if share else _clock(seconds)
        return (f'[{"#" * full}{"." * (BAR - full)}] {int(100 * share):3d} %  {done} of '
                f'{self._total} {self._what}, {pace}{time_left}')


def _clock(seconds):
    return '{}:{:02d}'.format(*divmod(round(seconds), 60))
