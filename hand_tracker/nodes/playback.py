"""Recorded time as it passes again: at a rate, with pauses, step by step. No ROS."""

import time
from contextlib import suppress
from queue import Empty, Queue
from threading import Condition, Event, Thread

SPIN = 200_000  # A wait may end this late, so the rest is spun [ns].


class Playback:
    """Play items at their recorded times.

    The schedule is absolute: lateness of one item never delays the next. The time stands still
    until `play` begins, which runs in one thread; every other method may be called from any
    thread, even before, and acts at once.

    Parameters
    ----------
    start : int
        Recorded time at which it starts [ns].
    rate : float
        How many times as fast as recorded.
    paused : bool
    """

    def __init__(self, start, rate=1., paused=False):
        self._changed = Condition()
        self._rate = rate
        self._paused = paused
        self._playing = self._stepping = self._closed = False
        self._played = 0
        self._anchor(start)

    def _anchor(self, recorded):
        """Let the recorded time be this now."""
        self._recorded = recorded
        self._steady = time.monotonic_ns()
        self._wall = self._steady + _wall_from_steady()

    def _elapse(self, recorded):
        """Return the time it takes from the anchor to a recorded time [ns]."""
        return round((recorded - self._recorded) / self._rate)

    def _now(self):
        if self._paused or not self._playing:
            return self._recorded
        return self._recorded + round((time.monotonic_ns() - self._steady) * self._rate)

    @property
    def now(self):
        """The recorded time that it is now [ns]."""
        with self._changed:
            return self._now()

    @property
    def paused(self):
        """Whether it is paused."""
        with self._changed:
            return self._paused

    def pause(self):
        """Stop the time."""
        self._set_paused(lambda paused: True)

    def resume(self):
        """Let the time pass again."""
        self._set_paused(lambda paused: False)

    def toggle_paused(self):
        """Pause, or resume when paused."""
        self._set_paused(lambda paused: not paused)

    def _set_paused(self, change):
        with self._changed:
            self._anchor(self._now())
            self._paused = change(self._paused)
            self._changed.notify_all()

    def set_rate(self, rate):
        """Change the rate.

        Parameters
        ----------
        rate : float

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

    def play_next(self):
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

    def close(self):
        """Let go whoever waits for the next item."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def play(self, items, put):
        """Hand over each item when it is due.

        Parameters
        ----------
        items : iterable
            Each with a `time` [ns], in its order.
        put : callable
            Called with the item and the wall time at which it is due [ns]. Items of the same
            recorded time are due at the same wall time.
        """
        with self._changed:
            self._playing = True
            self._anchor(self._recorded)
        for item in items:
            put(item, self._wait(item.time))
            with self._changed:
                self._played += 1
                self._stepping = False
                self._changed.notify_all()

    def _wait(self, recorded):
        """Wait until a recorded time is due; return the wall time that it is then."""
        with self._changed:
            while True:
                if self._paused and self._stepping:
                    self._anchor(recorded)
                    break
                left = self._steady + self._elapse(recorded) - time.monotonic_ns()
                if not self._paused and left <= SPIN:
                    break
                self._changed.wait(None if self._paused else (left - SPIN) * 1e-9)
            due = self._steady + self._elapse(recorded)
            wall = self._wall + self._elapse(recorded)
        while time.monotonic_ns() < due:
            pass
        return wall


def _wall_from_steady():
    """Return the wall time less the steady time [ns]."""
    # Another thread may come between two readings: the closest pair of a few counts.
    readings = [(time.monotonic_ns(), time.time_ns(), time.monotonic_ns()) for _ in range(5)]
    before, wall, after = min(readings, key=lambda reading: reading[2] - reading[0])
    return wall - (before + after) // 2


def read_ahead(items, count):
    """Iterate over items that a thread of its own takes from their source in advance.

    Parameters
    ----------
    items : iterable
    count : int
        How many it takes in advance.

    Yields
    ------
    object
        The items; an exception of their source is raised here.
    """
    ready = Queue(count)
    stop = Event()

    def fill():
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
