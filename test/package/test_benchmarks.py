"""The commands of `benchmarks/` run, in short, and write the rows that they promise."""

import json
import os
import subprocess
import sys
from importlib import import_module
from xml.etree import ElementTree

import numpy as np
import pytest

from benchmarks import peers, retarget, retarget_peers, write_document
from benchmarks.offline import measure_many
from benchmarks.repository import REPOSITORY
from hand_tracker.calibration.landmarks import LANDMARKS
from hand_tracker.core.model.hand import ROOT, Hand, preset_limits
from hand_tracker.files.urdf_file import urdf
from hand_tracker.retargeting.robot_hand import robot_hand
from hand_tracker.retargeting.robot_urdf import load_urdf_tree


def run(name, *arguments, folder):
    """Return the rows of a benchmark that runs as a file, in another folder."""
    out = folder / f'{name}.json'
    subprocess.run([sys.executable, REPOSITORY / 'benchmarks' / f'{name}.py', *map(str, arguments),
                    '--json', out], cwd=folder, check=True, stdout=subprocess.DEVNULL)
    return json.loads(out.read_text())


def test_the_inverse_kinematics_alone_meets_the_markers(tmp_path):
    rows = run('peers', '--frames', 50, '--peers', 'hand_tracker', folder=tmp_path)
    assert [(row['method'], row['wrist']) for row in rows] == [
        ('inverse kinematics alone', 'given'), ('inverse kinematics alone', 'solved'),
        ('the whole core', 'solved')]
    for row in rows[:2]:
        assert row['frames'] == 50
        assert row['mean_mm'] < .05
        assert row['degrees'] < 1.
        assert 0. < row['median_ms'] <= row['p99_ms']


@pytest.mark.parametrize('given', [True, False])
def test_peers_are_given_what_they_need_to_meet_the_markers(given):
    scene = peers.Scene(30, 0.)
    row = peers.measure('scipy', peers.Scipy, 'bounded', {}, given, scene)
    assert row['mean_mm'] < .01
    model = pytest.importorskip('pinocchio').buildModelFromXML(scene.urdf)
    assert set(model.names) - {'universe'} == set(scene.names)
    for marker in peers.MARKERS:
        assert model.existFrame(f'marker_{marker}')


@pytest.mark.parametrize('name, kind, module, given', [
    ('placo', peers.Placo, 'placo', True), ('placo', peers.Placo, 'placo', False),
    ('pink', peers.Pink, 'pink', False), ('mink', peers.Mink, 'mink', False)])
def test_quadratic_programmes_converge_to_the_markers(name, kind, module, given):
    pytest.importorskip(module, reason='only with requirements/peers.in')
    row = peers.measure(name, kind, 'converged', peers.ALL_ROUNDS, given, peers.Scene(30, 0.))
    assert row['mean_mm'] < .001


def test_retargeting_touches_where_the_person_does_without_a_peer(tmp_path):
    # Our own hand in the place of a robot's, as no robot's URDF is in this repository.
    (tmp_path / 'shadow_hand_right.urdf').write_text(urdf(Hand.scaled(
        limits=preset_limits('wide'))))
    row, = run('retarget', '--urdfs', tmp_path, '--robots', 'shadow', '--peers', folder=tmp_path)
    assert row['method'] == 'hand_tracker'
    assert (row['robot'], row['recording']) == ('shadow', 'pinches (simulated)')
    assert row['pinch_frames'] > 200 and row['pinch_share'] > .99
    assert row['max_step_rad'] <= .08 and abs(row['lag_ms']) < 2.
    assert 0. < row['median_us'] <= row['p99_us']


def test_peers_of_retargeting_that_are_not_installed_are_said_once(monkeypatch, capsys):
    for package in retarget_peers.RETARGETING_PEERS.values():
        monkeypatch.setitem(sys.modules, package.module, None)
    assert not retarget_peers.installed(retarget_peers.RETARGETING_PEERS)
    lines = capsys.readouterr().err.splitlines()
    assert [line.split(':')[0] for line in lines] == list(retarget_peers.RETARGETING_PEERS)
    assert all('pip install -r requirements/peers.in' in line for line in lines)


def solver_of_our_hand(peer, folder):
    """Return a peer's solver of our own hand as a robot, in the frame that peers expect."""
    hand = ElementTree.fromstring(urdf(Hand.scaled(
        limits=preset_limits('wide'))).partition('?>')[2])
    hand.extend(ElementTree.fromstring(
        '<robot><link name="base"/><joint name="turn" type="fixed">'
        f'<origin rpy="0 {-np.pi / 2} 0"/><parent link="base"/><child link="{ROOT}"/>'
        f'</joint></robot>'))
    path = folder / 'our_hand.urdf'
    ElementTree.ElementTree(hand).write(path)
    robot = robot_hand(load_urdf_tree(path))
    setup = retarget_peers.Setup('vector', 'base', 1.)
    if peer != 'dex-retargeting':
        return robot, retarget_peers.RETARGETING_PEERS[peer].solvers('', robot, path, setup)[0]
    config, digits = folder / 'vector.yml', robot.anatomy.digits
    config.write_text(json.dumps({'retargeting': {
        'type': 'vector', 'urdf_path': str(path), 'scaling_factor': 1.,
        'target_origin_link_names': ['base'] * len(digits),
        'target_task_link_names': [digit.tip_link for digit in digits.values()],
        'target_link_human_indices': [[0] * len(digits), [
            LANDMARKS.index(f'{role}_tip') for role in digits]]}}))
    return robot, retarget_peers.DexRetargeting(robot, path, setup, 'vector', config)


