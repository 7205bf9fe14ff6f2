"""Motion capture files: what is written is read again, traps of formats, damage is named."""

import gzip
import struct
import zipfile
from pathlib import Path

import ezc3d
import numpy as np
import pytest
from helpers.other_c3d import ezc3d_file
from helpers.point_files import gappy_recording, hand_recording
from mcap_ros2.reader import read_ros2_messages

from hand_tracker.core.errors import HandTrackerError
from hand_tracker.files import npz_file
from hand_tracker.files.bvh_file import (
    CHANNELS,
    BvhJoint,
    BvhMotion,
    read_bvh_motion,
    write_bvh_motion,
)
from hand_tracker.files.point_recording import Axes, PointRecording, RecordingError
from hand_tracker.files.recordings import (
    FORMATS,
    VICON_CSV,
    ReadingOptions,
    is_named_as_recording,
    read_recording,
    recognised_format,
    recordings_at,
    write_recording,
)
from hand_tracker.files.written_kinds import WRITTEN_FORMATS
from hand_tracker.messages.marker_ids import FIRST_FOREIGN_ID

NEEDS = 'ezc3d', 'mcap_ros2'
SUFFIXES = ('.c3d', '.trc', '.tsv', '.csv', 'vicon.csv', '.npz', '.mcap', '.db3')


def written(path, recording, suffix):
    path = path / f'take{suffix}'
    write_recording(path, recording, VICON_CSV if suffix.startswith('vicon') else None)
    return path


def text_file(path, text, name):
    (path / name).write_text(text, encoding='utf-8')
    return path / name


@pytest.mark.parametrize('suffix', SUFFIXES)
def test_points_labels_rate_and_gaps_come_back(tmp_path, suffix):
    recording = gappy_recording()
    found = read_recording(written(tmp_path, recording, suffix))
    assert found.rate == pytest.approx(120., rel=1e-3)
    if suffix in ('.mcap', '.db3'):
        # A marker that is never seen is in no message.
        order = [found.labels.index(f'{label}/{FIRST_FOREIGN_ID + i}')
                 for i, label in enumerate(recording.labels) if i != 6]
        points, truth = found.points[:, order], np.delete(recording.points, 6, axis=1)
    else:
        assert found.labels == recording.labels
        points, truth = found.points, recording.points
    np.testing.assert_allclose(points, truth, atol=2e-7)


@pytest.mark.parametrize('suffix', SUFFIXES[:6])
def test_a_format_is_known_by_its_content(tmp_path, suffix):
    path = written(tmp_path, hand_recording(5), suffix)
    expected = recognised_format(path).name
    renamed = path.rename(tmp_path / 'unnamed.dat')
    assert recognised_format(renamed).name == expected
    assert read_recording(renamed).points.shape == (5, 8, 3)


def test_a_gzipped_text_is_read(tmp_path):
    path = written(tmp_path, hand_recording(5), '.trc')
    packed = tmp_path / 'take.trc.gz'
    packed.write_bytes(gzip.compress(path.read_bytes()))
    np.testing.assert_array_equal(read_recording(packed).points, read_recording(path).points)
    packed.write_bytes(packed.read_bytes()[:-40])
    with pytest.raises(RecordingError, match='damaged gzip'):
        read_recording(packed)


@pytest.mark.parametrize('count', [3, 300, 600])
def test_c3d_files_agree_with_ezc3d_however_many_labels(tmp_path, count):
    rng = np.random.default_rng(1)
    points = rng.normal(0., 1., (7, count, 3)).astype(np.float32)
    points[2, 1] = np.nan
    labels = tuple(f'Subject:Marker{i}' for i in range(count))
    path = tmp_path / 'many.c3d'
    write_recording(path, PointRecording('many', 'test', labels, points, 100., None, Axes('m')))
    other = ezc3d.c3d(str(path))
    np.testing.assert_allclose(
        np.moveaxis(other['data']['points'][:3], 0, 2).swapaxes(0, 1), 1000. * points, rtol=1e-6)
    listed = [label for name, one in other['parameters']['POINT'].items()
              if name.startswith('LABELS') for label in one['value']]
    assert tuple(listed) == labels
    found = read_recording(path)
    assert found.labels == labels
    np.testing.assert_allclose(found.points, points, rtol=1e-6)


