"""The URDF: what it holds, that other programs load it in silence, and its command."""

import io
import logging
import shutil
import subprocess
import warnings
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from hand_tracker.cli.urdf import main
from hand_tracker.core.model.hand import DIGITS, FINGERS, JOINTS, LINKS, SIDES, Hand, preset_limits
from hand_tracker.core.model.kinematics import joint_table
from hand_tracker.core.model.marker_layout import MarkerLayout
from hand_tracker.files.hand_file import save_hand
from hand_tracker.files.urdf_file import urdf

URDF_FOLDER = Path(__file__).parents[2] / 'urdf'
ODD_HANDS = {
    'wide': Hand.scaled(limits=preset_limits('wide')),
    'splayed': Hand.scaled(.21, .09, splay=(.12, .02, -.08, -.2)),
    'deviating': Hand.scaled(side='left', phalanx_deviation=(.1, 0., -.05, -.15)),
    'rolled': Hand.scaled(side='left', thumb_roll=.8, thumb_axis_distance=.015),
    'finger CMC in the wrist': Hand.scaled(finger_cmc=np.zeros((4, 3))),
    'thumb straight down': Hand.scaled(
        thumb_rest_direction=(0., 0., -1.), thumb_abduction_axis=(0., 1., 0.)),
    'tip shorter than thick': Hand.scaled(radii=np.full((5, 3), .04)),
}


@pytest.fixture(params=[*SIDES, *ODD_HANDS])
def hand(request):
    return ODD_HANDS.get(request.param) or Hand.scaled(side=request.param)


def numbers(text):
    return np.array([float(word) for word in text.split()])


def turn(rpy):
    """Return URDF's rotation: about the fixed x, then y, then z."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy), np.sin(rpy)
    about_x = np.array(((1., 0., 0.), (0., cr, -sr), (0., sr, cr)))
    about_y = np.array(((cp, 0., sp), (0., 1., 0.), (-sp, 0., cp)))
    about_z = np.array(((cy, -sy, 0.), (sy, cy, 0.), (0., 0., 1.)))
    return about_z @ about_y @ about_x


def shapes(robot, link, kind='collision'):
    """Return (tag, centre, direction of z, attributes) of a link's shapes."""
    found = []
    for part in robot.findall(f"link[@name='{link}']/{kind}"):
        origin, shape = part.find('origin'), part.find('geometry')[0]
        along = turn(numbers(origin.get('rpy')))[:, 2]
        found.append((shape.tag, numbers(origin.get('xyz')), along,
                      {key: float(value) for key, value in shape.items()}))
    return found


def test_joints_and_links_are_the_hands(hand):
    robot = ElementTree.fromstring(urdf(hand, 'p_'))
    joints = robot.findall('joint')
    turning = [joint for joint in joints if joint.get('type') == 'revolute']
    assert [joint.get('name') for joint in turning] == [f'p_{name}' for name in JOINTS]
    assert [joint.find('child').get('link') for joint in turning] == [f'p_{n}' for n in LINKS]
    fixed = [joint for joint in joints if joint.get('type') == 'fixed']
    assert [joint.find('child').get('link') for joint in fixed] == [f'p_{d}_tip' for d in DIGITS]
    assert len(joints) == 30
    links = [link.get('name') for link in robot.findall('link')]
    assert len(links) == len(set(links)) == 31
    assert set(links) - {joint.find('child').get('link') for joint in joints} == {'p_wrist'}
    assert not robot.findall('.//inertial')


def test_limits_and_origins_are_the_hands(hand):
    robot = ElementTree.fromstring(urdf(hand))
    table = joint_table(hand)
    for i, name in enumerate(JOINTS):
        joint = robot.find(f"joint[@name='{name}']")
        limit = joint.find('limit')
        assert (float(limit.get('lower')), float(limit.get('upper'))) == pytest.approx(
            tuple(hand.limits[i]), abs=1e-9)
        assert float(limit.get('effort')) > 0. and float(limit.get('velocity')) > 0.
        origin = joint.find('origin')
        assert numbers(origin.get('xyz')) == pytest.approx(table.translation[i], abs=1e-9)
        assert turn(numbers(origin.get('rpy'))) == pytest.approx(table.rotation[i], abs=3e-9)
        assert numbers(joint.find('axis').get('xyz')) == pytest.approx(table.axis[i], abs=1e-9)


