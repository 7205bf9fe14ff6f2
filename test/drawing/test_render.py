"""Rendered meshes: right size and place, near before far, light and shadow."""

import numpy as np
import pytest

from hand_tracker.core.model.hand import SIDES
from hand_tracker.drawing.mesh import vertex_normals
from hand_tracker.drawing.render import (
    VIEW_DIRECTIONS,
    Camera,
    ball_mesh,
    bone_mesh,
    camera_axes,
    fitting_camera,
    merge_meshes,
    render,
    view_axes,
)

PURE_RED, PURE_BLUE = (1., 0., 0.), (0., 0., 1.)
FRONT = Camera(np.eye(3), np.zeros(3), .1)  # a picture element is a millimetre
SIZE = 100, 100


def covered(image):
    return image[..., 3] > 127


def colour_at(image, x, y):
    """Return which of red, green and blue is strongest at a place right and up [m]."""
    return int(np.argmax(image[50 - round(1000 * y), 50 + round(1000 * x), :3]))


@pytest.mark.parametrize('length', [0., .02])
def test_bone_is_closed_and_faces_outwards(length):
    end = np.array((length, 0., 0.))
    mesh = bone_mesh(np.zeros(3), end, .01, .005, PURE_RED)
    edges = np.sort(mesh.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    # The poles are rings of no size: but for theirs every edge has two faces.
    counts = np.unique(edges, axis=0, return_counts=True)[1]
    assert (counts == 2).mean() > .9
    normals = vertex_normals(mesh.vertices, mesh.faces)
    outwards = np.einsum('ni,ni->n', normals, mesh.vertices - .5 * end)
    assert (outwards > -1e-9).all()


def test_ball_is_a_disc_of_its_size_in_its_place():
    image = render([ball_mesh(np.array((.02, .01, 0.)), .01, PURE_RED)], FRONT, SIZE)
    rows, columns = np.nonzero(covered(image))
    assert columns.mean() == pytest.approx(69.5, abs=1.)
    assert rows.mean() == pytest.approx(39.5, abs=1.)
    assert covered(image).sum() == pytest.approx(np.pi * 10. ** 2, rel=.05)
    assert image[0, 0, 3] == 0


def test_near_hides_far_whatever_the_order():
    near = ball_mesh(np.array((0., 0., .03)), .01, PURE_RED)
    far = ball_mesh(np.zeros(3), .02, PURE_BLUE)
    for meshes in ((near, far), (far, near)):
        image = render(meshes, FRONT, SIZE)
        assert colour_at(image, 0., 0.) == 0
        assert colour_at(image, 0., -.017) == 2


def test_what_is_nearer_is_larger():
    sizes = [covered(render([ball_mesh(np.array((0., 0., z)), .01, PURE_RED)], FRONT, SIZE)).sum()
             for z in (-.2, 0., .2)]
    assert sizes[0] < sizes[1] < sizes[2]


def test_light_comes_from_above_and_throws_shadows():
    ground = ball_mesh(np.array((0., 0., -.1)), .09, (.8, .8, .8))
    image = render([ball_mesh(np.zeros(3), .04, (.8, .8, .8))], FRONT, SIZE).astype(int)
    assert image[25, 40, 0] > image[75, 60, 0] + 30
    alone = render([ground], FRONT, SIZE).astype(int)
    ball = ball_mesh(np.array((-.02, .02, .03)), .006, PURE_RED)
    shaded = render([ground, ball], FRONT, SIZE).astype(int)
    darker = (alone - shaded)[..., 1] > 20
    under_ball = shaded[..., 0] > shaded[..., 1] + 40
    rows, columns = np.nonzero(darker & ~under_ball)
    # Away from the light: to the right and down of the ball.
    assert len(rows) > 20
    ball_rows, ball_columns = np.nonzero(under_ball)
    assert columns.mean() > ball_columns.mean() and rows.mean() > ball_rows.mean()


def test_camera_looks_along_its_axes():
    camera = Camera(camera_axes((0., 0., 2.), (0., 3., 0.)), (.1, .2, .3), .1)
    np.testing.assert_allclose(camera.axes, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(camera.project(np.array((.1, .2, .3)), SIZE), (50., 50., 0.))
    np.testing.assert_allclose(camera.project(np.array((.12, .21, .3)), SIZE), (70., 40., 0.))


@pytest.mark.parametrize('view', VIEW_DIRECTIONS)
def test_left_hands_are_seen_as_right_ones_in_a_mirror(view):
    point = np.array((.1, .02, .03))
    right, up, depth = view_axes(view, 'right') @ point
    np.testing.assert_allclose(view_axes(view, 'left') @ (point * (1., -1., 1.)),
                               (-right, up, depth))


@pytest.mark.parametrize('side', SIDES)
def test_views_are_right_handed_and_the_thumb_is_near_in_its_view(side):
    for view in VIEW_DIRECTIONS:
        right, up, eye = view_axes(view, side)
        np.testing.assert_allclose(np.cross(right, up), eye)
    assert view_axes('from the thumb', side)[2] @ (0., 1. if side == 'right' else -1., 0.) == 1.


def test_fitted_camera_has_all_points_in_its_picture_and_little_air():
    points = np.random.default_rng(1).normal((.3, -.2, .1), (.1, .03, .05), (500, 3))
    for view in VIEW_DIRECTIONS:
        places = fitting_camera(view_axes(view, 'right'), points).project(points, SIZE)[:, :2]
        assert 0. < places.min() < 20. and 80. < places.max() < 100.


def test_joined_meshes_keep_their_faces():
    first, second = ball_mesh(np.zeros(3), .01, PURE_RED), ball_mesh(np.ones(3), .01, PURE_BLUE)
    both = merge_meshes([first, second])
    corners = both.vertices[both.faces[len(first.faces):]]
    np.testing.assert_array_equal(corners, second.vertices[second.faces])
    np.testing.assert_array_equal(both.colours[[0, -1]], (PURE_RED, PURE_BLUE))
