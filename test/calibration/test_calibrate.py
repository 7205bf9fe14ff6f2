"""The command `hand_tracker calibrate`, from a take to a hand file that is tracked."""

import numpy as np
import pytest
from helpers.capture_files import capture_path
from helpers.skin_markers import EVERY_JOINT, WORN_PLACES, simulated_take
from PIL import Image

from hand_tracker.calibration import LANDMARKS, landmark_positions
from hand_tracker.calibration.coverage import coverage, missing_movements
from hand_tracker.calibration.frame_choice import spread_frames
from hand_tracker.calibration.label_repair import worn_order
from hand_tracker.calibration.ruler import Ruler
from hand_tracker.calibration.ruler_check import ruler_doubts
from hand_tracker.calibration.takes import gather
from hand_tracker.cli import calibrate_recordings
from hand_tracker.cli.calibrate import main
from hand_tracker.core.model.hand import Hand, preset_limits
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.model.layout_presets import preset_layout
from hand_tracker.core.model.marker_layout import MARKERS
from hand_tracker.files.bags import bag_message, marker_array_message, write_bag
from hand_tracker.files.hand_file import load_hand
from hand_tracker.package_data import packaged_recording
from hand_tracker.simulation.motions import motion_named

HAND = Hand.scaled(.19, .09)


def written(path, take, **fields):
    np.savez(path, markers=take.points, marker_names=np.array(take.names), side=take.side,
             rate_hz=take.rate, **fields)
    return path


def with_thumb_and_index_exchanged(take):
    exchanged = {'thumb_tip': 'index_dip', 'index_dip': 'thumb_tip'}
    return take._replace(names=tuple(exchanged.get(name, name) for name in take.names))


def test_hand_file_and_picture_are_written(tmp_path, capsys):
    take, _ = simulated_take(HAND, EVERY_JOINT, seconds=12.)
    output = tmp_path / 'my_hand.yaml'
    assert main([str(written(tmp_path / 'take.npz', take)), '-o', str(output)]) == 0
    hand, layout = load_hand(output)
    np.testing.assert_allclose(hand.finger_bones, HAND.finger_bones, atol=.003)
    np.testing.assert_allclose(layout.offsets[3:7, 2], .008, atol=.002)
    assert '\nlimits: wearer\n' in output.read_text(encoding='utf-8')
    assert hand.range_of_motion.any()
    assert Image.open(output.with_suffix('.png')).size[0] > 600
    text = output.read_text(encoding='utf-8')
    printed = capsys.readouterr().out
    assert '# Fitted to take:' in text and 'not observed' in text
    assert 'little_tip' in printed and 'motion in the take' in printed
    assert printed.startswith('the hand fits ') and 'not observed' not in printed


def test_a_hand_file_that_is_replaced_is_kept_beside_the_new_one(tmp_path, capsys):
    output = tmp_path / 'my_hand.yaml'
    command = [str(written(tmp_path / 'take.npz', simulated_take(
        HAND, WORN_PLACES, seconds=8.)[0])), '-o', str(output)]
    old, old_picture = (tmp_path / f'my_hand.{one}.old' for one in ('yaml', 'png'))
    assert main(command) == 0 and main(command) == 0
    assert 'before' not in capsys.readouterr().out and not old.exists()
    first, picture = output.read_text('utf-8'), output.with_suffix('.png').read_bytes()
    assert main([*command, '--hand-length', '180']) == 0
    closing = capsys.readouterr().out.splitlines()[-1]
    assert closing.endswith(f'; what was there before is now {old} and {old_picture}')
    assert (old.read_text('utf-8'), old_picture.read_bytes()) == (first, picture)
    assert output.read_text('utf-8') != first and load_hand(output)
    second = output.read_text('utf-8')
    assert main(command) == 0
    assert old.read_text('utf-8') == second and output.read_text('utf-8') == first


