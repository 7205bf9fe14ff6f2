"""The skin: a closed mesh that follows the bones as flesh does."""

import resource
from dataclasses import fields

import numpy as np
import pytest
import trimesh
from PIL import Image
from scipy.spatial.transform import Rotation

from hand_tracker.cli.skin import main
from hand_tracker.core.model.hand import JOINTS, LINKS, Hand
from hand_tracker.core.model.kinematics import forward, joint_table
from hand_tracker.core.numerics.jit import COMPILED
from hand_tracker.simulation.poses import pose_angles
from hand_tracker.skin import (
    InvalidMesh,
    deform,
    load,
    load_skin,
    pictures,
)
from hand_tracker.skin.measure import self_intersection_share, volume, winding_numbers

NEEDS = 'skimage', 'trimesh'

HAND = Hand.scaled()
VOLUME_CHANGE = {'open': .02, 'spread': .02, 'fist': .06}


@pytest.fixture(scope='module', autouse=True)
def cache(tmp_path_factory):
    """Keep skins away from the user's own cache."""
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp('cache')
        patch.setenv('XDG_CACHE_HOME', str(folder))
        yield folder / 'hand_tracker'


@pytest.fixture(scope='module')
def skin(cache):
    return load_skin(HAND)


def posed(hand, name, **placed):
    return forward(joint_table(hand), pose_angles(name, hand), **placed)


def mesh(skin, vertices):
    return trimesh.Trimesh(vertices, skin.faces, process=False)


def test_skin_is_one_closed_mesh_of_a_hands_size(skin):
    found = mesh(skin, skin.vertices)
    assert found.is_watertight and found.is_winding_consistent
    assert found.body_count == 1
    assert found.euler_number == 2
    assert 3000 < len(skin.vertices) < 8000
    # Water displaced by adult hands up to the wrist: some 250 to 450 ml.
    assert 250e-6 < found.volume < 450e-6
    assert np.degrees(found.face_angles.min()) > 5.


@pytest.mark.parametrize('hand', [
    Hand.scaled(.17, .12), Hand.scaled(radii=np.full((5, 3), .002), palm_radius=.003)])
def test_broad_and_bony_hands_have_no_holes(hand):
    found = trimesh.Trimesh(*load.generated_arrays(hand)[:2], process=False)
    assert found.is_watertight
    assert (found.body_count, found.euler_number) == (1, 2)


def test_bones_are_inside(skin):
    assert [LINKS[link] for link in skin.links[:4]] == [
        'index_metacarpal', 'index_proximal', 'index_middle', 'index_distal']
    joints = forward(joint_table(HAND), np.zeros(len(JOINTS))).position
    np.testing.assert_array_equal(joints[list(skin.links)], skin.rest.position)
    middles = .5 * (joints[[2, 7, 12, 17, 23]] + joints[[3, 8, 13, 18, 24]])
    assert (trimesh.proximity.signed_distance(mesh(skin, skin.vertices), middles) > .004).all()


def test_weights_are_shares(skin):
    assert skin.weights.shape == (len(skin.vertices), len(skin.links))
    assert skin.weights.min() >= 0.
    assert skin.weights.max() <= 1.
    np.testing.assert_allclose(skin.weights.sum(axis=1), 1., rtol=0., atol=1e-12)
    assert (skin.weights.max(axis=0) > .7).all()


def test_weights_are_smooth(skin):
    edges = mesh(skin, skin.vertices).edges_unique
    jump = np.abs(skin.weights[edges[:, 0]] - skin.weights[edges[:, 1]]).max(axis=1)
    assert jump.max() < .5
    assert np.median(jump) < .05


def test_zero_angles_leave_the_skin_as_it_is(skin):
    pose = forward(joint_table(HAND), np.zeros(len(JOINTS)))
    np.testing.assert_allclose(deform(skin, pose), skin.vertices, rtol=0., atol=1e-12)


def test_the_skin_goes_with_the_wrist(skin):
    rotation = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    rotation *= np.linalg.det(rotation)
    moved = np.array((.3, -2., 1.))
    still = deform(skin, posed(HAND, 'fist'))
    gone = deform(skin, posed(HAND, 'fist', wrist_rotation=rotation, wrist_position=moved))
    np.testing.assert_allclose(gone, still @ rotation.T + moved, rtol=0., atol=1e-12)


