"""Recorded time passes again: rate, pause, steps. No ROS."""

import time
from threading import Thread
from typing import NamedTuple

import pytest

from hand_tracker.nodes.playback import Playback, read_ahead

START = 5 * 10**9
PERIOD = 10**7


class Item(NamedTuple):
    time: int


class Player:
    """A playback in a thread of its own, and what it played."""

    def __init__(self, playback, items):
        self.playback, self.played, self.due = playback, [], []
        self._thread = Thread(target=playback.play, args=(items, self._put))
        self._thread.start()

    def _put(self, item, due):
        self.played.append((item.time, time.monotonic_ns()))
        self.due.append(due)

    def join(self):
        self._thread.join(5)
        assert not self._thread.is_alive()
        return [item for item, _ in self.played]

    def wait_for(self, count):
        until = time.monotonic() + 5
        while len(self.played) < count:
            assert time.monotonic() < until
            time.sleep(.001)


def items(count, period=PERIOD):
    return [Item(START + i * period) for i in range(count)]


@pytest.mark.parametrize('rate', [1., 4.])
def test_plays_at_recorded_times(rate):
    player = Player(Playback(START, rate), items(21))
    assert player.join() == [item.time for item in items(21)]
    took = player.played[-1][1] - player.played[0][1]
    assert took == pytest.approx(20 * PERIOD / rate, abs=2e7)
    assert [due - player.due[0] for due in player.due] == [
        round(i * PERIOD / rate) for i in range(21)]


def test_same_recorded_time_is_due_at_the_same_time():
    player = Player(Playback(START), [Item(START), Item(START), Item(START + 1000)])
    player.join()
    assert player.due[1] == player.due[0] and player.due[2] == player.due[0] + 1000


def test_late_item_does_not_delay_the_next():
    playback = Playback(START)
    times = []

    def put(item, due):
        times.append(time.time_ns() - due)
        if len(times) == 2:
            time.sleep(.035)

    playback.play(items(12), put)
    assert times[2] > 2e7          # the next was late,
    assert times[-1] < 1e7         # the last in time again


def test_paused_plays_nothing_until_resumed():
    playback = Playback(START, paused=True)
    player = Player(playback, items(3))
    assert playback.paused and playback.now == START
    player._thread.join(.1)
    assert player.played == [] and playback.now == START
    playback.resume()
    assert len(player.join()) == 3
    assert not playback.paused and playback.now > START


def test_pause_acts_at_once_and_time_stands():
    playback = Playback(START)
    player = Player(playback, items(100))
    player.wait_for(5)
    playback.toggle_paused()
    now, count = playback.now, len(player.played)
    player._thread.join(.1)
    assert playback.now == now and len(player.played) <= count + 1
    playback.set_rate(100.)
    playback.toggle_paused()
    player.join()
    gap = player.played[-1][0] - now
    assert player.due[-1] - player.due[count - 1] > gap / 100


def test_rate_acts_on_the_wait_under_way():
    playback = Playback(START)
    player = Player(playback, [Item(START), Item(START + 60 * 10**9)])
    player.wait_for(1)
    assert playback.set_rate(1000.)
    assert len(player.join()) == 2


@pytest.mark.parametrize('rate', [0., -1., float('nan'), float('inf')])
def test_bad_rate_is_refused(rate):
    assert not Playback(START).set_rate(rate)


def test_time_stands_until_play_begins():
    playback = Playback(START, 1000.)
    time.sleep(.02)
    playback.pause()
    playback.resume()
    playback.set_rate(4.)
    assert playback.now == START
    time.sleep(.02)
    player = Player(playback, items(11))
    assert player.join() == [item.time for item in items(11)]
    assert player.played[-1][1] - player.played[0][1] > 10 * PERIOD / 4. - 5e6


def test_play_next_plays_one_and_moves_the_time():
    playback = Playback(START, paused=True)
    player = Player(playback, items(3, 3600 * 10**9))
    for count in (1, 2, 3):
        assert playback.play_next()
        assert len(player.played) == count
        assert playback.now == player.played[-1][0]
    player.join()
    playback.close()
    assert not playback.play_next()


def test_play_next_needs_a_pause():
    assert not Playback(START).play_next()


def test_close_lets_go_who_waits_for_a_step():
    playback = Playback(START, paused=True)
    answers = []
    caller = Thread(target=lambda: answers.append(playback.play_next()))
    caller.start()
    playback.close()
    caller.join(5)
    assert answers == [False]


def test_read_ahead_keeps_order_and_bound():
    taken = []

    def source():
        for number in range(50):
            taken.append(number)
            yield number

    ahead = read_ahead(source(), 5)
    assert next(ahead) == 0
    time.sleep(.05)
    assert len(taken) <= 8
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
