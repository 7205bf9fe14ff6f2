"""Calls in the background: one at a time, for what was asked for last."""

import time
from threading import Event

import pytest
from helpers.clients import CLIENT_PATIENCE

from hand_tracker.background import NewestCall


def outcome(call):
    """Return the next outcome."""
    until = time.monotonic() + CLIENT_PATIENCE
    while (found := call.poll()) is None:
        assert time.monotonic() < until
        time.sleep(.001)
    return found


def test_the_newest_of_what_was_asked_for_meanwhile_is_next():
    called, may_end = [], Event()

    def work(number):
        called.append(number)
        assert may_end.wait(CLIENT_PATIENCE)
        return -number

    call = NewestCall(work)
    assert call.poll() is None
    call.ask(1)
    assert call.poll() is None
    call.ask(2)
    call.ask(3)
    assert call.poll() is None
    may_end.set()
    assert outcome(call) == (1, -1) and outcome(call) == (3, -3)
    assert call.poll() is None and called == [1, 3]


def test_an_error_is_raised_where_the_outcome_is_asked_for():
    call = NewestCall(lambda number: 1 / number)
    call.ask(0)
    with pytest.raises(ZeroDivisionError):
        outcome(call)
    call.ask(2)
    assert outcome(call) == (2, .5)