def test_many_poses_at_once_are_those_one_by_one(skin):
    angles = np.stack([pose_angles(name, HAND) for name in ('open', 'fist')])
    together = deform(skin, forward(joint_table(HAND), angles))
    for one, name in zip(together, ('open', 'fist')):
        np.testing.assert_allclose(one, deform(skin, posed(HAND, name)), rtol=0., atol=1e-12)


@pytest.mark.parametrize('dual_quaternions', [False, True])
@pytest.mark.parametrize('name', VOLUME_CHANGE)
def test_flesh_keeps_its_volume(skin, name, dual_quaternions):
    rest = volume(skin.vertices, skin.faces)
    assert rest == pytest.approx(mesh(skin, skin.vertices).volume)
    change = volume(deform(skin, posed(HAND, name), dual_quaternions), skin.faces) / rest - 1.
    assert abs(change) < (.02 if dual_quaternions else VOLUME_CHANGE[name])


def test_winding_numbers():
    box = trimesh.creation.box()
    places = np.array(((0., 0., 0.), (.4, -.4, .3), (.6, 0., 0.), (5., 5., 5.)))
    np.testing.assert_allclose(winding_numbers(np.array(box.vertices[box.faces]), places),
                               (1., 1., 0., 0.), rtol=0., atol=1e-12)
    box = box.subdivide().subdivide().subdivide()
    two = trimesh.util.concatenate((box, box.copy().apply_translation((.3, .2, .1))))
    inside = [(np.abs(vertex - middle) < .499).all() for vertex, middle in zip(
        two.vertices, np.repeat(((.3, .2, .1), (0., 0., 0.)), len(box.vertices), axis=0))]
    assert self_intersection_share(np.array(two.vertices), np.array(two.faces)) == pytest.approx(
        np.mean(inside), abs=.03)
    assert np.mean(inside) > .1


@pytest.mark.skipif(not COMPILED, reason='takes minutes in plain Python')
@pytest.mark.parametrize(('name', 'share'), {'spread': .002, 'open': .005, 'fist': .08}.items())
def test_skin_goes_little_through_itself(skin, name, share):
    assert self_intersection_share(deform(skin, posed(HAND, name)), skin.faces) < share


def test_dual_quaternions_move_rigidly_what_is_rigid(skin):
    pose = posed(HAND, 'fist', wrist_position=np.array((.3, -2., 1.)))
    still = deform(skin, posed(HAND, 'fist'), True)
    np.testing.assert_allclose(deform(skin, pose, True), still + (.3, -2., 1.), atol=1e-12)
    # Where one link has all the weight, both ways are the same.
    alone = skin.weights.max(axis=1) > .995
    assert alone.sum() > 20
    np.testing.assert_allclose(
        still[alone], deform(skin, posed(HAND, 'fist'))[alone], rtol=0., atol=1e-3)
    zero = forward(joint_table(HAND), np.zeros(len(JOINTS)))
    np.testing.assert_allclose(deform(skin, zero, True), skin.vertices, rtol=0., atol=1e-12)


def test_left_is_mirrored(skin):
    left = load_skin(HAND.mirrored())
    mirror = np.array((1., -1., 1.))
    np.testing.assert_array_equal(left.vertices, skin.vertices * mirror)
    np.testing.assert_allclose(
        deform(left, posed(HAND.mirrored(), 'fist')), deform(skin, posed(HAND, 'fist')) * mirror,
        rtol=0., atol=1e-12)
    assert mesh(left, left.vertices).volume > 0.


def test_cache_gives_the_same_skin_and_damage_is_mended(skin, cache, monkeypatch):
    (path,) = cache.glob('skin-*.npz')
    again = load_skin(HAND)
    for name in ('vertices', 'faces', 'weights'):
        np.testing.assert_array_equal(getattr(again, name), getattr(skin, name))
    path.write_bytes(path.read_bytes()[:5000])
    mended = load_skin(HAND)
    np.testing.assert_array_equal(mended.weights, skin.weights)
    monkeypatch.setattr(load, 'generated_arrays', None)  # not made, but found
    np.testing.assert_array_equal(load_skin(HAND).weights, skin.weights)
    assert list(cache.iterdir()) == [path]


def test_a_skin_that_cannot_be_kept_leaves_nothing_on_the_disk(tmp_path):
    arrays = load.SkinArrays(np.zeros((5000, 3)), np.zeros((5000, 3), int), np.zeros((5000, 9)))
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    for room in (10, 100_000):  # [bytes] neither the first array fits, nor all
        resource.setrlimit(resource.RLIMIT_FSIZE, (room, hard))
        try:
            load._write_cache(tmp_path / 'skin.npz', arrays)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        assert list(tmp_path.iterdir()) == []
    load._write_cache(tmp_path / 'skin.npz', arrays)
    assert [path.name for path in tmp_path.iterdir()] == ['skin.npz']