def test_the_verdict_names_the_movements_that_the_take_lacks(tmp_path, capsys):
    take, _ = simulated_take(HAND, WORN_PLACES, seconds=8., motions=('power_grasp',))
    assert main([str(written(tmp_path / 'take.npz', take)), '-o', str(tmp_path / 'a.yaml')]) == 0
    verdict = capsys.readouterr().out.splitlines()[0]
    assert '; movements to add: bring the thumb to the tip of each finger in turn' in verdict


def test_a_recording_of_the_worn_markers(tmp_path):
    take, _ = simulated_take(HAND, WORN_PLACES, seconds=12.)
    start = 10 ** 18
    write_bag(tmp_path / 'take.mcap', (
        bag_message('/markers', stamp, marker_array_message(stamp, 'mocap', MARKERS, frame))
        for stamp, frame in ((start + round(1e9 * i / take.rate), frame)
                             for i, frame in enumerate(take.points))))
    output = tmp_path / 'hand.yaml'
    assert main([str(tmp_path / 'take.mcap'), '-o', str(output)]) == 0
    hand, layout = load_hand(output)
    assert layout.places[3] == 'index_dip'
    # Eight markers do not tell the bones apart, but how far the fingers reach.
    reach = hand.finger_bones[:, :2].sum(axis=1) + layout.offsets[3:7, 0]
    np.testing.assert_allclose(reach, HAND.finger_bones[:, :2].sum(axis=1), atol=.006)


def test_a_recording_in_which_no_marker_is_seen(tmp_path, capsys):
    nowhere = np.zeros((8, 3))
    write_bag(tmp_path / 'take.mcap', (
        bag_message('/markers', stamp, marker_array_message(stamp, 'mocap', MARKERS, nowhere))
        for stamp in range(10 ** 18, 10 ** 18 + 10 ** 9, 10 ** 7)))
    assert main([str(tmp_path / 'take.mcap'), '-o', str(tmp_path / 'hand.yaml')]) == 1
    assert 'none of the markers is ever seen in 100 messages' in capsys.readouterr().err


def test_a_label_that_the_recording_has_not_is_told_with_the_nearest(tmp_path, capsys):
    path = str(packaged_recording('right'))
    assert main([path, '--label', 'index=hand/33', '-o', str(tmp_path / 'hand.yaml')]) == 1
    assert "index is never seen, with the label 'hand/33'; expected one of hand/3, hand/" in (
        capsys.readouterr().err)


def test_a_recording_of_two_hands_is_refused_unless_labels_tell_them_apart(tmp_path, capsys):
    path = str(packaged_recording('both'))
    assert main([path, '-o', str(tmp_path / 'hand.yaml')]) == 1
    assert "answer to the label '0' of wrist, as those of two hands do" in capsys.readouterr().err
    labels = [f'--label={marker}=left/{number}' for number, marker in enumerate(MARKERS)]
    assert main([path, *labels, '--side', 'left', '-o', str(tmp_path / 'hand.yaml')]) == 0


def test_markers_at_the_joints_are_doubted_as_fingers_would_bend_too_far(tmp_path, capsys):
    assert main([str(packaged_recording()), '-o', str(tmp_path / 'hand.yaml')]) == 0
    said = capsys.readouterr().out
    assert 'bent farther than a PIP bends, degrees: index 1' in said
    assert 'its angles have standard deviations of ' in said


def test_lengths_by_a_ruler_are_in_millimetres(tmp_path, capsys):
    take, _ = simulated_take(HAND, WORN_PLACES, seconds=20.)
    take.save(tmp_path / 'take.npz')
    how = [str(tmp_path / 'take.npz'), '-o', str(tmp_path / 'hand.yaml')]
    assert main([*how, '--hand-length', '192', '--hand-breadth', '91', '--finger-lengths',
                 '100,110,105,85', '--marker-height', '5']) == 0
    bones = load_hand(tmp_path / 'hand.yaml')[0].finger_bones
    np.testing.assert_allclose(bones.sum(axis=1), (.1, .11, .105, .085), atol=.004)
    assert 'by the ruler' not in capsys.readouterr().err
    for option, value, expected in (
            ('--hand-length', '.19', "'.19'; allowed is 100 to 260 mm"),
            ('--finger-lengths', '100,110', "'100,110'; expected four lengths, index, middle"),
            ('--marker-height', 'high', "'high'; allowed is 0 to 30 mm")):
        with pytest.raises(SystemExit):
            main([*how, option, value])
        assert f'{option}: {expected}' in capsys.readouterr().err