def test_mcap_files_are_read_by_another_library(tmp_path):
    recording = gappy_recording(12)
    path = written(tmp_path, recording, '.mcap')
    messages = list(read_ros2_messages(str(path), topics=['/markers']))
    assert len(messages) == 12
    for one, truth in zip(messages, recording.points):
        seen = np.flatnonzero(np.isfinite(truth).all(axis=1))
        found = one.ros_msg.markers
        assert [(marker.ns, marker.id) for marker in found] == [
            (recording.labels[i], FIRST_FOREIGN_ID + i) for i in seen]
        np.testing.assert_allclose([(p.x, p.y, p.z) for p in (
            marker.pose.position for marker in found)], truth[seen], rtol=1e-6)


def test_c3d_files_of_ezc3d_are_read(tmp_path):
    points = np.random.default_rng(2).normal(0., 500., (20, 4, 3))
    points[3:6, 1] = np.nan
    path = ezc3d_file(tmp_path / 'other.c3d', ('A   ', 'B', 'A', 'Sub:C'), points)
    found = read_recording(path)
    assert found.labels == ('A', 'B', 'A#2', 'Sub:C')
    assert any('repeated labels' in note for note in found.notes)
    np.testing.assert_allclose(found.points, .001 * points, rtol=1e-6)


def test_the_upward_axis_of_a_c3d_file_counts(tmp_path):
    points = np.tile(np.array((1., 2., 3.)), (3, 1, 1))
    path = ezc3d_file(tmp_path / 'up.c3d', ('A',), points, 'm', X_SCREEN=['+X'], Y_SCREEN=['+Y'])
    found = read_recording(path)
    np.testing.assert_allclose(found.points[0, 0], (1., -3., 2.))
    assert found.axes.up == 'y' and 'y up' in ' '.join(found.notes)
    found = read_recording(path, ReadingOptions(up='z', units='cm'))
    np.testing.assert_allclose(found.points[0, 0], (.01, .02, .03))


def test_the_axis_that_qtm_writes_as_upward_points_down(tmp_path):
    points = np.tile(np.array((1., 2., 3.)), (3, 1, 1))
    path = ezc3d_file(tmp_path / 'qtm.c3d', ('A',), points, 'm', X_SCREEN=['-X'], Y_SCREEN=['-Z'])
    np.testing.assert_allclose(read_recording(path).points[0, 0], (1., -2., -3.))
    file = ezc3d.c3d(str(path))
    file.add_parameter('MANUFACTURER', 'COMPANY', ['Qualisys'])
    file.write(str(path))
    np.testing.assert_allclose(read_recording(path).points[0, 0], (1., 2., 3.))


def test_a_start_of_the_points_that_is_not_set_is_that_of_the_header(tmp_path):
    path = written(tmp_path, hand_recording(5), '.c3d')
    data = bytearray(path.read_bytes())
    start = data.index(b'DATA_START') + len('DATA_START') + 4
    assert data[start:start + 2] == data[16:18] != bytes(2)
    data[start:start + 2] = bytes(2)
    points = read_recording(path).points
    path.write_bytes(data)
    np.testing.assert_array_equal(read_recording(path).points, points)


def test_outputs_of_models_are_no_markers(tmp_path):
    path = ezc3d_file(tmp_path / 'model.c3d', ('A', 'KneeAngle'), np.ones((3, 2, 3)),
                      ANGLES=['KneeAngle'])
    found = read_recording(path)
    assert found.labels == ('A',) and any('no places' in note for note in found.notes)


