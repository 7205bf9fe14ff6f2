"""Calls in a background thread, of whose results only the newest matters."""

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from threading import Thread
from typing import Generic, TypeVar

Argument = TypeVar('Argument')
Outcome = TypeVar('Outcome')


class NewestCall(Generic[Argument, Outcome]):
    """Call a function in a background thread, one call at a time, for the newest argument.

    Parameters
    ----------
    function : callable
        Takes an argument and returns its outcome.
    """

    def __init__(self, function: Callable[[Argument], Outcome]) -> None:
        self._function = function
        self._asked: deque[Argument] = deque(maxlen=1)
        self._running: Future[tuple[Argument, Outcome]] | None = None

    def ask(self, argument: Argument) -> None:
        """Ask for a call, in place of one that was asked for and has not begun."""
        self._asked.append(argument)

    def poll(self) -> tuple[Argument, Outcome] | None:
        """Return an argument and its outcome, once; begin the next call.

        Returns
        -------
        argument : object
        outcome : object

        None while there is nothing new. Errors of the function are raised here.
        """
        done = None
        if self._running is not None and self._running.done():
            done, self._running = self._running, None
        if self._running is None and self._asked:
            self._running = Future()
            # A daemon, so that nobody waits for it at the end.
            Thread(target=self._call, args=(self._running, self._asked.pop()), daemon=True).start()
        return None if done is None else done.result()

    def _call(self, future: 'Future[tuple[Argument, Outcome]]', argument: Argument) -> None:
        try:
            future.set_result((argument, self._function(argument)))
        except Exception as error:
            future.set_exception(error)
