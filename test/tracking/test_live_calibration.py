"""Calibration in a running tracker: what its child process has said is told at its end."""

import errno
import os

import numpy as np
import pytest
from helpers.hands import hand_at

from hand_tracker.background import start_low_priority
from hand_tracker.calibration.live_take import LiveTake
from hand_tracker.core.model.marker_layout import MarkerLayout
from hand_tracker.tracking import live_calibration


@pytest.mark.parametrize('said, told', [
    ("print('the hand fits well\\n\\nmarkers\\nmy.yaml: right hand')",
     (True, 'my.yaml: right hand; the hand fits well')),
    ("print('my.yaml: a hand with markers at its joints')",
     (True, 'my.yaml: a hand with markers at its joints')),
    ("import sys; print('it fits'); sys.exit('the hand does not move')",
     (False, 'the hand does not move')),
    ('import sys; sys.exit(3)', (False, 'the fit ended with 3'))])
def test_a_fit_ends_with_its_file_and_its_verdict(said, told, tmp_path, monkeypatch):
    monkeypatch.setattr(live_calibration, 'start_low_priority', lambda _, *more: (
        start_low_priority(['-c', said], *more)))
    take = LiveTake(MarkerLayout(), 'right')
    for time in np.arange(0., 1., .03):
        take.add(hand_at(), time)
    fit = live_calibration.Fit(take, 'wearer', tmp_path / 'my.yaml')
    fit._child.wait()
    assert fit.ended() == told


def test_a_fit_that_cannot_begin_is_told(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(live_calibration, 'start_low_priority', full)
    one = live_calibration.LiveCalibration()
    one.start(MarkerLayout(), 'right', 'wearer', tmp_path / 'my.yaml')
    one.take.add(hand_at(), 0., 0.)
    assert one.update(1e6) is None and not one.is_running
    text = f'the fit could not be started: {os.strerror(errno.ENOSPC)}'
    assert text in one.values().values()
    assert one.pop_log_lines()[-1] == (True, f'calibration: {text}')
