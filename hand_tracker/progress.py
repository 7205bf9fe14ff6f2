"""Progress of long work: a bar on a terminal, otherwise a line every ten seconds."""

import sys
import threading
import time
from collections.abc import Iterable, Iterator, Sequence
from typing import TextIO, TypeVar

BAR_WIDTH = 24        # [characters]
BAR_PERIOD = .1       # [s] between redraws of the bar
PROGRESS_LOG_PERIOD = 10.      # [s] between lines where there is no terminal
CLEAR_LINE = '\r\x1b[K'

CURSOR_UP = '\x1b[{}A'

Item = TypeVar('Item')


def bar(share: float, width: int) -> str:
    """Return a bar of so many characters, of which a share [1] is full."""
    full = int(share * width)
    return f'[{"#" * full}{"." * (width - full)}]'


class Progress:
    """Progress display: share done, rate and time left.

    Parameters
    ----------
    total : int
        Number of pieces of the work.
    what : str
        Name of the pieces, in the plural.
    stream : file, optional
        Standard error when left out.
    """

    def __init__(self, total: int, what: str, stream: TextIO | None = None) -> None:
        self._total, self._what = total, what
        self._stream = sys.stderr if stream is None else stream
        self._is_terminal = self._stream.isatty()
        self._done, self._start = 0, 0.
        self._lock = threading.Lock()

    def over(self, items: Iterable[Item]) -> Iterator[Item]:
        """Yield items, and count each as done when the next one is asked for.

        Parameters
        ----------
        items : iterable

        Yields
        ------
        object
        """
        self._done, self._start = 0, time.monotonic()
        ended = threading.Event()
        # A thread, so that the display goes on during a single long piece.
        ticker = threading.Thread(target=self._tick, args=(ended,), daemon=True)
        ticker.start()
        try:
            for item in items:
                yield item
                self._done += 1
        finally:
            ended.set()
            ticker.join()
            if self._is_terminal:
                self._show()
                self._stream.write('\n')

    def _tick(self, ended: threading.Event) -> None:
        while not ended.wait(BAR_PERIOD if self._is_terminal else PROGRESS_LOG_PERIOD):
            self._show()

    def say(self, text: str) -> None:
        """Write a line above the bar.

        Parameters
        ----------
        text : str
        """
        with self._lock:
            print(f'{CLEAR_LINE}{text}' if self._is_terminal else text, file=self._stream,
                  flush=True)

    def _show(self) -> None:
        line = self._line(self._done, time.monotonic() - self._start)
        with self._lock:
            self._stream.write(f'{CLEAR_LINE}{line}' if self._is_terminal else f'{line}\n')
            self._stream.flush()

    def _line(self, done: int, seconds: float) -> str:
        # `total` may be an underestimate.
        share = min(1., done / max(self._total, 1))
        rate = done / max(seconds, 1e-9)
        rate_text = f'{rate:.0f} a second, ' if rate >= 10. else ''
        time_left = (f'{_minutes(seconds * (1. / share - 1.))} left' if share
                     else _minutes(seconds))
        return (f'{bar(share, BAR_WIDTH)} {int(100 * share):3d} %  {done} of '
                f'{self._total} {self._what}, {rate_text}{time_left}')


class Block:
    """Lines on a terminal that are drawn again in their place.

    Parameters
    ----------
    stream : file
        A terminal.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream, self._drawn = stream, 0

    def draw(self, lines: Sequence[str]) -> None:
        """Draw lines in the place of the last ones."""
        up = CURSOR_UP.format(self._drawn) if self._drawn else ''
        self._stream.write(up + ''.join(f'{CLEAR_LINE}{line}\n' for line in lines))
        self._stream.flush()
        self._drawn = len(lines)


def _minutes(seconds: float) -> str:
    return '{}:{:02d}'.format(*divmod(round(seconds), 60))