@pytest.mark.parametrize('up', ['x', '-x', 'y', '-y', 'z', '-z'])
@pytest.mark.parametrize('handed', ['right', 'left'])
def test_axes_are_turned_and_mirrored(up, handed):
    matrix = Axes('m', up, handed).matrix
    assert np.linalg.det(matrix) == pytest.approx(1. if handed == 'right' else -1.)
    axis = np.zeros(3)
    axis['xyz'.index(up[-1])] = -1. if up[0] == '-' else 1.
    np.testing.assert_allclose(matrix @ axis, (0., 0., 1.))


TRC_TEXT = ('PathFileType\t4\t(X/Y/Z)\tx.trc\n'
            'DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\n100\t100\t2\t2\t{units}\n'
            'Frame#\tTime\tA\t\t\tB{end}\n\t\tX{i}\tY{i}\tZ{i}\tX{j}\tY{j}\tZ{j}{end}\n{blank}'
            '1\t0.00\t1.0\t2.0\t3.0\t\t\t{end}\n2\t0.01\t4.0\t5.0\t6.0\t7.0\t8.0\t9.0{end}\n')


@pytest.mark.parametrize('first', [0, 1])
@pytest.mark.parametrize('end', ['', '\t'])
@pytest.mark.parametrize('blank', ['', '\n', '\t\t\n'])
@pytest.mark.parametrize('units, scale', [('mm', .001), ('m', 1.), ('Inches', .0254)])
def test_trc_files_of_every_kind_are_read(tmp_path, first, end, blank, units, scale):
    text = TRC_TEXT.format(i=first, j=first + 1, end=end, blank=blank, units=units)
    found = read_recording(text_file(tmp_path, text, 'a.trc'))
    assert found.labels == ('A', 'B') and found.rate == 100.
    assert np.isnan(found.points[0, 1]).all()
    np.testing.assert_allclose(found.points[1], scale * np.array(((4., -6., 5.), (7., -9., 8.))),
                               rtol=1e-6)


QTM = ('NO_OF_FRAMES\t2\nNO_OF_CAMERAS\t7\nNO_OF_MARKERS\t2\nFREQUENCY\t100\nDATA_INCLUDED\t3D\n'
       'TIME_STAMP\t2021-08-26, 15:19:24.317\t1.5\n{names}{columns}{rows}')


@pytest.mark.parametrize('lead', ['', '1\t0.5\t'])
@pytest.mark.parametrize('columns', ['', 'Frame\tTime\tA X\tA Y\tA Z\tB X\tB Y\tB Z\n'])
def test_qualisys_files_with_and_without_columns(tmp_path, lead, columns):
    rows = f'{lead}1.0\t2.0\t3.0\t0.000\t0.000\t0.000\n' * 2
    text = QTM.format(names='MARKER_NAMES\tA\tB\n', columns=columns, rows=rows)
    found = read_recording(text_file(tmp_path, text, 'a.tsv'))
    assert found.labels == ('A', 'B')
    np.testing.assert_allclose(found.points[:, 0], ((.001, .002, .003),) * 2, rtol=1e-6)
    assert np.isnan(found.points[:, 1]).all()


def test_points_that_nobody_labelled_have_no_label(tmp_path):
    recording = hand_recording(5)
    names = ('Unlabeled3', 'unlabelled 4', 'Unnamed', '*7', 'Unlabeledness', *recording.labels[5:])
    path = written(tmp_path, recording._replace(labels=names), '.c3d')
    assert sorted(read_recording(path).labels) == sorted(('',) * 4 + names[4:])


def test_decimal_commas_of_a_localised_table_are_read(tmp_path):
    text = QTM.format(names='MARKER_NAMES\tA\tB\n', columns='',
                      rows='1,5\t2,5\t3,5\t4,5\t5,5\t6,5\n' * 2)
    found = read_recording(text_file(tmp_path, text, 'a.tsv'))
    np.testing.assert_allclose(found.points[0, 0], (.0015, .0025, .0035), rtol=1e-6)


