"""Points of no hand, from frame to frame."""

import numpy as np

from hand_tracker.core.point_labelling.clutter import (
    CLUTTER_COST,
    STRETCH,
    continue_clutter,
    no_clutter,
    remember_clutter,
)

STEP = .01


def test_points_of_no_hand_go_on_as_they_moved_and_others_have_just_come():
    clutter = no_clutter(2)
    random = np.random.default_rng(1)
    first = np.array(((0., 0., 0.), (.1, 0., 0.), (.2, .1, 0.)))
    speeds = np.array(((.3, 0., 0.), (-.3, .2, 0.), (0., 0., 0.)))
    last_order = np.arange(3)
    for number in range(15):
        order = random.permutation(3)
        points = (first + speeds * STEP * number)[order]
        before, cost = np.empty(3, dtype=np.int64), np.empty(3)
        history = continue_clutter(clutter, points, STEP, before, cost)
        if number:
            # Rows of the last frame's order.
            assert np.array_equal(last_order[before], order)
        clutter = remember_clutter(
            clutter, points, np.ones(3, dtype=bool), before, history, STEP)
        last_order = order
    assert np.allclose(clutter.history.age, 14 * STEP)
    assert np.allclose(clutter.speed[np.argsort(order)], speeds)
    # The path is judged by stretches: each point's pace is that of the last whole one.
    assert np.allclose(clutter.history.pace[np.argsort(order)], speeds)
    assert (clutter.history.stretch < STRETCH).all()
    assert np.all((cost > .5 * CLUTTER_COST) & (cost <= CLUTTER_COST))
    points = np.vstack((points, (.1, .1, .1)))
    before, cost = np.empty(4, dtype=np.int64), np.empty(4)
    history = continue_clutter(clutter, points, 0., before, cost)
    assert before.tolist() == [0, 1, 2, -1]
    assert np.isneginf(cost[3])
    assert history.age[3] == 0. and np.isnan(history.pace[3]).all()


def test_points_that_a_hand_has_are_not_remembered():
    points = np.eye(3)
    before, cost = np.empty(3, dtype=np.int64), np.empty(3)
    clutter = no_clutter(2)
    history = continue_clutter(clutter, points, STEP, before, cost)
    clutter = remember_clutter(
        clutter, points, np.array((True, False, True)), before, history, STEP)
    assert np.array_equal(clutter.place, points[[0, 2]])
    assert not clutter.history.age.any()
