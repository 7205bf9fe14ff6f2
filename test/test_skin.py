"""The skin: a closed mesh that follows the bones as flesh does."""

import numpy as np
import pytest

trimesh = pytest.importorskip('trimesh', reason='trimesh is not installed')
pytest.importorskip('skimage', reason='scikit-image is not installed')

from hand_tracker.core.hand import JOINTS, LINKS, Hand  # noqa: E402
from hand_tracker.core.kinematics import forward, joint_table  # noqa: E402
from hand_tracker.simulation.poses import pose_angles  # noqa: E402
from hand_tracker.skin import deform, load_skin  # noqa: E402
from hand_tracker.skin import load  # noqa: E402

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


@pytest.mark.parametrize('name', VOLUME_CHANGE)
def test_flesh_keeps_its_volume(skin, name):
    rest = mesh(skin, skin.vertices).volume
    change = mesh(skin, deform(skin, posed(HAND, name))).volume / rest - 1.
    assert abs(change) < VOLUME_CHANGE[name]


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
    monkeypatch.setattr(load, 'model_arrays', None)  # not made, but found
    np.testing.assert_array_equal(load_skin(HAND).weights, skin.weights)
    assert list(cache.glob('*.part')) == []


def test_other_hands_have_other_skins(skin, cache):
    assert load._key(HAND, None) == load._key(Hand.scaled(side='left'), None)
    assert load._key(HAND, None) != load._key(Hand.scaled(length=.19), None)