def test_lengths_by_a_ruler_that_markers_contradict_are_doubted():
    take, _ = simulated_take(HAND, EVERY_JOINT, seconds=10.)
    fingers = HAND.finger_bones.sum(axis=1)
    right = Ruler(.19, .09, tuple(fingers))
    assert ruler_doubts(gather([take], right), 'right') == []
    long, broad, longer = ruler_doubts(gather([take], Ruler(
        .21, .11, (fingers[0] + .02, *fingers[1:]))), 'right')
    assert "the hand's length is 210 mm by the ruler, but 19" in long
    assert "the hand's breadth is 110 mm" in broad and 'the index finger' in longer


def test_what_is_no_take_is_told_what_would_be_one(tmp_path, capsys):
    (tmp_path / 'notes.txt').touch()
    for name, fault in (('absent.mcap', 'no such file or folder'),
                        ('notes.txt', 'the file has no bytes; expected')):
        assert main([str(tmp_path / name), '-o', str(tmp_path / 'hand.yaml')]) == 1
        said = capsys.readouterr().err
        assert f'{name}: {fault}' in said
    assert 'rosbag2' in said and 'npz' in said


def test_an_output_that_cannot_be_written_is_refused_before_the_fit(tmp_path, capsys):
    take, _ = simulated_take(HAND, EVERY_JOINT, seconds=8.)
    path = str(written(tmp_path / 'take.npz', take))
    for arguments in (('-o', 'absent/hand.yaml'),
                      ('-o', str(tmp_path / 'hand.yaml'), '--picture', 'absent/hand.png')):
        assert main([path, *arguments]) == 1
        said = capsys.readouterr()
        assert f'{arguments[-1]}: cannot be written' in said.err and not said.out
    assert not (tmp_path / 'hand.yaml').exists()


@pytest.mark.parametrize('name', ['take.npz', 'hand.txt'])
def test_an_output_that_is_no_hand_file_is_refused_and_kept(name, tmp_path, capsys):
    take = written(tmp_path / 'take.npz', simulated_take(HAND, WORN_PLACES, seconds=6.)[0])
    before = take.read_bytes()
    assert main([str(take), '-o', str(tmp_path / name)]) == 1
    assert 'expected .yaml, .yml' in capsys.readouterr().err
    assert take.read_bytes() == before and [*tmp_path.iterdir()] == [take]


def test_markers_on_the_tips_are_said_by_their_names_in_files(tmp_path, capsys):
    take = simulated_take(HAND, WORN_PLACES, seconds=12.)[0]
    path = written(tmp_path / 'take.npz', take._replace(names=MARKERS))
    output = tmp_path / 'hand.yaml'
    assert main([str(path), '-o', str(output), '--fingers', 'tip']) == 1
    assert '--fingers: tip; expected for MarkerArrays only' in capsys.readouterr().err
    fingers = MARKERS[3:7]
    assert main([str(path), '-o', str(output), '--markers',
                 ','.join(f'{finger}_tip={finger}' for finger in fingers)]) == 0
    assert load_hand(output)[1].places[3:7] == tuple(f'{finger}_tip' for finger in fingers)


def test_names_of_a_preset_are_told_with_its_name(tmp_path, capsys):
    take = simulated_take(HAND, EVERY_JOINT, seconds=6.)[0]
    for names, layout in ((range(1, 24), 'kyutech23'), (range(23), '')):
        points = np.repeat(take.points[:, :1], 23, axis=1)
        take = take._replace(names=[*map(str, names)], points=points)
        path = written(tmp_path / 'take.npz', take)
        assert main([str(path), '-o', str(tmp_path / 'hand.yaml')]) == 1
        said = capsys.readouterr().err
        assert '--markers' in said and ('its names are those of' in said) is bool(layout)
        assert layout in said


