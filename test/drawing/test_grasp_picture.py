"""Primitive shapes as meshes, and moments side by side."""

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from hand_tracker.drawing.grasp_picture import (
    CAPTION_HEIGHT,
    MOMENT_SIZE,
    SPHERE_SHARE,
    GraspMoment,
    PlacedShape,
    save_grasp_picture,
    shape_mesh,
)

TURN = Rotation.from_euler('xyz', (.3, -.5, 1.2)).as_matrix()
AT = np.array((.1, -.2, .3))
BALL_COLOUR = (1., .6, .1)


def placed(kind, size):
    return PlacedShape(kind, size, TURN, AT, BALL_COLOUR)


def volume(mesh):
    """Return the volume within a mesh by the divergence theorem: positive if faces look out."""
    return np.linalg.det(mesh.vertices[mesh.faces]).sum() / 6.


@pytest.mark.parametrize('shape, expected, tolerance', [
    (placed('box', (.02, .03, .05)), .02 * .03 * .05, 1e-9),
    (placed('sphere', (.03,)), 4. / 3. * np.pi * (SPHERE_SHARE * .03)**3, .03),
    # With round ends.
    (placed('cylinder', (.01, .05)), np.pi * .01**2 * .05 + 4. / 3. * np.pi * .01**3, .03)])
def test_a_shape_is_closed_looks_outwards_and_has_its_volume(shape, expected, tolerance):
    mesh = shape_mesh(shape)
    assert volume(mesh) == pytest.approx(expected, rel=tolerance)
    np.testing.assert_allclose(
        .5 * (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)), AT, atol=1e-3)


def test_a_box_is_turned_with_its_frame():
    corners = (shape_mesh(placed('box', (.02, .03, .05))).vertices - AT) @ TURN
    np.testing.assert_allclose(np.abs(corners), np.tile((.01, .015, .025), (24, 1)))


def test_moments_stand_beside_each_other(tmp_path):
    save_grasp_picture(tmp_path / 'grasp.png', [
        GraspMoment(title, [placed('box', (.1, .1, .02)), placed('sphere', (.03,))])
        for title in ('one', 'two', 'three')])
    with Image.open(tmp_path / 'grasp.png') as image:
        pixels = np.asarray(image.convert('RGB')).astype(int)
    assert pixels.shape[:2] == (MOMENT_SIZE + CAPTION_HEIGHT, 3 * MOMENT_SIZE)
    for left in range(0, 3 * MOMENT_SIZE, MOMENT_SIZE):
        panel = pixels[CAPTION_HEIGHT:, left:left + MOMENT_SIZE]
        assert (panel[..., 0] > panel[..., 2] + 60).mean() > .05
