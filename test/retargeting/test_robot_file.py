"""Robot files: presets, dex-retargeting's files, what inspecting writes, and clear refusals."""

import re

import numpy as np
import pytest
import yaml
from helpers.robots import GRIPPER, PARALLEL_GRIPPER, third_party_urdf, wide_hand

from hand_tracker.core.model.hand import JOINTS, Hand
from hand_tracker.files.urdf_file import urdf
from hand_tracker.package_data import share_directory
from hand_tracker.retargeting.retarget_options import RetargetOptions
from hand_tracker.retargeting.retarget_problem import make_problem
from hand_tracker.retargeting.robot_file import load_robot, preset_names
from hand_tracker.retargeting.robot_inspection import findings, robot_file_text
from hand_tracker.retargeting.robot_urdf import InvalidRobot

PRESETS = ('ability', 'allegro', 'fourier', 'inspire', 'leap', 'plain', 'robotiq_2f',
           'schunk_svh', 'shadow')


@pytest.fixture
def hand_urdf(tmp_path):
    path = tmp_path / 'hand.urdf'
    path.write_text(urdf(wide_hand()))
    return path


def robot_file(tmp_path, settings):
    path = tmp_path / 'robot.yaml'
    path.write_text(yaml.safe_dump({'urdf': 'hand.urdf', **settings}))
    return str(path)


def test_the_presets_are_there():
    assert tuple(preset_names()) == PRESETS


@pytest.mark.parametrize('side', ['right', 'left'])
@pytest.mark.parametrize('preset, urdf_name', [
    *((preset, preset + '_hand_{}') for preset in (
        'ability', 'allegro', 'inspire', 'leap', 'schunk_svh', 'shadow')),
    ('fourier', 'fourier_{}_hand_6dof'), ('fourier', 'fourier_{}_hand_12dof')])
def test_a_preset_takes_the_urdf_of_either_side(preset, urdf_name, side):
    loaded = load_robot(preset, str(third_party_urdf(urdf_name.format(side))))
    assert loaded.hand.side == side and loaded.notes == () and loaded.guesses == {}
    settings = yaml.safe_load(
        (share_directory() / 'config' / 'robots' / f'{preset}.yaml').read_text())
    assert list(loaded.hand.anatomy.digits) == list(settings['digits'])
    for role, digit in settings['digits'].items():
        assert 1e3 * loaded.hand.spheres[role].radius == pytest.approx(digit['radius_mm'])
    assert set(loaded.order) == set(loaded.hand.model.variables)


LISTED = {
    'ability': 'thumb_q1 thumb_q2 index_q1 middle_q1 ring_q1 pinky_q1',
    'allegro': ' '.join(f'joint_{number}.0' for number in range(16)),
    'inspire': 'thumb_proximal_yaw_joint thumb_proximal_pitch_joint index_proximal_joint '
               'middle_proximal_joint ring_proximal_joint pinky_proximal_joint',
    'leap': ' '.join(map(str, range(16))),
    'shadow': 'WRJ2 WRJ1 FFJ4 FFJ3 FFJ2 FFJ1 MFJ4 MFJ3 MFJ2 MFJ1 RFJ4 RFJ3 RFJ2 RFJ1 LFJ5 LFJ4 '
              'LFJ3 LFJ2 LFJ1 THJ5 THJ4 THJ3 THJ2 THJ1'}


@pytest.mark.parametrize('side', ['right', 'left'])
@pytest.mark.parametrize('preset', LISTED)
def test_commands_have_the_order_in_which_the_urdf_lists_the_joints(preset, side, tmp_path):
    path = str(third_party_urdf(f'{preset}_hand_{side}'))
    found, *others = load_robot(path), load_robot(preset, path)
    (tmp_path / 'written.yaml').write_text(robot_file_text(found, path))
    for loaded in found, *others:
        assert loaded.order == tuple(LISTED[preset].split())
    # The wrist of the Shadow Hand is left to an arm's controller.
    assert load_robot(str(tmp_path / 'written.yaml')).order == tuple(
        name for name in found.order if name not in found.hand.arm_joints)
    assert f'the preset {preset} may know more of it' in found.notes[0]