@pytest.mark.parametrize('layout', [[], ['--layout', 'sig18_19']])
def test_the_layout_of_a_take_of_more_than_eight_markers_is_told(tmp_path, capsys, layout):
    take = simulated_take(HAND, EVERY_JOINT, seconds=6.)[0]
    names = preset_layout('sig18_19').names
    take = take._replace(names=names, points=np.repeat(take.points[:, :1], len(names), axis=1))
    path = written(tmp_path / 'take.npz', take)
    assert main([str(path), '-o', str(tmp_path / 'hand.yaml'), *layout]) == 1
    assert ('these 19 markers are those of --layout sig18_19_skin' in capsys.readouterr().err
            ) is not bool(layout)


def test_joints_that_a_camera_estimates_are_no_markers_on_the_skin(tmp_path, capsys):
    capture = np.load(capture_path('dexret__human_joint_right'))
    np.savez(tmp_path / 'joints.npz', **{name: capture[name] for name in (
        'positions', 'joints', 'side')}, rate_hz=30.)
    output = tmp_path / 'hand.yaml'
    assert main([str(tmp_path / 'joints.npz'), '-o', str(output)]) == 0
    said = capsys.readouterr()
    assert 'joints of a skeleton' in said.out and 'note' not in said.err
    assert not load_hand(output)[1].offsets.any()


def test_a_ruler_that_contradicts_the_markers_is_named_where_no_hand_fits(tmp_path, capsys):
    take, _ = simulated_take(Hand.scaled(.205, .094), WORN_PLACES, seconds=10.)
    path, output = written(tmp_path / 'take.npz', take), tmp_path / 'hand.yaml'
    assert main([str(path), '-o', str(output), '--hand-length', '150',
                 '--hand-breadth', '70']) == 1
    said = capsys.readouterr().err
    assert '150 mm by the ruler' in said and not output.exists()
    assert said.endswith('did a marker slip? Or is a length by the ruler wrong?\n')


def test_a_left_recording_is_not_fitted_as_a_right_hand(tmp_path, capsys):
    take, _ = simulated_take(HAND.mirrored(), WORN_PLACES, seconds=8.)
    write_bag(tmp_path / 'take.mcap', (
        bag_message('/markers', stamp, marker_array_message(stamp, 'mocap', MARKERS, frame))
        for stamp, frame in ((10 ** 18 + round(1e9 * i / take.rate), frame)
                             for i, frame in enumerate(take.points))))
    assert main([str(tmp_path / 'take.mcap'), '-o', str(tmp_path / 'hand.yaml')]) == 1
    assert 'this is a left one (--side left)' in capsys.readouterr().err


def test_frames_with_a_stray_in_the_palm_are_left_out_and_told_of(tmp_path, capsys):
    take, _ = simulated_take(HAND, WORN_PLACES, seconds=20.)
    points = take.points.copy()
    points[np.arange(len(points)) % 60 < 6, WORN_PLACES.index('little_mcp')] += (.1, .1, 0.)
    take._replace(points=points).save(tmp_path / 'take.npz')
    assert main([str(tmp_path / 'take.npz'), '-o', str(tmp_path / 'hand.yaml')]) == 0
    assert 'not at their distances in 10% of the frames, where those elsewhere are left out' in (
        capsys.readouterr().err)


def test_takes_of_two_people_are_doubted(tmp_path, capsys):
    for name, hand in (('one', HAND), ('other', Hand.scaled(.165, .074)), ('again', HAND)):
        simulated_take(hand, WORN_PLACES, seconds=10.)[0].save(tmp_path / f'{name}.npz')
    for other, is_doubted in (('other', True), ('again', False)):
        assert main([str(tmp_path / 'one.npz'), str(tmp_path / f'{other}.npz'), '-o',
                     str(tmp_path / 'hand.yaml')]) == 0
        assert ('another person, or markers put on anew?' in capsys.readouterr().err) == is_doubted


