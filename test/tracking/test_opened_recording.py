"""Recordings of any format are tracked alike: by their labels, in their units."""

import json
import os
import struct
import sys
import time
from io import StringIO

import numpy as np
import pytest
from helpers.bodies import SimulatedBody
from helpers.capture_files import capture_file
from helpers.hands import markers_of
from helpers.point_files import hand_recording

from hand_tracker.__main__ import main
from hand_tracker.calibration.hand_axes import hands_of, side_likelihood, with_recognised_axes
from hand_tracker.calibration.hand_labels import hand_labels
from hand_tracker.calibration.hand_markers import UnknownMarkers, choose_markers
from hand_tracker.calibration.take_files import load_take, recorded_take
from hand_tracker.core.model.hand import JOINTS, SIDES, Hand
from hand_tracker.core.model.layout_presets import preset_layout
from hand_tracker.core.model.marker_layout import MARKERS, PAPER_PLACES
from hand_tracker.evaluation.captures import load_capture
from hand_tracker.files.bag_points import marker_messages, recorded_times
from hand_tracker.files.bags import open_bag, write_bag
from hand_tracker.files.bvh_file import write_bvh_motion
from hand_tracker.files.point_recording import (
    Axes,
    PointRecording,
    RecordingError,
    Said,
    conversion_note,
    even_rows,
)
from hand_tracker.files.recordings import (
    VICON_CSV,
    ReadingOptions,
    read_recording,
    write_recording,
)
from hand_tracker.messages.cdr import MarkerReader
from hand_tracker.messages.labels import LabelMap
from hand_tracker.package_data import packaged_recording
from hand_tracker.simulation.motion import demo_motion
from hand_tracker.tracking.opened_recording import is_marker_bag, open_recording
from hand_tracker.tracking.point_bag import MarkerChoice, PointBag


def both_hands(frames=40):
    """Return a recording with both hands."""
    right, left = hand_recording(frames), hand_recording(frames, 'left')
    return right._replace(labels=right.labels + left.labels,
                          points=np.concatenate((right.points, left.points), axis=1))


@pytest.mark.parametrize('labels, skeleton, names', [
    (('RightHandIndex1', 'RightInHandPinky', 'mixamorig:RightHandThumb3', 'RightHandIndex3_end',
      'RightHand'), True, ('index_mcp', 'little_cmc', 'thumb_ip', 'index_tip', 'wrist')),
    (('RightThumbProximal', 'RightThumbIntermediate', 'RightThumbDistal', 'RightLittleProximal'),
     True, ('thumb_cmc', 'thumb_mcp', 'thumb_ip', 'little_mcp')),
    (('RightSecondPP', 'RightFirstMC', 'RightFifthDP', 'RightFifthDP_end'), True,
     ('index_mcp', 'thumb_cmc', 'little_dip', 'little_tip')),
    (('right_hand_wrist', 'RightHandWrist', 'RHandWrist'), False, ('wrist',) * 3),
    (('rindexdip', 'IndexMCPR', 'Anna:RRINGTIP', 'pinkytipr', 'rthumbcmc', 'rwrist', 'RWRIST'),
     False, ('index_dip', 'index_mcp', 'ring_tip', 'little_tip', 'thumb_cmc', 'wrist', 'wrist')),
    (('Anna:RIndexTip', 'R_index_mcp', 'right_wrist', 'RThumbTip', 'index_tip_r'), False,
     ('index_tip', 'index_mcp', 'wrist', 'thumb_tip', 'index_tip'))])
def test_labels_of_every_spelling_name_the_right_hand(labels, skeleton, names):
    found = hand_labels(labels, skeleton)
    assert [one.name for one in found] == list(names)
    assert {one.side for one in found} == {'right'}


def test_labels_without_a_side():
    found = hand_labels(('index-finger-phalanx-intermediate', 'thumb-phalanx-proximal',
                         'INDEX_FINGER_DIP', 'hand_left', 'index_middle', 'LFIN', 'C7', ''), True)
    assert [(one.side, one.name) if one else None for one in found] == [
        ('', 'index_pip'), ('', 'thumb_mcp'), ('', 'index_dip'), ('', 'hand_left'),
        ('', 'index_middle'), None, None, None]
    found = hand_labels(('Rindex_mcp', 'lpinky_tip', 'thumb_ipr', 'index_mcp'))
    assert [(one.side, one.name) for one in found] == [
        ('right', 'index_mcp'), ('left', 'little_tip'), ('right', 'thumb_ip'), ('', 'index_mcp')]
    found = hand_labels(('ringtip', 'LITTLETIP', 'rindexdipl', 'rings', 'indexip'))
    assert [(one.side, one.name) if one else None for one in found] == [
        ('', 'ring_tip'), ('', 'little_tip'), None, None, None]


@pytest.mark.parametrize('side', ['right', 'left'])
def test_the_shape_of_a_hand_tells_its_side(side):
    recording = hand_recording(400, side, labels=PAPER_PLACES)
    hand, = hands_of(recording)
    right = side_likelihood(recording, hand)
    assert (right if side == 'right' else 1. - right) > .9


def test_exchanged_knuckles_make_no_hand_of_the_other_side():
    places = list(PAPER_PLACES)
    places[1], places[2] = places[2], places[1]
    recording = hand_recording(400, labels=places)
    assert side_likelihood(recording, hands_of(recording)[0]) == .5


@pytest.mark.parametrize('unit, size', [('m', 1.), ('dm', 10.), ('cm', 100.), ('mm', 1000.),
                                        ('in', 1. / .0254)])
def test_the_size_of_a_hand_tells_the_unit_and_its_side_the_axes(unit, size):
    recording = hand_recording(400)
    mirrored = size * recording.points * np.array((-1., 1., 1.), dtype=np.float32)
    said = Said(False, False)
    found = with_recognised_axes(recording._replace(
        points=mirrored, format='BVH', said=said, notes=(conversion_note(Axes('m', 'z'), said),)))
    assert found.axes == Axes(unit, 'z', 'left')
    assert [note for note in found.notes if 'the file is in' in note] == [
        f'the file is in {"inches" if unit == "in" else unit} (as the hand is 62 mm wide then, '
        'more or less: --units), z up; read as metres, z up']
    np.testing.assert_allclose(found.points, recording.points, rtol=1e-5)


@pytest.mark.parametrize('unit, size', [('cm', 100.), ('mm', 1000.)])
@pytest.mark.parametrize('share', [.6, 1.6])
def test_a_hand_of_another_size_is_not_in_inches(unit, size, share):
    recording = hand_recording(40)
    found = with_recognised_axes(recording._replace(
        points=share * size * recording.points, format='BVH', said=Said(False, True, True)))
    assert found.axes.units == unit


def test_a_declared_unit_that_cannot_be_is_told_of():
    recording = hand_recording(40)
    found = with_recognised_axes(recording._replace(points=100. * recording.points))
    assert any('as large as hands are: is the file in cm, not in m? (--units cm)' in note
               for note in found.notes)
    np.testing.assert_array_equal(found.points, 100. * recording.points)


@pytest.mark.parametrize('side, first', [('right', 0), ('left', 8)])
def test_markers_of_one_hand_of_two_are_chosen(side, first):
    chosen = choose_markers(both_hands(), side)
    assert chosen.side == side and chosen.layout.places == PAPER_PLACES
    assert chosen.columns == tuple((first + i,) for i in range(8))