def test_other_hands_have_other_skins(skin, cache):
    assert load._cache_key(HAND, None) == load._cache_key(Hand.scaled(side='left'), None)
    assert load._cache_key(HAND, None) != load._cache_key(Hand.scaled(length=.19), None)


@pytest.mark.parametrize('field', [field.name for field in fields(Hand) if field.name != 'side'])
def test_a_skin_is_that_of_hands_with_the_same_places_of_joints(field):
    value = getattr(HAND, field)
    other = HAND.replace(**{field: value + 1e-3 * np.ones(np.shape(value))})
    moves_joints = not all(map(np.array_equal, joint_table(HAND), joint_table(other)))
    # The radii shape the skin alone.
    assert load.has_skin_of(HAND, other) == (
        not moves_joints and field not in ('radii', 'palm_radius'))


@pytest.mark.parametrize('suffix', ['stl', 'obj', 'ply'])
def test_a_mesh_of_ones_own_is_laid_upon_the_hand(skin, tmp_path, suffix):
    turn = Rotation.from_rotvec((2., -1., 1.5)).as_matrix()
    own = mesh(skin, 1100. * skin.vertices @ turn.T + (300., -40., 7.))
    own.export(tmp_path / f'own.{suffix}')
    found = load_skin(HAND, tmp_path / f'own.{suffix}')
    assert len(found.vertices) == len(skin.vertices)
    assert trimesh.proximity.closest_point(
        mesh(skin, skin.vertices), found.vertices[::20])[1].max() < .001
    assert mesh(found, found.vertices).is_watertight
    np.testing.assert_allclose(found.weights.sum(axis=1), 1., rtol=0., atol=1e-12)
    fist = deform(found, posed(HAND, 'fist'))
    assert trimesh.proximity.closest_point(
        mesh(skin, deform(skin, posed(HAND, 'fist'))), fist[::20])[1].mean() < .001


def test_a_mesh_of_the_other_side_or_of_something_else_is_refused(skin, tmp_path):
    mesh(skin, skin.vertices).export(tmp_path / 'right.ply')
    with pytest.raises(InvalidMesh,
                       match=r'right\.ply: it fits a right hand, expected is a left one'):
        load_skin(HAND.mirrored(), tmp_path / 'right.ply')
    trimesh.creation.icosphere(3).export(tmp_path / 'ball.stl')
    with pytest.raises(InvalidMesh, match='ball.stl: laid upon'):
        load_skin(HAND, tmp_path / 'ball.stl')


def test_a_broken_mesh_is_named(skin, tmp_path):
    def refused(name, content, reason):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(InvalidMesh, match=f'{name}: .*{reason}'):
            load_skin(HAND, tmp_path / name)

    refused('a.stl', b'no mesh at all', '')
    refused('a.ply', b'ply\nformat ascii 1.0\nelement vertex 3\n', '')
    refused('a.obj', b'v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n', '3 vertices; allowed is 200')
    refused('a.dae', b'', 'expected is one of .obj, .ply, .stl')
    torn = trimesh.Trimesh(skin.vertices, skin.faces[5:], process=False)
    refused('torn.ply', torn.export(file_type='ply'), 'holes')
    with pytest.raises(InvalidMesh, match='none.obj: No such file'):
        load_skin(HAND, tmp_path / 'none.obj')


def test_command_draws_and_measures(skin, tmp_path, capsys, monkeypatch):
    if not COMPILED:
        pytest.skip('takes minutes in plain Python')
    monkeypatch.setattr(pictures, 'PICTURED_POSES', ('open', 'fist'))
    monkeypatch.setattr(pictures, 'CELL_SIZE', 200)
    assert main(['--side', 'left', '-o', str(tmp_path / 'out')]) == 0
    told = capsys.readouterr().out
    assert 'fist' in told
    for name in ('poses', 'weights', 'blending'):
        with Image.open(tmp_path / 'out' / f'{name}.png') as image:
            assert len(image.convert('RGB').getcolors(image.width * image.height)) > 100
    assert main(['--mesh', str(tmp_path / 'none.ply')]) == 1
    assert capsys.readouterr().err == f'hand_tracker skin: {tmp_path}/none.ply: No such file or ' \
                                      'directory\n'