def test_the_order_of_the_urdf_may_name_a_joint_before_the_one_that_carries_it(hand_urdf):
    text = hand_urdf.read_text()
    joints = re.findall(r'<joint .*?</joint>', text, re.DOTALL)
    body = re.sub(r'<joint .*?</joint>', '', text, flags=re.DOTALL)
    hand_urdf.write_text(body.replace('</robot>', ''.join(reversed(joints)) + '</robot>'))
    backwards, model = load_robot(str(hand_urdf)), load_robot('plain', text).hand.model
    listed = re.findall(r'joint name="(\w+)" type="revolute"', text)
    assert backwards.order == tuple(reversed(listed)) != model.variables == tuple(listed)
    order = [model.variables.index(name) for name in backwards.order]
    rest = model.lower + .3 * (model.upper - model.lower)
    np.testing.assert_allclose(
        backwards.hand.model.frames(rest[order])[1][-1], model.frames(rest)[1][
            model.joint_names.index(backwards.hand.model.joint_names[-1])], atol=1e-12)


def test_the_plain_hand_comes_with_its_urdfs_of_which_one_mirrors_the_other():
    right, left = (load_robot('plain', preferred_side=side) for side in ('right', 'left'))
    assert right.urdf.endswith('plain_hand_right.urdf') and right.notes == left.notes == ()
    assert (right.hand.side, left.hand.side) == ('right', 'left')
    assert len(right.hand.model.shapes) == len(left.hand.model.shapes) > 20
    share = np.random.default_rng(0).random(len(right.order))
    lower, upper = right.hand.model.lower, right.hand.model.upper
    position = lower + share * (upper - lower)
    # Fingers of both spread about z; the axes of the other joints are mirrored.
    signs = np.array([-1. if name.endswith('spread') else 1. for name in right.order])
    np.testing.assert_allclose(
        right.hand.tip_positions(position),
        left.hand.tip_positions(signs * position) * (1., -1., 1.), atol=1e-4)


def test_a_gripper_preset_takes_a_gripper_and_xml():
    loaded = load_robot('robotiq_2f', GRIPPER)
    assert loaded.hand.anatomy.is_gripper and loaded.options.escape == .1


def test_the_plain_hand_with_two_digits_is_no_gripper(tmp_path):
    (tmp_path / 'two.yaml').write_text(
        'digits: {thumb: {tip: thumb_tip}, index: {tip: index_tip}}\n')
    plain = load_robot('plain')
    loaded = load_robot(str(tmp_path / 'two.yaml'), plain.urdf)
    assert not loaded.hand.anatomy.is_gripper
    for role, sphere in loaded.hand.spheres.items():
        np.testing.assert_allclose(sphere.radius, plain.hand.spheres[role].radius, atol=2e-3)
    make_problem(loaded.hand, Hand.scaled(), loaded.options)
    with pytest.raises(InvalidRobot, match="side: the robot's hand is a right one"):
        make_problem(loaded.hand, Hand.scaled(side='left'), loaded.options)


@pytest.mark.parametrize('pattern, factor, message', [
    (r'(lower|upper)="([^"]+)"', 57.3, 'limits .* expected radians, not degrees'),
    (r'(xyz)="([^"]+)"', 1e3, 'm long, to its tip .* expected a URDF in metres')])
def test_a_urdf_in_degrees_or_millimetres_is_refused(pattern, factor, message, tmp_path):
    def scaled(found):
        numbers = ' '.join(str(factor * float(word)) for word in found[2].split())
        return f'{found[1]}="{numbers}"'

    path = tmp_path / 'hand.urdf'
    path.write_text(re.sub(pattern, scaled, urdf(wide_hand())))
    with pytest.raises(InvalidRobot, match=message):
        load_robot(str(path))