MOTIVE = ('Format Version,{version},Take Name,T,Capture Frame Rate,120.000000,Capture Start Time,'
          '2019-02-11 02.16.03 nachm.,Total Exported Frames,3,Length Units,{units}\n\n'
          '{type_lead}Rigid Body,Rigid Body,Rigid Body,Rigid Body Marker,Rigid Body Marker,'
          'Rigid Body Marker,Rigid Body Marker,Marker,Marker,Marker,Marker,Marker,Marker,'
          'Marker,Marker,Marker\n'
          '{name_lead}Hand,Hand,Hand,"Hand:A","Hand:A","Hand:A","Hand:A",Hand:A,Hand:A,Hand:A,'
          'Unlabeled 1001,Unlabeled 1001,Unlabeled 1001,Unlabeled 1002,Unlabeled 1002,'
          'Unlabeled 1002\n,,{ids}\n{parent}'
          ',,Position,Position,Position,Position,Position,Position,Marker Quality,Position,'
          'Position,Position,Position,Position,Position,Position,Position,Position\n'
          'Frame,Time (Seconds),X,Y,Z,X,Y,Z,,X,Y,Z,X,Y,Z,X,Y,Z\n'
          '0,0.0,9,9,9,8,8,8,1,1,2,3,4,5,6,,,\n1,0.008333,9,9,9,8,8,8,1,,,,4,5,7,,,\n'
          '2,0.016667,9,9,9,8,8,8,1,1,2,4,,,,4,5,8\n')


@pytest.mark.parametrize('version, type_lead, name_lead, parent', [
    ('1.1', ',,', ',,', ''), ('1.23', ',,', ',,', ''),
    ('1.25', ',Type,', ',Name,', ',Parent,' + ',' * 16 + '\n')])
def test_optitrack_files_of_every_version(tmp_path, version, type_lead, name_lead, parent):
    text = MOTIVE.format(version=version, units='Centimeters', type_lead=type_lead,
                         name_lead=name_lead, parent=parent, ids=','.join('1' * 16))
    found = read_recording(text_file(tmp_path, text, 'a.csv'))
    # The measured marker, once; the anonymous one is one point, whatever columns it came in.
    assert found.labels == ('Hand:A', '') and found.format == 'OptiTrack CSV'
    np.testing.assert_allclose(found.points[0, 0], (.01, -.03, .02), rtol=1e-6)
    assert np.isnan(found.points[1, 0]).all()
    np.testing.assert_allclose(found.points[:, 1, 1], (-.06, -.07, -.08), rtol=1e-6)
    assert any('stand twice' in note for note in found.notes)
    assert any('1 rigid bodies' in note for note in found.notes)


def test_an_optitrack_file_in_pixels_is_refused(tmp_path):
    text = MOTIVE.format(version='1.25', units='Pixels', type_lead=',,', name_lead=',,',
                         parent='', ids='')
    with pytest.raises(RecordingError, match="line 1: Length Units 'Pixels'; expected a unit"):
        read_recording(text_file(tmp_path, text, 'a.csv'))


@pytest.mark.parametrize('suffix', SUFFIXES[:6])
@pytest.mark.parametrize('start', [0., 5., 1.7e9])
def test_a_start_later_than_0_comes_back(tmp_path, suffix, start):
    """Formats that number their frames, and have no times, cannot tell of a date."""
    recording = hand_recording(60)._replace(stamps=start + np.arange(60) / 120.)
    found = read_recording(written(tmp_path, recording, suffix)).times()
    numbers_only = suffix in ('.c3d', 'vicon.csv')
    expected = 0. if numbers_only and start > 1e9 else start
    np.testing.assert_allclose(found, expected + np.arange(60) / 120., rtol=0., atol=1e-5)


def test_a_vicon_file_with_devices_in_front_is_read(tmp_path):
    text = ('Devices\n1000\n,,Force\nFrame,Sub Frame,Fx\n,,N\n1,0,5\n\n'
            'Trajectories\n100\n,,Anna:LFIN,,,Anna:LWRA,,\nFrame,Sub Frame,X,Y,Z,X,Y,Z\n'
            ',,mm,mm,mm,mm,mm,mm\n1,0,1,2,3,,,\n2,0,4,5,6,7,8,9\n\nEvents\n1\n')
    found = read_recording(text_file(tmp_path, text, 'a.csv'))
    assert found.labels == ('Anna:LFIN', 'Anna:LWRA') and found.rate == 100.
    np.testing.assert_allclose(found.points[1], ((.004, .005, .006), (.007, .008, .009)),
                               rtol=1e-6)
    assert np.isnan(found.points[0, 1]).all()


