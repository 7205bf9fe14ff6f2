"""Rates of recordings of points, by the times of their frames."""

import ezc3d
import numpy as np
import pytest

from hand_tracker.__main__ import main
from hand_tracker.core.model.hand import Hand
from hand_tracker.files.point_recording import nominal_rate, usual_rate
from hand_tracker.files.skeleton_motion import HandAngles
from hand_tracker.package_data import packaged_recording
from hand_tracker.tracking.save_motion import save_motion

NEEDS = 'ezc3d',


def stamps(rate, frames=1200):
    """Return times in whole nanoseconds, as a header has them [s]."""
    return 1e-9 * np.round(1e9 * np.arange(frames) / rate)


@pytest.mark.parametrize('rate', [24., 100., 120., 143., 240.])
def test_the_rate_of_rounded_stamps_is_the_nominal_one(rate):
    kept = np.delete(np.arange(1200), [3, 4, 400, 1000])
    assert nominal_rate(stamps(rate)) == rate
    assert nominal_rate(stamps(rate)[kept]) == rate
    assert nominal_rate(stamps(rate)[:2]) == rate
    assert nominal_rate(np.round(stamps(rate), 3)) == rate
    jitter = np.random.default_rng(5).uniform(-2e-4, 2e-4, 1200)
    assert nominal_rate(stamps(rate) + jitter) == rate
    assert usual_rate(stamps(rate) + jitter) == rate


@pytest.mark.parametrize('rate', [59.94, 119.999, 120.0001, 12.5, .4])
def test_a_rate_that_the_stamps_tell_from_a_nominal_one_stays(rate):
    assert nominal_rate(stamps(rate)) is None
    assert usual_rate(stamps(rate)) == pytest.approx(rate, rel=2e-7)


@pytest.mark.parametrize('times', [
    [], [1.], [1., 1.], [0., .01, .02, 0., .01, .02], [0., .01, .03, .031, .07],
    [0., .01, .02, 1e300], [0., .01, np.nan], [0., .01, np.inf]])
def test_times_without_a_rate_have_no_nominal_one(times):
    assert nominal_rate(np.array(times)) is None


def test_files_say_the_nominal_rate(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    recording = str(packaged_recording())
    for name in ('demo.csv', 'demo.c3d', 'demo.trc', 'demo.tsv'):
        assert main(['convert', recording, name]) == 0
    assert (',Capture Frame Rate,120.000000,Export Frame Rate,120.000000,'
            in (tmp_path / 'demo.csv').read_text(encoding='utf-8'))
    assert '\n120\t120\t' in (tmp_path / 'demo.trc').read_text(encoding='utf-8')
    assert 'FREQUENCY\t120\n' in (tmp_path / 'demo.tsv').read_text(encoding='utf-8')
    tracked = HandAngles(Hand.scaled(), np.zeros((30, 25)), np.zeros((30, 3)),
                         np.tile(np.eye(3), (30, 1, 1)), stamps(120., 30))
    for name in ('hand.c3d', 'hand.bvh'):
        save_motion(tmp_path / name, tracked)
    for name in ('demo.c3d', 'hand.c3d'):
        file = ezc3d.c3d(name)
        assert file['header']['points']['frame_rate'] == 120.
        assert file['parameters']['POINT']['RATE']['value'] == [120.]
    assert f'Frame Time: {1. / 120.!r}\n' in (tmp_path / 'hand.bvh').read_text(encoding='utf-8')