def test_joints_without_a_limit_of_speed_are_told():
    text = PARALLEL_GRIPPER.replace('upper="0.8"/></joint>', 'upper="0.8" velocity="0"/></joint>')
    notes = [note for note in load_robot('robotiq_2f', text).notes if 'speed' in note]
    assert notes == [
        'no limit of speed in the URDF: drive; retarget moves them at up to safety.max_speed']
    text = text.replace('velocity="0"', 'velocity="2"')
    assert not any('speed' in note for note in load_robot('robotiq_2f', text).notes)


def test_an_order_that_is_given_counts_in_place_of_the_file_s(tmp_path):
    text = GRIPPER.replace('upper="0.04" velocity="0.2"/><mimic',
                           'upper="0.015" velocity="0.02"/><mimic')
    for more in '', 'order: [slide]\n':
        (tmp_path / 'gripper.yaml').write_text(f'rest: {{slide: 0.03}}\n{more}')
        for given in (), ('slide', 'other'):
            loaded = load_robot(str(tmp_path / 'gripper.yaml'), text, order=given)
            assert loaded.order == (given or ('slide',))
            assert loaded.hand.rest == loaded.hand.model.upper.clip(0., .03)
            assert loaded.hand.model.upper == (.015 if given else .04)
    (tmp_path / 'gripper.yaml').write_text('order: [slide, other]\n')
    assert load_robot(str(tmp_path / 'gripper.yaml'), text).hand.model.velocity == .02
    text = text.replace('<mimic joint="slide"/>', '<mimic joint="slide" multiplier="-1"/>')
    with pytest.raises(InvalidRobot, match=r"gripper.yaml: order: 'other' follows 'slide' from"):
        load_robot(str(tmp_path / 'gripper.yaml'), text)


def test_what_inspecting_writes_is_the_same_robot(hand_urdf, tmp_path):
    found = load_robot(str(hand_urdf))
    text = robot_file_text(found, str(hand_urdf))
    (tmp_path / 'written.yaml').write_text(text)
    again = load_robot(str(tmp_path / 'written.yaml'))
    assert again.order == found.order and again.hand.side == 'right'
    assert again.notes == found.notes != ()
    for role, (centre, radius) in found.hand.spheres.items():
        np.testing.assert_allclose(again.hand.spheres[role].centre, centre, atol=1e-5)
        assert again.hand.spheres[role].radius == pytest.approx(radius, abs=1e-5)
    assert all(line in text for line in findings(found))
    assert any("index: tip 'index_tip'" in line for line in findings(found))


def test_what_inspecting_writes_has_what_the_file_has_set(hand_urdf, tmp_path):
    follow = {'index_pip_flexion': {'angle': 'index_pip_flexion', 'scale': .8, 'offset_deg': -10},
              'middle_pip_flexion': 'ring_pip_flexion'}
    options = {'escape': .1, 'iterations': 7}
    found = load_robot(robot_file(tmp_path, {'follow': follow, 'options': options}))
    (tmp_path / 'written.yaml').write_text(robot_file_text(found, str(hand_urdf)))
    again = load_robot(str(tmp_path / 'written.yaml'))
    assert again.options == found.options == RetargetOptions(**options)
    assert len(found.hand.follow) == 2
    for one, other in zip(again.hand.follow, found.hand.follow):
        assert one == pytest.approx(other)


def test_radii_that_are_guessed_are_told(hand_urdf, tmp_path):
    guess = 'radius at the tip of {}: 8.6 mm, guessed, 9 % of a digit: measure it, set radius_mm'
    (told,) = load_robot(str(hand_urdf)).notes
    assert told == guess.format('thumb, index, middle, ring, little')
    # Neither one that is given is a guess, nor one of the link's own sphere.
    given = {role: {'radius_mm': 8} for role in ('thumb', 'middle', 'ring', 'little')}
    (told,) = load_robot(robot_file(tmp_path, {'digits': given})).notes
    assert told == guess.format('index')
    hand_urdf.write_text(hand_urdf.read_text().replace(
        '<link name="index_tip"', '<link name="index_tip"><visual><geometry><sphere radius=".007"/>'
        '</geometry></visual></link><link name="unused"').replace('</robot>', (
            '<joint name="f" type="fixed"><parent link="wrist"/><child link="unused"/></joint>'
            '</robot>')))
    loaded = load_robot(robot_file(tmp_path, {'digits': given}))
    assert loaded.notes == () and loaded.hand.spheres['index'].radius == .007