@pytest.mark.parametrize('suffix', ['.tsv', 'vicon.csv'])
def test_frames_that_are_left_out_keep_their_times_without_a_column_of_times(tmp_path, suffix):
    recording = hand_recording(60)
    path = written(tmp_path, recording, suffix)
    lines = path.read_text().splitlines(keepends=True)
    head, rows = lines[:-60], lines[-60:]
    if suffix == '.tsv':
        head[-1] = head[-1].replace('Time\t', '')
        rows = [row.replace(f'\t{row.split()[1]}\t', '\t', 1) for row in rows]
    path.write_text(''.join((*head, *rows[:20], *rows[50:])))
    found = read_recording(path)
    assert found.rate == 120. and found.left_out == 30
    np.testing.assert_allclose(found.times()[[19, 20]], np.array((19, 50)) / 120.)
    np.testing.assert_allclose(found.points[20], recording.points[50], atol=2e-7)


@pytest.mark.parametrize('suffix', ['.c3d', '.trc', '.tsv', '.csv', 'vicon.csv'])
def test_a_cut_file_is_refused_or_read_as_far_as_it_goes(tmp_path, suffix):
    recording = hand_recording(30)
    whole = written(tmp_path, recording, suffix).read_bytes()
    cut = tmp_path / f'cut{suffix}'
    read = 0
    for length in np.linspace(10, len(whole) - 2, 60).astype(int):
        cut.write_bytes(whole[:length])
        try:
            found = read_recording(cut, ReadingOptions(partial=True))
        except HandTrackerError as error:
            assert 'cut' in str(error)
            continue
        read += 1
        # The blocks of a C3D file end in padding.
        if len(found.points) < 30:
            if suffix != 'vicon.csv' or any('cut' in note for note in found.notes):
                assert any('cut: ' in note for note in found.notes)
                with pytest.raises(RecordingError, match='--partial'):
                    read_recording(cut)
        np.testing.assert_allclose(found.points, recording.points[:len(found.points)], atol=2e-7)
    assert read > 10


def test_trc_files_of_spreadsheets_and_with_doubled_tabs_are_read(tmp_path):
    text = TRC_TEXT.format(i=1, j=2, end='', blank='', units='m')
    truth = read_recording(text_file(tmp_path, text, 'a.trc'))
    assert truth.axes.units == 'm'
    lines = text.splitlines()
    commas = [line.replace('\t', ',').ljust(60, ',') for line in lines]
    commas.insert(5, 60 * ',')
    doubled = [*lines[:2], lines[2].replace('\t', '\t\t'), *lines[3:]]
    # As of others: a cell of the header is empty, and a tab is at its end.
    sparse = [*lines[:2], lines[2].replace('100\t100', '100\t') + '\t', *lines[3:]]
    for other in (commas, doubled, sparse):
        found = read_recording(text_file(tmp_path, '\n'.join(other) + '\n', 'a.trc'))
        assert (found.labels, found.rate, found.axes) == (truth.labels, truth.rate, truth.axes)
        np.testing.assert_array_equal(found.points, truth.points)


def test_the_later_half_of_a_trc_file_is_whole(tmp_path):
    """Its header counts all frames, as of the take that it was cut out of."""
    recording = hand_recording(30)
    path = written(tmp_path, recording, '.trc')
    lines = path.read_text().splitlines(keepends=True)
    path.write_text(''.join((*lines[:-30], *lines[-12:])))
    np.testing.assert_allclose(read_recording(path).points, recording.points[18:], atol=2e-7)
    path.write_text(''.join((*lines[:-30], *lines[-12:-1])))
    with pytest.raises(RecordingError, match='cut: 11 whole frames of 30'):
        read_recording(path)