def test_markers_are_chosen_by_name_and_at_the_tips():
    labels = ('W', 'S:IndexMCP', 'S:LittleMCP', 'IndexTip', 'MiddleTip', 'RingTip', 'LittleTip',
              'T')
    recording = hand_recording(5, labels=labels)
    with pytest.raises(UnknownMarkers, match='no label for wrist, thumb; expected --markers'):
        choose_markers(recording)
    chosen = choose_markers(recording, names={'wrist': 'W', 'thumb': 'T'})
    assert chosen.layout.places[3:] == (
        'index_tip', 'middle_tip', 'ring_tip', 'little_tip', 'thumb_tip')
    assert chosen.columns[0] == (0,) and chosen.columns[7] == (7,)
    with pytest.raises(UnknownMarkers, match="no points with the label 'X' for wrist"):
        choose_markers(recording, names={'wrist': 'X'})
    with pytest.raises(UnknownMarkers, match='for ring; expected one of RingTip, '):
        choose_markers(recording, names={'ring': 'ringtip'})


def test_labels_of_marker_arrays_are_refused_for_a_file_of_points(tmp_path, capsys):
    write_recording(tmp_path / 'take.npz', hand_recording(5))
    assert main(['track', str(tmp_path / 'take.npz'), '--label', 'index=0/4',
                 '-o', str(tmp_path / 'angles.csv')]) == 1
    assert 'take.npz: --label: index=0/4; expected for MarkerArrays only' in (
        capsys.readouterr().err)


def test_two_markers_of_a_wrist_are_one():
    recording = hand_recording(5, labels=(*PAPER_PLACES[1:], 'wrist_in'))
    both = recording._replace(labels=(*recording.labels, 'wrist_out'), points=np.concatenate(
        (recording.points, recording.points[:, -1:] + np.float32(.02)), axis=1))
    assert choose_markers(both).columns[0] == (7, 8)