@pytest.mark.parametrize('settings', [{}, {'index': {'tip_offset_mm': [1, 2, 3]}}])
def test_a_guessed_radius_is_told_of_a_written_file_until_it_is_measured(
        settings, hand_urdf, tmp_path):
    found = load_robot(robot_file(tmp_path, {'digits': settings}))
    written = tmp_path / 'written.yaml'
    written.write_text(robot_file_text(found, str(hand_urdf)))
    again = load_robot(str(written))
    assert again.notes == found.notes and 'guessed' in again.notes[0]
    assert robot_file_text(again, str(hand_urdf)) == written.read_text()
    written.write_text(re.sub(r"(tip: '\w+')", r'\1, radius_mm: 7', written.read_text()))
    measured = load_robot(str(written))
    assert measured.notes == () and measured.guesses == {}
    for role, (centre, radius) in measured.hand.spheres.items():
        guess = found.hand.spheres[role]
        assert radius == .007
        # The sphere still ends at the tip, where its centre is not given.
        assert np.linalg.norm(centre - guess.centre) == pytest.approx(
            0. if role in settings else guess.radius - .007, abs=1e-9)


@pytest.mark.parametrize('gripper', [GRIPPER, PARALLEL_GRIPPER])
def test_what_inspecting_writes_of_a_gripper_is_the_same_gripper(gripper, tmp_path):
    urdf_path = tmp_path / 'gripper.urdf'
    urdf_path.write_text(gripper)
    found = load_robot(str(urdf_path))
    (tmp_path / 'written.yaml').write_text(robot_file_text(found, str(urdf_path)))
    again = load_robot(str(tmp_path / 'written.yaml'))
    assert again.notes == found.notes and again.guesses == found.guesses
    for role, (centre, radius) in found.hand.spheres.items():
        np.testing.assert_allclose(again.hand.spheres[role].centre, centre, atol=1e-9)
        assert again.hand.spheres[role].radius == pytest.approx(radius, abs=1e-9)


def test_a_urdf_is_known_by_its_extension_in_capitals_too(hand_urdf):
    capital = hand_urdf.rename(hand_urdf.with_suffix('.URDF'))
    assert load_robot(str(capital)).urdf == str(capital)


def test_joints_follow_human_joints(hand_urdf, tmp_path):
    path = robot_file(tmp_path, {'follow': {'index_pip_flexion': {
        'angle': 'little_pip_flexion', 'scale': .5, 'offset_deg': 90.}, 'thumb_ip_flexion':
        'thumb_ip_flexion'}, 'rest': {'index_mcp_flexion': .3}})
    robot = load_robot(path).hand
    first, second = robot.follow
    assert robot.model.variables[first.variable] == 'index_pip_flexion'
    assert (first.angle, first.scale) == (JOINTS.index('little_pip_flexion'), .5)
    assert first.offset == pytest.approx(np.pi / 2) and second.scale == 1.
    assert robot.rest[robot.model.variables.index('index_mcp_flexion')] == .3


def test_a_package_path_is_resolved_where_ros_knows_it(hand_urdf, tmp_path, monkeypatch):
    (tmp_path / 'share' / 'my_hand').mkdir(parents=True)
    hand_urdf.rename(tmp_path / 'share' / 'my_hand' / 'hand.urdf')
    path = robot_file(tmp_path, {'urdf': 'package://my_hand/hand.urdf'})
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))
    assert load_robot(path).hand.side == 'right'
    monkeypatch.setenv('AMENT_PREFIX_PATH', '')
    with pytest.raises(InvalidRobot, match="there is no package 'my_hand'"):
        load_robot(path)


