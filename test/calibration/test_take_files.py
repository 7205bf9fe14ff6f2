"""Takes of markers read from npz files."""

import numpy as np
import pytest
from helpers.capture_files import capture_path
from helpers.skin_markers import EVERY_JOINT, simulated_take

from hand_tracker.calibration.take_files import load_take
from hand_tracker.calibration.takes import InvalidTake
from hand_tracker.core.model.hand import Hand


@pytest.fixture
def fields():
    take, _ = simulated_take(Hand.scaled(), EVERY_JOINT, seconds=4.)
    return {'markers': take.points, 'marker_names': np.array(take.names), 'side': 'right',
            'rate_hz': 30.}


def written(tmp_path, fields):
    path = tmp_path / 'take.npz'
    np.savez(path, **fields)
    return path


def test_markers_and_their_names(tmp_path, fields):
    take = load_take(written(tmp_path, fields))
    assert take.names == EVERY_JOINT and take.side == 'right' and take.rate == 30.
    np.testing.assert_array_equal(take.points, fields['markers'])
    assert load_take(tmp_path / 'take.npz', 'left').side == 'left'


def test_joints_are_read_where_markers_have_no_names(tmp_path, fields):
    numbered = fields | {'marker_names': np.array([str(i) for i in range(len(EVERY_JOINT))]),
                         'positions': fields['markers'], 'joints': np.array(EVERY_JOINT)}
    assert load_take(written(tmp_path, numbered)).names == EVERY_JOINT


def test_markers_never_seen_are_left_out(tmp_path, fields):
    fields['markers'][:, 4] = np.nan
    fields['markers'][3, 5, 0] = np.inf
    take = load_take(written(tmp_path, fields))
    assert 'ring_mcp' not in take.names
    assert np.isnan(take.points[3, 4]).all()


@pytest.mark.parametrize(('change', 'message'), (
    ({'side': 'both'}, "side 'both'; expected right or left"),
    ({'rate_hz': 9000.}, 'rate_hz 9000; allowed is 5 to 2000 Hz'),
    ({'rate_hz': np.array((30., 60.))}, r'rate_hz of shape \(2,\), float64; expected a number'),
    ({'rate_hz': 'fast'}, 'rate_hz of shape .*; expected a number'),
    ({'sequence': np.zeros(3)}, 'expected a number for each of the'),
    ({'marker_names': np.array(['a'] * len(EVERY_JOINT))}, 'expected at least 8 names'),
    ({'markers': np.zeros((4, 2, 3))}, 'expected numbers')))
def test_faults_are_named(tmp_path, fields, change, message):
    with pytest.raises(InvalidTake, match=message):
        load_take(written(tmp_path, fields | change))


def test_markers_that_are_never_seen_are_not_taken_for_absent_ones(tmp_path, fields):
    unseen = fields | {'markers': np.full_like(fields['markers'], np.nan)}
    with pytest.raises(InvalidTake, match='none of its markers is ever seen: all places of wrist'):
        load_take(written(tmp_path, unseen))
    fields['markers'][:, 7:] = np.nan
    with pytest.raises(InvalidTake, match='at least 8 names .*; never seen are index_tip, '):
        load_take(written(tmp_path, fields))


def test_a_damaged_npz_file(tmp_path, fields):
    path = tmp_path / 'take.npz'
    np.savez_compressed(path, **fields)
    data = bytearray(path.read_bytes())
    data[200:400] = bytes(200)
    path.write_bytes(data)
    with pytest.raises(InvalidTake, match='take.npz: no npz file that can be read'):
        load_take(path)


def test_a_cut_npz_file_is_told_as_such(tmp_path, fields):
    path = tmp_path / 'take.npz'
    np.savez(path, **fields)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(InvalidTake, match='take.npz: cut: no npz file that can be read; expected'):
        load_take(path)


def test_no_npz_file(tmp_path):
    path = tmp_path / 'take.npz'
    path.write_text('no array')
    with pytest.raises(InvalidTake, match='no npz file that can be read'):
        load_take(path)
    with pytest.raises(InvalidTake, match='No such file'):
        load_take(tmp_path / 'none.npz')


def test_captures_with_numbered_and_with_named_markers():
    assert 'index_pip' in load_take(capture_path('kyutech_s1__trial4_task2')).names
    assert 'PinkyTip' in load_take(capture_path('sig18__user1_left')).names