@pytest.mark.parametrize('side', SIDES)
def test_capsules_run_from_joint_to_joint(side):
    robot = ElementTree.fromstring(urdf(Hand.scaled(
        side=side, phalanx_deviation=(.1, 0., -.05, -.15), thumb_roll=.8,
        thumb_axis_distance=.015)))
    followers = {f'{finger}_{a}': f'{finger}_{b}' for finger in FINGERS for a, b in (
        ('metacarpal', 'mcp_abduction'), ('proximal', 'pip_flexion'), ('middle', 'dip_flexion'))}
    followers.update(thumb_saddle='thumb_cmc_flexion', thumb_metacarpal='thumb_mcp_abduction',
                     thumb_proximal='thumb_ip_flexion')
    for link, joint in followers.items():
        end = numbers(robot.find(f"joint[@name='{joint}']/origin").get('xyz'))
        ball, far_ball, (tag, centre, along, size) = shapes(robot, link)
        assert (ball[0], far_ball[0], tag) == ('sphere', 'sphere', 'cylinder')
        assert ball[1] == pytest.approx(np.zeros(3))
        assert far_ball[1] == pytest.approx(end, abs=1e-9)
        half = along * size['length'] / 2.
        assert centre - half == pytest.approx(np.zeros(3), abs=3e-9)
        assert centre + half == pytest.approx(end, abs=3e-9)
        assert ball[3]['radius'] == far_ball[3]['radius'] == size['radius']


def test_skin_ends_at_the_finger_tips():
    hand = Hand.scaled()
    robot = ElementTree.fromstring(urdf(hand))
    for digit in DIGITS:
        tip = numbers(robot.find(f"joint[@name='{digit}_tip_fixed']/origin").get('xyz'))
        _, (_, centre, _, size), _ = shapes(robot, f'{digit}_distal')
        assert centre[0] + size['radius'] == pytest.approx(tip[0], abs=1e-9)
    assert numbers(robot.find("joint[@name='ring_tip_fixed']/origin").get('xyz'))[0] == (
        pytest.approx(hand.finger_bones[2, 2]))


def test_what_is_seen_is_what_collides_and_is_coloured(hand):
    robot = ElementTree.fromstring(urdf(hand, 'p_'))
    materials = {material.get('name') for material in robot.findall('material')}
    for link in robot.findall('link'):
        name = link.get('name')
        seen, solid = shapes(robot, name, 'visual'), shapes(robot, name)
        assert [(s[0], s[3], *s[1]) for s in seen] == [(s[0], s[3], *s[1]) for s in solid]
        for part in link.findall('visual'):
            assert part.find('material').get('name') in materials
    assert all(name.startswith('p_') for name in materials)


def test_text_is_the_same_every_time_and_short(hand):
    text = urdf(hand)
    assert text == urdf(hand.replace())
    assert max(len(line) for line in text.splitlines()) < 99
    assert '-0"' not in text and '-0 ' not in text and 'e-' not in text


@pytest.mark.parametrize('side', SIDES)
def test_shipped_files_are_what_the_command_writes(side, tmp_path):
    made = tmp_path / 'hand.urdf'
    assert main(['--side', side, '--prefix', f'{side}_', '-o', str(made)]) == 0
    shipped = URDF_FOLDER / f'hand_{side}.urdf'
    assert shipped.read_text(encoding='utf-8') == made.read_text(encoding='utf-8'), (
        f'remake it: python -m hand_tracker urdf --side {side} --prefix {side}_ -o {shipped.name}')


