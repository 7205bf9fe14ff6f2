"""Clouds of any layout: what numpy laid out is found again, contradictions are named."""

import numpy as np
import pytest
from helpers.clouds import NUMBER_FORMATS, cloud

from hand_tracker.adapters.point_cloud import points_of_cloud
from hand_tracker.adapters.point_frame import MalformedFrame

CLOUD_POINTS = np.array([[.5, -.25, 1.], [2., 4., -8.], [.125, 0., 0.], [1., 2., 3.]])


@pytest.mark.parametrize('order', '<>')
@pytest.mark.parametrize('form', ['f4', 'f8'])
@pytest.mark.parametrize('fields', [('x', 'y', 'z'), ('rgb', 'z', 'y', 'x'),
                                    ('intensity', 'x', 'y', 'ring', 'z', 'rgb')])
def test_any_layout_is_read(fields, form, order):
    message = cloud(CLOUD_POINTS, fields, form, order, padding=3)
    frame = points_of_cloud(message)
    np.testing.assert_array_equal(frame.points, CLOUD_POINTS)
    assert frame.names == () and frame.frame_id == 'world'
    assert (frame.stamp.sec, frame.stamp.nanosec) == (5, 7)


def test_rows_of_an_organised_cloud_may_be_padded():
    message = cloud(CLOUD_POINTS, height=2, row_padding=5)
    np.testing.assert_array_equal(points_of_cloud(message).points, CLOUD_POINTS)


def test_integers_are_numbers_too():
    message = cloud(np.array([[1, -2, 3]]), form='i2')
    np.testing.assert_array_equal(points_of_cloud(message).points, [[1., -2., 3.]])


def test_points_that_are_not_finite_are_left_out():
    points = CLOUD_POINTS.copy()
    points[0, 1], points[2, 2] = np.nan, np.inf
    np.testing.assert_array_equal(points_of_cloud(cloud(points)).points, CLOUD_POINTS[[1, 3]])


def test_an_empty_cloud_is_a_frame_without_points():
    assert points_of_cloud(cloud(np.empty((0, 3)))).points.shape == (0, 3)


def without_z(message):
    message.fields[2].name = 'height'


def unknown_type(message):
    message.fields[0].datatype = max(NUMBER_FORMATS.values()) + 1


def field_beyond_the_point(message):
    message.fields[2].offset = message.point_step - 1


def too_little_data(message):
    message.data = message.data[:-1]


def overlapping_rows(message):
    message.height, message.width, message.row_step = 2, 2, 4


@pytest.mark.parametrize('damage, said', [
    (without_z, "no field 'z'; it has x, y, height"), (unknown_type, "'x' has data type 9"),
    (field_beyond_the_point, "'z' at byte 11 goes beyond point_step 12"),
    (too_little_data, '47 bytes of data; 1 rows of 4 points of 12 bytes'),
    (overlapping_rows, 'a row every 4')])
def test_contradictions_are_named(damage, said):
    message = cloud(CLOUD_POINTS)
    damage(message)
    with pytest.raises(MalformedFrame, match='point cloud: ') as error:
        points_of_cloud(message)
    assert said in str(error.value)
