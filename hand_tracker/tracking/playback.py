"""Playback clock of a recording: rate, pause, single steps. No ROS."""

import time
from collections.abc import Callable, Generator, Iterable
from contextlib import suppress
from queue import Empty, Queue
from threading import Condition, Event, Thread
from typing import Protocol, TypeVar

BUSY_WAIT = 200_000  # [ns] that the system's waits may end late, so so much is waited busily


class TimedItem(Protocol):
    """Anything with a recorded time [ns]."""

    @property
    def time(self) -> int:
        """Recorded time [ns]."""


Item = TypeVar('Item')
Timed = TypeVar('Timed', bound=TimedItem)


class Playback:
    """Schedule of recorded items: each is played at its recorded time.

    The schedule is absolute: a late item does not delay the next. The time stands still until
    `play` begins, which runs in one thread; every other method may be called from any thread,
    also before, and acts at once.

    Parameters
    ----------
    start : int
        Recorded time at which it starts [ns].
    rate : float
        How many times as fast as recorded [1].
    paused : bool
    """

    def __init__(self, start: int, rate: float = 1., paused: bool = False) -> None:
        self._changed = Condition()
        self._rate = rate
        self._paused = paused
        self._playing = self._stepping = self._closed = False
        self._played = 0
        self._anchor(start)

    def _anchor(self, recorded: int) -> None:
        """Set the recorded time that it is now."""
        self._recorded = recorded
        self._steady = time.monotonic_ns()
        self._wall = self._steady + _wall_from_steady()

    def _elapse(self, recorded: int) -> int:
        """Return the real time from the anchor to a recorded time [ns]."""
        return round((recorded - self._recorded) / self._rate)

    def _now(self) -> int:
        if self._paused or not self._playing:
            return self._recorded
        return self._recorded + round((time.monotonic_ns() - self._steady) * self._rate)

    @property
    def now(self) -> int:
        """Current recorded time [ns]."""
        with self._changed:
            return self._now()

    @property
    def paused(self) -> bool:
        """Whether it is paused."""
        with self._changed:
            return self._paused

    def pause(self) -> None:
        """Stop the time."""
        self._set_paused(lambda paused: True)

    def resume(self) -> None:
        """Let the time pass again."""
        self._set_paused(lambda paused: False)

    def toggle_paused(self) -> None:
        """Pause, or resume when paused."""
        self._set_paused(lambda paused: not paused)

    def _set_paused(self, change: Callable[[bool], bool]) -> None:
        with self._changed:
            self._anchor(self._now())
            self._paused = change(self._paused)
            self._changed.notify_all()

    def set_rate(self, rate: float) -> bool:
        """Change the rate.

        Parameters
        ----------
        rate : float
            How many times as fast as recorded [1].

        Returns
        -------
        bool
            False when the rate is not above zero, and is left as it was.
        """
        if not 0 < rate < float('inf'):
            return False
        with self._changed:
            self._anchor(self._now())
            self._rate = rate
            self._changed.notify_all()
        return True

    def play_next(self) -> bool:
        """Play one item while paused, and move the time to it.

        Returns
        -------
        bool
            True when it has been played; False when not paused or nothing is left.
        """
        with self._changed:
            if not self._paused or self._closed:
                return False
            played = self._played
            self._stepping = True
            self._changed.notify_all()
            self._changed.wait_for(lambda: self._closed or self._played > played)
            return self._played > played

    def close(self) -> None:
        """End `play`, and every `play_next` that waits for the next item."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def play(self, items: Iterable[Timed], put: Callable[[Timed, int], object]) -> None:
        """Pass each item to `put` when it is due, until they end or it is closed.

        Parameters
        ----------
        items : iterable
            Each with a `time` [ns], in its order.
        put : callable
            Called with the item and the wall time at which it is due [ns]; items of the same
            recorded time have the same wall time.
        """
        with self._changed:
            self._playing = True
            self._anchor(self._recorded)
        for item in items:
            due = self._wait(item.time)
            if due is None:
                return
            put(item, due)
            with self._changed:
                self._played += 1
                self._stepping = False
                self._changed.notify_all()

    def _wait(self, recorded: int) -> int | None:
        """Wait until a recorded time is due; return its wall time [ns], None when closed."""
        with self._changed:
            while not self._closed:
                if self._paused and self._stepping:
                    self._anchor(recorded)
                    break
                left = self._steady + self._elapse(recorded) - time.monotonic_ns()
                if not self._paused and left <= BUSY_WAIT:
                    break
                self._changed.wait(None if self._paused else (left - BUSY_WAIT) * 1e-9)
            else:
                return None
            due = self._steady + self._elapse(recorded)
            wall = self._wall + self._elapse(recorded)
        while time.monotonic_ns() < due:
            pass
        return wall


def _wall_from_steady() -> int:
    """Return the offset of the wall clock from the steady clock [ns]."""
    # Another thread may come between two readings: the closest pair of a few counts.
    readings = [(time.monotonic_ns(), time.time_ns(), time.monotonic_ns()) for _ in range(5)]
    before, wall, after = min(readings, key=lambda reading: reading[2] - reading[0])
    return wall - (before + after) // 2


def read_ahead(items: Iterable[Item], count: int) -> Generator[Item, None, None]:
    """Iterate over items that another thread takes from their source in advance.

    Not in a thread that a signal may interrupt, which would leave the queue's lock taken.

    Parameters
    ----------
    items : iterable
    count : int
        Items taken in advance, at most.

    Yields
    ------
    object
        The items in order; an exception of their source is raised here.
    """
    ready: Queue = Queue(count)
    stop = Event()

    def fill() -> None:
        try:
            for item in items:
                ready.put((item, None))
                if stop.is_set():
                    return
            ready.put((None, StopIteration()))
        except Exception as error:
            ready.put((None, error))

    thread = Thread(target=fill, daemon=True)
    thread.start()
    try:
        while True:
            item, error = ready.get()
            if isinstance(error, StopIteration):
                return
            if error:
                raise error
            yield item
    finally:
        stop.set()
        while thread.is_alive():
            with suppress(Empty):
                ready.get_nowait()
            thread.join(.01)