def test_exchanged_labels_of_a_take_are_put_right(tmp_path, capsys):
    take, _ = simulated_take(HAND, WORN_PLACES, seconds=20.)
    points = take.points.copy()
    for number, start in enumerate(range(150, len(points) - 100, 200)):
        row, these = 3 + number % 3, slice(start, start + 60)
        points[these, [row, row + 1]] = points[these, [row + 1, row]]
    hands = []
    for name, these in (('right', take.points), ('exchanged', points)):
        take._replace(points=these).save(tmp_path / f'{name}.npz')
        assert main([str(tmp_path / f'{name}.npz'), '-o', str(tmp_path / f'{name}.yaml')]) == 0
        assert ('and were put right' in capsys.readouterr().err) == (name == 'exchanged')
        hands.append(load_hand(tmp_path / f'{name}.yaml')[0])
    right, exchanged = hands
    np.testing.assert_allclose(exchanged.finger_bones, right.finger_bones, atol=.0025)
    assert worn_order(take._replace(names=take.names[1:], points=take.points[:, 1:])) is None
    # Two markers on the index finger, none on the middle one.
    assert worn_order(take._replace(names=tuple(
        name.replace('middle_dip', 'index_tip') for name in take.names))) is None


def test_a_folder_stands_for_the_takes_in_it(tmp_path, capsys):
    folder, output = tmp_path / 'takes', tmp_path / 'hand.yaml'
    folder.mkdir()
    assert main([str(folder), '-o', str(output)]) == 1
    assert 'takes: no recording in this folder' in capsys.readouterr().err
    take, _ = simulated_take(HAND, WORN_PLACES, seconds=20.)
    half = len(take.points) // 2
    for name, part in (('first', slice(half)), ('second', slice(half, None))):
        take._replace(points=take.points[part], sequence=take.sequence[part]).save(
            folder / f'{name}.npz')
    (folder / 'notes.txt').touch()
    assert main([str(folder), '-o', str(output)]) == 0
    assert '# Fitted to first, second:' in output.read_text()


def test_a_few_frames_with_a_stray_do_not_refuse_a_take(tmp_path, capsys):
    take, _ = simulated_take(HAND, WORN_PLACES, seconds=20.)
    points = take.points.copy()
    stray = np.random.default_rng(1).random(len(points)) < .03
    points[stray, WORN_PLACES.index('thumb_tip')] += (.3, .2, .2)
    take._replace(points=points).save(tmp_path / 'take.npz')
    assert main([str(tmp_path / 'take.npz'), '-o', str(tmp_path / 'hand.yaml')]) == 0
    said = capsys.readouterr().out
    assert 'the hand fits well' in said and 'thumb_tip is more than 20 mm off in ' in said


@pytest.mark.parametrize('names', [WORN_PLACES, EVERY_JOINT])
def test_a_marker_that_is_never_within_reach_is_named(names, tmp_path, capsys):
    take, _ = simulated_take(HAND, names, seconds=10.)
    points = take.points.copy()
    points[:, names.index('thumb_tip')] += (.9, 0., 0.)
    take._replace(points=points).save(tmp_path / 'take.npz')
    assert main([str(tmp_path / 'take.npz'), '-o', str(tmp_path / 'hand.yaml')]) == 1
    assert 'thumb_tip is farther from the palm than the thumb reaches in 100% of the frames: are ' \
        'labels exchanged' in capsys.readouterr().err


@pytest.mark.parametrize(('change', 'reason'), (
    (lambda take: take.part(np.arange(60)), '2.0 s long'),
    (lambda take: take._replace(points=1e3 * take.points), 'millimetres'),
    (lambda take: take._replace(side='left'), 'this is a right one'),
    (lambda take: with_thumb_and_index_exchanged(take), 'mm at most: are labels exchanged')))
