"""Commands keep their pace while no frame of the hand comes."""

import numpy as np
import pytest

from hand_tracker.retargeting.command_pace import CommandPace


@pytest.mark.parametrize('period, tick', [(.01, .01), (.02, .01), (.002, .002)])
def test_no_command_is_left_out_where_ticks_are_early_or_late(period, tick):
    random, pace = np.random.default_rng(3), CommandPace(period, tick)
    sent, times = 0., []
    for now in tick * (np.arange(1, 2001) + random.uniform(-.2, .2, 2000)):
        if pace.is_due(now, sent):
            sent = now
            times.append(now)
    assert len(times) == pytest.approx(2000 * tick / period, abs=1)
    # One before a frame of the hand that is only a little late would be in its way.
    assert not pace.is_due(sent + 2.9 * period, sent + 2. * period)
