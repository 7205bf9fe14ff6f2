"""Messages of mocap4r2's drivers, as their definition has them."""

from types import SimpleNamespace

import numpy as np

from hand_tracker.adapters.mocap4r2 import points_of_markers, points_of_rigid_bodies

NAME, INDEX, BOTH_WAYS = range(3)


def marker(kind, index, name, *at):
    return SimpleNamespace(id_type=kind, marker_index=index, marker_name=name,
                           translation=SimpleNamespace(**dict(zip('xyz', at))))


def message(**fields):
    stamp = SimpleNamespace(sec=1, nanosec=2)
    return SimpleNamespace(header=SimpleNamespace(stamp=stamp, frame_id='map'), frame_number=3,
                           **fields)


def test_named_markers_are_named_and_indices_are_not():
    frame = points_of_markers(message(markers=[
        marker(NAME, 0, 'index', 1., 2., 3.), marker(INDEX, 5, 'ignored', 4., 5., 6.),
        marker(BOTH_WAYS, 7, 'thumb', float('nan'), 0., 0.), marker(NAME, 0, '', 7., 8., 9.)]))
    assert frame.names == ('index', 'thumb')
    np.testing.assert_array_equal(frame.markers, [[1., 2., 3.], [np.nan] * 3])
    np.testing.assert_array_equal(frame.points, [[4., 5., 6.], [7., 8., 9.]])
    assert (frame.frame_id, frame.stamp.nanosec) == ('map', 2)


def test_markers_of_bodies_have_the_name_of_their_body():
    bodies = [SimpleNamespace(rigid_body_name='RHand', markers=[
        marker(NAME, 0, 'wrist', 1., 2., 3.), marker(INDEX, 2, '', 4., 5., 6.)]),
        SimpleNamespace(rigid_body_name='cup', markers=[])]
    frame = points_of_rigid_bodies(message(rigidbodies=bodies))
    assert frame.names == ('RHand:wrist', 'RHand:2')
    np.testing.assert_array_equal(frame.markers, [[1., 2., 3.], [4., 5., 6.]])
    assert frame.points.shape == (0, 3)