@pytest.mark.parametrize('settings, message', [
    ({'palm': 1}, "there is no key 'palm'; expected are name, urdf"),
    ({'side': 'both'}, "side: 'both'; expected right or left"),
    ({'digits': {'pinky': {}}}, "digits: there is no key 'pinky'; expected are thumb"),
    ({'digits': {'thumb': 'x'}}, 'digits.thumb: expected keys as tip'),
    ({'digits': {'thumb': {'tip': 'x'}, 'index': {'tip': 'index_tip'}}}, "there is no link 'x'"),
    ({'digits': {'thumb': {'tip': 'index_tip'}, 'index': {'tip': 'index_tip'}}},
     "digits: index and thumb have the tip 'index_tip'; expected another for each"),
    ({'digits': {'index': {'radius_mm': 'big'}}}, "digits.index.radius_mm: 'big'; expected a"),
    ({'digits': {'index': {'radius_mm': .008}}}, 'radius_mm: 0.008; expected none below 0.5 mm'),
    ({'digits': {'index': {'radius_mm': -3}}}, 'digits.index.radius_mm: -3; expected none below'),
    ({'digits': {'index': {'radius_mm': 900}}}, 'index.radius_mm: 900; expected 300 mm at most'),
    ({'digits': {'index': {'tip_offset_mm': [1]}}}, 'tip_offset_mm: [1]; expected three'),
    ({'digits': {'index': {'tip_offset_mm': [0, 0, 900]}}}, 'expected 300 mm at most'),
    ({'rest': {'index_mcp_flexion': 60}}, 'rest.index_mcp_flexion: 60; expected'),
    ({'rest': {'knee': 0.}}, "rest: there is no independent joint 'knee'"),
    ({'follow': {'index_pip_flexion': 'knee'}}, "angle: 'knee'; expected one of index_cmc"),
    ({'options': {'speed': 1.}}, "options: there is no key 'speed'"),
    ({'options': {'smoothness': -1.}}, 'robot.yaml: options: smoothness: -1.0; allowed is'),
    ({'options': {'touch': 9.}}, 'touch: 9.0; allowed is 0 to 0.05 m'),
    ({'order': ['knee']}, "order: there is no movable joint 'knee'"),
    ({'order': 5}, 'order: 5; expected a list'),
    ({'rest': {'index_pip_joint': 2**64}}, 'integer of more than 64 bits'),
    ({'urdf': 'a\0b'}, 'embedded null'),
    ({'urdf': '~no_such_user/a.urdf'}, '~no_such_user/a.urdf: Could not determine home'),
    ({'urdf': ''}, "no urdf: give the path"),
    ({'urdf': '', 'finger_mcp_mm': {}}, "there is no key 'finger_mcp_mm'; expected are name, urdf"),
    ({'urdf': 'none.urdf'}, 'none.urdf: No such file'),
])
def test_what_is_wrong_is_named(settings, message, hand_urdf, tmp_path):
    with pytest.raises(ValueError) as refusal:
        load_robot(robot_file(tmp_path, settings))
    assert message in str(refusal.value)


def test_a_joint_that_moves_no_digit_follows_no_angle(hand_urdf, tmp_path):
    hand_urdf.write_text(hand_urdf.read_text().replace('</robot>', (
        '<link name="world"/><joint name="lift" type="prismatic"><parent link="world"/>'
        '<child link="wrist"/><axis xyz="0 0 1"/><limit lower="0" upper="1"/></joint></robot>')))
    with pytest.raises(InvalidRobot, match="follow: joint 'lift' moves no digit; expected one of "
                                           'index_cmc_flexion, .*thumb_ip_flexion$'):
        load_robot(robot_file(tmp_path, {'follow': {'lift': 'index_pip_flexion'}}))


