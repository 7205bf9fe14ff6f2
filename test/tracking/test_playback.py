"""Recorded time passes again: rate, pause, steps. No ROS."""

import time
from queue import Queue
from threading import Condition, Thread
from typing import NamedTuple

import pytest

from hand_tracker.tracking import playback as module
from hand_tracker.tracking.playback import BUSY_WAIT, Playback, read_ahead

BEGIN = 5 * 10**9
PERIOD = 10**7
PATIENCE = 240.  # [s], on a busy machine


class Item(NamedTuple):
    time: int


class Clock:
    """Stands in for the module `time`: time passes while it is read or waited for, only."""

    def __init__(self):
        self._now = 0

    def monotonic_ns(self):
        self._now += 1
        return self._now

    def time_ns(self):
        return BEGIN + self._now

    def sleep(self, seconds):
        self._now += round(1e9 * seconds)


@pytest.fixture
def clock(monkeypatch):
    """Return the clock of the playbacks of a test that has no other thread."""
    found = Clock()

    class Waiting(Condition):
        def wait(self, timeout=None):
            found.sleep(timeout)

    monkeypatch.setattr(module, 'time', found)
    monkeypatch.setattr(module, 'Condition', Waiting)
    return found


class Player:
    """A playback in a thread of its own, and what it played."""

    def __init__(self, playback, items):
        self.played, self.due = [], []
        self._thread = Thread(target=playback.play, args=(items, self._put))
        self._thread.start()

    def _put(self, item, due):
        self.due.append(due)
        self.played.append(item.time)

    def join(self):
        self._thread.join(PATIENCE)
        assert not self._thread.is_alive()
        return self.played

    def wait_for(self, count):
        wait(lambda: len(self.played) >= count)


def wait(condition):
    """Wait until a condition holds."""
    until = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < until
        time.sleep(.001)


def items(count, period=PERIOD):
    return [Item(BEGIN + i * period) for i in range(count)]


@pytest.mark.parametrize('rate', [1., 4.])
def test_plays_at_recorded_times(clock, rate):
    played = []
    Playback(BEGIN, rate).play(
        items(21), lambda item, due: played.append((item.time, due, clock.time_ns())))
    recorded, due, at = zip(*played)
    assert recorded == tuple(item.time for item in items(21))
    assert [each - due[0] for each in due] == [round(i * PERIOD / rate) for i in range(21)]
    assert all(0 <= late < 1000 for late in map(int.__sub__, at, due))


def test_same_recorded_time_is_due_at_the_same_time():
    player = Player(Playback(BEGIN), [Item(BEGIN), Item(BEGIN), Item(BEGIN + 1000)])
    player.join()
    assert player.due[1] == player.due[0] and player.due[2] == player.due[0] + 1000


def test_late_item_does_not_delay_the_next(clock):
    playback = Playback(BEGIN)
    late = []

    def put(item, due):
        late.append(clock.time_ns() - due)
        if len(late) == 2:
            clock.sleep(.035)

    playback.play(items(12), put)
    assert late[2] > 2e7           # the next was late,
    assert late[-1] < 1000         # the last in time again


def test_paused_plays_nothing_until_resumed():
    playback = Playback(BEGIN, paused=True)
    player = Player(playback, items(3))
    assert playback.paused and playback.now == BEGIN
    wait(lambda: playback._playing)
    assert player.played == [] and playback.now == BEGIN
    before = time.time_ns()
    playback.resume()
    assert len(player.join()) == 3
    # Nothing was due before.
    assert player.due[0] >= before
    assert not playback.paused and playback.now > BEGIN


def test_pause_acts_at_once_and_time_stands():
    playback = Playback(BEGIN)
    player = Player(playback, items(100))
    player.wait_for(5)
    playback.toggle_paused()
    now = playback.now
    playback.set_rate(100.)
    assert playback.now == now
    before = time.time_ns()
    playback.toggle_paused()
    player.join()
    # What was not due before the pause is due after it.
    late = [due for recorded, due in zip(player.played, player.due) if recorded > now]
    assert min(late) >= before
    assert late[-1] - late[0] == pytest.approx(PERIOD / 100. * (len(late) - 1), abs=2)


def test_rate_acts_on_the_wait_under_way():
    playback = Playback(BEGIN)
    player = Player(playback, [Item(BEGIN), Item(BEGIN + 3600 * 10**9)])
    player.wait_for(1)
    assert playback.set_rate(1e6)
    assert len(player.join()) == 2


@pytest.mark.parametrize('rate', [0., -1., float('nan'), float('inf')])
def test_bad_rate_is_refused(rate):
    assert not Playback(BEGIN).set_rate(rate)


def test_time_stands_until_play_begins(clock):
    playback = Playback(BEGIN, 1000.)
    clock.sleep(.02)
    playback.pause()
    playback.resume()
    playback.set_rate(4.)
    assert playback.now == BEGIN
    clock.sleep(.02)
    times = []
    playback.play(items(11), lambda item, due: times.append(clock.time_ns()))
    assert times[-1] - times[0] == pytest.approx(10 * PERIOD / 4., abs=BUSY_WAIT)


def test_play_next_plays_one_and_moves_the_time():
    playback = Playback(BEGIN, paused=True)
    player = Player(playback, items(3, 3600 * 10**9))
    for count in (1, 2, 3):
        assert playback.play_next()
        assert len(player.played) == count
        assert playback.now == player.played[-1]
    player.join()
    playback.close()
    assert not playback.play_next()


def test_play_next_needs_a_pause():
    assert not Playback(BEGIN).play_next()


def test_close_lets_go_who_waits_for_a_step():
    playback = Playback(BEGIN, paused=True)
    answers = []
    caller = Thread(target=lambda: answers.append(playback.play_next()))
    caller.start()
    playback.close()
    caller.join(PATIENCE)
    assert answers == [False]


@pytest.mark.parametrize('paused', [False, True])
def test_closing_ends_what_waits_for_the_next_item(paused):
    playback = Playback(BEGIN, paused=paused)
    player = Player(playback, [Item(BEGIN + 10**15)])
    playback.close()
    player.join()
    assert player.played == []


def test_read_ahead_keeps_order_and_bound(monkeypatch):
    taken, taken_when_full = [], []

    class WatchedQueue(Queue):
        def put(self, item):
            if self.full():
                taken_when_full.append(len(taken))
            super().put(item)

    def source():
        for number in range(50):
            taken.append(number)
            yield number

    monkeypatch.setattr(module, 'Queue', WatchedQueue)
    ahead = read_ahead(source(), 5)
    assert next(ahead) == 0
    # One is given, five wait, and the thread waits with one.
    wait(lambda: taken_when_full[-1:] == [7] or len(taken) == 50)
    assert len(taken) == 7
    assert list(ahead) == list(range(1, 50))


def test_read_ahead_raises_what_its_source_raises():
    def source():
        yield 1
        raise ZeroDivisionError

    ahead = read_ahead(source(), 5)
    assert next(ahead) == 1
    with pytest.raises(ZeroDivisionError):
        next(ahead)


def test_read_ahead_ends_its_thread_when_closed():
    closed = []

    def source():
        try:
            yield from iter(int, 1)
        finally:
            closed.append(True)

    numbers = source()
    ahead = read_ahead(numbers, 5)
    next(ahead)
    ahead.close()
    numbers.close()  # raises while the thread is in it
    assert closed