def test_a_file_of_points_is_a_bag_of_markers(tmp_path):
    recording = hand_recording()
    recording.points[3, 2] = np.nan
    path = tmp_path / 'take.trc'
    write_recording(path, recording)
    with open_recording(path, MarkerChoice()) as bag:
        assert isinstance(bag, PointBag) and [hand.side for hand in bag.hands] == ['right']
        assert len(list(bag.messages(['/markers']))) == len(recording.points)
        late = list(bag.messages(['/markers'], bag.start + bag.duration // 2))
        assert len(late) == len(recording.points) // 2
        assert bag.duration == pytest.approx(1e9 * (len(recording.points) - 1) / 120., rel=1e-6)


def angles(path):
    return np.genfromtxt(path, delimiter=',', skip_header=1)


@pytest.fixture(scope='module')
def tracked(tmp_path_factory):
    """Return a folder with a recording in every format, and the angles of the rosbag2 one."""
    folder = tmp_path_factory.mktemp('tracked')
    recording = hand_recording(240, start=100)
    for name in ('take.c3d', 'take.trc', 'take.tsv', 'take.csv', 'take.npz'):
        write_recording(folder / name, recording)
    write_recording(folder / 'vicon.csv', recording, VICON_CSV)
    write_bag(folder / 'bag.mcap', marker_messages(
        recording.points, recorded_times(recording), ('hand',) * 8))
    assert main(['track', str(folder / 'bag.mcap'), '-o', str(folder / 'bag_angles.csv')]) == 0
    return folder


@pytest.mark.parametrize('name', ['take.c3d', 'take.trc', 'take.tsv', 'take.csv', 'vicon.csv',
                                  'take.npz'])
def test_every_format_is_tracked_alike(tracked, tmp_path, name):
    assert main(['track', str(tracked / name), '-o', str(tmp_path / 'angles.csv')]) == 0
    np.testing.assert_allclose(angles(tmp_path / 'angles.csv'), angles(tracked / 'bag_angles.csv'),
                               atol=.05)


def test_a_cut_rosbag2_recording_is_tracked_as_far_as_it_goes(tracked, tmp_path, capsys):
    cut, out = tmp_path / 'cut.mcap', tmp_path / 'angles.csv'
    data = (tracked / 'bag.mcap').read_bytes()
    cut.write_bytes(data[:-200])
    command = ['track', str(cut), '-o', str(out)]
    assert main(command) == 1
    assert f'{cut}: cannot be read (cut, or not closed)' in capsys.readouterr().err
    assert main([*command, '--partial']) == 0
    assert f'{cut}: cut: 240 whole messages are read' in capsys.readouterr().err
    np.testing.assert_array_equal(angles(out), angles(tracked / 'bag_angles.csv'))
    assert main(['inspect', str(cut), '--partial']) == 0
    output = capsys.readouterr().out
    assert 'note: cut: 240 whole messages are read' in output and output.endswith(' --partial\n')


def test_the_likelier_side_is_taken_and_its_likelihood_told():
    path = capture_file('files/sig18/user1_capture1_sequence1_left.trc')
    bag = PointBag(path, MarkerChoice(layout=preset_layout('sig18_19')))
    assert bag.hands[0].side == 'left'
    assert any('a left hand, as its fingers bend, by a likelihood of 0.85: is it? (--side)' in note
               for note in bag.notes)


def test_a_side_that_is_asked_for_counts_more_than_the_shape(tmp_path):
    right = hand_recording(1800)
    names = tuple(label.partition('_')[2] for label in right.labels)
    write_recording(tmp_path / 'hand.npz', right._replace(labels=names))
    told = 'its fingers bend as those of a right hand: are --side, labels, units and axes right?'
    for asked, side, note in ((None, 'right', 'a right hand, as its fingers bend (--side)'),
                              ('right', 'right', ''),
                              ('left', 'left', told)):
        bag = PointBag(tmp_path / 'hand.npz', MarkerChoice(side=asked))
        assert bag.hands[0].side == side
        assert [one for one in bag.notes if 'bend' in one] == [note] * bool(note)
    assert main(['track', str(tmp_path / 'hand.npz'), '--side', 'left', '-o',
                 str(tmp_path / 'angles.csv')]) == 1


@pytest.mark.parametrize('side', SIDES)
def test_the_side_of_markers_that_are_named_is_found_by_shape(side, tmp_path, capsys):
    labels = tuple(f'P{row}' for row in range(8))
    path, out = str(tmp_path / 'take.c3d'), str(tmp_path / 'angles.csv')
    write_recording(path, hand_recording(1800, side, labels))
    named = '--markers', ','.join(map('='.join, zip(MARKERS, labels)))
    assert main(['track', path, '-o', out, *named]) == 0
    assert f'a {side} hand, as its fingers bend (--side)' in capsys.readouterr().err
    assert main(['inspect', path, *named]) == 0
    assert f' --side {side} --markers wrist=P0,' in capsys.readouterr().out.splitlines()[-1]


@pytest.mark.parametrize('labelled', [True, False])
def test_a_side_that_the_file_says_counts_more_than_the_shape(labelled, tmp_path):
    right = hand_recording(1800)
    names = tuple(label.partition('_')[2] for label in right.labels) if labelled else tuple(
        map(str, range(8)))
    write_recording(tmp_path / 'hand.npz', right._replace(labels=names, side='left'))
    choice = MarkerChoice(has_labels=labelled, finds_side=True)
    bag = PointBag(tmp_path / 'hand.npz', choice)
    assert bag.hands[0].side == 'left'
    assert 'a left hand, as the file says (--side)' in bag.notes
    given = PointBag(tmp_path / 'hand.npz', choice._replace(side='left'))
    assert not any('as the file says' in note for note in given.notes)
    asked = PointBag(tmp_path / 'hand.npz', choice._replace(side='right'))
    assert asked.hands[0].side == 'right'
    if labelled:
        assert 'the file says that it is a left hand: is --side right?' in asked.notes


@pytest.mark.parametrize('name', ['take.c3d', 'take.trc', 'take.tsv', 'take.csv', 'vicon.csv',
                                  'take.npz', 'bag.mcap'])
def test_inspect_says_what_is_in_it_and_what_to_run(tracked, tmp_path, name, capsys, monkeypatch):
    assert main(['inspect', str(tracked / name), '--json']) == 0
    found = json.loads(capsys.readouterr().out)
    assert {'labels', 'rate_hz', 'units', 'up', 'frames', 'gaps_pct', 'layouts'} <= set(found)
    assert found['frames'] == 240 and found['rate_hz'] == pytest.approx(120., rel=1e-3)
    best = found['layouts'][0]
    assert (best['name'], best['side']) == ('paper8', 'right') and best['likelihood'] > .9
    assert main(['inspect', str(tracked / name)]) == 0
    lines = capsys.readouterr().out.splitlines()
    # The command that it prints runs.
    command = lines[-1].removeprefix('next: hand_tracker ').split()
    monkeypatch.chdir(tmp_path)
    assert main(command) == 0
    assert len(angles(command[command.index('-o') + 1])) == 240


def test_inspect_asks_for_the_labels_of_a_hand_where_none_is_known(tmp_path, capsys):
    write_recording(tmp_path / 'body.trc', hand_recording(
        40, labels=tuple(f'body{i}' for i in range(8))))
    assert main(['inspect', str(tmp_path / 'body.trc')]) == 0
    line = capsys.readouterr().out.splitlines()[-1]
    assert line.startswith("next, if a hand's markers are among them, with their labels in place")
    assert '--markers wrist=LABEL,index_mcp=LABEL' in line


def test_inspect_names_a_recording_of_a_folder(tmp_path, capsys):
    for name in ('b.trc', 'a.trc'):
        write_recording(tmp_path / name, hand_recording(40))
    assert main(['inspect', str(tmp_path)]) == 1
    assert capsys.readouterr().err.endswith(
        f': a folder with recordings, 2 in number; expected one of them, as {tmp_path / "a.trc"}\n')


def test_inspect_asks_for_the_labels_of_as_many_markers_as_a_layout_has(
        tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names = preset_layout('vicon_production5').names
    recording, _ = vicon_recording(tuple(f'Anna:Q{i}q' for i in range(len(names))), 60)
    write_recording('own.trc', recording)
    assert main(['inspect', 'own.trc']) == 0
    line = capsys.readouterr().out.splitlines()[-1]
    assert line.startswith("next, if a hand's markers are among them, with their labels in place")
    command = line.partition(': hand_tracker ')[2]
    assert ' --layout vicon_production5 --markers WRA=LABEL,WRB=LABEL,' in command
    assert command.count('=LABEL') == len(names)
    for i in range(len(names)):
        command = command.replace('=LABEL', f'=Q{i}q', 1)
    assert main([*command.split(), '--side', 'left']) == 0
    assert '60 of 60 frames tracked' in capsys.readouterr().out


@pytest.mark.parametrize('output', ['out.c3d', 'out.trc', 'out.tsv', 'out.csv', 'out.npz',
                                    'out.mcap', 'out.bvh', 'out.glb', 'OUT.NPZ', 'OUT.MCAP'])
def test_convert_writes_what_is_read_again(tracked, tmp_path, output, capsys):
    path = tmp_path / output
    assert main(['convert', str(tracked / 'take.c3d'), str(path)]) == 0
    written = {'.c3d': 'C3D', '.trc': 'TRC', '.tsv': 'Qualisys TSV', '.csv': 'OptiTrack CSV',
               '.npz': 'npz', '.mcap': 'rosbag2'}.get(path.suffix.lower())
    assert written is None or capsys.readouterr().out.endswith(f'points, as {written}\n')
    if path.suffix == '.glb':
        assert path.read_bytes()[:4] == b'glTF'
    else:
        assert main(['track', str(path), '-o', str(tmp_path / 'angles.csv')]) == 0
        assert len(angles(tmp_path / 'angles.csv')) == 240


def test_markers_that_a_layout_names_are_read_though_joints_are_beside_them(tmp_path, capsys):
    hand, worn = Hand.scaled(), preset_layout('kyutech23')
    angles_of_frames, *wrist = demo_motion(hand).sample(np.arange(60) / 60.)
    fields = {'markers': markers_of(hand, angles_of_frames, worn, *wrist),
              'marker_names': worn.names, 'rate_hz': 60.}
    np.savez(tmp_path / 'markers.npz', **fields)
    np.savez(tmp_path / 'both.npz', **fields, joints=('wrist', 'index_tip'),
             positions=np.ones((60, 2, 3)))
    for name in ('markers', 'both'):
        assert main(['track', str(tmp_path / f'{name}.npz'), '-o', str(tmp_path / f'{name}.csv'),
                     '--layout', 'kyutech23', '--side', 'right']) == 0
        assert 'no label' not in capsys.readouterr().err
    assert (tmp_path / 'both.csv').read_bytes() == (tmp_path / 'markers.csv').read_bytes()
    np.savez(tmp_path / 'lacking.npz', **fields | {
        'markers': fields['markers'][:, :-1], 'marker_names': fields['marker_names'][:-1]},
        joints=('wrist', 'index_tip'), positions=np.ones((60, 2, 3)))
    assert main(['track', str(tmp_path / 'lacking.npz'), '-o', str(tmp_path / 'out.csv'),
                 '--layout', 'kyutech23', '--side', 'right']) == 0
    assert 'no label for 23; the other 22 markers are tracked' in capsys.readouterr().err
    assert main(['inspect', str(tmp_path / 'both.npz')]) == 0
    assert 'the markers beside the positions are not read (--layout kyutech23)' in (
        capsys.readouterr().out)


@pytest.mark.parametrize('layout', ['tips5_palm3', 'optitrack_hand', 'sig18_19', 'kyutech23'])
def test_markers_by_id_have_the_names_of_their_layout_in_other_formats(
        tmp_path, monkeypatch, layout):
    monkeypatch.chdir(tmp_path)
    hand, worn = Hand.scaled(), preset_layout(layout)
    angles_of_frames, *wrist = demo_motion(hand).sample(np.arange(20) / 40.)
    points = markers_of(hand, angles_of_frames, worn, *wrist).astype(np.float32)
    # Another marker beside those of the hand.
    points = np.concatenate((points, points[:, :1] + np.float32(.3)), axis=1)
    times = [10**9 + 25_000_000 * number for number in range(20)]
    write_bag('take.mcap', marker_messages(points, times, ('hand',) * points.shape[1]))
    how = ['--layout', layout, '--side', 'right', '--no-auto-size']
    assert main(['track', 'take.mcap', '-o', 'take.csv', *how]) == 0
    for name in ('out.npz', 'out.csv', 'out.trc', 'out.c3d', 'out.mcap', 'out.db3'):
        assert main(['convert', 'take.mcap', name, '--layout', layout]) == 0
        assert main(['track', name, '-o', 'angles.csv', *how]) == 0
        np.testing.assert_allclose(angles('angles.csv')[:, 1:], angles('take.csv')[:, 1:],
                                   atol=.05)


def test_convert_refuses_what_it_cannot_write(tracked, tmp_path, capsys):
    assert main(['convert', str(tracked / 'take.c3d'), str(tmp_path / 'out.fbx')]) == 1
    assert "unknown extension '.fbx'; expected .c3d, .csv, .npz" in capsys.readouterr().err
    assert main(['convert', str(tracked / 'take.c3d'), str(tracked / 'take.c3d')]) == 1
    assert 'would replace the recording' in capsys.readouterr().err


@pytest.mark.parametrize('arguments, message', [
    (['inspect', 'none.c3d'], 'no such file'),
    (['track', '{file}', '-o', 'out.csv', '--markers', 'nose=A'], "'nose=A'; expected MARKER="),
    (['track', '{file}', '-o', 'out.csv', '--markers', 'index=A, middle=A'],
     "'A' for both index and middle; expected a label of its own for each"),
    (['calibrate', '{file}', '-o', 'out.yaml', '--markers', 'index=A', '--markers', 'middle=A'],
     "'A' for both index and middle"),
    (['track', '{file}', '-o', 'out.csv', '--side', 'left'],
     'thumb of a left hand; expected --side right, of which they are, or --markers wrist='),
    (['track', '{file}', '-o', 'out.csv', '--units', 'm'],
     'check --units, the size of the hand and --markers'),
    (['track', '{file}', '--side', 'both', '-o', 'out.csv'],
     'of a left hand; expected --side right, of which they are'),
    (['track', '{file}', '--side', 'both', '--markers', 'index=A', '-o', 'out.csv'],
     '--markers names the points of one hand; expected --side right or left'),
    (['convert', '{file}', 'out.c3d', '--format', 'vicon-csv'],
     'out.c3d: the suffix is that of another format than vicon-csv; expected .csv'),
    (['convert', '{file}', 'out.csv', '--names', 'mixamo'],
     'out.csv: --names: mixamo; expected for outputs .bvh, .glb only'),
    (['convert', '{file}', 'out.glb', '--order', 'XYZ'],
     'out.glb: --order: XYZ; expected for outputs .bvh only'),
    (['convert', '{file}', 'none/out.trc'], 'no folder')])
def test_faults_are_told_in_a_line(tracked, tmp_path, monkeypatch, capsys, arguments, message):
    monkeypatch.chdir(tmp_path)
    words = [word.format(file=tracked / 'take.c3d') for word in arguments]
    assert main(words) == 1
    error = capsys.readouterr().err
    assert message in error and 'Traceback' not in error


@pytest.mark.parametrize('name', ['both.c3d', 'both.mcap'])
def test_both_hands_of_a_file_of_points_are_tracked(tmp_path, monkeypatch, capsys, name):
    monkeypatch.chdir(tmp_path)
    write_recording(tmp_path / name, both_hands(240))
    assert main(['inspect', name]) == 0
    command = capsys.readouterr().out.splitlines()[-1].removeprefix('next: hand_tracker ').split()
    assert command == ['track', name, '-o', 'both_angles.csv', '--side', 'both']
    assert main([*command, '--no-auto-size']) == 0
    together = angles('both_angles.csv')
    for first, side in ((1, 'right'), (26, 'left')):
        assert main(['track', name, '-o', 'one.csv', '--side', side, '--no-auto-size']) == 0
        np.testing.assert_array_equal(angles('one.csv')[:, 1:], together[:, first:first + 25])


def test_both_hands_may_have_labels_of_their_own(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    recording = both_hands(240)
    own = [f'{i + 1}' for i in range(len(recording.labels))]
    write_recording(tmp_path / 'both.c3d', recording)
    write_recording(tmp_path / 'own.c3d', recording._replace(labels=tuple(own)))
    markers = ','.join(f'{side}_{marker}={own[8 * number + row]}' for number, side in
                       enumerate(SIDES) for row, marker in enumerate(MARKERS))
    for name, words in (('both', ()), ('own', ('--markers', markers))):
        assert main(['track', f'{name}.c3d', '-o', f'{name}.csv', '--side', 'both',
                     '--no-auto-size', *words]) == 0
    np.testing.assert_array_equal(angles('own.csv'), angles('both.csv'))


def test_both_hands_of_points_without_labels_are_tracked(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    recording = both_hands(480)
    write_recording(tmp_path / 'both.trc', recording)
    write_recording(tmp_path / 'cloud.trc', recording._replace(labels=('',) * 16))
    for name in ('both', 'cloud'):
        assert main(['track', f'{name}.trc', '-o', f'{name}.csv', '--side', 'both',
                     '--no-auto-size']) == 0
    np.testing.assert_allclose(angles('cloud.csv')[-60:], angles('both.csv')[-60:], atol=.1)


def test_labels_without_a_side_are_not_of_both_hands(tracked, tmp_path, capsys):
    path = tmp_path / 'take.trc'
    write_recording(path, hand_recording(40, labels=PAPER_PLACES))
    assert main(['track', str(path), '-o', str(tmp_path / 'out.csv'), '--side', 'both']) == 1
    assert 'labels that name no right hand; expected such as right_index' in (
        capsys.readouterr().err)


def with_others(recording):
    """Return markers of a hand in another order, behind those of something else."""
    order = [3, 7, 1, 0, 6, 2, 5, 4]
    return recording._replace(
        labels=('box1', 'box2', *(recording.labels[i] for i in order), ''),
        points=np.concatenate((recording.points[:, :2] + np.float32(.3),
                               recording.points[:, order],
                               recording.points[:, :1] + np.float32(.2)), axis=1))


@pytest.mark.parametrize('labels', [None, tuple(f'M{i}' for i in range(8))])
def test_names_of_markers_last_in_a_rosbag2_recording(tracked, tmp_path, monkeypatch, capsys,
                                                      labels):
    monkeypatch.chdir(tmp_path)
    recording = with_others(hand_recording(240, labels=labels, start=100))
    write_recording(tmp_path / 'take.mcap', recording)
    if labels is None:
        assert main(['inspect', 'take.mcap']) == 0
        given = capsys.readouterr().out.splitlines()[-1].split()[4:]
    else:
        given = ['-o', 'take_angles.csv', '--markers', ','.join(
            f'{marker}={label}' for marker, label in zip(MARKERS, labels))]
    assert main(['track', 'take.mcap', *given]) == 0
    np.testing.assert_allclose(angles('take_angles.csv'), angles(tracked / 'bag_angles.csv'),
                               atol=.05)


def test_a_rosbag2_recording_with_names_is_a_take(tmp_path):
    path = tmp_path / 'take.mcap'
    write_recording(path, with_others(hand_recording(240, start=100)))
    take = load_take(path)
    assert take.side == 'right' and set(take.names) == set(PAPER_PLACES)


def test_names_of_markers_with_the_ids_of_the_tracker_are_no_reason_to_read_points(tmp_path):
    path = tmp_path / 'take.mcap'
    write_recording(path, hand_recording(40, labels=tuple(f'RHand:{name}' for name in MARKERS)))
    assert is_marker_bag(path)
    with open_bag(path) as bag:
        frame = MarkerReader(LabelMap()).read(next(bag.messages()).data)
    np.testing.assert_array_equal(frame.positions, hand_recording(1).points[0])


def test_a_landmark_that_is_the_origin_is_tracked(tmp_path, capsys):
    names = tuple(f'right_{place}' for place in PAPER_PLACES)
    recording = hand_recording(240, labels=names, start=100)._replace(is_landmarks=True)
    recording = recording._replace(points=recording.points - recording.points[:, :1])
    path = tmp_path / 'landmarks.npz'
    write_recording(path, recording)
    assert main(['track', str(path), '-o', str(tmp_path / 'angles.csv')]) == 0
    said = capsys.readouterr()
    assert '240 of 240 frames tracked' in said.out
    # Joints are not on the skin, so that no hand file is needed for that.
    assert 'no hand file' not in said.err
    # Two points at one place are none.
    recording.points[:, 5] = 0.
    write_recording(path, recording)
    assert not read_recording(path).seen[:, [0, 5]].any()


def test_the_wrist_of_a_skeleton_is_one_in_a_file_of_markers(tracked, tmp_path, capsys):
    bvh, c3d = tmp_path / 'hand.bvh', tmp_path / 'hand.c3d'
    assert main(['convert', str(tracked / 'take.c3d'), str(bvh)]) == 0
    assert main(['convert', str(bvh), str(c3d)]) == 0
    assert f'{c3d}: written RightHand as right_wrist' in capsys.readouterr().err
    found = []
    for path in (bvh, c3d):
        assert main(['track', str(path), '-o', str(tmp_path / 'angles.csv'),
                     '--no-auto-size']) == 0
        found.append(angles(tmp_path / 'angles.csv'))
    np.testing.assert_allclose(*found, atol=.05)


def test_inspect_has_numbered_points_labelled_and_a_body_spliced(tmp_path, capsys):
    recording = hand_recording(60, labels=tuple(str(i) for i in range(100, 108)))
    write_recording(tmp_path / 'numbers.trc', recording)
    assert main(['inspect', str(tmp_path / 'numbers.trc')]) == 0
    assert capsys.readouterr().out.endswith('numbers_angles.csv --labels none\n')
    write_bvh_motion(tmp_path / 'body.bvh', SimulatedBody('mixamo', 2.).motion(60.))
    assert main(['inspect', str(tmp_path / 'body.bvh')]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[-1] == (
        "next, with a recording of the hand's markers in place of HAND: hand_tracker splice "
        f'{tmp_path / "body.bvh"} HAND -o body_hands.bvh')
    # As `splice` has it.
    assert '60 Hz, 2.0 s; in cm, y up' in lines[0]
    assert 'note: the file is in cm (as the body is 1.7 m long then, more or less' in lines[-3]


def run_what_inspect_names(*arguments):
    """Run `inspect`, and the command that it names; return what both said."""
    assert main(['inspect', *arguments]) == 0
    said = sys.stdout.getvalue()
    assert main(said.splitlines()[-1].removeprefix('next: hand_tracker ').split()) == 0
    return sys.stdout.getvalue()


@pytest.mark.parametrize('name, change, said', [
    ('left.mcap', {}, '--side left'),
    ('numbers.npz', {'labels': tuple(map(str, range(8)))}, 'a left hand, by the shape'),
    ('mirrored_right.npz', {'labels': tuple(f'R_{name}' for name in PAPER_PLACES)},
     '--handed=left --side right')])
def test_what_inspect_names_next_tracks_hands_of_either_side(
        tmp_path, monkeypatch, name, change, said):
    monkeypatch.chdir(tmp_path)
    output = StringIO()
    monkeypatch.setattr(sys, 'stdout', output)
    monkeypatch.setattr(sys, 'stderr', output)
    recording = hand_recording(240, 'left')._replace(**change)
    if name.endswith('.mcap'):
        write_bag(name, marker_messages(
            recording.points, recorded_times(recording), ('hand',) * 8))
    else:
        write_recording(name, recording)
    printed = run_what_inspect_names(name)
    assert said in printed and '240 of 240 frames tracked' in printed
    assert 'searched for a right hand' not in printed


def test_inspect_has_messages_of_other_axes_converted_and_names_nothing_for_no_points(
        tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    recording = hand_recording(60)
    write_bag('take.mcap', marker_messages(
        recording.points, recorded_times(recording), ('hand',) * 8))
    assert main(['inspect', 'take.mcap', '--up', 'y']) == 0
    command = capsys.readouterr().out.splitlines()[-1]
    assert command == 'next: hand_tracker convert take.mcap take_points.npz --up=y'
    assert main(command.removeprefix('next: hand_tracker ').split()) == 0
    write_recording('none.npz', recording._replace(points=np.full_like(recording.points, np.nan)))
    capsys.readouterr()
    assert main(['inspect', 'none.npz']) == 0
    assert capsys.readouterr().out.endswith('\nno point is seen in any frame\n')
    assert main(['track', 'none.npz', '-o', 'angles.csv']) == 1
    assert 'none.npz: no point is seen in any of its 60 frames' in capsys.readouterr().err


@pytest.mark.parametrize('name, labels', [
    ('cloud.npz', ('',) * 9), ('numbers.trc', tuple(map(str, range(9)))), ('ids.mcap', None)])
def test_inspect_has_as_many_points_as_a_layout_has_markers_labelled_as_these(
        tmp_path, monkeypatch, capsys, name, labels):
    monkeypatch.chdir(tmp_path)
    recording, _ = vicon_recording(labels or ('',) * 9, 60)
    if labels is None:
        write_bag(name, marker_messages(recording.points, recorded_times(recording), ('leds',) * 9))
    else:
        write_recording(name, recording)
    assert main(['inspect', name, '--json']) == 0
    found = json.loads(capsys.readouterr().out)
    assert {'name': 'vicon_production5', 'side': 'unknown', 'likelihood': 1.,
            'is_complete': False} in found['layouts']
    assert main(['inspect', name]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert not any(line.startswith('first, ') for line in lines)
    assert ('leave out --labels none' in lines[-2]) == (labels is None)
    command = lines[-1].removeprefix('next: hand_tracker ').split()
    assert command[4:] == ['--layout', 'vicon_production5', '--labels', 'none']
    assert main([*command, '--side', 'left']) == 0
    assert '60 of 60 frames tracked' in capsys.readouterr().out


def test_inspect_has_the_markers_of_a_body_spliced(tmp_path, capsys):
    recording = hand_recording(60)
    there = np.linspace(.5, 1.5, 8)[:, None]
    body = recording._replace(
        labels=('Anna:RWRA', 'Anna:RWRB', *(f'Anna:B{i}' for i in range(8))),
        points=np.concatenate((recording.points[:, :1], recording.points[:, :1] + np.float32(.03),
                               recording.points[:, :8] + there), axis=1).astype(np.float32))
    write_recording(tmp_path / 'body.c3d', body)
    assert main(['inspect', str(tmp_path / 'body.c3d')]) == 0
    output = capsys.readouterr().out
    assert 'no layout of a hand is known by these labels' in output
    assert output.endswith(
        f'splice {tmp_path / "body.c3d"} HAND -o body_hands.c3d\n')
    # A hand whose markers have names of their own is none.
    near = body._replace(points=np.concatenate((body.points[:, :2], recording.points), axis=1))
    write_recording(tmp_path / 'hand.c3d', near)
    assert main(['inspect', str(tmp_path / 'hand.c3d')]) == 0
    assert "next, if a hand's markers are among them" in capsys.readouterr().out


def test_inspect_names_another_output_for_each_recording_of_a_folder(tmp_path, capsys):
    found = []
    for name in ('take.trc', 'take.tsv', 'other.trc'):
        write_recording(tmp_path / name, hand_recording(60))
    (tmp_path / 'other.yaml').touch()
    for name in ('take.trc', 'take.tsv', 'other.trc'):
        assert main(['inspect', str(tmp_path / name)]) == 0
        found.append(capsys.readouterr().out.partition(' -o ')[2].split()[0])
    assert found == ['take_trc_angles.csv', 'take_tsv_angles.csv', 'other_angles.csv']


def test_inspect_names_folders_where_outputs_of_recordings_would_have_one_name(
        tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    recordings = ['take.trc', 'a/take.trc', 'b/take.c3d', 'b/other.trc', 'c/d/take.trc',
                  'c/e/take.trc']
    for name in recordings:
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        write_recording(path, hand_recording(60))

    def outputs():
        found = []
        for name in recordings:
            assert main(['inspect', name]) == 0
            found.append(capsys.readouterr().out.partition(' -o ')[2].split()[0])
        return found

    names = ['take_angles.csv', 'a_take_angles.csv', 'b_take_angles.csv', 'other_angles.csv',
             'c_d_take_angles.csv', 'c_e_take_angles.csv']
    assert outputs() == names
    # Of another folder's recording, as far as is known.
    (tmp_path / 'other_angles.csv').touch()
    (tmp_path / 'take_angles.csv').touch()
    assert outputs() == [*names[:3], 'b_other_angles.csv', *names[4:]]


def test_inspect_names_the_likelier_unit_in_its_command(tmp_path, capsys):
    recording = hand_recording(60)
    write_recording(tmp_path / 'take.npz', recording._replace(points=1000. * recording.points))
    assert main(['inspect', str(tmp_path / 'take.npz')]) == 0
    assert ' --units=mm ' in capsys.readouterr().out.splitlines()[-1]


def test_a_unit_is_not_doubted_where_a_scale_is_given(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    recording = hand_recording(240)
    write_recording('take.npz', recording._replace(points=1000. * recording.points))
    assert main(['track', 'take.npz', '-o', 'out.csv', '--unit-scale', '0.001']) == 0
    assert main(['convert', 'take.npz', 'out.npz', '--unit-scale', '0.001']) == 0
    said = capsys.readouterr()
    assert '240 of 240 frames tracked' in said.out and '--units' not in said.err
    np.testing.assert_allclose(read_recording('out.npz').points, recording.points, rtol=1e-5)


@pytest.mark.parametrize('unit, size', [('mm', 1000.), ('cm', 100.), ('in', 1. / .0254)])
# The side of the paper's eight is found by their shape.
@pytest.mark.parametrize('layout, found', [('paper8', 'left'), ('sig18_19', 'unknown')])
def test_the_unit_of_points_without_labels_is_named(tmp_path, monkeypatch, capsys, unit, size,
                                                    layout, found):
    monkeypatch.chdir(tmp_path)
    hand, worn = Hand.scaled(side='left'), preset_layout(layout)
    angles_of_frames, *wrist = demo_motion(hand).sample(np.arange(60) / 30.)
    points = markers_of(hand, angles_of_frames, worn, *wrist)
    recording = hand_recording(60)._replace(
        labels=('',) * points.shape[1], points=(size * points).astype(np.float32))
    write_recording(tmp_path / 'take.npz', recording)
    note = f'as the markers of a hand: is the file in {unit}, not in m? (--units {unit})'
    assert main(['inspect', 'take.npz']) == 0
    lines = capsys.readouterr().out.splitlines()
    assert note in lines[2] and f' --units={unit} ' in lines[-1]
    assert any(line.startswith(f'layout {layout}, {found} hand') for line in lines)
    assert main(['track', 'take.npz', '-o', 'angles.csv', '--side', 'left']) == 1
    # Before anything is searched.
    assert note in capsys.readouterr().err.splitlines()[0]
    # Nothing is said of points in the file's unit, nor of those of no hand.
    for others in (points, 1.5 * np.random.default_rng(1).uniform(size=points.shape)):
        write_recording(tmp_path / 'take.npz', recording._replace(points=others.astype(np.float32)))
        assert main(['inspect', 'take.npz']) == 0
        assert 'is the file in' not in capsys.readouterr().out


def test_the_unit_of_markers_with_ids_is_given_as_their_scale(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    recording = hand_recording(240)
    write_bag('take.mcap', marker_messages(
        1000. * recording.points, recorded_times(recording), ('hand',) * 8))
    assert main(['inspect', 'take.mcap']) == 0
    command = capsys.readouterr().out.splitlines()[-1].removeprefix('next: hand_tracker ').split()
    assert '--unit-scale=0.001' in command
    for given in (command, [word.replace('--unit-scale=0.001', '--units=mm') for word in command]):
        assert main(given) == 0
        assert '240 of 240 frames tracked' in capsys.readouterr().out


def test_frames_that_were_left_out_are_missing_in_other_formats(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    whole = hand_recording(360)
    kept = np.r_[0:100, 140:300, 301:360]
    times = np.arange(360) / 120. + np.random.default_rng(0).uniform(-1e-3, 1e-3, 360)
    write_recording(tmp_path / 'drop.mcap', whole._replace(
        labels=MARKERS, points=whole.points[kept], stamps=times[kept]))
    assert main(['inspect', 'drop.mcap', '--json']) == 0
    found = json.loads(capsys.readouterr().out)
    assert found['frames'] == 319 and found['seconds'] == pytest.approx(359 / 120., abs=.01)
    assert found['gaps_pct'] == pytest.approx(100. * 41 / 360, abs=.01)
    for name in ('drop.c3d', 'drop.tsv', 'drop.npz', 'drop.trc'):
        assert main(['convert', 'drop.mcap', name]) == 0
        assert '41 frames between the others were left out' in capsys.readouterr().err
        seen = read_recording(tmp_path / name).seen.all(axis=1)
        assert np.flatnonzero(seen).tolist() == kept.tolist()
    assert main(['track', 'drop.mcap', '-o', 'drop.bvh', '--no-auto-size']) == 0
    assert len(read_recording(tmp_path / 'drop.bvh').points) == 360


def test_times_that_jitter_or_rest_for_long_leave_nothing_out():
    random = np.random.default_rng(1)
    even = np.arange(5000) / 100.0004
    np.testing.assert_array_equal(even_rows(even), np.arange(5000))
    np.testing.assert_array_equal(even_rows(even + random.uniform(-.003, .003, 5000)),
                                  np.arange(5000))
    paused = np.concatenate((np.arange(50.), 1e7 + np.arange(50.)))
    np.testing.assert_array_equal(even_rows(paused), np.arange(100))


def test_a_rate_that_no_file_says_is_assumed_and_given(tmp_path, capsys):
    path = tmp_path / 'take.npz'
    write_recording(path, hand_recording(240)._replace(rate=np.nan))
    out = tmp_path / 'angles.csv'
    assert main(['track', str(path), '-o', str(out)]) == 0
    assert 'does not say its rate: 100 Hz is assumed (--frame-rate)' in capsys.readouterr().err
    assert angles(out)[-1, 0] == pytest.approx(239 / 100.)
    assert main(['track', str(path), '-o', str(out), '--frame-rate', '60']) == 0
    assert 'its rate' not in capsys.readouterr().err
    assert angles(out)[-1, 0] == pytest.approx(239 / 60.)


@pytest.mark.parametrize('name', ['take.trc', 'take.csv', 'vicon.csv', 'take.c3d', 'take.npz'])
def test_the_table_has_the_time_of_the_file(tmp_path, capsys, name):
    path, out = tmp_path / name, tmp_path / 'angles.csv'
    recording = hand_recording(240)._replace(stamps=5. + np.arange(240) / 120.)
    recording.points[:30] = np.nan
    write_recording(path, recording, VICON_CSV if 'vicon' in name else None)
    if 'vicon' in name:    # its frames have numbers alone
        assert [line.partition(',')[0] for line in path.read_text().splitlines()[5:]] == [
            str(601 + frame) for frame in range(240)]
    elif path.suffix == '.c3d':
        data = bytearray(path.read_bytes())
        struct.pack_into('<2H', data, 6, 601, 840)
        for field, number in (b'ACTUAL_START_FIELD', 601), (b'ACTUAL_END_FIELD', 840):
            # Behind the name: length, type, and its dimensions.
            struct.pack_into('<2H', data, data.index(field) + len(field) + 5, number, 0)
        assert data == path.read_bytes()
    assert main(['track', str(path), '-o', str(out)]) == 0
    np.testing.assert_allclose(angles(out)[:, 0], 5. + np.arange(30, 240) / 120., atol=1e-6)
    assert 'at 5.25 s: tracking' in capsys.readouterr().err


@pytest.mark.parametrize('name', ['centres.trc', 'centres.c3d'])
def test_joint_centres_have_the_time_of_the_file(tmp_path, name):
    path, out = tmp_path / 'take.trc', tmp_path / name
    recording = hand_recording(60)._replace(stamps=700. + np.arange(60) / 120.)
    recording.points[:30] = np.nan
    write_recording(path, recording)
    assert main(['track', str(path), '-o', str(out)]) == 0
    np.testing.assert_allclose(read_recording(out).times(), recording.stamps[30:], atol=1e-6)


def test_a_recording_of_messages_has_the_stamps_of_the_file(tmp_path):
    recording = hand_recording(20)._replace(stamps=5. + np.arange(20) / 120.)
    write_recording(tmp_path / 'take.mcap', recording)
    with open_bag(tmp_path / 'take.mcap') as bag:
        assert (bag.start, bag.duration) == (5 * 10**9, round(19e9 / 120.))
    # A stamp of zero is none.
    assert recorded_times(recording._replace(stamps=recording.stamps - 5.))[0] == 10**9


@pytest.mark.parametrize('times', [[0., 1.], [[0.], [1.], [2.]], [0., np.nan, 2.], [0., 2., 1.]])
def test_times_of_an_npz_file_that_are_none_are_refused(tmp_path, times):
    write_recording(tmp_path / 'take.npz', hand_recording(3))
    with np.load(tmp_path / 'take.npz') as fields:
        np.savez(tmp_path / 'bad.npz', **fields, times_s=np.array(times))
    with pytest.raises(RecordingError, match='bad.npz: times_s of shape .*; expected 3 increasing'):
        read_recording(tmp_path / 'bad.npz')


@pytest.mark.parametrize('suffix', ['bvh', 'csv'])
def test_a_motion_that_begins_later_than_the_recording_says_so(tmp_path, suffix, capsys):
    recording, path = hand_recording(240), tmp_path / 'take.c3d'
    recording.points[:60] = np.nan
    write_recording(path, recording)
    assert main(['track', str(path), '-o', str(tmp_path / f'out.{suffix}')]) == 0
    late = 'it begins 0.50 s after the recording' in capsys.readouterr().out
    assert late == (suffix == 'bvh')
    assert main(['track', str(path), '-o', str(tmp_path / f'absent/out.{suffix}')]) == 1
    said = capsys.readouterr().err
    assert 'expected one to write into' in said and 'tracking' not in said


def test_what_a_file_lacks_is_named_without_topics_and_ids(tmp_path, capsys):
    recording, path = hand_recording(900), tmp_path / 'take.c3d'
    recording.points[:, 7] = np.nan      # the thumb
    recording.points[200:800] = np.nan
    write_recording(path, recording)
    assert main(['track', str(path), '-o', str(tmp_path / 'angles.csv')]) == 0
    said = capsys.readouterr()
    assert '300 of 900 frames tracked, the others are not written' in said.out
    assert 'never seen so far: thumb; ' in said.err
    assert 'frames of take.c3d have held no marker of the hand' in said.err
    assert "'7'" not in said.err and '/markers' not in said.err
    assert 'no hand file: markers count as at the joints' in said.err


@pytest.mark.parametrize('layout, said', [
    ('sig18_19', 'no hand file: --layout sig18_19_skin has these markers where people wear them'),
    ('sig18_19_skin', '')])
def test_where_people_wear_the_markers_of_a_preset_is_told_without_a_hand_file(
        tmp_path, capsys, layout, said):
    hand, worn = Hand.scaled(), preset_layout(layout)
    angles_of_frames, *wrist = demo_motion(hand).sample(np.arange(60) / 30.)
    points = markers_of(hand, angles_of_frames, worn, *wrist).astype(np.float32)
    path = tmp_path / 'take.npz'
    write_recording(path, hand_recording(60)._replace(labels=worn.names, points=points))
    assert main(['track', str(path), '-o', str(tmp_path / 'angles.csv'), '--layout', layout,
                 '--side', 'right']) == 0
    found = capsys.readouterr().err
    assert said in found and ('no hand file' in found) == bool(said)


def test_a_palm_of_another_size_is_said_once_though_markers_come_and_go(tmp_path, capsys):
    recording, path = hand_recording(600), tmp_path / 'take.npz'
    recording.points[150:300, 1] = np.nan
    write_recording(path, recording._replace(points=4. * recording.points))
    assert main(['track', str(path), '-o', str(tmp_path / 'angles.csv')]) == 1
    said = capsys.readouterr().err
    assert said.count('the palm markers are too far apart for this hand') == 2     # and at the end
    assert 'waiting for the palm' not in said and 'the last pose is kept' not in said


def test_a_hand_that_is_left_out_is_told_of(tmp_path, capsys):
    path, out = tmp_path / 'take.c3d', str(tmp_path / 'angles.csv')
    write_recording(path, both_hands())
    assert main(['track', str(path), '-o', out]) == 0
    assert 'labels name a left hand, too, which is left out (--side left, or both)' in (
        capsys.readouterr().err)
    assert main(['track', str(path), '-o', out, '--side', 'right']) == 0
    assert 'left out' not in capsys.readouterr().err
    hands = [hand_recording(40), hand_recording(40, start=60)]
    write_recording(path, hands[0]._replace(
        labels=tuple(f'{name}:{label}' for name, hand in zip(('Anna', 'Ben'), hands)
                     for label in hand.labels),
        points=np.concatenate([hand.points for hand in hands], axis=1)))
    assert main(['track', str(path), '-o', out]) == 0
    assert 'Ben: points called as those of Anna, which are taken (--subject)' in (
        capsys.readouterr().err)
    assert main(['track', str(path), '-o', out, '--subject', 'Ben']) == 0
    assert 'Anna' not in capsys.readouterr().err
    ben = angles(out)
    write_recording(path, hands[1])
    assert main(['track', str(path), '-o', out]) == 0
    np.testing.assert_array_equal(angles(out), ben)
    write_recording(path, both_hands())
    assert main(['track', str(path), '-o', out, '--subject', 'Max']) == 1
    assert "no points of 'Max'; expected one of its subjects: it has none" in (
        capsys.readouterr().err)


def test_inspect_finds_both_hands_by_their_namespaces(tmp_path, capsys):
    assert main(['inspect', str(packaged_recording('both'))]) == 0
    assert capsys.readouterr().out.endswith('-o demo_both_angles.csv --side both\n')
    write_recording(tmp_path / 'cloud.trc', both_hands()._replace(labels=('',) * 16))
    assert main(['inspect', str(tmp_path / 'cloud.trc')]) == 0
    assert capsys.readouterr().out.endswith(
        'cloud.trc -o cloud_angles.csv --side both --labels none\n')


def test_both_hands_keep_their_ids_from_one_rosbag2_recording_to_another(tmp_path):
    source = packaged_recording('both')
    assert main(['convert', str(source), str(tmp_path / 'both.mcap')]) == 0
    assert read_recording(tmp_path / 'both.mcap').labels == read_recording(source).labels


def test_recordings_that_differ_by_their_suffix_alone_keep_it(tracked, tmp_path, capsys):
    recordings = [str(tracked / name) for name in ('take.c3d', 'take.trc', 'vicon.csv')]
    assert main(['track', *recordings, '-o', str(tmp_path / 'out')]) == 0
    names = {path.name for path in (tmp_path / 'out').iterdir()}
    assert names == {'take.c3d.csv', 'take.trc.csv', 'vicon.csv'}
    table = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in table[1:4]] == ['take.c3d', 'take.trc', 'vicon']


def test_a_recording_that_was_replaced_is_tracked_again(tmp_path, capsys):
    takes = tmp_path / 'takes'
    takes.mkdir()
    path, command = takes / 'take.trc', ['track', str(takes), '-o', str(tmp_path / 'out')]
    for frames, age, is_there in ((40, 100., False), (40, 100., True), (60, -100., False)):
        write_recording(path, hand_recording(frames))
        written = time.time() - age
        os.utime(path, (written, written))
        assert main([*command, '--resume']) == 0
        assert ('already there' in capsys.readouterr().out) == is_there
    assert len(angles(tmp_path / 'out' / 'take.csv')) == 60


def test_takes_and_captures_are_read_from_every_format(tracked, tmp_path):
    take = load_take(tracked / 'take.trc')
    assert take.side == 'right' and take.names == PAPER_PLACES and take.rate == 120.
    assert take.is_optical
    # A posed hand is a capture of its joints.
    assert main(['convert', str(tracked / 'take.c3d'), str(tmp_path / 'hand.bvh')]) == 0
    path = tmp_path / 'hand.bvh'
    text = path.read_text(encoding='utf-8')
    head, motion = text.split('MOTION\n')
    rows = motion.splitlines()[2:]
    path.write_text(f'{head}MOTION\nFrames: {3 * len(rows)}\nFrame Time: 0.0083333\n'
                    + '\n'.join(rows * 3) + '\n', encoding='utf-8')
    capture = load_capture(path)
    assert capture.side == 'right' and not capture.missing and len(capture.joints) == 720


def vicon_recording(labels, frames):
    """Return a left hand with Vicon's markers, 60 frames a second, and its pose."""
    layout, hand = preset_layout('vicon_production5'), Hand.scaled(side='left')
    pose = demo_motion(hand).sample(np.arange(frames) / 60.)
    points = markers_of(hand, pose[0], layout, *pose[1:])
    return PointRecording('vicon', 'test', labels, points.astype(np.float32), 60., None,
                          Axes('m', 'z')), pose


@pytest.mark.parametrize('frames, is_take', [(360, True), (240, False)])
def test_inspect_has_the_hand_of_another_layout_fitted_first(tmp_path, capsys, frames, is_take):
    path = tmp_path / 'vicon.c3d'
    labels = tuple(f'Anna:L{name}' for name in preset_layout('vicon_production5').names)
    write_recording(path, vicon_recording(labels, frames)[0])
    assert main(['inspect', str(path)]) == 0
    output = capsys.readouterr().out
    assert output.endswith(f'next: hand_tracker track {path} -o vicon_angles.csv --layout '
                           'vicon_production5 --side left\n')
    assert (f': hand_tracker calibrate {path} -o my_hand.yaml --layout vicon_production5 '
            '--side left (then --hand my_hand.yaml' in output) == is_take


def test_other_layouts_are_tracked_by_their_labels_or_their_shape(tmp_path, capsys):
    layout = preset_layout('vicon_production5')
    labels = tuple(f'Anna:L{name}' for name in layout.names[:-1]) + ('nail',)
    path = tmp_path / 'vicon.c3d'
    recording, pose = vicon_recording(labels, 60)
    write_recording(path, recording)
    command = ['track', str(path), '-o', str(tmp_path / 'angles.csv'), '--layout',
               'vicon_production5']
    assert main([*command, '--no-auto-size']) == 0
    assert 'no label for PNK6; the other 8 markers are tracked' in capsys.readouterr().err
    assert main([*command, '--no-auto-size', '--markers', 'PNK6=nail']) == 0
    assert 'no label' not in capsys.readouterr().err
    found = np.radians(angles(tmp_path / 'angles.csv')[:, 1:])
    joint = JOINTS.index('little_mcp_flexion')
    assert np.abs(found[:, joint] - pose[0][:, joint]).max() < np.radians(6.)
    by_labels = found
    assert main([*command, '--no-auto-size', '--labels', 'none', '--side', 'left']) == 0
    found = np.radians(angles(tmp_path / 'angles.csv')[:, 1:])
    assert np.abs(found[-30:] - by_labels[-30:]).max() < np.radians(1.)


def test_a_calibration_says_which_of_two_hands_it_fits(tmp_path):
    write_recording(tmp_path / 'both.c3d', both_hands(60))
    path = tmp_path / 'both.c3d'
    note = f'{path}: the right hand is fitted; labels name a left one, too (--side left)'
    assert note in recorded_take(path).notes
    for side in SIDES:
        chosen = recorded_take(path, side)
        assert chosen.side == side and note not in chosen.notes


@pytest.mark.parametrize('rate, given, is_doubted', [
    (120., None, False), (2400., None, True), (2400., 2400., False)])
def test_a_rate_at_which_markers_are_too_fast_for_a_hand_is_doubted(
        tmp_path, rate, given, is_doubted):
    path = tmp_path / 'take.trc'
    write_recording(path, hand_recording(600)._replace(rate=rate))
    notes = PointBag(path, MarkerChoice(ReadingOptions(frame_rate=given))).notes
    assert any(f'is {rate:g} Hz its rate' in note for note in notes) == is_doubted