@pytest.mark.parametrize(('robot', 'named', 'meant'), [
    ('plain', 'leap_right', 'leap'), ('plain', 'Robotiq-2F-85', 'robotiq_2f'),
    ('allegro', 'plain_hand_left', 'plain'), ('plain', 'plain_leap', None),
    ('plain', 'mine', None)])
def test_a_urdf_that_names_another_presets_robot_is_doubted(robot, named, meant, tmp_path):
    text = (share_directory() / 'config' / 'robots' / 'plain_hand_right.urdf').read_text()
    xml = re.sub('<robot name="[^"]*"', f'<robot name="{named}"', text)
    notes = [note for note in load_robot(robot, xml).notes if 'is the preset' in note]
    assert notes == ([] if meant is None else [
        f"the URDF calls its robot '{named}': is the preset {meant} meant in place of {robot}?"])


@pytest.mark.parametrize(('named', 'preset'), [
    ('plain_hand_right', 'plain'), ('shadow_hand', None), ('mine', None)])
def test_a_urdf_alone_is_told_the_preset_that_takes_it(named, preset, tmp_path):
    text = (share_directory() / 'config' / 'robots' / 'plain_hand_right.urdf').read_text()
    (tmp_path / 'it.urdf').write_text(re.sub('<robot name="[^"]*"', f'<robot name="{named}"', text))
    notes = [note for note in load_robot(str(tmp_path / 'it.urdf')).notes if 'preset' in note]
    assert notes == ([] if preset is None else [
        f"the URDF calls its robot '{named}': the preset {preset} may know more of it, as its tips "
        "or its driver's order; give that as the robot, and this URDF as its robot_description"])


def test_an_unknown_robot_is_told_the_presets(tmp_path):
    with pytest.raises(InvalidRobot, match="'hal' is no file and no preset; presets are ability"):
        load_robot('hal')
    (tmp_path / 'list.yaml').write_text('- 1')
    with pytest.raises(InvalidRobot, match='expected a mapping'):
        load_robot(str(tmp_path / 'list.yaml'))


TIPS = ['thumb_tip', 'index_tip', 'middle_tip', 'ring_tip', 'little_tip']
DEX = {
    'vector': {'target_origin_link_names': ['wrist'] * 6,
               'target_task_link_names': [*TIPS, 'index_middle'],
               'target_link_human_indices': [[0] * 6, [4, 8, 12, 16, 20, 7]]},
    'position': {'target_link_names': TIPS, 'target_link_human_indices': [4, 8, 12, 16, 20]},
    'DexPilot': {'wrist_link_name': 'wrist', 'finger_tip_link_names': TIPS[:4],
                 'low_pass_alpha': .2, 'scaling_factor': 1.6},
}


@pytest.mark.parametrize('kind', DEX)
def test_files_of_dex_retargeting_are_read_as_they_are(kind, hand_urdf, tmp_path):
    path = tmp_path / 'dex.yml'
    path.write_text(yaml.safe_dump({'retargeting': {
        'type': kind, 'urdf_path': 'hand.urdf', **DEX[kind]}}))
    loaded = load_robot(str(path))
    tips = {role: digit.tip_link for role, digit in loaded.hand.anatomy.digits.items()}
    assert tips == {tip.split('_')[0]: tip for tip in TIPS[:4 if kind == 'DexPilot' else 5]}
    told = ' '.join(loaded.notes)
    assert ('scaling_factor 1.6: not used' in told) == (kind == 'DexPilot')
    assert ('index_middle: vectors to links other than tips' in told) == (kind == 'vector')


