"""Points of no hand, from frame to frame."""

import numpy as np

from hand_tracker.core.point_labelling.clutter import (
    CLUTTER_COST,
    STRETCH,
    continue_clutter,
    new_cloud,
    no_clutter,
    no_points,
    with_slots,
)

STEP = .01


def cloud_of(points):
    """Return a frame of points without ids."""
    return new_cloud(np.array(points, dtype=float), np.full(len(points), -1))


def test_points_of_no_hand_go_on_as_they_moved_and_others_have_just_come():
    clutter, last = no_clutter(2, slots=4), no_points()
    random = np.random.default_rng(1)
    first = np.array(((0., 0., 0.), (.1, 0., 0.), (.2, .1, 0.)))
    speeds = np.array(((.3, 0., 0.), (-.3, .2, 0.), (0., 0., 0.)))
    slots = None
    for number in range(15):
        order = random.permutation(3)
        cloud = cloud_of((first + speeds * STEP * number)[order])
        continue_clutter(clutter, last, STEP, cloud, STEP)
        assert cloud.free.all()
        if slots is None:
            slots = cloud.slots[np.argsort(order)]
            assert np.isneginf(cloud.cost).all()
        # Each keeps its slot, whatever the order.
        assert np.array_equal(cloud.slots, slots[order])
        last = cloud
    assert np.all((last.cost > .5 * CLUTTER_COST) & (last.cost <= CLUTTER_COST))
    cloud = cloud_of([*last.points, (.1, .1, .1)])
    continue_clutter(clutter, last, STEP, cloud, 0.)
    assert np.array_equal(cloud.slots[:3], last.slots)
    assert np.isneginf(cloud.cost[3])
    history, mine = clutter.history, slots
    assert np.allclose(history.age[mine], 14 * STEP)
    assert np.allclose(clutter.speed[mine], speeds)
    # The path is judged by stretches: each point's pace is that of the last whole one.
    assert np.allclose(history.pace[mine], speeds)
    assert (history.stretch[mine] < STRETCH).all()
    new = cloud.slots[3]
    assert history.age[new] == 0. and np.isnan(history.pace[new]).all()


def test_points_that_a_hand_has_are_not_remembered():
    clutter, cloud = no_clutter(2, slots=3), cloud_of(np.eye(3))
    continue_clutter(clutter, no_points(), STEP, cloud, STEP)
    cloud.free[1] = False
    again = cloud_of(np.eye(3))
    continue_clutter(clutter, cloud, STEP, again, STEP)
    assert np.isneginf(again.cost).tolist() == [False, True, False]
    assert clutter.history.age[again.slots].tolist() == [STEP, 0., STEP]


def test_points_keep_what_is_known_of_them_where_there_are_more_slots():
    clutter, cloud = no_clutter(2, slots=3), cloud_of(np.eye(3))
    continue_clutter(clutter, no_points(), STEP, cloud, STEP)
    many = cloud_of([*np.eye(3), *(2. + np.eye(3))])
    more = with_slots(clutter, 6)
    continue_clutter(more, cloud, STEP, many, STEP)
    assert np.array_equal(many.slots[:3], cloud.slots)
    assert len({*many.slots.tolist()}) == 6
    assert np.isneginf(many.cost).tolist() == [False] * 3 + [True] * 3
