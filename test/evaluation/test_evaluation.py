"""Evaluations: baselines against hand-made cases, rows, repeatability, and no truth let in."""

import json
import re

import numpy as np
import pytest
from helpers.capture_files import capture_path

from hand_tracker.__main__ import main
from hand_tracker.calibration import LANDMARKS, fit_hand
from hand_tracker.cli import evaluate
from hand_tracker.core.errors import HandTrackerError
from hand_tracker.core.model.hand import FINGERS, JOINTS, preset_limits
from hand_tracker.core.tracker import HandTracker
from hand_tracker.evaluation import (
    baselines,
    capture_fit,
    captured_hands,
    hidden_markers,
    noise_pip,
    noise_sensitivity,
    plain_hand,
    results,
    simulated,
    solvers,
)
from hand_tracker.evaluation.captures import Capture, InvalidCapture, load_capture
from hand_tracker.evaluation.demo_frames import demo_frames, tracked_hand
from hand_tracker.evaluation.evaluation_options import Options
from hand_tracker.evaluation.results import versions
from hand_tracker.evaluation.tables import Table, words
from hand_tracker.files.point_recording import Axes, PointRecording
from hand_tracker.files.recordings import write_recording

RATE = 60.


@pytest.fixture(scope='module')
def moving():
    """Return the demo motion as a capture of 10 s or so."""
    joints = demo_frames(RATE).joints[:700]
    return Capture('demo', joints, 'right', RATE)


@pytest.fixture(scope='module')
def capture_file(moving, tmp_path_factory):
    path = tmp_path_factory.mktemp('captures') / 'demo.npz'
    save(path, moving, source='a paper', licence='CC0')
    return path


def save(path, capture, **fields):
    np.savez(path, **{'positions': capture.joints, 'joints': np.array(LANDMARKS),
                      'side': capture.side, 'rate_hz': capture.rate, **fields})


@pytest.fixture(scope='module')
def fitted_hand(moving):
    joints = moving.joints[:moving.split]
    # A fit to joints without noise takes thrice as long.
    noise = np.random.default_rng(1).normal(0., .0005, joints.shape)
    return fit_hand(joints + noise, 'right')


@pytest.fixture
def fitted_once(fitted_hand, monkeypatch):
    """Fit the one hand of these tests once: that takes most of the time."""
    monkeypatch.setattr(capture_fit, 'fit_hand', lambda joints, side, limits: fitted_hand.replace(
        side=side, limits=preset_limits(limits, fitted_hand.range_of_motion)))


def local_markers(frames=240):
    """Return eight markers at rest in the palm's frame (frames, 8, 3), the digits' noisy [m]."""
    random = np.random.default_rng(1)
    local = np.tile(random.uniform(-.1, .1, (8, 3)), (frames, 1, 1))
    local[:, 3:] += random.normal(0., .01, (frames, 5, 3))
    return local


def test_pictures_name_things_as_people_do():
    assert words('thumb_cmc') == 'thumb CMC'
    assert words('manipnet__cup1_leftHand') == 'manipnet cup1 leftHand'
    assert words('spheres + fabrik') == 'spheres + FABRIK'
    assert words('tip') == 'tip'


def test_hold_last_stays_where_the_marker_was():
    local = local_markers()
    found = baselines.hold_last(local, 200, [4, 6], 120.)
    np.testing.assert_array_equal(found, np.repeat(local[199:200, [4, 6]], 40, axis=0))


def test_damped_velocity_starts_with_the_velocity_and_comes_to_rest():
    local = np.zeros((1320, 8, 3))
    local[:, 5, 0] = .12 * np.arange(1320) / 120.  # 0.12 m/s
    found = baselines.damped_velocity(local, 120, [5], 120.)[:, 0, 0] - local[119, 5, 0]
    assert found[0] == pytest.approx(.001, rel=.05)
    assert found[-1] == pytest.approx(.12 * baselines.DAMPING_TIME, rel=1e-3)
    assert (np.diff(found) >= 0.).all()


