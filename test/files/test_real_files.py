"""Files of real systems, read right: values checked against independent readers."""

import gzip

import c3d
import ezc3d
import numpy as np
import pytest
from helpers.capture_files import capture_folder, capture_path
from scipy.spatial.transform import Rotation

from hand_tracker.calibration.hand_axes import hands_of, side_likelihood, with_recognised_axes
from hand_tracker.files.point_recording import Axes
from hand_tracker.files.recordings import read_recording

NEEDS = 'c3d', 'ezc3d'


def real_file(name):
    path = capture_folder() / 'files' / name
    if not path.exists():
        pytest.skip(f'no file {path}')
    return path


def in_file_axes(recording):
    """Return the points as in the file, in its unit and axes."""
    return recording.points @ np.linalg.inv(recording.axes.matrix).T


def assert_same(points, truth):
    truth = np.where(np.isfinite(truth).all(axis=2, keepdims=True)
                     & truth.any(axis=2, keepdims=True), truth, np.nan)
    assert np.isfinite(truth).any()
    np.testing.assert_allclose(points, truth, rtol=2e-6, atol=1e-3)


@pytest.mark.parametrize('name', [
    'duplicate_labels', 'sample02_dec_int', 'sample02_dec_real', 'sample02_pc_int',
    'sample02_pc_real', 'tennis_serve_nan'])
def test_c3d_files_as_ezc3d_reads_them(name):
    path = real_file(f'{name}.c3d')
    other = ezc3d.c3d(str(path))['data']
    truth = np.moveaxis(other['points'][:3], 0, 2).swapaxes(0, 1)
    truth[other['meta_points']['residuals'][0].T < 0.] = np.nan
    assert_same(in_file_axes(read_recording(path)), truth)


@pytest.mark.parametrize('storage', ['int', 'real'])
def test_sgi_c3d_files_as_the_c3d_library_reads_them(storage):
    path = real_file(f'sample02_sgi_{storage}.c3d')
    with open(path, 'rb') as file:
        rows = np.array([points[:, :4] for _, points, _ in c3d.Reader(file).read_frames()])
    truth = np.where(rows[..., 3:] < 0., np.nan, rows[..., :3])
    found = read_recording(path)
    assert_same(in_file_axes(found), truth)
    assert found.rate == 50. and found.labels[:2] == ('RFT1', 'RFT2')
    assert found.axes == Axes('mm', 'z')


def test_repeated_labels_are_told_apart():
    found = read_recording(real_file('duplicate_labels.c3d'))
    assert len(set(found.labels)) == 48 and 'CLAVD#2' in found.labels


def test_a_qualisys_table_as_numpy_reads_it():
    path = real_file('dfki_recording.tsv.gz')
    with gzip.open(path, 'rt') as file:
        truth = np.loadtxt(file, delimiter='\t', skiprows=12)[:, 2:].reshape(6000, 21, 3)
    found = read_recording(path)
    assert_same(in_file_axes(found), truth)
    assert found.rate == 100. and found.labels[0] == 'hand_top'


@pytest.mark.parametrize('take', [1, 2, 10, 29])
@pytest.mark.parametrize('side', ['left', 'right'])
def test_trc_tables_as_numpy_reads_them(take, side):
    path = real_file(f'sig18/user1_capture1_sequence{take}_{side}.trc')
    truth = np.genfromtxt(path, delimiter='\t', skip_header=5)[:, 2:59].reshape(-1, 19, 3)
    found = with_recognised_axes(read_recording(path))
    assert_same(in_file_axes(found), truth)
    # The hand itself tells its side, and that the axes are right-handed.
    likelihood = side_likelihood(found, hands_of(found)[0])
    assert (likelihood if side == 'right' else 1. - likelihood) > .8


def test_a_frame_that_a_table_leaves_out_is_no_cut():
    found = read_recording(real_file('sig18/user1_capture1_sequence29_left.trc'))
    assert len(found.points) == 141 and any('leaves out: 1' in note for note in found.notes)


def test_a_posed_hand_is_a_capture_of_its_joints():
    found = with_recognised_axes(read_recording(real_file('manipnet_cup1_rightHand.bvh.gz')))
    assert found.axes == Axes('dm', 'y', 'left') and found.rate == pytest.approx(120., rel=1e-4)
    capture = np.load(capture_path('manipnet__cup1_rightHand'))
    names = [str(name) for name in capture['joints']]
    columns = hands_of(found)[0].columns
    shared = [name for name in names if name in columns]
    assert len(shared) == 16
    for frame in range(0, 4000, 400):
        truth = capture['positions'][frame, [names.index(name) for name in shared]]
        points = found.points[frame, [columns[name] for name in shared]].astype(float)
        truth, points = truth - truth.mean(axis=0), points - points.mean(axis=0)
        turn, _ = Rotation.align_vectors(truth, points)
        # A turn, not a mirror, lays one upon the other.
        np.testing.assert_allclose(turn.apply(points), truth, atol=1e-6)