BVH_TEXT = ('HIERARCHY\nROOT hand\n{{\nOFFSET 0 0 0\nCHANNELS 3 Xposition Yposition Zposition\n}}\n'
            'MOTION\nFrames: 2\nFrame Time: 0.01\n{}')


def test_a_skeleton_cut_in_its_very_last_number_is_told(tmp_path):
    joints = (BvhJoint('hand', -1, (0., 0., 0.), CHANNELS[:3]),)
    values = np.array(((0., -0., 12.5), (1e-7, 40., 2.), (3., 4., -10.413951)))
    path, cut = tmp_path / 'hand.bvh', tmp_path / 'cut.bvh'
    write_bvh_motion(path, BvhMotion(joints, values, .01))
    whole = path.read_bytes()
    assert np.array_equal(read_bvh_motion(path).values, values)
    cut.write_bytes(whole[:-1])
    assert np.array_equal(read_bvh_motion(cut).values, values)
    for missing in range(2, 12):
        cut.write_bytes(whole[:-missing])
        with pytest.raises(RecordingError, match='cut: 2 whole frames of 3'):
            read_recording(cut)
        found = read_recording(cut, ReadingOptions(partial=True))
        assert len(found.points) == 2 and any('cut: 2' in note for note in found.notes)


@pytest.mark.parametrize('rows, is_doubted', [
    ('1.25 2.125 3.5\n1.125 2.25 3.75', False), ('1 2 3\n4 5 6', False),
    ('1.25\t2.125\t3.5 \n1.125\t2.25\t3 ', False), ('1.251 2.125 3.5\n1.125 2.25 1e-05', True),
    ('1.251 2.125 3.525 \n1.125 2.25 3.5 ', False), ('1.25 2.125 0.0\n1.125 2.25 3.7', True),
    ('1.25 2.125 0.0\n1.125 2.25 3.7\n', False)])
def test_a_last_line_without_an_end_is_read_and_doubted_where_it_may_be_cut(
        tmp_path, rows, is_doubted):
    found = read_recording(text_file(tmp_path, BVH_TEXT.format(rows), 'a.bvh'))
    assert len(found.points) == 2
    assert any('may be cut' in note for note in found.notes) == is_doubted


@pytest.mark.parametrize('name, text, message', [
    ('a.trc', TRC_TEXT.format(i=1, j=2, end='', blank='', units='mm').replace('5.0', 'x5'),
     r"line 7: column 4: 'x5'; expected a number"),
    ('a.trc', 'PathFileType\t4\n', r'line 2: the file ends'),
    ('a.tsv', QTM.format(names='', columns='', rows='a\tb\n' * 1001), r'no numbers in'),
    ('a.tsv', QTM.replace('3D', '6D').format(names='MARKER_NAMES\tA\n', columns='',
                                             rows='1\t2\t3\n'), r'DATA_INCLUDED 6D'),
    ('a.csv', 'Format Version,1.23\n\nFrame,Time,X,Y,Z\n0,0,1,2,3\n', r'no row with Marker'),
    ('a.csv', 'Trajectories\n100\nx\ny\n', r'no line Frame, Sub Frame'),
    ('a.bvh', 'HIERARCHY\nROOT a\n{\nOFFSET 0 0\n', r'line 4: OFFSET 0 0; expected three'),
    ('a.bvh', 'HIERARCHY\nROOT a\n{\n}\nMOTION\n', r'hierarchy that is not whole'),
    ('a.csv', 'a,b\n1,2\n', r'begins neither with'),
    ('a.csv', 'time_s,right_index_pip_flexion_deg\r\n0.0,1.0\r\n', r'angles of joints, as `track`'),
    ('a.bag', '#ROSBAG V2.0\n', r'no known format; expected .*: of this one of ROS 1 '
                                r'rosbags-convert --src .*a\.bag --dst a --src-typestore ros1_n'),
    ('a.csv', 'time_stamp,x\n0,1\n', r'begins neither with'),
    ('a.txt', 'hello', r'no known format; expected C3D'),
    ('a.c3d', '', r'has no bytes'),
])
def test_what_is_no_recording_is_named(tmp_path, name, text, message):
    with pytest.raises(RecordingError, match=message):
        read_recording(text_file(tmp_path, text, name))


