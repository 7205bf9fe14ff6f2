"""Text tables of points: the times of frames are more exact than their digits."""

import numpy as np
import pytest
from helpers.point_files import hand_recording
from hypothesis import given, settings
from hypothesis import strategies as st

from hand_tracker.files.recordings import read_recording, write_recording
from hand_tracker.files.text_table import frame_times


@settings(deadline=None)
@given(rate=st.floats(20., 1000.), start=st.floats(0., 1000.), decimals=st.integers(5, 9),
       left_out=st.sets(st.integers(1, 400)), is_told=st.booleans())
def test_rounded_times_are_those_of_the_frames(rate, start, decimals, left_out, is_told):
    true = start + np.array([k for k in range(500) if k not in left_out]) / rate
    found_rate, times = frame_times(rate if is_told else np.nan, np.round(true, decimals))
    assert np.abs(np.diff(times) - np.diff(true)).max() < 2e-7
    assert found_rate == pytest.approx(rate, rel=2e-4)


def test_times_that_are_not_even_stay_as_they_are():
    times = np.cumsum([.01, .0101, .0099, .01, .012])
    rate, kept = frame_times(np.nan, times)
    assert kept is times and rate == pytest.approx(100., rel=.1)
    assert frame_times(120., times)[1] is times
    times = 1e-6 * np.arange(5)  # of another unit than the rate
    assert frame_times(100., times)[1] is times


def test_without_times_the_rate_is_the_headers():
    assert frame_times(120., None) == (120., None)
    rate, times = frame_times(np.nan, None)
    assert np.isnan(rate) and times is None


@pytest.mark.parametrize('time', ['inf', '1e308', '-1e308'])
def test_a_time_that_no_clock_shows_makes_the_frames_even(time, tmp_path):
    path = tmp_path / 'take.trc'
    write_recording(path, hand_recording(10))
    lines = path.read_text().splitlines()
    cells = lines[-1 if time[0] != '-' else -10].split('\t')
    lines[lines.index('\t'.join(cells))] = '\t'.join((cells[0], time, *cells[2:]))
    path.write_text('\n'.join(lines) + '\n')
    read = read_recording(path)
    assert read.stamps is None and read.rate == 120. and len(read.points) == 10