def test_a_bad_take_is_refused_with_the_reason(tmp_path, capsys, change, reason):
    take, _ = simulated_take(HAND, EVERY_JOINT, seconds=8.)
    output = tmp_path / 'hand.yaml'
    assert main([str(written(tmp_path / 'take.npz', change(take))), '-o', str(output)]) == 1
    assert reason in capsys.readouterr().err
    assert not output.exists()


def test_the_unit_of_a_take_may_be_given(tmp_path, monkeypatch):
    fitted = []
    monkeypatch.setattr(calibrate_recordings, 'calibrate_takes',
                        lambda takes, *_: fitted.extend(takes) or 'fitted')
    take, _ = simulated_take(HAND, EVERY_JOINT, seconds=8.)
    path = str(written(tmp_path / 'take.npz', take._replace(points=1000. * take.points)))
    for given in (('--units', 'mm'), ('--unit-scale', '0.001')):
        assert main([path, '-o', str(tmp_path / 'hand.yaml'), *given]) == 0
    for found in fitted:
        np.testing.assert_allclose(found.points, take.points, rtol=1e-6)
    assert len(fitted) == 2


def test_joint_centres_are_no_markers_on_the_skin(tmp_path, capsys):
    moving = motion_named('spelling', HAND, 2, 8.)
    angles, rotation, position = moving.sample(np.arange(0., 8., 1. / 30.))
    pose = forward(joint_table(HAND), angles, rotation, position)
    path = tmp_path / 'joints.npz'
    np.savez(path, positions=landmark_positions(HAND, pose, position), side='right', rate_hz=30.,
             joints=np.array(LANDMARKS))
    output = tmp_path / 'hand.yaml'
    assert main([str(path), '-o', str(output), '--limits', 'paper']) == 0
    assert 'no markers on the skin' in capsys.readouterr().out
    hand, layout = load_hand(output)
    np.testing.assert_allclose(hand.finger_bones, HAND.finger_bones, atol=1e-4)
    assert not layout.offsets.any()
    assert np.array_equal(hand.limits, preset_limits('paper')) and hand.range_of_motion.any()


def test_coverage_says_what_to_do():
    _, angles = simulated_take(HAND, WORN_PLACES, seconds=8.)
    covered = coverage(angles)
    assert len(covered) == 15 and all(0. <= one.share <= 1. for one in covered)
    still = coverage(np.zeros((10, 25)))
    assert {one.share for one in still} == {0.}
    assert 'bend the ring finger in its middle joint' in still[8].task
    assert coverage(np.zeros((0, 25))) == []
    assert missing_movements(one for one in still if one.joint == 'first') == [
        'bend the index, middle, ring, little finger in its knuckle and straighten it, '
        'alone', 'bring the thumb to the tip of each finger in turn']
    assert missing_movements(one._replace(degrees=90.) for one in still) == []


def test_the_range_of_motion_covers_all_that_is_asked_for():
    moving = motion_named('range_of_motion', HAND, 2)
    covered = coverage(moving.sample(np.arange(0., moving.duration, .1))[0])
    assert {(one.digit, one.joint) for one in covered if one.share < 1.} <= {
        ('thumb', 'first'), ('thumb', 'second')}
    # The others spread from the middle finger, which is not asked to turn as far.
    turns = {one.digit: one.degrees for one in covered if one.joint == 'turn'}
    assert turns['middle'] < 5. < 10. < min(turns['index'], turns['ring'], turns['little'])


def test_chosen_frames_cover_the_motion():
    random = np.random.default_rng(4)
    crowd = .001 * random.standard_normal((500, 1, 3))
    far = np.array((((.1, 0., 0.),), ((0., .1, 0.),), ((0., 0., .1),)))
    points = np.concatenate((crowd, far))
    points[7] = np.nan
    chosen = spread_frames(points, 10, .02)
    assert {500, 501, 502} <= set(chosen.tolist()) and len(chosen) == 4
    assert not len(spread_frames(np.full((4, 2, 3), np.nan), 10, .01))