def test_a_marker_that_is_linear_in_its_neighbours_is_predicted(monkeypatch):
    monkeypatch.setattr(baselines, 'RIDGE', 1e-9)
    local = local_markers()
    local[:, 4] = .5 * local[:, 3] + .3 * local[:, 6] + (.01, .02, .03)
    hidden = local.copy()
    hidden[200:, 4] = np.nan
    found = baselines.linear_from_neighbours(hidden, 200, [4], 120.)
    np.testing.assert_allclose(found[:, 0], local[200:, 4], atol=1e-9)


def test_a_palm_marker_is_carried_exactly_by_a_palm_that_moves_without_spin():
    template = np.array(((0., 0., 0.), (.08, .03, 0.), (.07, -.03, 0.)))
    steps = np.arange(1, 11)[:, None, None] * np.array((.001, .002, 0.))
    markers = template + steps
    markers[:, 1] = np.nan
    rotation, position = baselines.carried_poses(markers, 1, template, np.eye(3))
    np.testing.assert_allclose(rotation, np.tile(np.eye(3), (10, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(position, steps[:, 0], atol=1e-12)


def test_the_palm_is_fitted_as_it_was_turned():
    template = np.array(((0., 0., 0.), (.08, .03, 0.), (.07, -.03, 0.)))
    turn = np.array(((0., 0., 1.), (1., 0., 0.), (0., 1., 0.)))
    frames = np.array((template @ turn.T + (1., 2., 3.), np.full((3, 3), np.nan)))
    rotation, position = plain_hand.palm_poses(frames, template)
    np.testing.assert_allclose(rotation[0], turn, atol=1e-12)
    np.testing.assert_allclose(position[0], (1., 2., 3.), atol=1e-12)
    assert np.isnan(rotation[1]).all()


def test_the_plain_hand_is_right_about_a_hand_as_plain_as_itself():
    hand = plain_hand.PlainHand(
        np.zeros((21, 3)), np.array([(.045, .026, .018)] * 4), np.array((.046, .036, .029)),
        np.array((0., 0., 1.)), 1.)
    angles = np.radians((20., 50., 40.))  # DIP = 0.8 PIP
    bends = np.cumsum(angles)
    chain = np.cumsum(hand.bones[0][:, None] * np.stack(
        (np.cos(bends), 0. * bends, -np.sin(bends)), axis=1), axis=0)
    np.testing.assert_allclose(
        plain_hand._finger(np.zeros(3), hand.bones[0], chain[1][None])[0], chain, atol=1e-9)


def test_recordings_give_rows_of_every_class_and_method(moving, fitted_once):
    rows = captured_hands.judge(moving)
    assert {row['method'] for row in rows} == set(captured_hands.CAPTURE_METHODS)
    for row in rows:
        assert {'evaluation', 'recording', 'method', 'joint_class', 'mean_mm', 'p95_mm',
                'frames'} <= row.keys()
        assert row['frames'] == 560
    assert [row['within_limits_pct'] for row in rows if 'within_limits_pct' in row] == (
        [100.] * (len(captured_hands.CAPTURE_METHODS) - 1))


def test_a_left_hand_is_judged_as_the_right_hand_it_mirrors(moving, fitted_once):
    left = moving._replace(joints=moving.joints * (1., -1., 1.), side='left')
    for ours, mirrored in zip(captured_hands.judge(moving), captured_hands.judge(left)):
        assert mirrored['mean_mm'] == pytest.approx(ours['mean_mm'], abs=1e-3)


@pytest.fixture
def few_windows(monkeypatch):
    monkeypatch.setattr(hidden_markers, 'WINDOW_COUNT', 4)
    monkeypatch.setattr(hidden_markers, 'DRAWN_SETS', 1)


def test_occlusion_is_the_same_again_and_another_with_another_seed(
        moving, few_windows, fitted_once):
    first, again, other = (hidden_markers.judge(moving, seed) for seed in (1, 1, 2))
    assert first == again
    assert first != other
    assert {(row['hidden'], row['hidden_s'], row['method']) for row in first} == {
        (kind, seconds, method) for kind in ('one', 'palm', 'two', 'three')
        for seconds in (.1, .25, .5, 1.) for method in hidden_markers.OCCLUSION_METHODS}


@pytest.mark.parametrize('hidden', [[4], [7], [1], [3, 6, 7]])
def test_neither_tracker_nor_baselines_see_what_is_hidden_or_to_come(
        moving, fitted_hand, hidden):
    start, length = 300, 40
    fitted = moving.joints[:moving.split]
    tracker = HandTracker(fitted_hand)
    for frame in moving.markers[:start]:
        tracker.update(frame)
    template = plain_hand.fit_plain(fitted).template[plain_hand.PLAIN_PALM]
    lies = moving.markers.copy()
    lies[start:start + length, hidden] = np.random.default_rng(1).uniform(-1., 1., (
        length, len(hidden), 3))
    lies[start + length + 1:] = 5.
    unknown = moving.markers.copy()
    unknown[start:start + length, hidden] = np.nan
    results = []
    for markers in (moving.markers, lies, unknown):
        places, _ = hidden_markers.predicted(tracker, markers, start, [length], hidden, RATE)
        poses = plain_hand.palm_poses(markers[:, :3], template)
        guesses = baselines.predictions(
            markers, poses, slice(start, start + length), hidden, RATE, template)
        results.append(np.array([places, *guesses.values()]))
    assert np.isfinite(results[0]).all()
    np.testing.assert_array_equal(results[0], results[1])
    np.testing.assert_array_equal(results[0], results[2])


def test_windows_begin_after_all_markers_and_have_them_in_half_of_the_frames(moving):
    joints = moving.joints.copy()
    joints[300:400, 0] = np.nan
    starts, lengths = hidden_markers.windows(moving._replace(joints=joints), 1)
    assert (starts >= moving.split).all() and max(lengths) == 1.
    whole = np.isfinite(joints[:, 0]).all(axis=1)
    assert all(whole[start - 1] and whole[start:start + 60].sum() >= 30 for start in starts)
    joints[::2, 0] = np.nan
    joints[1::3, 0] = np.nan
    with pytest.raises(InvalidCapture, match='no 0.1 s with all eight markers'):
        hidden_markers.windows(moving._replace(joints=joints), 1)


def test_short_recordings_have_short_windows(moving):
    _, lengths = hidden_markers.windows(moving._replace(joints=moving.joints[:70]), 1)
    assert lengths == {.1: 6, .25: 15, .5: 30}


def with_gaps(capture, share=.02):
    joints = capture.joints.copy()
    joints[np.random.default_rng(1).uniform(size=joints.shape[:2]) < share] = np.nan
    return capture._replace(joints=joints)


def test_all_methods_are_judged_on_the_same_frames(moving, few_windows, fitted_once):
    gaps = with_gaps(moving)
    judged = int(gaps.whole[gaps.split:].sum())
    assert judged < 500
    assert {row['frames'] for row in captured_hands.judge(gaps)} == {judged}
    rows = hidden_markers.judge(gaps, 1)
    for kind in hidden_markers.HIDDEN_KINDS:
        for seconds in hidden_markers.HIDDEN_LENGTHS:
            assert len({row['frames'] for row in rows if (row['hidden'], row['hidden_s']) == (
                kind, seconds)}) == 1
    assert all(np.isfinite(row['mean_mm']) and row['frames'] > 0 for row in rows)


def test_frames_before_the_palm_is_seen_are_not_judged(moving, fitted_once):
    """A cold start at the split would judge the pose of rest at the origin."""
    joints = moving.joints.copy()
    joints[moving.split - 20:moving.split + 30, 0] = np.nan
    rows = captured_hands.judge(moving._replace(joints=joints))
    assert {row['frames'] for row in rows} == {530}
    assert max(row['p95_mm'] for row in rows if row['joint_class'] == 'mcp') < 5.


def test_a_joint_that_is_never_captured_is_not_judged(moving, tmp_path):
    joints = moving.joints.copy()
    joints[:, LANDMARKS.index('little_pip')] = np.nan
    save(tmp_path / 'gap.npz', moving, positions=joints)
    capture = load_capture(tmp_path / 'gap.npz')
    assert capture.missing == ['little_pip']
    filled = capture_fit.fitting_joints(capture)
    assert np.isfinite(filled).all()
    np.testing.assert_array_equal(filled[:, :18], joints[:capture.split, :18])
    # The place of a mean hand, of the capture's size.
    away = np.linalg.norm(filled - moving.joints[:capture.split], axis=2)
    assert np.median(away[:, LANDMARKS.index('little_pip')]) < .02


KEYS = {'evaluation', 'recording', 'method', 'mean_mm', 'p95_mm', 'frames'}


@pytest.mark.parametrize('name', [  # those of markers have other rows and tests of their own
    name for name, one in evaluate.EVALUATIONS.items() if one.judges in ((), ('captures',))])
def test_every_evaluation_has_rows_of_the_same_keys(
        name, moving, few_windows, fitted_once, monkeypatch, tmp_path):
    evaluation = evaluate.EVALUATIONS[name]
    module = evaluation.load()
    for short, value in (('CAMERA_COUNT_DURATION', 1.), ('FRAME_RATES_DURATION', 1.),
                         ('ABLATION_DURATION', 1.), ('ABLATION_MOTIONS', ('demo',)),
                         ('NOISE_LEVELS', (.3,)), ('SIZE_ERRORS', (0.,)),
                         ('STEADINESS_DURATION', 1.), ('STEADY_MOTIONS', ('demo',))):
        if hasattr(module, short):
            monkeypatch.setattr(module, short, value)
    monkeypatch.setattr(simulated, 'MOTIONS', {'demo': None})
    short = demo_frames()
    short = short._replace(**{field: getattr(short, field)[:200] for field in (
        'angles', 'wrist_rotation', 'wrist_position', 'markers', 'joints')})
    monkeypatch.setattr(noise_pip, 'NOISE_DRAWS', 1)
    monkeypatch.setattr(noise_pip, 'PIP_DURATION', 3.)
    for module_of_demo in (noise_sensitivity, solvers):
        monkeypatch.setattr(module_of_demo, 'demo_frames', lambda: short)
    rows = evaluate.run_evaluation(name, Options((moving,), quiet=True))
    for row in rows:
        assert KEYS <= row.keys()
        assert ('hidden' in row and 'hidden_s' in row) != ('joint_class' in row)
        assert row['evaluation'] == name and row['frames'] > 0
        assert (row['mean_mm'] is None) == (name == 'deviations'), 'which are of angles alone'
    assert all(len(line) == len(table.header) for table in module.tables(rows)
               for line in table.lines)
    for line in module.losses(rows).lines if hasattr(module, 'losses') else ():
        assert 'nan' not in line and 'None' not in line
    results.write_results(tmp_path / 'results.md', rows, {name: module},
                          Options((moving,)), 'hand_tracker evaluate')
    document = (tmp_path / 'results.md').read_text()
    assert ('## Where it loses' in document) == hasattr(module, 'losses')
    assert ('2 %' in document) == (not evaluation.judges)


def test_what_loses_is_found_from_the_rows():
    rows = [{'recording': 'a', 'joint_class': name, 'method': method, 'mean_mm': mean}
            for name in captured_hands.JOINT_CLASSES
            for method, mean in (('hand_tracker', 2. if name == 'dip' else 1.), ('plain', 1.5))]
    assert captured_hands.losses(rows).lines == [
        'dip: the plain hand is nearer on a 2.00 mm against 1.50']


def test_hidden_markers_lose_by_recording():
    rows = [{'recording': recording, 'hidden': 'palm', 'hidden_s': .1, 'method': method,
             'mean_mm': mean} for recording, method, mean in (
        ('a', 'hand_tracker', 1.), ('a', 'hold_last', 6.),
        ('b', 'hand_tracker', 3.), ('b', 'hold_last', 2.))]
    assert hidden_markers.losses(rows).lines == [
        'b, a palm marker hidden for 0.1 s (3.00 mm against 2.00 of hold_last)']


def test_captured_bends_are_the_flexions_of_a_hand_that_only_flexes():
    frames = demo_frames()
    bends = hidden_markers.captured_bends(frames.joints)
    assert bends.shape == (len(frames.joints), 5, 3)
    fingers = [[JOINTS.index(f'{finger}_{joint}_flexion') for joint in ('pip', 'dip')]
               for finger in FINGERS]
    np.testing.assert_allclose(bends[:, :4, 1:], frames.angles[:, fingers], atol=1e-6)
    assert np.isnan(hidden_markers.captured_bends(np.full((2, 21, 3), np.nan))).all()


def test_a_leap_in_any_frame_of_a_window_or_after_it_is_a_step(moving, few_windows, fitted_once,
                                                               monkeypatch):
    mean = {row['hidden_s']: row['step_deg'] for row in hidden_markers.judge(moving, 1)
            if row['method'] == 'hand_tracker' and row['hidden'] == 'one'}
    plain = hidden_markers.advance
    start = min(hidden_markers.windows(moving, 1)[0])

    def leaping(tracker, frame, index, rate):
        state = plain(tracker, frame, index, rate)
        within = np.isnan(frame).any() and index == start + 10
        return state._replace(angles=state.angles + 2.) if within else state
    monkeypatch.setattr(hidden_markers, 'advance', leaping)
    for row in hidden_markers.judge(moving, 1):
        if row['method'] == 'hand_tracker' and row['hidden'] == 'one':
            if row['hidden_s'] == .1:
                assert row['step_deg'] == mean[.1] < 90.
            else:
                assert row['step_deg'] > 90.


def test_smoothing_is_judged_beside_the_raw_solve(monkeypatch):
    monkeypatch.setattr(noise_pip, 'NOISE_DRAWS', 1)
    still, swaying, swing = (noise_pip.judge(task, 1) for task in (
        (30., 0., 0.), (30., 0., noise_pip.SWAY_AMPLITUDE), (30., 10., 0.)))
    # 0.3 mm turn a PIP of 30 degrees by 2 to 3: two bones and the noise of both their ends.
    assert 2. < still['raw_jitter_degrees'] < 3.
    assert 7. * still['smoothed_jitter_degrees'] < still['raw_jitter_degrees']
    assert still['smoothed_jitter_degrees'] < swaying['smoothed_jitter_degrees']
    assert swing['raw_gain'] == pytest.approx(1., abs=.05)
    assert abs(swing['raw_lag_ms']) < 1.
    monkeypatch.setattr(noise_pip, 'USUAL_NOISE', 0.)
    clean = noise_pip.judge((30., 10., 0.), 1)
    assert clean['raw_gain'] == pytest.approx(1., abs=1e-3)
    assert clean['raw_lag_ms'] == pytest.approx(0., abs=.01)


def test_the_tracked_hand_is_not_the_moving_one():
    true = demo_frames(10.).hand
    hand, layout = tracked_hand(true, 1)
    assert layout.offsets.all()
    for name in ('finger_mcp', 'finger_bones', 'thumb_cmc', 'thumb_bones'):
        found, moved = getattr(hand, name), getattr(true, name)
        assert .001 < np.abs(found[moved != 0.] / moved[moved != 0.] - 1.).max() < .1


@pytest.mark.parametrize('fields, message', [
    ({'positions': np.zeros((200, 20, 3))}, 'positions of shape (200, 20, 3)'),
    ({'positions': np.zeros((200, 21, 3), dtype=complex)}, 'must be numbers'),
    ({'joints': np.array(LANDMARKS[1:])}, 'expected are the 21 joints'),
    ({'side': 'both'}, 'side both; expected right or left'),
    ({'rate_hz': -1.}, 'rate_hz -1; allowed is 5 to 2000 Hz'),
    ({'rate_hz': np.zeros(3)}, 'expected one number'),
    ({'positions': np.zeros((50, 21, 3))}, '10 of the 10 frames to fit the hand on'),
    ({'positions': np.ones((1000, 21, 3))}, 'index MCP 0 from the wrist; expected metres'),
    ({'positions': np.random.default_rng(1).uniform(0., 200., (1000, 21, 3))},
     'expected metres, 0.03 to 0.2'),
    ({'positions': np.full((1000, 21, 3), np.nan)},
     '0 of the 200 frames to fit the hand on have all eight markers; at least 100 are needed; '
     'never captured: wrist, thumb_cmc'),
])
def test_captures_of_odd_shapes_are_refused(tmp_path, moving, fields, message):
    save(tmp_path / 'odd.npz', moving, **fields)
    with pytest.raises(InvalidCapture, match=re.escape(message)):
        load_capture(tmp_path / 'odd.npz')


def test_files_that_are_no_captures_are_refused(tmp_path):
    (tmp_path / 'text.npz').write_text('no capture')
    np.savez(tmp_path / 'other.npz', positions=np.zeros((3, 21, 3)))
    np.savez(tmp_path / 'objects.npz', positions=np.array([None]))
    np.save(tmp_path / 'alone.npy', np.zeros(3))
    (tmp_path / 'cut.npz').write_bytes((tmp_path / 'other.npz').read_bytes()[:200])
    unread = 'can be read; expected plain arrays, as numpy.savez writes them$'
    for name, message in (('text.npz', unread), ('objects.npz', unread), ('cut.npz', unread),
                          ('other.npz', 'it lacks joints, side, rate_hz; expected positions'),
                          ('none.npz', r'can be read \(No such file or directory\); expected')):
        with pytest.raises(InvalidCapture, match=message):
            load_capture(tmp_path / name)
    with pytest.raises(HandTrackerError, match='alone.npy: its beginning is that of no known'):
        load_capture(tmp_path / 'alone.npy')


def test_joints_may_come_in_any_order_and_without_a_rate(tmp_path, moving):
    order = np.random.default_rng(1).permutation(21)
    save(tmp_path / 'c.npz', moving, positions=moving.joints[:, order],
         joints=np.array(LANDMARKS)[order], rate_hz=np.nan)
    capture = load_capture(tmp_path / 'c.npz')
    np.testing.assert_array_equal(capture.joints, moving.joints)
    assert capture.rate == 30.
    assert load_capture(tmp_path / 'c.npz', 60.).rate == 60.
    with pytest.raises(InvalidCapture, match='rate_hz 1; allowed is 5 to 2000 Hz'):
        load_capture(tmp_path / 'c.npz', 1.)


def test_a_rate_that_no_file_says_can_be_given(tmp_path, moving, capsys, monkeypatch):
    given = []

    def judged(options):
        given.append([one.rate for one in options.captures])
        raise HandTrackerError('no more is asked')

    monkeypatch.setattr(hidden_markers, 'evaluate', judged)
    save(tmp_path / 'c.npz', moving, rate_hz=np.nan)
    write_recording(tmp_path / 'points.trc', PointRecording(
        'points', 'test', LANDMARKS, moving.joints.astype(np.float32), 120., None,
        Axes('m', 'z')))
    files = [str(tmp_path / name) for name in ('c.npz', 'points.trc')]
    note = f'{files[0]}: the file does not say its rate: 30 Hz is assumed (--frame-rate)'
    for more, is_assumed in (([], True), (['--frame-rate', '60'], False)):
        assert main(['evaluate', 'occlusion', *files, *more, '--quiet']) == 1
        errors = capsys.readouterr().err
        assert 'no more is asked' in errors
        assert errors.count(note) == errors.count('its rate') == is_assumed
    assert given == [[30., 120.], [60., 60.]]


def test_the_command_writes_rows_table_picture_and_document(
        capture_file, tmp_path, capsys, fitted_once):
    wrong = tmp_path / 'wrong.npz'
    wrong.write_text('')
    arguments = ['evaluate', 'recordings', '--json', str(tmp_path / 'rows.json'),
                 str(capture_file), str(wrong), '--output', str(tmp_path / 'out'),
                 '--results', str(tmp_path / 'docs' / 'results.md')]
    assert main(arguments) == 0
    captured = capsys.readouterr()
    assert f'left out: {wrong}' in captured.err
    assert 'Captured hands' in captured.out
    rows = json.loads((tmp_path / 'rows.json').read_text())
    assert {row['joint_class'] for row in rows} == {
        'mcp', 'pip', 'dip', 'tip', 'thumb_cmc', 'thumb_mcp', 'thumb_ip', 'all'}
    assert len((tmp_path / 'out/recordings.csv').read_text().splitlines()) == len(rows) + 1
    assert (tmp_path / 'out/recordings.png').stat().st_size > 1000
    document = (tmp_path / 'docs/results.md').read_text()
    assert '$CAPTURES/demo.npz' in document and '--results docs/results.md' in document
    assert 'a paper' in document and 'CC0' in document
    assert '- wrong.npz: no npz file' in document
    assert str(tmp_path) not in document
    assert f'Python {versions()["Python"]}' in document
    assert (tmp_path / 'docs/results/recordings.png').read_bytes() == (
        tmp_path / 'out/recordings.png').read_bytes()


def test_the_command_says_what_it_needs(tmp_path, capsys):
    with pytest.raises(SystemExit):
        evaluate.main(['occlusion'])
    assert 'name at least one npz file' in capsys.readouterr().err
    for arguments, message in ((['--seed', '-1'], '-1; allowed is 0 to 2147483647'),
                               (['--json', str(tmp_path)], 'is a folder; expected a file')):
        with pytest.raises(SystemExit):
            evaluate.main(['noise', *arguments])
        assert message in capsys.readouterr().err
    assert evaluate.main(['recordings', str(tmp_path / 'none.npz')]) == 1
    assert 'no such file or folder' in capsys.readouterr().err


def test_a_capture_that_cannot_be_judged_is_named_and_the_others_are_judged(
        moving, capture_file, tmp_path, capsys, fitted_once, few_windows):
    # All markers at once are there only in single frames.
    joints = moving.joints.copy()
    joints[moving.split::2, 0] = np.nan
    joints[moving.split + 1::3, 0] = np.nan
    save(tmp_path / 'holes.npz', moving, positions=joints)
    rows = tmp_path / 'rows.json'
    assert main(['evaluate', 'occlusion', str(tmp_path / 'holes.npz'), str(capture_file),
                 '--json', str(rows)]) == 0
    assert 'left out: holes: no 0.1 s' in capsys.readouterr().err
    assert {row['recording'] for row in json.loads(rows.read_text())} == {'demo'}
    assert main(['evaluate', 'occlusion', str(tmp_path / 'holes.npz')]) == 1
    assert 'none of the captures can be judged' in capsys.readouterr().err


def test_an_evaluation_that_fails_leaves_the_others_rows(
        capture_file, tmp_path, capsys, monkeypatch, fitted_once):
    def fails(options):
        raise InvalidCapture('no luck')

    monkeypatch.setattr(evaluate, 'EVALUATIONS', {
        name: evaluate.EVALUATIONS[name] for name in ('recordings', 'occlusion')})
    monkeypatch.setattr(hidden_markers, 'evaluate', fails)
    rows = tmp_path / 'rows.json'
    assert main(['evaluate', 'all', str(capture_file), '--json', str(rows)]) == 1
    assert 'occlusion: no luck' in capsys.readouterr().err
    assert json.loads(rows.read_text())


def test_rows_are_plain_json():
    assert evaluate.plain(np.float64(1.5)) == 1.5
    assert evaluate.plain(float('nan')) is None
    assert evaluate.plain('x') == 'x'


def test_work_comes_back_in_order_from_any_number_of_jobs():
    for jobs in (1, 2):
        assert list(Options(jobs=jobs).each('squares', abs, [-3, 1, -2])) == [3, 1, 2]


def test_tables_align_numbers_to_the_right():
    text = Table('Numbers', ('what', 'mm'), [('a', '1.0'), ('bcdef', '–')]).text()
    assert text.splitlines()[2:] == ['| what  |  mm |', '|-------|----:|', '| a     | 1.0 |',
                                     '| bcdef |   – |']


def test_the_baseline_makes_the_published_numbers_on_real_hands():
    """Medians over the whole recording, as the data's own table has them: PIP and DIP."""
    capture = load_capture(capture_path('manipnet__cyl_med3_rightHand')).right()
    found = plain_hand.plain_joints(plain_hand.fit_plain(capture.joints), capture.markers)
    errors = 1e3 * np.linalg.norm(found - capture.joints, axis=2)
    assert errors[:, plain_hand.PLAIN_FINGERS[:, 1]].mean() == pytest.approx(1.45, abs=.3)
    assert errors[:, plain_hand.PLAIN_FINGERS[:, 3]].mean() == pytest.approx(12.1, abs=1.)