@pytest.mark.parametrize('peer', retarget_peers.RETARGETING_PEERS)
def test_peers_of_retargeting_are_given_what_they_need_to_meet_the_tips(
        peer, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its warnings there
    try:
        import_module(retarget_peers.RETARGETING_PEERS[peer].module)
    except ImportError:
        pytest.skip('only with requirements/peers.in')
    recording = retarget.pinches()
    recording.landmarks = recording.landmarks[:60]
    robot, solver = solver_of_our_hand(peer, tmp_path)
    row = retarget.run(solver, recording, robot, set())
    assert row['tip_error_mm'] < 2.


def test_the_path_of_a_frame_is_short(tmp_path):
    pytest.importorskip('rclpy')
    row, = run('main_path', '--frames', 20, folder=tmp_path)
    assert row['answer_files'] <= 33 and row['answer_functions'] <= 132
    # The monitor's part of it runs ten times a second, for all frames since.
    assert row['files'] <= 35 and row['functions'] <= 149
    assert row['calls_after'] <= 3 and row['climbs'] <= 3 and row['upward_imports'] == 0


def test_recordings_are_tracked_in_parallel(tmp_path):
    row = measure_many(50., 2., 2, 2, tmp_path)
    assert (row['frames'], row['recordings'], row['jobs']) == (100, 2, 2)
    assert len(list((tmp_path / 'angles').iterdir())) == 2
    assert 0. < row['frames_per_s_core'] and 0. < row['peak_mb']


def test_two_hands_among_points_are_timed_beside_labelled_ones(tmp_path):
    rows = run('labelling', '--frames', 240, folder=tmp_path)
    assert [row['way'] for row in rows] == ['labelled', 'following', 'search']
    assert rows[0]['ratio'] == 1. and all(row['ratio'] > 0. for row in rows)
    assert all(row['points'] == 40 for row in rows)
    assert rows[1]['right_pct'] > 95.


@pytest.mark.ros
def test_nothing_grows_in_a_few_frames(tmp_path):
    pytest.importorskip('rclpy')
    rows = run('memory', '--frames', 400, folder=tmp_path)
    assert [row['what'] for row in rows] == ['core', 'fast path', 'node']
    assert all(row['frames'] == 400 for row in rows)
    assert all(row['grown_mb'] < 1. for row in rows)


@pytest.mark.ros
def test_every_round_trip_is_kept(tmp_path):
    pytest.importorskip('rclpy')
    rows = run('round_trip', '--rates', 100, '--seconds', .5, '--hands', 1, 'both',
               '--samples', tmp_path / 'trips.npz', folder=tmp_path)
    assert {(row['node'], row['hands']) for row in rows} >= {
        (node, hands) for node in ('hand_tracker', 'rclpy_echo') for hands in (1, 'both')}
    with np.load(tmp_path / 'trips.npz') as trips:
        assert len(trips.files) == len(rows)
        for row in rows:
            taken = trips[f"{row['node']}_100_{row['hands']}"]
            # Both hands in one message are one answer.
            assert len(taken) == 50 * (1 if row['hands'] == 'both' else row['hands'])
            assert np.isnan(taken).mean() == pytest.approx(.01 * row['dropped_percent'], abs=1e-5)
            assert row['median_us'] == pytest.approx(np.nanmedian(taken), abs=.06)


def test_the_document_has_every_row(tmp_path, monkeypatch):
    rows = [{'start': 'cold', 'seconds': 31.5}, {'start': 'warm', 'seconds': 1.25, 'starts': 3}]
    (tmp_path / 'startup.json').write_text(json.dumps(rows))
    monkeypatch.setattr(sys, 'argv', [
        'write_document', str(tmp_path), '-o', str(tmp_path / 'out.md')])
    assert write_document.main() == 0
    text = (tmp_path / 'out.md').read_text()
    assert '## startup' in text and 'benchmarks.startup' in text
    lines = [[cell.strip() for cell in line.strip('|').split('|')]
             for line in text.splitlines() if line.startswith('|')]
    assert ['start', 'seconds', 'starts'] in lines
    assert ['cold', '31.5', ''] in lines and ['warm', '1.25', '3'] in lines
    # What is not measured anew stays, and is said to be of before, once.
    (tmp_path / 'startup.json').unlink()
    for _ in range(2):
        assert write_document.main() == 0
    text = (tmp_path / 'out.md').read_text()
    assert '| cold  |    31.5 |' in text and text.count(write_document.EARLIER) == 1


def test_an_entry_is_fuzzed_and_what_adds_coverage_is_kept(tmp_path):
    pytest.importorskip('atheris', reason='only with requirements/fuzz.in')
    corpus = tmp_path / 'corpus'
    corpus.mkdir()
    (corpus / 'seed').write_text('wrist=leds/3')
    row, = run('fuzz_inputs', 'labels', '--seconds', 1, '--corpus', corpus, '--keep',
               folder=tmp_path)
    assert row['entry'] == 'labels' and row['executions'] > 0 and not row['fault']
    assert row['edges'] > row['edges_of_corpus'] > 0
    assert len(list(corpus.iterdir())) > 1


@pytest.mark.skipif(os.environ.get('HAND_TRACKER_FAULTS', '1') == '1',
                    reason='takes long: set HAND_TRACKER_FAULTS')
def test_what_is_killed_comes_back(tmp_path):
    for needed in ('rclpy', 'trajectory_msgs', 'viser', 'skimage'):
        pytest.importorskip(needed)
    *rows, robot = run('kills', '--count', 4, folder=tmp_path)
    assert sum(row['kills'] for row in rows) == sum(row['came_back'] for row in rows) == 4
    assert robot['commands'] > 20 and robot['steps_over_the_bound'] == 0