def test_yourdfpy_loads_it_in_silence(hand, caplog, capfd):
    yourdfpy = pytest.importorskip('yourdfpy', reason='yourdfpy is not installed')
    with warnings.catch_warnings(), caplog.at_level(logging.WARNING):
        warnings.simplefilter('error')
        # yourdfpy's own call, with collision scenes of any URDF.
        warnings.filterwarnings('ignore', '`Scene.dump', DeprecationWarning)
        robot = yourdfpy.URDF.load(
            io.BytesIO(urdf(hand).encode()), build_collision_scene_graph=True)
        assert robot.validate()
    assert robot.actuated_joint_names == list(JOINTS)
    assert robot.base_link == 'wrist'
    assert not caplog.records
    assert tuple(capfd.readouterr()) == ('', '')


def test_pinocchio_loads_it_in_silence(hand, caplog, capfd):
    pinocchio = pytest.importorskip('pinocchio', reason='pinocchio is not installed')
    with warnings.catch_warnings(), caplog.at_level(logging.WARNING):
        warnings.simplefilter('error')
        model = pinocchio.buildModelFromXML(urdf(hand))
        for kind in (pinocchio.VISUAL, pinocchio.COLLISION):
            geometry = pinocchio.buildGeomFromUrdfString(model, urdf(hand), kind)
            assert geometry.ngeoms == len(
                ElementTree.fromstring(urdf(hand)).findall('link/collision'))
    assert model.nq == model.nv == 25
    assert sorted(model.names[1:]) == sorted(JOINTS)
    order = [model.joints[model.getJointId(joint)].idx_q for joint in JOINTS]
    assert model.lowerPositionLimit[order] == pytest.approx(hand.limits[:, 0], abs=1e-9)
    assert model.upperPositionLimit[order] == pytest.approx(hand.limits[:, 1], abs=1e-9)
    assert not caplog.records
    assert tuple(capfd.readouterr()) == ('', '')


def test_check_urdf_passes(hand, tmp_path):
    if not shutil.which('check_urdf'):
        pytest.skip('check_urdf is not installed (Debian, Ubuntu: liburdfdom-tools)')
    path = tmp_path / 'hand.urdf'
    path.write_text(urdf(hand, 'p_'), encoding='utf-8')
    run = subprocess.run(['check_urdf', str(path)], capture_output=True, text=True, timeout=240)
    assert run.returncode == 0
    assert 'root Link: p_wrist has 5 child(ren)' in run.stdout
    assert run.stderr == ''


def test_command_writes_to_standard_output(capsys):
    assert main(['--side', 'left', '--limits', 'wide', '--prefix', 'l_']) == 0
    expected = Hand.scaled(side='left', limits=preset_limits('wide'))
    assert capsys.readouterr().out == urdf(expected, 'l_')


def test_command_takes_a_hand_file(tmp_path, capsys):
    hand = Hand.scaled(.2, .09, side='left', limits=preset_limits('wide'))
    save_hand(tmp_path / 'mine.yaml', hand, MarkerLayout())
    assert main(['--hand', str(tmp_path / 'mine.yaml')]) == 0
    assert capsys.readouterr().out == urdf(hand)
    assert main(['--hand', str(tmp_path / 'mine.yaml'), '--side', 'right']) == 0
    assert capsys.readouterr().out == urdf(hand.mirrored())


def test_command_says_what_is_wrong(tmp_path, capsys):
    missing = tmp_path / 'none.yaml'
    assert main(['--hand', str(missing)]) == 1
    assert capsys.readouterr().err == f'hand_tracker urdf: {missing}: No such file or directory\n'
    assert main(['-o', str(tmp_path / 'no' / 'folder.urdf')]) == 1
    assert 'No such file or directory' in capsys.readouterr().err
    with pytest.raises(SystemExit) as stopped:
        main(['--side', 'both'])
    assert stopped.value.code == 2