def test_what_is_not_used_of_a_file_of_dex_retargeting_is_said_once_and_why(hand_urdf, tmp_path):
    path = tmp_path / 'dex.yml'
    path.write_text(yaml.safe_dump({'options': {'touch': .01}, 'retargeting': {
        'type': 'vector', 'urdf_path': 'hand.urdf', **DEX['vector'], 'palm': 1,
        'finger_tip_link_names': TIPS, 'wrist_link_name': None, 'target_joint_names': ['a', 'b'],
        'add_dummy_free_joint': True, 'scaling_factor': 1.6, 'normal_delta': .004,
        'huber_delta': .02, 'project_dist': .03, 'escape_dist': .05, 'has_joint_limits': True,
        'ignore_mimic_joint': False, 'low_pass_alpha': .2}}))
    told = [note.partition(': not used')[::2] for note in load_robot(str(path)).notes
            if ': not used' in note]
    assert [part for part, _ in told] == [
        'wrist', 'add_dummy_free_joint True', 'escape_dist 0.05', 'finger_tip_link_names',
        'has_joint_limits True', 'huber_delta 0.02', 'ignore_mimic_joint False',
        'low_pass_alpha 0.2', 'normal_delta 0.004', 'project_dist 0.03', 'scaling_factor 1.6',
        'target_joint_names', "'options', 'palm'"]
    why = dict(told)
    assert why['wrist'] == ' as the wrist; the palm is found by geometry'
    assert why['escape_dist 0.05'] == '; tips are free by the option escape of a robot file'
    assert 'type vector is read by target_origin' in why['finger_tip_link_names']
    assert why["'options', 'palm'"] == '; files of dex-retargeting have no such key'


def test_a_urdf_of_dex_retargeting_is_found_beside_the_file_or_above_it(hand_urdf, tmp_path):
    path = tmp_path / 'configs' / 'teleop' / 'dex.yml'
    path.parent.mkdir(parents=True)

    def found(text, urdf=''):
        path.write_text(yaml.safe_dump({'retargeting': {
            'type': 'dexpilot', 'urdf_path': text, **DEX['DexPilot']}}))
        return load_robot(str(path), urdf).urdf

    above, beside = tmp_path / 'hands' / 'hand.urdf', path.parent / 'hand.urdf'
    above.parent.mkdir()
    beside.write_text(hand_urdf.read_text())
    hand_urdf.rename(above)
    assert found('hands/hand.urdf') == str(above) == found(str(above))
    assert found('hand.urdf') == str(beside)
    with pytest.raises(InvalidRobot, match="there is no 'my/hand.urdf' beside this file or in a "
                                           'folder above .* URDF directory .*--robot-description'):
        found('my/hand.urdf')
    assert found('my/hand.urdf', str(above)) == str(above)


def test_a_gripper_of_dex_retargeting_has_its_tips_as_origin_and_task(tmp_path):
    (tmp_path / 'gripper.urdf').write_text(GRIPPER)
    path = tmp_path / 'dex.yml'
    path.write_text(yaml.safe_dump({'retargeting': {
        'type': 'vector', 'urdf_path': 'gripper.urdf', 'target_origin_link_names': ['left_tip'],
        'target_task_link_names': ['right_tip'], 'target_link_human_indices': [[4], [8]]}}))
    digits = load_robot(str(path)).hand.anatomy.digits
    assert (digits['thumb'].tip_link, digits['index'].tip_link) == ('left_tip', 'right_tip')


@pytest.mark.parametrize('section, message', [
    (1, 'retargeting: 1; expected a mapping'),
    ({'type': 'magic'}, "retargeting.type: 'magic'; expected one of vector"),
    ({'type': 'vector'}, 'retargeting.urdf_path: missing'),
    ({'type': 'dexpilot', 'urdf_path': 'hand.urdf'}, 'finger_tip_link_names: None; expected a'),
    ({'type': 'position', 'urdf_path': 'hand.urdf', 'target_link_names': ['a'],
      'target_link_human_indices': [4]}, 'names 1 finger tips; expected at least two'),
])
def test_broken_files_of_dex_retargeting_are_refused(section, message, tmp_path):
    path = tmp_path / 'dex.yml'
    path.write_text(yaml.safe_dump({'retargeting': section}))
    with pytest.raises(InvalidRobot) as refusal:
        load_robot(str(path))
    assert message in str(refusal.value)