def test_a_text_of_another_encoding_is_named(tmp_path):
    path = tmp_path / 'take.csv'
    path.write_text('Format Version,1.23\n', encoding='utf-16')
    with pytest.raises(RecordingError, match='a text of UTF-16; expected one of UTF-8'):
        read_recording(path)


def test_hostile_headers_ask_for_no_memory(tmp_path, monkeypatch):
    whole = bytearray(written(tmp_path, hand_recording(5), '.c3d').read_bytes())
    # As many points as the header can hold: behind the name are offset, type and dimensions.
    at = whole.index(b'USED') + 8
    whole[at:at + 2] = b'\xfe\xff'
    path = tmp_path / 'hostile.c3d'
    path.write_bytes(whole)
    with pytest.raises(RecordingError, match='cut: 0 whole frames of 5'):
        read_recording(path)
    packed = tmp_path / 'hostile.npz'
    with zipfile.ZipFile(packed, 'w') as archive:
        header = np.lib.format.magic(1, 0)
        text = b"{'descr': '<f8', 'fortran_order': False, 'shape': (999999999, 99, 3), }\n"
        archive.writestr('markers.npy', header + struct.pack('<H', len(text)) + text)
    with pytest.raises(RecordingError, match='no npz file'):
        read_recording(packed)
    np.savez(packed, a=np.zeros(9), b=np.zeros(9))
    monkeypatch.setattr(npz_file, 'MAX_POINT_BYTES', 350)
    with pytest.raises(RecordingError, match='no npz file'):
        read_recording(packed)


@pytest.mark.parametrize('order', ['<', '>'])
def test_names_of_an_npz_file_that_are_no_text_are_refused(tmp_path, order):
    names = np.array(['wrist', 'thumb'], dtype=f'{order}U5')
    path = tmp_path / 'points.npz'
    np.savez(path, markers=np.zeros((2, 2, 3)) + .1, marker_names=names)
    assert read_recording(path).labels == ('wrist', 'thumb')
    # A code point above the last one.
    names.view(f'{order}u4')[3] = 0x110000
    np.savez(path, markers=np.zeros((2, 2, 3)) + .1, marker_names=names)
    with pytest.raises(RecordingError, match='points.npz: no npz file'):
        read_recording(path)


def test_missing_and_unwritable_paths_are_named(tmp_path):
    with pytest.raises(RecordingError, match='no such file'):
        read_recording(tmp_path / 'none.c3d')
    with pytest.raises(RecordingError, match="not written as '.bvh'"):
        write_recording(tmp_path / 'a.bvh', hand_recording(3))
    with pytest.raises(RecordingError, match='no folder'):
        write_recording(tmp_path / 'none' / 'a.trc', hand_recording(3))


def test_options_list_every_format_that_is_written():
    assert WRITTEN_FORMATS == tuple(
        one.name.lower().replace(' ', '-') for one in FORMATS if one.write)


def test_recordings_of_a_folder_are_known_by_extensions_in_capitals_too():
    assert all(map(is_named_as_recording, map(Path, ('TAKE.C3D', 'take.c3d', 'Take.Mcap'))))
    assert not is_named_as_recording(Path('TAKE.PDF'))


def test_gzipped_recordings_of_a_folder_are_among_the_others(tmp_path):
    for name in ('b.npz', 'a.trc.gz', 'C.TSV.GZ', 'notes.txt.gz'):
        (tmp_path / name).touch()
    found, left_out = recordings_at(tmp_path)
    assert ([one.name for one in found], left_out) == (['C.TSV.GZ', 'a.trc.gz', 'b.npz'], [])
